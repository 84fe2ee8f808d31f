"""Properties of a rig, and a clip's motion in terms that all rigs share: arms, and rotations of one humanoid.

``rig_info`` ties roles, T-pose, sizes and the canonical map to a skeleton. Local rotations of any rig become rotations
of the canonical humanoid, so that the same signing gives the same numbers, and small rotations of that humanoid go back
to the rig exactly; joints without a role stay as they are.

The canonical rotation of a joint brings its bone from the T-pose to its pose, seen from the nearest joint above with a
role. With G the global rotation of a joint, and C the one that poses the rest skeleton in the T-pose,

    K_j = G_j C_j^-1,    A_j = K_parent^-1 K_j = C_parent (G_parent^-1 G_j) C_j^-1.

A is the identity for all joints in a T-pose, whatever the rest pose, axes or facing of the file. A small rotation d
after A, in canonical axes, A -> A exp(d), is q -> q exp(C_j^-1 d) for the local rotation of the rig's own joint.

"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, kinematics, rotation
from signsplice.rig.roles import ARM, FINGERS, SIDES, Humanoid, arm_joints, find_roles, finger_roles, simplify
from signsplice.rig.t_pose import BodySizes, TPose, measure, t_pose

TRUNK = ("spine", "chest", "upperChest", "neck", "head")


def _side(side: str) -> tuple[str, ...]:
    return tuple(side + part for part in (*ARM, *(role for finger in FINGERS for role in finger_roles(finger))))


ROLES: tuple[str, ...] = (*TRUNK, *_side("left"), *_side("right"))
"""The R = 43 roles used in signing: trunk, neck, head, then 19 joints each of the left and right arm with hand."""
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
    """The canonical roles on a skeleton; R roles, K of which the rig has.

    joints: (R,) the joint of every role, -1 if there is none.
    parent_rows: (R,) row of the nearest role above, -1 for the hips.
    t_pose_rotations: (J, 4) global rotations of the T-pose.
    last_joints: (K,) the joint whose local rotation leads to each role from the role above.
    joint_paths: for rows of ``last_joints`` that need more than one local rotation: all joints on the path from the
        role above, with True if the path goes up and the rotation is undone.
    to_canonical: (K, 4, 4) matrices on quaternions that make canonical rotations of local ones.
    from_canonical: (K, 3, 3) matrices that bring a vector in canonical axes into those of its joint.
    arms: the joints of ``TIPS`` (the wrist for a missing finger), both elbows and, last, both shoulders.
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
    """Maps the canonical roles to a skeleton. Raises ``InputError`` if its arms are not known by name."""
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
    role_joints = joints[joints >= 0]
    parents = np.where(parent_rows >= 0, joints[parent_rows], hips)[joints >= 0]
    tips = np.array([roles.get(role, -1) for role in TIPS])
    tips = np.where(tips >= 0, tips, np.repeat(tips[[0, len(TIPS) // 2]], len(TIPS) // 2))
    arms = (*tips.tolist(), *(int(joints[side.start + k]) for k in (2, 1) for side in (LEFT, RIGHT)))
    paths = [_joint_path(skeleton, int(a), int(b)) for a, b in zip(parents, role_joints, strict=True)]
    shoulder = LEFT.start if joints[LEFT.start] >= 0 else LEFT.start + 1
    chest = int(joints[parent_rows[shoulder]]) if parent_rows[shoulder] >= 0 else hips
    inverses = rotation.inverse(t_pose.rotations[role_joints])
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
    """Returns the joints whose local rotations lead from one joint to another, with True if undone on the path up."""
    up, down = kinematics.path_to_root(skeleton, start), kinematics.path_to_root(skeleton, end)
    shared = set(up) & set(down)
    rising = [(joint, True) for joint in up if joint not in shared]
    return (*rising, *((joint, False) for joint in reversed(down) if joint not in shared))


def _on_quaternions(before: FloatArray, after: FloatArray) -> FloatArray:
    """Matrices (K, 4, 4) that take a quaternion q to before q after, for quaternions (K, 4)."""
    return np.stack([rotation.multiply(rotation.multiply(before, q), after) for q in np.eye(4)], axis=-1)


class RigInfo:
    """Properties derived from a skeleton alone; each is computed at its first use.

    skeleton: a copy, so that this object does not keep the original alive.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = replace(skeleton)

    @cached_property
    def roles(self) -> Humanoid:
        """Which joint plays which role. Raises ``InputError`` if the skeleton's own roles do not fit it."""
        return find_roles(self.skeleton)

    @cached_property
    def simple_names(self) -> tuple[str, ...]:
        """Joint names in comparable form, see ``roles.simplify``."""
        return tuple(map(simplify, self.skeleton.names))

    @cached_property
    def t_pose(self) -> TPose:
        """The skeleton in the T-pose."""
        return t_pose(self.skeleton, self.roles)

    @cached_property
    def sizes(self) -> BodySizes:
        """Stature, arm length, shoulder width and length unit."""
        return measure(self.skeleton, self.roles, lambda: self.t_pose.positions)

    @cached_property
    def arm_joints(self) -> list[int]:
        """Joints of left then right upper arm, lower arm and hand, then the hips. Raises ``InputError`` if both arms
        are not known by name.
        """
        return arm_joints(self.skeleton, self.roles)

    @cached_property
    def has_arms(self) -> bool:
        """Whether both arms are known by name."""
        try:
            return bool(self.arm_joints)
        except InputError:
            return False

    @cached_property
    def canonical(self) -> CanonicalMap:
        """How the skeleton carries the roles of the canonical humanoid. Raises as ``arm_joints`` does."""
        return map_roles(self.skeleton, self.roles, self.t_pose, self.sizes.arm_length)


def rig_info(skeleton: Skeleton) -> RigInfo:
    """Returns the properties of a skeleton, kept as long as it lives."""
    return skeleton.derived[RigInfo]


_RAISED_FRACTION = 0.4
"""Fraction of the height from rest to its highest point at which an arm has left its rest; less than half, so that a
sign that begins low and ends high keeps its beginning.
"""
_NO_REST_LIFT = 0.1
"""Rise of the arms below which a clip has no rest to trim, arm lengths."""


@dataclass(frozen=True, eq=False)
class Arms:
    """Both arms over time, left then right, in world axes and clip units.

    shoulders, elbows, wrists: (T, 2, 3) positions.
    hand_rotations: (T, 2, 3, 3) global rotation matrices.
    hips: (T, 3) positions.
    up: (3,) the world's vertical, a unit vector.
    length: shoulder to wrist, clip units.
    shoulder_width: distance of the shoulder joints, clip units.
    metres: length of one clip unit.
    fps: frame rate.
    """

    shoulders: FloatArray
    elbows: FloatArray
    wrists: FloatArray
    hand_rotations: FloatArray
    hips: FloatArray
    up: FloatArray
    length: float
    shoulder_width: float
    metres: float
    fps: float

    @property
    def lift(self) -> FloatArray:
        """Height of each wrist (T, 2): 0 if the arm hangs straight down, 1 at shoulder height."""
        return np.asarray(1.0 + (self.wrists - self.shoulders) @ self.up / self.length)


def arms(clip: Clip) -> Arms:
    """Returns the arms of a clip, kept as long as the clip lives: both seams of a word use them.

    Raises ``InputError`` if the rig's arms are not known by name.
    """
    return clip.derived[_arms]


def _arms(clip: Clip) -> Arms:
    info = rig_info(clip.skeleton)
    joints = info.arm_joints
    rotations, positions = kinematics.forward(clip, joints)
    shoulders, elbows, wrists = (positions[:, n : n + 4 : 3] for n in range(3))
    body = info.sizes
    trunk = shoulders.mean(axis=(0, 1)) - positions[:, 6].mean(axis=0)
    axis = int(np.argmax(np.abs(trunk)))
    up = np.zeros(3)
    up[axis] = np.sign(trunk[axis]) or 1.0
    return Arms(
        shoulders=shoulders,
        elbows=elbows,
        wrists=wrists,
        hand_rotations=rotations[:, 2:6:3],
        hips=positions[:, 6],
        up=up,
        length=body.arm_length,
        shoulder_width=body.shoulder_width,
        metres=body.unit.metres,
        fps=clip.fps,
    )


def hands_in_trunk_axes(own: Arms) -> tuple[FloatArray, FloatArray]:
    """Positions (T, 2, 3) and rotation matrices (T, 2, 3, 3) of the hands, from between the shoulders and in axes that
    turn and lean with the trunk: a body that sways moves no hand.
    """
    neck = own.shoulders.mean(axis=1)
    leftward, trunk = own.shoulders[:, 0] - own.shoulders[:, 1], neck - own.hips
    front = np.cross(leftward, trunk)
    axes = np.stack([leftward, np.cross(front, leftward), front], axis=1)  # (T, 3, 3)
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    wrists = np.einsum("tab,thb->tha", axes, own.wrists - neck[:, None])
    return wrists, np.einsum("tab,thbc->thac", axes, own.hand_rotations)


def active_span(arms: Arms) -> tuple[int, int]:
    """Returns frames [start, stop) in which the arms are away from rest; the whole clip if there is no rest.

    A clip rests at an end if both wrists are below their elbows there. The span then begins with the first frame (or
    ends with the last) in which the higher hand has risen 40 % of the height from rest to its highest point.
    """
    return span_between_rests(arms.lift, (arms.elbows - arms.shoulders) @ arms.up / arms.length + 1.0)


def span_between_rests(wrists: FloatArray, elbows: FloatArray) -> tuple[int, int]:
    """``active_span`` by the heights (T, 2) of both wrists and both elbows, arm lengths."""
    reach = wrists.max(axis=1)
    peak = float(reach.max())
    below = np.all(wrists < elbows, axis=1)
    start, stop = 0, len(reach)
    if below[0] and peak - reach[0] > _NO_REST_LIFT:
        start = int(np.argmax(reach >= reach[0] + _RAISED_FRACTION * (peak - reach[0])))
    if below[-1] and peak - reach[-1] > _NO_REST_LIFT:
        stop -= int(np.argmax(reach[::-1] >= reach[-1] + _RAISED_FRACTION * (peak - reach[-1])))
    return start, stop


FEATURE_FPS = 30.0
"""Frame rate at which networks see canonical motion, whatever the rate of the clip."""


@dataclass(frozen=True, eq=False)
class CanonicalMotion:
    """A clip on the canonical humanoid; R roles.

    quats: (T, R, 4) canonical rotations A; identity if the rig has no such joint.
    positions: (T, 12, 3) the joints of ``TIPS`` from the middle between the shoulders, in the axes of the trunk (left
        +X, up +Y, forward +Z), arm lengths; the wrist for a missing finger.
    elbow_positions: (T, 2, 3) the elbows, likewise.
    has_role: (R,) the roles that the rig has.
    fps: frame rate.
    """

    quats: FloatArray
    positions: FloatArray
    elbow_positions: FloatArray
    has_role: NDArray[np.bool_]
    fps: float

    def mirror(self) -> CanonicalMotion:
        """The same in the mirror: left and right are exchanged."""
        flip = np.array([-1.0, 1.0, 1.0])
        half = len(TIPS) // 2
        quats = self.quats[:, MIRROR] * np.array([1.0, -1.0, -1.0, 1.0])
        positions = np.concatenate([self.positions[:, half:], self.positions[:, :half]], axis=1) * flip
        return CanonicalMotion(quats, positions, self.elbow_positions[:, ::-1] * flip, self.has_role[MIRROR], self.fps)

    @property
    def active_span(self) -> tuple[int, int]:
        """Frames [start, stop) in which the arms are away from rest: ``active_span``, seen from the trunk."""
        return span_between_rests(self.positions[:, :: len(TIPS) // 2, 1], self.elbow_positions[..., 1])


def canonical_motion(clip: Clip) -> CanonicalMotion:
    """Brings the clip to the canonical humanoid. Raises ``InputError`` if its arms are not known by name."""
    canonical = rig_info(clip.skeleton).canonical
    # A = C_parent (G_parent^-1 G) C^-1, G global and C T-pose rotations: of the local rotations between
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
        all_quats = np.empty((len(ROLES), *quats.shape[1:]))
        all_quats[:] = rotation.IDENTITY[:, None]
        all_quats[canonical.has_role] = quats
        quats = all_quats
    rotations, positions = kinematics.forward(clip, [canonical.chest, *canonical.arms], canonical.origin)
    middle = positions[:, -2:].mean(axis=1)  # (T, 3), between the shoulders
    trunk = rotations[:, 0] @ canonical.from_chest
    seen = (positions[:, 1:-2] - middle[:, None]) @ trunk / canonical.arm_length
    return CanonicalMotion(
        quats.transpose(2, 0, 1), seen[:, : len(TIPS)], seen[:, len(TIPS) :], canonical.has_role, clip.fps
    )


def _rotation_along(local: FloatArray, path: tuple[tuple[int, bool], ...]) -> FloatArray:
    """Returns the rotation (T, 4) along a path of joints, from local rotations (T, J, 4)."""
    total = np.broadcast_to(rotation.IDENTITY, (len(local), 4))
    for joint, up in path:
        total = rotation.multiply(total, rotation.inverse(local[:, joint]) if up else local[:, joint])
    return total


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
    rotvecs = np.einsum("kab,nkb->nka", axes, delta_rotvecs[:, turned])
    local = np.array(local_rotations, dtype=np.float64)
    local[:, joints] = rotation.multiply(local[:, joints], rotation.exp(rotvecs))
    return local


def with_canonical_rotations(clip: Clip, quats: FloatArray) -> Clip:
    """The clip with each role's joint at canonical rotations ``quats`` (T, R, 4); joints without a role, and roles that
    the rig lacks, stay. Raises ``InputError`` if the clip's arms are not known by name.
    """
    deltas = rotation.log(rotation.multiply(rotation.inverse(canonical_motion(clip).quats), quats))
    return replace(clip, local_rotations=apply_deltas(clip.skeleton, clip.local_rotations, deltas))


def mirror_deltas(delta_rotvecs: FloatArray) -> FloatArray:
    """Rotation vectors (T, R, 3) of all roles as they are in the mirror."""
    return np.asarray(delta_rotvecs[:, MIRROR] * np.array([1.0, -1.0, -1.0]))
