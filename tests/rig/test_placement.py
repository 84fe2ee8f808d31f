"""rig.align: where a signer stands, clips moved there as rigid wholes, and the clip that each was moved from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import random_clip

from signsplice.body.retarget import align
from signsplice.motion import Clip, concatenate, resample, rotation
from signsplice.rig.align import Placement, place, placement, reference


def elsewhere(clip: Clip) -> Placement:
    """Another placement than that of the clip: 1 m to the side, facing left."""
    current = placement(clip)
    return Placement(current.position + np.array([100.0, 0.0, 0.0]), current.up, np.cross(current.up, current.forward))


def test_a_placed_clip_stands_at_its_target(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    target = elsewhere(clip)
    found = placement(place(clip, target))
    np.testing.assert_allclose(found.up, target.up, atol=1e-9)
    np.testing.assert_allclose(found.forward, target.forward, atol=1e-9)
    np.testing.assert_allclose(found.position, target.position, atol=1e-9)


def test_a_clip_that_stands_at_its_target_is_returned(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    assert place(clip, placement(clip)) is clip


def test_a_moved_clip_has_the_clip_it_was_moved_from(words: dict[str, Clip]) -> None:
    clip = words["DEAF"]
    assert clip.source_clip is None
    moved = align(clip, reference(words["HELLO"])).clip
    assert moved is not clip
    again = place(moved, elsewhere(clip))
    assert again is not moved
    assert moved.source_clip is again.source_clip is clip


def test_any_other_change_of_a_placed_clip_drops_its_source(words: dict[str, Clip]) -> None:
    clip = words["DEAF"]
    placed = place(clip, elsewhere(clip))
    assert placed.source_clip is clip
    changed = {
        "slicing": placed[2:-2],
        "slicing all frames": placed[:],
        "replace": replace(placed, name="other"),
        "resample": resample(placed, 60.0),
        "resample in speed": resample(placed, placed.fps, speed=2.0),
        "concatenate": concatenate([placed, placed]),
        "concatenate one clip": concatenate([placed]),
        "resample at another speed": resample(align(clip, reference(words["HELLO"])).clip, clip.fps, 2.0),
    }
    assert {what: other.source_clip for what, other in changed.items()} == dict.fromkeys(changed)


def test_a_clip_cannot_be_made_with_a_source(words: dict[str, Clip]) -> None:
    clip = words["DEAF"]
    with pytest.raises(TypeError, match="source_clip"):
        Clip(clip.skeleton, clip.local_rotations, clip.root_positions, 30.0, source_clip=clip)  # type: ignore[call-arg]


def test_a_rig_without_a_body_stands_at_its_root_and_faces_z() -> None:
    clip = random_clip(3)
    found = placement(clip)
    np.testing.assert_array_equal(found.up, [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(found.forward, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(found.position, np.median(clip.root_positions, axis=0), atol=1e-9)


def test_the_vertical_is_the_world_axis_nearest_to_the_trunk(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    tilt = rotation.exp([np.pi / 2.0, 0.0, 0.0])  # from Y up to Z up
    local = np.array(clip.local_rotations)
    local[:, 0] = rotation.multiply(tilt, local[:, 0])
    z_up = replace(clip, local_rotations=local, root_positions=rotation.rotate(tilt, clip.root_positions))
    np.testing.assert_array_equal(placement(clip).up, [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(placement(z_up).up, [0.0, 0.0, 1.0])
