"""Tables as data, and their two written forms: Markdown and LaTeX."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

_TEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
}
_WIDTH = 160
"""Characters of a line of notes in Markdown."""
RULE: tuple[str, ...] = ()
"""A row without cells: a horizontal line."""


@dataclass(frozen=True)
class Table:
    """A table.

    - caption: text above the table
    - label: name for references
    - head: column heads
    - rows: as many cells as heads in each row, or ``RULE``
    - notes: paragraphs below the table; text between backquotes is set as code
    """

    caption: str
    label: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if row and len(row) != len(self.head):
                raise ValueError(f"table {self.label}: {len(row)} cells under {len(self.head)} heads: {row}")


def markdown(table: Table) -> str:
    """A table as Markdown, with its caption and notes."""
    rows = [row for row in table.rows if row]
    lines = [f"**{table.caption}**", "", _line(table.head), _line(["---"] * len(table.head)), *map(_line, rows), ""]
    for note in table.notes:
        lines += [*textwrap.wrap(note, _WIDTH, break_long_words=False, break_on_hyphens=False), ""]
    return "\n".join(lines)


def latex(table: Table) -> str:
    """A table as LaTeX, with its caption and notes; needs no package."""
    body = [r"\hline" if not row else " & ".join(map(escape, row)) + r" \\" for row in table.rows]
    notes = [rf"\par {_note(note)}" for note in table.notes]
    return "\n".join(
        [
            r"\begin{table}",
            rf"\caption{{{escape(table.caption)}}}",
            rf"\label{{tab:{table.label}}}",
            r"\centering\scriptsize\setlength{\tabcolsep}{3pt}",
            rf"\begin{{tabular}}{{{'l' * 2}{'r' * (len(table.head) - 2)}}}",
            r"\hline",
            " & ".join(map(escape, table.head)) + r" \\",
            r"\hline",
            *body,
            r"\hline",
            r"\end{tabular}",
            *notes,
            r"\end{table}",
            "",
        ]
    )


def escape(text: str) -> str:
    """Text with the characters that are LaTeX commands escaped."""
    return "".join(_TEX.get(character, character) for character in text)


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


def _note(note: str) -> str:
    parts = note.split("`")  # odd parts stood between backquotes
    return "".join(
        escape(part)
        if n % 2 == 0
        else r"\texttt{" + escape(part).replace(r"\textbar{}", r"\textbar{}\allowbreak{}") + "}"
        for n, part in enumerate(parts)
    )
