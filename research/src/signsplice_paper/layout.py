"""Tables as data, and their written forms: Markdown, LaTeX, and CSV of several at once."""

from __future__ import annotations

import csv
import io
import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace

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
    - split: of the corpus, empty where the table is of none
    """

    caption: str
    label: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    split: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if row and len(row) != len(self.head):
                raise ValueError(f"table {self.label}: {len(row)} cells under {len(self.head)} heads: {row}")


def markdown(table: Table) -> str:
    """A table as Markdown, with its caption and notes."""
    rows = [row for row in table.rows if row]
    lines = [f"**{table.caption}**", "", _line(table.head), _line(["---"] * len(table.head)), *map(_line, rows), ""]
    return "\n".join([*lines, *(f"{text}\n" for text in paragraphs(table.notes))])


def paragraphs(notes: Sequence[str]) -> list[str]:
    """Notes as wrapped paragraphs."""
    wrapped = (textwrap.wrap(note, _WIDTH, break_long_words=False, break_on_hyphens=False) for note in notes)
    return ["\n".join(lines) for lines in wrapped]


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


def selected(table: Table, names: Sequence[str] | None, heads: Sequence[str] | None) -> Table:
    """The lines of a table that have a score and whose first cell is one of ``names``, and the columns under ``heads``,
    beside the first two; None: all. Of scores over several seeds the mean alone.
    """
    columns = [n for n, head in enumerate(table.head) if n < 2 or heads is None or head in heads]
    scored = [row for row in table.rows if row and set(row[2:]) - {"", "-"}]
    rows = [row for row in scored if names is None or row[0] in names]
    kept = tuple(tuple(row[n].split(" [")[0] for n in columns) for row in rows)
    return replace(table, head=tuple(table.head[n] for n in columns), rows=kept)


def as_csv(tables: Sequence[Table]) -> str:
    """Tables as one CSV: a line for each split, block and pair of first cells, a column for each head of any table."""
    heads = list(dict.fromkeys(head for table in tables for head in table.head[2:]))
    lines: dict[tuple[str, ...], dict[str, str]] = {}
    for table in tables:
        block = ""
        for row in filter(None, table.rows):
            if not any(row[1:]):
                block = row[0].removesuffix(":")
                continue
            known = lines.setdefault((table.split, block, *row[:2]), {})
            for head, cell in zip(table.head[2:], row[2:], strict=True):
                if known.setdefault(head, cell) != cell:
                    raise ValueError(f"{row[:2]} has {known[head]} and {cell} under {head}")
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    used = [n for n in range(4) if n > 1 or any(key[n] for key in lines)]
    names = ("split", "block", *tables[0].head[:2])
    writer.writerow([*(names[n] for n in used), *heads])
    for key, cells in lines.items():
        writer.writerow([*(key[n] for n in used), *(cells.get(head, "-") for head in heads)])
    return out.getvalue()


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
