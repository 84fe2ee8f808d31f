"""Turns of elbows about the line from shoulder to wrist, so that forearms keep out of the trunk.

A Viterbi search (1967) chooses the swivels of all frames of an arm together: little depth beyond the source's, little
turning, and smooth changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.collision import clearances
from signsplice.motion import FloatArray

_GRID = np.deg2rad(np.arange(-60.0, 61.0, 15.0))
"""Turns to choose from, radians."""
_TURN = float(np.deg2rad(30.0))
"""The turn that costs ``_TURN_WEIGHT``, radians."""
_TURN_WEIGHT = 0.15
"""Cost of a turn, in squared centimetres of depth."""
_CHANGE_WEIGHT = 0.5
"""Cost of a change by half of ``_TURN`` from frame to frame, likewise."""
_WIDTH_S = 0.06
"""Standard deviation of the bell that smooths the chosen swivels, s."""
_LEAST_WIDTH = 0.5
"""Least standard deviation of that bell, frames."""
_DEEP = 1e-4
"""Squared depth from which on an elbow turns, cm^2."""
_AROUND_S = 0.3
"""Time before the first and after the last such frame in which the elbow may turn, s."""


@dataclass(frozen=True, eq=False)
class BentArm:
    """An arm over time, m.

    shoulder, elbow, wrist: (T, 3).
    radii: (2,) of the forearm at elbow and wrist.
    """

    shoulder: FloatArray
    elbow: FloatArray
    wrist: FloatArray
    radii: FloatArray


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Capsules that the forearm must keep out of, m: starts and ends (T, S, 3), radii (S, 2)."""

    starts: FloatArray
    ends: FloatArray
    radii: FloatArray


def choose(arm: BentArm, obstacles: Obstacles, allowed: FloatArray, fps: float, grid: FloatArray = _GRID) -> FloatArray:
    """Returns turns (T,) of the elbow, radians, right-handed about the line from shoulder to wrist: the best of
    ``grid``, smoothed. They lessen the forearm's depth in any capsule beyond ``allowed`` (T, S), m; some may remain.
    """
    cost = _depth_cost(arm.elbow[None], arm, obstacles, allowed, slice(None))[0]
    deep_frames = np.flatnonzero(cost > _DEEP)
    swivels = np.zeros(len(arm.wrist))
    if not len(deep_frames):
        return swivels
    n_around = int(np.ceil(_AROUND_S * fps))
    span = slice(max(deep_frames[0] - n_around, 0), deep_frames[-1] + n_around + 1)
    s, e, w = arm.shoulder[span], arm.elbow[span], arm.wrist[span]
    axis = (w - s) / (np.linalg.norm(w - s, axis=-1, keepdims=True) + 1e-9)
    on_axis = np.einsum("tx,tx->t", e - s, axis)[:, None] * axis
    off_axis = e - s - on_axis
    cos, sin = np.cos(grid)[:, None, None], np.sin(grid)[:, None, None]
    turned = s + on_axis + cos * off_axis + sin * np.cross(axis, off_axis)  # (K, T, 3)
    costs = _depth_cost(turned, arm, obstacles, allowed, span).T
    costs += _TURN_WEIGHT * (grid / _TURN) ** 2
    change: FloatArray = _CHANGE_WEIGHT * np.square((grid[:, None] - grid) / (0.5 * _TURN))
    chosen = grid[least_cost_choices(costs, [change] * (len(costs) - 1))]
    width = max(_WIDTH_S * fps, _LEAST_WIDTH)
    half_width = int(np.ceil(3.0 * width))
    bell = np.exp(-0.5 * (np.arange(-half_width, half_width + 1) / width) ** 2)
    padded = np.pad(chosen, half_width, mode="edge")
    swivels[span] = np.convolve(padded, bell / bell.sum(), mode="valid")
    return swivels


def _depth_cost(elbow: FloatArray, arm: BentArm, obstacles: Obstacles, allowed: FloatArray, span: slice) -> FloatArray:
    """Returns the squared depth (K, T) of the forearm beyond the allowed one, summed over the capsules, cm^2, for
    elbows (K, T, 3) in a span of frames.
    """
    starts, ends, allowed = obstacles.starts[span], obstacles.ends[span], allowed[span]
    shape = (*elbow.shape[:2], allowed.shape[1])
    p, u = (np.broadcast_to(x[:, :, None], (*shape, 3)).reshape(-1, 3) for x in (elbow, arm.wrist[span] - elbow))
    q, v = (np.broadcast_to(x, (*shape, 3)).reshape(-1, 3) for x in (starts, ends - starts))
    own_radii, other_radii = (np.broadcast_to(x, (*shape, 2)).reshape(-1, 2) for x in (arm.radii, obstacles.radii))
    depth = np.maximum(-clearances(p - q, u, v, own_radii, other_radii).distance.reshape(shape) - allowed, 0.0)
    return np.asarray((1e4 * depth * depth).sum(axis=-1))


def least_cost_choices(costs: FloatArray, changes: Sequence[FloatArray] | FloatArray) -> NDArray[np.intp]:
    """Returns the choices (T,) with the least sum of costs (T, K) and costs of change (T - 1, K, K)."""
    best, back = costs[0], []
    for row, change in zip(costs[1:], changes, strict=True):
        total = best[:, None] + change
        back.append(total.argmin(axis=0))
        best = total.min(axis=0) + row
    chosen = [int(best.argmin())]
    for came in reversed(back):
        chosen.append(int(came[chosen[-1]]))
    return np.array(chosen[::-1])
