"""How long a transition takes, by rule, and the tempos that a call may ask for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip
from signsplice.rig.info import Arms, active_span, arms
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

USUAL_SPEED_M_S = 0.45
"""Mean wrist speed in continuous signing (0.42 to 0.47 m/s)."""

MAX_TRANSITION_S = 10.0
"""The longest transition, whatever asks for it."""
_SLOWEST_S = 1.5
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


def most_frames(fps: float) -> int:
    """The number of frames of the longest transition."""
    return round(MAX_TRANSITION_S * fps)


@dataclass(frozen=True)
class RuleDuration(Duration):
    """A duration that follows a rule: (arms before, arms after, last frame kept, first frame kept) -> seconds."""

    name: str
    summary: str
    rule: Callable[[Arms, Arms, int, int], float]

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take."""
        return self.rule(arms(before), arms(after), cut.pre, cut.post)


def travel_widths(before: Arms, after: Arms, pre: int, post: int) -> float:
    """Distance that the hand with the longer path has to go, in shoulder widths."""
    distances = np.linalg.norm(after.wrists[post] - before.wrists[pre], axis=-1)
    return float(distances.max() / before.shoulder_width)


def _fixed(before: Arms, after: Arms, pre: int, post: int) -> float:
    return HUMAN_MEDIAN_S


def travel_law(widths: float) -> float:
    """Seconds that people take over a distance of D shoulder widths: 51 + 149 log2(1 + D / 0.15) ms, fitted to 124 gaps
    of the DGS Corpus (r2 0.48).
    """
    return 0.051 + 0.149 * float(np.log2(1.0 + widths / 0.15))


def _travel(before: Arms, after: Arms, pre: int, post: int) -> float:
    return travel_law(travel_widths(before, after, pre, post))


def _speed(before: Arms, after: Arms, pre: int, post: int) -> float:
    """Distance over the mean of the two boundary speeds, of the hand with the longer path; at least one frame."""
    distances = np.linalg.norm(after.wrists[post] - before.wrists[pre], axis=-1)
    hand = int(np.argmax(distances))
    speeds = []
    for own, frame, step in ((before, pre, -1), (after, post, 1)):
        other = min(max(frame + step, 0), len(own.wrists) - 1)
        speeds.append(np.linalg.norm(own.wrists[other, hand] - own.wrists[frame, hand]) * own.fps)
    mean = float(np.mean(speeds))
    return float(np.clip(distances[hand] / mean, 1.0 / before.fps, _SLOWEST_S)) if mean > 0.0 else _SLOWEST_S


def _tempo(before: Arms, after: Arms, pre: int, post: int) -> float:
    """The travel law, times the signer's tempo (the root of usual over own wrist speed, 0.7 to 1.4), at least 0.25 s.

    Deaf viewers of avatars prefer transitions slower than human ones (Al-khazraji et al. 2021), so the human median is
    the floor. The root: half of what the signer differs from others is taken to show in transitions too; a guess, not a
    measurement.
    """
    tempo = np.sqrt(USUAL_SPEED_M_S / max(0.5 * (_wrist_speed(before) + _wrist_speed(after)), 1e-3))
    return max(HUMAN_MEDIAN_S, _travel(before, after, pre, post) * float(np.clip(tempo, 0.7, 1.4)))


def _wrist_speed(arms: Arms) -> float:
    """Mean speed (m/s) of the faster wrist while the arms are away from rest."""
    start, stop = active_span(arms)
    steps = np.linalg.norm(np.diff(arms.wrists[start:stop], axis=0), axis=-1)
    return float(steps.mean(axis=0).max() * arms.fps * arms.metres) if len(steps) else USUAL_SPEED_M_S


class RunningDuration(Duration):
    """How long a transition takes at a tempo: the human median of 0.25 s, in proportion where the tempo is slower than
    running signing, and longer where a hand would pass ``FAST_M_S``.
    """

    name = "running"
    summary = "0.25 s, longer where a hand has far to go"

    def __init__(self, seconds: float) -> None:
        self.least = HUMAN_MEDIAN_S * max(1.0, seconds / RUNNING_S)

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take."""
        p, q = arms(before), arms(after)
        travel = float(np.linalg.norm(q.wrists[cut.post] - p.wrists[cut.pre], axis=-1).max()) * p.metres
        return max(self.least, _PEAK_OVER_MEAN * travel / FAST_M_S - 1.0 / before.fps)


DURATIONS: dict[str, Duration] = {
    duration.name: duration
    for duration in (
        RuleDuration("tempo", "the hand's travel and the signer's tempo, at least the human median of 0.25 s", _tempo),
        RuleDuration("fixed", "always the human median, 0.25 s", _fixed),
        RuleDuration("travel", "51 + 149 log2(1 + D / 0.15) ms for D shoulder widths (DGS Corpus)", _travel),
        RuleDuration("speed", "distance over boundary speed", _speed),
    )
}
DEFAULT_DURATION = "tempo"
