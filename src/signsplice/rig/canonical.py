"""The signing body of any rig on one canonical humanoid: the same motion gives the same numbers, whatever the rig.

A joint's canonical turn is the rotation that brings its bone from the common pose to where it is, seen from the
nearest joint above that has a role: identity for all in a T-pose, whatever the file's rest pose, axes or facing. With
G the global rotation of a joint, and C the one that poses the rest skeleton in the common pose (``common_pose``),

    K_j = G_j C_j^-1,    A_j = K_above^-1 K_j.

A turn ``d`` of a joint in canonical axes, A -> A exp(d), is q -> q exp(C_j^-1 d) for the local rotation of the rig's
own joint: what a network says in canonical axes goes back to any rig exactly, and joints without a role stay as they
are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton, concatenate
from signsplice.rig import proportions
from signsplice.rig.arms import arm_joints, span_between_rests
from signsplice.rig.roles import find_roles
from signsplice.rig.t_pose import t_pose_positions, t_pose_rotations

Float = NDArray[np.float64]

FEATURE_FPS = 30.0
"""Frame rate at which networks see canonical motion, whatever the rate of the clip."""
FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
_PHALANGES = ("Proximal", "Intermediate", "Distal")
TRUNK = ("spine", "chest", "upperChest", "neck", "head")
ARM = ("Shoulder", "UpperArm", "LowerArm", "Hand")


def _side(side: str) -> tuple[str, ...]:
    fingers = [f"{f}{p}" for f in FINGERS for p in (("Metacarpal", *_PHALANGES[::2]) if f == "Thumb" else _PHALANGES)]
    return tuple(side + part for part in (*ARM, *fingers))


ROLES: tuple[str, ...] = (*TRUNK, *_side("left"), *_side("right"))
"""The roles that sign: trunk, neck, head, then 19 joints of the left arm and hand, and as many of the right."""
N_SIDE = len(_side("left"))
LEFT = slice(len(TRUNK), len(TRUNK) + N_SIDE)
RIGHT = slice(LEFT.stop, LEFT.stop + N_SIDE)
TIPS: tuple[str, ...] = tuple(f"{side}{part}" for side in ("left", "right") for part in
                              ("Hand", *(f"{finger}Distal" for finger in FINGERS)))  # fmt: skip
"""Joints whose places are told: wrist and the last joint of every finger, left then right."""

MIRROR = np.concatenate([np.arange(len(TRUNK)), np.arange(RIGHT.start, RIGHT.stop), np.arange(LEFT.start, LEFT.stop)])
"""Where each role finds its counterpart in the mirror."""


@dataclass(frozen=True, eq=False)
class CanonicalMap:
    """How a skeleton carries the roles.

    joints (R,): joint of every role, -1 where there is none. parent_rows (R,): row of the nearest role above it, -1 where
    the hips are. t_pose_rotations (J, 4): rotations of the common pose. last_joints (K,): of the K roles that are there, the joint whose
    local rotation leads to it; joint_paths: of those to which it does not lead alone, or not down, by row of ``last_joints``, all
    joints from the one above, with True where the way goes up. to_canonical (K, 4, 4): what makes the canonical turns of
    such rotations, as matrices on quaternions. from_canonical (K, 3, 3): what brings a vector in canonical axes into those of its
    joint. arms: joints of ``TIPS`` (the wrist's where a finger is missing), both elbows and, last, both shoulders.
    origin: the nearest joint above all of them and ``chest``, in whose axes, those of the trunk, places are told.
    arm_length: shoulder to wrist, clip units.
    """

    joints: NDArray[np.intp]
    parent_rows: NDArray[np.intp]
    t_pose_rotations: Float
    last_joints: NDArray[np.intp]
    joint_paths: dict[int, tuple[tuple[int, bool], ...]]
    to_canonical: Float
    from_canonical: Float
    arms: tuple[int, ...]
    chest: int
    origin: int
    arm_length: float

    @property
    def has_role(self) -> NDArray[np.bool_]:
        """Which roles the rig has (R,)."""
        return self.joints >= 0


_MAPS: WeakKeyDictionary[Skeleton, CanonicalMap] = WeakKeyDictionary()


def canonical_map(skeleton: Skeleton) -> CanonicalMap:
    """How a skeleton carries the roles, remembered as long as it lives. Raises ``InputError`` where it has no arms that
    are known by name.
    """
    found = _MAPS.get(skeleton)
    if found is None:
        found = _MAPS[skeleton] = _canonical_map(skeleton)
    return found


def _canonical_map(skeleton: Skeleton) -> CanonicalMap:
    arm_joints(skeleton)
    roles = find_roles(skeleton).joints
    hips = roles.get("hips", 0)
    joints = np.array([roles.get(role, -1) for role in ROLES])
    row_of = {int(joint): row for row, joint in enumerate(joints) if joint >= 0}
    above = np.full(len(ROLES), -1)
    for row, joint in enumerate(joints):
        if joint >= 0:
            above[row] = next(
                (row_of[over] for over in kinematics.path_to_root(skeleton, joint)[1:] if over in row_of), -1
            )
    common = t_pose_rotations(skeleton)
    own, over = joints[joints >= 0], np.where(above >= 0, joints[above], hips)[joints >= 0]
    tips = np.array([roles.get(role, -1) for role in TIPS])
    tips = np.where(tips >= 0, tips, np.repeat(tips[[0, len(TIPS) // 2]], len(TIPS) // 2))
    arms = (*tips.tolist(), *(int(joints[side.start + k]) for k in (2, 1) for side in (LEFT, RIGHT)))
    ways = [_joint_path(skeleton, int(a), int(b)) for a, b in zip(over, own, strict=True)]
    shoulder = LEFT.start if joints[LEFT.start] >= 0 else LEFT.start + 1
    chest = int(joints[above[shoulder]]) if above[shoulder] >= 0 else hips
    return CanonicalMap(
        joints=joints,
        parent_rows=above,
        t_pose_rotations=common,
        last_joints=np.array([way[-1][0] if way else 0 for way in ways]),
        joint_paths={k: way for k, way in enumerate(ways) if len(way) != 1 or way[0][1]},
        from_canonical=rotation.to_matrix(rotation.inverse(common[own])),
        to_canonical=_on_quaternions(common[over], rotation.inverse(common[own])),
        arms=arms,
        chest=chest,
        origin=kinematics.common_ancestor(skeleton, (*arms, chest)),
        arm_length=proportions.sizes(skeleton).arm_length,
    )


def _joint_path(skeleton: Skeleton, start: int, end: int) -> tuple[tuple[int, bool], ...]:
    """The joints whose local rotations lead from one joint to another, True where they are undone on the way up."""
    up, down = kinematics.path_to_root(skeleton, start), kinematics.path_to_root(skeleton, end)
    common = set(up) & set(down)
    ups = [(joint, True) for joint in up if joint not in common]
    return (*ups, *((joint, False) for joint in reversed(down) if joint not in common))


def _on_quaternions(before: Float, after: Float) -> Float:
    """Matrices (K, 4, 4) that take a quaternion q to before q after, for quaternions (K, 4)."""
    return np.stack([rotation.multiply(rotation.multiply(before, q), after) for q in np.eye(4)], axis=-1)


@dataclass(frozen=True, eq=False)
class CanonicalMotion:
    """A clip's signing body.

    quats (T, R, 4): canonical turns A, quaternions; identity where the rig has no such joint. positions (T, 12, 3): the
    joints of ``TIPS`` from the middle between the shoulders, in the axes of the trunk (left +X, up +Y, forward +Z), in
    arm lengths; the wrist's where a finger is missing. elbow_positions (T, 2, 3): theirs, likewise. has_role (R,): roles that the
    rig has.
    """

    quats: Float
    positions: Float
    elbow_positions: Float
    has_role: NDArray[np.bool_]
    fps: float

    def mirrored(self) -> CanonicalMotion:
        """The same seen in the mirror: left and right change places."""
        flip = np.array([-1.0, 1.0, 1.0])
        half = len(TIPS) // 2
        turns = self.quats[:, MIRROR] * np.array([1.0, -1.0, -1.0, 1.0])
        places = np.concatenate([self.positions[:, half:], self.positions[:, :half]], axis=1) * flip
        return CanonicalMotion(turns, places, self.elbow_positions[:, ::-1] * flip, self.has_role[MIRROR], self.fps)

    @property
    def active_span(self) -> tuple[int, int]:
        """Frames [start, stop) in which the arms are away from rest: ``arms.active_span``, seen from the trunk."""
        return span_between_rests(self.positions[:, :: len(TIPS) // 2, 1], self.elbow_positions[..., 1])


def canonical_motion(clip: Clip) -> CanonicalMotion:
    """The signing body of a clip. Raises ``InputError`` where its arms are not known by name."""
    known = canonical_map(clip.skeleton)
    # A = C_above G_above^-1 G C^-1: of the rotations between the two joints alone, no kinematics.
    # Frames last, so that every product is of long rows.
    local = clip.local_rotations.transpose(1, 2, 0)
    between = local[known.last_joints]
    for k, way in known.joint_paths.items():
        between[k] = _rotation_along(clip.local_rotations, way).T
    turns = known.to_canonical @ between
    if not known.has_role.all():
        whole = np.empty((len(ROLES), *turns.shape[1:]))
        whole[:] = rotation.IDENTITY[:, None]
        whole[known.has_role] = turns
        turns = whole
    globals_, positions = kinematics.forward(clip, [known.chest, *known.arms], known.origin)
    middle = positions[:, -2:].mean(axis=1)
    trunk = globals_[:, 0] @ rotation.to_matrix(rotation.inverse(known.t_pose_rotations[known.chest]))
    places = (positions[:, 1:-2] - middle[:, None]) @ trunk / known.arm_length
    return CanonicalMotion(
        turns.transpose(2, 0, 1), places[:, : len(TIPS)], places[:, len(TIPS) :], known.has_role, clip.fps
    )


def canonical_motions(clips: Sequence[Clip]) -> list[CanonicalMotion]:
    """The signing bodies of clips of one skeleton, looked at in one go: those of ``canonical_motion``."""
    together, at, out = canonical_motion(concatenate(clips)), 0, []
    for clip in clips:
        own = slice(at, at := at + len(clip))
        out.append(
            CanonicalMotion(
                together.quats[own], together.positions[own], together.elbow_positions[own], together.has_role, clip.fps
            )
        )
    return out


def _rotation_along(local: Float, way: tuple[tuple[int, bool], ...]) -> Float:
    """The rotation (T, 4) from one joint to another, of local rotations (T, J, 4)."""
    out = np.broadcast_to(rotation.IDENTITY, (len(local), 4))
    for joint, up in way:
        out = rotation.multiply(out, rotation.inverse(local[:, joint]) if up else local[:, joint])
    return out


def apply_deltas(skeleton: Skeleton, local_rotations: Float, deltas: Float) -> Float:
    """Local rotations (T, J, 4) with each role's joint turned by ``deltas`` (T, R, 3), rotation vectors in canonical
    axes; others stay. Roles that the rig lacks are passed over.
    """
    known = canonical_map(skeleton)
    joints = known.joints[known.has_role]
    own = np.einsum("kab,nkb->nka", known.from_canonical, deltas[:, known.has_role])
    out = np.array(local_rotations, dtype=np.float64)
    out[:, joints] = rotation.multiply(out[:, joints], rotation.exp(own))
    return out


def canonical_bones(skeleton: Skeleton) -> Float:
    """From the joint above each role's to its own in the common pose (R, 3), arm lengths; 0 where a role is missing.

    With turns A, joints lie at p_j = p_above + K_above bone_j, as near as joints without a role keep their pose.
    """
    known = canonical_map(skeleton)
    places = t_pose_positions(skeleton)
    hips = find_roles(skeleton).joints.get("hips", 0)
    over = np.where(known.parent_rows >= 0, known.joints[known.parent_rows], hips)
    return np.asarray(np.where(known.has_role[:, None], (places[known.joints] - places[over]) / known.arm_length, 0.0))


def mirrored_deltas(deltas: Float) -> Float:
    """Deltas (T, R, 3) as they are in the mirror."""
    return np.asarray(deltas[:, MIRROR] * np.array([1.0, -1.0, -1.0]))
