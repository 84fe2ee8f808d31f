"""Rest poses: the pose in which a rig shows a person, where it shows none with all rotations at identity.

The axes of a rig's joints are its maker's choice. In most rigs all rotations at identity show a T-pose, an A-pose or
arms that hang; in some they show bones in one line, or a heap. Motion is then carried to other rigs from the pose of a
frame, whose joints lie where they lie whatever the axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.cache import CACHE
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.info import rig_info
from signsplice.rig.naming import SIDES

TRUNK = ("hips", "spine", "chest", "upperChest", "neck", "head")
_MOST_LEANING_DEG, _MOST_TWISTED_DEG, _MOST_RAISED_DEG = 65.0, 45.0, 15.0
"""In a person's pose no bone of the trunk leans farther from the line of hips and shoulders, shoulders are not twisted
farther against hips, and no thigh points farther above the horizontal; people sit in some rigs' poses.
"""
_SHORT = 0.1
"""Bones of the trunk that are shorter than this fraction of it may point anywhere."""


def with_rest_pose(clip: Clip, frame: int | None = None) -> Clip:
    """The clip with the pose of ``frame``, by default of the first that shows a person, as its skeleton's rest pose;
    the clip itself where the skeleton shows a person with all rotations at identity, has a rest pose, or no frame shows
    one. Raises ``InputError`` for a frame that it does not have.
    """
    if frame is not None and not 0 <= frame < len(clip):
        raise InputError(f"{clip.name}: no frame {frame} to be its rest pose, expected 0 to {len(clip) - 1}")
    if clip.skeleton.rest_pose is not None or rests_as_person(clip.skeleton):
        return clip
    return CACHE.of(clip, _with_first_person) if frame is None else _with_frame(clip, frame)


def rests_as_person(skeleton: Skeleton) -> bool:
    """Whether the skeleton shows a person with all rotations at identity; True where its arms are not known."""
    return CACHE.of(skeleton, _rests_as_person)


def _rests_as_person(skeleton: Skeleton) -> bool:
    info = rig_info(skeleton)
    return not info.has_arms or bool(_show_person(kinematics.rest_positions(skeleton)[None], info.roles.joints)[0])


def rest_frame(clip: Clip) -> int | None:
    """The first frame whose pose is the skeleton's rest pose, else that shows a person; None where there is none."""
    rest = clip.skeleton.rest_pose
    if rest is None:
        shown = _show_person(kinematics.forward(clip)[1], rig_info(clip.skeleton).roles.joints)
    else:
        shown = (clip.local_rotations == rest).all(axis=(1, 2))
    return int(shown.argmax()) if shown.any() else None


def _with_first_person(clip: Clip) -> Clip:
    frame = rest_frame(clip)
    return clip if frame is None else _with_frame(clip, frame)


def _with_frame(clip: Clip, frame: int) -> Clip:
    return replace(clip, skeleton=replace(clip.skeleton, rest_pose=clip.local_rotations[frame]))


def _show_person(positions: FloatArray, joints: Mapping[str, int]) -> NDArray[np.bool_]:
    """Which poses (T,) of joints at ``positions`` (T, J, 3) a person could stand or sit in, arms aside."""
    at = {role: positions[:, joint] for role, joint in joints.items()}
    hips = at.get("hips", positions[:, 0])
    across = at["leftUpperArm"] - at["rightUpperArm"]
    up = 0.5 * (at["leftUpperArm"] + at["rightUpperArm"]) - hips
    trunk = [hips, *(at[role] for role in TRUNK[1:] if role in at)]
    # Comparisons are False where a bone has no length: it shows nothing.
    with np.errstate(invalid="ignore", divide="ignore"):
        wrong = np.abs(_cosines(across, up)) > np.sin(np.deg2rad(_MOST_TWISTED_DEG))
        for bone in np.diff(trunk, axis=0):
            is_long = np.linalg.norm(bone, axis=-1) > _SHORT * np.linalg.norm(up, axis=-1)
            wrong |= is_long & (_cosines(bone, up) < np.cos(np.deg2rad(_MOST_LEANING_DEG)))
        if all(f"{side}UpperLeg" in at for side in SIDES):
            legs = at["leftUpperLeg"] - at["rightUpperLeg"]
            wrong |= _cosines(across, legs) < np.cos(np.deg2rad(_MOST_TWISTED_DEG))
            for side in (side for side in SIDES if f"{side}LowerLeg" in at):
                thigh = at[f"{side}LowerLeg"] - at[f"{side}UpperLeg"]
                wrong |= _cosines(thigh, up) > np.sin(np.deg2rad(_MOST_RAISED_DEG))
    return np.asarray(~wrong)


def _cosines(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cosines (T,) of the angles between vectors (T, 3)."""
    return np.asarray(np.sum(a * b, axis=-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)))
