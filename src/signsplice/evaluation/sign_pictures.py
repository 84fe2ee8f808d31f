"""A picture of one sign, for who writes it: its postures, and its movements with the hands' paths."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from signsplice.render.picture import Image, dotted, draw, draw_hand, make_scene
from signsplice.render.sheet import write_cells
from signsplice.rig.naming import SIDES
from signsplice.signer.planner import IsolatedWord

_MOST_COLUMNS = 10
DOT = (204, 24, 84)
"""Colour of paths and places."""


def write_preview(word: IsolatedWord, path: Path, size: int = 230) -> None:
    """Write one sign as PNG: its postures, and each movement half way with the paths of the hands that act, from the
    front and from the side; below, these hands alone.
    """
    steps = list(_steps(word))[:_MOST_COLUMNS]
    acting = [side for side in SIDES if word.sign.two_handed or (side == "left") == word.signer.left_handed]
    scenes = [make_scene(word.clip, view) for view in ("front", "side")]
    cells: list[tuple[Image, str]] = []
    for scene in scenes:
        for frame, label, frames in steps:
            trail = scene.hands[frames, [SIDES.index(side) for side in acting]].reshape(-1, 3)
            cells.append((dotted(draw(scene, frame, size, size), scene, trail, DOT, 2.0), label))
    for side in acting:
        cells += [(draw_hand(scenes[0], frame, side, size), f"{side} hand") for frame, _, _ in steps]
    write_cells(cells, path, len(steps))


def _steps(word: IsolatedWord) -> Iterator[tuple[int, str, slice]]:
    """Frames to show, what each is, and the frames whose paths are drawn: the first posture, and of each movement, of
    its first pass, the middle and the end.
    """
    yield word.events.start, word.sign.gloss, slice(0)
    for n, one in enumerate(word.segments, 1):
        if one.segment.kind == "M":
            begin, stop = one.passes[0] if one.passes else (one.begin, one.end)
            times = f", {one.segment.times} times" if one.segment.times > 1 else ""
            yield (begin + stop) // 2, f"{n}: M{times}", slice(begin, stop + 1)
            yield stop, f"{n}: end of M", slice(0)
