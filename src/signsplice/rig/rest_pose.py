"""Rest poses: the pose in which a rig shows a person, and rigs of one body whose rest poses have different axes.

The axes of a rig's joints are arbitrary. In most rigs, identity rotations show a T-pose, an A-pose or hanging arms; in
some they show bones in one line, or a heap. Motion is then transferred to other rigs from the pose of a frame, whose
joint positions do not depend on the axes.

If the bones of two rigs have the same lengths and angles, the axes of every joint follow from them, independently of
units, names and rest poses. Only the twist of a joint about a single bone is undetermined: it is taken from the file's
rest pose.

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
_MOST_LEANING_DEG = 65.0
"""Largest angle of a person's trunk bones from the line of hips and shoulders, degrees."""
_MOST_TWISTED_DEG = 45.0
"""Largest twist of a person's shoulders against the hips, degrees."""
_MOST_RAISED_DEG = 15.0
"""Largest angle of a person's thighs above the horizontal, degrees: some rigs' poses sit."""
_SHORT = 0.1
"""Bones of the trunk shorter than this fraction of it may have any direction."""


def with_rest_pose(clip: Clip, frame: int | None = None) -> Clip:
    """Sets the pose of ``frame``, by default the first that shows a person, as the rest pose of the clip's skeleton.
    Returns the clip itself if the skeleton shows a person with all rotations at identity or has a rest pose, or if no
    frame shows one. Raises ``InputError`` for a frame that the clip does not have.
    """
    if frame is not None and not 0 <= frame < len(clip):
        raise InputError(f"{clip.name}: no frame {frame} to be its rest pose, expected 0 to {len(clip) - 1}")
    if clip.skeleton.rest_pose is not None or rests_as_person(clip.skeleton):
        return clip
    return clip.derived[_with_first_person] if frame is None else _with_frame(clip, frame)


def rests_as_person(skeleton: Skeleton) -> bool:
    """Whether the skeleton shows a person with all rotations at identity; True if its arms are not known."""
    return skeleton.derived[_rests_as_person]


def _rests_as_person(skeleton: Skeleton) -> bool:
    info = rig_info(skeleton)
    return not info.has_arms or bool(_show_person(kinematics.rest_positions(skeleton)[None], info.roles.joints)[0])


def rest_frame(clip: Clip) -> int | None:
    """Returns the first frame in the skeleton's rest pose, or that shows a person if it has none; None without one."""
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
    points = {role: positions[:, joint] for role, joint in joints.items()}
    hips = points.get("hips", positions[:, 0])
    to_left = points["leftUpperArm"] - points["rightUpperArm"]
    up = 0.5 * (points["leftUpperArm"] + points["rightUpperArm"]) - hips
    trunk = [hips, *(points[role] for role in _TRUNK[1:] if role in points)]
    # Comparisons are False for bones without length: these show nothing.
    with np.errstate(invalid="ignore", divide="ignore"):
        wrong = np.abs(_cosines(to_left, up)) > np.sin(np.deg2rad(_MOST_TWISTED_DEG))
        for bone in np.diff(trunk, axis=0):
            is_long = np.linalg.norm(bone, axis=-1) > _SHORT * np.linalg.norm(up, axis=-1)
            wrong |= is_long & (_cosines(bone, up) < np.cos(np.deg2rad(_MOST_LEANING_DEG)))
        if all(f"{side}UpperLeg" in points for side in SIDES):
            legs = points["leftUpperLeg"] - points["rightUpperLeg"]
            wrong |= _cosines(to_left, legs) < np.cos(np.deg2rad(_MOST_TWISTED_DEG))
            for side in (side for side in SIDES if f"{side}LowerLeg" in points):
                thigh = points[f"{side}LowerLeg"] - points[f"{side}UpperLeg"]
                wrong |= _cosines(thigh, up) > np.sin(np.deg2rad(_MOST_RAISED_DEG))
    return np.asarray(~wrong)


def _cosines(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cosines (T,) of the angles between vectors (T, 3)."""
    return np.asarray(np.sum(a * b, axis=-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)))


IDENTICAL = 1e-3
"""Difference of rest bones, as a fraction of the longest, that counts as a file's rounding."""
_SAME_LENGTH = 0.005
"""Difference of bones, as a fraction of their length, below which they are one body's."""
_SHORT_BONE = 0.1
"""Least length, as a fraction of the longest bone, that bones are compared with."""
_SAME_AXES_DEG = 0.5
"""Rotation of trunk joints against one another below which their rest pose shows their axes, degrees."""
_ONE_LINE = 1e-4
"""Spread of bone directions, as a fraction, below which bones lie in one line."""


@dataclass(frozen=True, eq=False)
class OneBody:
    """How one skeleton is brought into the rest pose of another with the same bones.

    poses: global rotations (J, 4) of its joints in that pose, and of the joints of the other.
    warnings: about a rest pose that had to be taken from a frame, one line each.
    """

    poses: tuple[FloatArray, FloatArray]
    warnings: tuple[str, ...] = ()


def axes_on_one_body(clip: Clip, target: Skeleton, name: str, pairs: Mapping[int, int]) -> OneBody | None:
    """Returns how the clip's skeleton is brought into the rest pose of ``target``, named ``name``; None if their bones
    differ.

    pairs: target joint -> source joint.
    """
    source = clip.skeleton
    rest = _rest(target)
    axes = _axes_like(source, target, pairs, _rest(source), rest)
    trunk = [joint for role, joint in rig_info(source).roles.joints.items() if role in _TRUNK]
    if axes is None or source.rest_pose is not None or not trunk:
        return None if axes is None else OneBody((axes, rest))
    spread_deg = np.rad2deg(rotation.angle_between(axes[trunk], axes[trunk[0]])).max()
    frame = rest_frame(clip) if spread_deg > _SAME_AXES_DEG else None
    posed = None if frame is None else global_quats(source, clip.local_rotations[frame])
    # Bones do not show how far the trunk's joints are twisted about them, nor which way the head faces.
    posed = None if posed is None else _axes_like(source, target, pairs, posed, rest)
    if posed is None:
        return OneBody((axes, rest))
    line = f"{clip.name}: joints have other axes than those of {name}: frame {frame} is taken as its rest pose"
    return OneBody((posed, rest), (line,))


def _rest(skeleton: Skeleton) -> FloatArray:
    """Returns the global rotations (J, 4) of a skeleton's rest pose."""
    identity = np.tile(rotation.IDENTITY, (len(skeleton), 1))
    return identity if skeleton.rest_pose is None else global_quats(skeleton, skeleton.rest_pose)


def bones_apart(source: Skeleton, target: Skeleton, pairs: Mapping[int, int]) -> float:
    """Returns the largest difference of two skeletons' rest bones, as a fraction of the longest; infinite if their
    hierarchies differ.
    """
    below = [joint for joint in pairs if target.parents[joint] in pairs]
    if any(pairs[int(target.parents[joint])] != source.parents[pairs[joint]] for joint in below) or not below:
        return float("inf")
    bones = target.offsets[below]
    offsets = size_ratio(source, target, pairs) * source.offsets[[pairs[joint] for joint in below]] - bones
    return float(np.linalg.norm(offsets, axis=-1).max() / np.linalg.norm(bones, axis=-1).max())


def size_ratio(source: Skeleton, target: Skeleton, pairs: Mapping[int, int]) -> float:
    """Returns the median ratio of bone lengths target / source."""
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
    """Returns global rotations (J, 4) that bring ``source`` into the pose ``rest`` of ``target`` with the least twist
    about single bones from its ``pose``, both global rotations (J, 4); None if bones differ in length or angle.
    """
    longest = float(np.linalg.norm(target.offsets, axis=-1).max()) or 1.0
    scale = size_ratio(source, target, pairs) / longest
    axes = np.array(pose)
    turns = np.tile(rotation.IDENTITY, (len(target), 1))
    first = min(pairs)
    for joint in sorted(pairs):
        source_joint, parent = pairs[joint], int(target.parents[joint])
        children = [child for child in target.children[joint] if child in pairs]
        if any(source.parents[pairs[child]] != source_joint for child in children):
            return None
        above = turns[parent] if parent >= 0 else rotation.IDENTITY
        if joint == first and len(children) < 2:  # hips without legs do not show which way the body faces
            ours, theirs = _place_joints(target, rest)[[*pairs]], _place_joints(source, pose)[[*pairs.values()]]
            above = _least_rotation(theirs - theirs.mean(axis=0), ours - ours.mean(axis=0))
        bones = rotation.rotate(rest[joint], target.offsets[children] / longest)
        carried = scale * source.offsets[[pairs[child] for child in children]]
        carried = rotation.rotate(rotation.multiply(above, axes[source_joint]), carried)
        turn = _least_rotation(carried, bones)
        errors = np.linalg.norm(rotation.rotate(turn, carried) - bones, axis=-1)
        if (errors > _SAME_LENGTH * np.maximum(np.linalg.norm(bones, axis=-1), _SHORT_BONE)).any():
            return None
        turns[joint] = rotation.multiply(turn, above)
        axes[source_joint] = rotation.multiply(turns[joint], axes[source_joint])
    return axes


def _place_joints(skeleton: Skeleton, rotations: FloatArray) -> FloatArray:
    """Returns the positions (J, 3) of joints with global rotations (J, 4), from the root."""
    positions = np.zeros((len(skeleton), 3))
    for joint, parent in enumerate(skeleton.parents.tolist()):
        if parent >= 0:
            positions[joint] = positions[parent] + rotation.rotate(rotations[parent], skeleton.offsets[joint])
    return positions


def _least_rotation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the rotation (4,) that best fits vectors ``a`` (K, 3) to ``b`` (K, 3): the smallest for one direction,
    else that of least squares (Kabsch 1976).
    """
    if not len(a):
        return rotation.IDENTITY
    u, sizes, vt = np.linalg.svd(b.T @ a)
    if sizes[1] <= _ONE_LINE * sizes[0]:
        longest = int(np.linalg.norm(b, axis=-1).argmax())
        return rotation.between_vectors(a[longest], b[longest])
    return rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)
