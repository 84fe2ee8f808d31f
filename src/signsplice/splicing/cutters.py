"""Rule-based cutters: they choose the frames at which the sign before is left and the sign after is entered.

Rules search the inner ends of the two clips' active spans (arms away from rest): the last 0.3 s of the first clip and
the first 0.3 s of the second, each at most 30 % of its span. Over whole clips the closest pair would be two rest
frames, and the arms would drop between the words.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from signsplice.motion import Clip, FloatArray
from signsplice.rig.info import Arms, active_span, arms
from signsplice.splicing.contracts import Cut, Cutter

WINDOW_S = 0.3
"""Longest search window, s."""
WINDOW_FRACTION = 0.3
"""Largest fraction of an active span that is searched."""
VELOCITY_TIME_S = 0.15
"""Velocities count as the distance covered in this time, s: half of a usual transition."""


@dataclass(frozen=True)
class RuleCutter(Cutter):
    """A cutter that follows a rule: (before, after) -> splice position."""

    name: str
    summary: str
    rule: Callable[[Clip, Clip], Cut]

    own_rate: ClassVar[bool] = True

    def cut(self, before: Clip, after: Clip) -> Cut:
        """Returns the splice position of two aligned clips."""
        return self.rule(before, after)


def _ends(before: Clip, after: Clip) -> Cut:
    return Cut(len(before) - 1, 0)


def _rest_trim(before: Clip, after: Clip) -> Cut:
    return Cut(active_span(arms(before))[1] - 1, active_span(arms(after))[0])


def _hand_distance(before: Clip, after: Clip) -> Cut:
    """Minimises the distance (shoulder widths) plus the angle (half turns) between frames, summed over both hands."""

    def cost(p: Arms, q: Arms, rows: slice, columns: slice) -> FloatArray:
        step = p.wrists[rows, None] - q.wrists[None, columns]  # (P, Q, 2, 3)
        distance = np.sqrt(np.einsum("ijhc,ijhc->ijh", step, step)) / p.shoulder_width
        cosine = np.einsum("ihab,jhab->ijh", p.hand_rotations[rows], q.hand_rotations[columns])
        angle = np.arccos(np.clip(0.5 * (cosine - 1.0), -1.0, 1.0)) / np.pi
        return np.asarray((distance + angle).sum(axis=-1))

    return _lowest_cost(before, after, cost)


def _pose_velocity(before: Clip, after: Clip) -> Cut:
    """Minimises the squared change of position and of velocity (over 0.15 s) of elbows and wrists."""

    def cost(p: Arms, q: Arms, rows: slice, columns: slice) -> FloatArray:
        a, b = _pose_and_velocity(p, rows), _pose_and_velocity(q, columns)
        squares = (a**2).sum(1)[:, None] + (b**2).sum(1)[None] - 2.0 * a @ b.T
        return np.asarray(squares)

    return _lowest_cost(before, after, cost)


def _pose_and_velocity(arms: Arms, frames: slice) -> FloatArray:
    """Returns positions of elbows and wrists in some frames, and the distances that they cover in 0.15 s by central
    differences: (n, 24), arm lengths.
    """
    indices = np.arange(frames.start, frames.stop)
    last = np.minimum(indices + 1, len(arms.wrists) - 1)
    first = np.maximum(indices - 1, 0)
    per_step = VELOCITY_TIME_S * arms.fps / np.maximum(last - first, 1)
    points = [part.reshape(len(part), 6) for part in (arms.elbows, arms.wrists)]
    steps = [(part[last] - part[first]) * per_step[:, None] for part in points]
    return np.concatenate([part[indices] for part in points] + steps, axis=1) / arms.length


def _lowest_cost(before: Clip, after: Clip, cost: Callable[[Arms, Arms, slice, slice], FloatArray]) -> Cut:
    p, q = arms(before), arms(after)
    (p_start, p_stop), (q_start, q_stop) = active_span(p), active_span(q)
    rows = slice(p_stop - search_window(p_stop - p_start, before.fps), p_stop)
    columns = slice(q_start, q_start + search_window(q_stop - q_start, after.fps))
    costs = cost(p, q, rows, columns)
    i, j = np.unravel_index(int(np.argmin(costs)), costs.shape)
    return Cut(rows.start + int(i), columns.start + int(j))


def search_window(n_frames: int, fps: float) -> int:
    """Returns the number of frames of an active span that are searched, at least one."""
    return max(1, int(min(WINDOW_S * fps, WINDOW_FRACTION * n_frames)))


CUTTERS: dict[str, Cutter] = {
    cutter.name: cutter
    for cutter in (
        RuleCutter("ends", "no search: the last frame of one clip, the first of the next", _ends),
        RuleCutter("rest-trim", "where the arms leave and reach rest (40 % of their rise)", _rest_trim),
        RuleCutter("hand-distance", "least hand distance plus hand angle (Zhu 2014, Chen 2017)", _hand_distance),
        RuleCutter("pose-velocity", "least change of arm position and velocity (Zhao 2008)", _pose_velocity),
    )
}
CLASSICAL_CUTTER = "pose-velocity"
"""Used if no network can be read; the default is learned (``options.choose``)."""
