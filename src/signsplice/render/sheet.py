"""Contact sheets: frames of a clip on one page, densest at seams, with both hands enlarged under every frame; and
strips: many clips on one page, one row each. Films share the captions, colours and marks.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.formats.atomic import replacing
from signsplice.motion import Clip
from signsplice.progress import Progress, track_progress
from signsplice.render.picture import Image, Scene, draw, draw_hand, has_hands, make_scene
from signsplice.render.skin import pillow


@dataclass(frozen=True)
class SheetLayout:
    """Sizes and numbers of the cells of a contact sheet."""

    picture_px: tuple[int, int] = (224, 224)
    """Width and height of the picture in each cell, pixels."""
    hand_px: int = 110
    """Side of each enlarged hand, pixels."""
    gap_px: int = 8
    """Gap between cells, pixels."""
    line_px: int = 20
    """Height of a line of text, pixels."""
    n_columns: int = 8
    """Largest number of columns."""
    n_cells: int = 32
    """Usual number of cells."""


_LAYOUT = SheetLayout()

INK = (45, 45, 50)
"""Colour of text, RGB 0 to 255."""
PAPER = (244, 241, 236)
"""Colour of the background."""
SIGN = (108, 128, 160)
"""Colour of signs."""
TRANSITION = (222, 142, 32)
"""Colour of transitions."""
RETRACTION = (176, 184, 198)
"""Colour of a sentence's retraction: ``SIGN`` half as strong."""

_FONTS = ("NotoSans-Regular.ttf", "DejaVuSans.ttf", "Arial Unicode.ttf", "arial.ttf", "Arial.ttf")
"""System fonts for letters beyond ASCII, in order of preference."""


@dataclass(frozen=True)
class Mark:
    """A span of frames to mark.

    kind: "sign", "transition" or "retraction".
    name: the word, may be empty.
    start: first frame.
    stop: frame after the last.
    """

    kind: str
    name: str
    start: int
    stop: int

    @property
    def colour(self) -> tuple[int, int, int]:
        """Its colour in a time line."""
        return {"transition": TRANSITION, "retraction": RETRACTION}.get(self.kind, SIGN)


def mark_at(marks: Sequence[Mark], frame: int) -> Mark | None:
    """Returns the mark that contains a frame, or None."""
    return next((mark for mark in marks if mark.start <= frame < mark.stop), None)


def caption(marks: Sequence[Mark], frame: int) -> tuple[str, tuple[int, int, int]]:
    """Returns the caption of a frame (the word, or the words before and after) and its colour: ``TRANSITION`` in a
    transition, ``SIGN`` in a retraction, else ``INK``.
    """
    mark = mark_at(marks, frame)
    if mark is None or mark.kind != "transition":
        return (mark.name, SIGN if mark.kind == "retraction" else INK) if mark is not None else ("", INK)
    around = mark_at(marks, mark.start - 1), mark_at(marks, mark.stop)
    if mark.name or not all(around):
        return mark.name or "transition", TRANSITION
    return " > ".join(side.name for side in around if side is not None), TRANSITION


def write_line(
    pen: Any, text: str, centre: float, top: float, width: float, ink: tuple[int, int, int], size: int
) -> None:
    """Draw one line, centred at ``centre``, with a Pillow pen; if it is wider than ``width``, dots replace its end.
    ``top``: of the letters, ``size``: of the font; all in pixels.
    """
    text, font = _text_and_font(text, size)
    if pen.textlength(text, font=font) > width:
        while text and pen.textlength(text + "...", font=font) > width:
            text = text[:-1]
        text += "..."
    pen.text((centre - 0.5 * pen.textlength(text, font=font), top), text, fill=ink, font=font)


def _text_and_font(text: str, size: int) -> tuple[str, Any]:
    """Returns the text and a font of ``size`` pixels that has its letters.

    Pillow's own font has only ASCII. Other letters need a system font; without one, accents are removed and letters
    other than accented Latin become "?".
    """
    font_ = pillow("ImageFont")
    if not text.isascii():
        for name in _FONTS:
            try:
                return text, font_.truetype(name, size)
            except OSError:
                continue
        bare = unicodedata.normalize("NFKD", text.replace("\N{LATIN SMALL LETTER SHARP S}", "ss"))
        text = "".join(letter for letter in bare if not unicodedata.combining(letter))
        text = text.encode("ascii", "replace").decode()
    return text, font_.load_default(size)


def write_sheet(clip: Clip, scene: Scene, path: Path, marks: Sequence[Mark], progress: Progress | None) -> None:
    """Write a sheet as PNG, with word, frame number and time under each picture and an amber border at transitions."""
    frames = sheet_frames(len(clip), marks)
    hands = has_hands(clip)
    columns = min(_LAYOUT.n_columns, len(frames))
    w, h = cell_size(hands)
    (width, height), gap, line = _LAYOUT.picture_px, _LAYOUT.gap_px, _LAYOUT.line_px
    image_ = pillow("Image")
    sheet = image_.new("RGB", (columns * w, -(-len(frames) // columns) * h), PAPER)
    pen = pillow("ImageDraw").Draw(sheet)
    for n, frame in enumerate(track_progress(frames, progress)):
        x, y = n % columns * w + gap // 2, n // columns * h + gap // 2
        sheet.paste(image_.fromarray(draw(scene, frame, width, height)), (x, y))
        text, ink = caption(marks, frame)
        centre, below = x + 0.5 * width, y + height
        write_line(pen, text, centre, below + 2, width - gap, ink, 15)
        write_line(pen, f"frame {frame}   {frame / clip.fps:.2f} s", centre, below + line, width - gap, INK, 13)
        if hands:  # the signer's right hand on the left, as in the picture
            for side, hand_x in (("right", x + 1), ("left", x + width - _LAYOUT.hand_px - 1)):
                enlarged = image_.fromarray(draw_hand(scene, frame, side, _LAYOUT.hand_px))
                sheet.paste(enlarged, (hand_x, below + 2 * line))
        if ink == TRANSITION:
            pen.rectangle((x - 2, y - 2, x + w - gap + 1, y + h - gap + 1), outline=TRANSITION, width=3)
    sheet.save(path, format="PNG")


def cell_size(hands: bool) -> tuple[int, int]:
    """Returns width and height of a cell with its gap, pixels; ``hands``: with enlarged hands."""
    (width, height), gap = _LAYOUT.picture_px, _LAYOUT.gap_px
    return width + gap, height + 2 * _LAYOUT.line_px + (_LAYOUT.hand_px if hands else 0) + gap


def sheet_frames(n_frames: int, marks: Sequence[Mark], n_cells: int = _LAYOUT.n_cells) -> list[int]:
    """Returns the frames of a contact sheet: the kept frames at both sides of every seam, the ends and the middle of
    every transition, and evenly spread frames in the remaining cells.
    """
    chosen: set[int] = set()
    for mark in marks:
        if mark.kind == "transition":
            chosen |= {mark.start - 1, mark.start, (mark.start + mark.stop - 1) // 2, mark.stop - 1, mark.stop}
    chosen = {frame for frame in chosen if 0 <= frame < n_frames}
    limit = min(max(n_cells - len(chosen), _LAYOUT.n_columns), n_frames)
    pages = [chosen | set(np.linspace(0, n_frames - 1, n).round().astype(int).tolist()) for n in range(limit, 0, -1)]
    whole_rows = (page for page in pages if len(page) % _LAYOUT.n_columns == 0 or len(page) < _LAYOUT.n_columns)
    return sorted(next(whole_rows, pages[0]))


@dataclass(frozen=True)
class Strip:
    """A row of a page.

    clip: the clip.
    caption: text above the row.
    frames: frames to show.
    marked: the shown frames that get a border: those in a transition.
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
    strips: Sequence[Strip], path: Path, picture_px: int = 150, hand_px: int = 84, progress: Progress | None = None
) -> None:
    """Write a page of strips as PNG. ``picture_px``, ``hand_px``: sides of pictures and of enlarged hands (0: none)."""
    image_ = pillow("Image")
    columns = max(len(strip.frames) for strip in strips)
    label, gap = 20, 6
    height = label + picture_px + hand_px + gap
    sheet = image_.new("RGB", (columns * (picture_px + gap) + gap, len(strips) * height), PAPER)
    pen = pillow("ImageDraw").Draw(sheet)
    for n, strip in enumerate(track_progress(strips, progress)):
        top = n * height
        scene = make_scene(strip.clip, strip.view)
        write_line(pen, strip.caption, 0.5 * sheet.width, top + 2, sheet.width - gap, INK, 14)
        for k, frame in enumerate(strip.frames):
            cell_x = gap + k * (picture_px + gap)
            sheet.paste(image_.fromarray(draw(scene, frame, picture_px, picture_px)), (cell_x, top + label))
            if strip.hand and hand_px:
                enlarged = image_.fromarray(draw_hand(scene, frame, strip.hand, hand_px))
                sheet.paste(enlarged, (cell_x + (picture_px - hand_px) // 2, top + label + picture_px))
            if frame in strip.marked:
                bottom = top + label + picture_px + hand_px
                box = (cell_x - 1, top + label - 1, cell_x + picture_px, bottom)
                pen.rectangle(box, outline=TRANSITION, width=2)
    with replacing(path) as temporary:
        sheet.quantize(96, dither=image_.Dither.NONE).save(temporary, format="PNG", optimize=True)


def write_cells(cells: Sequence[tuple[Image, str]], path: Path, columns: int, colours: int = 0) -> None:
    """Write a page of equal-sized pictures as PNG, each above a line of text; ``colours``: size of palette (0: all)."""
    image_, line = pillow("Image"), 18
    height, width = cells[0][0].shape[:2]
    sheet = image_.new("RGB", (columns * width, -(-len(cells) // columns) * (height + line)), PAPER)
    pen = pillow("ImageDraw").Draw(sheet)
    for n, (picture, text) in enumerate(cells):
        x, y = n % columns * width, n // columns * (height + line)
        sheet.paste(image_.fromarray(picture), (x, y))
        write_line(pen, text, x + 0.5 * width, y + height, width - 4, INK, 12)
    if colours:
        sheet = sheet.quantize(colours, dither=image_.Dither.NONE)
    with replacing(path) as temporary:
        sheet.save(temporary, format="PNG", optimize=True)
