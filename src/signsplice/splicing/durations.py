"""How long a transition takes, by rule, and the tempos that a call may ask for."""

from __future__ import annotations

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip
from signsplice.rig.info import Arms, arms
from signsplice.splicing.contracts import Cut, Duration

CITATION, NATURAL = "citation", "natural"
RUNNING_S = 0.70
"""Seconds a sign takes in running signing, the transition to it included."""
FASTEST_S, SLOWEST_S = 0.4, 1.5
FAST_M_S = 2.5
"""Peaks of isolated words reach 1.7 to 2.5 m/s; a transition beyond that is faster than any sign."""
HUMAN_MEDIAN_S = 0.25
"""Median of 621 transitions between two signs, annotated in motion capture of Czech Sign Language (5 and 95 %: 0.16 and
0.48 s).
"""

SIGN_FRACTION, MEAN_SIGN_S = 0.62, 0.44
"""How long a sign lasts in running signing over how long it lasts alone (median of 151 glosses of Czech Sign Language),
and seconds that it lasts there on average (917 signs). Both are what ``measure.lengths`` of the workshop finds.
"""
TRAVEL_S, DOUBLING_S = 0.10, 0.20
"""Seconds of a transition without travel, and more for each doubling of one shoulder width plus the travel: what gives
the distances at the default cutter's cuts the times of Czech transitions (the same).
"""
MAX_TRANSITION_S = 10.0
"""The longest transition, whatever asks for it."""
_PEAK_OVER_MEAN = 1.875
"""Of a minimum-jerk movement from rest to rest."""


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


def running_sign_s(alone_s: float, seconds_a_sign: float = RUNNING_S) -> float:
    """Seconds that a sign takes at a tempo, from the seconds that it takes alone. Signs differ in length as they do
    alone, but none aims at more than the mean: dictionaries show signs so slowly that length says little beyond it.
    """
    return min(SIGN_FRACTION * alone_s, MEAN_SIGN_S) * seconds_a_sign / RUNNING_S


def most_frames(fps: float) -> int:
    """The number of frames of the longest transition."""
    return round(MAX_TRANSITION_S * fps)


def travel_widths(before: Arms, after: Arms, pre: int, post: int) -> float:
    """Distance that the hand with the longer path has to go, in shoulder widths."""
    distances = np.linalg.norm(after.wrists[post] - before.wrists[pre], axis=-1)
    return float(distances.max() / before.shoulder_width)


class TravelDuration(Duration):
    """People's time for the distance of the hand that goes farther, in proportion more at tempos slower than running
    signing, and at least their median. Longer where that hand would pass ``FAST_M_S``.

    seconds_a_sign: the tempo, by default that of signs as recorded: they last 1 / ``SIGN_FRACTION`` of their time in
        running signing, and a transition at that tempo is beside them as smooth as they are.

    Deaf viewers of avatars prefer transitions slower than human ones (Al-khazraji et al. 2021), so none is shorter than
    the human median.
    """

    name = "tempo"
    summary = "160 + 320 log2(1 + D) ms for D shoulder widths (Czech Sign Language), at least 0.25 s"

    def __init__(self, seconds_a_sign: float = RUNNING_S / SIGN_FRACTION) -> None:
        self.slowness = max(1.0, seconds_a_sign / RUNNING_S)

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take."""
        body = arms(before)
        widths = travel_widths(body, arms(after), cut.pre, cut.post)
        mean_m_s = FAST_M_S / _PEAK_OVER_MEAN
        least = widths * body.shoulder_width * body.metres / mean_m_s - 1.0 / before.fps
        people_s = TRAVEL_S + DOUBLING_S * float(np.log2(1.0 + widths))
        return max(self.slowness * people_s, HUMAN_MEDIAN_S, least)


class FixedDuration(Duration):
    """The human median, whatever the distance."""

    name = "fixed"
    summary = "always the human median, 0.25 s"

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take."""
        return HUMAN_MEDIAN_S


DURATIONS: dict[str, Duration] = {duration.name: duration for duration in (TravelDuration(), FixedDuration())}
DEFAULT_DURATION = "tempo"
