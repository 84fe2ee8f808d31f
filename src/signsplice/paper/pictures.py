"""Figures 6 and 7: transition frames of the systems and the truth, drawn as bones, with the dominant hand enlarged.

The bones join the predicted positions directly, so that a distorted hand is visible. The truth is drawn in grey under
every prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.paper import kept_frames, published
from signsplice.paper.kept_frames import KeptFrames
from signsplice.paper.results import CLASSICAL, SHIPPED
from signsplice.synth.signer import JOINTS, skeleton

Float = NDArray[np.float64]
Stroke = tuple[int, str, float, float]
"""How a line is drawn: depth order, colour, width, opacity."""
Window = tuple[float, float, float, float]
"""A rectangle: left, right, bottom, top."""

SHOWN = ("lstm", "transformer", "lpt")
"""The systems in the paper's figures 6 and 7; the paper leaves ConvS2S out because of its low scores."""
MOST_COLUMNS = 8
CELL, HAND_CELL, GAP, LABELS, HEADS = 1.0, 0.6, 0.05, 1.15, 0.42
"""Inches."""
TRUTH = "truth"
HAND_REACH = 0.055
"""Half the side of the window around the dominant hand, in the numbers' unit: 12 cm."""
_TRUNK, _RIGHT, _LEFT, _TRUE = "#6b6b70", "#de8e20", "#3f6fa8", "#c9c5bd"


def draw_pairs(pyplot: Any, chosen: Sequence[KeptFrames], scale: str) -> Any:
    """A matplotlib figure of the chosen pairs, with a row for the truth and one for each system; None if no system's
    frames are kept.
    """
    rows = [(pair, name, frames) for pair in chosen for name, frames in _rows(pair, scale)]
    if len(rows) <= len(chosen):
        return None
    columns = min(MOST_COLUMNS, max(len(frames) for _, _, frames in rows)) + 2
    pitch = CELL + HAND_CELL + 3 * GAP
    size = (LABELS + columns * (CELL + GAP) + GAP, pitch * len(rows) + HEADS * len(chosen) + GAP)
    figure = pyplot.figure(figsize=size)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, size[0]), ylim=(0.0, size[1]))  # one unit is an inch
    ax.axis("off")
    window = _body_window(chosen)
    strokes: dict[Stroke, list[Float]] = {}
    top = size[1]
    for pair, name, frames in rows:
        whole = np.concatenate([pair.before, frames, pair.after])
        true = np.concatenate([pair.before, pair.truth, pair.after])
        side = _dominant_side(true)
        if name == TRUTH:
            ax.text(LABELS + GAP, top - 0.16, pair.name, fontsize=8, weight="bold", va="center")
            top -= HEADS
        ax.text(LABELS - GAP, top - 0.5 * CELL, name, fontsize=8, ha="right", va="center")
        for column, at in enumerate(_shown(len(whole), columns)):
            left = LABELS + column * (CELL + GAP)
            under = None if name == TRUTH else true[round(at * (len(true) - 1) / (len(whole) - 1))]
            kept = at in (0, len(whole) - 1)
            if name == TRUTH:
                ax.text(left + 0.5 * CELL, top + 0.08, "kept" if kept else str(at), fontsize=7, ha="center")
            hand_window = _hand_window(true[0] if at == 0 else whole[at], side)
            _cell(strokes, (left, top - CELL, CELL, CELL), whole[at], under, window, kept)
            bottom = top - CELL - GAP - HAND_CELL
            _cell(strokes, (left, bottom, CELL, HAND_CELL), whole[at], under, hand_window, kept, side)
        top -= pitch
    _stroke(ax, strokes)
    return figure


def _rows(pair: KeptFrames, scale: str) -> list[tuple[str, Float]]:
    """Names and frames of a pair's rows: the truth, the systems of the paper's figures, Hermite at the true positions
    and the product.
    """
    out = [(TRUTH, pair.truth)]
    for system in SHOWN:
        frames = pair.made.get(kept_frames.label(system, scale, "adamw"))
        if frames is not None and len(frames):
            out.append((published.name(system), frames))
    for (system, given), clip_scale, name in (
        (kept_frames.HERMITE, CLASSICAL, "Hermite, given\npositions\nand length"),
        (kept_frames.PRODUCT, SHIPPED, "signsplice"),
    ):
        frames = pair.made.get(kept_frames.label(system, clip_scale, "", given))
        if frames is not None and len(frames):
            out.append((name, frames))
    return out


def _shown(count: int, columns: int) -> list[int]:
    """The frames shown of ``count``: all, or as many as columns, evenly spaced from first to last."""
    return list(dict.fromkeys(np.linspace(0, count - 1, min(count, columns)).round().astype(int).tolist()))


def _dominant_side(frames: Float) -> str:
    """The side of the hand that moves more: Right or Left."""
    ranges = {s: float(np.ptp(_positions(frames)[:, JOINTS[f"{s}Hand"]], axis=0).sum()) for s in ("Right", "Left")}
    return max(ranges, key=lambda side: ranges[side])


def _positions(frames: Float) -> Float:
    """Joint positions (T, 53, 3) of frames (T, 159)."""
    return frames.reshape(-1, len(JOINTS), 3)


def _body_window(chosen: Sequence[KeptFrames]) -> Window:
    """The square around head, hands and hips of all true frames, shown in every picture of a body."""
    points = np.concatenate([_positions(part) for pair in chosen for part in (pair.before, pair.truth, pair.after)])
    upper = points[:, [n for name, n in JOINTS.items() if not _is_leg(name)]].reshape(-1, 3)
    low, high = upper[:, :2].min(axis=0) - 0.02, upper[:, :2].max(axis=0) + 0.02
    half = 0.5 * float((high - low).max())
    x, y = 0.5 * (low + high)
    return float(x) - half, float(x) + half, float(y) - half, float(y) + half


def _hand_window(frame: Float, side: str) -> Window:
    """The rectangle around a hand of a frame (159)."""
    x, y, _ = _positions(frame)[0, JOINTS[f"{side}HandMiddle1"]]
    aspect = CELL / HAND_CELL
    return x - aspect * HAND_REACH, x + aspect * HAND_REACH, y - HAND_REACH, y + HAND_REACH


def _cell(
    strokes: dict[Stroke, list[Float]],
    box: tuple[float, float, float, float],
    frame: Float,
    under: Float | None,
    window: Window,
    kept: bool,
    side: str | None = None,
) -> None:
    """Add one picture to the strokes: the bones of a frame (159) over those of the truth, clipped to a box (left,
    bottom, width, height) that shows a window of the positions. ``side``: draw only this hand.
    """
    low, size = np.array(box[:2]), np.array(box[2:])
    outline = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * size + low
    strokes.setdefault((-1, "#d8d4cc", 0.6, 1.0), []).append(np.stack([outline[:-1], outline[1:]], axis=1))
    corner, scale = np.array([window[0], window[2]]), box[2] / (window[1] - window[0])
    for positions, faint in ((under, True), (frame, False)):
        if positions is None:
            continue
        for order, (segments, colour, width) in enumerate(_bones(positions, side)):
            visible = clipped((segments - corner) * scale + low, low, low + size)
            key = (0, _TRUE, 1.8 * width, 1.0) if faint else (1 + order, colour, width, 0.55 if kept else 1.0)
            strokes.setdefault(key, []).append(visible)


def _stroke(ax: Any, strokes: dict[Stroke, list[Float]]) -> None:
    """Draw all strokes of a kind as one line with breaks at NaN, since a figure has thousands of bones."""
    for (order, colour, width, alpha), parts in strokes.items():
        segments = np.concatenate(parts)
        points = np.concatenate([segments, np.full((len(segments), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        ax.plot(*points.T, color=colour, lw=width, alpha=alpha, zorder=2 + order, solid_capstyle="round")


def clipped(segments: Float, low: Float, high: Float) -> Float:
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


def _bones(frame: Float, side: str | None) -> list[tuple[Float, str, float]]:
    """Bones of the upper body, or of one hand, seen from the front: segments (n, 2, 2), colour, width. Trunk and head
    come first, then the left arm, then the right.
    """
    positions = _positions(frame)[0]  # (53, 3)
    parents = skeleton().parents
    thin = 1.6 if side else 0.7
    groups: dict[tuple[str, float], list[Float]] = {}
    for colour in (_TRUNK, _LEFT, _RIGHT):
        for width in (2.0, thin):
            groups[colour, width] = []
    for name, joint in JOINTS.items():
        if joint == 0 or _is_leg(name) or name == "HeadTop_End" or (side is not None and f"{side}Hand" not in name):
            continue
        colour = _RIGHT if name.startswith("Right") else _LEFT if name.startswith("Left") else _TRUNK
        finger = "Hand" in name and name not in ("RightHand", "LeftHand")
        groups[colour, thin if finger else 2.0].append(positions[[parents[joint], joint], :2])
    if side is None:
        groups[_TRUNK, thin] += [np.stack(ends) for ends in pairwise(_head_ring(positions))]
    return [(np.stack(segments), *key) for key, segments in groups.items() if segments]


def _head_ring(positions: Float) -> Float:
    """An ellipse (n, 2) around the head, as tall as the distance from its joint to its top."""
    low, high = positions[JOINTS["Head"], :2], positions[JOINTS["HeadTop_End"], :2]
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    ring = 0.5 * float(np.linalg.norm(high - low)) * np.stack([0.8 * np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(0.5 * (low + high) + ring)


def _is_leg(name: str) -> bool:
    return any(part in name for part in ("Leg", "Foot", "Toe"))
