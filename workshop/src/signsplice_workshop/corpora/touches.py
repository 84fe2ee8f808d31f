"""Measures how near the hands of an isolated word come to the skin in its first and last postures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.body.collision import SkinPairs, pair_clearances, skin_pairs
from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.rig.roles import SIDES
from signsplice.signer.collisions import TOUCH_CM
from signsplice.signer.phonology import MIRRORED_HANDS
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import Signer
from signsplice.signer.timing import Events


@dataclass(frozen=True)
class SeenEvents(Events):
    """Events of a word, and how near its hands are to the skin then.

    Skin distances are those of ``measure_skin_clearances``: of the strong hand, or of either if the hands mirror each
    other, to head, trunk, the other hand and the other arm.

    touches_first: whether the first posture touches: a skin distance of at most 5 mm
    touches_last: whether the last posture touches
    gap_first_cm: skin distance at ``start``; None in corpora of version 1, whose touches are those of the notation
    gap_last_cm: skin distance at ``end``
    """

    touches_first: bool = False
    touches_last: bool = False
    gap_first_cm: float | None = None
    gap_last_cm: float | None = None


def measure_touches(word: IsolatedWord) -> SeenEvents:
    """Returns the events of a word with skin distances, measured if they are not known yet."""
    events = word.events
    if isinstance(events, SeenEvents):
        return events
    first, last = measure_skin_clearances(
        word.clip, (events.start, events.end), find_touching_sides(word.sign.hands, word.signer)
    )
    return SeenEvents(
        **vars(events),
        touches_first=bool(first <= TOUCH_CM),
        touches_last=bool(last <= TOUCH_CM),
        gap_first_cm=float(first),
        gap_last_cm=float(last),
    )


def with_touches(word: IsolatedWord) -> IsolatedWord:
    """Returns a word whose skin distances are measured, so that many cuts of it need not measure them."""
    return replace(word, events=measure_touches(word))


def find_touching_sides(hands: str, signer: Signer) -> tuple[str, ...]:
    """Returns the hands whose touches count, of ``SIDES``: the strong one, or both if they mirror each other; ``hands``
    says how a sign's hands work together.
    """
    if hands in MIRRORED_HANDS:
        return SIDES
    return ("left",) if signer.left_handed else ("right",)


def measure_skin_clearances(clip: Clip, frames: Sequence[int], sides: Sequence[str]) -> FloatArray:
    """Returns the least distance (F,), cm, at ``frames``, from the skin of the hands ``sides`` to head, neck, trunk,
    the other hand and the other arm; negative inside, rounded so that a mirrored signer has the same.
    """
    rows = list(frames)
    body = body_capsules(clip.skeleton)
    starts, ends = capsule_ends(
        body, *kinematics.forward(Clip(clip.skeleton, clip.local_rotations[rows], clip.root_positions[rows], clip.fps))
    )
    pairs = skin_pairs(body, frozenset(body.keys))
    hand_pairs = np.flatnonzero(_select_hand_pairs(pairs, sides, np.array([*body.groups.left, *body.groups.right])))
    frame_indices, pair_indices = np.repeat(np.arange(len(rows)), len(hand_pairs)), np.tile(hand_pairs, len(rows))
    distance = pair_clearances(starts, ends, body.radii, pairs, frame_indices, pair_indices).distance
    return np.asarray(distance.reshape(len(rows), -1).min(axis=1).round(6))


def _select_hand_pairs(pairs: SkinPairs, sides: Sequence[str], hands: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Returns which pairs (K,) have a capsule of one of these hands."""
    numbers = [SIDES.index(side) for side in sides]
    is_own_hand = np.isin(pairs.own_side, numbers)
    is_other_hand = np.isin(pairs.other_side, numbers) & np.isin(pairs.other, hands)
    return np.asarray(is_own_hand | is_other_hand)
