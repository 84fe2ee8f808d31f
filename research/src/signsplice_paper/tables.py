"""The table of results.json: each system by condition, training words and split, seeds together, next to the figures
that the paper prints.

Rows whose signatures differ are refused. A system that found no token with any seed has no other score of positions.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from signsplice_paper import published
from signsplice_paper.layout import Table, format_markdown, format_number, format_short
from signsplice_paper.protocol import SPLITS
from signsplice_paper.results import ResultRow, Results, check_comparable

SHORT = "short"
"""Digits of a score with two significant figures."""
TIME = "ms_median"
COLUMNS: tuple[tuple[str, int | str, str], ...] = (
    ("pta", 3, "PTA"),
    ("paa", 3, "PAA"),
    ("paa_all", 3, "both exact"),
    ("within_1", 3, "within 1"),
    ("accuracy", 4, "Accuracy"),
    ("mse", SHORT, "MSE"),
    *((f"bleu-{n}", 3, f"BLEU-{n}") for n in (1, 2, 3, 4)),
    ("length_exact", 3, "length exact"),
    (TIME, 1, "ms a pair"),
    ("joint_jumps", 3, "over 60 degrees"),
    ("bone_change", 3, "bone change"),
    ("accuracy_bones", 4, "Accuracy, bones kept"),
    ("mse_bones", SHORT, "MSE, bones kept"),
    ("bleu-4_bones", 3, "BLEU-4, bones kept"),
    ("joint_jumps_bones", 3, "over 60 degrees, bones kept"),
    ("bone_change_bones", 3, "bone change, bones kept"),
    ("paa_train", 3, "PAA, pairs that taught"),
    ("accuracy_valid", 4, "Accuracy, validation"),
)
"""Score, digits and title of each column."""
ON_PAGE = ("PTA", "PAA", "both exact", "within 1", "Accuracy", "MSE", "BLEU-1", "BLEU-4", "over 60 degrees",
           "over 60 degrees, bones kept", "ms a pair")  # fmt: skip
"""Columns of the tables on pages."""
PAPERS_FIGURES = "printed"
"""In the column of conditions: figures that the paper prints."""
ON_SPLIT, ON_MANY = "words of the split", "many words and bodies"
"""What a system was taught on: the training part of the judged split, or a corpus to teach on."""
_ORDER = (*published.TABLE_1, published.LPT_PLUS, *published.ABLATIONS)


@dataclass(frozen=True)
class TableLine:
    """One line of the table.

    - system: the name that is shown, the same in both conditions
    - condition: how its tokens were trained, or which truth a method was given
    - taught: ``ON_SPLIT``, ``ON_MANY`` or "-"
    - rows: one for each seed
    """

    system: str
    condition: str
    taught: str
    rows: tuple[ResultRow, ...]

    @property
    def n_seeds(self) -> int:
        """How many seeds it has."""
        return len(self.rows)

    def values(self, name: str) -> list[float]:
        """Returns a score of every seed, without unknown ones; for the time that of the largest seed alone, since a
        machine is not as fast on every day.
        """
        known = [value for row in self.rows if not math.isnan(value := row.score(name))]
        return known[-1:] if name == TIME else known

    def score(self, name: str) -> float:
        """Returns the mean of a score over the seeds; NaN if it is unknown."""
        values = self.values(name)
        return float(np.mean(values)) if values else float("nan")

    def format_cell(self, name: str, digits: int | str = 3) -> str:
        """Returns a score as text: the mean, and with several seeds the least and the largest in brackets; "-" if it
        is unknown, or a score of positions and no pair has both.
        """
        values = self.values(name)
        if name != "pta" and max(self.values("pta"), default=1.0) == 0.0 and name.startswith(("paa", "within")):
            return "-"
        text = format_score(self.score(name), digits)
        if len(values) < 2:
            return text
        return f"{text} [{format_score(min(values), digits)}, {format_score(max(values), digits)}]"


def format_score(value: float, digits: int | str) -> str:
    """Returns a score as text."""
    return format_short(value) if isinstance(digits, str) else format_number(value, digits)


def list_lines(results: Results, scale: str, split: str) -> list[TableLine]:
    """Returns all lines of a split: the paper's systems, LPT+, ablations, those taught on many words, then methods
    that splice clips with rotations, and baselines. A line has the rows that differ in seed alone. Raises
    ``InputError`` if rows cannot be compared.

    scale: of the trained systems; others are always listed.
    """
    rows = [row for row in results.rows if row.split == split and row.part == "test"]
    check_comparable(rows)
    groups: dict[tuple[object, ...], list[ResultRow]] = {}
    for row in sorted(rows, key=lambda row: (_make_sort_key(row), row.seed or 0)):
        if row.condition and row.scale != scale:
            continue
        groups.setdefault((row.system, row.given, row.taught, row.optimiser, row.fr), []).append(row)
    return [
        TableLine(
            published.get_display_name(group[0].system),
            _format_condition(group[0]),
            _format_taught(group[0]),
            tuple(group),
        )
        for group in groups.values()
    ]


def find_line(
    results: Results, scale: str, system: str, split: str, taught: str = ON_SPLIT, optimiser: str = "adamw"
) -> TableLine:
    """Returns the line of a system or method; without rows if there are none."""
    matches = [
        line
        for line in list_lines(results, scale, split)
        if line.rows[0].system == system and line.taught in (taught, "-") and line.rows[0].optimiser in (optimiser, "")
    ]
    return matches[0] if matches else TableLine(published.get_display_name(system), "", taught, ())


def _format_condition(row: ResultRow) -> str:
    if not row.condition:
        return "given nothing" if row.given == "nothing" else f"given {row.given}"
    return row.condition if row.optimiser == "adamw" else f"{row.condition}, SGD"


def _format_taught(row: ResultRow) -> str:
    if not row.condition:
        return "-"
    return ON_MANY if row.taught else ON_SPLIT


def _make_sort_key(row: ResultRow) -> tuple[object, ...]:
    """Returns a row's place among others."""
    if not row.condition:
        return (2, row.scale, row.system, row.given)
    base = next(
        (system for system, by_condition in published.CONDITIONS.items() if row.system in by_condition.values()),
        row.system,
    )
    return (bool(row.taught), _ORDER.index(base) if base in _ORDER else len(_ORDER), row.condition, row.optimiser)


def format_csv(results: Results, scale: str) -> str:
    """Returns every line of every split, with all columns."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    titles = [title for _, _, title in COLUMNS]
    writer.writerow(["split", "system", "condition", "taught on", *titles, "seeds", "steps", "parameters", "commit"])
    for split in SPLITS:
        for line in list_lines(results, scale, split):
            facts = zip(*((row.steps, row.n_parameters, row.commit) for row in line.rows), strict=True)
            texts = ["/".join(str(value) for value in dict.fromkeys(values) if value is not None) for values in facts]
            cells = [line.format_cell(name, digits) for name, digits, _ in COLUMNS]
            writer.writerow([split, line.system, line.condition, line.taught, *cells, line.n_seeds, *texts])
    return text.getvalue()


def make_table(results: Results, scale: str, split: str, systems: Sequence[str] | None = None) -> Table | None:
    """Returns the table of a split for pages, with the figures that the paper prints in the random split's; only
    ``systems`` if they are named. None without a line.
    """
    lines = [line for line in list_lines(results, scale, split) if systems is None or line.rows[0].system in systems]
    if not lines:
        return None
    columns = [column for column in COLUMNS if column[2] in ON_PAGE]
    rows = _format_paper_rows(columns) if split == SPLITS[0] else []
    rows += [
        (line.system, line.condition, line.taught, *(line.format_cell(name, digits) for name, digits, _ in columns))
        for line in lines
    ]
    head = ("system", "condition", "taught on", *(title for _, _, title in columns))
    return Table(f"{split}: {lines[0].rows[0].n_pairs} test pairs", f"table-{split}", head, tuple(rows))


def _format_paper_rows(columns: Sequence[tuple[str, int | str, str]]) -> list[tuple[str, ...]]:
    """Returns the lines as the paper prints them."""
    rows = []
    for system, values in (published.TABLE_1 | published.TABLE_3).items():
        printed = dict(zip(published.METRICS, values, strict=True))
        if system == published.PRINTED:
            printed |= {"Accuracy": f"{published.ACCURACY:.2f}", "MSE": f"{published.MSE:.4f}"}
        name = published.get_display_name(system)
        rows.append((name, PAPERS_FIGURES, "-", *(printed.get(title, "-") for _, _, title in columns)))
    return rows


def format_page(results: Results, scale: str) -> str:
    """Returns the tables of all splits as a page."""
    tables = [make_table(results, scale, split) for split in SPLITS]
    present = [table for table in tables if table is not None]
    return "\n".join(["# Tables", "", "All columns: [table.csv](table.csv).", "", *map(format_markdown, present)])
