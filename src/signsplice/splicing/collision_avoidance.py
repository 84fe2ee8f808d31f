"""Body sense: no hand goes through head, trunk or the other hand between two signs.

The body is the capsules of ``motion.body``. Where a transition would lead a hand into it, the wrist is led around:
pushed out along one way for each stretch of frames that would lie inside, the pushes spread smoothly over the
neighbouring frames and fading to nothing, with their slope, at both signs. The frames of the signs are never touched.
A sign may itself press a hand into the capsules (a chin that is touched is not where ours is): a transition may then
be as deep as a straight line between its two ends is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body import arm_ik, collision, smoothing
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton, concatenate
from signsplice.rig import proportions
from signsplice.rig.arms import arm_joints, has_arms

Float = NDArray[np.float64]

TOLERANCE_M = 0.003
"""Touching may press this deep."""
_ROUNDS = 30
"""Pushes, at most, until a way around is found."""
_SLACK_M = 0.03
"""How much farther hands may go before what is near them is looked for anew."""
_TRIES = 10
"""Ways around that are tried: an arm may be too short for the first."""
_WORTH = 0.05
"""Share of the depth that is left by which a try has to lessen it, for another to follow."""
_SOFTEST = 0.35
"""Least cosine between a stretch's one way out and that of a frame by which a push is lengthened."""


@dataclass(frozen=True, eq=False)
class ClearedTransition:
    """A transition that leads around the body. depth_before and depth: how deep a hand lies in it, m, at the worst
    frame, as it came and as it is, beyond what its two ends call for; 0 where no hand does, None on a rig whose arms
    are not known.
    """

    clip: Clip
    depth_before: float | None
    depth: float | None


def avoid_collisions(filled: Clip, before: Clip, after: Clip) -> ClearedTransition:
    """A transition between the last frame of ``before`` and the first of ``after``, led around the body.

    On a rig whose arms are not known by name it comes back as it is.
    """
    if not has_arms(filled.skeleton):
        return ClearedTransition(filled, None, None)
    return _lead_around(filled, before, after, _posed_window(_window(filled, before, after)))


@dataclass(frozen=True, eq=False)
class _PosedWindow:
    """What is seen of a window: where its joints are (T, J, 3), and its body's capsules."""

    skeleton: Skeleton
    places: Float
    capsules: collision.PosedCapsules

    def __getitem__(self, frames: slice) -> _PosedWindow:
        return _PosedWindow(self.skeleton, self.places[frames], self.capsules[frames])

    @property
    def ahead(self) -> Float:
        """The way ahead of the chest (T, 3): at right angles to the shoulders and the trunk."""
        known = arm_joints(self.skeleton)
        left, right, hips = (self.places[:, known[k]] for k in (0, 3, 6))
        ahead = rotation.cross(left - right, left + right - 2.0 * hips)
        return np.asarray(ahead / (np.linalg.norm(ahead, axis=-1, keepdims=True) + 1e-12))


def _window(filled: Clip, before: Clip, after: Clip) -> Clip:
    return concatenate([before[-1:], filled, after[:1]])


def _posed_window(window: Clip) -> _PosedWindow:
    turns, places = kinematics.forward(window)
    return _PosedWindow(window.skeleton, places, collision.posed_capsules(window.skeleton, turns, places))


def _lead_around(filled: Clip, before: Clip, after: Clip, seen: _PosedWindow) -> ClearedTransition:
    """``avoid_collisions`` of a transition that was looked at."""
    metres = proportions.sizes(filled.skeleton).unit.metres
    best, first, least = filled, 0.0, np.inf
    for n in range(_TRIES + 1):
        if n > 0:
            seen = _posed_window(_window(filled, before, after))
        near = seen.capsules.near(_SLACK_M / metres)
        worst = _worst(near.pressed()[0] * metres)
        if n == 0:
            first = worst
        gained = least - worst
        if gained > 0.0:
            best, least = filled, worst
        if worst == 0.0 or gained < _WORTH * worst or n == _TRIES:
            break
        filled = arm_ik.move_wrists(filled, _avoiding_moves(seen, near, metres))
    return ClearedTransition(best, first, least)


def avoid_all_collisions(gaps: Sequence[tuple[Clip, Clip, Clip]]) -> list[ClearedTransition]:
    """``avoid_collisions`` of transitions on one skeleton, each with the signs before and after it. All are looked at in one go;
    most have nothing to be led around.
    """
    if not gaps or not has_arms(gaps[0][0].skeleton):
        return [ClearedTransition(filled, None, None) for filled, _, _ in gaps]
    windows = [_window(*gap) for gap in gaps]
    seen = _posed_window(concatenate(windows))
    depth = seen.capsules.pressed()[0] * proportions.sizes(windows[0].skeleton).unit.metres
    ends = np.cumsum([0, *(len(window) for window in windows)])
    told = []
    for gap, start, stop in zip(gaps, ends[:-1], ends[1:], strict=True):
        deep = _worst(depth[start:stop]) > 0.0
        told.append(_lead_around(*gap, seen[start:stop]) if deep else ClearedTransition(gap[0], 0.0, 0.0))
    return told


def _avoiding_moves(seen: _PosedWindow, near: collision.NearPairs, metres: float) -> Float:
    """Moves (n, 2, 3) of the hands, were arms long enough, that lead the frames between around what they lie in;
    ``near``: what lies within ``_SLACK_M`` of them.
    """
    n_between, ahead = len(seen.places) - 2, seen.ahead
    level, kernel = smoothing.fade_window(n_between)[:, None, None], _kernel(n_between)
    moves, slack = np.zeros((n_between + 2, 2, 3)), _SLACK_M / metres
    for _ in range(_ROUNDS):
        farthest = 2.0 * float(np.linalg.norm(moves, axis=-1).max())  # of two hands apart
        if farthest > slack:
            slack = farthest + _SLACK_M / metres
            near = seen.capsules.near(slack)
        depth, way = near.pressed(moves)
        over = _excess_depth(depth * metres) / metres
        if over.max() <= 0.0:
            break
        push = _pushes(over + 0.3 * TOLERANCE_M / metres, way[1:-1], ahead[1:-1])
        moves[1:-1] += smoothing.spread_in_time(push, kernel) * level
    return moves[1:-1]


def depths(filled: Clip, before: Clip, after: Clip) -> Float:
    """How deep (n,) a hand lies in the body, m, in each frame of a transition, beyond what both ends call for, 0 where
    none does. Raises ``InputError`` where the rig's arms are not known by name.
    """
    depth, _ = _posed_window(_window(filled, before, after)).capsules.pressed()
    return _total_depth(_excess_depth(depth * proportions.sizes(filled.skeleton).unit.metres).max(axis=1))


def _worst(depth: Float) -> float:
    """The deepest of the frames between, m, beyond what both ends call for, from depths (n + 2, 2), m."""
    return float(_total_depth(_excess_depth(depth).max()))


def _excess_depth(depth: Float) -> Float:
    """How much deeper (n, 2) than they may lie the frames between lie, m, from the depths (n + 2, 2) with those of both
    ends: of each hand, whatever it lies in.
    """
    share = np.linspace(0.0, 1.0, len(depth))[1:-1, None]
    ends = np.maximum(depth[[0, -1]] - TOLERANCE_M, 0.0)
    return np.asarray(depth[1:-1] - (TOLERANCE_M + (1.0 - share) * ends[0] + share * ends[1]))


def _total_depth(over: Float) -> Float:
    """Depths beyond what the ends call for, m, of what is too deep by ``over``; 0 where nothing is."""
    return np.where(over > 0.0, over + TOLERANCE_M, 0.0)


def _pushes(over: Float, way: Float, ahead: Float) -> Float:
    """The pushes (n, 2, 3) out of what lies deeper than allowed by ``over`` (n, 2): every stretch along one way, the
    mean of its frames' ways (n, 2, 3) and, where those fall out with one another, ahead.
    """
    push = np.zeros_like(way)
    for side in (0, 1):
        for stretch in _stretches(over[:, side] > 0.0):
            deep = over[stretch, side, None]
            along = (deep * way[stretch, side]).sum(axis=0) + 0.3 * (deep * ahead[stretch]).sum(axis=0)
            along /= np.linalg.norm(along) + 1e-12
            cosine = np.maximum(way[stretch, side] @ along, _SOFTEST)
            push[stretch, side] = deep / cosine[:, None] * along
    return push


def _stretches(inside: NDArray[np.bool_]) -> list[slice]:
    """Runs of frames that lie inside."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _kernel(n_frames: int) -> Float:
    """Weights by which a push spreads over a gap: a bell an eighth of the gap wide, three frames at least."""
    width = max(1.2, n_frames / 8.0)
    side = int(np.ceil(2.5 * width))
    return np.asarray(np.exp(-0.5 * (np.arange(-side, side + 1) / width) ** 2))
