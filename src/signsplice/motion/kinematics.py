"""Forward kinematics, and the ancestors and descendants of joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.motion.rotation import FloatArray


def forward(
    clip: Clip, joints: Sequence[int] | None = None, origin: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Compute global rotations (T, K, 3, 3) and positions (T, K, 3), clip units, of joints.

    joints: K joint indices, all by default; only they and their ancestors are computed.
    origin: a common ancestor; the result is relative to its axes and position, by default to the world's.

    global_j = global_parent local_j; position_j = position_parent + global_parent offset_j; the root is at
    root_positions.
    """
    skeleton = clip.skeleton
    path = _joint_path(skeleton, None if joints is None else tuple(int(joint) for joint in joints), origin or 0)
    # Components first, frames last, all joints of one depth together: few operations on long rows. Each joint has a
    # 3 x 4 matrix of rotation and position: (3, 4, K, T); local, then made global depth by depth.
    matrices = np.empty((3, 4, len(path.order), len(clip.local_rotations)))
    _write_matrices(clip.local_rotations.take(path.order, axis=1), out=matrices[:, :3])
    if clip.translations is None:
        matrices[:, 3] = skeleton.offsets[path.order].T[..., None]
    else:
        matrices[:, 3] = clip.translations[:, path.order].transpose(2, 1, 0)
    if origin is None:
        matrices[:, 3, 0] = clip.root_positions.T
    else:
        matrices[:, :, 0] = np.eye(3, 4)[..., None]
    for rows, parents in path.levels:
        parent_matrices = matrices.take(parents, axis=2)
        child_matrices = np.einsum("abkt,bckt->ackt", parent_matrices[:, :3], matrices[:, :, rows])
        child_matrices[:, 3] += parent_matrices[:, 3]
        matrices[:, :, rows] = child_matrices
    selected = matrices.take(path.wanted, axis=2).transpose(3, 2, 0, 1)
    return selected[..., :3], selected[..., 3]


@dataclass(frozen=True, eq=False)
class _JointPath:
    """The path down a skeleton to some joints.

    order: all required joints by depth, the common ancestor first.
    levels: for each further depth, the rows of ``order`` and the rows of their parents.
    wanted: the rows of the requested joints.
    """

    order: NDArray[np.intp]
    levels: tuple[tuple[slice, NDArray[np.intp]], ...]
    wanted: NDArray[np.intp]


def _joint_path(skeleton: Skeleton, joints: tuple[int, ...] | None, origin: int) -> _JointPath:
    """Return the path to some joints (None: all), cached as long as the skeleton lives."""
    paths, key = skeleton.derived[_no_paths], (joints, origin)
    if key not in paths:
        paths[key] = _find_joint_path(skeleton, range(len(skeleton)) if joints is None else joints, origin)
    return paths[key]


def _no_paths(_: Skeleton) -> dict[tuple[tuple[int, ...] | None, int], _JointPath]:
    """Return an empty cache of a skeleton: (joints, origin) -> path."""
    return {}


def _find_joint_path(skeleton: Skeleton, wanted: Sequence[int], origin: int) -> _JointPath:
    parents = skeleton.parents.tolist()
    depth = {origin: 0}
    for joint in wanted:
        chain = []
        while joint not in depth:
            chain.append(joint)
            joint = parents[joint]
        for below in reversed(chain):
            depth[below] = depth[parents[below]] + 1
    order = sorted(depth, key=lambda joint: (depth[joint], joint))
    row = {joint: k for k, joint in enumerate(order)}
    levels = []
    for _, level in groupby(order[1:], key=depth.__getitem__):
        joints = list(level)
        rows = slice(row[joints[0]], row[joints[-1]] + 1)
        levels.append((rows, np.array([row[parents[joint]] for joint in joints])))
    return _JointPath(np.array(order), tuple(levels), np.array([row[joint] for joint in wanted], np.intp))


def path_to_root(skeleton: Skeleton, joint: int) -> list[int]:
    """Return a joint and its ancestors, the root last."""
    path = [joint]
    while skeleton.parents[path[-1]] >= 0:
        path.append(int(skeleton.parents[path[-1]]))
    return path


def subtree(skeleton: Skeleton, joint: int) -> list[int]:
    """Return a joint and its descendants, in order."""
    below = {joint}
    for child, parent in enumerate(skeleton.parents.tolist()):
        if parent in below:
            below.add(child)
    return sorted(below)


def common_ancestor(skeleton: Skeleton, joints: Sequence[int]) -> int:
    """Return the nearest common ancestor of some joints, which may be one of them."""
    shared = set.intersection(*(set(path_to_root(skeleton, joint)) for joint in joints))
    return max(shared)


def _write_matrices(q: FloatArray, out: FloatArray) -> None:
    """Write the rotation matrices of quaternions (T, K, 4) to ``out`` (3, 3, K, T)."""
    x, y, z, w = np.ascontiguousarray(q.transpose(2, 1, 0))
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz = x * x2, y * y2, z * z2
    xy, xz, yz = x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - yy - zz, xy - wz, xz + wy
    out[1, 0], out[1, 1], out[1, 2] = xy + wz, 1.0 - xx - zz, yz - wx
    out[2, 0], out[2, 1], out[2, 2] = xz - wy, yz + wx, 1.0 - xx - yy


def tip_positions(clip: Clip, global_rotations: FloatArray, global_positions: FloatArray) -> FloatArray:
    """Return positions (T, E, 3) of the skeleton's end sites, clip units, from ``forward`` of all joints."""
    sites = clip.skeleton.end_sites
    joints = [site.joint for site in sites]
    offsets = np.array([site.offset for site in sites]).reshape(-1, 3)
    return np.asarray(global_positions[:, joints] + np.einsum("teab,eb->tea", global_rotations[:, joints], offsets))


def global_quats(skeleton: Skeleton, local_quats: FloatArray) -> FloatArray:
    """Convert local rotations (..., J, 4) to global ones (..., J, 4)."""
    quats = np.array(local_quats)
    for joint in range(1, len(skeleton)):
        quats[..., joint, :] = rotation.multiply(quats[..., skeleton.parents[joint], :], quats[..., joint, :])
    return quats


def rest_positions(skeleton: Skeleton) -> FloatArray:
    """Return joint positions (J, 3) of the zero pose (all rotations identity, the root at the origin), not of
    ``skeleton.rest_pose``; clip units.
    """
    positions = np.zeros((len(skeleton), 3))
    for joint in range(1, len(skeleton)):
        positions[joint] = positions[skeleton.parents[joint]] + skeleton.offsets[joint]
    return positions
