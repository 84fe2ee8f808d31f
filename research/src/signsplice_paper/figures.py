"""The paper's figures 4(c), 5(a), 6 and 7 from results.json and frames.npz, each as PNG and SVG.

Curves are those of whole systems through their own positions; minutes are summed over a system's parts.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from signsplice.errors import MissingExtraError
from signsplice.formats.atomic import replacing
from signsplice_paper import published
from signsplice_paper.curve import MOST_DIFFERENCE, Curve, measure_difference
from signsplice_paper.kept_frames import KeptFrames
from signsplice_paper.results import Results
from signsplice_paper.style import ABLATIONS, COMPARED, make_plot_options

HALF = (5.2, 3.6)
"""Inches of one plot."""
SPLIT = "random"
LEAST_ACCURACY = 0.5
"""Least Accuracy at the lower edge of a plot, if every curve ends above it; lower beginnings are cut off."""
_ERRORS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.03, 0.02, 0.015, 0.01, 0.007, 0.005)
"""Errors 1 - Accuracy that have a tick."""


def write(
    results: Results, figure_pairs: Sequence[KeptFrames], folder: Path, scale: str
) -> tuple[list[Path], list[str]]:
    """Writes the figures; returns their paths, and a line for each figure or curve that is left out. Raises
    ``MissingExtraError`` without matplotlib.
    """
    from signsplice_paper.pictures import draw_pairs

    pyplot = import_pyplot()
    written: list[Path] = []
    left_out: list[str] = []
    plots = _Plots(results, scale, pyplot)
    for name, systems in (("figure4c", COMPARED), ("figure5a", ABLATIONS)):
        written += _save_figure(pyplot, plots.draw_curves(systems), folder / name, left_out)
    left_out += plots.refused
    for name, pairs in (("figure6", figure_pairs[:1]), ("figure7", figure_pairs[1:])):
        written += _save_figure(pyplot, draw_pairs(pyplot, pairs, scale), folder / name, left_out)
    return written, list(dict.fromkeys(left_out))


def _save_figure(pyplot: Any, figure: Any, path: Path, left_out: list[str]) -> list[Path]:
    if figure is None:
        left_out.append(path.name)
        return []
    written = save(figure, path)
    pyplot.close(figure)
    return written


def import_pyplot() -> Any:
    """Returns matplotlib's pyplot, set to draw to files and to write the same bytes for the same numbers.

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
    """Writes a figure as PNG and SVG, each atomically, and returns their paths."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # keep the layout of the first drawing for both files
    paths = []
    for suffix, metadata in ((".png", {"Software": None}), (".svg", {"Date": None})):
        target = path.with_suffix(suffix)
        with replacing(target) as temporary:
            figure.savefig(temporary, dpi=130, format=suffix[1:], metadata=metadata)
            if suffix == ".svg":  # six decimals per coordinate double the file's size
                text = temporary.read_text(encoding="utf-8")
                temporary.write_text(re.sub(r"(\.\d\d)\d+", r"\1", text), encoding="utf-8")
        paths.append(target)
    return paths


class _Plots:
    """The plots of one scale; each method returns a figure, or None if there are too few rows.

    - refused: a line for each curve whose last point differs from its row's validation score
    """

    def __init__(self, results: Results, scale: str, pyplot: Any) -> None:
        self.results, self.scale, self.pyplot = results, scale, pyplot
        self.refused: list[str] = []
        self.curves = {curve.system: curve for curve in results.curves if not curve.seed and self._is_drawn(curve)}

    def draw_curves(self, systems: Sequence[str]) -> Any:
        """Draws, by the minutes of training, Accuracy on validation pairs, and exact positions of test pairs and,
        dotted, of training pairs; of seed 0. Returns None with fewer than two curves.
        """
        known = [self.curves[system] for system in systems if system in self.curves]
        known = [curve for curve in known if None not in curve.column("core_minutes")]
        if len(known) < 2:
            return None
        figure, (accuracy_axis, position_axis) = self.pyplot.subplots(
            1, 2, figsize=(2.0 * HALF[0], HALF[1]), constrained_layout=True
        )
        for curve in known:
            options = {"lw": 1.6, "ms": 4.0, **make_plot_options(curve.system)}
            minutes = curve.column("core_minutes")
            name = published.get_display_name(curve.system)
            accuracy_axis.plot(
                minutes, [1.0 - (value or 0.0) for value in curve.column("accuracy")], **options, label=name
            )
            position_axis.plot(minutes, curve.column("paa_test"), **options)
            position_axis.plot(minutes, curve.column("paa_train"), **{**options, "ls": ":", "marker": ""})
        _format_accuracy_axis(accuracy_axis)
        accuracy_axis.set(xlabel="core-minutes of training", xlim=(0.0, None), ylabel="Accuracy, validation pairs")
        position_axis.set(xlabel="core-minutes of training", xlim=(0.0, None), ylim=(-0.02, 1.02),
                  ylabel="both positions exact: test, dotted taught")  # fmt: skip
        position_axis.grid(alpha=0.25)
        accuracy_axis.legend(fontsize=8)
        figure.suptitle(f"Through each system's own positions (AdamW, scale {self.scale}, {SPLIT})", fontsize=10)
        return figure

    def _is_drawn(self, curve: Curve) -> bool:
        """Returns whether a curve belongs to the figure. A curve whose last point differs from the validation score
        of the same bundle's row is refused.
        """
        if (curve.scale, curve.optimiser, curve.split) != (self.scale, "adamw", SPLIT):
            return False
        for row in self.results.find(system=curve.system, bundle=curve.bundle, split=SPLIT, part="test"):
            measured = row.score("accuracy_valid")
            if measure_difference(curve, measured) > MOST_DIFFERENCE:
                self.refused.append(
                    f"the curve of {curve.system} (ends at {curve.column('accuracy')[-1]}, its row's validation "
                    f"Accuracy is {measured:.4f})"
                )
                return False
        return True


def _format_accuracy_axis(ax: Any) -> None:
    """Sets the axis of errors 1 - Accuracy: logarithmic, upside down, with ticks that name the Accuracy."""
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
