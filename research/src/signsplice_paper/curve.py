"""Validation curves: how good a whole system was after each part of its training, through its own positions.

A curve is made from snapshots of the weights (``train.curves``) and stored as curve.json in the bundle's folder.
results.json holds a copy, with which figures are drawn.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.formats.json_files import read_json

FILE = "curve.json"
VERSION = 2
COLUMNS = ("pairs", "core_minutes", "accuracy", "mse", "paa_train", "paa_test")
"""The numbers of a point: pairs seen and processor minutes of all parts together, Accuracy and MSE on validation pairs,
and the share of taught and of test pairs whose positions are both exact."""
MOST_DIFFERENCE = 0.002
"""Largest difference between the Accuracy of the last point and that of the exported bundle on the same pairs."""


@dataclass(frozen=True)
class Curve:
    """The scores of a system on validation pairs over its training.

    - system: the system's name
    - split: the split whose training part it learned from
    - scale: smoke, cpu or paper
    - optimiser: adamw or sgd
    - fr: frames that Culling keeps on each side, None without Culling
    - seed: the training's seed
    - points: the numbers of each point, named by ``columns``; None if unknown
    - columns: ``COLUMNS``
    - bundle: first digits of the bundle's sha256
    - corpus: hash of the corpus
    - n_pairs: number of pairs of each kind
    """

    system: str
    split: str
    scale: str
    optimiser: str
    fr: int | None
    seed: int | None
    points: Sequence[Sequence[float | None]]
    columns: tuple[str, ...] = COLUMNS
    bundle: str = ""
    corpus: str = ""
    n_pairs: int = 0

    @property
    def key(self) -> tuple[object, ...]:
        """Identifies the curve: a curve of the same key replaces it."""
        return (self.system, self.split, self.scale, self.optimiser, self.fr, self.seed)

    def column(self, name: str) -> list[float | None]:
        """Returns one number of every point."""
        index = self.columns.index(name)
        return [point[index] for point in self.points]


def measure_difference(curve: Curve, accuracy: float) -> float:
    """Returns the difference between the last point's Accuracy and an Accuracy on the same pairs; infinite for a curve
    without points.
    """
    last = curve.column("accuracy")[-1] if curve.points else None
    return float("inf") if last is None else abs(last - accuracy)


def parse_curve(stored: Mapping[str, Any]) -> Curve:
    """Returns the curve that ``asdict`` stored. Raises ``TypeError`` or ``KeyError`` for anything else."""
    if tuple(stored["columns"]) != COLUMNS or any(len(point) != len(COLUMNS) for point in stored["points"]):
        raise KeyError("columns")
    return Curve(**{**stored, "points": [tuple(point) for point in stored["points"]], "columns": COLUMNS})


def save(curve: Curve, folder: Path) -> Path:
    """Writes curve.json into a bundle's folder, atomically, and returns its path."""
    path = folder / FILE
    with replacing(path) as temporary:
        temporary.write_text(json.dumps({"version": VERSION, **asdict(curve)}) + "\n", encoding="utf-8")
    return path


def load(folder: Path, bundle: str) -> Curve | None:
    """Returns the curve in a bundle's folder, None if there is none or it is of an earlier bundle. Raises
    ``InputError`` for a file of another kind.
    """
    path = folder / FILE
    if not path.is_file():
        return None
    stored = read_json(path, "a validation curve")
    try:
        if stored.pop("version") != VERSION:
            raise KeyError("version")
        curve = parse_curve(stored)
    except (AttributeError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is no validation curve ({error}); remove it, `signsplice-paper curves`") from error
    return curve if curve.bundle == bundle else None
