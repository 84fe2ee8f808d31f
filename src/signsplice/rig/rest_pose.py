"""Rest poses: the pose in which a rig shows a person, and two rigs of one body whose rest poses have other axes.

The axes of a rig's joints are its maker's choice. In most rigs all rotations at identity show a T-pose, an A-pose or
arms that hang; in some they show bones in one line, or a heap. Motion is then carried to other rigs from the pose of a
frame, whose joints lie where they lie whatever the axes.

Where the bones of two rigs have the same lengths and the same angles between those of one joint, the axes of every
joint follow from them, in whatever unit, under whatever names and from whatever rest pose. Only how far a joint is
twisted about a single bone is open: it is taken from the file's rest pose.

"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, kinematics, rotation
from signsplice.motion.kinematics import global_quats
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES

_TRUNK = ("hips", "spine", "chest", "upperChest", "neck", "head")
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
    return clip.derived[_with_first_person] if frame is None else _with_frame(clip, frame)


def rests_as_person(skeleton: Skeleton) -> bool:
    """Whether the skeleton shows a person with all rotations at identity; True where its arms are not known."""
    return skeleton.derived[_rests_as_person]


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
    trunk = [hips, *(at[role] for role in _TRUNK[1:] if role in at)]
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


IDENTICAL = 1e-3
"""Rest bones that lie apart by less than this fraction of the longest are the same but for a file's rounding."""
_SAME_LENGTH, _SHORT_BONE = 0.005, 0.1
"""Bones that lie apart by a smaller fraction than this are one body's; those shorter than this part of the longest are
compared as if they were as long.
"""
_SAME_AXES_DEG, _ONE_LINE = 0.5, 1e-4
"""Joints of a trunk that are turned against one another by less have the axes that their rest pose shows. Bones whose
directions spread by less than this fraction lie in one line.
"""


@dataclass(frozen=True, eq=False)
class OneBody:
    """How one skeleton is brought into the rest pose of another with the same bones.

    poses: global rotations (J, 4) of its joints in that pose, and of the joints of the other.
    warnings: about a rest pose that had to be taken from a frame, one line each.
    """

    poses: tuple[FloatArray, FloatArray]
    warnings: tuple[str, ...] = ()


def axes_on_one_body(clip: Clip, target: Skeleton, name: str, pairs: Mapping[int, int]) -> OneBody | None:
    """How the clip's skeleton is brought into the rest pose of ``target``, which is called ``name``; None where their
    bones differ.

    pairs: target joint -> source joint.
    """
    source = clip.skeleton
    rest = _rest(target)
    axes = _axes_like(source, target, pairs, _rest(source), rest)
    trunk = [joint for role, joint in rig_info(source).roles.joints.items() if role in _TRUNK]
    if axes is None or source.rest_pose is not None or not trunk:
        return None if axes is None else OneBody((axes, rest))
    apart = np.rad2deg(rotation.angle_between(axes[trunk], axes[trunk[0]])).max()
    frame = rest_frame(clip) if apart > _SAME_AXES_DEG else None
    posed = None if frame is None else global_quats(source, clip.local_rotations[frame])
    # Bones do not show how far the trunk's joints are twisted about them, nor which way the head faces.
    posed = None if posed is None else _axes_like(source, target, pairs, posed, rest)
    if posed is None:
        return OneBody((axes, rest))
    line = f"{clip.name}: joints have other axes than those of {name}: frame {frame} is taken as its rest pose"
    return OneBody((posed, rest), (line,))


def _rest(skeleton: Skeleton) -> FloatArray:
    """Global rotations (J, 4) of a skeleton's rest pose."""
    identity = np.tile(rotation.IDENTITY, (len(skeleton), 1))
    return identity if skeleton.rest_pose is None else global_quats(skeleton, skeleton.rest_pose)


def bones_apart(source: Skeleton, target: Skeleton, pairs: Mapping[int, int]) -> float:
    """How far rest bones of two skeletons lie apart at most, as a fraction of the longest; infinite where joints of the
    one do not hang as those of the other.
    """
    below = [joint for joint in pairs if target.parents[joint] in pairs]
    if any(pairs[int(target.parents[joint])] != source.parents[pairs[joint]] for joint in below) or not below:
        return float("inf")
    bones = target.offsets[below]
    apart = size_ratio(source, target, pairs) * source.offsets[[pairs[joint] for joint in below]] - bones
    return float(np.linalg.norm(apart, axis=-1).max() / np.linalg.norm(bones, axis=-1).max())


def size_ratio(source: Skeleton, target: Skeleton, pairs: Mapping[int, int]) -> float:
    """Median ratio of bone lengths target / source."""
    lengths = np.array(
        [
            (np.linalg.norm(target.offsets[j]), np.linalg.norm(source.offsets[k]))
            for j, k in pairs.items()
            if target.parents[j] >= 0 and pairs.get(int(target.parents[j])) == source.parents[k]
        ]
    ).reshape(-1, 2)
    lengths = lengths[(lengths > 1e-9 * lengths.max(axis=0, initial=0.0)).all(axis=1)]
    return float(np.median(lengths[:, 0] / lengths[:, 1])) if len(lengths) else 1.0


def _axes_like(
    source: Skeleton, target: Skeleton, pairs: Mapping[int, int], pose: FloatArray, rest: FloatArray
) -> FloatArray | None:
    """Global rotations (J, 4) that bring ``source`` into the pose ``rest`` of ``target``, twisted about single bones as
    little as may be from its ``pose``, both global rotations (J, 4); None where bones differ in length or angle.
    """
    longest = float(np.linalg.norm(target.offsets, axis=-1).max()) or 1.0
    scale = size_ratio(source, target, pairs) / longest
    axes = np.array(pose)
    turns = np.tile(rotation.IDENTITY, (len(target), 1))
    for joint in sorted(pairs):
        other, parent = pairs[joint], int(target.parents[joint])
        children = [child for child in target.children[joint] if child in pairs]
        if any(source.parents[pairs[child]] != other for child in children):
            return None
        above = turns[parent] if parent >= 0 else rotation.IDENTITY
        bones = rotation.rotate(rest[joint], target.offsets[children] / longest)
        carried = scale * source.offsets[[pairs[child] for child in children]]
        carried = rotation.rotate(rotation.multiply(above, axes[other]), carried)
        turn = _least_rotation(carried, bones)
        apart = np.linalg.norm(rotation.rotate(turn, carried) - bones, axis=-1)
        if (apart > _SAME_LENGTH * np.maximum(np.linalg.norm(bones, axis=-1), _SHORT_BONE)).any():
            return None
        turns[joint] = rotation.multiply(turn, above)
        axes[other] = rotation.multiply(turns[joint], axes[other])
    return axes


def _least_rotation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Rotation (4,) that brings vectors ``a`` (K, 3) as near as may be to ``b`` (K, 3): the smallest for one direction,
    else that of least squares (Kabsch 1976).
    """
    if not len(a):
        return rotation.IDENTITY
    u, sizes, vt = np.linalg.svd(b.T @ a)
    if sizes[1] <= _ONE_LINE * sizes[0]:
        longest = int(np.linalg.norm(b, axis=-1).argmax())
        return rotation.between_vectors(a[longest], b[longest])
    return rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)
