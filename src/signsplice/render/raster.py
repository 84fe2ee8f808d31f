"""A z-buffer of shaded triangles, seen straight on (orthographic)."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.float32]

Indices = NDArray[np.intp]

_LIGHT = np.array([-0.45, 0.62, 0.78], np.float32) / np.float32(np.linalg.norm([-0.45, 0.62, 0.78]))
_AMBIENT, _DIFFUSE, _RIM = 0.50, 0.52, 0.10
_BOXES = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 64, 128, 512, 4096)
"""Triangles whose boxes are about as large are drawn together, pixels."""
_AT_ONCE = 1 << 21
"""Pixels that are looked at in one go."""
_EDGE = np.float32(-1e-4)
"""So little outside of a triangle is in it: no gap is left between two."""


@dataclass(eq=False)
class Canvas:
    """A picture in the making: colour (H, W, 3) 0..1, depth (H, W) towards the viewer, and which group each pixel
    shows: -1 nothing, 0 what needs no outline where it meets something at one depth.
    """

    width: int
    height: int
    background: tuple[float, float, float] = (0.955, 0.945, 0.925)
    colour: Pixels = field(init=False)
    depth: Pixels = field(init=False)
    group: NDArray[np.int16] = field(init=False)

    def __post_init__(self) -> None:
        self.colour = np.empty((self.height, self.width, 3), np.float32)
        self.colour[:] = self.background
        self.depth = np.full((self.height, self.width), -np.inf, np.float32)
        self.group = np.full((self.height, self.width), -1, np.int16)

    def mesh(self, points: Pixels, light: Pixels, triangles: Indices, tints: Pixels, groups: NDArray[np.int16]) -> None:
        """Draw a closed skin of triangles (F, 3), seen from outside where their corners run against the clock.

        points: (V, 3) pixels right, pixels up, pixels towards the viewer. light: (V,) of each vertex, spread over the
        triangles between (Gouraud 1971). tints: (F, 3) colours; groups: (F,) which each belongs to.
        """
        x, y, z = (points[:, k][triangles] for k in range(3))
        y = np.float32(self.height) - y
        area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
        left, right = np.ceil(x.min(axis=1)), np.floor(x.max(axis=1))
        top, bottom = np.ceil(y.min(axis=1)), np.floor(y.max(axis=1))
        left, top = np.maximum(left, 0.0), np.maximum(top, 0.0)
        right, bottom = np.minimum(right, self.width - 1.0), np.minimum(bottom, self.height - 1.0)
        sizes = np.maximum(right - left, bottom - top) + 1.0
        seen = (area < 0.0) & (right >= left) & (bottom >= top)
        samples = [
            part
            for least, most in pairwise(_BOXES)
            for some in _portions(np.flatnonzero(seen & (sizes > least) & (sizes <= most)), int(most))
            for part in [_samples(x[some], y[some], area[some], left[some], top[some], int(most), some)]
        ]
        if not samples:
            return
        owner, column, row, first, second = (np.concatenate(part) for part in zip(*samples, strict=True))
        inside = (column < self.width) & (row < self.height)
        owner, first, second = owner[inside], first[inside], second[inside]
        at = row[inside] * self.width + column[inside]
        third = np.float32(1.0) - first - second
        height = first * z[owner, 0] + second * z[owner, 1] + third * z[owner, 2]
        depth, group, colour = self.depth.reshape(-1), self.group.reshape(-1), self.colour.reshape(-1, 3)
        np.maximum.at(depth, at, height)
        front = np.flatnonzero(height == depth[at])
        owner, at = owner[front], at[front]
        corners = light[triangles[owner]]
        shade = first[front] * corners[:, 0] + second[front] * corners[:, 1] + third[front] * corners[:, 2]
        group[at] = groups[owner]
        colour[at] = shade[:, None] * tints[owner]

    def finish(self, step: float, near: float, far: float) -> NDArray[np.uint8]:
        """The picture (H/2, W/2, 3), 0..255: outlined, toned by depth, and halved in size to smooth edges.

        step: a jump of depth (pixels) that counts as one thing before another; near, far: depths that are toned
        brightest and dimmest.
        """
        shown = np.empty((self.height // 2, self.width // 2, 3), np.uint8)
        shown[:] = np.asarray(self.background, np.float32) * np.float32(255.0) + np.float32(0.5)
        rows, columns = (np.flatnonzero((self.group >= 0).any(axis=axis)) for axis in (1, 0))
        if not rows.size:
            return shown
        # Only where something is drawn, and a little around it; from even to even pixels.
        y0, y1 = max(rows[0] - 2, 0) // 2 * 2, min(rows[-1] + 4, self.height) // 2 * 2
        x0, x1 = max(columns[0] - 2, 0) // 2 * 2, min(columns[-1] + 4, self.width) // 2 * 2
        box = slice(y0, y1), slice(x0, x1)
        group, depth = self.group[box], self.depth[box]
        tone = (depth - np.float32(far)) * np.float32(0.26 / max(near - far, 1e-6))
        tone = np.clip(tone, np.float32(0.0), np.float32(0.26)) + np.float32(0.80)
        light = _outlines(group, depth, step)
        np.multiply(light, tone, out=light, where=group >= 0)
        picture = self.colour[box] * light[..., None]
        half = picture[0::2, 0::2] + picture[1::2, 0::2] + picture[0::2, 1::2] + picture[1::2, 1::2]
        half = np.clip(half * np.float32(63.75) + np.float32(0.5), 0.0, 255.0)
        shown[y0 // 2 : y1 // 2, x0 // 2 : x1 // 2] = half
        return shown


def lit(normals: Pixels) -> Pixels:
    """Light (V,) that falls on a skin with normals (V, 3): right, up, towards the viewer."""
    facing = np.clip(normals[:, 2], 0.0, 1.0)
    light = _AMBIENT + _DIFFUSE * np.maximum(normals @ _LIGHT, 0.0) - _RIM * (1.0 - facing) ** 3
    return np.asarray(light, np.float32)


def _portions(chosen: Indices, side: int) -> list[Indices]:
    """Triangles whose boxes have so many pixels to a side, as many at a time as are looked at in one go."""
    most = max(1, _AT_ONCE // side**2)
    return [chosen[k : k + most] for k in range(0, len(chosen), most)]


def _samples(
    x: Pixels, y: Pixels, area: Pixels, left: Pixels, top: Pixels, side: int, numbers: Indices
) -> tuple[Indices, Indices, Indices, Pixels, Pixels]:
    """Pixels of boxes with ``side`` pixels to a side that lie in their triangles: the triangle's number, column and row
    of each, and how near it is to the first and to the second corner (barycentric).
    """
    across, down = (part.ravel() for part in np.meshgrid(*[np.arange(side, dtype=np.float32)] * 2))
    near: list[Pixels] = []
    for one, other in ((1, 2), (2, 0)):
        # Linear over the picture: its value at the box's corner, and how it grows to the right and down.
        right, below = (y[:, one] - y[:, other]) / area, (x[:, other] - x[:, one]) / area
        corner = ((x[:, one] - left) * (y[:, other] - top) - (x[:, other] - left) * (y[:, one] - top)) / area
        near.append(corner[:, None] + right[:, None] * across + below[:, None] * down)
    first, second = near
    inside = (first >= _EDGE) & (second >= _EDGE) & (first + second <= 1.0 - _EDGE)
    owner, cell = np.nonzero(inside)
    column = left[owner].astype(np.intp) + across[cell].astype(np.intp)
    row = top[owner].astype(np.intp) + down[cell].astype(np.intp)
    return numbers[owner], column, row, first[inside], second[inside]


def _outlines(group: NDArray[np.int16], depth: Pixels, step: float) -> Pixels:
    """Darkening (H, W): strong behind an edge of something nearer, light where two groups meet at one depth."""
    dark = np.ones(depth.shape, np.float32)
    deep = np.where(group >= 0, depth, np.float32(-1e6))
    height, width = depth.shape
    for reach, strong, light in ((2, 0.55, 0.85), (1, 0.30, 0.62)):
        for dy, dx in ((reach, 0), (-reach, 0), (0, reach), (0, -reach)):
            here = slice(max(-dy, 0), height - max(dy, 0)), slice(max(-dx, 0), width - max(dx, 0))
            there = tuple(slice(part.start + d, part.stop + d) for part, d in zip(here, (dy, dx), strict=True))
            nearer = deep[there] - deep[here]
            edge = nearer > step
            view = dark[here]
            view[edge] = np.minimum(view[edge], np.float32(strong))
            meets = (group[there] != group[here]) & (nearer > -step) & ~edge & (group[here] > 0) & (group[there] > 0)
            view[meets] = np.minimum(view[meets], np.float32(light))
    return dark
