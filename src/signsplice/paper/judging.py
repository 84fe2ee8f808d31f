"""Rows of results: every bundle of a folder and every method on clips, judged on every split that allows it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from signsplice.errors import InputError
from signsplice.formats.atomic import read_bytes
from signsplice.paper import clip_methods, kept_frames, protocol, published, results
from signsplice.paper.clip_methods import ClipAnswers, ClipMethod
from signsplice.paper.protocol import Answer, Protocol
from signsplice.paper.results import CLASSICAL, OWN, TAUGHT, Curve, ResultRow, Results
from signsplice.splicing.learned import SYSTEM
from signsplice.synth.corpus import Pairs

Advance = Callable[[str], AbstractContextManager[Callable[[int, int], None] | None]]
Opener = Callable[[Path, str], Any]
"""A bundle's folder and how its frames are to be decoded -> the system."""

RESULTS, SHOTS = "results.json", "frames.npz"


@dataclass(frozen=True)
class Judgement:
    """What one call adds: rows and curves, and the frames for the pictures."""

    rows: tuple[ResultRow, ...]
    curves: tuple[Curve, ...]
    shots: tuple[kept_frames.KeptFrames, ...]


def facts(folder: Path) -> dict[str, Any]:
    """What a bundle says of itself. Raises ``InputError`` where it is none."""
    try:
        told = json.loads(read_bytes(folder / "bundle.json"))
    except ValueError as error:
        raise InputError(f"{folder / 'bundle.json'}: is no JSON ({error})") from error
    if not isinstance(told, dict):
        raise InputError(f"{folder / 'bundle.json'}: expected an object")
    return told


def find_bundles(bundles: Path, scale: str) -> list[Path]:
    """Folders of bundles of a scale, by name."""
    if not bundles.is_dir():
        return []
    return [path.parent for path in sorted(bundles.glob("*/bundle.json")) if facts(path.parent).get("scale") == scale]


def corpus_trained_methods(bundles: Path, warn: Callable[[str], object]) -> list[ClipMethod]:
    """Rows of this project's networks in a folder of bundles, those that learned from a corpus of pairs. A bundle that
    cannot be judged, or the second of a split, is passed over with a line to ``warn``.
    """
    made: dict[tuple[str, ...], list[ClipMethod]] = {}
    for path in sorted(bundles.glob("*/bundle.json")) if bundles.is_dir() else []:
        told = facts(path.parent)
        networks = told.get("networks", {}) if told.get("system") == SYSTEM else {}
        if not any("taught" in network for network in networks.values()):
            continue
        try:
            methods = clip_methods.product_methods(path.parent)
            known = tuple((methods[0].taught or {}).values())
            if known in made:
                raise InputError(f"{path.parent}: taught {' '.join(known)} as another bundle is; move one away")
            made[known] = methods
        except InputError as error:
            warn(f"not judged: {error}")
    return [method for methods in made.values() for method in methods]


def splits(pairs: Pairs, limit: int | None = None) -> list[Protocol]:
    """The test part of every split that has a pair in it."""
    return [protocol.choose(pairs, split, limit=limit) for split in protocol.SPLITS if pairs.split(split, "test")]


def everything(
    pairs: Pairs,
    bundles: Sequence[Path],
    known: Results,
    kept: Sequence[kept_frames.KeptFrames],
    progress: Advance,
    opener: Opener | None = None,
    limit: int | None = None,
    again: bool = False,
    methods: Iterable[ClipMethod] | None = None,
) -> Iterator[Judgement]:
    """Judge methods on clips and bundles, a judgement for each; what ``known`` has already of the same bundle,
    protocol and measures is passed over unless ``again``.

    progress: makes a progress bar by name. opener: the project's own by default.
    """
    protocols = splits(pairs, limit)
    chosen = kept_frames.merge(kept, kept_frames.choose(pairs, protocols[0])) if protocols else []
    for method in clip_methods.all_clip_methods() if methods is None else methods:
        answer, taught = ClipAnswers(pairs, method), method.taught
        allowed = [p for p in protocols if taught is None or protocol.may_judge(taught, pairs, p)]
        scale, sha256 = (
            (OWN if taught is None else TAUGHT) if method.learned else CLASSICAL,
            method.parts.bundle,
        )
        row = ResultRow(method.name, "", scale, given=method.given, bundle=sha256 and sha256[:12])
        shown = taught is None and (method.name, method.given) in kept_frames.SHOWN_METHODS
        name = kept_frames.label(method.name, scale, "", method.given) if shown else ""
        rows, chosen = _judge(row, name, answer, allowed, pairs, known, chosen, progress, again, answer.prepare)
        yield Judgement(tuple(rows), (), tuple(chosen))
    for folder in bundles:
        told = facts(folder)
        allowed = [p for p in protocols if protocol.may_judge(told, pairs, p)]
        if not allowed:
            protocol.refuse(told, pairs, protocols[0], folder.name)
        row = ResultRow(split="", **results.bundle_row(told, folder))
        best = row.fr in (None, published.BEST_FR)
        name = kept_frames.label(row.system, row.scale, row.optimiser) if best else ""
        rows, chosen = _judge(
            row, name, _LazySystem(folder, pairs, opener), allowed, pairs, known, chosen, progress, again
        )
        if best and row.system in published.IN_ONE_PASS:
            once, answer_of = (
                replace(row, system=published.IN_ONE_PASS[row.system]),
                _LazySystem(folder, pairs, opener, True),
            )
            rows += _judge(once, "", answer_of, allowed, pairs, known, chosen, progress, again)[0]
        curve = read_curve(folder, told, row)
        yield Judgement(tuple(rows), () if curve is None else (curve,), tuple(chosen))


class _LazySystem:
    """A bundle's answers; it is opened when the first pair comes."""

    def __init__(self, folder: Path, pairs: Pairs, opener: Opener | None, one_pass: bool = False) -> None:
        self.folder, self.pairs, self.opener = folder, pairs, opener
        self.decoding = "parallel" if one_pass else "one-by-one"
        self._answer: Answer | None = None

    def __call__(self, number: int) -> Any:
        if self._answer is None:
            opener = self.opener
            if opener is None:
                from signsplice.paper.systems import open_bundle

                opener = open_bundle
            self._answer = protocol.answers(self.pairs, opener(self.folder, self.decoding))
        return self._answer(number)


def _judge(
    like: ResultRow,
    name: str,
    answer: Answer,
    protocols: Sequence[Protocol],
    pairs: Pairs,
    known: Results,
    kept: list[kept_frames.KeptFrames],
    progress: Advance,
    again: bool,
    prepare: Callable[[Sequence[int]], None] | None = None,
) -> tuple[list[ResultRow], list[kept_frames.KeptFrames]]:
    """Rows of one answerer on some protocols, and the shots with its frames where the random split is among them."""
    rows = []
    around = results.surroundings()
    for p in protocols:
        row = replace(like, split=p.split, part=p.part, corpus=p.corpus, protocol=p.signature, **around)
        old = next((r for r in known.rows if r.key == row.key), None)
        if old is not None and not again and _same(old, row) and all(not name or name in s.made for s in kept):
            continue
        if prepare is not None:
            prepare(p.numbers)
        with progress(f"{like.system}, {p.split}") as advance:
            judged = protocol.judge(answer, pairs, p, advance)
        rows.append(replace(row, scores=results.finite(judged.scores), n_pairs=judged.n_pairs))
        if p.split == "random" and name:
            kept = kept_frames.shown(kept, name, answer)
    return rows, kept


def _same(old: ResultRow, new: ResultRow) -> bool:
    return (old.bundle, old.protocol, old.measures) == (new.bundle, new.protocol, new.measures)


def read_curve(folder: Path, told: Mapping[str, Any], row: ResultRow) -> Curve | None:
    """Validation accuracy by step from the training log beside a bundle (JSON lines with ``step`` and ``accuracy``);
    None where there is none.
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
    split = str(told.get("split", ""))
    return Curve(row.system, split, row.scale, row.optimiser, row.fr, row.seed, results.thinned(sorted(points)))
