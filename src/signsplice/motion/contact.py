"""What touches what: how deep capsules of a body lie in one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.body import Body, body, place
from signsplice.motion.clip import Skeleton

Float = NDArray[np.float64]

_HEAD = ("face", "hair", "nose", "neck")
_TINY = 1e-12
_APART = 1.2


@dataclass(frozen=True)
class Groups:
    """Indices of a body's capsules: those of the left and of the right hand, of the head with the neck, of the trunk
    (shoulders included).
    """

    left: tuple[int, ...]
    right: tuple[int, ...]
    head: tuple[int, ...]
    trunk: tuple[int, ...]


@lru_cache(maxsize=64)
def groups(body: Body) -> Groups:
    """The capsules that hands must not lie in, and the hands."""
    parts = list(enumerate(zip(body.parts, body.sides, strict=True)))
    hands = {
        side: tuple(n for n, (part, s) in parts if s == side and part not in ("sleeve", "cuff", "leg", "shoe"))
        for side in ("left", "right")
    }
    return Groups(
        hands["left"],
        hands["right"],
        head=tuple(n for n, (part, _) in parts if part in _HEAD),
        trunk=tuple(n for n, (part, _) in parts if part == "shirt"),
    )


def hands_inside(skeleton: Skeleton, global_rotations: Float, global_positions: Float) -> tuple[Float, Float]:
    """How deep (T, 2) the left and the right hand lie in head, neck, trunk or the other hand, clip units (negative: how
    far they are from them), and the unit way out (T, 2, 3) in the world.

    From the globals of ``kinematics.forward`` for all joints. Hands that meet go apart as wholes more than from skin to
    skin, since fingers alone would push this way and that.
    """
    shape = known_body(skeleton)
    known = groups(shape)
    starts, ends = place(shape, global_rotations, global_positions)
    solid = (*known.head, *known.trunk)
    return _deepest(shape, starts, ends, (solid, solid), True)


@dataclass(frozen=True, eq=False)
class Capsules:
    """A body's capsules over time: starts and ends (T, C, 3) of their axes in the world."""

    shape: Body
    starts: Float
    ends: Float

    def moved(self, moves: Float) -> Capsules:
        """The same with the hands moved by ``moves`` (T, 2, 3), left and right; head, trunk and arms stay."""
        starts, ends = self.starts.copy(), self.ends.copy()
        known = groups(self.shape)
        for side, own in enumerate((known.left, known.right)):
            starts[:, own] += moves[:, side, None]
            ends[:, own] += moves[:, side, None]
        return Capsules(self.shape, starts, ends)

    def pressed(self) -> tuple[Float, Float]:
        """``hands_inside`` where a hand lies in something, in a part of the time: only capsules that the ball around a
        hand reaches are looked at. Elsewhere the depth is some number not above 0, and the way means nothing.
        """
        known, starts, ends = groups(self.shape), self.starts, self.ends
        depth, way = np.full((len(starts), 2), -np.inf), np.zeros((len(starts), 2, 3))
        near, meeting = _near(self.shape, known, starts, ends)
        rows = np.flatnonzero(np.any(near, axis=(1, 2)) | meeting)
        if len(rows):
            solid = np.array([*known.head, *known.trunk])
            left, right = (tuple(solid[own].tolist()) for own in np.any(near[rows], axis=0))
            meet = bool(meeting[rows].any())
            depth[rows], way[rows] = _deepest(self.shape, starts[rows], ends[rows], (left, right), meet)
        return depth, way


def capsules(skeleton: Skeleton, global_rotations: Float, global_positions: Float) -> Capsules:
    """A skeleton's capsules, from the globals of ``kinematics.forward`` for all joints."""
    shape = known_body(skeleton)
    return Capsules(shape, *place(shape, global_rotations, global_positions))


def _near(shape: Body, known: Groups, starts: Float, ends: Float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which capsules of head and trunk the ball around each hand reaches (T, 2, S), and whether the two balls do one
    another (T,).
    """
    solid = [*known.head, *known.trunk]
    q, v = starts[:, solid], ends[:, solid] - starts[:, solid]
    thickest = shape.radii[solid].max(axis=1)
    near = np.zeros((len(starts), 2, len(solid)), bool)
    centres, balls = [], []
    for side, own in enumerate(map(list, (known.left, known.right))):
        points = np.concatenate([starts[:, own], ends[:, own]], axis=1)
        centre = points.mean(axis=1) if own else np.full((len(starts), 3), np.inf)
        thick = np.concatenate([shape.radii[own, 0], shape.radii[own, 1]])
        ball = (np.linalg.norm(points - centre[:, None], axis=-1) + thick).max(axis=1, initial=0.0)
        if own:
            way = centre[:, None] - q
            share = np.clip(_dot(way, v) / (_dot(v, v) + _TINY), 0.0, 1.0)
            near[:, side] = np.linalg.norm(way - share[..., None] * v, axis=-1) < ball[:, None] + thickest
        centres.append(centre)
        balls.append(ball)
    if not (known.left and known.right):
        return near, np.zeros(len(starts), bool)
    return near, np.linalg.norm(centres[0] - centres[1], axis=-1) < balls[0] + balls[1]


def _deepest(
    shape: Body, starts: Float, ends: Float, solid: tuple[tuple[int, ...], tuple[int, ...]], meeting: bool
) -> tuple[Float, Float]:
    """How deep (T, 2) each hand lies, and its way out (T, 2, 3), in some capsules for the left and for the right one,
    and in the other hand where they are ``meeting``.
    """
    known = groups(shape)
    n_frames = len(starts)
    depth, way = np.full((n_frames, 2), -np.inf), np.zeros((n_frames, 2, 3))
    meeting = meeting and bool(known.left and known.right)
    if meeting:
        between, across = overlap(starts, ends, shape.radii, known.left, known.right)
        apart = starts[:, known.left].mean(axis=1) - starts[:, known.right].mean(axis=1)
        across = across + _APART * (apart / (np.linalg.norm(apart, axis=-1, keepdims=True) + _TINY))[:, None, None]
        across /= np.linalg.norm(across, axis=-1, keepdims=True) + _TINY
    rows = np.arange(n_frames)
    for side, own in enumerate((known.left, known.right)):
        deep, out = overlap(starts, ends, shape.radii, own, solid[side])
        if meeting:
            other, away = (between, across) if side == 0 else (between.swapaxes(1, 2), -across.swapaxes(1, 2))
            deep, out = np.concatenate([deep, other], axis=2), np.concatenate([out, away], axis=2)
        if deep.size:
            deep, out = deep.reshape(n_frames, -1), out.reshape(n_frames, -1, 3)
            worst = deep.argmax(axis=1)
            depth[:, side], way[:, side] = deep[rows, worst], out[rows, worst]
    return depth, way


@lru_cache(maxsize=64)
def known_body(skeleton: Skeleton) -> Body:
    """The body of a skeleton, remembered."""
    return body(skeleton)


def overlap(starts: Float, ends: Float, radii: Float, a: Sequence[int], b: Sequence[int]) -> tuple[Float, Float]:
    """How deep (T, A, B) capsules ``a`` lie in capsules ``b`` (negative: how far apart), and the unit way (T, A, B, 3)
    along which each of ``a`` would leave.

    starts, ends: (T, C, 3) from ``body.place``; radii (C, 2). The nearest points of the two axes (Ericson 2005, 5.1.9)
    with the radii there; exact for capsules of one thickness, within the taper's slope for others.
    """
    rows, columns = np.asarray(a, np.intp), np.asarray(b, np.intp)
    p, q = starts[:, rows, None], starts[:, None, columns]
    u, v = ends[:, rows, None] - p, ends[:, None, columns] - q
    r = p - q
    uu, vv, uv = _dot(u, u) + _TINY, _dot(v, v) + _TINY, _dot(u, v)
    ur, vr = _dot(u, r), _dot(v, r)
    s = np.clip((uv * vr - ur * vv) / np.maximum(uu * vv - uv * uv, _TINY), 0.0, 1.0)
    t = np.clip((uv * s + vr) / vv, 0.0, 1.0)
    s = np.clip((uv * t - ur) / uu, 0.0, 1.0)
    way = r + s[..., None] * u - t[..., None] * v
    distance = np.sqrt(_dot(way, way)) + _TINY
    thick_a = radii[rows, 0, None] + s * (radii[rows, 1] - radii[rows, 0])[:, None]
    thick_b = radii[columns, 0] + t * (radii[columns, 1] - radii[columns, 0])
    return thick_a + thick_b - distance, way / distance[..., None]


def _dot(a: Float, b: Float) -> Float:
    return np.asarray(np.einsum("...c,...c->...", a, b))
