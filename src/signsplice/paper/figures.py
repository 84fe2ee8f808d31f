"""The paper's figures 4 to 7 from results.json and the few frames kept beside it, each as PNG and SVG."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import MissingExtraError
from signsplice.formats.atomic import replacing
from signsplice.paper import published
from signsplice.paper.kept_frames import HERMITE, SIGNSPLICE, KeptFrames
from signsplice.paper.results import Curve, ResultRow, Results
from signsplice.paper.tables import OPTIMISERS, pick

COLOURS = ("#3f6fa8", "#de8e20", "#5a9367", "#b04a5a", "#7d5ba6", "#6b6b6b", "#2a9d9d", "#a08040")
SIZE = (5.2, 3.6)
SPLIT = "random"


def write(results: Results, shots: Sequence[KeptFrames], folder: Path, scale: str) -> tuple[list[Path], list[str]]:
    """Draw every figure that there are numbers for, by AdamW and, with ``-sgd`` in its name, by SGD: the paths written,
    and the names of figures that nothing was measured for.

    Raises ``MissingExtraError`` without matplotlib.
    """
    from signsplice.paper.pictures import draw_shots

    pyplot = plotting()
    written: list[Path] = []
    left_out: list[str] = []
    for optimiser in OPTIMISERS:
        own = _Numbers(results, scale, optimiser)
        drawings: dict[str, Callable[[Any], bool]] = {
            "figure4a": own.accuracy_by_fr,
            "figure4b": own.time_and_error_by_fr,
            "figure4c": partial(own.accuracy, systems=published.TABLE_1),
            "figure4d": partial(own.error_against_time, systems=published.TABLE_1, classical=True),
            "figure5a": partial(own.accuracy, systems=published.TABLE_3),
            "figure5b": partial(own.error_against_time, systems=published.TABLE_3, classical=False),
        }
        for name, draw in drawings.items():
            name = name if optimiser == "adamw" else f"{name}-{optimiser}"
            figure, ax = pyplot.subplots(figsize=SIZE, constrained_layout=True)
            if draw(ax):
                written += save(figure, folder / name)
            else:
                left_out.append(name)
            pyplot.close(figure)
    for name, chosen in (("figure6", shots[:1]), ("figure7", shots[1:])):
        figure = draw_shots(pyplot, chosen, scale)
        if figure is None:
            left_out.append(name)
        else:
            written += save(figure, folder / name)
            pyplot.close(figure)
    return written, left_out


def plotting() -> Any:
    """Pyplot of matplotlib, drawing to files, the same bytes for the same numbers. Raises ``MissingExtraError``."""
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError("figures need matplotlib: pip install 'signsplice[paper]'") from error
    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "signsplice"
    from matplotlib import pyplot

    return pyplot


def save(figure: Any, path: Path) -> list[Path]:
    """Write a figure as PNG and SVG, each whole or not at all."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once, not for every file
    out = []
    for suffix, metadata in ((".png", {"Software": None}), (".svg", {"Date": None})):
        target = path.with_suffix(suffix)
        with replacing(target) as temporary:
            figure.savefig(temporary, dpi=130, format=suffix[1:], metadata=metadata)
            if suffix == ".svg":  # six decimals of a point are half of the file
                text = temporary.read_text(encoding="utf-8")
                temporary.write_text(re.sub(r"(\.\d\d)\d+", r"\1", text), encoding="utf-8")
        out.append(target)
    return out


class _Numbers:
    """What the figures of one scale and optimiser are drawn from; each method draws on axes and says whether it
    could.
    """

    def __init__(self, results: Results, scale: str, optimiser: str) -> None:
        self.results, self.scale, self.optimiser = results, scale, optimiser
        self.told = f"{OPTIMISERS[optimiser]}, scale {scale}"

    def accuracy_by_fr(self, ax: Any) -> bool:
        """Figure 4(a)."""
        by_fr = {curve.fr: curve for curve in self._curves("lpt") if curve.fr is not None}
        if len(by_fr) < 2:
            return False
        for n, fr in enumerate(sorted(by_fr)):
            _line(ax, by_fr[fr].points, f"fr = {fr}", n)
        return _finish_curves(ax, f"Accuracy over training by fr ({self.told})")

    def time_and_error_by_fr(self, ax: Any) -> bool:
        """Figure 4(b)."""
        rows = self.results.find(system="lpt", scale=self.scale, optimiser=self.optimiser, split=SPLIT, part="test")
        by_fr = {row.fr: row for row in rows if row.fr is not None}
        if len(by_fr) < 2:
            return False
        chosen = [by_fr[fr] for fr in sorted(by_fr)]
        at = [float(row.fr or 0) for row in chosen]
        ax.bar(at, [row.score("ms_mean") for row in chosen], width=0.9, color=COLOURS[0], alpha=0.75)
        ax.set(xlabel="fr, frames", xticks=at)
        ax.set_ylabel("mean prediction time, ms (bars)", color=COLOURS[0])
        other = ax.twinx()
        other.plot(at, [row.score("mse") for row in chosen], "o-", color=COLOURS[1])
        other.set_ylabel("MSE (line)", color=COLOURS[1])
        other.set_ylim(0.0, 1.2 * max(row.score("mse") for row in chosen))
        ax.set_title(f"Prediction time and MSE by fr ({self.told})", fontsize=10)
        return True

    def accuracy(self, ax: Any, systems: Iterable[str]) -> bool:
        """Figures 4(c) and 5(a). Systems that share the network that makes frames share its curve."""
        drawn: dict[tuple[tuple[float, float], ...], tuple[list[str], int]] = {}
        for n, system in enumerate(systems):
            curves = [c for c in self._curves(system) if c.fr in (None, published.BEST_FR)]
            if curves:
                curve = min(curves, key=lambda c: c.seed or 0)
                drawn.setdefault(tuple((a, b) for a, b in curve.points), ([], n))[0].append(published.name(system))
        for points, (names, n) in drawn.items():
            _line(ax, points, ", ".join(names), n)
        n_systems = sum(len(names) for names, _ in drawn.values())
        return n_systems > 1 and _finish_curves(ax, f"Accuracy over training ({self.told})")

    def error_against_time(self, ax: Any, systems: Iterable[str], classical: bool) -> bool:
        """Figures 4(d) and 5(b), and where asked for two classical rows that are told the length, and our networks."""
        rows = list(pick(self.results, self.scale, SPLIT, self.optimiser, systems).values())
        if len(rows) < 2:
            return False
        for n, row in enumerate(rows):
            below = any(_close(row, other) for other in rows[:n])
            _point(ax, row, published.name(row.system), COLOURS[n], "o", below)
        if classical:
            for system, told, name, colour in (
                ("pose-velocity+hermite", "length", "pose-velocity+hermite,\ntold length", "#9a9a9a"),
                (*HERMITE, "true-positions+hermite,\ntold positions and length", "#9a9a9a"),
                (*SIGNSPLICE, "signsplice", "#1b1b1b"),
            ):
                for row in self.results.find(system=system, told=told, split=SPLIT, part="test"):
                    _point(ax, row, name, colour, "s")
        ax.axhline(published.VISIBLE, color="#b04a5a", ls=":", lw=1)
        ax.annotate("seen by viewers above (paper)", (0.01, published.VISIBLE), xycoords=("axes fraction", "data"),
                    ha="left", va="bottom", fontsize=7, color="#b04a5a")  # fmt: skip
        ax.set(xscale="log", yscale="log", xlabel="mean prediction time, ms a pair", ylabel="MSE")
        ax.margins(0.3)
        _plain_ticks(ax)
        ax.set_title(f"MSE against prediction time ({self.told})", fontsize=10)
        return True

    def _curves(self, system: str) -> list[Curve]:
        return [
            curve
            for curve in self.results.curves
            if (curve.system, curve.scale, curve.optimiser, curve.split) == (system, self.scale, self.optimiser, SPLIT)
        ]


def _line(ax: Any, points: Sequence[tuple[float, float]], name: str, n: int) -> None:
    steps, values = np.array(points, float).reshape(-1, 2).T
    ax.plot(steps, values, color=COLOURS[n % len(COLOURS)], lw=1.5, label=name, marker="." if len(steps) < 12 else "")


def _finish_curves(ax: Any, title: str) -> bool:
    ax.set(xlabel="training steps", ylabel="Accuracy, validation part")
    ax.set_title(title, fontsize=10)
    low, high = ax.get_ylim()
    ax.set_ylim(max(low, high - 0.5, 0.0), min(high, 1.0))
    ax.grid(alpha=0.25)
    ax.legend(fontsize=8)
    return True


def _plain_ticks(ax: Any) -> None:
    """Ticks of logarithmic axes at 1, 2 and 5 in plain decimals."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.10f}".rstrip("0").rstrip(".")))


def _close(a: ResultRow, b: ResultRow) -> bool:
    """Whether the names of two points would lie upon one another."""
    return all(abs(np.log(a.score(name) / b.score(name))) < 0.15 for name in ("ms_mean", "mse"))


def _point(ax: Any, row: ResultRow, name: str, colour: str, marker: str, below: bool = False) -> None:
    x, y = row.score("ms_mean"), row.score("mse")
    ax.plot(x, y, marker, color=colour, ms=7)
    ax.annotate(name, (x, y), xytext=(6, -12 if below else 4), textcoords="offset points", fontsize=7.5)
