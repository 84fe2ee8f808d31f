"""The figure of the page: the paper's four systems as it prints them, as printed here, and treated alike."""

from __future__ import annotations

from typing import Any

from signsplice_paper import published
from signsplice_paper.lines import line
from signsplice_paper.results import Results
from signsplice_paper.style import style

NAME = "treatments"
SCORES = {"bleu-4": "BLEU-4", "pta": "PTA: positions found", "paa": "PAA: exact, of those found"}
MARKERS = {"printed": "x", published.AS_PRINTED: "o", published.BIAS_ALONE: "D", published.EQUAL: "s"}
"""Treatment -> marker; ``printed`` is the paper's own table."""


def plot(results: Results, scale: str, pyplot: Any) -> Any:
    """The figure, a panel for each score; None without a row of any system."""
    values: dict[tuple[str, str], dict[str, float]] = {}
    for system, by_treatment in published.TREATED.items():
        for treatment, of in by_treatment.items():
            one = line(results, of, scale, "random")
            if one.is_known:
                values[system, treatment] = {score: one.score(score) for score in SCORES}
    if not values:
        return None
    for system, printed in published.TABLE_1.items():
        by_score = dict(zip(published.SCORES.values(), map(float, printed), strict=True))
        values[system, "printed"] = {score: by_score[score] for score in SCORES}
    rows = list(reversed(published.TREATED))
    figure, panels = pyplot.subplots(1, len(SCORES), figsize=(8.4, 2.6), sharey=True, layout="constrained")
    for panel, (score, title) in zip(panels, SCORES.items(), strict=True):
        for (system, treatment), found in values.items():
            shift = 0.24 * (1.5 - list(MARKERS).index(treatment))
            filled = "white" if treatment == published.AS_PRINTED else style(system).colour
            panel.plot(
                found[score], rows.index(system) + shift, ls="", marker=MARKERS[treatment], ms=7,
                color=style(system).colour, mfc=filled,
            )  # fmt: skip
        panel.set(title=title, xlim=(-0.03, 1.03), ylim=(-0.6, len(rows) - 0.4))
        panel.set_yticks(range(len(rows)), [published.name(system) for system in rows])
        panel.grid(alpha=0.3)
    for treatment, marker in MARKERS.items():
        name = "printed in the paper" if treatment == "printed" else f"here, {treatment}"
        filled = "white" if treatment == published.AS_PRINTED else "black"
        panels[0].plot([], [], ls="", marker=marker, color="black", mfc=filled, label=name)
    figure.legend(loc="outside lower center", ncols=len(MARKERS), frameon=False)
    return figure
