"""Skin distances within one body: between hands, and from hands and forearms to head, trunk and arms.

Two bodies of the same roles have the same capsules by key, so that a distance on one has its counterpart on the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import BodyCapsules

Float = NDArray[np.float64]
Index = NDArray[np.intp]

_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class SkinPairs:
    """Pairs of capsules whose distance matters, as rows of a body's capsules.

    own, other: (K,) of each pair; ``own`` is of a hand or forearm.
    own_side: (K,) 0 where ``own`` is of the left arm, 1 of the right.
    other_side: (K,) likewise of ``other``; -1 where it is of head or trunk, which do not move with a wrist.
    """

    own: Index
    other: Index
    own_side: Index
    other_side: Index


def skin_pairs(body: BodyCapsules, keys: frozenset[str], forearms: bool = False) -> SkinPairs:
    """All pairs of a body among capsules with these keys: hand and head, neck, trunk, other hand or other arm; with
    ``forearms``, forearm and head, neck or trunk too.
    """
    rows = [n for n, key in enumerate(body.keys) if key in keys]
    groups = body.groups
    hands = [[n for n in group if n in rows] for group in (groups.left, groups.right)]
    solid = [n for n in (*groups.head, *groups.trunk) if n in rows]
    arms = [[n for n in rows if body.sides[n] == side and body.parts[n] in ("sleeve", "cuff")] for side in _SIDES]
    cuffs = [[n for n in arm if forearms and body.parts[n] == "cuff"] for arm in arms]
    found: list[tuple[int, int, int, int]] = []
    for side in (0, 1):
        found += [(a, b, side, -1) for a in hands[side] for b in solid]
        found += [(a, b, side, 1 - side) for a in hands[side] for b in arms[1 - side]]
        found += [(a, b, side, -1) for a in cuffs[side] for b in solid if not _joined(body, b)]
    found += [(a, b, 0, 1) for a in hands[0] for b in hands[1]]
    return SkinPairs(*np.array(found, np.intp).reshape(-1, 4).T)


_SIDES = ("left", "right")


def _joined(body: BodyCapsules, row: int) -> bool:
    """Whether a capsule lies where the arms begin: a forearm folded against its own upper arm may meet it."""
    return body.keys[row].endswith("Shoulder") or body.keys[row].startswith("collar")


def may_be_near(starts: Float, ends: Float, radii: Float, pairs: SkinPairs, margin: float) -> NDArray[np.bool_]:
    """Whether the balls around each pair's capsules are nearer than ``margin`` (T, K), from capsule ends (T, C, 3)."""
    middles, axes = 0.5 * (starts + ends), ends - starts
    reach = 0.5 * np.sqrt(np.einsum("tcx,tcx->tc", axes, axes).max(axis=0)) + radii.max(axis=1) + 0.5 * margin
    middles = middles - middles.mean(axis=(0, 1))
    squares = np.einsum("tcx,tcx->tc", middles, middles)
    away = squares[:, :, None] + squares[:, None] - 2.0 * middles @ middles.transpose(0, 2, 1)
    near = away < (reach[:, None] + reach) ** 2
    return np.asarray(near[:, pairs.own, pairs.other])


@dataclass(frozen=True, eq=False)
class Gaps:
    """Skin distances of N pairs at some frames.

    distance: (N,) from skin to skin; negative inside.
    normals: (N, 3) unit vectors from the other capsule to the own one.
    own_at, other_at: (N,) where along each axis the nearest points lie, 0 to 1.
    """

    distance: Float
    normals: Float
    own_at: Float
    other_at: Float


def gaps(p: Float, u: Float, q: Float, v: Float, own_radii: Float, other_radii: Float) -> Gaps:
    """Skin distances of capsules: starts p, q and axes u, v (N, 3), radii (N, 2) (Ericson 2005, 5.1.9)."""
    r = p - q
    uu, vv, uv = _dot(u, u) + _TINY, _dot(v, v) + _TINY, _dot(u, v)
    ur, vr = _dot(u, r), _dot(v, r)
    s = np.clip((uv * vr - ur * vv) / np.maximum(uu * vv - uv * uv, _TINY), 0.0, 1.0)
    t = np.clip((uv * s + vr) / vv, 0.0, 1.0)
    s = np.clip((uv * t - ur) / uu, 0.0, 1.0)
    line = r + s[:, None] * u - t[:, None] * v
    away = np.sqrt(_dot(line, line)) + _TINY
    thick = own_radii[:, 0] + s * (own_radii[:, 1] - own_radii[:, 0])
    thick = thick + other_radii[:, 0] + t * (other_radii[:, 1] - other_radii[:, 0])
    return Gaps(away - thick, line / away[:, None], s, t)


def pair_gaps(starts: Float, ends: Float, radii: Float, pairs: SkinPairs, frames: Index, k: Index) -> Gaps:
    """Skin distances of the pairs ``k`` (N,) at ``frames`` (N,), from capsule ends (T, C, 3) and radii (C, 2)."""
    own, other = pairs.own[k], pairs.other[k]
    p, q = starts[frames, own], starts[frames, other]
    return gaps(p, ends[frames, own] - p, q, ends[frames, other] - q, radii[own], radii[other])


def _dot(a: Float, b: Float) -> Float:
    return np.asarray(np.einsum("nc,nc->n", a, b))
