"""Skin distances within one body: between hands, and from hands and forearms to head, trunk and arms;
and contacts as events: from when to when a hand touches head, trunk, arm or the other hand.

Two bodies of the same roles have the same capsules by key, so that a distance on one has its counterpart on the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import ARM, BodyCapsules
from signsplice.motion.arrays import FloatArray
from signsplice.rig.roles import SIDES

Index = NDArray[np.intp]

TINY = 1e-12


@dataclass(frozen=True, eq=False)
class _Block:
    """All pairs of some capsules with others: rows of a body's capsules, (A,) and (B,)."""

    own: Index
    other: Index


@dataclass(frozen=True, eq=False)
class SkinPairs:
    """Pairs of capsules whose distance matters, as rows of a body's capsules.

    own, other: (K,) of each pair; ``own`` is of a hand or forearm.
    own_side: (K,) 0 where ``own`` is of the left arm, 1 of the right.
    other_side: (K,) likewise of ``other``; -1 where it is of head or trunk, which do not move with a wrist.
    blocks: the same pairs as products: all of one hand, or one forearm, with all that it may meet.
    """

    own: Index
    other: Index
    own_side: Index
    other_side: Index
    blocks: tuple[_Block, ...]


@dataclass(frozen=True, eq=False)
class Near:
    """Pairs of capsules that are near one another at some frames.

    frames, k: (N,) in order of frames.
    distance: (N,) from skin to skin at the source, m.
    """

    frames: Index
    k: Index
    distance: FloatArray


def skin_pairs(body: BodyCapsules, keys: frozenset[str]) -> SkinPairs:
    """All pairs of a hand's capsules and those of head, neck, trunk, other arm and other hand, among these keys."""
    hands, arms, solid = _parts(body, keys)
    blocks = [(hands[side], [*solid, *arms[1 - side]]) for side in (0, 1)]
    return _paired(body, [*blocks, (hands[0], hands[1])])


def forearm_pairs(body: BodyCapsules, keys: frozenset[str]) -> SkinPairs:
    """All pairs of a forearm and a capsule of head, neck, trunk, but where arms begin, or the other arm, among these
    keys.
    """
    _, arms, solid = _parts(body, keys)
    free = [n for n in solid if n in body.groups.head or n in body.groups.below_arms]
    return _paired(
        body,
        [([n for n in arms[side] if body.parts[n] == "cuff"], [*free, *arms[1 - side]]) for side in (0, 1)],
    )


def _parts(body: BodyCapsules, keys: frozenset[str]) -> tuple[list[list[int]], list[list[int]], list[int]]:
    """Rows of both hands, of both arms, and of head, neck and trunk."""
    groups = body.groups
    hands = [[n for n in group if body.keys[n] in keys] for group in (groups.left, groups.right)]
    solid = [n for n in (*groups.head, *groups.trunk) if body.keys[n] in keys]
    arms = [
        [n for n, key in enumerate(body.keys) if key in keys and body.sides[n] == side and body.parts[n] in ARM]
        for side in SIDES
    ]
    return hands, arms, solid


def _paired(body: BodyCapsules, blocks: list[tuple[list[int], list[int]]]) -> SkinPairs:
    side = np.array([SIDES.index(side) if side else -1 for side in body.sides], np.intp)
    rows = [_Block(np.array(own, np.intp), np.array(other, np.intp)) for own, other in blocks]
    own = np.concatenate([np.repeat(block.own, len(block.other)) for block in rows])
    other = np.concatenate([np.tile(block.other, len(block.own)) for block in rows])
    return SkinPairs(own, other, side[own], side[other], tuple(rows))


def near_pairs(
    starts: FloatArray, ends: FloatArray, radii: FloatArray, pairs: SkinPairs, margin: float
) -> tuple[Index, Index]:
    """Frames and pairs (N,), in order of frames, that may be nearer than ``margin``, from capsule ends (T, C, 3) and
    radii (C, 2): first by a ball around each whole hand or forearm, then by one around each of its capsules.
    """
    axes = ends - starts
    lengths, thick, middles = dot(axes, axes), radii.max(axis=1), starts + 0.5 * axes
    reach = 0.5 * np.sqrt(lengths.max(axis=0)) + thick
    found, offset = [], 0
    for block in pairs.blocks:
        n_own, n_other = len(block.own), len(block.other)
        if n_own and n_other:
            ball = middles[:, block.own].mean(axis=1, keepdims=True)
            out = middles[:, block.own] - ball
            radius = (np.sqrt(dot(out, out)) + reach[block.own]).max(axis=1, keepdims=True)
            b = block.other
            away = squared_distance(ball, starts[:, b], axes[:, b], lengths[:, b])
            frames, columns = np.nonzero(away < (radius + thick[b] + margin) ** 2)
            rows = frames * len(radii)
            at, own = rows[:, None] + b[columns, None], rows[:, None] + block.own
            away = squared_distance(
                _take(middles, own), _take(starts, at), _take(axes, at), lengths.reshape(-1).take(at)
            )
            most = reach[block.own] + thick[b[columns], None] + margin
            near, a = np.nonzero(away < most * most)
            found.append((frames[near], offset + a * n_other + columns[near]))
        offset += n_own * n_other
    frames, k = (np.concatenate([one[part] for one in found] or [np.empty(0, np.intp)]) for part in (0, 1))
    order = np.argsort(frames, kind="stable")
    return frames[order], k[order]


def _take(points: FloatArray, at: Index) -> FloatArray:
    """Rows (..., 3) of points (T, C, 3) by their flat index."""
    return points.reshape(-1, 3).take(at, axis=0)


def squared_distance(point: FloatArray, start: FloatArray, axis: FloatArray, length: FloatArray) -> FloatArray:
    """Squared distance of points from line segments (..., 3) with axes of squared ``length`` (...)."""
    away = point - start
    along = np.clip(dot(away, axis) / (length + TINY), 0.0, 1.0)
    away = away - along[..., None] * axis
    return dot(away, away)


@dataclass(frozen=True, eq=False)
class Clearances:
    """Skin distances of pairs of capsules.

    distance: (...) from skin to skin; negative inside.
    normals: (..., 3) unit vectors from the other capsule to the own one.
    own_at, other_at: (...) where along each axis the nearest points lie, 0 to 1.
    """

    distance: FloatArray
    normals: FloatArray
    own_at: FloatArray
    other_at: FloatArray


def clearances(
    r: FloatArray, u: FloatArray, v: FloatArray, own_radii: FloatArray, other_radii: FloatArray
) -> Clearances:
    """Skin distances of capsules with axes u from those with axes v (..., 3), which start r (..., 3) from one another;
    radii (..., 2). From the nearest points of the two axes (Ericson 2005, 5.1.9) with the radii there: exact for
    capsules of one thickness, within the taper's slope for others.
    """
    uu, vv, uv = dot(u, u) + TINY, dot(v, v) + TINY, dot(u, v)
    ur, vr = dot(u, r), dot(v, r)
    s = np.clip((uv * vr - ur * vv) / np.maximum(uu * vv - uv * uv, TINY), 0.0, 1.0)
    t = np.clip((uv * s + vr) / vv, 0.0, 1.0)
    s = np.clip((uv * t - ur) / uu, 0.0, 1.0)
    line = r + s[..., None] * u - t[..., None] * v
    away = np.sqrt(dot(line, line)) + TINY
    thick = own_radii[..., 0] + s * (own_radii[..., 1] - own_radii[..., 0])
    thick = thick + other_radii[..., 0] + t * (other_radii[..., 1] - other_radii[..., 0])
    return Clearances(away - thick, line / away[..., None], s, t)


def pair_clearances(
    starts: FloatArray, ends: FloatArray, radii: FloatArray, pairs: SkinPairs, frames: Index, k: Index
) -> Clearances:
    """Skin distances of the pairs ``k`` (N,) at ``frames`` (N,), from capsule ends (T, C, 3) and radii (C, 2)."""
    own, other, rows = pairs.own[k], pairs.other[k], frames * len(radii)
    p, q = _take(starts, rows + own), _take(starts, rows + other)
    u, v = _take(ends, rows + own) - p, _take(ends, rows + other) - q
    return clearances(p - q, u, v, radii[own], radii[other])


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Dot products (...) of vectors (..., 3)."""
    return np.asarray(np.einsum("...c,...c->...", a, b))


TOUCH_M, PART_M = 0.005, 0.012
"""A contact begins where skins are nearer than the first and ends where they are farther apart than the second, m."""
KEPT_M = 0.005
"""A contact is kept where its distance changes by less than this, m."""
PRESS_M = 0.002
"""Pressing deeper than this, m, need not be kept: skin gives, capsules do not."""
REGIONS = ("head", "neck", "trunk", "arm", "hand")
"""What a hand touches; the last two are those of the other side."""
_SHORTEST, _HOLE = 2, 3
"""Frames that a contact lasts at least; and gaps between two contacts that count as none."""


@dataclass(frozen=True)
class Contact:
    """A contact of one hand.

    hand: "left" or "right"; "right" where both hands meet.
    region: one of ``REGIONS``.
    frames: first frame and end, half-open, of the clip before it was placed or resampled.
    before_mm, after_mm: median skin distance at the source and on the other body, mm; negative inside.
    is_kept: whether that is the same within ``KEPT_M``; where it lies deep at the source, it may lie less deep.
    """

    hand: str
    region: str
    frames: tuple[int, int]
    before_mm: float
    after_mm: float
    is_kept: bool


def find_contacts(
    body: BodyCapsules, pairs: SkinPairs, near: Near, after: FloatArray, n_frames: int
) -> tuple[Contact, ...]:
    """The contacts of a clip of ``n_frames``, in order.

    near: all pairs that are nearer than ``PART_M`` at the source; after: (N,) their distances on the other body, m.
    """
    frames, k, before = near.frames, near.k, near.distance
    region = np.array([_region(body, row) for row in range(len(body.keys))], np.intp)[pairs.other[k]]
    side = np.where(region == REGIONS.index("hand"), 1, pairs.own_side[k])
    tables = np.full((2, n_frames, 2, len(REGIONS)), np.inf)
    for table, distance in zip(tables, (before, after), strict=True):
        np.minimum.at(table, (frames, side, region), distance)
    found = []
    for n_hand, hand in enumerate(SIDES):
        for n, name in enumerate(REGIONS):
            for start, stop in _events(tables[0, :, n_hand, n]):
                then, now = (_median(table[start:stop, n_hand, n]) for table in tables)
                is_kept = then - KEPT_M < now < max(then, -PRESS_M) + KEPT_M
                found.append(Contact(hand, name, (start, stop), round(1e3 * then, 1), round(1e3 * now, 1), is_kept))
    return tuple(sorted(found, key=lambda one: one.frames))


def _median(distance: FloatArray) -> float:
    return float(np.median(distance[np.isfinite(distance)]))


def _region(body: BodyCapsules, row: int) -> int:
    if body.sides[row]:
        return REGIONS.index("arm" if body.parts[row] in ("sleeve", "cuff") else "hand")
    return REGIONS.index({"shirt": "trunk", "neck": "neck"}.get(body.parts[row], "head"))


def _events(distance: FloatArray) -> list[tuple[int, int]]:
    """Half-open ranges of frames in which a distance (T,) is that of a contact."""
    touching = np.zeros(len(distance), bool)
    is_touching = False
    for frame, value in enumerate(distance.tolist()):
        is_touching = value < (PART_M if is_touching else TOUCH_M)
        touching[frame] = is_touching
    edges = np.flatnonzero(np.diff(np.r_[False, touching, False].astype(int))).tolist()
    events: list[tuple[int, int]] = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if events and start - events[-1][1] <= _HOLE:
            events[-1] = (events[-1][0], stop)
        else:
            events.append((start, stop))
    return [(start, stop) for start, stop in events if stop - start >= _SHORTEST]
