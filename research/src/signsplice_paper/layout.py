"""Tables as data, and their text in Markdown."""

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


def format_markdown(table: Table) -> str:
    """Returns a table as Markdown, with its caption and notes."""
    lines = [
        f"**{table.caption}**",
        "",
        _format_line(table.head),
        _format_line(["---"] * len(table.head)),
        *map(_format_line, table.rows),
        "",
    ]
    return "\n".join([*lines, *(f"{text}\n" for text in wrap_paragraphs(table.notes))])


def wrap_paragraphs(notes: Sequence[str]) -> list[str]:
    """Returns notes as wrapped paragraphs."""
    wrapped = (textwrap.wrap(note, _WIDTH, break_long_words=False, break_on_hyphens=False) for note in notes)
    return ["\n".join(lines) for lines in wrapped]


def format_number(value: float, digits: int = 3) -> str:
    """Returns a score as text; "-" for NaN."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def format_short(value: float) -> str:
    """Returns a small score with two significant figures: 0.0015, 0.012; "-" for NaN."""
    if not math.isfinite(value):
        return "-"
    if value == 0.0:
        return "0"
    return f"{value:.{max(1, 1 - math.floor(math.log10(abs(value))))}f}"


def _format_line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
