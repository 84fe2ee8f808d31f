"""Figures 6 and 7: transition frames of the systems and the truth, drawn as bones, with the dominant hand enlarged.

The bones join the predicted positions directly, so that a distorted hand is visible. The truth is drawn in grey under
every prediction: the true frame of the same number under the first two frames, as the paper compares them, and the last
under the last. The frames at both ends are the kept frames at the positions that a system found.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from signsplice.motion import FloatArray
from signsplice_paper import kept_frames, published
from signsplice_paper.extra_metrics import FIRST
from signsplice_paper.kept_frames import KeptFrames
from signsplice_paper.results import CLASSICAL, SHIPPED
from signsplice_paper.stick_figure import HIDDEN, LEFT, RIGHT, SIDES, TRUNK, StickFigure
from signsplice_paper.style import SEEN

Stroke = tuple[int, str, float, float]
"""How a line is drawn: depth order, colour, width, opacity."""
Window = tuple[float, float, float, float]
"""A rectangle: left, right, bottom, top."""

MOST_COLUMNS = 8
CELL, HAND_CELL, GAP, LABELS, HEADS = 1.0, 0.6, 0.05, 1.15, 0.34
"""Inches."""
TRUTH = "truth"
HAND_REACH = 0.055
"""Half the side of the window around the dominant hand, in the numbers' unit: 12 cm."""
_COLOURS = {TRUNK: "#6b6b70", LEFT: "#3f6fa8", RIGHT: "#de8e20"}
_TRUE = "#c9c5bd"


def draw_pairs(pyplot: Any, pairs: Sequence[KeptFrames], scale: str) -> Any:
    """Returns a matplotlib figure of the pairs, with a row for the truth and one for each system; None if no system's
    frames are kept.
    """
    rows = [(pair, name, frames) for pair in pairs for name, frames in _list_rows(pair, scale)]
    if len(rows) <= len(pairs):
        return None
    columns = min(MOST_COLUMNS + 2, max(len(frames) for _, _, frames in rows))
    pitch = CELL + HAND_CELL + 3 * GAP
    size = (LABELS + columns * (CELL + GAP) + GAP, pitch * len(rows) + HEADS * len(pairs) + GAP)
    figure = pyplot.figure(figsize=size)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, size[0]), ylim=(0.0, size[1]))  # one unit is an inch
    ax.axis("off")
    window = _compute_body_window(pairs)
    strokes: dict[Stroke, list[FloatArray]] = {}
    top = size[1]
    for pair, name, frames in rows:
        if name == TRUTH:
            ax.text(LABELS + GAP, top - 0.16, pair.name, fontsize=8, weight="bold", va="center")
            top -= HEADS
        ax.text(LABELS - GAP, top - 0.5 * CELL, name, fontsize=8, ha="right", va="center")
        _add_row(ax, strokes, pair, frames, name == TRUTH, top, columns, window)
        top -= pitch
    _draw_strokes(ax, strokes)
    return figure


def _add_row(
    ax: Any,
    strokes: dict[Stroke, list[FloatArray]],
    pair: KeptFrames,
    frames: FloatArray,
    is_true: bool,
    top: float,
    columns: int,
    window: Window,
) -> None:
    """Adds the pictures of one row: ``frames`` (T, K) with the kept frame at either end, and the number of each."""
    true = np.concatenate([pair.before, pair.truth, pair.after])
    side = _find_dominant_side(pair.figure, true)
    for column, index in enumerate(_select_frames(len(frames), columns)):
        x = LABELS + column * (CELL + GAP)
        true_frame = None if is_true else true[_match_true_frame(index, len(frames), len(true))]
        is_kept = index in (0, len(frames) - 1)
        number = "kept" if is_kept else str(index)
        ax.text(x + 0.04, top - 0.03, number, fontsize=6, va="top", color="#6b6b6b", zorder=9)
        _add_cell(strokes, pair.figure, (x, top - CELL, CELL, CELL), frames[index], true_frame, window, is_kept)
        if side is None:
            continue
        hand_window = _compute_hand_window(pair.figure, frames[index], side)
        bottom = top - CELL - GAP - HAND_CELL
        _add_cell(
            strokes, pair.figure, (x, bottom, CELL, HAND_CELL), frames[index], true_frame, hand_window, is_kept, side
        )


def _list_rows(pair: KeptFrames, scale: str) -> list[tuple[str, FloatArray]]:
    """Returns names and frames of a pair's rows, with the kept frame at either end: the truth, the systems of the
    paper's figures and LPT+, Hermite at the true positions, and the product.
    """
    rows = [(TRUTH, np.concatenate([pair.before, pair.truth, pair.after]))]
    labels = [(kept_frames.make_label(system, scale, "adamw"), published.get_display_name(system)) for system in SEEN]
    for (system, given_truth), clip_scale, name in (
        (kept_frames.HERMITE, CLASSICAL, "Hermite, given\npositions\nand length"),
        (kept_frames.PRODUCT, SHIPPED, "signsplice"),
    ):
        labels.append((kept_frames.make_label(system, clip_scale, "", given_truth), name))
    for label, name in labels:
        frames = pair.made.get(label)
        if frames is not None and len(frames):
            edges = pair.edges.get(label, np.concatenate([pair.before, pair.after]))
            rows.append((name, np.concatenate([edges[:1], frames, edges[1:]])))
    return rows


def _select_frames(count: int, columns: int) -> list[int]:
    """Returns the frames shown of ``count``: all, or as many as columns: the kept one, the first ``FIRST`` of the
    transition, and others, evenly spaced, up to the last.
    """
    if count <= columns:
        return list(range(count))
    first = list(range(min(FIRST + 1, columns - 1)))
    later = np.linspace(first[-1], count - 1, columns - len(first) + 1)[1:]
    return first + [round(position) for position in later.tolist()]


def _match_true_frame(frame: int, count: int, n_true: int) -> int:
    """Returns the true frame of ``n_true`` that is drawn under a frame of ``count``."""
    if frame <= FIRST or n_true <= FIRST + 2 or count <= FIRST + 2:
        return min(frame, n_true - 1) if frame < count - 1 else n_true - 1
    return FIRST + round((frame - FIRST) * (n_true - 1 - FIRST) / (count - 1 - FIRST))


def _find_dominant_side(figure: StickFigure, frames: FloatArray) -> str | None:
    """Returns the side of the hand that moves more: right or left; None if the numbers hold no hand."""
    positions = figure.project_frames(frames)
    ranges = {s: float(np.ptp(positions[:, figure.wrists[s]], axis=0).sum()) for s in SIDES if s in figure.wrists}
    return max(ranges, key=lambda side: ranges[side]) if ranges else None


def _compute_body_window(pairs: Sequence[KeptFrames]) -> Window:
    """Returns the square around head, hands and hips of all true frames, shown in every picture of a body."""
    points = []
    for pair in pairs:
        visible = [n for n, part in enumerate(pair.figure.parts) if part != HIDDEN] + list((pair.figure.head or ())[1:])
        points += [
            pair.figure.project_frames(part)[:, visible].reshape(-1, 2)
            for part in (pair.before, pair.truth, pair.after)
        ]
    upper = np.concatenate(points)
    low, high = upper.min(axis=0) - 0.02, upper.max(axis=0) + 0.02
    half = 0.5 * float((high - low).max())
    x, y = 0.5 * (low + high)
    return float(x) - half, float(x) + half, float(y) - half, float(y) + half


def _compute_hand_window(figure: StickFigure, frame: FloatArray, side: str) -> Window:
    """Returns the rectangle around a hand of a frame (3 J,)."""
    x, y = figure.project_frames(frame[None])[0, figure.knuckles[side]].tolist()
    aspect = CELL / HAND_CELL
    return x - aspect * HAND_REACH, x + aspect * HAND_REACH, y - HAND_REACH, y + HAND_REACH


def _add_cell(
    strokes: dict[Stroke, list[FloatArray]],
    figure: StickFigure,
    box: tuple[float, float, float, float],
    frame: FloatArray,
    true_frame: FloatArray | None,
    window: Window,
    is_kept: bool,
    side: str | None = None,
) -> None:
    """Adds one picture to the strokes: the bones of a frame (3 J,) over those of the truth, clipped to a box (left,
    bottom, width, height) that shows a window of the positions. ``side``: draw only this hand.
    """
    low, size = np.array(box[:2]), np.array(box[2:])
    outline = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * size + low
    strokes.setdefault((-1, "#d8d4cc", 0.6, 1.0), []).append(np.stack([outline[:-1], outline[1:]], axis=1))
    corner, scale = np.array([window[0], window[2]]), box[2] / (window[1] - window[0])
    for positions, faint in ((true_frame, True), (frame, False)):
        if positions is None:
            continue
        for order, (segments, colour, width) in enumerate(_project_bones(figure, positions, side)):
            visible = clip_segments((segments - corner) * scale + low, low, low + size)
            key = (0, _TRUE, 1.8 * width, 1.0) if faint else (1 + order, colour, width, 0.55 if is_kept else 1.0)
            strokes.setdefault(key, []).append(visible)


def _draw_strokes(ax: Any, strokes: dict[Stroke, list[FloatArray]]) -> None:
    """Draws all strokes of a kind as one line with breaks at NaN, since a figure has thousands of bones."""
    for (order, colour, width, alpha), parts in strokes.items():
        segments = np.concatenate(parts)
        points = np.concatenate([segments, np.full((len(segments), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        ax.plot(*points.T, color=colour, lw=width, alpha=alpha, zorder=2 + order, solid_capstyle="round")


def clip_segments(segments: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Returns the parts of segments (n, 2, 2) in a box from ``low`` (2,) to ``high`` (2,) (Liang and Barsky 1984)."""
    start, direction = segments[:, 0], segments[:, 1] - segments[:, 0]  # (n, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - start) / direction, (high - start) / direction
    parallel = direction == 0.0
    inside = (start >= low) & (start <= high)
    enter = np.where(parallel, np.where(inside, 0.0, 2.0), np.minimum(first, second)).max(axis=1)
    leave = np.where(parallel, 1.0, np.maximum(first, second)).min(axis=1)
    enter, leave = np.maximum(enter, 0.0), np.minimum(leave, 1.0)
    visible = enter < leave
    ends = np.stack([enter, leave], axis=1)[visible]
    return np.asarray(start[visible, None] + ends[..., None] * direction[visible, None])


def _project_bones(figure: StickFigure, frame: FloatArray, side: str | None) -> list[tuple[FloatArray, str, float]]:
    """Returns the bones of the upper body, or of one hand, seen from the front: segments (n, 2, 2), colour, width.
    Trunk and head come first, then the left arm, then the right.
    """
    projected = figure.project_frames(frame[None])[0]  # (J, 2)
    thin = 1.6 if side else 0.7
    bones = []
    for part, colour in _COLOURS.items():
        for width, fingers in ((2.0, False), (thin, True)):
            segments = [projected[list(bone)] for bone in figure.find_bones(part, fingers, side)]
            if part == TRUNK and fingers and side is None and figure.head is not None:
                segments += [np.stack(ends) for ends in pairwise(_make_head_ring(*projected[list(figure.head)]))]
            if segments:
                bones.append((np.stack(segments), colour, width))
    return bones


def _make_head_ring(low: FloatArray, high: FloatArray) -> FloatArray:
    """Returns an ellipse (n, 2) around the head, as tall as the distance from its joint (2,) to its top (2,)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    ring = 0.5 * float(np.linalg.norm(high - low)) * np.stack([0.8 * np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(0.5 * (low + high) + ring)
