"""The lines of the tables: which rows of results.json stand in them, seeds together, and which systems are not trained.

A system that found no token at all, with any seed, is named "not trained", and none of its scores is shown. One whose
Accuracy is below that of the mean transition on the same pairs, with every seed, is marked so, and its scores are
shown: it may find positions and fail at lengths.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice_paper import published
from signsplice_paper.layout import number, short
from signsplice_paper.results import CLASSICAL, CLIP_SCALES, CORPUS_TRAINED, FITTED, MEAN, SHIPPED, ResultRow, Results

OPTIMISERS = {"adamw": "AdamW", "sgd": "SGD", "sgd-momentum": "SGD with momentum"}
MISSING, UNTRAINED, BELOW = "not trained yet", "not trained: no token found", "below the mean transition"
TIMES = ("ms_mean", "ms_median")
"""Scores of the last seed that has them, timed on one day with other systems: a machine is not as fast on every day,
and rows of a busy one have none.
"""
SHORT = "short"
"""Digits of a score with two significant figures."""


@dataclass(frozen=True)
class TableLine:
    """One system in a table.

    - name: as shown
    - origin: how it was trained, or what it was given
    - rows: its rows, one for every seed; none if it was not judged
    - trained: False for a system that found no token with any seed
    """

    name: str
    origin: str
    rows: tuple[ResultRow, ...] = ()
    trained: bool = True

    @property
    def is_known(self) -> bool:
        """Whether it has scores to be shown."""
        return bool(self.rows) and self.trained

    def values(self, name: str) -> list[float]:
        """A score of every seed, of the last for ``TIMES``, without those that are NaN."""
        found = [value for row in self.rows if not math.isnan(value := row.score(name))]
        return found[-1:] if name in TIMES else found

    def score(self, name: str) -> float:
        """The mean of a score over the seeds; NaN if it is unknown."""
        values = self.values(name) if self.is_known else []
        return float(np.mean(values)) if values else float("nan")

    def cell(self, name: str, digits: int | str = 3) -> str:
        """A score as text: the mean, and with several seeds the least and the largest in brackets."""
        values = self.values(name) if self.is_known else []
        text = written(self.score(name), digits)
        if len(values) < 2:
            return text
        return f"{text} [{written(min(values), digits)}, {written(max(values), digits)}]"

    @property
    def seeds(self) -> str:
        """The seeds of its rows; "-" for methods without any."""
        found = sorted({row.seed for row in self.rows if row.seed is not None})
        return ", ".join(map(str, found)) if found else "-"


def written(value: float, digits: int | str) -> str:
    """A score as text."""
    return short(value) if isinstance(digits, str) else number(value, digits)


def mean_transition(results: Results, split: str) -> ResultRow | None:
    """The row of the mean transition on a split's test part."""
    return next(iter(results.find(scale=MEAN, split=split, part="test")), None)


def line(
    results: Results,
    system: str,
    scale: str,
    split: str,
    optimiser: str = "adamw",
    fr: int | None = None,
    seeds: Collection[int] = (),
) -> TableLine:
    """The line of one of the paper's systems or of those beside it, with the paper's fr where none is given, and with
    all seeds where none are given.
    """
    rows = results.find(system=system, scale=scale, split=split, optimiser=optimiser, part="test")
    wanted = (None, published.BEST_FR) if fr is None else (fr,)
    rows = sorted((row for row in rows if row.fr in wanted), key=lambda row: row.seed or 0)
    rows = [row for row in rows if not seeds or row.seed in seeds]
    name, by = published.name(system), OPTIMISERS.get(optimiser, optimiser)
    if not rows:
        return TableLine(name, f"{by}, {MISSING}")
    steps = "/".join(dict.fromkeys(f"{row.steps}" for row in rows))
    if optimiser == "sgd" and any(row.stopped in ("steps", "time") for row in rows):
        by += " ended by its limit, not by validation"
    many = f", {len(rows)} seeds" if len(rows) > 1 else ""
    made = TableLine(name, f"{by}, {steps} steps{many}", tuple(rows))
    if max(made.values("pta"), default=1.0) == 0.0:
        return replace(made, origin=f"{made.origin}; {UNTRAINED}", trained=False)
    baseline = mean_transition(results, split)
    if baseline is not None and max(made.values("accuracy"), default=math.inf) < baseline.score("accuracy"):
        return replace(made, origin=f"{made.origin}; {BELOW}")
    return made


def shared_seeds(
    results: Results, systems: Iterable[str], scale: str, split: str, optimiser: str = "adamw", frs: Sequence[int] = ()
) -> frozenset[int]:
    """The seeds that all of some systems have, with each of ``frs``, as far as they have rows; none if that is no seed.

    Systems that share networks are compared with these seeds alone: otherwise the network that they share would decide.
    """
    found = [line(results, s, scale, split, optimiser, fr).rows for s in systems for fr in frs or (None,)]
    seeds = [frozenset(row.seed for row in rows if row.seed is not None) for rows in found if rows]
    return seeds[0].intersection(*seeds[1:]) if seeds else frozenset()


def lines(
    results: Results, systems: Sequence[str], scale: str, split: str, seeds: Collection[int] = ()
) -> list[TableLine]:
    """The lines of some systems trained by AdamW, and of those that were trained by SGD."""
    out = []
    for system in systems:
        out.append(line(results, system, scale, split, seeds=seeds))
        by_sgd = line(results, system, scale, split, "sgd")
        with_momentum = line(results, system, scale, split, "sgd-momentum")
        out += [by_sgd] if by_sgd.rows or system == published.PRINTED else []
        out += [with_momentum] if with_momentum.rows else []
    return out


def clip_lines(results: Results, split: str, chosen: Sequence[tuple[str, str]] | None = None) -> list[TableLine]:
    """The lines of methods on clips, only those of ``chosen`` (name, given) if there are any."""
    rows = [row for scale in CLIP_SCALES for row in results.find(scale=scale, split=split, part="test")]
    if chosen is not None:
        rows = [row for key in chosen for row in rows if (row.system, row.given) == key]
    return [TableLine(row.system, clip_origin(row), (row,)) for row in rows]


def mean_lines(results: Results, split: str) -> list[TableLine]:
    """The line of the mean transition, if it was judged."""
    row = mean_transition(results, split)
    return [] if row is None else [TableLine(published.name(row.system), "mean of the training part", (row,))]


def pairs_seen(results: Results, row: ResultRow) -> float | None:
    """How many pairs all parts of a row's system saw in training, from the last point of its curve; None if unknown."""
    key = (row.system, row.split, row.scale, row.optimiser, row.fr, row.seed)
    curve = next((c for c in results.curves if c.key == key and c.points), None)
    return None if curve is None else curve.column("pairs")[-1]


def clip_origin(row: ResultRow) -> str:
    """What a method on clips was given, and whether its networks learned from the split."""
    if row.scale == CLASSICAL:
        return f"classical, given {row.given}"
    if row.scale == FITTED:
        return f"fitted to the training part, given {row.given}"
    own = {SHIPPED: "as it ships", CORPUS_TRAINED: "trained on the split"}[row.scale]
    return f"signsplice, {own}, given {row.given}"
