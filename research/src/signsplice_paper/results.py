"""results.json, version 3: every measured row with the recipe that made it, and the curve of every training.

A row's key: the system (its name implies the condition), what it was given, what it was taught on, scale, optimiser,
fr, seed, split and part. A new row replaces the row of the same key. A table holds only rows whose signatures agree.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.formats.reading import read_bytes
from signsplice_paper import curve, metrics, viewed
from signsplice_paper.curve import Curve

VERSION = 3
FILE = "results.json"
_OTHER_VERSION = "earlier ones are of corpora that are no longer judged; choose another --out, and judge again"
CLASSICAL, SHIPPED, MEAN, FITTED = "classical", "own", "mean", "fitted"
"""Scales of rows that are not the paper's systems: methods without training, this project's networks as they ship, the
mean transition of a split's training part, and methods fitted to that part in closed form.
"""
SIGNATURES = {**metrics.SIGNATURES, **viewed.SIGNATURES}
GIVEN = ("nothing", "length", "positions", "positions and length")
"""The parts of the truth that a method may be given which splices clips with rotations, not joint positions."""


@dataclass(frozen=True)
class ResultRow:
    """One system on one protocol. The paper's systems are those that ``signsplice-paper`` trains; other rows are of
    methods that splice clips with rotations, of the mean transition and of fitted methods.

    - system: the system's or method's name
    - split: the split that is judged
    - scale: smoke, cpu or paper; ``CLASSICAL``, ``SHIPPED``, ``FITTED`` or ``MEAN`` for other rows
    - taught: hash of the corpus that it learned from, if that is another than the one judged on; else empty
    - optimiser: adamw or sgd; empty for rows other than the paper's systems
    - part: the part of the split that is judged
    - fr: frames that Culling keeps on each side, None without Culling
    - seed: the training's seed, None for rows other than the paper's systems
    - given: the part of the truth that the method was given, one of ``GIVEN``
    - steps: training steps of all networks together, None without such a training
    - stopped: why a training ended: plateau, steps or time; empty for rows other than the paper's systems
    - n_parameters: number of parameters
    - token_bias: bias of the tokens' logits, 0 without; None for methods without tokens
    - bundle: first digits of the bundle's sha256, None for classical methods
    - corpus: hash of the judged corpus
    - truth: kind of its true positions: partner, word, events, or the source that made them
    - protocol: signature of the protocol
    - metrics_id: ``hash_signatures`` of the metrics
    - n_pairs: number of pairs judged
    - condition: one of ``published.AS_PRINTED`` and ``EQUAL``; empty for rows other than the paper's systems
    - scores: by name, None if there was nothing to count
    - commit: git revision of the code
    - versions: of Python and packages
    - machine: processor and number of cores
    """

    system: str
    split: str
    scale: str = CLASSICAL
    taught: str = ""
    optimiser: str = ""
    part: str = "test"
    fr: int | None = None
    seed: int | None = None
    given: str = "nothing"
    steps: int | None = None
    stopped: str = ""
    n_parameters: int | None = None
    token_bias: float | None = None
    bundle: str | None = None
    corpus: str = ""
    truth: str = ""
    protocol: str = ""
    metrics_id: str = ""
    n_pairs: int = 0
    condition: str = ""
    scores: Mapping[str, float | None] = field(default_factory=dict)
    commit: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    machine: str = ""

    @property
    def key(self) -> tuple[object, ...]:
        """Identifies the row: a row of the same key replaces it."""
        method = (self.system, self.given, self.taught, self.scale, self.optimiser, self.fr, self.seed)
        return (*method, self.split, self.part)

    def score(self, name: str) -> float:
        """Returns a score by name, NaN if it is missing."""
        value = self.scores.get(name)
        return float("nan") if value is None else value


@dataclass(frozen=True)
class Results:
    """The contents of results.json.

    - rows: with distinct keys
    - curves: with distinct keys
    - signatures: the metrics' signatures by name, for every ``metrics_id`` of the rows
    """

    rows: tuple[ResultRow, ...] = ()
    curves: tuple[Curve, ...] = ()
    signatures: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def merge(self, rows: Iterable[ResultRow] = (), curves: Iterable[Curve] = ()) -> Results:
        """Returns these results with rows and curves added; the same key replaces. Signatures that no row names are
        dropped.
        """
        by_key = {row.key: row for row in (*self.rows, *rows)}
        by_curve = {c.key: c for c in (*self.curves, *curves)}
        used_ids = {row.metrics_id for row in by_key.values()}
        known = {**self.signatures, hash_signatures(): SIGNATURES}
        return Results(
            tuple(sorted(by_key.values(), key=lambda row: _make_sort_key(row.key))),
            tuple(sorted(by_curve.values(), key=lambda c: _make_sort_key(c.key))),
            {k: v for k, v in known.items() if k in used_ids},
        )

    def find(self, **values: object) -> list[ResultRow]:
        """Returns the rows whose fields have these values."""
        return [row for row in self.rows if all(getattr(row, k) == v for k, v in values.items())]


def hash_signatures() -> str:
    """Returns a short hash of the current signatures of all scores."""
    text = json.dumps(SIGNATURES, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def check_comparable(rows: Sequence[ResultRow]) -> None:
    """Raises ``InputError`` if rows for one table differ in metrics, protocol or corpus."""
    for field_name in ("metrics_id", "protocol", "corpus"):
        by_value = {getattr(row, field_name): row for row in rows}
        if len(by_value) > 1:
            (a, first), (b, second) = list(by_value.items())[:2]
            raise InputError(
                f"{first.system} and {second.system} cannot be compared in one table: {field_name} {a!r} and {b!r}; "
                "judge both again with `signsplice-paper all`"
            )


def replace_nonfinite(scores: Mapping[str, float]) -> dict[str, float | None]:
    """Returns scores for JSON, with None in place of NaN and infinity."""
    return {name: value if math.isfinite(value) else None for name, value in scores.items()}


def load(path: Path) -> Results:
    """Returns the results in a file, empty without a file. Raises ``InputError`` for a file of another kind."""
    if not path.exists():
        return Results()
    try:
        head = json.loads(read_bytes(path))
        if head["version"] != VERSION:
            raise InputError(f"{path}: version {head['version']}, expected {VERSION}; {_OTHER_VERSION}")
        names = {f.name for f in fields(ResultRow)}
        rows = tuple(ResultRow(**{k: v for k, v in row.items() if k in names}) for row in head["rows"])
        curves = tuple(curve.parse_curve(stored) for stored in head["curves"])
        return Results(rows, curves, head["signatures"])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is no results.json of this project ({error})") from error


def save(results: Results, path: Path) -> None:
    """Writes results atomically, with one row per line."""
    lines = [
        "{",
        f' "version": {VERSION},',
        f' "signatures": {json.dumps(results.signatures, indent=1)},',
        ' "rows": [',
        ",\n".join("  " + json.dumps(asdict(row)) for row in results.rows),
        ' ],\n "curves": [',
        ",\n".join("  " + json.dumps(asdict(c)) for c in results.curves),
        " ]\n}",
    ]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _make_sort_key(key: tuple[object, ...]) -> tuple[str, ...]:
    return tuple("" if part is None else f"{part:09d}" if isinstance(part, int) else str(part) for part in key)
