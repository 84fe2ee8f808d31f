"""How a skeleton carries the roles of the canonical humanoid: what turns its local rotations into canonical ones.

The canonical rotation of a joint brings its bone from the T-pose to where it is, seen from the nearest joint above that
has a role. With G the global rotation of a joint, and C the one that poses the rest skeleton in the T-pose,

    K_j = G_j C_j^-1,    A_j = K_parent^-1 K_j = C_parent (G_parent^-1 G_j) C_j^-1.

A is the identity for all joints in a T-pose, whatever the rest pose, axes or facing of the file. A small rotation d
after A, in canonical axes, A -> A exp(d), is q -> q exp(C_j^-1 d) for the local rotation of the rig's own joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import kinematics, rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Skeleton
from signsplice.rig.naming import SIDES
from signsplice.rig.roles import FINGERS, Humanoid, arm_joints, finger_roles
from signsplice.rig.t_pose import TPose

TRUNK = ("spine", "chest", "upperChest", "neck", "head")
ARM = ("Shoulder", "UpperArm", "LowerArm", "Hand")


def _side(side: str) -> tuple[str, ...]:
    return tuple(side + part for part in (*ARM, *(role for finger in FINGERS for role in finger_roles(finger))))


ROLES: tuple[str, ...] = (*TRUNK, *_side("left"), *_side("right"))
"""The R = 43 roles that sign: trunk, neck, head, then 19 joints of the left arm and hand, and as many of the right."""
N_SIDE = len(_side("left"))
LEFT = slice(len(TRUNK), len(TRUNK) + N_SIDE)
RIGHT = slice(LEFT.stop, LEFT.stop + N_SIDE)
TIPS: tuple[str, ...] = tuple(
    f"{side}{part}" for side in SIDES for part in ("Hand", *(f"{finger}Distal" for finger in FINGERS))
)
"""The 12 joints whose positions count: wrist and last joint of every finger, left then right."""
MIRROR = np.concatenate([np.arange(len(TRUNK)), np.arange(RIGHT.start, RIGHT.stop), np.arange(LEFT.start, LEFT.stop)])
"""For each role the row of its counterpart in the mirror (R,)."""


@dataclass(frozen=True, eq=False)
class CanonicalMap:
    """How a skeleton carries the roles; R roles, K of which the rig has.

    joints: (R,) the joint of every role, -1 where there is none.
    parent_rows: (R,) row of the nearest role above, -1 for the hips.
    t_pose_rotations: (J, 4) global rotations of the T-pose.
    last_joints: (K,) the joint whose local rotation leads to each role from the role above.
    joint_paths: for rows of ``last_joints`` where one local rotation is not enough: all joints on the path from the
        role above, with True where the path goes up and the rotation is undone.
    to_canonical: (K, 4, 4) matrices on quaternions that make canonical rotations of local ones.
    from_canonical: (K, 3, 3) matrices that bring a vector in canonical axes into those of its joint.
    arms: the joints of ``TIPS`` (the wrist's where a finger is missing), both elbows and, last, both shoulders.
    chest: the joint that carries the shoulders.
    origin: the nearest joint above ``arms`` and ``chest``; kinematics starts there.
    arm_length: shoulder to wrist, clip units.
    """

    joints: NDArray[np.intp]
    parent_rows: NDArray[np.intp]
    t_pose_rotations: FloatArray
    last_joints: NDArray[np.intp]
    joint_paths: dict[int, tuple[tuple[int, bool], ...]]
    to_canonical: FloatArray
    from_canonical: FloatArray
    arms: tuple[int, ...]
    chest: int
    origin: int
    arm_length: float

    @cached_property
    def has_role(self) -> NDArray[np.bool_]:
        """Which roles the rig has (R,)."""
        return self.joints >= 0

    @cached_property
    def from_chest(self) -> FloatArray:
        """The matrix (3, 3) that undoes the chest's global rotation in the T-pose."""
        return rotation.to_matrix(rotation.inverse(self.t_pose_rotations[self.chest]))


def map_roles(skeleton: Skeleton, humanoid: Humanoid, t_pose: TPose, arm_length: float) -> CanonicalMap:
    """How a skeleton carries the roles. Raises ``InputError`` where its arms are not known by name."""
    arm_joints(skeleton, humanoid)
    roles = humanoid.joints
    hips = roles.get("hips", 0)
    joints = np.array([roles.get(role, -1) for role in ROLES])
    row_of = {int(joint): row for row, joint in enumerate(joints) if joint >= 0}
    parent_rows = np.full(len(ROLES), -1)
    for row, joint in enumerate(joints):
        if joint >= 0:
            above = kinematics.path_to_root(skeleton, joint)[1:]
            parent_rows[row] = next((row_of[over] for over in above if over in row_of), -1)
    own = joints[joints >= 0]
    parents = np.where(parent_rows >= 0, joints[parent_rows], hips)[joints >= 0]
    tips = np.array([roles.get(role, -1) for role in TIPS])
    tips = np.where(tips >= 0, tips, np.repeat(tips[[0, len(TIPS) // 2]], len(TIPS) // 2))
    arms = (*tips.tolist(), *(int(joints[side.start + k]) for k in (2, 1) for side in (LEFT, RIGHT)))
    paths = [_joint_path(skeleton, int(a), int(b)) for a, b in zip(parents, own, strict=True)]
    shoulder = LEFT.start if joints[LEFT.start] >= 0 else LEFT.start + 1
    chest = int(joints[parent_rows[shoulder]]) if parent_rows[shoulder] >= 0 else hips
    inverses = rotation.inverse(t_pose.rotations[own])
    return CanonicalMap(
        joints=joints,
        parent_rows=parent_rows,
        t_pose_rotations=t_pose.rotations,
        last_joints=np.array([path[-1][0] if path else 0 for path in paths]),
        joint_paths={k: path for k, path in enumerate(paths) if len(path) != 1 or path[0][1]},
        from_canonical=rotation.to_matrix(inverses),
        to_canonical=_on_quaternions(t_pose.rotations[parents], inverses),
        arms=arms,
        chest=chest,
        origin=kinematics.common_ancestor(skeleton, (*arms, chest)),
        arm_length=arm_length,
    )


def _joint_path(skeleton: Skeleton, start: int, end: int) -> tuple[tuple[int, bool], ...]:
    """The joints whose local rotations lead from one joint to another, True where they are undone on the path up."""
    up, down = kinematics.path_to_root(skeleton, start), kinematics.path_to_root(skeleton, end)
    shared = set(up) & set(down)
    rising = [(joint, True) for joint in up if joint not in shared]
    return (*rising, *((joint, False) for joint in reversed(down) if joint not in shared))


def _on_quaternions(before: FloatArray, after: FloatArray) -> FloatArray:
    """Matrices (K, 4, 4) that take a quaternion q to before q after, for quaternions (K, 4)."""
    return np.stack([rotation.multiply(rotation.multiply(before, q), after) for q in np.eye(4)], axis=-1)
