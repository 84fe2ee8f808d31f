"""Where wrists go on another body, so that hands keep their place on it and touch what they touched.

The hands' rotations in the world stay as they are. What is sought are two moves a frame, m = (m_left, m_right), of the
wrists from where copied rotations put them. First a linear least-squares problem, then a few Gauss-Newton steps on skin
distances; both are banded, since frames are tied to their neighbours alone:

    E(m) = sum w |a + m - P|^2                  hand anchors a at their places P on the other body
         + sum w |(a_l + m_l) - (a_r + m_r) - D|^2   one hand's anchors at their places on the other hand
         + w_0 |wrist + m - N|^2                the wrist at its place in signing space
         + lambda sum_t |m_(t-1) - 2 m_t + m_(t+1)|^2
         + sum w (gap(m) - gap*)^2              skin distances: what touches, and what must not
         + sum w (reach(m))^2                   wrists within reach of their arms

Places are relative to capsules: the share t along the axis, the direction from it, and the skin distance. Weights fall
with that distance, w = 1 / (1 + gap / rho)^4, so that what is near decides (Ho, Komura and Tai 2010; Molla, Debarba and
Boulic 2018).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from signsplice.body.capsules import BodyCapsules
from signsplice.body.touch import Gaps, SkinPairs, ball_gaps, gaps, skin_pairs

Float = NDArray[np.float64]
Index = NDArray[np.intp]

NEAR_M = 0.04
"""rho: skin distance over which weights fall, m."""
_FREE_M, _FAR_M = 0.06, 0.25
"""Distances up to which a gap keeps its length, and from which on it is scaled as signing space is, m."""
_SPACE_WEIGHT = 0.15
_SMOOTHNESS = 100.0
"""lambda at 30 frames a second."""
_CONTACT_WEIGHT = 60.0
_CONTACT_FADE_M = 0.006
_TOUCH_M = 0.012
"""Skin distance at the source up to which a pair is held at its distance, m."""
_CLEAR_M = 0.010
"""Pairs that are farther apart than this at the source may come as near, not nearer, m."""
_PRESS_M = 0.002
"""A touch may press this deep, m, however deep it is at the source."""
_MARGIN_M = 0.035
_STEPS = 4
_REACH, _REACH_WEIGHT = 0.985, 60.0


@dataclass(frozen=True, eq=False)
class PosedBody:
    """A body over time, in metres.

    body: its capsules.
    starts, ends: (T, C, 3) of their axes in the world.
    radii: (C, 2).
    shoulders, elbows, wrists: (T, 2, 3) left and right.
    arm_lengths: (2,) upper arm and forearm together.
    """

    body: BodyCapsules
    starts: Float
    ends: Float
    radii: Float
    shoulders: Float
    elbows: Float
    wrists: Float
    arm_lengths: Float

    @property
    def hand_length(self) -> float:
        """Median length of the palms' capsules."""
        palms = [n for n, part in enumerate(self.body.parts) if part == "palm"]
        return float(np.median(np.linalg.norm(self.body.ends[palms] - self.body.starts[palms], axis=-1)))


_ANCHORS = (
    ("ThumbDistal", 1.0),
    ("IndexDistal", 1.0),
    ("MiddleDistal", 1.0),
    ("RingDistal", 1.0),
    ("LittleDistal", 1.0),
    ("IndexPalm", 1.0),
    ("LittlePalm", 1.0),
    ("MiddlePalm", 0.6),
    ("Mitten", 0.3),
    ("Mitten", 1.0),
)
"""Points of a hand: key of a capsule without the side, and where along its axis."""


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of the capsules that two bodies share, on either body.

    source, target: (n,) rows.
    at: (n,) where along the axes, for anchors.
    """

    source: Index
    target: Index
    at: Float


class Fit:
    """The problem of one clip: ``source`` as it was signed, ``carried`` with the same rotations on the other body.

    fps: frame rate.
    active: (T,) how much each frame is signing: 0 where the arms hang.
    """

    def __init__(self, source: PosedBody, carried: PosedBody, fps: float, active: Float) -> None:
        self.source, self.carried, self.fps, self.active = source, carried, fps, active
        self.n_frames = len(source.wrists)
        self._arm_scale = float(np.mean(carried.arm_lengths) / np.mean(source.arm_lengths))
        self._hand_scale = carried.hand_length / source.hand_length
        shared = frozenset(source.body.keys) & frozenset(carried.body.keys)
        self._pairs = skin_pairs(source.body, shared), skin_pairs(carried.body, shared)
        self._anchors = [self._rows([(side + key, at) for key, at in _ANCHORS], shared) for side in ("left", "right")]
        solid = [source.body.keys[n] for n in (*source.body.groups.head, *source.body.groups.trunk)]
        self._solid = [
            self._rows([*((key, 0.0) for key in solid), (f"{o}UpperArm", 0.0), (f"{o}LowerArm", 0.0)], shared)
            for o in ("right", "left")
        ]

    def _rows(self, wanted: list[tuple[str, float]], shared: frozenset[str]) -> _Rows:
        found = [(key, at) for key, at in wanted if key in shared]
        source, target = ([body.keys.index(key) for key, _ in found] for body in (self.source.body, self.carried.body))
        return _Rows(np.array(source, np.intp), np.array(target, np.intp), np.array([at for _, at in found]))

    def moves(self) -> Float:
        """The moves (T, 2, 3) of the wrists, m."""
        diagonal, off, right = self._linear()
        m = self._solve_linear(diagonal, off, right)
        contacts = _Contacts(self, m)
        for _ in range(_STEPS):
            m = self._step(m, contacts, diagonal, off, right)
        return m

    # --- the linear stage ---

    def _linear(self) -> tuple[Float, Float, Float]:
        """Per frame: the diagonal (T, 2) and off-diagonal (T,) of the 2 x 2 block, the right side (T, 2, 3)."""
        diagonal = np.full((self.n_frames, 2), _SPACE_WEIGHT)
        middle, wrists = self.carried.shoulders.mean(axis=1, keepdims=True), self.source.wrists
        space = middle + self._arm_scale * (wrists - self.source.shoulders.mean(axis=1, keepdims=True))
        right = _SPACE_WEIGHT * (space - self.carried.wrists)
        for side in (0, 1):
            weight, pull = self._body_places(side)
            diagonal[:, side] += weight
            right[:, side] += pull
        weight, pull = self._hand_places()
        diagonal += weight[:, None]
        right[:, 0] += pull
        right[:, 1] -= pull
        return diagonal, -weight, right

    def _body_places(self, side: int) -> tuple[Float, Float]:
        """Sums over anchors and capsules of weights (T,), and of weights times the way to the place (T, 3)."""
        anchors, solid = self._anchors[side], self._solid[side]
        s, c = self.source, self.carried
        a, ra = _points(s, anchors.source, anchors.at)
        start, axis = s.starts[:, None, solid.source], (s.ends - s.starts)[:, None, solid.source]
        along = np.einsum("tasx,tasx->tas", a[:, :, None] - start, np.broadcast_to(axis, (*a.shape[:2], *axis.shape[2:])))
        t = np.clip(along / (np.einsum("tasx,tasx->tas", axis, axis) + 1e-12), 0.0, 1.0)
        out = a[:, :, None] - start - t[..., None] * axis
        away = np.sqrt(np.einsum("tasx,tasx->tas", out, out)) + 1e-9
        radius = s.radii[solid.source]
        gap = away - (radius[:, 0] + t * (radius[:, 1] - radius[:, 0])) - ra[:, None]
        weight = _weight(gap) * self.active[:, None, None]
        b, rb = _points(c, anchors.target, anchors.at)
        start, axis = c.starts[:, None, solid.target], (c.ends - c.starts)[:, None, solid.target]
        radius = c.radii[solid.target]
        wanted = (radius[:, 0] + t * (radius[:, 1] - radius[:, 0])) + rb[:, None] + self._scaled(gap)
        way = start + t[..., None] * axis + out * (wanted / away)[..., None] - b[:, :, None]
        return weight.sum(axis=(1, 2)), np.einsum("tas,tasx->tx", weight, way)

    def _hand_places(self) -> tuple[Float, Float]:
        """Sum over pairs of anchors of weights (T,), and of weights times the way of the left to its place (T, 3)."""
        left, right = self._anchors
        (a, ra), (b, rb) = (_points(self.source, rows.source, rows.at) for rows in (left, right))
        d = a[:, :, None] - b[:, None]
        away = np.sqrt(np.einsum("tabx,tabx->tab", d, d)) + 1e-9
        gap = away - ra[:, None] - rb
        weight = _weight(gap) * self.active[:, None, None]
        (a, ra), (b, rb) = (_points(self.carried, rows.target, rows.at) for rows in (left, right))
        wanted = d * ((ra[:, None] + rb + self._scaled(gap)) / away)[..., None]
        way = wanted - (a[:, :, None] - b[:, None])
        return weight.sum(axis=(1, 2)), np.einsum("tab,tabx->tx", weight, way)

    def _scaled(self, gap: Float) -> Float:
        """A skin distance on the other body: as it is where it is small, scaled as signing space where it is large."""
        share = np.clip((gap - _FREE_M) / (_FAR_M - _FREE_M), 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        return gap * (self._hand_scale + (self._arm_scale - self._hand_scale) * share)

    @property
    def _smooth(self) -> float:
        return _SMOOTHNESS * (self.fps / 30.0) ** 4

    def _solve_linear(self, diagonal: Float, off: Float, right: Float) -> Float:
        n = self.n_frames
        band = np.zeros((5, 2 * n))  # lower form: band[k, i] = A[i + k, i]
        d0, d1, d2 = _second_differences(n)
        band[0] = (diagonal + self._smooth * d0[:, None]).ravel()
        band[1, 0::2] = off
        band[2, : 2 * (n - 1)] = np.repeat(self._smooth * d1, 2)
        band[4, : 2 * max(n - 2, 0)] = np.repeat(self._smooth * d2, 2)
        return np.asarray(solveh_banded(band, right.reshape(2 * n, 3), lower=True, check_finite=False)).reshape(n, 2, 3)

    # --- the contact stage ---

    def _step(self, m: Float, contacts: _Contacts, diagonal: Float, off: Float, right: Float) -> Float:
        n = self.n_frames
        block = np.zeros((n, 6, 6))
        for axis in range(3):
            block[:, axis, axis], block[:, 3 + axis, 3 + axis] = diagonal[:, 0], diagonal[:, 1]
            block[:, 3 + axis, axis] = block[:, axis, 3 + axis] = off
        rhs = right.reshape(n, 6).copy()
        contacts.add(m, block, rhs)
        self._add_reach(m, block, rhs)
        band = np.zeros((18, 6 * n))
        for k in range(6):
            for i in range(6 - k):
                band[k, i::6] = block[:, i + k, i]
        d0, d1, d2 = _second_differences(n)
        band[0] += np.repeat(self._smooth * d0, 6)
        band[6, : 6 * (n - 1)] += np.repeat(self._smooth * d1, 6)
        band[12, : 6 * max(n - 2, 0)] += np.repeat(self._smooth * d2, 6)
        solved = solveh_banded(band, rhs.ravel(), lower=True, check_finite=False)
        return np.asarray(solved).reshape(n, 2, 3)

    def _add_reach(self, m: Float, block: Float, rhs: Float) -> None:
        """Keep wrists within reach: the plane at right angles to the arm, where they are beyond."""
        for side in (0, 1):
            arm = self.carried.wrists[:, side] + m[:, side] - self.carried.shoulders[:, side]
            length = np.linalg.norm(arm, axis=-1)
            most = _REACH * self.carried.arm_lengths[side]
            rows = np.flatnonzero(length > most)
            if not len(rows):
                continue
            n = arm[rows] / length[rows, None]
            goal = most - length[rows] + np.einsum("nx,nx->n", n, m[rows, side])
            own = slice(3 * side, 3 * side + 3)
            block[rows, own, own] += _REACH_WEIGHT * n[:, :, None] * n[:, None]
            rhs[rows, own] += _REACH_WEIGHT * goal[:, None] * n


class _Contacts:
    """Pairs of capsules that are near, at the source or where the linear stage puts them."""

    def __init__(self, fit: Fit, m: Float) -> None:
        source, carried = fit.source, fit.carried
        theirs, ours = fit._pairs
        shift = np.zeros((fit.n_frames, 3))
        near = ball_gaps(source.starts, source.ends, source.radii, theirs) < _TOUCH_M
        starts, ends = _moved(carried, m)
        near |= ball_gaps(starts, ends, carried.radii, ours) < _MARGIN_M
        self.frames, self.k = np.nonzero(near)
        self.pairs, self.carried = ours, carried
        self.then = _gaps(source.starts, source.ends, source.radii, theirs, self.frames, self.k).distance
        now = _gaps(starts, ends, carried.radii, ours, self.frames, self.k).distance
        keep = (self.then < _TOUCH_M) | (now < _MARGIN_M)
        self.frames, self.k, self.then = self.frames[keep], self.k[keep], self.then[keep]

    def add(self, m: Float, block: Float, rhs: Float) -> None:
        """Add this step's residuals to the blocks (T, 6, 6) and right sides (T, 6)."""
        if not len(self.frames):
            return
        starts, ends = _moved(self.carried, m)
        now = _gaps(starts, ends, self.carried.radii, self.pairs, self.frames, self.k)
        touching = self.then < _TOUCH_M
        wanted = np.where(touching, np.maximum(self.then, -_PRESS_M), np.minimum(self.then, _CLEAR_M))
        weight = np.where(touching, _CONTACT_WEIGHT * np.exp(-np.maximum(self.then, 0.0) / _CONTACT_FADE_M), 0.0)
        weight = np.where(now.distance < np.minimum(self.then, _CLEAR_M), _CONTACT_WEIGHT, weight)
        rows = np.flatnonzero(weight > 1e-3)
        frames, k = self.frames[rows], self.k[rows]
        share = np.zeros((len(rows), 2))
        at = np.arange(len(rows))
        share[at, self.pairs.own_side[k]] = np.where(self.pairs.own_is_forearm[k], now.own_at[rows], 1.0)
        meets = self.pairs.other_side[k] >= 0
        factor = np.where(self.pairs.other_is_arm[k], _arm_share(self.carried, self.pairs.other[k], now.other_at[rows]), 1.0)
        share[at[meets], self.pairs.other_side[k][meets]] = -factor[meets]
        jacobian = (share[:, :, None] * now.normals[rows, None]).reshape(-1, 6)
        goal = wanted[rows] - now.distance[rows] + np.einsum("ni,ni->n", jacobian, m[frames].reshape(-1, 6))
        weighted = weight[rows, None] * jacobian
        order_starts = np.flatnonzero(np.r_[True, np.diff(frames) > 0]) if len(frames) else np.empty(0, int)
        if len(frames):
            block[frames[order_starts]] += np.add.reduceat(weighted[:, :, None] * jacobian[:, None], order_starts)
            rhs[frames[order_starts]] += np.add.reduceat(weighted * goal[:, None], order_starts)


def _arm_share(body: PosedBody, rows: Index, at: Float) -> Float:
    """How far a point of an arm moves with its wrist: not at the shoulder, half-way at the elbow."""
    upper = np.array([body.body.parts[row] == "sleeve" for row in range(len(body.body.parts))])[rows]
    return np.where(upper, 0.5 * at, 0.5 + 0.5 * at)


def _moved(body: PosedBody, m: Float) -> tuple[Float, Float]:
    """Capsule ends (T, C, 3) with the hands moved by m (T, 2, 3), and arms drawn after them."""
    starts, ends = body.starts.copy(), body.ends.copy()
    for side, name in enumerate(("left", "right")):
        for row, (part, of) in enumerate(zip(body.body.parts, body.body.sides, strict=True)):
            if of != name or part in ("leg", "shoe"):
                continue
            first, last = {"sleeve": (0.0, 0.5), "cuff": (0.5, 1.0)}.get(part, (1.0, 1.0))
            starts[:, row] += first * m[:, side]
            ends[:, row] += last * m[:, side]
    return starts, ends


def _gaps(starts: Float, ends: Float, radii: Float, pairs: SkinPairs, frames: Index, k: Index) -> Gaps:
    own, other = pairs.own[k], pairs.other[k]
    p, q = starts[frames, own], starts[frames, other]
    return gaps(p, ends[frames, own] - p, q, ends[frames, other] - q, radii[own], radii[other])


def _points(body: PosedBody, rows: Index, at: Float) -> tuple[Float, Float]:
    """Points (T, n, 3) along capsules, and the radii (n,) there."""
    start = body.starts[:, rows]
    radius = body.radii[rows]
    return start + at[:, None] * (body.ends[:, rows] - start), radius[:, 0] + at * (radius[:, 1] - radius[:, 0])


def _weight(gap: Float) -> Float:
    near = 1.0 + np.maximum(gap, 0.0) / NEAR_M
    return 1.0 / (near * near * near * near)


def _second_differences(n: int) -> tuple[Float, Float, Float]:
    """The three diagonals of D'D, D the second differences of n values."""
    if n < 3:
        return np.zeros(n), np.zeros(max(n - 1, 0)), np.zeros(max(n - 2, 0))
    d0, d1, d2 = np.zeros(n), np.zeros(n - 1), np.ones(n - 2)
    d0[:-2] += 1.0
    d0[1:-1] += 4.0
    d0[2:] += 1.0
    d1[:-1] -= 2.0
    d1[1:] -= 2.0
    return d0, d1, d2
