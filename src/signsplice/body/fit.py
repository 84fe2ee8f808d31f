"""Moves of wrists on another body, so that hands keep their places on it and their contacts.

The hands keep their rotations in the world. The unknowns are two moves per frame, m = (m_left, m_right), of the wrists
from their places under copied rotations. A linear least-squares problem comes first, then a few Gauss-Newton steps on
skin distances; both are banded, since frames depend on their neighbours only:

    E(m) = sum w |a + m - P|^2                  hand anchors a at their places P on the other body
         + sum w |(a_l + m_l) - (a_r + m_r) - D|^2   one hand's anchors at their places on the other hand
         + w_0 |wrist + m - N|^2                the wrist at its place in signing space
         + lambda sum_t |m_(t-1) - 2 m_t + m_(t+1)|^2
         + sum w (c(m) - c*)^2                  skin distances: contacts, and clearances to keep
         + sum w (reach(m))^2                   wrists within reach of their arms

Places are relative to capsules: the share t along the axis, the direction from it, and the skin distance. Weights fall
with that distance, w = 1 / (1 + c / rho)^4, so that close capsules decide (Ho, Komura and Tai 2010; Molla, Debarba and
Boulic 2018).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from signsplice.body.capsules import BodyCapsules
from signsplice.body.collision import Near, SkinPairs, clearances, near_pairs, pair_clearances, skin_pairs
from signsplice.body.contacts import PosedBody
from signsplice.motion import FloatArray
from signsplice.rig.roles import SIDES

Index = NDArray[np.intp]


@dataclass(frozen=True)
class WristSettings:
    """Weights and limits of the fit of wrists."""

    anchor_fade_m: float = 0.04
    """rho: skin distance over which the weights of anchors fall, m."""
    hand_clearance_m: float = 0.06
    """Largest clearance that scales as hands do, m."""
    space_clearance_m: float = 0.25
    """Least clearance that scales as signing space does, m."""
    space_weight: float = 0.15
    """w_0: weight of the wrists' places in signing space."""
    smoothness: float = 100.0
    """lambda at the frame rate ``smoothness_fps``."""
    smoothness_fps: float = 30.0
    """Frame rate to which ``smoothness`` refers, Hz."""
    steps: int = 4
    """Gauss-Newton steps of the first solution."""
    refining_steps: int = 2
    """Gauss-Newton steps of a refinement."""
    damping: float = 10.0
    """Weight that ties moves to those of the step before: contacts that come and go would make them swing."""
    reach: float = 0.985
    """Largest distance of a wrist from its shoulder, arm lengths."""
    reach_weight: float = 60.0
    """Weight that pulls wrists back within reach."""
    signing_activity: float = 0.5
    """Activity of an arm above which it signs."""


WRISTS = WristSettings()


@dataclass(frozen=True)
class ContactSettings:
    """Skin distances and weights of contacts."""

    weight: float = 60.0
    """Weight of a contact."""
    fade_m: float = 0.006
    """Depth at the source over which the weight of a contact falls by a factor e, m."""
    least_weight: float = 1e-3
    """Weight above which a contact counts."""
    touch_distance_m: float = 0.012
    """Largest skin distance at the source of a pair that keeps its distance, m."""
    clearance_m: float = 0.010
    """Least distance to which pairs that are farther apart at the source may come, m."""
    press_depth_m: float = 0.002
    """Largest depth at the source of a contact of skin on skin, m."""
    watch_distance_m: float = 0.035
    """Largest skin distance on the other body of a pair that the fit watches, m."""


CONTACTS = ContactSettings()

_ARM_SHARES = {"sleeve": (0.0, 0.5), "cuff": (0.5, 1.0)}
"""Shares of a wrist's move that both ends of an arm's parts follow."""
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
"""Points of a hand: key of a capsule without the side, and place along its axis."""


def solve_blocks(block: FloatArray, rhs: FloatArray, smoothness: float) -> FloatArray:
    """Returns the moves (T, 2, 3) that solve a block (T, 6, 6) and right side (T, 6) for each frame; the squares of
    their second differences, with weight ``smoothness``, couple the frames.
    """
    n = len(block)
    band = np.zeros((18, 6 * n))
    for k in range(6):
        for i in range(6 - k):
            band[k, i::6] = block[:, i + k, i]
    d0, d1, d2 = second_differences(n)
    band[0] += np.repeat(smoothness * d0, 6)
    band[6, : 6 * (n - 1)] += np.repeat(smoothness * d1, 6)
    band[12, : 6 * max(n - 2, 0)] += np.repeat(smoothness * d2, 6)
    return np.asarray(scipy.linalg.solveh_banded(band, rhs.ravel(), lower=True, check_finite=False)).reshape(n, 2, 3)


def second_differences(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns the three diagonals of D'D, D the second differences of n values."""
    if n < 3:
        return np.zeros(n), np.zeros(max(n - 1, 0)), np.zeros(max(n - 2, 0))
    d0, d1, d2 = np.zeros(n), np.zeros(n - 1), np.ones(n - 2)
    d0[:-2] += 1.0
    d0[1:-1] += 4.0
    d0[2:] += 1.0
    d1[:-1] -= 2.0
    d1[1:] -= 2.0
    return d0, d1, d2


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of the capsules that two bodies share, on each body.

    source, target: (n,) rows.
    at: (n,) places along the axes, for anchors.
    """

    source: Index
    target: Index
    at: FloatArray


class Fit:
    """The problem of one clip: ``source`` as signed, ``carried`` with the same rotations on the other body.

    fps: frame rate.
    active: (T, 2) activity of each arm in each frame: 0 while it hangs.
    """

    def __init__(self, source: PosedBody, carried: PosedBody, fps: float, active: FloatArray) -> None:
        self.source, self.carried, self.fps, self.active = source, carried, fps, active
        self.n_frames = len(source.wrists)
        self._arm_scale = float(np.mean(carried.arm_lengths) / np.mean(source.arm_lengths))
        self._hand_scale = carried.palm_length / source.palm_length
        self.shared = frozenset(source.body.keys) & frozenset(carried.body.keys)
        self.pairs = skin_pairs(source.body, self.shared), skin_pairs(carried.body, self.shared)
        self._anchors = [self._rows([(side + key, share) for key, share in _ANCHORS]) for side in SIDES]
        solid = [source.body.keys[n] for n in (*source.body.groups.head, *source.body.groups.trunk)]
        self._solid = [
            self._rows([*((key, 0.0) for key in solid), (f"{o}UpperArm", 0.0), (f"{o}LowerArm", 0.0)])
            for o in ("right", "left")
        ]

    def _rows(self, places: list[tuple[str, float]]) -> _Rows:
        shared = [(key, share) for key, share in places if key in self.shared]
        source, target = ([body.keys.index(key) for key, _ in shared] for body in (self.source.body, self.carried.body))
        return _Rows(np.array(source, np.intp), np.array(target, np.intp), np.array([share for _, share in shared]))

    def moves(self) -> FloatArray:
        """Returns the moves (T, 2, 3) of the wrists, m; arms follow by ``_wrist_weights``."""
        m = self._solve_linear()
        self.out_of_reach = self._out_of_reach(m)
        self.near = _near_contacts(self, m)
        return self._solve_contacts(m, self.carried, np.zeros_like(m), WRISTS.steps)

    def _out_of_reach(self, m: FloatArray) -> FloatArray:
        """Returns the largest distance (2,) of each hand's places beyond its arm's reach while it signs, m."""
        excess = np.linalg.norm(self.carried.wrists + m - self.carried.shoulders, axis=-1) - self.carried.arm_lengths
        return np.asarray((excess * (self.active > WRISTS.signing_activity)).max(axis=0, initial=0.0))

    def refine(self, moved: PosedBody) -> FloatArray:
        """Returns refined moves, from ``moved``: the body with the arms after the moves so far."""
        base = moved.wrists - self.carried.wrists
        return self._solve_contacts(base, moved, base, WRISTS.refining_steps)

    def _solve_contacts(self, m: FloatArray, posed: PosedBody, base: FloatArray, steps: int) -> FloatArray:
        contacts = _Contacts(self.pairs[1], self.near, posed, base)
        for _ in range(steps):
            m = self._step(m, contacts)
        return m

    # --- the linear stage ---

    @cached_property
    def _linear(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Per frame: the diagonal (T, 2) and off-diagonal (T,) of the 2 x 2 block, the right side (T, 2, 3)."""
        diagonal = np.full((self.n_frames, 2), WRISTS.space_weight)
        middle, wrists = self.carried.shoulders.mean(axis=1, keepdims=True), self.source.wrists
        space = middle + self._arm_scale * (wrists - self.source.shoulders.mean(axis=1, keepdims=True))
        right = WRISTS.space_weight * (space - self.carried.wrists)
        for side in (0, 1):
            weight, pull = self._body_pull(side)
            diagonal[:, side] += weight
            right[:, side] += pull
        weight, pull = self._hand_pull()
        diagonal += weight[:, None]
        right[:, 0] += pull
        right[:, 1] -= pull
        return diagonal, -weight, right

    def _body_pull(self, side: int) -> tuple[FloatArray, FloatArray]:
        """Returns sums over anchors and capsules of weights (T,), and of weighted displacements (T, 3)."""
        anchors, solid = self._anchors[side], self._solid[side]
        s, c = self.source, self.carried
        a, ra = _points(s, anchors.source, anchors.at)
        start, axis = s.starts[:, None, solid.source], (s.ends - s.starts)[:, None, solid.source]
        since = a[:, :, None] - start
        projection = np.einsum("tasx,tasx->tas", since, np.broadcast_to(axis, since.shape))
        t = np.clip(projection / (np.einsum("tasx,tasx->tas", axis, axis) + 1e-12), 0.0, 1.0)
        offset = since - t[..., None] * axis
        distance = np.sqrt(np.einsum("tasx,tasx->tas", offset, offset)) + 1e-9
        radius = s.radii[solid.source]
        clearance = distance - (radius[:, 0] + t * (radius[:, 1] - radius[:, 0])) - ra[:, None]
        weight = _weight(clearance) * self.active[:, side, None, None]
        b, rb = _points(c, anchors.target, anchors.at)
        start, axis = c.starts[:, None, solid.target], (c.ends - c.starts)[:, None, solid.target]
        radius = c.radii[solid.target]
        goal = (radius[:, 0] + t * (radius[:, 1] - radius[:, 0])) + rb[:, None] + self._scale_clearance(clearance)
        displacement = start + t[..., None] * axis + offset * (goal / distance)[..., None] - b[:, :, None]
        return weight.sum(axis=(1, 2)), np.einsum("tas,tasx->tx", weight, displacement)

    def _hand_pull(self) -> tuple[FloatArray, FloatArray]:
        """Returns sums over pairs of anchors of weights (T,), and of weighted displacements (T, 3) of the left hand."""
        left_rows, right_rows = self._anchors
        (a, ra), (b, rb) = (_points(self.source, rows.source, rows.at) for rows in (left_rows, right_rows))
        d = a[:, :, None] - b[:, None]
        distance = np.sqrt(np.einsum("tabx,tabx->tab", d, d)) + 1e-9
        clearance = distance - ra[:, None] - rb
        weight = _weight(clearance) * self.active.min(axis=1)[:, None, None]
        (a, ra), (b, rb) = (_points(self.carried, rows.target, rows.at) for rows in (left_rows, right_rows))
        goal = d * ((ra[:, None] + rb + self._scale_clearance(clearance)) / distance)[..., None]
        displacement = goal - (a[:, :, None] - b[:, None])
        return weight.sum(axis=(1, 2)), np.einsum("tab,tabx->tx", weight, displacement)

    def _scale_clearance(self, clearance: FloatArray) -> FloatArray:
        """Returns a skin distance on the other body: hands scale a small one, signing space scales a large one."""
        low, high = WRISTS.hand_clearance_m, WRISTS.space_clearance_m
        share = np.clip((clearance - low) / (high - low), 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        return clearance * (self._hand_scale + (self._arm_scale - self._hand_scale) * share)

    @property
    def smoothness(self) -> float:
        """The weight of smoothness at the clip's frame rate."""
        return WRISTS.smoothness * (self.fps / WRISTS.smoothness_fps) ** 4

    def _solve_linear(self) -> FloatArray:
        n, (diagonal, off, right) = self.n_frames, self._linear
        band = np.zeros((5, 2 * n))  # lower form: band[k, i] = A[i + k, i]
        d0, d1, d2 = second_differences(n)
        band[0] = (diagonal + self.smoothness * d0[:, None]).ravel()
        band[1, 0::2] = off
        band[2, : 2 * (n - 1)] = np.repeat(self.smoothness * d1, 2)
        band[4, : 2 * max(n - 2, 0)] = np.repeat(self.smoothness * d2, 2)
        return np.asarray(
            scipy.linalg.solveh_banded(band, right.reshape(2 * n, 3), lower=True, check_finite=False)
        ).reshape(n, 2, 3)

    # --- the contact stage ---

    def _step(self, m: FloatArray, contacts: _Contacts) -> FloatArray:
        n, (diagonal, off, right) = self.n_frames, self._linear
        block = np.zeros((n, 6, 6))
        for axis in range(3):
            block[:, axis, axis], block[:, 3 + axis, 3 + axis] = diagonal[:, 0], diagonal[:, 1]
            block[:, 3 + axis, axis] = block[:, axis, 3 + axis] = off
        rhs = right.reshape(n, 6) + WRISTS.damping * m.reshape(n, 6)
        block[:, range(6), range(6)] += WRISTS.damping
        contacts.add(m, block, rhs)
        self._add_reach(m, block, rhs)
        return solve_blocks(block, rhs, self.smoothness)

    def _add_reach(self, m: FloatArray, block: FloatArray, rhs: FloatArray) -> None:
        """Keep wrists within reach: those beyond aim at the plane at right angles to the arm."""
        for side in (0, 1):
            arm = self.carried.wrists[:, side] + m[:, side] - self.carried.shoulders[:, side]
            length = np.linalg.norm(arm, axis=-1)
            limit = WRISTS.reach * self.carried.arm_lengths[side]
            rows = np.flatnonzero(length > limit)
            if not len(rows):
                continue
            n = arm[rows] / length[rows, None]
            goal = limit - length[rows] + np.einsum("nx,nx->n", n, m[rows, side])
            columns = slice(3 * side, 3 * side + 3)
            block[rows, columns, columns] += WRISTS.reach_weight * n[:, :, None] * n[:, None]
            rhs[rows, columns] += WRISTS.reach_weight * goal[:, None] * n


def _near_contacts(fit: Fit, m: FloatArray) -> Near:
    """Returns the pairs that are close at the source, or on the other body with its wrists moved by ``m``."""
    source, posed, (source_pairs, target_pairs) = fit.source, fit.carried, fit.pairs
    first, last, sides = _wrist_weights(posed.body)
    shift = m[:, sides]  # (T, C, 3)
    starts, ends = posed.starts + first[:, None] * shift, posed.ends + last[:, None] * shift
    touching = near_pairs(source.starts, source.ends, source.radii, source_pairs, CONTACTS.touch_distance_m)
    close = near_pairs(starts, ends, posed.radii, target_pairs, CONTACTS.watch_distance_m)
    n = len(target_pairs.own)
    frames, k = np.divmod(np.union1d(touching[0] * n + touching[1], close[0] * n + close[1]), n)
    before = pair_clearances(source.starts, source.ends, source.radii, source_pairs, frames, k).distance
    after = pair_clearances(starts, ends, posed.radii, target_pairs, frames, k).distance
    is_close = (before < CONTACTS.touch_distance_m) | (after < CONTACTS.watch_distance_m)
    return Near(frames[is_close], k[is_close], before[is_close])


class _Contacts:
    """The near pairs on a body whose wrists have moved by ``base`` in ``posed``."""

    def __init__(self, target_pairs: SkinPairs, near: Near, posed: PosedBody, base: FloatArray) -> None:
        self.frames, k, self.then = near.frames, near.k, near.distance
        first, last, _ = _wrist_weights(posed.body)
        own_rows, other_rows = target_pairs.own[k], target_pairs.other[k]
        self._p, self._q = posed.starts[self.frames, own_rows], posed.starts[self.frames, other_rows]
        self._u, self._v = posed.ends[self.frames, own_rows] - self._p, posed.ends[self.frames, other_rows] - self._q
        self._radii = posed.radii[own_rows], posed.radii[other_rows]
        self._sides = target_pairs.own_side[k], np.maximum(target_pairs.other_side[k], 0)
        moves = target_pairs.other_side[k] >= 0
        self._first = first[own_rows], np.where(moves, first[other_rows], 0.0)
        self._more = (last - first)[own_rows], np.where(moves, (last - first)[other_rows], 0.0)
        self._base = base[self.frames]
        touching = self.then < CONTACTS.touch_distance_m
        # A pair that lies deep at the source has no skin to touch: it may stay as deep, with less weight.
        off = np.maximum(np.abs(self.then + 0.5 * CONTACTS.press_depth_m) - 0.5 * CONTACTS.press_depth_m, 0.0)
        self._wanted = self._allowed = np.minimum(self.then, CONTACTS.clearance_m)
        self._held = np.where(touching, CONTACTS.weight * np.exp(-off / CONTACTS.fade_m), 0.0)

    def add(self, m: FloatArray, block: FloatArray, rhs: FloatArray) -> None:
        """Add this step's residuals to the blocks (T, 6, 6) and right sides (T, 6)."""
        if not len(self.frames):
            return
        rows, since = np.arange(len(self.frames)), m[self.frames] - self._base
        own_moves, other_moves = since[rows, self._sides[0]], since[rows, self._sides[1]]
        now = clearances(
            (self._p + self._first[0][:, None] * own_moves) - (self._q + self._first[1][:, None] * other_moves),
            self._u + self._more[0][:, None] * own_moves,
            self._v + self._more[1][:, None] * other_moves,
            *self._radii,
        )
        weight = np.where(now.distance < self._allowed, CONTACTS.weight, self._held)
        rows = np.flatnonzero(weight > CONTACTS.least_weight)
        if not len(rows):
            return
        share, index = np.zeros((len(rows), 2)), np.arange(len(rows))
        share[index, self._sides[0][rows]] = (self._first[0] + now.own_at * self._more[0])[rows]
        share[index, self._sides[1][rows]] -= (self._first[1] + now.other_at * self._more[1])[rows]
        jacobian = (share[:, :, None] * now.normals[rows, None]).reshape(-1, 6)
        frames = self.frames[rows]
        goal = (self._wanted - now.distance)[rows] + np.einsum("ni,ni->n", jacobian, m[frames].reshape(-1, 6))
        weighted = weight[rows, None] * jacobian
        starts = np.flatnonzero(np.r_[True, frames[1:] > frames[:-1]])
        block[frames[starts]] += np.add.reduceat(weighted[:, :, None] * jacobian[:, None], starts)
        rhs[frames[starts]] += np.add.reduceat(weighted * goal[:, None], starts)


def _wrist_weights(body: BodyCapsules) -> tuple[FloatArray, FloatArray, Index]:
    """Returns the shares (C,) of a wrist's move that both ends of each capsule follow, and the wrist's side (C,)."""
    first, last = np.zeros(len(body.parts)), np.zeros(len(body.parts))
    for n, (part, side) in enumerate(zip(body.parts, body.sides, strict=True)):
        if side and part not in ("leg", "shoe"):
            first[n], last[n] = _ARM_SHARES.get(part, (1.0, 1.0))
    return first, last, np.array([int(side == "right") for side in body.sides], np.intp)


def _points(body: PosedBody, rows: Index, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns points (T, n, 3) along capsules, and the radii (n,) there."""
    start = body.starts[:, rows]
    radius = body.radii[rows]
    return start + at[:, None] * (body.ends[:, rows] - start), radius[:, 0] + at * (radius[:, 1] - radius[:, 0])


def _weight(clearance: FloatArray) -> FloatArray:
    ratio = 1.0 + np.maximum(clearance, 0.0) / WRISTS.anchor_fade_m
    return 1.0 / (ratio * ratio * ratio * ratio)
