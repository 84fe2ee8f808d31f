"""results.json: every row that was measured, with the recipe that made it, and the curves of every training.

A row is told apart by what was judged and where: system, what it was told, scale, optimiser, fr, seed, split, part. A
new row takes the place of one of the same key. Tables are made of rows whose signatures agree, and of no others.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from signsplice.errors import InputError
from signsplice.formats.atomic import read_bytes, replacing
from signsplice.paper import metrics
from signsplice.splicing.bundle import bundle_sha256

VERSION = 1
CLASSICAL, OWN, TAUGHT = "classical", "own", "taught"
"""Scales of rows that the paper does not know: methods that were not trained, this project's networks as they ship, and
the same after learning from the split's training part, as every system of the paper does.
"""
ON_CLIPS = (CLASSICAL, OWN, TAUGHT)
PACKAGES = ("signsplice", "numpy", "scipy", "onnxruntime")
MOST_POINTS = 400
_STORED = {"given": "told"}
"""Fields whose key in results.json is another word: files written before must stay readable."""


@dataclass(frozen=True)
class ResultRow:
    """One system on one protocol. ``bundle``: hash of the bundle judged, None for classical rows; ``given``: what of the
    truth it was told; ``measures``: which signatures its scores have; a score is None where nothing could be counted.
    """

    system: str
    split: str
    scale: str = CLASSICAL
    optimiser: str = ""
    part: str = "test"
    fr: int | None = None
    seed: int | None = None
    given: str = "nothing"
    steps: int | None = None
    n_parameters: int | None = None
    bundle: str | None = None
    corpus: str = ""
    protocol: str = ""
    measures: str = ""
    n_pairs: int = 0
    scores: Mapping[str, float | None] = field(default_factory=dict)
    commit: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    machine: str = ""

    @property
    def key(self) -> tuple[object, ...]:
        """What tells rows apart."""
        told = (self.system, self.given, self.scale, self.optimiser, self.fr, self.seed)
        return (*told, self.split, self.part)

    def score(self, name: str) -> float:
        """A score by name, NaN where there is none."""
        value = self.scores.get(name)
        return float("nan") if value is None else value


@dataclass(frozen=True)
class Curve:
    """A training as it went: validation accuracy by step."""

    system: str
    split: str
    scale: str
    optimiser: str
    fr: int | None
    seed: int | None
    points: Sequence[tuple[float, float]]

    @property
    def key(self) -> tuple[object, ...]:
        """What tells curves apart."""
        return (self.system, self.split, self.scale, self.optimiser, self.fr, self.seed)


@dataclass(frozen=True)
class Results:
    """Rows and curves, each of another key, and the signatures that rows name."""

    rows: tuple[ResultRow, ...] = ()
    curves: tuple[Curve, ...] = ()
    signatures: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def merged(self, rows: Iterable[ResultRow] = (), curves: Iterable[Curve] = ()) -> Results:
        """These results with rows and curves added; those of the same key are replaced. Signatures no row names go."""
        by_key = {row.key: row for row in (*self.rows, *rows)}
        by_curve = {curve.key: curve for curve in (*self.curves, *curves)}
        named = {row.measures for row in by_key.values()}
        known = {**self.signatures, signature_id(): metrics.SIGNATURES}
        return Results(
            tuple(sorted(by_key.values(), key=lambda row: _order(row.key))),
            tuple(sorted(by_curve.values(), key=lambda curve: _order(curve.key))),
            {k: v for k, v in known.items() if k in named},
        )

    def find(self, **wanted: object) -> list[ResultRow]:
        """Rows whose fields have these values."""
        return [row for row in self.rows if all(getattr(row, k) == v for k, v in wanted.items())]


def signature_id() -> str:
    """A short name for the signatures of all measures as they are now."""
    text = json.dumps(metrics.SIGNATURES, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def check_alike(rows: Sequence[ResultRow]) -> None:
    """Raise ``InputError`` where rows for one table were not measured alike: other measures, protocol or corpus."""
    for what in ("measures", "protocol", "corpus"):
        kinds = {getattr(row, what): row for row in rows}
        if len(kinds) > 1:
            (a, first), (b, second) = list(kinds.items())[:2]
            raise InputError(
                f"{first.system} and {second.system} cannot stand in one table: {what} {a!r} and {b!r}; "
                "judge both anew with `signsplice paper all`"
            )


def bundle_row(facts: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The fields of a row that a bundle's facts tell. Raises ``InputError`` where one is missing."""
    try:
        told = {name: facts[name] for name in ("system", "scale", "optimiser", "seed", "steps", "corpus")}
    except KeyError as error:
        raise InputError(f"{folder / 'bundle.json'}: has no {error.args[0]!r}; export the bundle anew") from None
    config = facts.get("config") or {}
    fr = facts.get("fr", config.get("fr"))
    return {**told, "fr": fr, "n_parameters": facts.get("n_parameters"), "bundle": bundle_hash(folder)}


def bundle_hash(folder: Path) -> str:
    """The first twelve hex digits of a bundle's sha256."""
    return bundle_sha256(folder)[:12]


def surroundings() -> dict[str, Any]:
    """Where a row is measured: commit, versions, machine, and the signatures' name."""
    return {"commit": commit(), "versions": versions(), "machine": machine(), "measures": signature_id()}


def commit(folder: Path | None = None) -> str:
    """The git revision that runs, "+" after it where files differ from it; empty where there is none."""
    where = folder or Path(__file__).resolve().parents[1]
    try:
        told = [
            subprocess.run(["git", *call], cwd=where, capture_output=True, text=True, check=True, timeout=20).stdout
            for call in (["rev-parse", "--short=12", "HEAD"], ["status", "--porcelain", "--", "."])
        ]
    except (OSError, subprocess.SubprocessError):
        return ""
    return told[0].strip() + ("+" if told[1].strip() else "")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that a row rests on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def machine() -> str:
    """The processor and how many cores there are: times are of one machine."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), name)
    except OSError:
        pass
    return f"{name}, {os.cpu_count()} cores"


def finite(scores: Mapping[str, float]) -> dict[str, float | None]:
    """Scores for JSON: None for what could not be counted."""
    return {name: value if math.isfinite(value) else None for name, value in scores.items()}


def thinned(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """At most ``MOST_POINTS`` of a curve's points, evenly chosen, first and last among them."""
    if len(points) <= MOST_POINTS:
        return list(points)
    step = (len(points) - 1) / (MOST_POINTS - 1)
    return [points[round(k * step)] for k in range(MOST_POINTS)]


def load(path: Path) -> Results:
    """Results from a file; none where there is no file. Raises ``InputError`` for a file that is something else."""
    if not path.exists():
        return Results()
    try:
        head = json.loads(read_bytes(path))
        if head["version"] != VERSION:
            raise InputError(f"{path}: version {head['version']}, expected {VERSION}; measure anew")
        names = {_STORED.get(f.name, f.name): f.name for f in fields(ResultRow)}
        rows = tuple(ResultRow(**{names[k]: v for k, v in row.items() if k in names}) for row in head["rows"])
        curves = tuple(Curve(**{**curve, "points": [(a, b) for a, b in curve["points"]]}) for curve in head["curves"])
        return Results(rows, curves, head["signatures"])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is no results.json of this project ({error})") from error


def save(results: Results, path: Path) -> None:
    """Write results whole or not at all, a row a line."""
    lines = [
        "{",
        f' "version": {VERSION},',
        f' "signatures": {json.dumps(results.signatures, indent=1)},',
        ' "rows": [',
        ",\n".join("  " + json.dumps(_stored(row)) for row in results.rows),
        ' ],\n "curves": [',
        ",\n".join("  " + json.dumps(asdict(curve)) for curve in results.curves),
        " ]\n}",
    ]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _stored(row: ResultRow) -> dict[str, Any]:
    """A row with the keys of results.json."""
    return {_STORED.get(name, name): value for name, value in asdict(row).items()}


def _order(key: tuple[object, ...]) -> tuple[str, ...]:
    return tuple("" if part is None else f"{part:09d}" if isinstance(part, int) else str(part) for part in key)
