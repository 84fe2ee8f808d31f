"""Figures 6 and 7: transition frames of the systems beside the truth, as figures of bones with the strong hand
enlarged.

Bones are drawn straight from the predicted positions, so that a hand out of shape is seen out of shape; the truth lies
under every prediction in grey.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.paper import kept_frames, published
from signsplice.paper.kept_frames import KeptFrames
from signsplice.paper.results import CLASSICAL, OWN
from signsplice.synth.signer import JOINTS, skeleton

Float = NDArray[np.float64]
Stroke = tuple[int, str, float, float]
"""How a line is drawn: what it lies above, colour, width, opacity."""

SHOWN = ("lstm", "transformer", "lpt")
"""The systems in the paper's figures 6 and 7; ConvS2S is left out there because it does so badly."""
MOST_COLUMNS = 8
CELL, HAND_CELL, GAP, LABELS, HEADS = 1.0, 0.6, 0.05, 1.15, 0.42
"""Inches."""
TRUTH = "truth"
HAND_REACH = 0.055
"""Half the side of the window around the strong hand, in the numbers' unit: 12 cm."""
_TRUNK, _RIGHT, _LEFT, _TRUE = "#6b6b70", "#de8e20", "#3f6fa8", "#c9c5bd"


def draw_shots(pyplot: Any, chosen: Sequence[KeptFrames], scale: str) -> Any:
    """A matplotlib figure of some shots under one another, a row for the truth and one for each system; None where no
    system's frames are kept.
    """
    rows = [(shot, name, frames) for shot in chosen for name, frames in _rows(shot, scale)]
    if len(rows) <= len(chosen):
        return None
    columns = min(MOST_COLUMNS, max(len(frames) for _, _, frames in rows)) + 2
    pitch = CELL + HAND_CELL + 3 * GAP
    size = (LABELS + columns * (CELL + GAP) + GAP, pitch * len(rows) + HEADS * len(chosen) + GAP)
    figure = pyplot.figure(figsize=size)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, size[0]), ylim=(0.0, size[1]))  # one unit an inch
    ax.axis("off")
    window = _window(chosen)
    strokes: dict[Stroke, list[Float]] = {}
    top = size[1]
    for shot, name, frames in rows:
        whole = np.concatenate([shot.before, frames, shot.after])
        true = np.concatenate([shot.before, shot.truth, shot.after])
        strong = _strong(true)
        if name == TRUTH:
            ax.text(LABELS + GAP, top - 0.16, shot.name, fontsize=8, weight="bold", va="center")
            top -= HEADS
        ax.text(LABELS - GAP, top - 0.5 * CELL, name, fontsize=8, ha="right", va="center")
        for column, at in enumerate(_shown(len(whole), columns)):
            left = LABELS + column * (CELL + GAP)
            under = None if name == TRUTH else true[round(at * (len(true) - 1) / (len(whole) - 1))]
            kept = at in (0, len(whole) - 1)
            if name == TRUTH:
                ax.text(left + 0.5 * CELL, top + 0.08, "kept" if kept else str(at), fontsize=7, ha="center")
            hand = _around(true[0] if at == 0 else whole[at], strong)
            _cell(strokes, (left, top - CELL, CELL, CELL), whole[at], under, window, kept)
            low = top - CELL - GAP - HAND_CELL
            _cell(strokes, (left, low, CELL, HAND_CELL), whole[at], under, hand, kept, strong)
        top -= pitch
    _stroke(ax, strokes)
    return figure


def _rows(shot: KeptFrames, scale: str) -> list[tuple[str, Float]]:
    """Names and frames of a shot's rows: the truth, the systems of the paper's figures, Hermite at the true places."""
    out = [(TRUTH, shot.truth)]
    for system in SHOWN:
        frames = shot.made.get(kept_frames.label(system, scale, "adamw"))
        if frames is not None and len(frames):
            out.append((published.name(system), frames))
    for (system, told), scale_of, name in (
        (kept_frames.HERMITE, CLASSICAL, "Hermite, told\npositions\nand length"),
        (kept_frames.SIGNSPLICE, OWN, "signsplice"),
    ):
        frames = shot.made.get(kept_frames.label(system, scale_of, "", told))
        if frames is not None and len(frames):
            out.append((name, frames))
    return out


def _shown(count: int, columns: int) -> list[int]:
    """Which of ``count`` frames stand in the columns: all, or evenly chosen ones, first and last among them."""
    return list(dict.fromkeys(np.linspace(0, count - 1, min(count, columns)).round().astype(int).tolist()))


def _strong(frames: Float) -> str:
    """The hand that moves more."""
    moved = {s: float(np.ptp(_places(frames)[:, JOINTS[f"{s}Hand"]], axis=0).sum()) for s in ("Right", "Left")}
    return max(moved, key=lambda side: moved[side])


def _places(frames: Float) -> Float:
    return frames.reshape(-1, len(JOINTS), 3)


def _window(chosen: Sequence[KeptFrames]) -> tuple[float, float, float, float]:
    """What every picture of a body shows: head, hands and hips of all true frames, as a square."""
    points = np.concatenate([_places(part) for shot in chosen for part in (shot.before, shot.truth, shot.after)])
    upper = points[:, [n for name, n in JOINTS.items() if not _is_leg(name)]].reshape(-1, 3)
    low, high = upper[:, :2].min(axis=0) - 0.02, upper[:, :2].max(axis=0) + 0.02
    half = 0.5 * float((high - low).max())
    x, y = 0.5 * (low + high)
    return float(x) - half, float(x) + half, float(y) - half, float(y) + half


def _around(frame: Float, side: str) -> tuple[float, float, float, float]:
    x, y, _ = _places(frame)[0, JOINTS[f"{side}HandMiddle1"]]
    aspect = CELL / HAND_CELL
    return x - aspect * HAND_REACH, x + aspect * HAND_REACH, y - HAND_REACH, y + HAND_REACH


def _cell(
    strokes: dict[Stroke, list[Float]],
    box: tuple[float, float, float, float],
    frame: Float,
    under: Float | None,
    window: tuple[float, float, float, float],
    kept: bool,
    hand: str | None = None,
) -> None:
    """Add one picture in a box (left, bottom, width, height) to the strokes: the bones of a frame (159), those of the
    truth under them, framed to a window (left, right, bottom, top) and cut off at the box.
    """
    low, size = np.array(box[:2]), np.array(box[2:])
    frame_of_box = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * size + low
    strokes.setdefault((-1, "#d8d4cc", 0.6, 1.0), []).append(np.stack([frame_of_box[:-1], frame_of_box[1:]], axis=1))
    corner, scale = np.array([window[0], window[2]]), box[2] / (window[1] - window[0])
    for positions, faint in ((under, True), (frame, False)):
        if positions is None:
            continue
        for order, (segments, colour, width) in enumerate(_bones(positions, hand)):
            placed = clipped((segments - corner) * scale + low, low, low + size)
            key = (0, _TRUE, 1.8 * width, 1.0) if faint else (1 + order, colour, width, 0.55 if kept else 1.0)
            strokes.setdefault(key, []).append(placed)


def _stroke(ax: Any, strokes: dict[Stroke, list[Float]]) -> None:
    """Draw all strokes of a kind as one line, broken by NaN: a figure has thousands of bones."""
    for (order, colour, width, alpha), parts in strokes.items():
        segments = np.concatenate(parts)
        points = np.concatenate([segments, np.full((len(segments), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        ax.plot(*points.T, color=colour, lw=width, alpha=alpha, zorder=2 + order, solid_capstyle="round")


def clipped(segments: Float, low: Float, high: Float) -> Float:
    """The parts of segments (n, 2, 2) inside a box from ``low`` (2,) to ``high`` (2,) (Liang and Barsky 1984)."""
    start, way = segments[:, 0], segments[:, 1] - segments[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - start) / way, (high - start) / way
    still = way == 0.0
    inside = (start >= low) & (start <= high)
    enter = np.where(still, np.where(inside, 0.0, 2.0), np.minimum(first, second)).max(axis=1)
    leave = np.where(still, 1.0, np.maximum(first, second)).min(axis=1)
    enter, leave = np.maximum(enter, 0.0), np.minimum(leave, 1.0)
    there = enter < leave
    ends = np.stack([enter, leave], axis=1)[there]
    return np.asarray(start[there, None] + ends[..., None] * way[there, None])


def _bones(frame: Float, hand: str | None) -> list[tuple[Float, str, float]]:
    """Bones of the upper body, or of one hand, as seen from the front: segments (n, 2, 2), colour, width; trunk and
    head, then the left arm and the right.
    """
    places = _places(frame)[0]
    parents = skeleton().parents
    groups: dict[tuple[str, float], list[Float]] = {}
    for colour in (_TRUNK, _LEFT, _RIGHT):
        for width in (2.0, 1.6 if hand else 0.7):
            groups[colour, width] = []
    for name, joint in JOINTS.items():
        if joint == 0 or _is_leg(name) or name == "HeadTop_End" or (hand is not None and f"{hand}Hand" not in name):
            continue
        colour = _RIGHT if name.startswith("Right") else _LEFT if name.startswith("Left") else _TRUNK
        finger = "Hand" in name and name not in ("RightHand", "LeftHand")
        groups[colour, (1.6 if hand else 0.7) if finger else 2.0].append(places[[parents[joint], joint], :2])
    if hand is None:
        ring = _head(places)
        groups[_TRUNK, 0.7] += [np.stack(ends) for ends in pairwise(ring)]
    return [(np.stack(segments), *key) for key, segments in groups.items() if segments]


def _head(places: Float) -> Float:
    """A ring (n, 2) around the head, as tall as from its joint to its top."""
    low, high = places[JOINTS["Head"], :2], places[JOINTS["HeadTop_End"], :2]
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    ring = 0.5 * float(np.linalg.norm(high - low)) * np.stack([0.8 * np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(0.5 * (low + high) + ring)


def _is_leg(name: str) -> bool:
    return any(part in name for part in ("Leg", "Foot", "Toe"))
