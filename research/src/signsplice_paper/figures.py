"""The paper's figures 4 to 7 from results.json and frames.npz, each as PNG and SVG.

Curves are those of whole systems through their own positions. They have two axes: pairs seen in training, and
core-minutes, both summed over a system's parts.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from signsplice.errors import MissingExtraError
from signsplice.formats.atomic import replacing
from signsplice_paper import frame_errors, published, treatments
from signsplice_paper.curve import MOST_DIFFERENCE, Curve, difference
from signsplice_paper.kept_frames import HERMITE, PRODUCT, KeptFrames
from signsplice_paper.labels import label_points
from signsplice_paper.lines import OPTIMISERS, TableLine, line, shared_seeds
from signsplice_paper.results import CORPUS_TRAINED, Results
from signsplice_paper.style import ABLATIONS, CLASSICAL, COMPARED, ON_CLIPS, Style, plot_options, style

Key = TypeVar("Key")
HALF = (5.2, 3.6)
"""Inches of one plot."""
SPLIT = "random"
X_AXES = {"pairs": ("thousands of pairs seen in training", 1e-3), "core_minutes": ("core-minutes of training", 1.0)}
"""The numbers of a point that are drawn, with the axis and its scale."""
SWEPT = ("lpt-printed", "lpt")
"""The systems that may be trained for several fr; the first that is, is shown."""
LEAST_ACCURACY = 0.5
"""Least Accuracy at the lower edge of a plot, if every curve ends above it; curves enter from below."""
_ERRORS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.03, 0.02, 0.015, 0.01, 0.007, 0.005)
"""Errors 1 - Accuracy that have a tick."""


def write(results: Results, kept: Sequence[KeptFrames], folder: Path, scale: str) -> tuple[list[Path], list[str]]:
    """The paths of the figures and of the table of errors by frame, and a line for each figure or curve left out.

    Figures 4 and 5 are drawn for AdamW, and for SGD with ``-sgd`` in the name. Raises ``MissingExtraError`` without
    matplotlib.
    """
    from signsplice_paper.pictures import draw_pairs

    pyplot = plotting()
    written: list[Path] = []
    left_out: list[str] = []
    for optimiser in ("adamw", "sgd"):
        plots = _Plots(results, scale, optimiser, pyplot)
        by_name: dict[str, Callable[[], Any]] = {
            "figure4a": plots.accuracy_by_fr,
            "figure4b": plots.time_and_error_by_fr,
            "figure4c": partial(plots.accuracy, {"": COMPARED}),
            "figure4d": plots.comparison,
            "figure5a": partial(plots.accuracy, ABLATIONS, alike=True),
            "figure5b": plots.ablations,
            frame_errors.PAGE: partial(frame_errors.plot, results, scale, optimiser, pyplot),
        }
        for name, draw in by_name.items():
            name = name if optimiser == "adamw" else f"{name}-{optimiser}"
            written += _written(pyplot, draw(), folder / name, left_out)
        left_out += plots.refused
    alike = treatments.plot(results, scale, pyplot)
    if alike is not None:
        written += _written(pyplot, alike, folder / treatments.NAME, left_out)
    for name, chosen in (("figure6", kept[:1]), ("figure7", kept[1:])):
        written += _written(pyplot, draw_pairs(pyplot, chosen, scale), folder / name, left_out)
    return written, list(dict.fromkeys(left_out))


def _written(pyplot: Any, figure: Any, path: Path, left_out: list[str]) -> list[Path]:
    if figure is None:
        left_out.append(path.name)
        return []
    written = save(figure, path)
    pyplot.close(figure)
    return written


def plotting() -> Any:
    """Matplotlib's pyplot, set to draw to files and to write the same bytes for the same numbers.

    Raises ``MissingExtraError`` without matplotlib.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError("figures need matplotlib: pip install matplotlib") from error
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
    """The plots of one scale and optimiser; each method returns a figure, or None if there are too few rows.

    - refused: a line for each curve that ends elsewhere than its row's validation score
    """

    def __init__(self, results: Results, scale: str, optimiser: str, pyplot: Any) -> None:
        self.results, self.scale, self.optimiser, self.pyplot = results, scale, optimiser, pyplot
        self.setting = f"{OPTIMISERS[optimiser]}, scale {scale}"
        self.refused: list[str] = []
        self.curves = [curve for curve in results.curves if self._is_drawn(curve)]

    def accuracy_by_fr(self) -> Any:
        """Figure 4(a)."""
        by_fr = next((found for s in SWEPT if len(found := self._swept(s)) > 1), {})
        if not by_fr:
            return None
        shades = self.pyplot.get_cmap("viridis_r")
        lines = {}
        for n, (fr, curve) in enumerate(sorted(by_fr.items())):
            best = fr == published.BEST_FR
            colour = shades(0.12 + 0.88 * n / (len(by_fr) - 1))
            lines[f"fr = {fr}"] = (curve, {"color": colour, "lw": 2.4 if best else 1.2, "marker": "os^Dv<>"[n % 7]})
        system = published.name(next(iter(by_fr.values())).system)
        return self._drawn_curves({"": lines}, f"{system}: validation Accuracy by fr ({self.setting})")

    def time_and_error_by_fr(self) -> Any:
        """Figure 4(b)."""
        wanted = {"scale": self.scale, "optimiser": self.optimiser, "split": SPLIT, "part": "test"}
        for system in SWEPT:
            frs = sorted({row.fr for row in self.results.find(system=system, **wanted) if row.fr is not None})
            seeds = shared_seeds(self.results, [system], self.scale, SPLIT, self.optimiser, frs)
            found = {fr: line(self.results, system, self.scale, SPLIT, self.optimiser, fr, seeds) for fr in frs}
            known = {fr: one for fr, one in found.items() if one.is_known}
            if len(known) > 1:
                return self._bars(known, published.name(system))
        return None

    def _bars(self, by_fr: Mapping[int, TableLine], name: str) -> Any:
        figure, ax = self.pyplot.subplots(figsize=HALF, constrained_layout=True)
        at, found = list(by_fr), by_fr.values()
        bars, curve = style("lpt-printed").colour, style("lpt").colour
        errors = [one.score("mse") for one in found]
        ax.bar(at, [one.score("ms_mean") for one in found], width=0.9, color=bars, alpha=0.75)
        ax.set(xlabel="fr, frames", xticks=at)
        ax.set_ylabel("mean prediction time, ms (bars)", color=bars)
        other = ax.twinx()
        other.plot(at, errors, "D-", color=curve)
        other.set_ylabel("MSE (line)", color=curve)
        other.set_ylim(0.0, 1.2 * max(errors))
        ax.set_title(f"{name}: prediction time and MSE by fr ({self.setting})", fontsize=9)
        return figure

    def accuracy(self, groups: Mapping[str, Sequence[str]], alike: bool = False) -> Any:
        """Figures 4(c) and 5(a): a row of plots for each group of systems that has two curves or more; ``alike``: of a
        seed that all of a group have.
        """
        lines = {}
        for title, systems in groups.items():
            at_best = [curve for curve in self.curves if curve.fr in (None, published.BEST_FR)]
            found = _last({s: [curve for curve in at_best if curve.system == s] for s in systems}, alike)
            known = {published.name(s): (curve, plot_options(s)) for s, curve in found.items()}
            if len(known) > 1:
                lines[title] = known
        return self._drawn_curves(lines, f"Accuracy on validation pairs, own positions ({self.setting})")

    def comparison(self) -> Any:
        """Figure 4(d): the compared systems, two classical rows with what they are given, and this project's."""
        points = self._points(COMPARED)
        if len(points) < 2:
            return None
        for (system, given), name, of in (
            (("pose-velocity+hermite", "length"), "pose-velocity+hermite,\ngiven length", CLASSICAL),
            (HERMITE, "true-positions+hermite,\ngiven positions and length", CLASSICAL),
            (PRODUCT, "signsplice", ON_CLIPS),
        ):
            for row in self.results.find(system=system, given=given, split=SPLIT, part="test"):
                trained = "" if of is CLASSICAL else ", as it ships"
                trained = ", trained on the split" if row.scale == CORPUS_TRAINED else trained
                points.append((TableLine(name + trained, "", (row,)), of))
        return self._error_against_time({"": points})

    def ablations(self) -> Any:
        """Figure 5(b): a plot for each family of which two or more are there."""
        groups = {title: self._points(systems, alike=True) for title, systems in ABLATIONS.items()}
        return self._error_against_time({title: points for title, points in groups.items() if len(points) > 1})

    def _points(self, systems: Sequence[str], alike: bool = False) -> list[tuple[TableLine, Style]]:
        """The line and the style of every system that is trained; ``alike``: with the seeds that all of them have."""
        at = (self.scale, SPLIT, self.optimiser)
        seeds = shared_seeds(self.results, systems, *at) if alike else ()
        found = {system: line(self.results, system, *at, seeds=seeds) for system in systems}
        return [(one, style(system)) for system, one in found.items() if one.is_known]

    def _error_against_time(self, groups: Mapping[str, Sequence[tuple[TableLine, Style]]]) -> Any:
        """A plot of MSE against time for each group of points."""
        if not groups:
            return None
        width = max(HALF[0] * len(groups), 1.25 * HALF[0])
        size = {"figsize": (width, 1.2 * HALF[1]), "constrained_layout": True}
        figure, axes = self.pyplot.subplots(1, len(groups), squeeze=False, **size)
        for ax, (title, points) in zip(axes[0], groups.items(), strict=True):
            at = [(one.score("ms_mean"), one.score("mse")) for one, _ in points]
            for (x, y), (_, of) in zip(at, points, strict=True):
                ax.plot(x, y, of.marker, color=of.colour, ms=7, mfc="white" if of.dashed else of.colour)
            ax.axhline(published.VISIBLE, color="#9a9a9a", ls=":", lw=1)
            ax.annotate("seen by viewers above (paper)", (0.01, published.VISIBLE), fontsize=7, color="#6b6b6b",
                        xycoords=("axes fraction", "data"), ha="left", va="bottom")  # fmt: skip
            ax.set(xscale="log", yscale="log", xlabel="mean prediction time, ms a pair", ylabel="MSE")
            ax.set_xlim(_log_limits([x for x, _ in at]))
            ax.set_ylim(_log_limits([y for _, y in at] + [published.VISIBLE]))
            _plain_ticks(ax)
            ax.set_title(title or f"MSE against prediction time ({self.setting})", fontsize=10)
        if len(groups) > 1 or "" not in groups:
            figure.suptitle(f"MSE against prediction time ({self.setting})", fontsize=10)
        for ax, points in zip(axes[0], groups.values(), strict=True):
            at = [(one.score("ms_mean"), one.score("mse")) for one, _ in points]
            label_points(ax, at, [one.name for one, _ in points], [of.colour for _, of in points])
        return figure

    def _drawn_curves(self, groups: Mapping[str, Mapping[str, tuple[Curve, dict[str, Any]]]], title: str) -> Any:
        """Curves by group (rows of plots), with each of ``X_AXES`` (columns) that all curves of the group know."""
        if not groups:
            return None
        known = [
            x for x in X_AXES
            if all(None not in curve.column(x) for lines in groups.values() for curve, _ in lines.values())
        ]  # fmt: skip
        size = {"figsize": (HALF[0] * len(known), HALF[1] * len(groups)), "constrained_layout": True}
        figure, axes = self.pyplot.subplots(len(groups), len(known), squeeze=False, **size)
        for row, (group, lines) in zip(axes, groups.items(), strict=True):
            for ax, x in zip(row, known, strict=True):
                for name, (curve, options) in lines.items():
                    at = [X_AXES[x][1] * (value or 0.0) for value in curve.column(x)]
                    height = [1.0 - (value or 0.0) for value in curve.column("accuracy")]
                    ax.plot(at, height, **{"lw": 1.6, "ms": 4.0, **options}, label=name)
                _accuracy_axis(ax)
                ax.set(xlabel=X_AXES[x][0], xlim=(0.0, None), ylabel="Accuracy" + (f", {group}" if group else ""))
            row[0].legend(fontsize=8)
        figure.suptitle(title, fontsize=10)
        return figure

    def _swept(self, system: str) -> dict[int, Curve]:
        """A system's curves by fr, of a seed that all of them have."""
        own = [curve for curve in self.curves if curve.system == system and curve.fr is not None]
        return _last({fr: [c for c in own if c.fr == fr] for fr in sorted({c.fr for c in own if c.fr})}, alike=True)

    def _is_drawn(self, curve: Curve) -> bool:
        """Whether a curve belongs here, and its system found the positions itself. One that ends elsewhere than the
        validation score of the same bundle's row is refused.
        """
        if (curve.scale, curve.optimiser, curve.split) != (self.scale, self.optimiser, SPLIT):
            return False
        for row in self.results.find(system=curve.system, bundle=curve.bundle, split=SPLIT, part="test"):
            measured = row.score("accuracy_valid")
            if difference(curve, measured) > MOST_DIFFERENCE:
                self.refused.append(
                    f"the curve of {curve.system} (ends at {curve.column('accuracy')[-1]}, its row's validation "
                    f"Accuracy is {measured:.4f})"
                )
                return False
        return True


def _last(found: Mapping[Key, Sequence[Curve]], alike: bool) -> dict[Key, Curve]:
    """Of the curves of each, that of the last seed; ``alike``: of the last seed that all have, if there is one."""
    found = {key: curves for key, curves in found.items() if curves}
    seeds = [{curve.seed for curve in curves} for curves in found.values()]
    shared = set.intersection(*seeds) if alike and seeds else set()
    return {
        key: max((c for c in curves if not shared or c.seed in shared), key=lambda c: c.seed or 0)
        for key, curves in found.items()
    }


def _accuracy_axis(ax: Any) -> None:
    """Set the axis of errors 1 - Accuracy: logarithmic, upside down, with ticks that name the Accuracy."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    ax.set(yscale="log")
    errors = [line.get_ydata() for line in ax.lines]
    worst, last = max(float(max(values)) for values in errors), max(float(values[-1]) for values in errors)
    lower = max(min(1.0 - LEAST_ACCURACY, 1.15 * worst), 1.1 * last)
    ax.set_ylim(lower, 0.8 * max(min(float(min(values)) for values in errors), 1e-4))
    ax.yaxis.set_major_locator(FixedLocator(_ERRORS))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{1.0 - value:g}"))
    ax.grid(alpha=0.25)


def _log_limits(values: Sequence[float]) -> tuple[float, float]:
    """The limits of a logarithmic axis with room for labels around values."""
    low, high = min(values), max(values)
    room = max(1.4, (high / low) ** 0.22)
    return low / room, high * room


def _plain_ticks(ax: Any) -> None:
    """Put the ticks of logarithmic axes at 1, 2, 5 and, where the axis is short, some between, in plain decimals."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    for axis in (ax.xaxis, ax.yaxis):
        low, high = axis.get_view_interval()
        axis.set_major_locator(
            LogLocator(subs=(1.0, 2.0, 5.0) if high > 15.0 * low else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0))
        )
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.10f}".rstrip("0").rstrip(".")))
