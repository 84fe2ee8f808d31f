"""How far a signer's hands are from what they may touch, skin to skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.body.capsules import BodyCapsules, body_capsules, capsule_ends
from signsplice.body.clearance import SkinPairs, pair_clearances, skin_pairs
from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig.naming import SIDES
from signsplice.synth import pose
from signsplice.synth.phonology import Sign
from signsplice.synth.signer import Signer, skeleton

TOUCH_CM = 0.5
"""Distance of the skins up to which hands count as touching."""
MIRRORED_HANDS = ("symmetric", "alternating")
"""Kinds of hands of which either may touch; of others the strong one."""


def hand_clearances(states: FloatArray, signer: Signer) -> FloatArray:
    """Distances (T, 4) between skins, cm, negative inside: of the strong hand and of the weak one from head and trunk,
    of the strong hand from the weak hand or arm, and from the weak hand alone.
    """
    body, starts, ends = _posed(states, signer)
    groups = body.groups
    solid = (*groups.head, *groups.trunk)
    parts = zip(body.parts, body.sides, strict=True)
    arm = tuple(n for n, (part, side) in enumerate(parts) if side == "left" and part in ("sleeve", "cuff"))
    pairs = ((groups.right, solid), (groups.left, solid), (groups.right, arm), (groups.right, groups.left))
    clearances = np.stack([_clearance(body, starts, ends, *pair) for pair in pairs], axis=1)
    clearances[:, 2] = clearances[:, 2:].min(axis=1)
    return clearances


def between_hands(states: FloatArray, signer: Signer) -> FloatArray:
    """Distance (T,) between the skins of the two hands, cm, negative inside."""
    body, starts, ends = _posed(states, signer)
    return _clearance(body, starts, ends, body.groups.right, body.groups.left)


def _posed(states: FloatArray, signer: Signer) -> tuple[BodyCapsules, FloatArray, FloatArray]:
    """The capsules of a right-handed signer's body, and where their axes (T, C, 3) start and end."""
    signer = replace(signer, left_handed=False)
    bones = skeleton(signer)
    body = body_capsules(bones)
    return body, *capsule_ends(body, *kinematics.forward(Clip(bones, *pose.rotations(states, signer), 30.0)))


def _clearance(
    body: BodyCapsules, starts: FloatArray, ends: FloatArray, own: tuple[int, ...], other: tuple[int, ...]
) -> FloatArray:
    return np.asarray(-collision.overlap(starts, ends, body.radii, own, other)[0].max(axis=(1, 2)))


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
