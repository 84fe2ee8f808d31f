"""The table of results.json: each system by condition, what it was taught on and split, seeds together, beside the
figures that the paper prints.

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
from signsplice_paper.layout import Table, markdown, number, short
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
PRINTED, HERE, ON_MANY = "printed", "words of the split", "many words and bodies"
_ORDER = (*published.TABLE_1, published.LPT_PLUS, *published.ABLATIONS)


@dataclass(frozen=True)
class TableLine:
    """One line of the table.

    - system: its name
    - condition: what its tokens were given, or where a method's cut and length are from
    - taught: what it learned from
    - rows: one for each seed
    """

    system: str
    condition: str
    taught: str
    rows: tuple[ResultRow, ...]

    @property
    def seeds(self) -> int:
        """How many seeds it has."""
        return len(self.rows)

    def values(self, name: str) -> list[float]:
        """A score of every seed, without those that are unknown; of the time the last alone, since a machine is not as
        fast on every day.
        """
        found = [value for row in self.rows if not math.isnan(value := row.score(name))]
        return found[-1:] if name == TIME else found

    def score(self, name: str) -> float:
        """The mean of a score over the seeds; NaN if it is unknown."""
        values = self.values(name)
        return float(np.mean(values)) if values else float("nan")

    def cell(self, name: str, digits: int | str = 3) -> str:
        """A score as text: the mean, and with several seeds the least and the largest in brackets."""
        values = self.values(name)
        if name != "pta" and max(self.values("pta"), default=1.0) == 0.0 and name.startswith(("paa", "within")):
            return "-"
        text = format_score(self.score(name), digits)
        if len(values) < 2:
            return text
        return f"{text} [{format_score(min(values), digits)}, {format_score(max(values), digits)}]"


def format_score(value: float, digits: int | str) -> str:
    """A score as text."""
    return short(value) if isinstance(digits, str) else number(value, digits)


def lines(results: Results, scale: str, split: str) -> list[TableLine]:
    """All lines of a split: the paper's systems, LPT+, ablations, those taught on many words, then methods on clips and
    baselines. Raises ``InputError`` where rows cannot be compared.
    """
    rows = [row for row in results.rows if row.split == split and row.part == "test"]
    check_comparable(rows)
    groups: dict[tuple[object, ...], list[ResultRow]] = {}
    for row in sorted(rows, key=lambda row: (_place(row), row.seed or 0)):
        if row.condition and row.scale != scale:
            continue
        groups.setdefault((row.system, row.given, row.taught, row.optimiser, row.fr), []).append(row)
    return [
        TableLine(published.name(of[0].system), _condition(of[0]), _taught(of[0]), tuple(of)) for of in groups.values()
    ]


def line(
    results: Results, scale: str, system: str, split: str, taught: str = HERE, optimiser: str = "adamw"
) -> TableLine:
    """The line of a system or method; without rows where there are none."""
    found = [
        one
        for one in lines(results, scale, split)
        if one.rows[0].system == system and one.taught in (taught, "-") and one.rows[0].optimiser in (optimiser, "")
    ]
    return found[0] if found else TableLine(published.name(system), "", taught, ())


def _condition(row: ResultRow) -> str:
    if not row.condition:
        return "given nothing" if row.given == "nothing" else f"given {row.given}"
    return row.condition if row.optimiser == "adamw" else f"{row.condition}, SGD"


def _taught(row: ResultRow) -> str:
    if not row.condition:
        return "-"
    return ON_MANY if row.taught else HERE


def _place(row: ResultRow) -> tuple[object, ...]:
    """Where a row stands among others."""
    if not row.condition:
        return (2, row.scale, row.system, row.given)
    base = next((s for s, by in published.CONDITIONS.items() if row.system in by.values()), row.system)
    return (bool(row.taught), _ORDER.index(base) if base in _ORDER else len(_ORDER), row.condition, row.optimiser)


def as_csv(results: Results, scale: str) -> str:
    """Every line of every split, with all columns."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    titles = [title for _, _, title in COLUMNS]
    writer.writerow(["split", "system", "condition", "taught on", *titles, "seeds", "steps", "parameters", "commit"])
    for split in SPLITS:
        for one in lines(results, scale, split):
            facts = zip(*((row.steps, row.n_parameters, row.commit) for row in one.rows), strict=True)
            texts = ["/".join(str(value) for value in dict.fromkeys(of) if value is not None) for of in facts]
            cells = [one.cell(name, digits) for name, digits, _ in COLUMNS]
            writer.writerow([split, one.system, one.condition, one.taught, *cells, one.seeds, *texts])
    return out.getvalue()


def table(results: Results, scale: str, split: str, systems: Sequence[str] | None = None) -> Table | None:
    """The table of a split as it stands on pages, with what the paper prints in the random split's; only ``systems``
    where they are named. None without a line.
    """
    found = [one for one in lines(results, scale, split) if systems is None or one.rows[0].system in systems]
    if not found:
        return None
    columns = [column for column in COLUMNS if column[2] in ON_PAGE]
    rows = _paper_rows(columns) if split == SPLITS[0] else []
    rows += [
        (one.system, one.condition, one.taught, *(one.cell(name, digits) for name, digits, _ in columns))
        for one in found
    ]
    head = ("system", "condition", "taught on", *(title for _, _, title in columns))
    return Table(f"{split}: {found[0].rows[0].n_pairs} test pairs", f"table-{split}", head, tuple(rows))


def _paper_rows(columns: Sequence[tuple[str, int | str, str]]) -> list[tuple[str, ...]]:
    """The lines as the paper prints them."""
    rows = []
    for system, values in (published.TABLE_1 | published.TABLE_3).items():
        known = dict(zip(published.METRICS, values, strict=True))
        if system == published.PRINTED:
            known |= {"Accuracy": f"{published.ACCURACY:.2f}", "MSE": f"{published.MSE:.4f}"}
        rows.append((published.name(system), PRINTED, "-", *(known.get(title, "-") for _, _, title in columns)))
    return rows


def page(results: Results, scale: str) -> str:
    """The tables of all splits as a page."""
    found = [table(results, scale, split) for split in SPLITS]
    shown = [one for one in found if one is not None]
    return "\n".join(["# Tables", "", "All columns: [table.csv](table.csv).", "", *map(markdown, shown)])
