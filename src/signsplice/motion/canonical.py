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

from signsplice.motion import kinematics, rotation, stance
from signsplice.motion.arms import arm_joints, between_rests
from signsplice.motion.clip import Clip, Skeleton, concatenate
from signsplice.motion.common_pose import common_positions, common_rotations
from signsplice.motion.humanoid import find_roles

Float = NDArray[np.float64]

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
class Rig:
    """How a skeleton carries the roles.

    joints (R,): joint of every role, -1 where there is none. above (R,): row of the nearest role above it, -1 where
    the hips are. common (J, 4): rotations of the common pose. last (K,): of the K roles that are there, the joint whose
    local rotation leads to it; ways: of those to which it does not lead alone, or not down, by row of ``last``, all
    joints from the one above, with True where the way goes up. into (K, 4, 4): what makes the canonical turns of
    such rotations, as matrices on quaternions. back (K, 3, 3): what brings a vector in canonical axes into those of its
    joint. arms: joints of ``TIPS`` (the wrist's where a finger is missing), both elbows and, last, both shoulders.
    origin: the nearest joint above all of them and ``chest``, in whose axes, those of the trunk, places are told.
    arm_length: shoulder to wrist, clip units.
    """

    joints: NDArray[np.intp]
    above: NDArray[np.intp]
    common: Float
    last: NDArray[np.intp]
    ways: dict[int, tuple[tuple[int, bool], ...]]
    into: Float
    back: Float
    arms: tuple[int, ...]
    chest: int
    origin: int
    arm_length: float

    @property
    def there(self) -> NDArray[np.bool_]:
        """Which roles the rig has (R,)."""
        return self.joints >= 0


_RIGS: WeakKeyDictionary[Skeleton, Rig] = WeakKeyDictionary()


def rig(skeleton: Skeleton) -> Rig:
    """How a skeleton carries the roles, remembered as long as it lives. Raises ``InputError`` where it has no arms that
    are known by name.
    """
    found = _RIGS.get(skeleton)
    if found is None:
        found = _RIGS[skeleton] = _rig(skeleton)
    return found


def _rig(skeleton: Skeleton) -> Rig:
    arm_joints(skeleton)
    roles = find_roles(skeleton).joints
    hips = roles.get("hips", 0)
    joints = np.array([roles.get(role, -1) for role in ROLES])
    row_of = {int(joint): row for row, joint in enumerate(joints) if joint >= 0}
    above = np.full(len(ROLES), -1)
    for row, joint in enumerate(joints):
        if joint >= 0:
            above[row] = next((row_of[over] for over in kinematics.lineage(skeleton, joint)[1:] if over in row_of), -1)
    common = common_rotations(skeleton)
    own, over = joints[joints >= 0], np.where(above >= 0, joints[above], hips)[joints >= 0]
    tips = np.array([roles.get(role, -1) for role in TIPS])
    tips = np.where(tips >= 0, tips, np.repeat(tips[[0, len(TIPS) // 2]], len(TIPS) // 2))
    arms = (*tips.tolist(), *(int(joints[side.start + k]) for k in (2, 1) for side in (LEFT, RIGHT)))
    ways = [_way(skeleton, int(a), int(b)) for a, b in zip(over, own, strict=True)]
    shoulder = LEFT.start if joints[LEFT.start] >= 0 else LEFT.start + 1
    chest = int(joints[above[shoulder]]) if above[shoulder] >= 0 else hips
    return Rig(
        joints=joints,
        above=above,
        common=common,
        last=np.array([way[-1][0] if way else 0 for way in ways]),
        ways={k: way for k, way in enumerate(ways) if len(way) != 1 or way[0][1]},
        back=rotation.to_matrix(rotation.inverse(common[own])),
        into=_on_quaternions(common[over], rotation.inverse(common[own])),
        arms=arms,
        chest=chest,
        origin=kinematics.meeting(skeleton, (*arms, chest)),
        arm_length=stance.sizes(skeleton).arm_length,
    )


def _way(skeleton: Skeleton, start: int, end: int) -> tuple[tuple[int, bool], ...]:
    """The joints whose local rotations lead from one joint to another, True where they are undone on the way up."""
    up, down = kinematics.lineage(skeleton, start), kinematics.lineage(skeleton, end)
    common = set(up) & set(down)
    ups = [(joint, True) for joint in up if joint not in common]
    return (*ups, *((joint, False) for joint in reversed(down) if joint not in common))


def _on_quaternions(before: Float, after: Float) -> Float:
    """Matrices (K, 4, 4) that take a quaternion q to before q after, for quaternions (K, 4)."""
    return np.stack([rotation.multiply(rotation.multiply(before, q), after) for q in np.eye(4)], axis=-1)


@dataclass(frozen=True, eq=False)
class Signing:
    """A clip's signing body.

    turns (T, R, 4): canonical turns A, quaternions; identity where the rig has no such joint. places (T, 12, 3): the
    joints of ``TIPS`` from the middle between the shoulders, in the axes of the trunk (left +X, up +Y, forward +Z), in
    arm lengths; the wrist's where a finger is missing. elbows (T, 2, 3): theirs, likewise. there (R,): roles that the
    rig has.
    """

    turns: Float
    places: Float
    elbows: Float
    there: NDArray[np.bool_]
    fps: float

    def mirrored(self) -> Signing:
        """The same seen in the mirror: left and right change places."""
        flip = np.array([-1.0, 1.0, 1.0])
        half = len(TIPS) // 2
        turns = self.turns[:, MIRROR] * np.array([1.0, -1.0, -1.0, 1.0])
        places = np.concatenate([self.places[:, half:], self.places[:, :half]], axis=1) * flip
        return Signing(turns, places, self.elbows[:, ::-1] * flip, self.there[MIRROR], self.fps)

    @property
    def active(self) -> tuple[int, int]:
        """Frames [start, stop) in which the arms are away from rest: ``arms.active_span``, seen from the trunk."""
        return between_rests(self.places[:, :: len(TIPS) // 2, 1], self.elbows[..., 1])


def signing(clip: Clip) -> Signing:
    """The signing body of a clip. Raises ``InputError`` where its arms are not known by name."""
    known = rig(clip.skeleton)
    # A = C_above G_above^-1 G C^-1: of the rotations between the two joints alone, no kinematics.
    # Frames last, so that every product is of long rows.
    local = clip.local_rotations.transpose(1, 2, 0)
    between = local[known.last]
    for k, way in known.ways.items():
        between[k] = _along(clip.local_rotations, way).T
    turns = known.into @ between
    if not known.there.all():
        whole = np.empty((len(ROLES), *turns.shape[1:]))
        whole[:] = rotation.IDENTITY[:, None]
        whole[known.there] = turns
        turns = whole
    globals_, positions = kinematics.forward(clip, [known.chest, *known.arms], known.origin)
    middle = positions[:, -2:].mean(axis=1)
    trunk = globals_[:, 0] @ rotation.to_matrix(rotation.inverse(known.common[known.chest]))
    places = (positions[:, 1:-2] - middle[:, None]) @ trunk / known.arm_length
    return Signing(turns.transpose(2, 0, 1), places[:, : len(TIPS)], places[:, len(TIPS) :], known.there, clip.fps)


def signings(clips: Sequence[Clip]) -> list[Signing]:
    """The signing bodies of clips of one skeleton, looked at in one go: those of ``signing``."""
    together, at, out = signing(concatenate(clips)), 0, []
    for clip in clips:
        own = slice(at, at := at + len(clip))
        out.append(Signing(together.turns[own], together.places[own], together.elbows[own], together.there, clip.fps))
    return out


def _along(local: Float, way: tuple[tuple[int, bool], ...]) -> Float:
    """The rotation (T, 4) from one joint to another, of local rotations (T, J, 4)."""
    out = np.broadcast_to(rotation.IDENTITY, (len(local), 4))
    for joint, up in way:
        out = rotation.multiply(out, rotation.inverse(local[:, joint]) if up else local[:, joint])
    return out


def turned(skeleton: Skeleton, local_rotations: Float, deltas: Float) -> Float:
    """Local rotations (T, J, 4) with each role's joint turned by ``deltas`` (T, R, 3), rotation vectors in canonical
    axes; others stay. Roles that the rig lacks are passed over.
    """
    known = rig(skeleton)
    joints = known.joints[known.there]
    own = np.einsum("kab,nkb->nka", known.back, deltas[:, known.there])
    out = np.array(local_rotations, dtype=np.float64)
    out[:, joints] = rotation.multiply(out[:, joints], rotation.exp(own))
    return out


def bones(skeleton: Skeleton) -> Float:
    """From the joint above each role's to its own in the common pose (R, 3), arm lengths; 0 where a role is missing.

    With turns A, joints lie at p_j = p_above + K_above bone_j, as near as joints without a role keep their pose.
    """
    known = rig(skeleton)
    places = common_positions(skeleton)
    hips = find_roles(skeleton).joints.get("hips", 0)
    over = np.where(known.above >= 0, known.joints[known.above], hips)
    return np.asarray(np.where(known.there[:, None], (places[known.joints] - places[over]) / known.arm_length, 0.0))


def mirrored_deltas(deltas: Float) -> Float:
    """Deltas (T, R, 3) as they are in the mirror."""
    return np.asarray(deltas[:, MIRROR] * np.array([1.0, -1.0, -1.0]))
