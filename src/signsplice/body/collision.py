"""What touches what: how deep capsules of a body lie in one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import BodyCapsules, body_capsules, capsule_ends
from signsplice.motion.clip import Skeleton

Float = NDArray[np.float64]

_HEAD = ("face", "hair", "nose", "neck")
_TINY = 1e-12
_APART = 1.2


@dataclass(frozen=True)
class CapsuleGroups:
    """Indices of a body's capsules: those of the left and of the right hand, of the head with the neck, of the trunk
    (shoulders included).
    """

    left: tuple[int, ...]
    right: tuple[int, ...]
    head: tuple[int, ...]
    trunk: tuple[int, ...]


@lru_cache(maxsize=64)
def capsule_groups(body_capsules: BodyCapsules) -> CapsuleGroups:
    """The capsules that hands must not lie in, and the hands."""
    parts = list(enumerate(zip(body_capsules.parts, body_capsules.sides, strict=True)))
    hands = {
        side: tuple(n for n, (part, s) in parts if s == side and part not in ("sleeve", "cuff", "leg", "shoe"))
        for side in ("left", "right")
    }
    return CapsuleGroups(
        hands["left"],
        hands["right"],
        head=tuple(n for n, (part, _) in parts if part in _HEAD),
        trunk=tuple(n for n, (part, _) in parts if part == "shirt"),
    )


def hand_penetration(skeleton: Skeleton, global_rotations: Float, global_positions: Float) -> tuple[Float, Float]:
    """How deep (T, 2) the left and the right hand lie in head, neck, trunk or the other hand, clip units (negative: how
    far they are from them), and the unit way out (T, 2, 3) in the world.

    From the globals of ``kinematics.forward`` for all joints. Hands that meet go apart as wholes more than from skin to
    skin, since fingers alone would push this way and that.
    """
    shape = known_capsules(skeleton)
    known = capsule_groups(shape)
    starts, ends = capsule_ends(shape, global_rotations, global_positions)
    n_frames, solid = len(starts), (*known.head, *known.trunk)
    depth, way = np.full((n_frames, 2), -np.inf), np.zeros((n_frames, 2, 3))
    meeting = bool(known.left and known.right)
    if meeting:
        between, across = overlap(starts, ends, shape.radii, known.left, known.right)
        apart = starts[:, known.left].mean(axis=1) - starts[:, known.right].mean(axis=1)
        across = across + _APART * (apart / (np.linalg.norm(apart, axis=-1, keepdims=True) + _TINY))[:, None, None]
        across /= np.linalg.norm(across, axis=-1, keepdims=True) + _TINY
    rows = np.arange(n_frames)
    for side, own in enumerate((known.left, known.right)):
        deep, out = overlap(starts, ends, shape.radii, own, solid)
        if meeting:
            other, away = (between, across) if side == 0 else (between.swapaxes(1, 2), -across.swapaxes(1, 2))
            deep, out = np.concatenate([deep, other], axis=2), np.concatenate([out, away], axis=2)
        if deep.size:
            deep, out = deep.reshape(n_frames, -1), out.reshape(n_frames, -1, 3)
            worst = deep.argmax(axis=1)
            depth[:, side], way[:, side] = deep[rows, worst], out[rows, worst]
    return depth, way


@dataclass(frozen=True, eq=False)
class PosedCapsules:
    """A body's capsules over time: starts and ends (T, C, 3) of their axes in the world."""

    shape: BodyCapsules
    starts: Float
    ends: Float

    def __getitem__(self, frames: slice) -> PosedCapsules:
        """Those of some frames."""
        return PosedCapsules(self.shape, self.starts[frames], self.ends[frames])

    def near(self, slack: float = 0.0) -> NearPairs:
        """What a hand may come to lie in where it moves by up to ``slack``, clip units: the pairs of a hand's capsule,
        taken as a ball about its middle, and one of head, trunk or the other hand that come so near.

        Whole hands are looked at first, as balls too: most of the time they are near to nothing.
        """
        known, radii = capsule_groups(self.shape), self.shape.radii
        hands = [np.array(own, np.intp) for own in (known.left, known.right)]
        others = np.array([*known.head, *known.trunk, *known.right], np.intp)
        starts, axes = self.starts - self.starts[0].mean(axis=0), self.ends - self.starts
        middles, thick = starts + 0.5 * axes, radii.max(axis=1)
        reach = 0.5 * np.sqrt(_dot(axes, axes)) + thick
        whole = [_ball(middles[:, hand], reach[:, hand]) for hand in hands]
        balls, radius = (np.hstack([ball[k] for ball in whole]) for k in (0, 1))
        met = _meet(balls, radius, starts[:, others], axes[:, others], thick[others] + slack)
        met[:, 1, len(known.head) + len(known.trunk) :] = False  # the right hand and itself
        at, columns = np.flatnonzero(met.any(axis=(1, 2))), np.flatnonzero(met.any(axis=(0, 1)))
        own, others = np.concatenate(hands), others[columns]
        rows, box = np.ix_(at, own), np.ix_(at, others)
        near = _meet(middles[rows], reach[rows], starts[box], axes[box], thick[others] + slack)
        of_side = np.repeat([0, 1], [len(hands[0]), len(hands[1])])
        frames, i, j = np.nonzero(near & met[np.ix_(at, np.arange(2), columns)][:, of_side])
        frames, left, meeting = at[frames], of_side[i] == 0, columns[j] >= len(known.head) + len(known.trunk)
        i, j = own[i], others[j]
        apart = np.zeros((len(i), 3))
        if meeting.any():
            apart = (starts[:, hands[0]].mean(axis=1) - starts[:, hands[1]].mean(axis=1))[frames]
        return NearPairs(
            n_frames=len(starts),
            frames=frames,
            hands=np.column_stack([left, np.where(meeting, -1.0, ~left)]),
            meeting=meeting,
            gaps=starts[frames, i] - starts[frames, j],
            axes=(axes[frames, i], axes[frames, j]),
            radii=(radii[i], radii[j]),
            apart=apart,
        )

    def pressed(self) -> tuple[Float, Float]:
        """``hand_penetration`` where a hand lies in something, in a small part of the time: only what is ``near`` is looked
        at. Elsewhere the depth is some number not above 0, and the way means nothing.
        """
        return self.near().pressed()


def _ball(middles: Float, reach: Float) -> tuple[Float, Float]:
    """Middles (T, 1, 3) and radii (T, 1) of balls about balls (T, K, 3), (T, K); none about none."""
    if not middles.shape[1]:
        return np.zeros((len(middles), 1, 3)), np.full((len(middles), 1), -np.inf)
    whole = middles.mean(axis=1, keepdims=True)
    away = middles - whole
    return whole, (np.sqrt(_dot(away, away)) + reach).max(axis=1, keepdims=True)


def _meet(middles: Float, reach: Float, starts: Float, axes: Float, thick: Float) -> NDArray[np.bool_]:
    """Whether balls, middles (T, A, 3) and radii (T, A), meet capsules, starts and axes (T, B, 3) and radii (B,):
    (T, A, B).
    """
    # Squares of distances by products of matrices: few numbers on the way.
    over = axes.transpose(0, 2, 1)
    squares = _dot(axes, axes)[:, None] + _TINY
    along = middles @ over - _dot(starts, axes)[:, None]
    share = np.clip(along / squares, 0.0, 1.0)
    away = (
        _dot(middles, middles)[:, :, None] + _dot(starts, starts)[:, None] - 2.0 * middles @ starts.transpose(0, 2, 1)
    )
    return np.asarray(away - share * (2.0 * along - share * squares) < np.maximum(reach[:, :, None] + thick, 0.0) ** 2)


@dataclass(frozen=True, eq=False)
class NearPairs:
    """K pairs of capsules that lie near one another, each of a hand and of what it must not lie in, over some frames.

    frames (K,). hands (K, 2): how a pair's gap follows the left and the right hand; of two hands 1 and -1.
    meeting (K,): whether it is of two hands. gaps (K, 3): from the start of what is near to that of the hand's capsule;
    axes and radii of both, (K, 3) and (K, 2). apart (K, 3): from the right to the left hand.
    """

    n_frames: int
    frames: NDArray[np.intp]
    hands: Float
    meeting: NDArray[np.bool_]
    gaps: Float
    axes: tuple[Float, Float]
    radii: tuple[Float, Float]
    apart: Float

    def pressed(self, moves: Float | None = None) -> tuple[Float, Float]:
        """How deep (T, 2) each hand lies in something, and the way out (T, 2, 3), with the hands moved by ``moves`` (T,
        2, 3); as ``Capsules.pressed``.
        """
        depth, way = np.full((self.n_frames, 2), -np.inf), np.zeros((self.n_frames, 2, 3))
        if not len(self.frames):
            return depth, way
        gaps = self.gaps
        moved = None if moves is None else _dot_rows(self.hands, moves[self.frames])
        if moved is not None:
            gaps = gaps + moved
        depths, ways = _penetration(gaps, *self.axes, *self.radii)
        both = self.meeting
        if both.any():
            apart = self.apart[both] if moved is None else self.apart[both] + moved[both]
            across = ways[both] + _APART * apart / (np.linalg.norm(apart, axis=-1, keepdims=True) + _TINY)
            ways[both] = across / (np.linalg.norm(across, axis=-1, keepdims=True) + _TINY)
        deeper = np.argsort(depths, kind="stable")
        for side in (0, 1):
            own = deeper[self.hands[deeper, side] != 0.0]  # of a frame's several the last one stays: the deepest
            depth[self.frames[own], side] = depths[own]
            way[self.frames[own], side] = ways[own] * self.hands[own, side, None]
        return depth, way


def _dot_rows(weights: Float, rows: Float) -> Float:
    """Sums (K, 3) of rows (K, S, 3), each times its weight (K, S)."""
    return np.asarray((weights[:, :, None] * rows).sum(axis=1))


def posed_capsules(skeleton: Skeleton, global_rotations: Float, global_positions: Float) -> PosedCapsules:
    """A skeleton's capsules, from the globals of ``kinematics.forward`` for all joints."""
    shape = known_capsules(skeleton)
    return PosedCapsules(shape, *capsule_ends(shape, global_rotations, global_positions))


@lru_cache(maxsize=64)
def known_capsules(skeleton: Skeleton) -> BodyCapsules:
    """The body of a skeleton, remembered."""
    return body_capsules(skeleton)


def overlap(starts: Float, ends: Float, radii: Float, a: Sequence[int], b: Sequence[int]) -> tuple[Float, Float]:
    """How deep (T, A, B) capsules ``a`` lie in capsules ``b`` (negative: how far apart), and the unit way (T, A, B, 3)
    along which each of ``a`` would leave.

    starts, ends: (T, C, 3) from ``body.place``; radii (C, 2). The nearest points of the two axes (Ericson 2005, 5.1.9)
    with the radii there; exact for capsules of one thickness, within the taper's slope for others.
    """
    rows, columns = np.asarray(a, np.intp), np.asarray(b, np.intp)
    p, q = starts[:, rows, None], starts[:, None, columns]
    u, v = ends[:, rows, None] - p, ends[:, None, columns] - q
    return _penetration(p - q, u, v, radii[rows, None], radii[columns])


def _penetration(r: Float, u: Float, v: Float, one: Float, two: Float) -> tuple[Float, Float]:
    """How deep (...) capsules with axes u lie in those with axes v (..., 3), which start r (..., 3) from one another,
    and the unit ways out (..., 3); radii (..., 2).
    """
    uu, vv, uv = _dot(u, u) + _TINY, _dot(v, v) + _TINY, _dot(u, v)
    ur, vr = _dot(u, r), _dot(v, r)
    s = np.clip((uv * vr - ur * vv) / np.maximum(uu * vv - uv * uv, _TINY), 0.0, 1.0)
    t = np.clip((uv * s + vr) / vv, 0.0, 1.0)
    s = np.clip((uv * t - ur) / uu, 0.0, 1.0)
    way = r + s[..., None] * u - t[..., None] * v
    distance = np.sqrt(_dot(way, way)) + _TINY
    thick = one[..., 0] + s * (one[..., 1] - one[..., 0]) + two[..., 0] + t * (two[..., 1] - two[..., 0])
    return thick - distance, way / distance[..., None]


def _dot(a: Float, b: Float) -> Float:
    return np.asarray(np.einsum("...c,...c->...", a, b))
