"""The paper's figures 4 to 7 from results.json and frames.npz, each as PNG and SVG."""

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
from signsplice.paper.kept_frames import HERMITE, PRODUCT, KeptFrames
from signsplice.paper.lines import OPTIMISERS, pick
from signsplice.paper.results import Curve, ResultRow, Results

COLOURS = ("#3f6fa8", "#de8e20", "#5a9367", "#b04a5a", "#7d5ba6", "#6b6b6b", "#2a9d9d", "#a08040")
SIZE = (5.2, 3.6)
SPLIT = "random"


def write(results: Results, kept: Sequence[KeptFrames], folder: Path, scale: str) -> tuple[list[Path], list[str]]:
    """The paths of the figures written, and the names of the figures that have no numbers.

    Figures 4 and 5 are drawn for AdamW, and for SGD with ``-sgd`` in the name. Raises ``MissingExtraError`` without
    matplotlib.
    """
    from signsplice.paper.pictures import draw_pairs

    pyplot = plotting()
    written: list[Path] = []
    left_out: list[str] = []
    for optimiser in OPTIMISERS:
        plots = _Plots(results, scale, optimiser)
        by_name: dict[str, Callable[[Any], bool]] = {
            "figure4a": plots.accuracy_by_fr,
            "figure4b": plots.time_and_error_by_fr,
            "figure4c": partial(plots.accuracy, systems=published.TABLE_1),
            "figure4d": partial(plots.error_against_time, systems=published.TABLE_1, clip_methods=True),
            "figure5a": partial(plots.accuracy, systems=published.TABLE_3),
            "figure5b": partial(plots.error_against_time, systems=published.TABLE_3, clip_methods=False),
        }
        for name, draw in by_name.items():
            name = name if optimiser == "adamw" else f"{name}-{optimiser}"
            figure, ax = pyplot.subplots(figsize=SIZE, constrained_layout=True)
            if draw(ax):
                written += save(figure, folder / name)
            else:
                left_out.append(name)
            pyplot.close(figure)
    for name, chosen in (("figure6", kept[:1]), ("figure7", kept[1:])):
        figure = draw_pairs(pyplot, chosen, scale)
        if figure is None:
            left_out.append(name)
        else:
            written += save(figure, folder / name)
            pyplot.close(figure)
    return written, left_out


def plotting() -> Any:
    """Matplotlib's pyplot, set to draw to files and to write the same bytes for the same numbers.

    Raises ``MissingExtraError`` without matplotlib.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError("figures need matplotlib: pip install 'signsplice[paper]'") from error
    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "signsplice"
    from matplotlib import pyplot

    return pyplot


def save(figure: Any, path: Path) -> list[Path]:
    """Write a figure as PNG and SVG, each atomically; the paths written."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # keep the layout of the first drawing for both files
    out = []
    for suffix, metadata in ((".png", {"Software": None}), (".svg", {"Date": None})):
        target = path.with_suffix(suffix)
        with replacing(target) as temporary:
            figure.savefig(temporary, dpi=130, format=suffix[1:], metadata=metadata)
            if suffix == ".svg":  # six decimals per coordinate double the file's size
                text = temporary.read_text(encoding="utf-8")
                temporary.write_text(re.sub(r"(\.\d\d)\d+", r"\1", text), encoding="utf-8")
        out.append(target)
    return out


class _Plots:
    """The plots of one scale and optimiser; each method draws on axes and returns whether it had enough rows."""

    def __init__(self, results: Results, scale: str, optimiser: str) -> None:
        self.results, self.scale, self.optimiser = results, scale, optimiser
        self.setting = f"{OPTIMISERS[optimiser]}, scale {scale}"

    def accuracy_by_fr(self, ax: Any) -> bool:
        """Figure 4(a)."""
        by_fr = {curve.fr: curve for curve in self._curves("lpt") if curve.fr is not None}
        if len(by_fr) < 2:
            return False
        for n, fr in enumerate(sorted(by_fr)):
            _line(ax, by_fr[fr].points, f"fr = {fr}", n)
        return _finish_curves(ax, f"Accuracy over training by fr ({self.setting})")

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
        ax.set_title(f"Prediction time and MSE by fr ({self.setting})", fontsize=10)
        return True

    def accuracy(self, ax: Any, systems: Iterable[str]) -> bool:
        """Figures 4(c) and 5(a). Systems that share the network for frames share its curve."""
        drawn: dict[tuple[tuple[float, float], ...], tuple[list[str], int]] = {}
        for n, system in enumerate(systems):
            curves = [c for c in self._curves(system) if c.fr in (None, published.BEST_FR)]
            if curves:
                curve = min(curves, key=lambda c: c.seed or 0)
                drawn.setdefault(tuple((a, b) for a, b in curve.points), ([], n))[0].append(published.name(system))
        for points, (names, n) in drawn.items():
            _line(ax, points, ", ".join(names), n)
        n_systems = sum(len(names) for names, _ in drawn.values())
        return n_systems > 1 and _finish_curves(ax, f"Accuracy over training ({self.setting})")

    def error_against_time(self, ax: Any, systems: Iterable[str], clip_methods: bool) -> bool:
        """Figures 4(d) and 5(b); ``clip_methods`` adds two classical rows with given length, and the product."""
        rows = list(pick(self.results, self.scale, SPLIT, self.optimiser, systems).values())
        if len(rows) < 2:
            return False
        for n, row in enumerate(rows):
            below = any(_close(row, other) for other in rows[:n])
            _point(ax, row, published.name(row.system), COLOURS[n], "o", below)
        if clip_methods:
            for system, given, name, colour in (
                ("pose-velocity+hermite", "length", "pose-velocity+hermite,\ngiven length", "#9a9a9a"),
                (*HERMITE, "true-positions+hermite,\ngiven positions and length", "#9a9a9a"),
                (*PRODUCT, "signsplice", "#1b1b1b"),
            ):
                for row in self.results.find(system=system, given=given, split=SPLIT, part="test"):
                    _point(ax, row, name, colour, "s")
        ax.axhline(published.VISIBLE, color="#b04a5a", ls=":", lw=1)
        ax.annotate("seen by viewers above (paper)", (0.01, published.VISIBLE), xycoords=("axes fraction", "data"),
                    ha="left", va="bottom", fontsize=7, color="#b04a5a")  # fmt: skip
        ax.set(xscale="log", yscale="log", xlabel="mean prediction time, ms a pair", ylabel="MSE")
        ax.margins(0.3)
        _plain_ticks(ax)
        ax.set_title(f"MSE against prediction time ({self.setting})", fontsize=10)
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
    """Put the ticks of logarithmic axes at 1, 2 and 5, in plain decimals."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.10f}".rstrip("0").rstrip(".")))


def _close(a: ResultRow, b: ResultRow) -> bool:
    """Whether the labels of two points would overlap."""
    return all(abs(np.log(a.score(name) / b.score(name))) < 0.15 for name in ("ms_mean", "mse"))


def _point(ax: Any, row: ResultRow, name: str, colour: str, marker: str, below: bool = False) -> None:
    x, y = row.score("ms_mean"), row.score("mse")
    ax.plot(x, y, marker, color=colour, ms=7)
    ax.annotate(name, (x, y), xytext=(6, -12 if below else 4), textcoords="offset points", fontsize=7.5)
