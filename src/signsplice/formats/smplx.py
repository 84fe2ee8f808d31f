"""SMPL-X and SMPL-H poses (``.npz``): rotation vectors of 55 or 52 joints, as in AMASS and signing data sets.

Bones have the lengths of this project's signer: the model's own shapes are licensed, and ``betas`` need them. The
joints' axes are the world's in the T-pose, X to the signer's left, Y up, Z ahead; ``trans`` is the pelvis' position.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, rotation
from signsplice.rig.align import copy_rotations, reference

_USUAL_FPS = 30.0
# Joint, number of its parent, and its position in the T-pose, cm from the pelvis.
_TRUNK = (
    ("pelvis", -1, 0, 0, 0), ("left_hip", 0, 9, -4, 0), ("right_hip", 0, -9, -4, 0), ("spine1", 0, 0, 10, -1),
    ("left_knee", 1, 9, -45, 0.5), ("right_knee", 2, -9, -45, 0.5), ("spine2", 3, 0, 22, -1.5),
    ("left_ankle", 4, 9, -85, -1), ("right_ankle", 5, -9, -85, -1), ("spine3", 6, 0, 35, -1.5),
    ("left_foot", 7, 10, -91, 11), ("right_foot", 8, -10, -91, 11), ("neck", 9, 0, 51, -1),
    ("left_collar", 9, 5, 45, -0.5), ("right_collar", 9, -5, 45, -0.5), ("head", 12, 0, 60, 1),
    ("left_shoulder", 13, 18, 47, -1), ("right_shoulder", 14, -18, 47, -1), ("left_elbow", 16, 47.5, 47, -1),
    ("right_elbow", 17, -47.5, 47, -1), ("left_wrist", 18, 73, 47, -1), ("right_wrist", 19, -73, 47, -1),
)  # fmt: skip
_FACE = (("jaw", 15, 0, 62, 3), ("left_eye_smplhf", 15, 3.2, 69, 8), ("right_eye_smplhf", 15, -3.2, 69, 8))
_FINGERS = {
    "index": ((81.5, 47, 1.9), (86, 47, 1.9), (88.6, 47, 1.9)),
    "middle": ((81.6, 47.2, -0.3), (86.5, 47.2, -0.3), (89.5, 47.2, -0.3)),
    "pinky": ((80.3, 46.6, -4.4), (83.9, 46.6, -4.4), (86, 46.6, -4.4)),
    "ring": ((81, 47, -2.4), (85.5, 47, -2.4), (88.4, 47, -2.4)),
    "thumb": ((74.9, 45.8, 1.2), (78, 44.6, 3.9), (80.5, 43.6, 6.1)),
}
"""Finger -> positions of its left joints in the T-pose, cm from the pelvis."""
_PARTS = (
    (3, ("root_orient", "global_orient", "smplx_root_pose")),
    (63, ("pose_body", "body_pose", "smplx_body_pose")),
    (3, ("pose_jaw", "jaw_pose", "smplx_jaw_pose")),
    (3, ("leye_pose", "smplx_leye_pose")),
    (3, ("reye_pose", "smplx_reye_pose")),
    (45, ("left_hand_pose", "smplx_lhand_pose")),
    (45, ("right_hand_pose", "smplx_rhand_pose")),
)
"""Parts of a pose in the order of the joints: count of numbers, and array names. Some names hold two parts:
``_JOINED``.
"""
_JOINED = {"pose_eye": (3, 5), "pose_hand": (5, 7)}
"""Name -> range of parts that it holds."""
_POSES = ("poses", "fullpose")
"""Names of an array of whole poses."""
_TRANS = ("trans", "transl", "smplx_transl")
"""Names of the array of root positions."""
_RATES = ("mocap_frame_rate", "mocap_framerate", "fps")
"""Names of the frame rate."""
_NOT_READ = ("betas", "expression", "smplx_shape", "smplx_expr", "dmpls")
"""Arrays that a clip does not hold."""
NAMES = (*_POSES, *(name for _, names in _PARTS for name in names), *_JOINED, *_TRANS, *_RATES, *_NOT_READ)
"""Names of all arrays that are read from an archive."""
N_NUMBERS = {165: 55, 156: 52}
"""Numbers of a whole pose -> joints, with and without a face."""


def is_smplx(names: Collection[str]) -> bool:
    """Whether an archive with arrays of these names holds SMPL-X poses."""
    return any(name in names for name in (*_POSES, *_PARTS[1][1]))


def skeleton(n_joints: int) -> Skeleton:
    """Return the signer's skeleton with the joints of SMPL-X (55) or SMPL-H (52), in metres."""
    rows = [*_TRUNK, *(_FACE if n_joints == 55 else ())]
    for side, sign, wrist in (("left", 1, 20), ("right", -1, 21)):
        for finger, places in _FINGERS.items():
            for k, (x, y, z) in enumerate(places):
                rows.append((f"{side}_{finger}{k + 1}", len(rows) - 1 if k else wrist, sign * x, y, z))
    parents = np.array([row[1] for row in rows])
    positions = 0.01 * np.array([row[2:] for row in rows], np.float64)  # (J, 3)
    offsets = positions - np.where((parents >= 0)[:, None], positions[parents], 0.0)
    return Skeleton(tuple(row[0] for row in rows), parents, offsets)


def from_arrays(arrays: Mapping[str, NDArray[Any]], name: str) -> Clip:
    """Build the clip from an archive's arrays. Raises ``InputError`` if they are no poses."""
    poses = _whole_poses(arrays)
    bones = skeleton(N_NUMBERS[poses.shape[1]])
    roots = next((arrays[key] for key in _TRANS if key in arrays), np.zeros((len(poses), 3)))
    rates = [key for key in _RATES if key in arrays]
    notes = [] if rates else [f"it names no frame rate: {_USUAL_FPS:g} fps is taken"]
    if len(poses) == 1:
        notes = ["it holds one frame; join the files of a recording into arrays of (frames, numbers), in one file"]
    notes += [f"{key} is not read: bones have this project's lengths" for key in ("betas",) if _is_used(arrays, key)]
    return Clip(
        bones,
        rotation.exp(_check_array("poses", poses, poses.shape).reshape(len(poses), -1, 3)),
        _part("trans", roots, len(poses), 3),
        float(arrays[rates[0]]) if rates and arrays[rates[0]].ndim == 0 else _USUAL_FPS,
        name,
        left_out=tuple(key for key in _NOT_READ if key != "betas" and _is_used(arrays, key)),
        notes=tuple(notes),
    )


def encode(clip: Clip) -> bytes:
    """Encode a clip in an archive with the arrays of AMASS' SMPL-X files; hands as rotations from the flat hand. A clip
    of another rig is converted by its joints' roles. Raises ``RigMismatchError`` if that is no person.
    """
    bones = skeleton(55)
    if clip.skeleton.names != bones.names:
        rest = Clip(bones, np.tile(rotation.IDENTITY, (1, len(bones), 1)), np.zeros((1, 3)), clip.fps, "SMPL-X")
        clip = copy_rotations(clip, reference(rest), by_role=True)[0]
    poses = rotation.log(clip.local_rotations).reshape(len(clip), -1)  # (T, 165)
    archive = BytesIO()
    np.savez_compressed(
        archive,
        surface_model_type=np.array("smplx"),
        gender=np.array("neutral"),
        mocap_frame_rate=np.array(clip.fps),
        trans=clip.root_positions,
        poses=poses,
        betas=np.zeros(16),
        root_orient=poses[:, :3],
        pose_body=poses[:, 3:66],
        pose_jaw=poses[:, 66:69],
        pose_eye=poses[:, 69:75],
        pose_hand=poses[:, 75:],
    )
    return archive.getvalue()


def _whole_poses(arrays: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """Return poses (T, 165 or 156) of an archive that holds them whole or in parts; missing parts are at rest."""
    for key in _POSES:
        if key in arrays:
            poses = np.atleast_2d(arrays[key])
            if poses.ndim != 2 or poses.shape[1] not in N_NUMBERS:
                raise InputError(
                    f"{key} has shape {arrays[key].shape}, expected (T, 165) of SMPL-X or (T, 156) of SMPL-H"
                )
            return poses
    body = next(arrays[name] for name in _PARTS[1][1] if name in arrays)
    n_frames = 1 if body.ndim < 2 or body.shape == (21, 3) else len(body)
    parts: list[NDArray[Any]] = []
    for number, (size, names) in enumerate(_PARTS):
        key = next((name for name in names if name in arrays), "")
        joined = next((name for name, (a, b) in _JOINED.items() if a <= number < b and name in arrays), "")
        if key:
            parts.append(_part(key, arrays[key], n_frames, size))
        elif joined:
            first, stop = _JOINED[joined]
            joined_poses = _part(joined, arrays[joined], n_frames, size * (stop - first))
            parts.append(joined_poses[:, size * (number - first) : size * (number - first + 1)])
        else:
            parts.append(np.zeros((n_frames, size)))
    return np.concatenate(parts, axis=1)


def _part(name: str, values: NDArray[Any], n_frames: int, size: int) -> FloatArray:
    """Return values (T, size) of an array of T frames; of one frame, the array may have any shape of ``size`` numbers.

    OSX and SMPLer-X write a file for each frame, with arrays (3,) and (63,), or (1, 3) and (21, 3).
    """
    if values.size == n_frames * size and (n_frames == 1 or len(values) == n_frames):
        values = values.reshape(n_frames, size)
    return _check_array(name, values, (n_frames, size))


def _check_array(name: str, values: NDArray[Any], shape: tuple[int, ...]) -> FloatArray:
    if values.shape != shape:
        what = (
            "; hands in PCA need the licensed model"
            if shape[1] == 45 and values.shape[-1:] not in ((45,), (3,))
            else ""
        )
        raise InputError(f"{name} has shape {values.shape}, expected {shape}{what}")
    if not np.isfinite(values).all():
        raise InputError(f"{name}: a number is not finite")
    return np.asarray(values, np.float64)


def _is_used(arrays: Mapping[str, NDArray[Any]], name: str) -> bool:
    return name in arrays and bool(np.any(arrays[name]))
