"""Labels of points in a plot, each beside its point and over nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Box = NDArray[np.float64]
"""Left, bottom, right, top, in pixels."""

FONT_SIZE = 7.5
_MARKER_PX = 8.0
"""Half the side of the square around a point that no label may touch."""
_DISTANCES = (11.0, 22.0, 36.0, 52.0, 72.0, 96.0, 124.0)
"""Distances, in pixels, at which a label may lie from its point; the nearest free one is taken."""
_DIRECTIONS = np.deg2rad([0.0, 180.0, 90.0, 270.0, 30.0, 330.0, 150.0, 210.0, 60.0, 300.0, 120.0, 240.0])
_MARGIN = np.array([0.05, 0.0])
"""Part of a label's size by which it may differ where it is drawn in another resolution."""
_PAD_PX = 3.0
_LEADER_FROM = 18.0
"""Distance from which on a thin line leads from the label to its point."""


def label_points(ax: Any, points: Sequence[tuple[float, float]], names: Sequence[str], colours: Sequence[str]) -> None:
    """Write a name beside each point of finished axes, so that no two labels overlap, none covers a point, and all lie
    within the axes as far as there is room.

    The limits and the layout of the axes must be final.
    """
    figure = ax.figure
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    at = ax.transData.transform(np.array(points, float).reshape(-1, 2))
    inside = _box(ax.get_window_extent())
    taken = [np.array([x - _MARKER_PX, y - _MARKER_PX, x + _MARKER_PX, y + _MARKER_PX]) for x, y in at]
    taken += [_box(text.get_window_extent()) for text in ax.texts if text.get_text()]
    for k in np.lexsort((at[:, 1], at[:, 0])).tolist():
        text = ax.annotate(
            names[k], points[k], xytext=(0, 0), textcoords="offset points", fontsize=FONT_SIZE, color=colours[k],
            zorder=5, annotation_clip=False,
        )  # fmt: skip
        size = _box(text.get_window_extent())
        half = 0.5 * (1.0 + _MARGIN) * (size[2:] - size[:2]) + _PAD_PX
        places = [(d * direction, _middle(at[k], d * direction, half)) for d, direction in _around_a_point()]
        free = [place for place in places if _is_free(_around(place[1], half), taken)]
        within = [place for place in free if _is_inside(_around(place[1], half), inside)]
        offset, middle = (within or free or places)[0]
        text.xyann = tuple(offset * 72.0 / figure.dpi)
        text.set(
            ha=_alignment(offset[0], ("right", "center", "left")), va=_alignment(offset[1], ("top", "center", "bottom"))
        )
        taken.append(_around(middle, half))
        _lead(ax, at[k], middle, half)


def _around_a_point() -> Iterator[tuple[float, Box]]:
    """Where a label may lie beside its point: distance and direction, the nearest first."""
    for distance in _DISTANCES:
        for angle in _DIRECTIONS:
            yield distance, np.array([np.cos(angle), np.sin(angle)])


def _alignment(offset: float, names: tuple[str, str, str]) -> str:
    """The edge of a label that stands at its place: the one towards its point."""
    return names[1] if abs(offset) < 1.0 else names[0] if offset < 0.0 else names[2]


def _middle(point: Box, offset: Box, half: Box) -> Box:
    """The middle of a label whose edge towards its point lies at an offset from it."""
    return np.asarray(point + offset + np.where(np.abs(offset) < 1.0, 0.0, np.sign(offset)) * (half - _PAD_PX))


def _lead(ax: Any, point: Box, middle: Box, half: Box) -> None:
    """Draw a thin line from a point to its label where that lies far off."""
    nearest = np.clip(point, middle - half, middle + half)
    if np.linalg.norm(nearest - point) > _LEADER_FROM:
        ends = ax.transData.inverted().transform(np.stack([point, nearest]))
        ax.plot(*ends.T, color="#9a9a9a", lw=0.7, zorder=1)


def _is_free(box: Box, taken: Sequence[Box]) -> bool:
    return not any(np.all(box[:2] < other[2:]) and np.all(other[:2] < box[2:]) for other in taken)


def _is_inside(box: Box, edge: Box) -> bool:
    return bool(np.all(box[:2] >= edge[:2]) and np.all(box[2:] <= edge[2:]))


def _around(middle: Box, half: Box) -> Box:
    return np.concatenate([middle - half, middle + half])


def _box(extent: Any) -> Box:
    return np.array([extent.x0, extent.y0, extent.x1, extent.y1])
