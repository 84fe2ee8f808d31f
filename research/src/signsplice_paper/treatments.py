"""The paper's four systems as it prints them, as printed here, and treated alike: lines for pages, and their figure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from signsplice_paper import published
from signsplice_paper.lines import SHORT, TableLine, line
from signsplice_paper.results import Results
from signsplice_paper.style import style

NAME = "treatments"
SCORES = {"bleu-4": "BLEU-4", "pta": "PTA: positions found", "paa": "PAA: exact, of those found"}
MARKERS = {"printed": "x", published.AS_PRINTED: "o", published.BIAS_ALONE: "D", published.EQUAL: "s"}
"""Treatment -> marker; ``printed`` is the paper's own table."""
_CELLS: dict[str, int | str] = {"bleu-1": 3, "bleu-4": 3, "pta": 3, "paa": 3, "accuracy": 3, "mse": SHORT}
_SEEDS = 3


def _lines(results: Results, scale: str) -> Iterator[tuple[str, str, TableLine]]:
    """System, treatment and line, with rows or without."""
    for system, by_treatment in published.TREATED.items():
        for treatment, of in by_treatment.items():
            yield system, treatment, line(results, of, scale, "random")


def rows(results: Results, scale: str) -> list[tuple[str, ...]]:
    """Cells of the table that pages show, a system's first line being the paper's, without the bias alone: name,
    treatment, and scores with the least and the largest of the seeds.
    """
    made: list[tuple[str, ...]] = []
    for system, treatment, one in _lines(results, scale):
        if treatment == published.BIAS_ALONE:
            continue
        if treatment == published.AS_PRINTED:
            by = dict(zip(published.METRICS, published.TABLE_1[system], strict=True))
            both = (f"{published.ACCURACY}", f"{published.MSE}") if system == published.PRINTED else ("-", "-")
            made.append(
                (published.name(system), "printed", *(by[m] for m in ("BLEU-1", "BLEU-4", "PTA", "PAA")), *both)
            )
        made.append(("", treatment, *(one.cell(score, digits) for score, digits in _CELLS.items())))
    return made


def seeds(results: Results, scale: str) -> str:
    """How many seeds the lines have, those with fewer than three by name."""
    few = [
        f"{len(one.rows)} of {published.name(system)}, {treatment}"
        for system, treatment, one in _lines(results, scale)
        if len(one.rows) < _SEEDS and treatment != published.BIAS_ALONE
    ]
    return "three each" + "".join([", but ", "; ".join(few)] if few else [])


def plot(results: Results, scale: str, pyplot: Any) -> Any:
    """The figure, a panel for each score, lines from the least to the largest of the seeds; None without a row of any
    system.
    """
    values = {
        (system, treatment): {score: one.values(score) for score in SCORES}
        for system, treatment, one in _lines(results, scale)
        if one.is_known
    }
    if not values:
        return None
    for system, printed in published.TABLE_1.items():
        by_score = dict(zip(published.SCORES.values(), map(float, printed), strict=True))
        values[system, "printed"] = {score: [by_score[score]] for score in SCORES}
    order = list(reversed(published.TREATED))
    figure, panels = pyplot.subplots(1, len(SCORES), figsize=(8.4, 2.6), sharey=True, layout="constrained")
    for panel, (score, title) in zip(panels, SCORES.items(), strict=True):
        for (system, treatment), found in values.items():
            y = order.index(system) + 0.24 * (1.5 - list(MARKERS).index(treatment))
            filled = "white" if treatment == published.AS_PRINTED else style(system).colour
            seen = found[score]
            panel.plot([min(seen), max(seen)], [y, y], color=style(system).colour, lw=1.2)
            panel.plot(
                sum(seen) / len(seen), y, ls="", marker=MARKERS[treatment], ms=6, color=style(system).colour, mfc=filled
            )
        panel.set(title=title, xlim=(-0.03, 1.03), ylim=(-0.6, len(order) - 0.4))
        panel.set_yticks(range(len(order)), [published.name(system) for system in order])
        panel.grid(alpha=0.3)
    for treatment, marker in MARKERS.items():
        name = "printed in the paper" if treatment == "printed" else f"here, {treatment}"
        filled = "white" if treatment == published.AS_PRINTED else "black"
        panels[0].plot([], [], ls="", marker=marker, color="black", mfc=filled, label=name)
    figure.legend(loc="outside lower center", ncols=len(MARKERS), frameon=False)
    return figure
