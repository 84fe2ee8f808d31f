"""Bundles of the paper's systems: finding them, and what their rows and curves take from them."""

from __future__ import annotations

import json
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.reading import read_bytes
from signsplice.paper import results
from signsplice.paper.results import Curve, ResultRow
from signsplice.splicing.bundle import BUNDLE_FILE, BundleConfig, bundle_sha256, config_of


def read_all(bundles: Path) -> list[BundleConfig]:
    """The configurations of all bundles in a folder, sorted by name.

    Bundles of other versions are included; opening one raises ``InputError``. So does reading an invalid bundle.json.
    """
    return [_read(path) for path in sorted(bundles.glob(f"*/{BUNDLE_FILE}"))] if bundles.is_dir() else []


def _read(path: Path) -> BundleConfig:
    try:
        return config_of(json.loads(read_bytes(path)), path)
    except ValueError as error:
        raise InputError(f"{path}: is no JSON ({error})") from error


def result_row(config: BundleConfig) -> ResultRow:
    """A bundle's row without split and scores. Raises ``InputError`` if bundle.json lacks a field."""
    fields = ("system", "scale", "optimiser", "seed", "steps", "corpus")
    config.require(*fields)
    values = {name: getattr(config, name) for name in fields}
    bias = None if config.runs is None else config.runs.token_bias
    return ResultRow(
        split="", **values, fr=config.fr, n_parameters=config.n_parameters, token_bias=bias, bundle=short_hash(config)
    )


def short_hash(config: BundleConfig) -> str:
    """The first twelve hex digits of a bundle's sha256."""
    return bundle_sha256(config.path.parent)[:12]


def training_curve(config: BundleConfig, row: ResultRow) -> Curve | None:
    """Validation accuracy by step from a bundle's training logs (JSON lines with ``step`` and ``accuracy``); None if
    there are none.
    """
    points = []
    for path in sorted(config.path.parent.glob("*.jsonl")):
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
