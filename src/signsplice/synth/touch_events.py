"""How near hands are to the skin at the events of a word: a touch is what is seen, not what the notation asks for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.body.touch import SkinPairs, pair_gaps, skin_pairs
from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig.naming import SIDES
from signsplice.synth.phonology import Sign
from signsplice.synth.signer import Signer

MIRRORED_HANDS = ("symmetric", "alternating")
"""Kinds of hands of which either may touch; of others the strong one."""


def touching_sides(sign: Sign, signer: Signer) -> tuple[str, ...]:
    """The hands of a sign whose touches count, of ``SIDES``: the strong one, and both where they mirror one another."""
    if sign.hands in MIRRORED_HANDS:
        return SIDES
    return ("left",) if signer.left_handed else ("right",)


def skin_gaps(clip: Clip, frames: Sequence[int], sides: Sequence[str]) -> FloatArray:
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
    distance = pair_gaps(starts, ends, body.radii, pairs, rows, k).distance
    return np.asarray(distance.reshape(len(at), -1).min(axis=1).round(6))


def _of_hands(pairs: SkinPairs, sides: Sequence[str], hands: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which pairs (K,) have a capsule of one of these hands."""
    numbers = [SIDES.index(side) for side in sides]
    own = np.isin(pairs.own_side, numbers)
    other = np.isin(pairs.other_side, numbers) & np.isin(pairs.other, hands)
    return np.asarray(own | other)
