"""Tables of measures: each measure names a figure, computes it and says how it is shown. The rows, JSON and Markdown of
all evaluations are made of such tables. Also compares figures of a corpus with real ones.
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
    head: head of its column of Markdown, with the unit; measures with the same head share a cell, and a measure without
        a head is in JSON alone.
    form: format of the number in its cell, such as "{:.2f}".
    factor: from the figure to the unit that is shown.
    function: computes the figure from the measured object, or None if it has none; a measure without a function names
        the measured object.
    """

    name: str
    head: str = ""
    form: str = "{}"
    factor: float | None = None
    function: Callable[[Any], object] | None = None

    def cell(self, row: Row) -> str:
        """Returns the figure of a row as text; "-" for a missing number."""
        value = getattr(row, self.name)
        if isinstance(value, bool):
            return "yes" if value else "no"
        if value is None:
            return re.sub(r"\{[^}]*\}( %)?", "-", self.form)
        return self.form.format(value if self.factor is None else self.factor * value)


def percent(name: str, head: str, digits: int, function: Callable[[Any], object] | None = None) -> Measure:
    """Returns a measure whose fraction is shown in %."""
    return Measure(name, head, f"{{:.{digits}f}} %", 100.0, function)


def aggregate(field: str, statistic: Callable[[FloatArray], float]) -> Callable[[Iterable[object]], float | None]:
    """Returns a function that gives a statistic of a field of measurements that have it; None if none has it."""

    def function(measurements: Iterable[object]) -> float | None:
        values = [value for value in (getattr(measurement, field) for measurement in measurements) if value is not None]
        return float(statistic(np.array(values))) if values else None

    return function


def make_row(measures: Sequence[Measure], measured: object, **names: object) -> Row:
    """Returns the figures of a measured object; ``names``: values of the measures without a function."""
    figures = {
        measure.name: names[measure.name] if measure.function is None else measure.function(measured)
        for measure in measures
    }
    return SimpleNamespace(**figures)


def format_measures(measures: Sequence[Measure], rows: Iterable[Row]) -> list[str]:
    """Returns rows as lines of a Markdown table."""
    headings = dict.fromkeys(measure.head for measure in measures if measure.head)
    cells = [
        ["".join(measure.cell(row) for measure in measures if measure.head == heading) for heading in headings]
        for row in rows
    ]
    return format_table(list(headings), cells)


def format_table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> list[str]:
    """Returns lines of a Markdown table."""
    return [_format_line(head), _format_line(["---"] * len(head)), *map(_format_line, rows)]


def _format_line(cells: Sequence[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def parse_tables(lines: Iterable[str]) -> list[dict[str, Any]]:
    """Returns the tables among lines of Markdown: each with its section, the paragraph before it, and its rows as
    shown.
    """
    tables: list[dict[str, Any]] = []
    section, paragraph, head = "", list[str](), list[str]()
    for line in lines:
        if line.startswith("#"):
            section = line.strip("# ")
        elif not line.startswith("|"):
            paragraph, head = ([] if head or (line and paragraph[-1:] == [""]) else paragraph) + [line], []
        elif not head:
            head = _split_cells(line)
            tables.append({"section": section, "text": " ".join(paragraph).strip(), "rows": []})
        elif not line.startswith("| ---"):
            tables[-1]["rows"].append(dict(zip(head, _split_cells(line), strict=True)))
    return tables


def format_csv(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Returns rows as the text of a CSV file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([head, *rows])
    return text.getvalue()


def _split_cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


PERCENTILES = (5, 25, 50, 75, 95)
MEDIAN_WITHIN, TAILS_WITHIN = 0.15, 0.25
"""Largest difference of our median, and of our 5 and 95 %, from the real ones, as a fraction of these."""
HEAD = ("quantity", "unit", "corpus", "real", "from", "ratio", "median / 5 % / 95 %")


@dataclass(frozen=True)
class Quantity:
    """One line of a table of realism.

    name, unit: name and unit of the quantity.
    ours: ``PERCENTILES`` of the corpus (5), or one figure (1).
    real: real percentiles (5), the ends of a range (2), or one figure (1), a median where ``ours`` has percentiles.
    source: source of the real figures.
    spread: whether the ends of a range are real 5 and 95 %, rather than a range of medians.
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
    """Returns ``PERCENTILES`` of the values."""
    return tuple(float(value) for value in np.percentile(values, PERCENTILES))


def format_quantities(quantities: Sequence[Quantity]) -> list[str]:
    """Returns Markdown: a line for each quantity, and below, which agree and which miss."""
    words = {True: "yes", False: "no", None: "-"}
    rows = []
    for quantity in quantities:
        real = (" to " if len(quantity.real) == 2 else " / ").join(map(format_number, quantity.real))
        ours = " / ".join(map(format_number, quantity.ours))
        agrees = " / ".join(words[agreement] for agreement in quantity.agreement)
        rows.append((quantity.name, quantity.unit, ours, real, quantity.source, f"{quantity.ratio:.2f}", agrees))
    return [*format_table(HEAD, rows), "", *list_misses(quantities)]


def list_misses(quantities: Sequence[Quantity]) -> list[str]:
    """Returns the quantities that miss, and in what, as one line of Markdown and a list."""
    missing = []
    for quantity in quantities:
        names = ("median" if len(quantity.ours) == 5 else "figure", "5 %", "95 %")
        misses = [name for name, agrees in zip(names, quantity.agreement, strict=True) if agrees is False]
        if misses:
            missing.append(f"- {quantity.name} ({quantity.source}): {', '.join(misses)}")
    n_agree = len(quantities) - len(missing)
    line = f"{n_agree} of {len(quantities)} rows agree in all that can be compared."
    return [line] if not missing else [f"{line} Still misses:", "", *missing]


def format_number(value: float) -> str:
    """Returns a figure with three digits."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
