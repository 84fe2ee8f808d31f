"""The events of an isolated word: its frames of rest, postures and movements, and what touches there."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Events:
    """Frames of an isolated word, and how near its hands are to the skin in its first and last postures.

    Skin distances are those of ``clearance``: of the strong hand, or of either where the hands mirror one another,
    to head, trunk, the other hand and the other arm.

    up: the last frame of rest
    start: the first posture
    end: the last posture
    down: the first frame of rest again
    first: the first movement, [begin, end]; None for a word without movement
    passes: [begin, end] of every pass of the last movement, in order: its repetitions, or a circle's revolutions
    touches_first: whether the first posture touches: a skin distance of at most 5 mm
    touches_last: whether the last posture touches
    gap_first_cm: skin distance at ``start``; None in corpora of version 1, whose touches are those of the notation
    gap_last_cm: skin distance at ``end``
    """

    up: int
    start: int
    end: int
    down: int
    first: tuple[int, int] | None
    passes: tuple[tuple[int, int], ...]
    touches_first: bool = False
    touches_last: bool = False
    gap_first_cm: float | None = None
    gap_last_cm: float | None = None
