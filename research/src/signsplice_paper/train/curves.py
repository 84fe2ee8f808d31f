"""Validation curves of whole systems through their own positions, from the snapshots of their parts' weights.

The parts of a system are trained one after another. A point of the curve takes all of them after the same fraction of
their training: the positions are those that SPSN finds then, Culling is done there, and frames are made. The pairs are
those that the training loop validates on, and as many of those that taught, and of the test, which decide nothing. The
last point is compared with the exported bundle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch

from signsplice.errors import InputError
from signsplice.formats.reading import read_bytes
from signsplice_paper import bundles, curve, pair_samples, protocol
from signsplice_paper.configs import PaperConfig
from signsplice_paper.curve import Curve
from signsplice_paper.judging import ProgressBar
from signsplice_paper.metrics import accuracy, pair_mse
from signsplice_paper.prediction import Prediction
from signsplice_paper.systems import open_bundle
from signsplice_paper.train import scales
from signsplice_paper.train.batch_prediction import BatchPredictor, Words
from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.stopping import SNAPSHOTS
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.train import records
from signsplice_workshop.train.tasks import Task

SPLIT = "random"
"""The split whose curves are drawn."""


@dataclass(frozen=True)
class TrainedPart:
    """A part of a bundle, and the folder of its training.

    - name: name of the part
    - folder: its checkpoint, log and snapshots
    - steps: training steps
    - batch: pairs in a batch
    - snapshots: step -> file of weights
    """

    name: str
    folder: Path
    steps: int
    batch: int
    snapshots: Mapping[int, Path]

    def after(self, fraction: float) -> int:
        """The step of the snapshot nearest to a fraction of the training."""
        return min(self.snapshots, key=lambda step: (abs(step - fraction * self.steps), step))

    def core_minutes(self, step: int) -> float | None:
        """Processor minutes of the first steps, None where they were not logged."""
        logged = records.lines(self.folder / records.LOG_FILE)
        lines = [line for line in logged if line["step"] <= step and "cpu_s" in line]
        return lines[-1]["cpu_s"] / 60.0 if lines else None


@dataclass(frozen=True)
class CurveJudge:
    """What curves are judged on.

    - pairs: the corpus
    - parts: the folder that holds a folder for each trained part
    - device: where networks run
    - progress: makes a progress bar
    """

    pairs: Pairs
    parts: Path
    device: torch.device
    progress: ProgressBar

    def write(self, configs: Iterable[PaperConfig], again: bool, warn: Callable[[str], object]) -> Iterator[Path]:
        """Make the curves that are drawn and not there yet, as curve.json in the bundles' folders; their paths.

        again: make those that are there again. warn: is told, in one line each, of bundles without snapshots, and of a
        curve that does not end where its exported bundle is; neither gets a curve.
        """
        without: list[str] = []
        for config in configs:
            folder = config.path.parent
            if (config.split, config.corpus) != (SPLIT, self.pairs.head["hash"]):
                continue
            if not again and curve.load(folder, bundles.short_hash(config)) is not None:
                continue
            parts = find_trained_parts(config, self.parts)
            if not parts:
                without.append(folder.name)
                continue
            with self.progress(f"curve of {folder.name}") as advance:
                made = measure(config, self.pairs, parts, self.device, advance)
            exported = score_bundle(config, self.pairs)
            if curve.difference(made, exported) <= curve.MOST_DIFFERENCE:
                yield curve.save(made, folder)
                continue
            warn(
                f"{folder}: no curve is kept; it ends at an Accuracy of {made.column('accuracy')[-1]} on "
                f"{made.n_pairs} validation pairs, and the exported bundle has {exported:.6f}"
            )
        if without:
            warn(f"{self.parts}: no snapshots of {', '.join(without)}, which get no curve; they are kept in training")


def find_trained_parts(config: PaperConfig, parts: Path) -> list[TrainedPart]:
    """The parts of a bundle: the folders whose log is the one that the bundle holds; none where one has no snapshots,
    as of bundles that were made elsewhere.
    """
    config.require("config", "parts")
    found = []
    for name, facts in config.stored["parts"].items():
        path = config.path.parent / f"{name}.jsonl"
        log = read_bytes(path) if path.is_file() else b""
        same = [
            path.parent
            for path in sorted(parts.glob(f"{name}-*/{records.LOG_FILE}"))
            if log and read_bytes(path) == log
        ]
        files = [path for folder in same[:1] for path in (folder / SNAPSHOTS).glob("*.pt") if path.stem.isdecimal()]
        if not files:
            return []
        snapshots = {int(path.stem): path for path in sorted(files)}
        found.append(TrainedPart(name, same[0], facts["steps"], facts["batch"], snapshots))
    return found


def measure(
    config: PaperConfig,
    pairs: Pairs,
    parts: Sequence[TrainedPart],
    device: torch.device,
    progress: Callable[[int, int], None] | None = None,
) -> Curve:
    """The curve of a bundle, with as many points as its part with the fewest snapshots."""
    row = bundles.result_row(config)
    numbers = pair_samples.validation(pairs, config.split or "")
    words, truths = _words(pairs, numbers), [_truth(pairs, number) for number in numbers]
    samples = [pair_samples.sample(pairs, config.split or "", part, len(numbers)) for part in ("train", "test")]
    tasks = [_task(config, part, pairs).to(device).eval() for part in parts]
    bias = 0.0 if config.runs is None else config.runs.token_bias
    system = BatchPredictor([task.network for task in tasks], config.fr, bias)
    fewest = min(parts, key=lambda part: len(part.snapshots))
    points: list[tuple[float | None, ...]] = []
    for done, step in enumerate(fewest.snapshots, 1):
        steps = [part.after(step / fewest.steps) for part in parts]
        for task, part, at in zip(tasks, parts, steps, strict=True):
            _load(task, part.snapshots[at])
        minutes = [part.core_minutes(at) for part, at in zip(parts, steps, strict=True)]
        seen = float(sum(part.batch * at for part, at in zip(parts, steps, strict=True)))
        spent = None if None in minutes else round(sum(m for m in minutes if m is not None), 4)
        scores = (*_scores(system.predict(words), truths), *(_exact(system, pairs, sample) for sample in samples))
        points.append((seen, spent, *(round(score, 6) for score in scores)))
        if progress is not None:
            progress(done, len(fewest.snapshots))
    return Curve(
        row.system, config.split or "", row.scale, row.optimiser, row.fr, row.seed,
        points, curve.COLUMNS, row.bundle or "", row.corpus, len(numbers),
    )  # fmt: skip


def score_bundle(config: PaperConfig, pairs: Pairs) -> float:
    """The Accuracy of the exported bundle on the curve's pairs."""
    answer = protocol.answers(pairs, open_bundle(config.path.parent))
    return protocol.accuracy(answer, pairs, pair_samples.validation(pairs, config.split or ""))


def _scores(predictions: Sequence[Prediction], truths: Sequence[np.ndarray[Any, Any]]) -> tuple[float, float]:
    """Accuracy (eq. 19) and MSE (eq. 21)."""
    both = list(zip(predictions, truths, strict=True))
    return (
        float(np.mean([accuracy(made.frames, true) for made, true in both])),
        float(np.mean([pair_mse(made.frames, true) for made, true in both])),
    )


def _exact(system: BatchPredictor, pairs: Pairs, numbers: Sequence[int]) -> float:
    """The share of pairs whose positions are both exact."""
    found = system.positions(_words(pairs, numbers))
    true = pairs.index[list(numbers), 2:4].tolist()
    return float(np.mean([list(one) == both for one, both in zip(found, true, strict=True)]))


def _words(pairs: Pairs, numbers: Sequence[int]) -> list[Words]:
    words = {
        word: np.array(pairs.word(word), np.float32) for word in set(pairs.index[list(numbers), :2].ravel().tolist())
    }
    return [(words[p], words[q]) for p, q in pairs.index[list(numbers), :2].tolist()]


def _truth(pairs: Pairs, number: int) -> np.ndarray[Any, Any]:
    return np.asarray(pairs.truth(number)[2], np.float64)


def _task(config: PaperConfig, part: TrainedPart, pairs: Pairs) -> Task:
    """A part with the sizes that the bundle states, its weights not yet set."""
    scale, system = config.scale or "", config.system or ""
    known = {p.name: p for p in scales.parts(system, scale, config.fr, 0, config.optimiser or "", config.split or "")}
    like = known[part.name]
    named = {field.name for field in fields(like.config)}  # bundles of earlier versions state more
    stored = config.stored["config"][part.name]
    sizes = type(like.config)(**{name: value for name, value in stored.items() if name in named})
    made = scales.SystemPart(part.name, sizes, like.fr, part.steps, part.batch, like.rate)
    n_numbers = len(config.stored["normaliser"]["mean"])
    blank = Normaliser(torch.zeros(n_numbers), torch.ones(n_numbers))
    return scales.task(made, blank, config.seed or 0)


def _load(task: Task, path: Path) -> None:
    """Set a task to a snapshot's weights. Raises ``InputError`` where the file is broken or of another network."""
    try:
        task.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
    except Exception as error:  # a damaged file may raise anything
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: cannot be read as weights ({reason}); no curve is made") from error
