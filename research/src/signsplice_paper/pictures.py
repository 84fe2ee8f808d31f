"""Figures 6 and 7: transition frames of the systems and the truth, drawn as bones, with the dominant hand enlarged.

The bones join the predicted positions directly, so that a distorted hand is visible. The truth is drawn in grey under
every prediction: the true frame of the same number under the first two, as the paper compares them, and under the last
the last. The frames at both ends are those that a system keeps at the positions that it found.
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


def draw_pairs(pyplot: Any, chosen: Sequence[KeptFrames], scale: str) -> Any:
    """A matplotlib figure of the chosen pairs, with a row for the truth and one for each system; None if no system's
    frames are kept.
    """
    rows = [(pair, name, frames) for pair in chosen for name, frames in _rows(pair, scale)]
    if len(rows) <= len(chosen):
        return None
    columns = min(MOST_COLUMNS + 2, max(len(frames) for _, _, frames in rows))
    pitch = CELL + HAND_CELL + 3 * GAP
    size = (LABELS + columns * (CELL + GAP) + GAP, pitch * len(rows) + HEADS * len(chosen) + GAP)
    figure = pyplot.figure(figsize=size)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, size[0]), ylim=(0.0, size[1]))  # one unit is an inch
    ax.axis("off")
    window = _body_window(chosen)
    strokes: dict[Stroke, list[FloatArray]] = {}
    top = size[1]
    for pair, name, frames in rows:
        if name == TRUTH:
            ax.text(LABELS + GAP, top - 0.16, pair.name, fontsize=8, weight="bold", va="center")
            top -= HEADS
        ax.text(LABELS - GAP, top - 0.5 * CELL, name, fontsize=8, ha="right", va="center")
        _row(ax, strokes, pair, frames, name == TRUTH, top, columns, window)
        top -= pitch
    _stroke(ax, strokes)
    return figure


def _row(
    ax: Any,
    strokes: dict[Stroke, list[FloatArray]],
    pair: KeptFrames,
    frames: FloatArray,
    is_true: bool,
    top: float,
    columns: int,
    window: Window,
) -> None:
    """Add the pictures of one row: ``frames`` (T, K) with the kept frame at either end, and the number of each."""
    true = np.concatenate([pair.before, pair.truth, pair.after])
    side = _dominant_side(pair.figure, true)
    for column, at in enumerate(_select_frames(len(frames), columns)):
        left = LABELS + column * (CELL + GAP)
        under = None if is_true else true[_true_frame(at, len(frames), len(true))]
        kept = at in (0, len(frames) - 1)
        number = "kept" if kept else str(at)
        ax.text(left + 0.04, top - 0.03, number, fontsize=6, va="top", color="#6b6b6b", zorder=9)
        _cell(strokes, pair.figure, (left, top - CELL, CELL, CELL), frames[at], under, window, kept)
        if side is None:
            continue
        hand_window = _hand_window(pair.figure, frames[at], side)
        bottom = top - CELL - GAP - HAND_CELL
        _cell(strokes, pair.figure, (left, bottom, CELL, HAND_CELL), frames[at], under, hand_window, kept, side)


def _rows(pair: KeptFrames, scale: str) -> list[tuple[str, FloatArray]]:
    """Names and frames of a pair's rows, with the kept frame at either end: the truth, the systems of the paper's
    figures and LPT+, Hermite at the true positions, and the product.
    """
    out = [(TRUTH, np.concatenate([pair.before, pair.truth, pair.after]))]
    named = [(kept_frames.label(system, scale, "adamw"), published.name(system)) for system in SEEN]
    for (system, given), clip_scale, name in (
        (kept_frames.HERMITE, CLASSICAL, "Hermite, given\npositions\nand length"),
        (kept_frames.PRODUCT, SHIPPED, "signsplice"),
    ):
        named.append((kept_frames.label(system, clip_scale, "", given), name))
    for label, name in named:
        frames = pair.made.get(label)
        if frames is not None and len(frames):
            edges = pair.edges.get(label, np.concatenate([pair.before, pair.after]))
            out.append((name, np.concatenate([edges[:1], frames, edges[1:]])))
    return out


def _select_frames(count: int, columns: int) -> list[int]:
    """The frames shown of ``count``: all, or as many as columns: the kept one, the first ``FIRST`` of the transition,
    and others, evenly spaced, up to the last.
    """
    if count <= columns:
        return list(range(count))
    first = list(range(min(FIRST + 1, columns - 1)))
    others = np.linspace(first[-1], count - 1, columns - len(first) + 1)[1:]
    return first + [round(at) for at in others.tolist()]


def _true_frame(at: int, count: int, n_true: int) -> int:
    """The true frame of ``n_true`` under frame ``at`` of ``count``."""
    if at <= FIRST or n_true <= FIRST + 2 or count <= FIRST + 2:
        return min(at, n_true - 1) if at < count - 1 else n_true - 1
    return FIRST + round((at - FIRST) * (n_true - 1 - FIRST) / (count - 1 - FIRST))


def _dominant_side(figure: StickFigure, frames: FloatArray) -> str | None:
    """The side of the hand that moves more: right or left; None if the numbers hold no hand."""
    positions = figure.project_frames(frames)
    ranges = {s: float(np.ptp(positions[:, figure.wrists[s]], axis=0).sum()) for s in SIDES if s in figure.wrists}
    return max(ranges, key=lambda side: ranges[side]) if ranges else None


def _body_window(chosen: Sequence[KeptFrames]) -> Window:
    """The square around head, hands and hips of all true frames, shown in every picture of a body."""
    points = []
    for pair in chosen:
        seen = [n for n, part in enumerate(pair.figure.parts) if part != HIDDEN] + list((pair.figure.head or ())[1:])
        points += [
            pair.figure.project_frames(part)[:, seen].reshape(-1, 2) for part in (pair.before, pair.truth, pair.after)
        ]
    upper = np.concatenate(points)
    low, high = upper.min(axis=0) - 0.02, upper.max(axis=0) + 0.02
    half = 0.5 * float((high - low).max())
    x, y = 0.5 * (low + high)
    return float(x) - half, float(x) + half, float(y) - half, float(y) + half


def _hand_window(figure: StickFigure, frame: FloatArray, side: str) -> Window:
    """The rectangle around a hand of a frame (3 J,)."""
    x, y = figure.project_frames(frame[None])[0, figure.knuckles[side]].tolist()
    aspect = CELL / HAND_CELL
    return x - aspect * HAND_REACH, x + aspect * HAND_REACH, y - HAND_REACH, y + HAND_REACH


def _cell(
    strokes: dict[Stroke, list[FloatArray]],
    figure: StickFigure,
    box: tuple[float, float, float, float],
    frame: FloatArray,
    under: FloatArray | None,
    window: Window,
    kept: bool,
    side: str | None = None,
) -> None:
    """Add one picture to the strokes: the bones of a frame (3 J,) over those of the truth, clipped to a box (left,
    bottom, width, height) that shows a window of the positions. ``side``: draw only this hand.
    """
    low, size = np.array(box[:2]), np.array(box[2:])
    outline = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * size + low
    strokes.setdefault((-1, "#d8d4cc", 0.6, 1.0), []).append(np.stack([outline[:-1], outline[1:]], axis=1))
    corner, scale = np.array([window[0], window[2]]), box[2] / (window[1] - window[0])
    for positions, faint in ((under, True), (frame, False)):
        if positions is None:
            continue
        for order, (segments, colour, width) in enumerate(_bones(figure, positions, side)):
            visible = clip_segments((segments - corner) * scale + low, low, low + size)
            key = (0, _TRUE, 1.8 * width, 1.0) if faint else (1 + order, colour, width, 0.55 if kept else 1.0)
            strokes.setdefault(key, []).append(visible)


def _stroke(ax: Any, strokes: dict[Stroke, list[FloatArray]]) -> None:
    """Draw all strokes of a kind as one line with breaks at NaN, since a figure has thousands of bones."""
    for (order, colour, width, alpha), parts in strokes.items():
        segments = np.concatenate(parts)
        points = np.concatenate([segments, np.full((len(segments), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        ax.plot(*points.T, color=colour, lw=width, alpha=alpha, zorder=2 + order, solid_capstyle="round")


def clip_segments(segments: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """The parts of segments (n, 2, 2) inside a box from ``low`` (2,) to ``high`` (2,) (Liang and Barsky 1984)."""
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


def _bones(figure: StickFigure, frame: FloatArray, side: str | None) -> list[tuple[FloatArray, str, float]]:
    """Bones of the upper body, or of one hand, seen from the front: segments (n, 2, 2), colour, width. Trunk and head
    come first, then the left arm, then the right.
    """
    seen = figure.project_frames(frame[None])[0]  # (J, 2)
    thin = 1.6 if side else 0.7
    out = []
    for part, colour in _COLOURS.items():
        for width, fingers in ((2.0, False), (thin, True)):
            segments = [seen[list(bone)] for bone in figure.bones(part, fingers, side)]
            if part == TRUNK and fingers and side is None and figure.head is not None:
                segments += [np.stack(ends) for ends in pairwise(_head_ring(*seen[list(figure.head)]))]
            if segments:
                out.append((np.stack(segments), colour, width))
    return out


def _head_ring(low: FloatArray, high: FloatArray) -> FloatArray:
    """An ellipse (n, 2) around the head, as tall as the distance from its joint (2,) to its top (2,)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    ring = 0.5 * float(np.linalg.norm(high - low)) * np.stack([0.8 * np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(0.5 * (low + high) + ring)
