"""Keeps hands out of head, trunk and the other arm: wrists are pushed out of collisions, smoothly in time; and how far
hands are from what they may touch, skin to skin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.body.clearance import SkinPairs, pair_clearances, skin_pairs
from signsplice.body.collision import PosedCapsules
from signsplice.motion import curves, kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig.naming import SIDES
from signsplice.signer import pose
from signsplice.signer.figure import Figure
from signsplice.signer.phonology import Sign
from signsplice.signer.signer import Signer

TOLERANCE_CM = 0.2
"""Depth up to which a touch may press into the body."""
NEAR_CM = 1.0
"""Distance from the skin up to which a hand may be meant to touch it."""
_ROUNDS = 30
_STUCK_CM = 0.35
"""Depth from which a hand that is still in the body after these rounds is pushed on, in a steadier direction."""
_KERNEL = np.array([0.12, 0.35, 0.72, 1.0, 0.72, 0.35, 0.12])


def clear_collisions(
    states: FloatArray,
    signer: Signer,
    ends: bool = False,
    figure: Figure | None = None,
    mirrored: bool = False,
) -> FloatArray:
    """States (T, 65) with wrists moved out of head, trunk and the other arm where they lay deeper than the tolerance.

    Each push is spread over about five frames. ``ends``: the frames belong between two others; pushes fade out towards
    both ends, so that their neighbours fit. ``figure``: of these states but for their arms.
    """
    figure = figure or Figure(states, signer)
    level = curves.fade_window(len(states)) if ends else np.ones(len(states))
    mean = np.zeros((len(states), 2, 3))
    depth, exits = _depths(figure.posed(states).capsules)
    for n in range(2 * _ROUNDS):
        out = exits
        if n >= _ROUNDS:
            if depth.max() < _STUCK_CM:
                break
            # On either side of a nose or a finger by turns: the mean direction leads out.
            mean = 0.8 * mean + 0.2 * out
            out = mean / (np.linalg.norm(mean, axis=-1, keepdims=True) + 1e-9)
        gain = 0.6 if n < _ROUNDS // 2 else 1.0  # gently first: of two hands that meet, both are pushed
        push = gain * np.maximum(depth - 0.7 * TOLERANCE_CM, 0.0) * (depth > TOLERANCE_CM)
        if not push.any():
            break
        pushes = push[..., None] * out  # (T, 2, 3)
        if mirrored:
            pushes = np.repeat(pushes.mean(axis=1, keepdims=True), 2, axis=1)
            pushes[..., 0] = -np.abs(pushes[..., 0])  # away from the other hand, though they be past one another
        displacements = curves.spread_in_time(pushes, _KERNEL) * level[:, None, None]
        states = states.copy()
        pose.hands(states)[..., pose.WRIST] += displacements
        frames = np.flatnonzero(displacements.any(axis=(1, 2)))
        depth[frames], exits[frames] = _depths(figure.posed(states[frames], frames).capsules)
    return states


def penetration(
    states: FloatArray, signer: Signer, slack: float = 0.0, figure: Figure | None = None
) -> tuple[FloatArray, FloatArray]:
    """Depth (T, 2) of each hand, strong first, in head, trunk, the other arm or its hand, or of its forearm in the
    other arm, cm, some negative number where it is free by more than ``slack`` (then without a direction); and the unit
    direction (T, 2, 3) out of there in the chest's axes, mirrored for the weak hand as its state is. ``figure``: of
    these states but for their arms.
    """
    return _depths((figure or Figure(states, signer)).posed(states).capsules, slack)


def _depths(capsules: PosedCapsules, slack: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """``penetration`` of capsules in the chest's axes."""
    depth, out = capsules.near_pairs(slack, forearms=True).penetration()
    return depth[:, ::-1], out[:, ::-1] * [[[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]]]


def touching(states: FloatArray, signer: Signer) -> NDArray[np.bool_]:
    """Whether either hand touches head, trunk or the other hand, or nearly does (T,)."""
    depth, _ = penetration(states, replace(signer, left_handed=False), NEAR_CM)
    return np.asarray(depth.max(axis=1) > -NEAR_CM)


TOUCH_CM = 0.5
"""Distance of the skins up to which hands count as touching."""
MIRRORED_HANDS = ("symmetric", "alternating")
"""Kinds of hands of which either may touch; of others the strong one."""


def hand_clearances(states: FloatArray, signer: Signer, most: float = np.inf) -> FloatArray:
    """Distances (T, 4) between skins, cm, negative inside, or ``most`` where they are greater: of the strong hand and
    of the weak one from head and trunk, of the strong hand from the weak hand or arm, and from the weak hand alone.
    """
    capsules = Figure(states, signer).posed(states).capsules
    body, groups = capsules.body, capsules.body.groups
    solid = (*groups.head, *groups.trunk)
    parts = zip(body.parts, body.sides, strict=True)
    arm = tuple(n for n, (part, side) in enumerate(parts) if side == "left" and part in ("sleeve", "cuff"))
    strong, weak = (
        capsules.nearest(own, other, most)[0]
        for own, other in ((groups.right, (solid, arm, groups.left)), (groups.left, (solid,)))
    )
    return np.column_stack([strong[:, 0], weak[:, 0], strong[:, 1:].min(axis=1), strong[:, 2]])


def between_hands(states: FloatArray, signer: Signer, most: float = np.inf) -> FloatArray:
    """Distance (T,) between the skins of the two hands, cm, negative inside, or ``most`` where it is greater."""
    capsules = Figure(states, signer).posed(states).capsules
    return capsules.nearest(capsules.body.groups.right, (capsules.body.groups.left,), most)[0][:, 0]


def touching_sides(sign: Sign, signer: Signer) -> tuple[str, ...]:
    """The hands of a sign whose touches count, of ``SIDES``: the strong one, and both where they mirror one another."""
    if sign.hands in MIRRORED_HANDS:
        return SIDES
    return ("left",) if signer.left_handed else ("right",)


def skin_clearances(clip: Clip, frames: Sequence[int], sides: Sequence[str]) -> FloatArray:
    """Least distance (F,), cm, at some frames, from the skin of the hands ``sides`` to head, neck, trunk, the other
    hand and the other arm; negative inside, rounded so that a mirrored signer has the same.
    """
    at = list(frames)
    body = body_capsules(clip.skeleton)
    starts, ends = capsule_ends(
        body, *kinematics.forward(Clip(clip.skeleton, clip.local_rotations[at], clip.root_positions[at], clip.fps))
    )
    pairs = skin_pairs(body, frozenset(body.keys))
    wanted = np.flatnonzero(_of_hands(pairs, sides, np.array([*body.groups.left, *body.groups.right])))
    rows, k = np.repeat(np.arange(len(at)), len(wanted)), np.tile(wanted, len(at))
    distance = pair_clearances(starts, ends, body.radii, pairs, rows, k).distance
    return np.asarray(distance.reshape(len(at), -1).min(axis=1).round(6))


def _of_hands(pairs: SkinPairs, sides: Sequence[str], hands: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which pairs (K,) have a capsule of one of these hands."""
    numbers = [SIDES.index(side) for side in sides]
    own = np.isin(pairs.own_side, numbers)
    other = np.isin(pairs.other_side, numbers) & np.isin(pairs.other, hands)
    return np.asarray(own | other)
