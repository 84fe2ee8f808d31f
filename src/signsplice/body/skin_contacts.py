"""Hands on an avatar's posed skin: the last moves of its wrists, after the fit to its capsules.

Capsules and the relief above them say where skin is to a centimetre, its mesh to a millimetre. In every frame in which
a hand is near head, neck, trunk or the other hand, points on it are compared with those of the other skin, both posed
as players do it (linear blend skinning). The least height s of the hand's points above the other skin, along its normal
n, is brought to the clearance at the source, c*, by moves d of both wrists:

    E(d) = sum w (s + n . d - c*)^2 + sum h |d_left - d_right|^2 + mu sum |d|^2
         + lambda sum_t |d_(t-1) - 2 d_t + d_(t+1)|^2

w is 0 where a hand that touches nothing lies higher than c*; h holds hands together that touch. Hands keep their
rotations. A few rounds (Gauss-Newton), since other points become the lowest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from signsplice.body.capsules import ARM
from signsplice.body.collision import Near, SkinPairs
from signsplice.body.fit import CLEAR_M, CONTACT_FADE_M, CONTACT_WEIGHT, PRESS_M, TOUCH_M, Fit, solve_blocks
from signsplice.body.skin_surface import THICK_M, AvatarSkin, least_height
from signsplice.motion import Clip, FloatArray, kinematics

_NEAR_M, _LOW_M = 0.045, 0.025
"""Distance up to which points of two skins are looked at as hands move, m, and by how much more than the nearest."""
_MOST_ACROSS = 1.5
"""Points that lie farther than this from the normal through the nearest point of the surface, in the distance between
its points, are beyond its edge.
"""
_SHARP_M = 0.001
"""Points that lie higher than the lowest by this, m, count less by a factor e."""
_ROUNDS, _HOLD, _TOGETHER, _TOGETHER_M = 3, 1.0, 30.0, 0.01
"""Rounds of the solution; mu; h of hands that touch, and the clearance over which it falls by a factor e, m."""
_TIE = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(3))
"""The square of the difference of both moves, as a block."""
_BODY, _HANDS = 0, 1
_KINDS = ((0, _BODY), (1, _BODY), (0, _HANDS))
"""Hand, and what it meets."""


@dataclass(frozen=True, eq=False)
class _Meeting:
    """Frames in which a hand is near other skin.

    side: 0 for the left hand, 1 for the right.
    what: ``_BODY``, or ``_HANDS``: the left hand on the right one.
    frames: (N,) of a clip.
    wanted: (N,) the height of the hand above the other skin, m.
    held: (N,) weights of that where the hand is higher.
    weight: (N,) weights where it is lower.
    together: (N,) how much hands touch, 0 to 1.
    """

    side: int
    what: int
    frames: NDArray[np.intp]
    wanted: FloatArray
    held: FloatArray
    weight: FloatArray
    together: FloatArray


@dataclass(frozen=True, eq=False)
class _Pose:
    """One frame of a meeting: ``hand`` (H, 3) points, and ``points`` and ``normals`` (N, 3) of the other skin."""

    hand: FloatArray
    points: cKDTree
    normals: FloatArray


class SkinFit:
    """Moves of the wrists of ``fit`` by the skin of its body.

    moves: (T, 2, 3) from where copied rotations put the wrists, m.
    """

    def __init__(self, fit: Fit, skin: AvatarSkin, carried: Clip, metres: float, moves: FloatArray) -> None:
        self._fit, self.moves = fit, moves
        self._spacing = metres * skin.body.spacing, metres * skin.hands[1].spacing
        self._meetings = [meeting for side, what in _KINDS if len((meeting := _meeting(fit, side, what)).frames)]
        self._poses = [_poses(one, skin, carried, metres, moves) for one in self._meetings]
        more = np.zeros_like(moves)
        for _ in range(_ROUNDS if self._meetings else 0):
            more = self._round(more)
        self.moves = moves + more
        self._heights = [self._lowest(k, more)[0] for k in range(len(self._meetings))]

    def distances(self, pairs: SkinPairs, near: Near, distance: FloatArray) -> FloatArray:
        """``distance`` (N,) of near pairs with the least of each meeting's frame as the skin has it."""
        out = distance.copy()
        for one, heights in zip(self._meetings, self._heights, strict=True):
            rows = np.flatnonzero(_is_of(self._fit, pairs, near, one.side, one.what))
            least = np.full(self._fit.n_frames, np.inf)
            np.minimum.at(least, near.frames[rows], distance[rows])
            change = np.zeros(self._fit.n_frames)
            known = np.isfinite(heights) & np.isfinite(least[one.frames])
            change[one.frames[known]] = heights[known] - least[one.frames[known]]
            out[rows] += change[near.frames[rows]]
        return out

    def _round(self, more: FloatArray) -> FloatArray:
        """Better moves in place of ``more`` (T, 2, 3)."""
        n = len(more)
        block, rhs = np.tile(_HOLD * np.eye(6), (n, 1, 1)), np.zeros((n, 6))
        for k, one in enumerate(self._meetings):
            heights, normals = self._lowest(k, more)
            off = one.wanted - heights
            weight = np.where(off > 0.0, one.weight, one.held)
            rows = np.flatnonzero(np.isfinite(heights) & (weight > 0.0))
            both = np.zeros((len(rows), 2, 3))
            both[:, one.side] = normals[rows]
            if one.what == _HANDS:
                both[:, 1] = -normals[rows]
                block[one.frames] += _TOGETHER * one.together[:, None, None] * _TIE
            jacobian, frames = both.reshape(-1, 6), one.frames[rows]
            goal = off[rows] + np.einsum("ni,ni->n", jacobian, more[frames].reshape(-1, 6))
            block[frames] += weight[rows, None, None] * jacobian[:, :, None] * jacobian[:, None]
            rhs[frames] += (weight[rows] * goal)[:, None] * jacobian
        return solve_blocks(block, rhs, self._fit.smoothness)

    def _lowest(self, k: int, more: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The least heights (N,) of a meeting's hand above the other skin, m, infinite where it is far, and the normals
        (N, 3) there.
        """
        one = self._meetings[k]
        moved = more[one.frames, one.side] - (more[one.frames, 1] if one.what == _HANDS else 0.0)
        found, directions = np.full(len(moved), np.inf), np.zeros((len(moved), 3))
        for n, (pose, by) in enumerate(zip(self._poses[k], moved, strict=True)):
            if pose is None:
                continue
            most_across, thick = _MOST_ACROSS * self._spacing[one.what], THICK_M[one.what]
            found[n], heights, normals = least_height(pose.hand + by, pose.points, pose.normals, most_across, thick)
            direction = np.exp((found[n] - heights) / _SHARP_M) @ normals
            directions[n] = direction / (np.linalg.norm(direction) + 1e-12)
        return found, directions


def _is_of(fit: Fit, pairs: SkinPairs, near: Near, side: int, what: int) -> NDArray[np.bool_]:
    """Which near pairs (N,) are those of a hand with the body, or of both hands."""
    is_hand = np.array([part not in ARM for part in fit.source.body.parts])[fit.pairs[0].other[near.k]]
    other = pairs.other_side[near.k]
    is_other = other < 0 if what == _BODY else (other >= 0) & is_hand
    return np.asarray((pairs.own_side[near.k] == side) & is_other)


def _meeting(fit: Fit, side: int, what: int) -> _Meeting:
    """The frames in which a hand is near the body, or the left hand near the right one, while it signs."""
    rows = np.flatnonzero(_is_of(fit, fit.pairs[0], fit.near, side, what))
    least = np.full(fit.n_frames, np.inf)
    np.minimum.at(least, fit.near.frames[rows], fit.near.distance[rows])
    active = fit.active[:, side] if what == _BODY else fit.active.min(axis=1)
    frames = np.flatnonzero(np.isfinite(least) & (active > 0.0))
    then, weight = least[frames], CONTACT_WEIGHT * active[frames]
    deep = np.maximum(np.abs(then + 0.5 * PRESS_M) - 0.5 * PRESS_M, 0.0)
    held = np.where(then < TOUCH_M, np.exp(-deep / CONTACT_FADE_M), 0.0)
    together = np.exp(-np.maximum(then, 0.0) / _TOGETHER_M)
    return _Meeting(side, what, frames, np.clip(then, -PRESS_M, CLEAR_M), held * weight, weight, together)


def _poses(one: _Meeting, skin: AvatarSkin, carried: Clip, metres: float, moves: FloatArray) -> list[_Pose | None]:
    """Both skins in the frames of a meeting, m, with the wrists moved by ``moves``; None where they are far apart."""
    rotations, positions = (part[one.frames] for part in kinematics.forward(carried))
    other, found = skin.hands[1] if one.what == _HANDS else skin.body, []
    for n, frame in enumerate(one.frames.tolist()):
        hand = metres * skin.hands[one.side].deform(rotations[n], positions[n])[0] + moves[frame, one.side]
        by = moves[frame, 1] if one.what == _HANDS else np.zeros(3)
        middle = hand.mean(axis=0)
        radius = float(np.linalg.norm(hand - middle, axis=1).max()) + _NEAR_M
        points, normals = other.deform(rotations[n], positions[n], ((middle - by) / metres, radius / metres))
        tree = cKDTree(metres * points + by)
        apart = np.asarray(tree.query(hand, distance_upper_bound=_NEAR_M)[0])
        hand = hand[apart < min(_NEAR_M, apart.min() + _LOW_M)]
        found.append(_Pose(hand, tree, normals) if len(hand) else None)
    return found
