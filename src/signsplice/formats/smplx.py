"""SMPL-X and SMPL-H poses (``.npz``, ``.npy``, ``.pkl``): rotation vectors of 55 or 52 joints, as in AMASS and signing
data sets.

Bones have the lengths of this project's signer: the model's own shapes are licensed, and ``betas`` need them. The
joints' axes are the world's in the T-pose, X to the signer's left, Y up, Z ahead; ``trans`` is the pelvis' position.
Poses in a camera's axes (Y down) or in a room's with Z up are turned upright.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.reading import ReadLimits, stem
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
    (3, ("root_orient", "global_orient", "smplx_root_pose", "root_pose")),
    (63, ("pose_body", "body_pose", "smplx_body_pose")),
    (3, ("pose_jaw", "jaw_pose", "smplx_jaw_pose")),
    (3, ("leye_pose", "smplx_leye_pose")),
    (3, ("reye_pose", "smplx_reye_pose")),
    (45, ("left_hand_pose", "smplx_lhand_pose", "lhand_pose")),
    (45, ("right_hand_pose", "smplx_rhand_pose", "rhand_pose")),
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
RATES = ("mocap_frame_rate", "mocap_framerate", "fps")
"""Names of the frame rate."""
_SHAPES = ("betas", "smplx_shape")
_NOT_READ = (*_SHAPES, "expression", "smplx_expr", "dmpls")
"""Arrays that a clip does not hold."""
PACKED = "smplx"
"""Name of an array with all numbers of a frame in a row, one of ``_LAYOUTS``."""
NAMES = (PACKED, *_POSES, *(name for _, names in _PARTS for name in names), *_JOINED, *_TRANS, *RATES, *_NOT_READ)
"""Names of all arrays that are read from an archive."""
N_NUMBERS = {165: 55, 156: 52}
"""Numbers of a whole pose -> joints, with and without a face."""
_BODY = (("root_orient", 3), ("pose_body", 63))
_HANDS_JAW = (("smplx_lhand_pose", 45), ("smplx_rhand_pose", 45), ("pose_jaw", 3))
_SHAPE = (("betas", 10), ("expression", 10))
_LAYOUTS = {
    322: (*_BODY, ("pose_hand", 90), ("pose_jaw", 3), ("expression", 50), ("", 100), ("trans", 3), ("betas", 10)),
    182: (*_BODY, *_HANDS_JAW, *_SHAPE, ("", 3)),
    179: (*_BODY, *_HANDS_JAW, *_SHAPE),
    **{n_numbers: (("poses", n_numbers),) for n_numbers in N_NUMBERS},
}
"""Numbers in a row -> parts in order; unnamed ones are not read. 322: Motion-X (``Load_motion_data.md``); 182:
SignAvatars (``vis.py``), whose last three are of a virtual camera; 179: the same without these, as SOKE joins the fits
of Neural Sign Actors.
"""
_LEAST_UPRIGHT = 0.5
"""Least mean component of the pelvis' up axis along another axis at which poses are turned: 60 degrees from it."""


def is_smplx(names: Collection[str]) -> bool:
    """Whether an archive with arrays of these names holds SMPL-X poses."""
    return any(name in names for name in (PACKED, *_POSES, *_PARTS[1][1]))


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


def build_clip(arrays: Mapping[str, NDArray[Any]], file: str, limits: ReadLimits, n_bytes: int) -> Clip:
    """Build the clip from arrays by name, which come from ``n_bytes`` of a file. Raises ``InputError`` if they are no
    poses, ``LimitError`` if they are too many.
    """
    clip = _build_clip(arrays, stem(file))
    limits.check_clip(len(clip), len(clip.skeleton), clip.fps, clip.nbytes, n_bytes, file)
    return clip


def _build_clip(arrays: Mapping[str, NDArray[Any]], name: str) -> Clip:
    arrays = unpack(arrays)
    poses = _whole_poses(arrays)
    if not len(poses):
        raise InputError("it holds no frames")
    bones = skeleton(N_NUMBERS[poses.shape[1]])
    roots = next((arrays[key] for key in _TRANS if key in arrays), np.zeros((len(poses), 3)))
    rates = [key for key in RATES if key in arrays]
    rates = [key for key in rates if arrays[key].size == 1]
    notes = [] if rates else [f"it names no frame rate: {_USUAL_FPS:g} fps is taken"]
    if len(poses) == 1:
        notes = ["it holds one frame; name the folder instead that holds the files of a recording, a frame each"]
    quats = rotation.exp(_check_array("poses", poses, poses.shape).reshape(len(poses), -1, 3))
    root_quats, root_positions, turned = _upright(quats[:, 0], _part("trans", roots, len(poses), 3))
    quats[:, 0] = root_quats
    if "smplx_lhand_pose" in arrays:  # of OSX and what follows it, whose model has flat_hand_mean=False
        notes.append("hands are relative to the model's mean hand, which is licensed: fingers bend too little")
    notes += [f"{key} is not read: bones have this project's lengths" for key in _SHAPES if _is_used(arrays, key)]
    return Clip(
        bones,
        quats,
        root_positions,
        float(arrays[rates[0]].reshape(())) if rates else _USUAL_FPS,
        name,
        left_out=tuple(key for key in _NOT_READ if key not in _SHAPES and _is_used(arrays, key)),
        notes=(*notes, *turned),
    )


def unpack(arrays: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
    """Return arrays by name, with ``PACKED`` split into its parts. Raises ``InputError`` for an unknown layout."""
    if PACKED not in arrays:
        return arrays
    rows = np.atleast_2d(arrays[PACKED])
    if rows.ndim != 2 or rows.shape[1] not in _LAYOUTS:
        shapes = "(T, 322) of Motion-X, (T, 182) of SignAvatars, (T, 179), (T, 165) of SMPL-X or (T, 156) of SMPL-H"
        raise InputError(f"it holds an array {arrays[PACKED].shape}, expected {shapes}; name the parts in an .npz")
    layout = _LAYOUTS[rows.shape[1]]
    parts = np.split(rows, np.cumsum([size for _, size in layout])[:-1], axis=1)
    others = {name: values for name, values in arrays.items() if name != PACKED}
    return others | {name: part for (name, _), part in zip(layout, parts, strict=True) if name}


def join_frames(frames: Sequence[Mapping[str, NDArray[Any]]], labels: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Join the arrays of single frames into arrays (T, ...). ``labels`` name the frames in messages. Raises
    ``InputError`` if one holds several frames, or other arrays than the first.
    """
    unpacked = [unpack(arrays) for arrays in frames]
    sizes = [{name: values.size for name, values in arrays.items() if name not in RATES} for arrays in unpacked]
    for arrays, n_numbers, label in zip(unpacked, sizes, labels, strict=True):
        try:
            n_frames = len(_whole_poses(arrays))
        except InputError as error:
            raise InputError(f"{label}: {error}") from error
        if n_frames != 1:
            raise InputError(f"{label}: {n_frames} frames, expected one; convert each recording alone")
        if n_numbers != sizes[0]:
            raise InputError(f"{label}: holds other arrays than {labels[0]}, expected frames of one layout")
    rates = {name: values for name, values in frames[0].items() if name in RATES}
    return rates | {name: np.stack([arrays[name].ravel() for arrays in unpacked]) for name in sizes[0]}


def _upright(root_quats: FloatArray, roots: FloatArray) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Return rotations (T, 4) and positions (T, 3) of the pelvis in axes with Y up, and a note if they were turned.

    A camera's axes have Y down, and Z away from it. Its positions follow from a focal length that most data sets choose
    for the crop of each frame, so they are not read.
    """
    up = rotation.rotate(root_quats, [0.0, 1.0, 0.0]).mean(axis=0)  # (3,)
    if up[1] < -_LEAST_UPRIGHT:
        turned = rotation.multiply([1.0, 0.0, 0.0, 0.0], root_quats)  # half a turn about X
        return turned, np.zeros_like(roots), ("poses in a camera's axes are turned upright; the signer stays in place",)
    if up[2] > max(_LEAST_UPRIGHT, abs(up[1])):
        quarter = rotation.exp([-np.pi / 2, 0.0, 0.0])
        note = "poses with Z up are turned upright"
        return rotation.multiply(quarter, root_quats), rotation.rotate(quarter, roots), (note,)
    return root_quats, roots, ()


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
            "; hands in PCA need the licensed model: save the 45 numbers that it makes of them"
            if shape[1] == 45 and values.shape[-1:] not in ((45,), (3,))
            else ""
        )
        raise InputError(f"{name} has shape {values.shape}, expected {shape}{what}")
    if not np.isfinite(values).all():
        raise InputError(f"{name}: a number is not finite")
    return np.asarray(values, np.float64)


def _is_used(arrays: Mapping[str, NDArray[Any]], name: str) -> bool:
    return name in arrays and bool(np.any(arrays[name]))
