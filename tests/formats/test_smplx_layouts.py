"""SMPL-X poses as research data sets publish them: rows of numbers, pickles, folders of frames, a camera's axes."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.formats import ReadAs, load, smplx
from signsplice.motion import Clip, kinematics, rotation

RNG = np.random.default_rng(5)
N_FRAMES = 12
Arrays = dict[str, Any]


def parts(n_frames: int = N_FRAMES, root: Any = (0.1, -0.2, 0.05)) -> Arrays:
    """Numbers of each part of a pose, those of the root near a rotation vector."""
    sizes = {"body": 63, "left": 45, "right": 45, "jaw": 3}
    turned = Rotation.from_rotvec(RNG.normal(size=(n_frames, 3)) * 0.05) * Rotation.from_rotvec(root)
    return {"root": turned.as_rotvec()} | {name: RNG.normal(size=(n_frames, n)) * 0.3 for name, n in sizes.items()}


def other(n: int) -> NDArray[Any]:
    return RNG.normal(size=(N_FRAMES, n))


def whole(p: Arrays) -> NDArray[Any]:
    return np.hstack([p["root"], p["body"], p["jaw"], np.zeros((len(p["root"]), 6)), p["left"], p["right"]])


def saved(values: Any, path: Path) -> Path:
    np.save(path, values) if path.suffix == ".npy" else path.write_bytes(pickle.dumps(values))
    return path


def assert_poses(clip: Clip, p: Arrays) -> None:
    """The clip's joints have the rotations of the parts, by scipy."""
    expected = Rotation.from_rotvec(whole(p).reshape(-1, 3)).as_matrix().reshape(-1, 55, 3, 3)
    np.testing.assert_allclose(rotation.to_matrix(clip.local_rotations), expected[:, : len(clip.skeleton)], atol=2e-6)


def test_rows_of_motion_x_hold_hands_before_the_jaw_and_the_translation_after_the_face(tmp_path: Path) -> None:
    p, trans = parts(), other(3)
    rows = [p["root"], p["body"], p["left"], p["right"], p["jaw"], other(50), other(100), trans, other(10)]
    clip = load(saved(np.hstack(rows).astype(np.float32), tmp_path / "a.npy"))
    assert_poses(clip, p)
    np.testing.assert_allclose(clip.root_positions, trans, atol=1e-6)
    assert clip.fps == 30.0
    assert clip.left_out == ("expression",)
    assert clip.notes == (
        "it names no frame rate: 30 fps is taken", "betas is not read: bones have this project's lengths",
    )  # fmt: skip


def sign_avatars(p: Arrays, n_camera: int = 3) -> NDArray[Any]:
    rows = [p["root"], p["body"], p["left"], p["right"], p["jaw"], other(10), other(10), other(n_camera)]
    return np.hstack(rows).astype(np.float32)


@pytest.mark.parametrize("n_camera", [3, 0])
@pytest.mark.parametrize("suffix", [".npy", ".pkl"])
def test_rows_of_sign_avatars_hold_the_left_hand_first_and_a_camera_last(
    n_camera: int, suffix: str, tmp_path: Path
) -> None:
    p = parts()
    rows = sign_avatars(p, n_camera)
    film = {"smplx": rows, "unsmooth_smplx": other(169), "height": 720, "focal": other(2), "left_valid": [True]}
    clip = load(saved(rows if suffix == ".npy" else film, tmp_path / f"a{suffix}"))
    assert_poses(clip, p)
    np.testing.assert_array_equal(clip.root_positions, 0.0)
    assert "hands are relative to the model's mean hand, which is licensed: fingers bend too little" in clip.notes


@pytest.mark.parametrize("n_numbers", [165, 156])
def test_rows_of_plain_poses_are_read(n_numbers: int, tmp_path: Path) -> None:
    poses = whole(parts())[:, :n_numbers]
    clip = load(saved(poses, tmp_path / "a.npy"), read=ReadAs(fps=24))
    np.testing.assert_allclose(
        rotation.to_matrix(clip.local_rotations).reshape(-1, 3, 3),
        Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix(), atol=1e-9,
    )  # fmt: skip
    assert clip.fps == 24.0


CAMERA = Rotation.from_euler("x", 180, degrees=True)
"""From axes with Y up, Z ahead of the signer to those of a camera before the signer: Y down, Z away from the camera."""
Z_UP = Rotation.from_euler("x", 90, degrees=True)


@pytest.mark.parametrize(
    ("axes", "note"),
    [(CAMERA, "poses in a camera's axes are turned upright; the signer stays in place"),
     (Z_UP, "poses with Z up are turned upright")],
)  # fmt: skip
def test_a_signer_in_other_axes_comes_out_upright_and_faces_ahead(axes: Rotation, note: str, tmp_path: Path) -> None:
    """The left forearm of a T-pose bends up by 90 degrees: its hand lies above the elbow, by the model's definition."""
    poses, n = np.zeros((6, 165)), 6
    lean = Rotation.from_euler("xz", [[5, 3]] * n, degrees=True)  # a body is never exactly upright
    poses[:, :3] = (axes * lean).as_rotvec()
    elbow = 3 * smplx.skeleton(55).names.index("left_elbow")
    poses[:, elbow + 2] = np.pi / 2
    path = tmp_path / "a.npz"
    np.savez(path, poses=poses, trans=axes.apply(np.tile([0.3, 1.0, 2.0], (n, 1))))
    clip = load(path)
    assert note in clip.notes
    np.testing.assert_allclose(rotation.to_matrix(clip.local_rotations[:, 0]), lean.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(clip.root_positions, [[0, 0, 0] if axes is CAMERA else [0.3, 1.0, 2.0]] * n, atol=1e-9)
    names, at = clip.skeleton.names, kinematics.forward(clip)[1][0]
    head, toes, pelvis, hand, bend = (
        at[names.index(name)] for name in ("head", "left_foot", "pelvis", "left_wrist", "left_elbow")
    )
    assert head[1] > pelvis[1] + 0.4
    assert toes[1] < pelvis[1] - 0.7
    assert toes[2] > at[names.index("left_ankle")][2], "toes point ahead, along Z"
    assert hand[0] > pelvis[0] + 0.3, "the left hand lies to the left, along X"
    assert hand[1] > bend[1] + 0.2


def test_an_upright_signer_is_not_turned_and_keeps_its_place(tmp_path: Path) -> None:
    p, trans = parts(root=(0.3, 2.8, 0.1)), other(3)
    path = tmp_path / "a.npz"
    np.savez(path, poses=whole(p), trans=trans)
    clip = load(path)
    assert_poses(clip, p)
    np.testing.assert_array_equal(clip.root_positions, trans)


def of_a_frame(p: Arrays, t: int) -> Arrays:
    """The arrays that OSX, and the fits of How2Sign, hold of a frame."""
    names = {"root": "root", "body": "body", "left": "lhand", "right": "rhand", "jaw": "jaw"}
    arrays = {f"smplx_{name}_pose": p[part][t].astype(np.float32) for part, name in names.items()}
    return arrays | {"smplx_shape": np.ones(10), "smplx_expr": np.ones(10), "cam_trans": np.array([0.0, 0.1, 9.0])}


def of_the_model(p: Arrays) -> Arrays:
    names = {"root": "global_orient", "left": "left_hand_pose", "right": "right_hand_pose", "jaw": "jaw_pose"}
    return {name: p[part] for part, name in names.items()} | {"body_pose": p["body"].reshape(-1, 21, 3)}


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize(
    "holder",
    [
        lambda p: [of_a_frame(p, t) for t in range(N_FRAMES)],
        lambda p: of_the_model(p) | {"gender": "neutral", "fps": np.float64(25)},
        lambda p: {"video": {"name": "a"}, "smplx_params": of_the_model(p), "fps": 25},
        lambda p: {"params": {"smplx": of_the_model(p) | {"transl": None}}},
        lambda p: {"poses": np.asfortranarray(whole(p).astype(">f8"))},
        lambda p: whole(p),
    ],
)
def test_pickles_of_all_protocols_hold_dicts_frames_or_an_array(holder: Any, protocol: int, tmp_path: Path) -> None:
    p, path = parts(), tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps(holder(p), protocol=protocol))
    clip = load(path)
    assert_poses(clip, p)
    rates = {True: 25.0, False: 30.0}
    assert clip.fps == rates["fps" in str(holder(p)) and isinstance(holder(p), dict)]


def folder_of(p: Arrays, folder: Path, name: str, numbers: Any = range(1, N_FRAMES + 1)) -> Path:
    folder.mkdir(parents=True)
    for t, number in enumerate(numbers):
        path = folder / name.format(number)
        if path.suffix == ".npz":
            np.savez(path, **of_a_frame(p, t))
        else:
            saved(of_a_frame(p, t) if path.suffix == ".pkl" else sign_avatars(p)[t], path)
    (folder / "notes.txt").write_text("not a frame")
    return folder


@pytest.mark.parametrize("name", ["{:06d}.npz", "frame_{}.pkl", "7a-3_{}_3D.pkl", "{:05d}_0.npz", "{}.npy"])
def test_a_folder_of_frames_is_a_clip_in_natural_order(name: str, tmp_path: Path) -> None:
    p = parts()
    clip = load(folder_of(p, tmp_path / "HELLO", name))
    assert_poses(clip, p)
    assert clip.name == "HELLO"
    assert clip.notes[0] == "it names no frame rate: 30 fps is taken"
    assert load(tmp_path / "HELLO", read=ReadAs(fps=24)).fps == 24.0


def test_a_gap_in_the_numbers_of_frames_is_noted(tmp_path: Path) -> None:
    clip = load(folder_of(parts(3), tmp_path / "a", "{}.npz", (8, 9, 12)))
    assert clip.notes[-1] == "2 of the frames 8 to 12 have no file: the others follow each other"


def test_a_folder_is_converted_by_name_or_from_within(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = folder_of(parts(root=(np.pi, 0.1, 0)), tmp_path / "HELLO", "{}.npz")
    monkeypatch.chdir(folder)
    for source in (str(folder), "."):
        result = CliRunner().invoke(app, ["convert", source, str(tmp_path / "a.bvh"), "--input-fps", "24"])
        assert result.exit_code == 0, result.output
        assert "poses in a camera's axes are turned upright; the signer stays in place" in result.output
        clip = load(tmp_path / "a.bvh")
        assert clip.fps == 24.0
        assert len(clip) == N_FRAMES


def test_folders_that_are_no_frames_of_one_recording_are_refused(tmp_path: Path) -> None:
    def refused(folder: Path) -> str:
        with pytest.raises(InputError) as caught:
            load(folder)
        assert "\n" not in str(caught.value)
        assert str(folder) in str(caught.value)
        return str(caught.value)

    (tmp_path / "empty").mkdir()
    assert "is a folder, expected a file, or a folder with files of one kind" in refused(tmp_path / "empty")
    mixed = folder_of(parts(), tmp_path / "mixed", "{}.npz")
    saved(sign_avatars(parts())[0], mixed / "99.npy")
    assert "holds .npy and .npz files" in refused(mixed)
    people = folder_of(parts(), tmp_path / "people", "{}_0.npz")
    np.savez(people / "1_1.npz", **of_a_frame(parts(), 0))
    assert "the names of its files do not tell the order of frames" in refused(people)
    named = folder_of(parts(), tmp_path / "named", "{}.npz")
    np.savez(named / "last.npz", **of_a_frame(parts(), 0))
    assert "expected names that differ in the frame's number alone" in refused(named)
    layouts = folder_of(parts(), tmp_path / "layouts", "{}.npz")
    np.savez(layouts / "13.npz", poses=whole(parts())[0])
    assert "13.npz: holds other arrays than 1.npz, expected frames of one layout" in refused(layouts)
    films = folder_of(parts(), tmp_path / "films", "{}.npz")
    np.savez(films / "13.npz", poses=whole(parts()))
    assert "13.npz: 12 frames, expected one" in refused(films)
    broken = folder_of(parts(), tmp_path / "broken", "{}.npz")
    (broken / "4.npz").write_bytes(b"PK")
    assert "4.npz: is no valid .npz file" in refused(broken)


def test_hands_in_pca_of_sgnify_are_refused_with_what_to_save(tmp_path: Path) -> None:
    frame = {"global_orient": np.zeros((1, 3)), "body_pose": np.zeros((1, 63)), "left_hand_pose": np.zeros((1, 12))}
    for number in range(3):
        (tmp_path / f"{number:03}.pkl").write_bytes(pickle.dumps(frame, protocol=2))
    with pytest.raises(InputError, match=r"000\.pkl: left_hand_pose has shape .* save the 45 numbers"):
        load(tmp_path)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((5, 72)), r"it holds an array (5, 72), expected (T, 322) of Motion-X, (T, 182) of SignAvatars"),
        (np.zeros((5, 55, 3)), "it holds an array (5, 55, 3), expected"),
        (np.zeros(()), "it holds an array (), expected"),
        (np.zeros((0, 182)), "no frames"),
        (np.zeros((5, 182), int), "the array holds int64, expected numbers of 32 or 64 bits"),
        (np.array({"smplx": 1}), "the array holds object, expected numbers"),
        (np.full((5, 182), np.nan), "a number is not finite"),
    ],
)
def test_other_arrays_are_refused_in_a_line_that_says_what_is_expected(
    values: Any, message: str, tmp_path: Path
) -> None:
    path = saved(values, tmp_path / "a.npy")
    with pytest.raises(InputError) as caught:
        load(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
