"""SMPL-X poses: joints by an independent product of rotations, layouts of several sets, and archives that are wrong."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from signsplice import lexicon
from signsplice.errors import InputError
from signsplice.formats import load, npz, save, smplx
from signsplice.motion import Clip, kinematics, rotation
from signsplice.rig.info import rig_info

RNG = np.random.default_rng(11)
POSES, TRANS = RNG.normal(size=(5, 165)) * 0.5, RNG.normal(size=(5, 3))


def archive(**arrays: Any) -> bytes:
    out = BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def read(**arrays: Any) -> Clip:
    return npz.parse(archive(**arrays), "word.npz")


@pytest.mark.parametrize(("n_numbers", "n_joints"), [(165, 55), (156, 52)])
def test_joints_are_where_products_of_rotation_vectors_put_them(n_numbers: int, n_joints: int) -> None:
    clip = read(poses=POSES[:, :n_numbers], trans=TRANS, mocap_frame_rate=np.array(60))
    bones = clip.skeleton
    assert clip.fps == 60.0
    assert len(bones) == n_joints
    turned, placed = np.empty((5, n_joints, 3, 3)), np.empty((5, n_joints, 3))
    for j in range(n_joints):
        local = Rotation.from_rotvec(POSES[:, 3 * j : 3 * j + 3]).as_matrix()
        parent = bones.parents[j]
        turned[:, j] = local if parent < 0 else turned[:, parent] @ local
        placed[:, j] = TRANS if parent < 0 else placed[:, parent] + turned[:, parent] @ bones.offsets[j]
    np.testing.assert_allclose(kinematics.forward(clip)[1], placed, atol=1e-12)


def test_the_rest_pose_is_a_symmetric_t_pose_whose_joints_all_have_roles() -> None:
    bones = smplx.skeleton(55)
    places = dict(zip(bones.names, kinematics.rest_positions(bones), strict=True))
    for name, place in places.items():
        if name.startswith("left_"):
            np.testing.assert_allclose(places[name.replace("left", "right")], place * [-1, 1, 1], atol=1e-12)
    assert places["left_wrist"][1] == pytest.approx(places["left_shoulder"][1])
    assert len(rig_info(bones).roles.joints) == 55
    assert 1.5 < rig_info(bones).sizes.unit.stature_m < 1.8


PARTS = {
    "root_orient": POSES[:, :3], "pose_body": POSES[:, 3:66], "pose_jaw": POSES[:, 66:69],
    "pose_eye": POSES[:, 69:75], "pose_hand": POSES[:, 75:],
}  # fmt: skip
OF_THE_MODEL = {
    "global_orient": POSES[:, :3], "body_pose": POSES[:, 3:66].reshape(5, 21, 3), "jaw_pose": POSES[:, 66:69],
    "leye_pose": POSES[:, 69:72], "reye_pose": POSES[:, 72:75], "left_hand_pose": POSES[:, 75:120],
    "right_hand_pose": POSES[:, 120:],
}  # fmt: skip


@pytest.mark.parametrize("parts", [PARTS, OF_THE_MODEL])
def test_poses_in_parts_are_the_same_as_whole_ones(parts: dict[str, Any]) -> None:
    whole, made = read(poses=POSES, trans=TRANS), read(**parts, transl=TRANS)
    np.testing.assert_array_equal(made.local_rotations, whole.local_rotations)
    np.testing.assert_array_equal(made.root_positions, whole.root_positions)


def test_parts_that_are_missing_are_at_rest_and_a_missing_rate_is_noted() -> None:
    clip = read(body_pose=POSES[:, 3:66], betas=np.ones(10), expression=np.ones((5, 10)))
    np.testing.assert_array_equal(clip.local_rotations[:, 25:], np.broadcast_to(rotation.IDENTITY, (5, 30, 4)))
    assert clip.left_out == ("expression",)
    assert len(clip.notes) == 2


CASES = Path(__file__).parents[1] / "data" / "cases" / "smplx_single_frame"


@pytest.mark.parametrize("file", ["osx_frame.npz", "smplerx_frame.npz"])
def test_a_file_of_one_frame_is_read_with_a_note(file: str) -> None:
    """OSX and SMPLer-X write a file for each frame of a film."""
    clip = load(CASES / file)
    with np.load(CASES / file) as stored:
        body = next(stored[name] for name in ("smplx_body_pose", "body_pose") if name in stored)
    assert len(clip) == 1
    np.testing.assert_allclose(rotation.log(clip.local_rotations[0, 1:22]).ravel(), body.ravel(), atol=1e-9)
    assert clip.notes[0].startswith("it holds one frame; name the folder")


@pytest.mark.parametrize(
    "arrays",
    [
        {name: part[0] for name, part in PARTS.items()} | {"trans": TRANS[0]},
        {name: part[:1] for name, part in OF_THE_MODEL.items()} | {"transl": TRANS[:1]},
        {name: part[0].reshape(-1, 3) for name, part in OF_THE_MODEL.items()} | {"transl": TRANS[0]},
        {"poses": POSES[0], "trans": TRANS[0]},
    ],
)
def test_one_frame_may_have_any_shape(arrays: dict[str, Any]) -> None:
    clip, whole = read(**arrays), read(poses=POSES, trans=TRANS)
    np.testing.assert_array_equal(clip.local_rotations, whole.local_rotations[:1])
    np.testing.assert_array_equal(clip.root_positions, whole.root_positions[:1])


def test_what_is_written_is_read_back_within_a_hundredth_of_a_degree(tmp_path: Path) -> None:
    with lexicon.open_shipped_lexicon() as words:
        source = words.clip("NAME")
    path, again = tmp_path / "name.smplx.npz", tmp_path / "again.smplx.npz"
    save(source, path)
    carried = load(path)
    save(carried, again)
    angles = np.rad2deg(rotation.angle_between(load(again).local_rotations, carried.local_rotations))
    assert angles.max() < 0.01
    with np.load(path, allow_pickle=False) as stored:
        assert stored["poses"].shape == (len(source), 165)
        assert stored["mocap_frame_rate"] == source.fps
    # Bones point where they pointed: the two hands lie alike between the shoulders, in arm lengths.
    for clip, arm in ((source, rig_info(source.skeleton)), (carried, rig_info(carried.skeleton))):
        joints = arm.roles.joints
        at = kinematics.forward(clip, [joints["rightUpperArm"], joints["rightHand"]])[1] / arm.sizes.arm_length
        reach = at[:, 1] - at[:, 0]
        if clip is source:
            expected = reach
    np.testing.assert_allclose(reach, expected, atol=0.02)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"poses": POSES[:, :72]}, r"poses has shape \(5, 72\), expected"),
        ({"poses": POSES, "trans": TRANS[:4]}, r"trans has shape \(4, 3\), expected \(5, 3\)"),
        ({"poses": np.where(POSES > 1, np.nan, POSES)}, "poses: a number is not finite"),
        ({"body_pose": POSES[:, 3:66], "left_hand_pose": POSES[:, :12]}, "hands in PCA need the licensed model"),
        ({"body_pose": POSES[:, 3:60]}, r"body_pose has shape"),
        ({"body_pose": POSES[0, 3:66], "left_hand_pose": POSES[0, :12]}, "hands in PCA need the licensed model"),
        ({"body_pose": POSES[:, 3:66], "left_hand_pose": POSES[:4, :45]}, r"has shape \(4, 45\), expected \(5, 45\)\)"),
        ({"body_pose": POSES[:, 3:66], "global_orient": POSES[:3, :5]}, r"global_orient has shape \(3, 5\), expected"),
        ({"body_pose": POSES[:, 3:66].T}, r"body_pose has shape \(63, 5\), expected \(63, 63\)"),
        ({"body_pose": POSES[0, 0]}, r"body_pose has shape \(\), expected \(1, 63\)"),
        ({"body_pose": POSES[:, 3:66], "jaw_pose": POSES[0, :3]}, r"jaw_pose has shape \(3,\), expected \(5, 3\)"),
        ({"poses": POSES, "mocap_frame_rate": np.array(-5.0)}, "frame rate -5.0"),
        ({"poses": np.array([{"a": 1}], object)}, "poses holds object, expected numbers"),
        ({"poses": POSES.astype(str)}, "expected numbers"),
        ({"other": POSES}, "it is no clip that signsplice wrote, nor poses of SMPL-X"),
    ],
)
def test_a_wrong_archive_is_one_line(arrays: dict[str, Any], message: str, tmp_path: Path) -> None:
    file = tmp_path / "word.npz"
    file.write_bytes(archive(**arrays))
    with pytest.raises(InputError, match=message) as caught:
        load(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert "\n" not in str(caught.value)
