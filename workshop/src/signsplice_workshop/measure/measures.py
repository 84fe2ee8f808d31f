"""Measured rows as Markdown tables and as JSON; figures of a corpus beside real ones, and which of them agree."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance
from dataclasses import dataclass

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.progress import Progress as Progress
from signsplice.progress import counted as counted

T = TypeVar("T")
_STORED = {"avoids_collisions": "body_sense", "n_seams": "n_joins", "keyframed": "drawn"}
"""Fields of rows whose JSON key is another word: files written before must stay comparable."""


def markdown(head: Sequence[object], rows: Iterable[Sequence[object]]) -> list[str]:
    """Lines of a Markdown table."""
    return [_line(head), _line(["---"] * len(head)), *map(_line, rows)]


def markdown_columns(columns: Mapping[str, Callable[[T], str]], rows: Iterable[T]) -> list[str]:
    """Lines of a Markdown table: of every row the cell of each column, by the column's head."""
    return markdown(list(columns), ([cell(row) for cell in columns.values()] for row in rows))


def shown(value: float | None, form: str, factor: float = 1.0) -> str:
    """A figure times a factor, by a format; "-" where there is none."""
    return "-" if value is None else format(factor * value, form)


def percent(value: float | None, form: str = ".0f") -> str:
    """A fraction in %; "-" where there is none."""
    return "-" if value is None else f"{100 * value:{form}} %"


def _line(cells: Sequence[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def to_json(row: DataclassInstance) -> dict[str, Any]:
    """A row with the keys that ``signsplice evaluate --json`` prints."""
    return {_STORED.get(name, name): value for name, value in asdict(row).items()}


def tables_in(lines: Iterable[str]) -> list[dict[str, Any]]:
    """The tables among lines of Markdown: each with its section, the paragraph before it, and its rows as shown."""
    found: list[dict[str, Any]] = []
    section, paragraph, head = "", list[str](), list[str]()
    for line in lines:
        if line.startswith("#"):
            section = line.strip("# ")
        elif not line.startswith("|"):
            paragraph, head = ([] if head or (line and paragraph[-1:] == [""]) else paragraph) + [line], []
        elif not head:
            head = _cells(line)
            found.append({"section": section, "text": " ".join(paragraph).strip(), "rows": []})
        elif not line.startswith("| ---"):
            found[-1]["rows"].append(dict(zip(head, _cells(line), strict=True)))
    return found


def csv_text(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Rows as the text of a CSV file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([head, *rows])
    return text.getvalue()


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


PERCENTILES = (5, 25, 50, 75, 95)
MEDIAN_WITHIN, TAILS_WITHIN = 0.15, 0.25
"""How far our median, and our 5 and 95 %, may be from the real ones, as a fraction of these."""
HEAD = ("quantity", "unit", "corpus", "real", "from", "ratio", "median / 5 % / 95 %")


@dataclass(frozen=True)
class Quantity:
    """One line of a table of realism.

    name, unit: of the quantity.
    ours: ``PERCENTILES`` of the corpus (5), or one figure (1).
    real: real percentiles (5), the ends of a range (2), or one figure (1), a median where ``ours`` has percentiles.
    source: where the real figures are from.
    spread: whether a range's ends are real 5 and 95 %, rather than a range of medians.
    """

    name: str
    unit: str
    ours: tuple[float, ...]
    real: tuple[float, ...]
    source: str
    spread: bool = False

    @property
    def median(self) -> float:
        """Our median, or our one figure."""
        return self.ours[len(self.ours) // 2]

    @property
    def ratio(self) -> float:
        """Our median over the real one (the middle of a range)."""
        return self.median / (0.5 * sum(self.real) if len(self.real) == 2 else self.real[len(self.real) // 2])

    @property
    def agreement(self) -> tuple[bool, bool | None, bool | None]:
        """Whether our median, 5 % and 95 % are near enough to the real ones, the median to the nearer end of a range;
        None for a percentile that is not known of both. A range of medians has no percentiles.
        """
        low, high = self.real if len(self.real) == 2 else (self.real[len(self.real) // 2],) * 2
        median = (1.0 - MEDIAN_WITHIN) * low <= self.median <= (1.0 + MEDIAN_WITHIN) * high
        if len(self.ours) < 5 or not (self.spread or len(self.real) == 5):
            return median, None, None
        low_tail, high_tail = (
            abs(ours - real) <= TAILS_WITHIN * abs(real)
            for ours, real in ((self.ours[0], self.real[0]), (self.ours[-1], self.real[-1]))
        )
        return median, low_tail, high_tail


def percentiles(values: Sequence[float] | FloatArray) -> tuple[float, ...]:
    """``PERCENTILES`` of some values."""
    return tuple(float(v) for v in np.percentile(values, PERCENTILES))


def table(quantities: Sequence[Quantity]) -> list[str]:
    """Markdown: a line for each quantity, and below, which agree and which miss."""
    words = {True: "yes", False: "no", None: "-"}
    rows = []
    for q in quantities:
        real = (" to " if len(q.real) == 2 else " / ").join(map(number, q.real))
        ours = " / ".join(map(number, q.ours))
        agrees = " / ".join(words[part] for part in q.agreement)
        rows.append((q.name, q.unit, ours, real, q.source, f"{q.ratio:.2f}", agrees))
    return [*markdown(HEAD, rows), "", *misses(quantities)]


def misses(quantities: Sequence[Quantity]) -> list[str]:
    """Which quantities miss, and in what, as one line of Markdown and a list."""
    found = []
    for q in quantities:
        names = ("median" if len(q.ours) == 5 else "figure", "5 %", "95 %")
        parts = [name for name, part in zip(names, q.agreement, strict=True) if part is False]
        if parts:
            found.append(f"- {q.name} ({q.source}): {', '.join(parts)}")
    n_agree = len(quantities) - len(found)
    line = f"{n_agree} of {len(quantities)} rows agree in all that can be compared."
    return [line] if not found else [f"{line} Still misses:", "", *found]


def number(value: float) -> str:
    """A figure with three digits."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
