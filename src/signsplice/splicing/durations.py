"""Rules for the duration of a transition, and the tempos that a call may choose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, at_frames, batch_clips
from signsplice.rig.info import Arms, arms
from signsplice.splicing.contracts import Cut, Duration


@dataclass(frozen=True)
class HumanTiming:
    """Durations and speeds of people's signs and transitions.

    The durations are those of motion capture of Czech Sign Language, measured by ``measure.lengths`` of the workshop.
    """

    median_transition_s: float = 0.25
    """Median of 621 annotated transitions between two signs, s (5 and 95 %: 0.16 and 0.48 s)."""
    sign_fraction: float = 0.62
    """Duration of a sign in running signing over its duration alone: median of 151 glosses."""
    mean_sign_s: float = 0.44
    """Mean duration of a sign in running signing, s (917 signs)."""
    still_transition_s: float = 0.10
    """Duration of a transition without travel, s, fitted with ``doubling_s`` to the distances at the default cutter's
    cuts and the durations of the transitions.
    """
    doubling_s: float = 0.20
    """Additional duration for each doubling of one shoulder width plus the travel, s."""
    largest_speed_m_s: float = 2.5
    """Largest wrist speed of signs, m/s: peaks of isolated words reach 1.7 to 2.5 m/s."""
    peak_over_mean: float = 1.875
    """Peak speed over mean speed of a minimum-jerk movement from rest to rest."""


HUMAN = HumanTiming()

CITATION = "citation"
"""Tempo of signs as recorded."""
NATURAL = "natural"
"""Tempo of running signing."""
RUNNING_S = 0.70
"""Time that a sign takes in running signing, s, including the transition to it."""
FASTEST_S = 0.4
"""Fastest tempo, seconds a sign."""
SLOWEST_S = 1.5
"""Slowest tempo, seconds a sign."""
MAX_TRANSITION_S = 10.0
"""Longest transition, s, whatever asks for it."""


def seconds_a_sign(tempo: str | float) -> float | None:
    """Returns the seconds that a sign takes with its transition at a tempo ("natural", or the seconds themselves); None
    for "citation". Raises ``InputError`` for any other tempo.
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
    """Returns the seconds that a sign takes at a tempo, from the seconds that it takes alone: proportional, but at most
    the mean. Dictionaries show signs so slowly that longer durations carry little information.
    """
    return min(HUMAN.sign_fraction * alone_s, HUMAN.mean_sign_s) * seconds_a_sign / RUNNING_S


def most_frames(fps: float) -> int:
    """Returns the number of frames of the longest transition."""
    return round(MAX_TRANSITION_S * fps)


def travel_widths(before: Arms, after: Arms, pre: int, post: int) -> float:
    """Returns the distance of the hand with the longer path, in shoulder widths."""
    distances = np.linalg.norm(after.wrists[post] - before.wrists[pre], axis=-1)
    return float(distances.max() / before.shoulder_width)


class TravelDuration(Duration):
    """The human duration for the distance of the hand that moves farther, proportionally longer at tempos slower than
    running signing, and at least the human median. Longer if that hand would exceed ``HUMAN.largest_speed_m_s``.

    seconds_a_sign: the tempo, by default that of signs as recorded: they last 1 / ``HUMAN.sign_fraction`` of their time
        in running signing, and a transition at that tempo is as smooth as they are.

    Deaf viewers of avatars prefer transitions slower than human ones (Al-khazraji et al. 2021), so none is shorter than
    the human median.
    """

    name = "tempo"
    summary = "160 + 320 log2(1 + D) ms for D shoulder widths (Czech Sign Language), at least 0.25 s"

    def __init__(self, seconds_a_sign: float = RUNNING_S / HUMAN.sign_fraction) -> None:
        self.slowness = max(1.0, seconds_a_sign / RUNNING_S)

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take."""
        ends = [[at_frames(clip, slice(n, n + 1))] for clip, n in ((before, cut.pre), (after, cut.post))]
        seen = [arms(block.clip) for block in batch_clips(ends)]  # two only of different skeletons
        widths, body = travel_widths(seen[0], seen[-1], 0, -1), seen[0]
        mean_m_s = HUMAN.largest_speed_m_s / HUMAN.peak_over_mean
        least = widths * body.shoulder_width * body.metres / mean_m_s - 1.0 / before.fps
        people_s = HUMAN.still_transition_s + HUMAN.doubling_s * float(np.log2(1.0 + widths))
        return max(self.slowness * people_s, HUMAN.median_transition_s, least)


class FixedDuration(Duration):
    """The human median, whatever the distance."""

    name = "fixed"
    summary = "always the human median, 0.25 s"

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take."""
        return HUMAN.median_transition_s


DURATIONS: dict[str, Duration] = {duration.name: duration for duration in (TravelDuration(), FixedDuration())}
DEFAULT_DURATION = "tempo"
