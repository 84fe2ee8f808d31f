"""Two rigs of one body: the same bones, in another unit, under other names, at rest in another pose or with other axes.

Where bones have the same lengths and the same angles between those of one joint, the axes of every joint follow from
them, whatever the pose that a file shows with all rotations at identity. Only how far a joint is twisted about a single
bone is open: it is taken from the file's rest pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip, Skeleton
from signsplice.motion.kinematics import global_quats
from signsplice.rig.info import rig_info
from signsplice.rig.rest_pose import TRUNK, rest_frame

IDENTICAL = 1e-3
"""Rest bones that lie apart by less than this fraction of the longest are the same but for a file's rounding."""
_SAME_LENGTH, _SHORT = 0.005, 0.1
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
    trunk = [joint for role, joint in rig_info(source).roles.joints.items() if role in TRUNK]
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
        if (apart > _SAME_LENGTH * np.maximum(np.linalg.norm(bones, axis=-1), _SHORT)).any():
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
