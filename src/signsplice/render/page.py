"""Captions, colours and marks that pages and films share, and access to Pillow."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

from signsplice.errors import MissingExtraError

INK, PAPER = (45, 45, 50), (244, 241, 236)
SIGN, TRANSITION = (108, 128, 160), (222, 142, 32)

_FONTS = ("NotoSans-Regular.ttf", "DejaVuSans.ttf", "Arial Unicode.ttf", "arial.ttf", "Arial.ttf")


@dataclass(frozen=True)
class Mark:
    """A span of frames to mark.

    kind: "sign" or "transition".
    name: of the word, may be empty.
    start: first frame.
    stop: frame after the last.
    """

    kind: str
    name: str
    start: int
    stop: int


def pillow(module: str) -> ModuleType:
    """A module of Pillow. Raises ``MissingExtraError`` where it is not installed."""
    try:
        return import_module(f"PIL.{module}")
    except ImportError as error:
        raise MissingExtraError("pictures need Pillow: pip install '.[video]' in signsplice's folder") from error


def mark_at(marks: Sequence[Mark], frame: int) -> Mark | None:
    """The mark that contains a frame, None where none does."""
    return next((mark for mark in marks if mark.start <= frame < mark.stop), None)


def caption(marks: Sequence[Mark], frame: int) -> tuple[str, bool]:
    """The caption of a frame, and whether it is in a transition: the word, or the words before and after."""
    mark = mark_at(marks, frame)
    if mark is None or mark.kind != "transition":
        return (mark.name if mark is not None else ""), False
    around = mark_at(marks, mark.start - 1), mark_at(marks, mark.stop)
    if mark.name or not all(around):
        return mark.name or "transition", True
    return " > ".join(side.name for side in around if side is not None), True


def write_line(
    pen: Any, text: str, centre: float, top: float, width: float, ink: tuple[int, int, int], size: int
) -> None:
    """Draw one centred line with a Pillow pen; where it is wider than ``width`` pixels, its end becomes dots."""
    text, font = _text_and_font(text, size)
    if pen.textlength(text, font=font) > width:
        while text and pen.textlength(text + "...", font=font) > width:
            text = text[:-1]
        text += "..."
    pen.text((centre - 0.5 * pen.textlength(text, font=font), top), text, fill=ink, font=font)


def _text_and_font(text: str, size: int) -> tuple[str, Any]:
    """The text and a font that has its letters.

    Pillow's own font has only ASCII. Other letters need a font of the system; without one, accents are removed, and
    letters that are not accented Latin become "?".
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
