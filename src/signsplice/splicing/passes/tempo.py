"""Signs brought to the tempo of running signing: each is played through a monotone warp of its own time.

Dictionary forms are signed slowly, with holds. The warp changes when each posture comes and no posture itself: paths,
repetitions and contacts stay. It depends on the sign alone, so that a stream can send a sign's frames before it knows
where the sign will be left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.interpolate import PchipInterpolator

from signsplice.errors import InputError
from signsplice.lexicon.entry import is_letter
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip, concatenate, sampled
from signsplice.rig import metrics
from signsplice.rig.arms import active_span, arms
from signsplice.rig.info import rig_info
from signsplice.splicing.gap import Gap
from signsplice.splicing.methods.cut import Cut, Cutter, cut_clips
from signsplice.splicing.methods.duration import HUMAN_MEDIAN_S, Duration, most_frames
from signsplice.splicing.methods.transition import Transition
from signsplice.splicing.passes.filling import FilledGap, fill
from signsplice.splicing.passes.free_hand import with_peaks
from signsplice.splicing.passes.pace import pace
from signsplice.splicing.seam import FAST_M_S

CITATION, NATURAL = "citation", "natural"
RUNNING_S = 0.70
"""Seconds a sign takes in running signing, the transition to it included."""
FASTEST_S, SLOWEST_S = 0.4, 1.5
SIGN_FRACTION = 0.4
"""How much of that time a sign aims at between the frames that two neighbours like itself would leave of it. The rest
goes to transitions, to what other neighbours leave beyond that, and to signs that people cannot sign so fast: chosen on
words kept apart, so that all together take the time that was asked for.
"""
_PEAK_OVER_MEAN = 1.875
"""Of a minimum-jerk movement from rest to rest."""
_LONGER = (1.25, 1.5, 2.0)
"""Lengths that are tried for a transition, over the first one."""
_DECIMALS = 4


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


def reached(signs: Sequence[tuple[str, tuple[int, int]]], fps: float, tempo: str | float) -> ReachedTempo:
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


@dataclass(frozen=True, eq=False)
class Played:
    """A sign as it is played.

    clip: the frames.
    sources: (T,) the frame of the recorded clip that each shows, rising; between two frames it is their slerp. None
        where all are played as recorded.
    n_left_out: how many frames of the whole clip come before the recorded one.
    warnings: what a user should know, one line each.
    """

    clip: Clip
    sources: FloatArray | None = None
    n_left_out: int = 0
    warnings: tuple[str, ...] = ()

    def first(self, frame: int) -> int:
        """The frame with which to begin so that the recorded ``frame`` and all after it are played."""
        return frame if self.sources is None else int(np.searchsorted(self.sources, frame, side="right")) - 1

    def last(self, frame: int) -> int:
        """The frame with which to end so that the recorded ``frame`` and all before it are played."""
        return frame if self.sources is None else int(np.searchsorted(self.sources, frame, side="left"))

    def cut(self, cut: Cut, after: Played) -> Cut:
        """A cut of the recorded clips, this and the one ``after``, in frames as they are played."""
        return Cut(self.last(cut.pre), after.first(cut.post))

    def source(self, start: int, stop: int) -> tuple[int, int]:
        """The recorded frames from which the frames [start, stop) are made, half-open."""
        if self.sources is None:
            return start, stop
        return int(np.floor(self.sources[start])), int(np.ceil(self.sources[stop - 1])) + 1

    def warp(self, start: int, stop: int, output: int) -> tuple[tuple[int, float], ...] | None:
        """For each of the frames [start, stop), the first of which is frame ``output`` of a sentence, that frame and
        the one of the whole clip that it shows.
        """
        if self.sources is None:
            return None
        whole = self.sources[start:stop] + self.n_left_out  # exact, see ``play``
        return tuple((output + n, float(source)) for n, source in enumerate(whole))


def play(clip: Clip, cutter: Cutter, seconds: float, n_left_out: int = 0) -> Played:
    """An aligned clip brought to a tempo of ``seconds`` a sign, as far as human peaks allow; as recorded where the sign
    is no longer than that, or the rig's arms are not known by name.

    What counts as the sign is what the cutter keeps of it between two signs like itself. ``n_left_out``: frames of the
    whole clip that come before this one.
    """
    if not rig_info(clip.skeleton).has_arms:
        return Played(clip, warnings=(f"no arms known in {clip.name}: it is played as recorded, whatever the tempo",))
    if len(clip) < 2:
        return Played(clip)
    first, last = _sign(clip, cutter)
    limits = pace(clip)
    rates = limits.rates(first, last, SIGN_FRACTION * seconds - 1.0 / clip.fps)
    if np.all(rates == 1.0):
        return Played(clip)
    # Rounded as they count in the whole clip: sampling that at a warp's frames gives the same fractions, bit for bit.
    sources = np.round(_source_frames(rates) + n_left_out, _DECIMALS) - n_left_out
    return Played(sampled(clip, sources), sources, n_left_out)


def _sign(clip: Clip, cutter: Cutter) -> tuple[int, int]:
    """First and last frame of the sign in a clip: as the cutter cuts it, at most while the arms are away from rest."""
    (cut,) = cut_clips(cutter, [clip, clip])
    start, stop = active_span(arms(clip))
    first, last = max(cut.post, start), min(cut.pre, stop - 1)
    return (first, last) if first < last else (start, stop - 1)


def _source_frames(rates: FloatArray) -> FloatArray:
    """The recorded frame that each played one shows, from the rate at each recorded frame (T,). The first and the last
    frame are played as they are: the whole is slower by less than a frame for that.
    """
    slowness = 1.0 / rates
    times = np.r_[0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))]  # played frames
    n_frames = int(np.ceil(times[-1] - 1e-9))
    times *= n_frames / times[-1]
    sources = PchipInterpolator(times, np.arange(len(rates), dtype=np.float64))(np.arange(n_frames + 1))
    sources = np.round(sources, _DECIMALS)
    sources[0], sources[-1] = 0.0, len(rates) - 1.0
    return np.asarray(sources)


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


@dataclass(frozen=True)
class GapFiller:
    """How the gaps of a sentence are filled; sentences with equal fillers may have theirs filled together.

    transition, avoid_collisions: as in ``SpliceOptions``.
    is_running: whether gaps get more frames where a hand would be faster than signs are.
    measures: whether the wrists' speed will be asked for.
    """

    transition: Transition
    avoid_collisions: bool | None
    is_running: bool
    measures: bool

    def fill(self, gaps: Sequence[Gap]) -> list[FilledGap]:
        """The new frames of every gap."""
        fill_all = fill_unhurried if self.is_running else fill
        filled = fill_all(self.transition, gaps, self.avoid_collisions)
        return with_peaks(filled, gaps) if self.measures else filled


def fill_unhurried(transition: Transition, gaps: Sequence[Gap], avoid_collisions: bool | None) -> list[FilledGap]:
    """As ``filling.fill``, with more frames in the gaps in which a hand would be faster than signs are."""
    return [
        _unhurried(transition, gap, made, avoid_collisions)
        for gap, made in zip(gaps, fill(transition, gaps, avoid_collisions), strict=True)
    ]


def _unhurried(transition: Transition, gap: Gap, made: FilledGap, avoid_collisions: bool | None) -> FilledGap:
    for factor in _LONGER:
        n_frames = min(math.ceil(factor * gap.n_frames), most_frames(gap.before.fps))
        if n_frames <= len(made.clip) or not _is_too_fast(gap, made.clip):
            break
        (made,) = fill(transition, [replace(gap, n_frames=n_frames)], avoid_collisions)
    return made


def _is_too_fast(gap: Gap, new: Clip) -> bool:
    """Whether a wrist passes ``FAST_M_S`` in the new frames of a gap."""
    info = rig_info(new.skeleton)
    if not info.has_arms:
        return False
    window = concatenate([gap.before[-1:], new, gap.after[:1]])
    wrists = arms(window).wrists * info.sizes.unit.metres
    return metrics.peak_speed(wrists, 1, len(window) - 1, window.fps) > FAST_M_S
