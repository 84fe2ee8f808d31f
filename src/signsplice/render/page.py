"""What stands around a picture: marks of signs and transitions, their colours and captions."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

from signsplice.errors import MissingExtraError

Progress = Callable[[int, int], None]

INK, PAPER = (45, 45, 50), (244, 241, 236)
SIGN, TRANSITION = (108, 128, 160), (222, 142, 32)


_FONTS = ("NotoSans-Regular.ttf", "DejaVuSans.ttf", "Arial Unicode.ttf", "arial.ttf", "Arial.ttf")


@dataclass(frozen=True)
class Mark:
    """A stretch of frames [start, stop) to be marked: kind "sign" or "transition", and the word's name."""

    kind: str
    name: str
    start: int
    stop: int


def pillow(module: str) -> ModuleType:
    """A module of Pillow. Raises ``MissingExtraError`` where it is not installed."""
    try:
        return import_module(f"PIL.{module}")
    except ImportError as error:
        raise MissingExtraError("pictures need Pillow: pip install 'signsplice[video]'") from error


def mark_at(marks: Sequence[Mark], frame: int) -> Mark | None:
    """The mark that a frame lies in, None where none does."""
    return next((mark for mark in marks if mark.start <= frame < mark.stop), None)


def caption(marks: Sequence[Mark], frame: int) -> tuple[str, bool]:
    """What to write under a frame, and whether it lies in a transition: the word, or the words on either side."""
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
    """Draw one centred line with a Pillow pen, cut short with dots where it is wider than ``width`` pixels."""
    text, font = _lettering(text, size)
    if pen.textlength(text, font=font) > width:
        while text and pen.textlength(text + "...", font=font) > width:
            text = text[:-1]
        text += "..."
    pen.text((centre - 0.5 * pen.textlength(text, font=font), top), text, fill=ink, font=font)


def _lettering(text: str, size: int) -> tuple[str, Any]:
    """The text and a font that has its letters.

    Pillow's own font knows ASCII alone. Other letters take a font of the system; where there is none they lose their
    accents, and those that are no accented Latin letters stand as "?".
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
