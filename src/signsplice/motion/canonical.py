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

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import kinematics, rotation, stance
from signsplice.motion.arms import arm_joints
from signsplice.motion.clip import Clip, Skeleton
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
    the hips are. common (J, 4): rotations of the common pose. tips (12,): joints of ``TIPS``, -1 where there is none.
    arm_length: shoulder to wrist, clip units.
    """

    joints: NDArray[np.intp]
    above: NDArray[np.intp]
    common: Float
    tips: NDArray[np.intp]
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
    joints = np.array([roles.get(role, -1) for role in ROLES])
    row_of = {int(joint): row for row, joint in enumerate(joints) if joint >= 0}
    above = np.full(len(ROLES), -1)
    for row, joint in enumerate(joints):
        over = int(skeleton.parents[joint]) if joint >= 0 else -1
        while over >= 0 and over not in row_of:
            over = int(skeleton.parents[over])
        above[row] = row_of.get(over, -1)
    tips = np.array([roles.get(role, -1) for role in TIPS])
    return Rig(joints, above, common_rotations(skeleton), tips, stance.sizes(skeleton).arm_length)


@dataclass(frozen=True, eq=False)
class Signing:
    """A clip's signing body.

    turns (T, R, 3, 3): canonical turns A; identity where the rig has no such joint. places (T, 12, 3): the joints of
    ``TIPS`` from the middle between the shoulders, in the axes of the trunk (left +X, up +Y, forward +Z), in
    arm lengths; the wrist's where a finger is missing. there (R,): roles that the rig has.
    """

    turns: Float
    places: Float
    there: NDArray[np.bool_]
    fps: float

    def mirrored(self) -> Signing:
        """The same seen in the mirror: left and right change places."""
        flip = np.array([-1.0, 1.0, 1.0])
        half = len(TIPS) // 2
        turns = self.turns[:, MIRROR] * flip[:, None] * flip
        places = np.concatenate([self.places[:, half:], self.places[:, :half]], axis=1) * flip
        return Signing(turns, places, self.there[MIRROR], self.fps)


def signing(clip: Clip) -> Signing:
    """The signing body of a clip. Raises ``InputError`` where its arms are not known by name."""
    known = rig(clip.skeleton)
    hips = find_roles(clip.skeleton).joints.get("hips", 0)
    shoulders = [known.joints[LEFT.start + 1], known.joints[RIGHT.start + 1]]
    rows = np.flatnonzero(known.there)
    tips = np.where(known.tips >= 0, known.tips, np.repeat(known.tips[[0, len(TIPS) // 2]], len(TIPS) // 2))
    asked = [hips, *known.joints[rows].tolist(), *shoulders, *tips.tolist()]
    globals_, positions = kinematics.forward(clip, asked)
    n = len(rows) + 1
    carried = np.einsum("tkab,kcb->tkac", globals_[:, :n], rotation.to_matrix(known.common[asked[:n]]))  # K
    at = {int(row): k + 1 for k, row in enumerate(rows)} | {-1: 0}
    over = [at[int(known.above[row])] for row in rows]
    turns = np.broadcast_to(np.eye(3), (len(clip), len(ROLES), 3, 3)).copy()
    turns[:, rows] = np.einsum("tkba,tkbc->tkac", carried[:, over], carried[:, 1:n])
    top = carried[:, at[int(known.above[LEFT.start if known.joints[LEFT.start] >= 0 else LEFT.start + 1])]]
    middle = positions[:, n : n + 2].mean(axis=1)
    places = (positions[:, n + 2 :] - middle[:, None]) @ top / known.arm_length
    return Signing(turns, places, known.there, clip.fps)


def turned(skeleton: Skeleton, local_rotations: Float, deltas: Float) -> Float:
    """Local rotations (T, J, 4) with each role's joint turned by ``deltas`` (T, R, 3), rotation vectors in canonical
    axes; others stay. Roles that the rig lacks are passed over.
    """
    known = rig(skeleton)
    rows = np.flatnonzero(known.there)
    joints = known.joints[rows]
    own = rotation.rotate(rotation.inverse(known.common[joints]), deltas[:, rows])
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
