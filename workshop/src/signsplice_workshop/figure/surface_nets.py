"""The surface of a solid from its distance field, as triangles.

Naive surface nets (Gibson 1998): a vertex in every grid cell that the surface crosses, a quad across every grid edge
that it crosses; then every vertex moves onto the surface along the field's gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import FloatArray

Field = Callable[[FloatArray], FloatArray]
"""Points (N, 3) -> their distances from the solid (N,), negative inside."""

_CHUNK = 4_096
"""Number of points at a time: a field's intermediate arrays stay in the processor's cache."""
_COARSE = 4
"""Grid steps along the edge of a coarse cell."""
_N_PROJECTIONS = 2
"""Number of steps that move a vertex onto the surface."""


def surface(
    field: Field, low: FloatArray, high: FloatArray, step: float
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Returns vertices (V, 3), outward unit normals (V, 3) and triangles (F, 3), counter-clockwise seen from outside.

    low, high (3,): corners of a box around the whole surface. step: of the grid, in the same unit. Raises
    ``ValueError`` if the box holds no surface.
    """
    field = _in_chunks(field)
    origin = np.asarray(low, np.float64) - step
    counts = (np.ceil((np.asarray(high) - origin) / (_COARSE * step)).astype(int) + 1) * _COARSE + 1
    values = _sample_field(field, origin, counts, step)
    inside = values < 0.0
    corners = [inside[_corner_slices(shift, inside.shape)] for shift in product((0, 1), repeat=3)]
    crossed = np.any(corners, axis=0) & ~np.all(corners, axis=0)
    cells = np.argwhere(crossed)
    if not len(cells):
        raise ValueError(f"no surface between {low} and {high}")
    vertex_of_cell = np.full(crossed.shape, -1)
    vertex_of_cell[tuple(cells.T)] = np.arange(len(cells))
    vertices = origin + step * (cells + _crossing_means(values, cells))
    triangles = _triangles(inside, vertex_of_cell)
    for _ in range(_N_PROJECTIONS):
        distances = field(vertices)
        slopes = [field(vertices + move) - distances for move in 0.05 * step * np.eye(3)]
        vertices = vertices - np.clip(distances, -step, step)[:, None] * _unit(np.stack(slopes, axis=-1))
    return vertices, _gradient(field, vertices, 0.05 * step), triangles


def _in_chunks(field: Field) -> Field:
    """Returns the field, evaluated for a limited number of points at a time."""

    def evaluate_chunks(points: FloatArray) -> FloatArray:
        return np.concatenate([field(points[n : n + _CHUNK]) for n in range(0, max(len(points), 1), _CHUNK)])

    return evaluate_chunks


def _corner_slices(shift: tuple[int, ...], shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Returns the slices that select one corner of every cell: ``shift`` 0 or 1 of each axis."""
    return tuple(slice(s, n - 1 + s) for s, n in zip(shift, shape, strict=True))


def _sample_field(field: Field, origin: FloatArray, counts: NDArray[np.int_], step: float) -> FloatArray:
    """Returns the field on a grid; exact close to the surface, elsewhere infinite, with its sign."""
    coarse = [np.arange(0, n, _COARSE) for n in counts]
    rough = _values(field, origin, coarse, step)
    reach = 0.5 * np.sqrt(3.0) * _COARSE * step  # from a point of a cell to the nearest corner, at most
    is_close = np.abs(rough) < reach
    near_cells = np.zeros_like(is_close)
    for shift in product((0, 1), repeat=3):  # cells with a corner close to the surface
        near_cells[:-1, :-1, :-1] |= is_close[_corner_slices(shift, is_close.shape)]
    values = np.full(tuple(counts), np.inf)
    for i, j, k in np.argwhere(near_cells):
        values[_coarse_slices(i, j, k)] = 0.0
    todo = np.argwhere(values == 0.0)
    values[tuple(todo.T)] = field(origin + step * todo)
    # Whole coarse cells without surface: the rough field shows which are inside.
    for i, j, k in np.argwhere(~near_cells & (rough < 0.0)):
        box = _coarse_slices(i, j, k)
        values[box] = np.where(np.isinf(values[box]), -np.inf, values[box])
    return values


def _coarse_slices(i: int, j: int, k: int) -> tuple[slice, slice, slice]:
    """Returns the slices of a coarse cell's points, far sides included."""
    first, second, third = (slice(_COARSE * n, _COARSE * n + _COARSE + 1) for n in (i, j, k))
    return first, second, third


def _values(field: Field, origin: FloatArray, axes: list[NDArray[np.int_]], step: float) -> FloatArray:
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return field(origin + step * grid.reshape(-1, 3)).reshape(grid.shape[:3])


def _crossing_means(values: FloatArray, cells: NDArray[np.int_]) -> FloatArray:
    """Returns the place of the surface in each cell (C, 3): the mean of its crossings of the cell's edges, 0 to 1."""
    sums, counts = np.zeros((len(cells), 3)), np.zeros((len(cells), 1))
    for axis in range(3):
        other_axes = [k for k in range(3) if k != axis]
        for shift in product((0, 1), repeat=2):
            start = cells.copy()
            start[:, other_axes] += shift
            end = start.copy()
            end[:, axis] += 1
            a, b = values[tuple(start.T)], values[tuple(end.T)]
            hit = (a < 0.0) != (b < 0.0)
            alpha = np.full(len(cells), 0.5)
            np.divide(a, a - b, out=alpha, where=hit & np.isfinite(a) & np.isfinite(b))
            point = np.zeros((len(cells), 3))
            point[:, other_axes] = shift
            point[:, axis] = alpha
            sums[hit] += point[hit]
            counts[hit] += 1.0
    return sums / counts


def _triangles(inside: NDArray[np.bool_], vertex_of_cell: NDArray[np.int_]) -> NDArray[np.int64]:
    """Returns triangles (F, 3) of vertex numbers, two for every grid edge whose ends lie on different sides of the
    surface: their corners are the vertices of the four cells around it. ``vertex_of_cell``: -1 for cells without one.
    """
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ends = [slice(None)] * 3, [slice(None)] * 3
        ends[0][axis], ends[1][axis] = slice(None, -1), slice(1, None)
        first, second = inside[tuple(ends[0])], inside[tuple(ends[1])]
        edges = np.argwhere(first != second)
        leaves = first[tuple(edges.T)]  # from inside to outside along the axis

        def cell(du: int, dv: int, edges: NDArray[np.int_] = edges, u: int = u, v: int = v) -> NDArray[np.int_]:
            cells = edges.copy()
            cells[:, u] -= du
            cells[:, v] -= dv
            return np.asarray(vertex_of_cell[tuple(cells.T)])

        a, b, c, d = cell(1, 1), cell(0, 1), cell(0, 0), cell(1, 0)
        abc, acd = np.stack([a, b, c], -1), np.stack([a, c, d], -1)
        quads = np.where(leaves[:, None, None], np.stack([abc, acd], 1), np.stack([abc[:, ::-1], acd[:, ::-1]], 1))
        faces.append(quads.reshape(-1, 3))
    return np.concatenate(faces)


def _gradient(field: Field, points: FloatArray, step: float) -> FloatArray:
    """Returns unit gradients (N, 3) by central differences."""
    moves = step * np.eye(3)
    slopes = np.stack([field(points + move) - field(points - move) for move in moves], axis=-1)
    return _unit(slopes)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-300))
