"""Canonical motion: the same signing gives the same numbers, whatever the rig.

Local rotations of any rig become rotations of one humanoid (``canonical_map``), and small rotations of that humanoid
go back to the rig exactly; joints without a role stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import kinematics, rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.arms import span_between_rests
from signsplice.rig.canonical_map import MIRROR, ROLES, TIPS
from signsplice.rig.info import rig_info

FEATURE_FPS = 30.0
"""Frame rate at which networks see canonical motion, whatever the rate of the clip."""


@dataclass(frozen=True, eq=False)
class CanonicalMotion:
    """A clip on the canonical humanoid; R roles.

    quats: (T, R, 4) canonical rotations A; identity where the rig has no such joint.
    positions: (T, 12, 3) the joints of ``TIPS`` from the middle between the shoulders, in the axes of the trunk (left
        +X, up +Y, forward +Z), arm lengths; the wrist's where a finger is missing.
    elbow_positions: (T, 2, 3) the elbows, likewise.
    has_role: (R,) the roles that the rig has.
    fps: frame rate.
    """

    quats: FloatArray
    positions: FloatArray
    elbow_positions: FloatArray
    has_role: NDArray[np.bool_]
    fps: float

    def mirrored(self) -> CanonicalMotion:
        """The same in the mirror: left and right are exchanged."""
        flip = np.array([-1.0, 1.0, 1.0])
        half = len(TIPS) // 2
        quats = self.quats[:, MIRROR] * np.array([1.0, -1.0, -1.0, 1.0])
        positions = np.concatenate([self.positions[:, half:], self.positions[:, :half]], axis=1) * flip
        return CanonicalMotion(quats, positions, self.elbow_positions[:, ::-1] * flip, self.has_role[MIRROR], self.fps)

    @property
    def active_span(self) -> tuple[int, int]:
        """Frames [start, stop) in which the arms are away from rest: ``arms.active_span``, seen from the trunk."""
        return span_between_rests(self.positions[:, :: len(TIPS) // 2, 1], self.elbow_positions[..., 1])


def canonical_motion(clip: Clip) -> CanonicalMotion:
    """The clip on the canonical humanoid. Raises ``InputError`` where its arms are not known by name."""
    canonical = rig_info(clip.skeleton).canonical
    # A = C_parent (G_parent^-1 G) C^-1, G global and C T-pose rotations (canonical_map): of the local rotations between
    # the two joints alone, without kinematics. The frame axis is last, for speed.
    local = clip.local_rotations.transpose(1, 2, 0)  # (J, 4, T)
    between = local[canonical.last_joints]  # (K, 4, T)
    for k, path in canonical.joint_paths.items():
        between[k] = _rotation_along(clip.local_rotations, path).T
    # No matrix product: how that rounds depends on the number of frames, and other clips may be joined to this one.
    quats = np.zeros_like(between)
    for k in range(4):
        quats += canonical.to_canonical[:, :, k, None] * between[:, None, k]
    if not canonical.has_role.all():
        whole = np.empty((len(ROLES), *quats.shape[1:]))
        whole[:] = rotation.IDENTITY[:, None]
        whole[canonical.has_role] = quats
        quats = whole
    rotations, positions = kinematics.forward(clip, [canonical.chest, *canonical.arms], canonical.origin)
    middle = positions[:, -2:].mean(axis=1)  # (T, 3), between the shoulders
    trunk = rotations[:, 0] @ canonical.from_chest
    seen = (positions[:, 1:-2] - middle[:, None]) @ trunk / canonical.arm_length
    return CanonicalMotion(
        quats.transpose(2, 0, 1), seen[:, : len(TIPS)], seen[:, len(TIPS) :], canonical.has_role, clip.fps
    )


def _rotation_along(local: FloatArray, path: tuple[tuple[int, bool], ...]) -> FloatArray:
    """The rotation (T, 4) from one joint to another, of local rotations (T, J, 4)."""
    out = np.broadcast_to(rotation.IDENTITY, (len(local), 4))
    for joint, up in path:
        out = rotation.multiply(out, rotation.inverse(local[:, joint]) if up else local[:, joint])
    return out


def apply_deltas(
    skeleton: Skeleton, local_rotations: FloatArray, delta_rotvecs: FloatArray, roles: NDArray[np.bool_] | None = None
) -> FloatArray:
    """Local rotations (T, J, 4) with each role's joint turned by ``delta_rotvecs`` (T, R, 3), rotation vectors in
    canonical axes, radians; other joints stay. Roles that the rig lacks, or that are not among ``roles`` (R,), are
    passed over.
    """
    canonical = rig_info(skeleton).canonical
    turned = canonical.has_role if roles is None else canonical.has_role & roles
    joints = canonical.joints[turned]
    axes = canonical.from_canonical[turned[canonical.has_role]]
    own = np.einsum("kab,nkb->nka", axes, delta_rotvecs[:, turned])
    out = np.array(local_rotations, dtype=np.float64)
    out[:, joints] = rotation.multiply(out[:, joints], rotation.exp(own))
    return out


def canonical_bones(skeleton: Skeleton) -> FloatArray:
    """From the joint of the role above to each role's own in the T-pose (R, 3), arm lengths; 0 where a role is missing.

    With canonical rotations A, joints lie at p_j = p_parent + K_parent bone_j, as near as joints without a role keep
    their pose.
    """
    info = rig_info(skeleton)
    canonical, positions = info.canonical, info.t_pose.positions
    hips = info.roles.joints.get("hips", 0)
    parents = np.where(canonical.parent_rows >= 0, canonical.joints[canonical.parent_rows], hips)
    bones = (positions[canonical.joints] - positions[parents]) / canonical.arm_length
    return np.asarray(np.where(canonical.has_role[:, None], bones, 0.0))


def mirrored_deltas(delta_rotvecs: FloatArray) -> FloatArray:
    """Rotation vectors (T, R, 3) of all roles as they are in the mirror."""
    return np.asarray(delta_rotvecs[:, MIRROR] * np.array([1.0, -1.0, -1.0]))
