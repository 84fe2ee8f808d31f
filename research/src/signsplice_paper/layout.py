"""Tables as data, and as Markdown."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

_WIDTH = 160
"""Characters of a line of notes in Markdown."""


@dataclass(frozen=True)
class Table:
    """A table.

    - caption: text above the table
    - label: name for references
    - head: column heads
    - rows: as many cells as heads in each row
    - notes: paragraphs below the table; text between backquotes is set as code
    """

    caption: str
    label: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.head):
                raise ValueError(f"table {self.label}: {len(row)} cells under {len(self.head)} heads: {row}")


def markdown(table: Table) -> str:
    """A table as Markdown, with its caption and notes."""
    lines = [
        f"**{table.caption}**",
        "",
        _line(table.head),
        _line(["---"] * len(table.head)),
        *map(_line, table.rows),
        "",
    ]
    return "\n".join([*lines, *(f"{text}\n" for text in paragraphs(table.notes))])


def paragraphs(notes: Sequence[str]) -> list[str]:
    """Notes as wrapped paragraphs."""
    wrapped = (textwrap.wrap(note, _WIDTH, break_long_words=False, break_on_hyphens=False) for note in notes)
    return ["\n".join(lines) for lines in wrapped]


def number(value: float, digits: int = 3) -> str:
    """A score as text; "-" for NaN."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def short(value: float) -> str:
    """A small score with two significant figures: 0.0015, 0.012; "-" for NaN."""
    if not math.isfinite(value):
        return "-"
    if value == 0.0:
        return "0"
    return f"{value:.{max(1, 1 - math.floor(math.log10(abs(value))))}f}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
