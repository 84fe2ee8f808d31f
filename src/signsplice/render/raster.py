"""A z-buffer rasterizer of shaded triangles, orthographic, in numpy; and the light that ``gpu`` has too."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.float32]
Indices = NDArray[np.intp]

BACKGROUND = (0.955, 0.945, 0.925)
"""Colour behind the figure, 0 to 1."""
AMBIENT = 0.40, 0.68
"""Light on a surface that faces down and on one that faces up."""
KEY = 0.58
"""Light that the key light adds to a surface that faces it."""
RIM = 0.10
"""Light lost at the rim, as a surface turns away from the viewer."""
DEPTH_TONE = 0.86, 0.18
"""Brightness of the farthest shade of depth, and what the nearest adds to it."""
OUTLINE_STEP = 0.010
"""Depth between two surfaces above which the farther one is outlined, statures."""
_BOXES = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 64, 128, 512, 4096)
"""Limits of the size of bounding boxes that separate batches of triangles, pixels."""
_AT_ONCE = 1 << 21
"""Largest number of pixels tested in one batch."""
_EDGE = np.float32(-1e-4)
"""Tolerance of barycentric coordinates, which prevents gaps between triangles."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with its light; depths and places in camera axes (right, up, towards the viewer), statures.

    width, height: of the picture, pixels.
    centre: the place in its middle, right and up.
    scale: pixels a stature.
    light: (3,) unit vector towards the key light.
    near, far: depths of the brightest and the darkest shade.
    ball: centre (3,) and radius of a ball around all that throws a shadow.
    """

    width: int
    height: int
    centre: tuple[float, float]
    scale: float
    light: Pixels
    near: float
    far: float
    ball: tuple[Pixels, float]


@dataclass(frozen=True, eq=False)
class Texture:
    """A picture on a surface.

    pixels: (H, W, 4) 0..255, with alpha.
    uvs: (V, 2) coordinates of the vertices, v down; the picture repeats beyond 0 to 1.
    cutoff: least alpha that is visible, 0 to 1.
    """

    pixels: NDArray[np.uint8]
    uvs: Pixels
    cutoff: float

    def sample(self, corners: Indices, first: Pixels, second: Pixels) -> Pixels:
        """Returns the nearest pixels (N, 4), 0..1, at points of triangles with ``corners`` (N, 3), given by their
        ``first`` and ``second`` barycentric coordinates (N,).
        """
        height, width = self.pixels.shape[:2]
        weights = np.stack([first, second, np.float32(1.0) - first - second], axis=1)
        at = np.einsum("nk,nka->na", weights, self.uvs[corners]) * np.array([width, height], np.float32)
        column, row = np.floor(at).astype(np.intp).T
        return np.asarray(self.pixels[row % height, column % width], np.float32) / np.float32(255.0)


@dataclass(eq=False)
class Canvas:
    """A picture under construction.

    width, height: pixels.
    colour: (H, W, 3) 0..1.
    depth: (H, W) towards the viewer, pixels; -inf for empty pixels.
    group: (H, W) group of the triangle at each pixel; -1 for empty pixels. Two groups above 0 that meet at the same
        depth get an outline.
    """

    width: int
    height: int
    colour: Pixels = field(init=False)
    depth: Pixels = field(init=False)
    group: NDArray[np.int16] = field(init=False)

    def __post_init__(self) -> None:
        self.colour = np.empty((self.height, self.width, 3), np.float32)
        self.colour[:] = BACKGROUND
        self.depth = np.full((self.height, self.width), -np.inf, np.float32)
        self.group = np.full((self.height, self.width), -1, np.int16)

    def mesh(
        self,
        points: Pixels,
        light: Pixels,
        triangles: Indices,
        tints: Pixels,
        groups: NDArray[np.int16],
        texture: Texture | None = None,
        both_sides: bool = False,
    ) -> None:
        """Draw a surface of triangles (F, 3); triangles with clockwise corners face away and are skipped, unless
        ``both_sides`` are visible.

        points: (V, 3) pixels right, up, and towards the viewer. light: (2, V) brightness of each vertex, from outside
        and from inside, interpolated over triangles (Gouraud 1971). tints: (F, 3) colour of each triangle. groups: (F,)
        group of each triangle.
        """
        x, y, z = (points[:, k][triangles] for k in range(3))
        y = np.float32(self.height) - y
        area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
        left, right = np.ceil(x.min(axis=1)), np.floor(x.max(axis=1))
        top, bottom = np.ceil(y.min(axis=1)), np.floor(y.max(axis=1))
        left, top = np.maximum(left, 0.0), np.maximum(top, 0.0)
        right, bottom = np.minimum(right, self.width - 1.0), np.minimum(bottom, self.height - 1.0)
        sizes = np.maximum(right - left, bottom - top) + 1.0
        visible = ((area < 0.0) | (both_sides & (area > 0.0))) & (right >= left) & (bottom >= top)
        samples = [
            part
            for smallest, largest in pairwise(_BOXES)
            for batch in _batches(np.flatnonzero(visible & (sizes > smallest) & (sizes <= largest)), int(largest))
            for part in [_samples(x[batch], y[batch], area[batch], left[batch], top[batch], int(largest), batch)]
        ]
        if not samples:
            return
        owner, column, row, first, second = (np.concatenate(part) for part in zip(*samples, strict=True))
        inside = (column < self.width) & (row < self.height)
        if texture is not None and texture.cutoff > 0.0:
            inside &= texture.sample(triangles[owner], first, second)[:, 3] >= texture.cutoff
        owner, first, second = owner[inside], first[inside], second[inside]
        pixels = row[inside] * self.width + column[inside]
        third = np.float32(1.0) - first - second
        height = first * z[owner, 0] + second * z[owner, 1] + third * z[owner, 2]
        depth, group, colour = self.depth.reshape(-1), self.group.reshape(-1), self.colour.reshape(-1, 3)
        np.maximum.at(depth, pixels, height)
        front = np.flatnonzero(height == depth[pixels])
        owner, pixels = owner[front], pixels[front]
        corners = light[(area[owner] > 0.0).astype(np.intp)[:, None], triangles[owner]]
        shade = first[front] * corners[:, 0] + second[front] * corners[:, 1] + third[front] * corners[:, 2]
        group[pixels] = groups[owner]
        colour[pixels] = shade[:, None] * tints[owner]
        if texture is not None:
            colour[pixels] *= texture.sample(triangles[owner], first[front], second[front])[:, :3]

    def finish(self, step: float, near: float, far: float) -> NDArray[np.uint8]:
        """Returns the picture (H/2, W/2, 3), 0..255: outlined, shaded by depth, and halved in size to smooth edges.

        step: depth difference, pixels, above which a surface behind another is outlined. near, far: depths of the
        brightest and the darkest shade.
        """
        shown = np.empty((self.height // 2, self.width // 2, 3), np.uint8)
        shown[:] = np.asarray(BACKGROUND, np.float32) * np.float32(255.0) + np.float32(0.5)
        rows, columns = (np.flatnonzero((self.group >= 0).any(axis=axis)) for axis in (1, 0))
        if not rows.size:
            return shown
        # Process only the drawn area with a small margin, aligned to even pixels.
        y0, y1 = max(rows[0] - 2, 0) // 2 * 2, min(rows[-1] + 4, self.height) // 2 * 2
        x0, x1 = max(columns[0] - 2, 0) // 2 * 2, min(columns[-1] + 4, self.width) // 2 * 2
        box = slice(y0, y1), slice(x0, x1)
        group, depth = self.group[box], self.depth[box]
        least, span = (np.float32(value) for value in DEPTH_TONE)
        tone = np.clip((depth - np.float32(far)) * span / np.float32(max(near - far, 1e-6)), 0.0, span) + least
        light = _outlines(group, depth, step)
        np.multiply(light, tone, out=light, where=group >= 0)
        picture = self.colour[box] * light[..., None]
        half = picture[0::2, 0::2] + picture[1::2, 0::2] + picture[0::2, 1::2] + picture[1::2, 1::2]
        half = np.clip(half * np.float32(63.75) + np.float32(0.5), 0.0, 255.0)
        shown[y0 // 2 : y1 // 2, x0 // 2 : x1 // 2] = half
        return shown


def lit(normals: Pixels, light: Pixels) -> Pixels:
    """Returns factors (V,) on the colours of a surface with unit normals (V, 3), right, up, towards the viewer: the
    root of its light, as colours are nearly roots too. ``light``: (3,) unit vector towards the key light.
    """
    low, high = AMBIENT
    facing = np.clip(normals[:, 2], 0.0, 1.0)
    ambient = 0.5 * (low + high) + 0.5 * (high - low) * normals[:, 1]
    linear = ambient + KEY * np.maximum(normals @ light, 0.0) - RIM * (1.0 - facing) ** 3
    return np.asarray(np.sqrt(linear), np.float32)


def _batches(triangles: Indices, side: int) -> list[Indices]:
    """Splits triangles with boxes of ``side`` pixels into batches of at most ``_AT_ONCE`` pixels."""
    count = max(1, _AT_ONCE // side**2)
    return [triangles[k : k + count] for k in range(0, len(triangles), count)]


def _samples(
    x: Pixels, y: Pixels, area: Pixels, left: Pixels, top: Pixels, side: int, numbers: Indices
) -> tuple[Indices, Indices, Indices, Pixels, Pixels]:
    """Returns the pixels inside triangles with boxes of ``side`` pixels a side: triangle, column, row, and first and
    second barycentric coordinate of each.
    """
    x_steps, y_steps = (part.ravel() for part in np.meshgrid(*[np.arange(side, dtype=np.float32)] * 2))
    coordinates: list[Pixels] = []
    for start, end in ((1, 2), (2, 0)):
        # A linear function of the pixel: its value at the box's corner, and its slopes to the right and down.
        right, below = (y[:, start] - y[:, end]) / area, (x[:, end] - x[:, start]) / area
        corner = ((x[:, start] - left) * (y[:, end] - top) - (x[:, end] - left) * (y[:, start] - top)) / area
        coordinates.append(corner[:, None] + right[:, None] * x_steps + below[:, None] * y_steps)
    first, second = coordinates
    inside = (first >= _EDGE) & (second >= _EDGE) & (first + second <= 1.0 - _EDGE)
    owner, cell = np.nonzero(inside)
    column = left[owner].astype(np.intp) + x_steps[cell].astype(np.intp)
    row = top[owner].astype(np.intp) + y_steps[cell].astype(np.intp)
    return numbers[owner], column, row, first[inside], second[inside]


def _outlines(group: NDArray[np.int16], depth: Pixels, step: float) -> Pixels:
    """Returns factors (H, W) that darken outlines: strongly behind a nearer surface, lightly between two groups at one
    depth.
    """
    dark = np.ones(depth.shape, np.float32)
    depth = np.where(group >= 0, depth, np.float32(-1e6))
    height, width = depth.shape
    for reach, strong, light in ((2, 0.55, 0.85), (1, 0.30, 0.62)):
        for dy, dx in ((reach, 0), (-reach, 0), (0, reach), (0, -reach)):
            pixels = slice(max(-dy, 0), height - max(dy, 0)), slice(max(-dx, 0), width - max(dx, 0))
            neighbours = tuple(slice(part.start + d, part.stop + d) for part, d in zip(pixels, (dy, dx), strict=True))
            nearer = depth[neighbours] - depth[pixels]
            edge = nearer > step
            view = dark[pixels]
            view[edge] = np.minimum(view[edge], np.float32(strong))
            both = (group[pixels] > 0) & (group[neighbours] > 0)
            meets = (group[neighbours] != group[pixels]) & (nearer > -step) & ~edge & both
            view[meets] = np.minimum(view[meets], np.float32(light))
    return dark
