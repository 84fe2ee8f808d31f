"""Bundles of the paper's systems: finding them, and what their rows and curves take from them."""

from __future__ import annotations

import json
from pathlib import Path

from signsplice.formats.atomic import read_bytes
from signsplice.paper import results
from signsplice.paper.results import Curve, ResultRow
from signsplice.splicing.bundle import BUNDLE_FILE, BundleConfig, bundle_sha256, read_config


def all_bundles(bundles: Path) -> list[Path]:
    """Folders of all bundles in a folder, sorted by name."""
    return [path.parent for path in sorted(bundles.glob(f"*/{BUNDLE_FILE}"))] if bundles.is_dir() else []


def of_scale(bundles: Path, scale: str) -> list[Path]:
    """Folders of the bundles of a scale, sorted by name."""
    return [folder for folder in all_bundles(bundles) if read_config(folder).scale == scale]


def result_row(config: BundleConfig, folder: Path) -> ResultRow:
    """A bundle's row without split and scores. Raises ``InputError`` if bundle.json lacks a field."""
    fields = ("system", "scale", "optimiser", "seed", "steps", "corpus")
    config.require(*fields)
    values = {name: getattr(config, name) for name in fields}
    return ResultRow(split="", **values, fr=config.fr, n_parameters=config.n_parameters, bundle=short_hash(folder))


def short_hash(folder: Path) -> str:
    """The first twelve hex digits of a bundle's sha256."""
    return bundle_sha256(folder)[:12]


def training_curve(folder: Path, config: BundleConfig, row: ResultRow) -> Curve | None:
    """Validation accuracy by step from a bundle's training logs (JSON lines with ``step`` and ``accuracy``); None if
    there are none.
    """
    points = []
    for path in sorted(folder.glob("*.jsonl")):
        for line in read_bytes(path).decode("utf-8").splitlines():
            try:
                entry = json.loads(line)
            except ValueError:
                continue
            value = entry.get("accuracy", entry.get("valid_accuracy")) if isinstance(entry, dict) else None
            if value is not None and "step" in entry:
                points.append((float(entry["step"]), float(value)))
    if not points:
        return None
    split = config.split or ""
    return Curve(row.system, split, row.scale, row.optimiser, row.fr, row.seed, results.thinned(sorted(points)))
