"""Tempos: how long a sign takes with the transition to it, as asked for and as measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from signsplice.errors import InputError
from signsplice.lexicon.gloss import is_letter

CITATION, NATURAL = "citation", "natural"
RUNNING_S = 0.70
"""Seconds a sign takes in running signing, the transition to it included."""
FASTEST_S, SLOWEST_S = 0.4, 1.5
FAST_M_S = 2.5
"""Peaks of isolated words reach 1.7 to 2.5 m/s; a transition beyond that is faster than any sign."""


def seconds_a_sign(tempo: str | float) -> float | None:
    """Seconds that a sign takes with its transition at a tempo: "natural", or the seconds themselves; None for
    "citation". Raises ``InputError`` for anything else.
    """
    if tempo == CITATION:
        return None
    try:
        seconds = RUNNING_S if tempo == NATURAL else float(tempo)
    except (TypeError, ValueError):
        seconds = float("nan")
    if isinstance(tempo, bool) or not FASTEST_S <= seconds <= SLOWEST_S:
        raise InputError(
            f"tempo {tempo!r}, expected {CITATION}, {NATURAL} or {FASTEST_S:g} to {SLOWEST_S:g} seconds a sign"
        )
    return seconds


@dataclass(frozen=True)
class ReachedTempo:
    """The tempo of a sentence.

    mode: "citation", "natural", or "seconds" where they were given.
    asked_seconds: seconds that a sign was to take with its transition; None for "citation".
    seconds: seconds that a sign takes with the transition to it, the mean of all signs but letters, the first and the
        last, which begin and end at rest; None where there is no other.
    """

    mode: Literal["citation", "natural", "seconds"] = "citation"
    asked_seconds: float | None = None
    seconds: float | None = None


def measured_tempo(signs: Sequence[tuple[str, tuple[int, int]]], fps: float, tempo: str | float) -> ReachedTempo:
    """The tempo of a sentence whose ``signs`` have these names and output frames, half-open, in order."""
    asked = seconds_a_sign(tempo)
    mode: Literal["citation", "natural", "seconds"] = "seconds"
    if asked is None:
        mode = "citation"
    elif tempo == NATURAL:
        mode = "natural"
    inner = list(pairwise(signs))[:-1]
    frames = [after[1] - before[1] for (_, before), (name, after) in inner if not is_letter(name)]
    seconds = round(float(np.mean(frames)) / fps, 3) if frames else None
    return ReachedTempo(mode, asked, seconds)
