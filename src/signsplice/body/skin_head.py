"""The capsules of an avatar's head, fitted to the vertices of its face and skull."""

from __future__ import annotations

import numpy as np

from signsplice.body.skin_points import MIN_POINTS, quantile
from signsplice.motion.arrays import FloatArray

_CHIN, _TOP, _WIDTH = -0.0092, 0.134, 0.045
"""Of the usual head about its joint, measured as here: heights of chin and top, half width of the face; fractions of
stature.
"""
_BALLS = {"face": 0, "chin": 1, "nose": 2, "skull": 3}
"""Rows of the capsules that are placed by rules of their own."""
_CELL = 0.006
"""Cell of the maps of front and back, as a fraction of stature."""
_LEAST = 10
"""How many times the fewest vertices a head needs."""
_FRONT, _JAW = 0.4, (0.6, 0.4)
"""How far in front the face begins, in depths of the nose; the jaw, likewise, and how wide it is, in those of the face.
"""
_WIDEST = 0.98
"""Share of the face's vertices that lie within its width."""
_TALL = (0.8, 1.3)
"""Least and largest height of a head in its width, both in those of the usual one."""
_PROFILE = (("chin", 0, 0.012), ("chin", 1, 0.012), ("face", 0, 0.012), ("face", 1, 0.02))
"""Balls that touch the face: capsule, which end, and how far above vertices count, as a fraction of stature."""
_BELOW, _BESIDE, _OPEN = 0.25, 0.6, 0.25
"""Vertices below a ball count as far as this part of those above; beside it, in half widths of the face; and how far
the back of a skull may lie in front of its usual place, in its radii.
"""
_NOSE = (0.15, 0.2, 0.6, 0.5)
"""Where the nose is: half width, in those of the face; from and to which height between chin and top; and how near
vertices are to its bridge, in its length.
"""
_N_BALLS, _GRAZING = 5, 0.3
"""Balls along a capsule, and the share of their squared radius that a vertex must see in front of it."""


def fit_head(starts: FloatArray, ends: FloatArray, radii: FloatArray, points: FloatArray, height: float) -> bool:
    """Fit the head's capsules in place: ``starts`` and ``ends`` (8, 3) and ``radii`` (8, 2) of the usual proportions,
    to vertices (N, 3) of the head, all about its joint. False where there are too few vertices.
    """
    if len(points) < _LEAST * MIN_POINTS:
        return False
    front, back = (_map(points, sign, _CELL * height) for sign in (1.0, -1.0))
    nose = float(front[:, 2].max())
    face = front[front[:, 2] > _FRONT * nose]
    wide = quantile(np.abs(face[:, 0]), _WIDEST) if len(face) else 0.0
    jaw = face[(face[:, 2] > _JAW[0] * nose) & (np.abs(face[:, 0]) < _JAW[1] * wide)]
    if len(jaw) < MIN_POINTS:
        return False
    chin, top = float(jaw[:, 1].min()), float(points[:, 1].max())
    x_scale = wide / (_WIDTH * height)
    y_scale = (top - chin) / ((_TOP - _CHIN) * height)
    y_scale = float(np.clip(y_scale, _TALL[0] * x_scale, _TALL[1] * x_scale))
    top = chin + y_scale * (_TOP - _CHIN) * height
    radii *= x_scale
    for part in (starts, ends):
        part[:, 0] *= x_scale
        part[:, 1] = chin + y_scale * (part[:, 1] - _CHIN * height)
        part[:, 2] *= x_scale
    starts[_BALLS["skull"], 1] = top - radii[_BALLS["skull"], 0]
    upper, lower, skull = (_BALLS[name] for name in ("face", "chin", "skull"))
    balls = [(part[row].copy(), float(radii[row, k])) for row in (upper, lower) for part, k in ((starts, 0), (ends, 1))]
    template = _between(balls[:2]) + _between(balls[2:])
    for name, end, half in _PROFILE:
        part, row = (starts, ends)[end], _BALLS[name]
        above = front[:, 1] - part[row, 1]  # less is wanted from below, where the surface of a chin recedes
        near = (above > -_BELOW * half * y_scale * height) & (above < half * y_scale * height)
        near &= np.abs(front[:, 0]) < _BESIDE * wide
        part[row, 2] += _offset(front[near], template, 1.0) or 0.0
    usual_middle, middle = (
        0.5 * (a + b) for a, b in ((balls[0][0][2], balls[1][0][2]), (starts[upper, 2], ends[upper, 2]))
    )
    balls = [(part[skull].copy(), float(radii[skull, k])) for k, part in enumerate((starts, ends))]
    found = _offset(back[np.abs(back[:, 0]) < _BESIDE * wide], _between(balls), -1.0)
    # A head that is open behind, under hair that does not count, has only the inside of its face there.
    is_open = found is None or found > middle - usual_middle + _OPEN * radii[skull, 0]
    for part in (starts, ends):
        part[skull, 2] += middle - usual_middle if is_open or found is None else found
    _place_nose(starts, ends, radii, front, (chin, top, wide))
    for row in range(_BALLS["skull"] + 1, len(starts)):  # eyes and mouth, drawn on the face
        for k, part in enumerate((starts, ends)):
            part[row, 2] = _surface(front, part[row], _CELL * height, part[row, 2] + radii[row, k]) - radii[row, k]
    return True


def _place_nose(
    starts: FloatArray, ends: FloatArray, radii: FloatArray, front: FloatArray, sizes: tuple[float, float, float]
) -> None:
    """Put the nose's capsule below the foremost point of the middle of the face."""
    chin, top, wide = sizes
    height_fraction = (front[:, 1] - chin) / (top - chin)
    beside, low, high, near = _NOSE
    middle = front[(np.abs(front[:, 0]) < beside * wide) & (height_fraction > low) & (height_fraction < high)]
    row = _BALLS["nose"]
    if not len(middle):
        return
    tip = middle[int(np.argmax(middle[:, 2]))]
    rise = starts[row, 1] - ends[row, 1]
    ends[row] = 0.0, tip[1], tip[2] - radii[row, 1]
    bridge = middle[np.abs(middle[:, 1] - tip[1] - rise) < near * rise]
    starts[row] = 0.0, tip[1] + rise, (float(bridge[:, 2].max()) if len(bridge) else tip[2]) - radii[row, 0]


def _map(points: FloatArray, sign: float, cell: float) -> FloatArray:
    """Of the points (N, 3) in each square cell of the plane of x and y, the one that lies farthest in front, or behind
    with ``sign`` -1.
    """
    order = np.argsort(-sign * points[:, 2], kind="stable")
    _, first = np.unique(np.floor(points[order, :2] / cell).astype(np.int64), axis=0, return_index=True)
    return points[order[first]]


def _between(balls: list[tuple[FloatArray, float]]) -> list[tuple[FloatArray, float]]:
    """Middles and radii of balls from the first to the last of two."""
    (a, r), (b, q) = balls
    return [(a + t * (b - a), r + t * (q - r)) for t in np.linspace(0.0, 1.0, _N_BALLS)]


def _offset(surface: FloatArray, balls: list[tuple[FloatArray, float]], sign: float) -> float | None:
    """The median distance in z by which a surface (N, 3) lies beyond the outermost of some balls, seen from in front,
    or from behind with ``sign`` -1; None where they do not overlap.
    """
    outer = np.full(len(surface), -np.inf)
    for middle, radius in balls:
        squared = radius**2 - ((surface[:, :2] - middle[:2]) ** 2).sum(axis=1)
        near = squared > _GRAZING * radius**2
        outer[near] = np.maximum(outer[near], sign * middle[2] + np.sqrt(squared[near]))
    met = np.isfinite(outer)
    if met.sum() < MIN_POINTS:
        return None
    return sign * quantile(sign * surface[met, 2] - outer[met], 0.5)


def _surface(front: FloatArray, at: FloatArray, cell: float, otherwise: float) -> float:
    """The z of the front at a place; ``otherwise`` where no vertex is near."""
    near = front[np.abs(front[:, :2] - at[:2]).max(axis=1) < 1.5 * cell]
    return float(near[:, 2].max()) if len(near) else otherwise
