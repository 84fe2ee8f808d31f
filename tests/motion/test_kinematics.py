"""motion.kinematics: forward kinematics compared with a plain loop and with pybvh."""

from pathlib import Path

import numpy as np
import pybvh
import pytest
from conftest import random_clip

from signsplice.formats import save
from signsplice.motion import Clip, FloatArray, kinematics, rotation


def positions_by_loop(clip: Clip) -> FloatArray:
    """Global positions (T, J, 3), computed one frame and one joint at a time."""
    out = np.empty((len(clip), len(clip.skeleton), 3))
    for t in range(len(clip)):
        global_matrices: list[FloatArray] = []
        for j, parent in enumerate(clip.skeleton.parents):
            local = rotation.to_matrix(clip.local_rotations[t, j])
            if parent < 0:
                out[t, j] = clip.root_positions[t]
                global_matrices.append(local)
            else:
                out[t, j] = out[t, parent] + global_matrices[parent] @ clip.skeleton.offsets[j]
                global_matrices.append(global_matrices[parent] @ local)
    return out


@pytest.mark.parametrize("seed", range(5))
def test_forward_agrees_with_a_plain_loop(seed: int) -> None:
    clip = random_clip(seed)
    rotations, positions = kinematics.forward(clip)
    assert np.allclose(positions, positions_by_loop(clip))
    some_rotations, some_positions = kinematics.forward(clip, [7, 0, 3])
    assert np.allclose(some_positions, positions[:, [7, 0, 3]], atol=1e-12)
    assert np.allclose(some_rotations, rotations[:, [7, 0, 3]], atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_forward_agrees_with_pybvh(seed: int, tmp_path: Path) -> None:
    clip = random_clip(seed)
    save(clip, tmp_path / "clip.bvh")
    other = pybvh.read_bvh_file(tmp_path / "clip.bvh", world_up="+y")
    assert list(other.joint_names) == list(clip.skeleton.names)
    assert np.allclose(other.joint_positions(), kinematics.forward(clip)[1], atol=1e-6)


def test_forward_of_real_clips_agrees_with_pybvh(real_clips: dict[str, Clip]) -> None:
    from conftest import REAL

    for name in ("isl_thanks", "long_take_metres", "SitIdle"):
        other = pybvh.read_bvh_file(REAL / f"{name}.bvh", world_up="+y")
        positions = kinematics.forward(real_clips[name])[1]
        assert np.allclose(other.joint_positions(), positions, atol=1e-9 * np.abs(positions).max())


def test_tip_positions_are_those_of_the_end_sites() -> None:
    clip = random_clip(2)
    rotations, positions = kinematics.forward(clip)
    tips = kinematics.tip_positions(clip, rotations, positions)
    for e, site in enumerate(clip.skeleton.end_sites):
        expected = positions[:, site.joint] + rotations[:, site.joint] @ site.offset
        assert np.allclose(tips[:, e], expected)
