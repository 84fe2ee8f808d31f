"""A z-buffer of shaded tapered capsules, seen straight on (orthographic)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.float32]

_LIGHT = np.array([-0.45, 0.62, 0.78], np.float32) / np.float32(np.linalg.norm([-0.45, 0.62, 0.78]))
_AMBIENT, _DIFFUSE, _RIM = 0.50, 0.52, 0.10


@dataclass(eq=False)
class Canvas:
    """A picture in the making: colour (H, W, 3) 0..1, depth (H, W) towards the viewer, and which group each pixel
    shows.
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

    def capsule(
        self,
        start: NDArray[np.float64],
        end: NDArray[np.float64],
        radii: tuple[float, float],
        colour: tuple[float, float, float],
        group: int,
        blend: float = 0.0,
    ) -> None:
        """Draw one capsule; start, end: (3,) pixels right, pixels down, pixels towards the viewer; radii in pixels.

        A capsule is the ball of radius r swept along its axis. Over a pixel whose way to the axis is h on the picture
        plane, with rho = sqrt(r^2 - h^2), the ball that comes nearest to the viewer stands rho b_z / |b| beyond the
        foot of that way (b the axis), where the height of the swept surface is stationary. A taper is followed by a
        second look with the radius there. Within ``blend`` pixels of depth it flows into what its group has drawn
        already (Quilez's polynomial smooth maximum), so that a trunk of several capsules is one smooth body.
        """
        big = max(radii) + 1.0
        x0, y0 = np.floor(np.minimum(start, end)[:2] - big).astype(int)
        x1, y1 = np.ceil(np.maximum(start, end)[:2] + big).astype(int) + 1
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, self.width), min(y1, self.height)
        if x0 >= x1 or y0 >= y1:
            return
        px = np.arange(x0, x1, dtype=np.float32)[None, :] - np.float32(start[0])
        py = np.arange(y0, y1, dtype=np.float32)[:, None] - np.float32(start[1])
        bx, by, bz = (np.float32(v) for v in end - start)
        flat = np.float32(max(np.hypot(bx, by), 1e-3))
        foot = (px * bx + py * by) / flat
        across = (px * by - py * bx) ** 2 / (flat * flat) if flat > 1e-3 else px * px + py * py
        lean = bz / np.float32(np.hypot(flat, bz))
        t = np.clip(foot / flat, 0.0, 1.0)
        for _ in range(2 if bz else 0):
            radius = np.float32(radii[0]) + t * np.float32(radii[1] - radii[0])
            t = np.clip((foot + lean * np.sqrt(np.maximum(radius * radius - across, 0.0))) / flat, 0.0, 1.0)
        radius = np.float32(radii[0]) + t * np.float32(radii[1] - radii[0])
        dx, dy = px - t * bx, py - t * by
        nz = np.sqrt(np.maximum(1.0 - (dx * dx + dy * dy) / (radius * radius), 0.0))
        z = np.float32(start[2]) + t * bz + radius * nz
        window = (slice(y0, y1), slice(x0, x1))
        depth = self.depth[window]
        seen = (nz > 0.0) & (z > depth - np.float32(blend))
        if blend:
            seen &= (z > depth) | (self.group[window] == group)
        nz, front = nz[seen], z[seen]
        light = np.maximum((dx[seen] * _LIGHT[0] - dy[seen] * _LIGHT[1]) / radius[seen] + nz * _LIGHT[2], 0.0)
        shade = _AMBIENT + _DIFFUSE * light - _RIM * (1.0 - nz) ** 3
        new = shade[:, None] * np.asarray(colour, np.float32)
        if blend:
            before = depth[seen]
            near = np.flatnonzero((self.group[window][seen] == group) & (front < before + np.float32(blend)))
            share = 0.5 + 0.5 * (front[near] - before[near]) / np.float32(blend)
            front[near] = share * front[near] + (1.0 - share) * (before[near] + np.float32(blend) * share)
            share = share[:, None]
            new[near] = share * new[near] + (1.0 - share) * self.colour[window][seen][near]
        depth[seen] = front
        self.group[window][seen] = group
        self.colour[window][seen] = new

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
            meets = (group[there] != group[here]) & (nearer > -step) & ~edge & (group[here] >= 0)
            view[meets] = np.minimum(view[meets], np.float32(light))
    return dark
