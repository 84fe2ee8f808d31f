"""Strips: many clips on one page, one row each, with a hand enlarged under every picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from signsplice.formats.atomic import replacing
from signsplice.motion.clip import Clip
from signsplice.render.page import INK, PAPER, TRANSITION, Progress, pillow, write_line
from signsplice.render.picture import draw, draw_hand, make_scene


@dataclass(frozen=True)
class Strip:
    """A row of a page.

    clip: the clip.
    caption: text above the row.
    frames: frames to show.
    marked: those of them that are in a transition.
    view: one of ``picture.VIEWS``.
    hand: the hand to enlarge, "left", "right" or "".
    """

    clip: Clip
    caption: str
    frames: Sequence[int]
    marked: Sequence[int] = ()
    view: str = "front"
    hand: str = "right"


def write_strips(
    strips: Sequence[Strip], path: Path, cell: int = 150, hand: int = 84, progress: Progress | None = None
) -> None:
    """Write a page of strips as PNG; ``cell`` and ``hand``: side of pictures and of enlarged hands in px (0: none)."""
    image_ = pillow("Image")
    columns = max(len(strip.frames) for strip in strips)
    label, gap = 20, 6
    height = label + cell + hand + gap
    sheet = image_.new("RGB", (columns * (cell + gap) + gap, len(strips) * height), PAPER)
    pen = pillow("ImageDraw").Draw(sheet)
    for n, strip in enumerate(strips):
        top = n * height
        scene = make_scene(strip.clip, strip.view)
        write_line(pen, strip.caption, 0.5 * sheet.width, top + 2, sheet.width - gap, INK, 14)
        for k, frame in enumerate(strip.frames):
            left = gap + k * (cell + gap)
            sheet.paste(image_.fromarray(draw(scene, frame, cell, cell)), (left, top + label))
            if strip.hand and hand:
                enlarged = image_.fromarray(draw_hand(scene, frame, strip.hand, hand))
                sheet.paste(enlarged, (left + (cell - hand) // 2, top + label + cell))
            if frame in strip.marked:
                box = (left - 1, top + label - 1, left + cell, top + label + cell + hand)
                pen.rectangle(box, outline=TRANSITION, width=2)
        if progress is not None:
            progress(n + 1, len(strips))
    with replacing(path) as temporary:
        sheet.quantize(256, dither=image_.Dither.NONE).save(temporary, format="PNG", optimize=True)
