"""The surface of a solid given by a distance field, as triangles.

Naive surface nets (Gibson 1998): a vertex in every grid cell that the surface crosses, a quad across every grid edge
that it crosses; then every vertex is moved onto the surface along the field's gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import FloatArray

Field = Callable[[FloatArray], FloatArray]
"""Points (N, 3) -> how far they lie outside (N,), negative inside."""

_BLOCK = 4_096
"""Points at a time: what a field computes for them stays in the processor's cache."""
_COARSE = 4
_N_PROJECTIONS = 2
"""Steps by which a vertex is moved onto the surface."""


def surface(
    field: Field, low: FloatArray, high: FloatArray, step: float
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Vertices (V, 3), unit normals outwards (V, 3) and triangles (F, 3), counter-clockwise seen from outside.

    low, high (3,): corners of a box that holds the whole surface. step: the grid's, in the same unit. Raises
    ``ValueError`` where the box holds no surface.
    """
    field = _in_blocks(field)
    origin = np.asarray(low, np.float64) - step
    counts = (np.ceil((np.asarray(high) - origin) / (_COARSE * step)).astype(int) + 1) * _COARSE + 1
    values = _sample_field(field, origin, counts, step)
    inside = values < 0.0
    corners = [inside[_corner_slices(shift, inside.shape)] for shift in product((0, 1), repeat=3)]
    crossed = np.any(corners, axis=0) & ~np.all(corners, axis=0)
    cells = np.argwhere(crossed)
    if not len(cells):
        raise ValueError(f"no surface between {low} and {high}")
    numbers = np.full(crossed.shape, -1)
    numbers[tuple(cells.T)] = np.arange(len(cells))
    vertices = origin + step * (cells + _within(values, cells))
    triangles = _triangles(inside, numbers)
    for _ in range(_N_PROJECTIONS):
        here = field(vertices)
        slopes = [field(vertices + move) - here for move in 0.05 * step * np.eye(3)]
        vertices = vertices - np.clip(here, -step, step)[:, None] * _unit(np.stack(slopes, axis=-1))
    return vertices, _gradient(field, vertices, 0.05 * step), triangles


def _in_blocks(field: Field) -> Field:
    """The same field, evaluated for a limited number of points at a time."""

    def evaluate_blocks(points: FloatArray) -> FloatArray:
        return np.concatenate([field(points[at : at + _BLOCK]) for at in range(0, max(len(points), 1), _BLOCK)])

    return evaluate_blocks


def _corner_slices(shift: tuple[int, ...], shape: tuple[int, ...]) -> tuple[slice, ...]:
    """The corners of all cells that lie at one end of each axis."""
    return tuple(slice(s, n - 1 + s) for s, n in zip(shift, shape, strict=True))


def _sample_field(field: Field, origin: FloatArray, counts: NDArray[np.int_], step: float) -> FloatArray:
    """The field on a grid; exact near the surface, elsewhere only its sign."""
    coarse = [np.arange(0, n, _COARSE) for n in counts]
    rough = _values(field, origin, coarse, step)
    reach = 0.5 * np.sqrt(3.0) * _COARSE * step  # from a point of a cell to the nearest corner, at most
    near = np.abs(rough) < reach
    wide = np.zeros_like(near)
    for shift in product((0, 1), repeat=3):  # cells with any corner near
        wide[:-1, :-1, :-1] |= near[_corner_slices(shift, near.shape)]
    values = np.full(tuple(counts), np.inf)
    for i, j, k in np.argwhere(wide):
        values[_block(i, j, k)] = 0.0
    todo = np.argwhere(values == 0.0)
    values[tuple(todo.T)] = field(origin + step * todo)
    # Whole blocks without surface: the rough field shows which are inside.
    for i, j, k in np.argwhere(~wide & (rough < 0.0)):
        box = _block(i, j, k)
        values[box] = np.where(np.isinf(values[box]), -np.inf, values[box])
    return values


def _block(i: int, j: int, k: int) -> tuple[slice, slice, slice]:
    """The points of a coarse cell, its far sides too."""
    first, second, third = (slice(_COARSE * at, _COARSE * at + _COARSE + 1) for at in (i, j, k))
    return first, second, third


def _values(field: Field, origin: FloatArray, axes: list[NDArray[np.int_]], step: float) -> FloatArray:
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return field(origin + step * grid.reshape(-1, 3)).reshape(grid.shape[:3])


def _within(values: FloatArray, cells: NDArray[np.int_]) -> FloatArray:
    """Where in each cell (C, 3) the surface lies: the mean of the points where it crosses the cell's edges, 0 to 1."""
    sums, counts = np.zeros((len(cells), 3)), np.zeros((len(cells), 1))
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for shift in product((0, 1), repeat=2):
            start = cells.copy()
            start[:, others] += shift
            end = start.copy()
            end[:, axis] += 1
            a, b = values[tuple(start.T)], values[tuple(end.T)]
            hit = (a < 0.0) != (b < 0.0)
            alpha = np.full(len(cells), 0.5)
            np.divide(a, a - b, out=alpha, where=hit & np.isfinite(a) & np.isfinite(b))
            point = np.zeros((len(cells), 3))
            point[:, others] = shift
            point[:, axis] = alpha
            sums[hit] += point[hit]
            counts[hit] += 1.0
    return sums / counts


def _triangles(inside: NDArray[np.bool_], numbers: NDArray[np.int_]) -> NDArray[np.int64]:
    """Two triangles across every edge of the grid whose ends lie on different sides, out of the cells around it."""
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ends = [slice(None)] * 3, [slice(None)] * 3
        ends[0][axis], ends[1][axis] = slice(None, -1), slice(1, None)
        first, second = inside[tuple(ends[0])], inside[tuple(ends[1])]
        at = np.argwhere(first != second)
        leaves = first[tuple(at.T)]  # from inside to outside along the axis

        def cell(du: int, dv: int, at: NDArray[np.int_] = at, u: int = u, v: int = v) -> NDArray[np.int_]:
            where = at.copy()
            where[:, u] -= du
            where[:, v] -= dv
            return np.asarray(numbers[tuple(where.T)])

        a, b, c, d = cell(1, 1), cell(0, 1), cell(0, 0), cell(1, 0)
        one, two = np.stack([a, b, c], -1), np.stack([a, c, d], -1)
        quads = np.where(leaves[:, None, None], np.stack([one, two], 1), np.stack([one[:, ::-1], two[:, ::-1]], 1))
        faces.append(quads.reshape(-1, 3))
    return np.concatenate(faces)


def _gradient(field: Field, points: FloatArray, step: float) -> FloatArray:
    """Unit gradients (N, 3) by central differences."""
    moves = step * np.eye(3)
    slopes = np.stack([field(points + move) - field(points - move) for move in moves], axis=-1)
    return _unit(slopes)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-300))
