"""Tables of measures: each names a figure, computes it and says how it is shown. All subjects make their rows, JSON and
Markdown of such a table. Also figures of a corpus beside real ones, and which of them agree.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from signsplice.motion import FloatArray
from signsplice.progress import Progress as Progress
from signsplice.progress import track_progress as track_progress

Row = SimpleNamespace
"""Figures by the names of their measures."""


@dataclass(frozen=True)
class Measure:
    """One figure of a row.

    name: its key in JSON.
    head: head of its column of Markdown, with the unit; measures with one head share a cell, and one without a head is
        in JSON alone.
    form: format of the number in its cell, "{:.2f}".
    factor: from the figure to the unit that is shown.
    function: the figure of what was measured, None where there is none; a measure without a function names what was
        measured.
    """

    name: str
    head: str = ""
    form: str = "{}"
    factor: float | None = None
    function: Callable[[Any], object] | None = None

    def cell(self, row: Row) -> str:
        """The figure of a row as text; "-" in place of a number that there is not."""
        value = getattr(row, self.name)
        if isinstance(value, bool):
            return "yes" if value else "no"
        if value is None:
            return re.sub(r"\{[^}]*\}( %)?", "-", self.form)
        return self.form.format(value if self.factor is None else self.factor * value)


def percent(name: str, head: str, digits: int, function: Callable[[Any], object] | None = None) -> Measure:
    """A measure whose fraction is shown in %."""
    return Measure(name, head, f"{{:.{digits}f}} %", 100.0, function)


def over(field: str, statistic: Callable[[FloatArray], float]) -> Callable[[Iterable[object]], float | None]:
    """A function of measurements: a statistic of a field of theirs, of those that have it; None where none has."""

    def function(measurements: Iterable[object]) -> float | None:
        values = [value for value in (getattr(one, field) for one in measurements) if value is not None]
        return float(statistic(np.array(values))) if values else None

    return function


def row_of(measures: Sequence[Measure], measured: object, **names: object) -> Row:
    """The figures of what was measured; ``names``: what it is called, by measures without a function."""
    figures = {one.name: names[one.name] if one.function is None else one.function(measured) for one in measures}
    return SimpleNamespace(**figures)


def markdown_rows(measures: Sequence[Measure], rows: Iterable[Row]) -> list[str]:
    """Lines of a Markdown table of rows."""
    heads = dict.fromkeys(one.head for one in measures if one.head)
    cells = [["".join(one.cell(row) for one in measures if one.head == head) for head in heads] for row in rows]
    return markdown(list(heads), cells)


def markdown(head: Sequence[object], rows: Iterable[Sequence[object]]) -> list[str]:
    """Lines of a Markdown table."""
    return [_line(head), _line(["---"] * len(head)), *map(_line, rows)]


def _line(cells: Sequence[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


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
