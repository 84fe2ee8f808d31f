"""Validation curves of whole systems through their own positions, from the snapshots of their parts' weights.

The parts of a system are trained one after another. A point of the curve takes all of them after the same fraction of
their training: SPSN predicts the positions, Culling is done there, and frames are made. The pairs are those that the
training loop validates on, and as many training and test pairs, which decide nothing. The last point is compared with
the exported bundle.
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
from signsplice_paper.metrics import compute_accuracy, compute_mse
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

    def nearest_snapshot(self, fraction: float) -> int:
        """Returns the step of the snapshot nearest to a fraction of the training."""
        return min(self.snapshots, key=lambda step: (abs(step - fraction * self.steps), step))

    def core_minutes(self, step: int) -> float | None:
        """Returns the processor minutes of the first steps, None if they were not logged."""
        logged = records.read_lines(self.folder / records.LOG_FILE)
        lines = [line for line in logged if line["step"] <= step and "cpu_s" in line]
        return lines[-1]["cpu_s"] / 60.0 if lines else None


@dataclass(frozen=True)
class CurveJudge:
    """Measures curves on a corpus.

    - pairs: the corpus
    - parts: the folder that holds a folder for each trained part
    - device: the device on which networks run
    - progress: makes a progress bar
    """

    pairs: Pairs
    parts: Path
    device: torch.device
    progress: ProgressBar

    def write(self, configs: Iterable[PaperConfig], rewrite: bool, warn: Callable[[str], object]) -> Iterator[Path]:
        """Writes the missing curves as curve.json into the bundles' folders, and yields their paths.

        rewrite: whether to replace existing curves. warn: called with one line about bundles without snapshots, and
        about a curve whose end differs from its exported bundle; neither gets a curve.
        """
        skipped: list[str] = []
        for config in configs:
            folder = config.path.parent
            if (config.split, config.corpus) != (SPLIT, self.pairs.head["hash"]):
                continue
            if not rewrite and curve.load(folder, bundles.compute_short_hash(config)) is not None:
                continue
            parts = find_trained_parts(config, self.parts)
            if not parts:
                skipped.append(folder.name)
                continue
            with self.progress(f"curve of {folder.name}") as advance:
                measured = measure(config, self.pairs, parts, self.device, advance)
            exported = score_bundle(config, self.pairs)
            if curve.measure_difference(measured, exported) <= curve.MOST_DIFFERENCE:
                yield curve.save(measured, folder)
                continue
            warn(
                f"{folder}: no curve is kept; it ends at an Accuracy of {measured.column('accuracy')[-1]} on "
                f"{measured.n_pairs} validation pairs, and the exported bundle has {exported:.6f}"
            )
        if skipped:
            warn(f"{self.parts}: no snapshots of {', '.join(skipped)}, which get no curve; they are kept in training")


def find_trained_parts(config: PaperConfig, parts: Path) -> list[TrainedPart]:
    """Returns the parts of a bundle: the folders whose log equals the bundle's. Returns none if a part has no
    snapshots, as of bundles that were made elsewhere.
    """
    config.require("config", "parts")
    trained_parts = []
    for name, facts in config.stored["parts"].items():
        path = config.path.parent / f"{name}.jsonl"
        log = read_bytes(path) if path.is_file() else b""
        folders = [
            path.parent
            for path in sorted(parts.glob(f"{name}-*/{records.LOG_FILE}"))
            if log and read_bytes(path) == log
        ]
        files = [path for folder in folders[:1] for path in (folder / SNAPSHOTS).glob("*.pt") if path.stem.isdecimal()]
        if not files:
            return []
        snapshots = {int(path.stem): path for path in sorted(files)}
        trained_parts.append(TrainedPart(name, folders[0], facts["steps"], facts["batch"], snapshots))
    return trained_parts


def measure(
    config: PaperConfig,
    pairs: Pairs,
    parts: Sequence[TrainedPart],
    device: torch.device,
    progress: Callable[[int, int], None] | None = None,
) -> Curve:
    """Returns the curve of a bundle, with as many points as its part with the fewest snapshots."""
    row = bundles.make_result_row(config)
    numbers = pair_samples.sample_validation(pairs, config.split or "")
    words, truths = _load_words(pairs, numbers), [_load_truth(pairs, number) for number in numbers]
    samples = [pair_samples.sample(pairs, config.split or "", part, len(numbers)) for part in ("train", "test")]
    tasks = [_make_task(config, part, pairs).to(device).eval() for part in parts]
    bias = 0.0 if config.runs is None else config.runs.token_bias
    system = BatchPredictor([task.network for task in tasks], config.fr, bias)
    shortest = min(parts, key=lambda part: len(part.snapshots))
    points: list[tuple[float | None, ...]] = []
    for n_done, step in enumerate(shortest.snapshots, 1):
        steps = [part.nearest_snapshot(step / shortest.steps) for part in parts]
        for task, part, part_step in zip(tasks, parts, steps, strict=True):
            _load_weights(task, part.snapshots[part_step])
        minutes = [part.core_minutes(part_step) for part, part_step in zip(parts, steps, strict=True)]
        n_pairs_seen = float(sum(part.batch * part_step for part, part_step in zip(parts, steps, strict=True)))
        core_minutes = None if None in minutes else round(sum(value for value in minutes if value is not None), 4)
        scores = (
            *_score_frames(system.predict(words), truths),
            *(_score_positions(system, pairs, sample) for sample in samples),
        )
        points.append((n_pairs_seen, core_minutes, *(round(score, 6) for score in scores)))
        if progress is not None:
            progress(n_done, len(shortest.snapshots))
    return Curve(
        row.system, config.split or "", row.scale, row.optimiser, row.fr, row.seed,
        points, curve.COLUMNS, row.bundle or "", row.corpus, len(numbers),
    )  # fmt: skip


def score_bundle(config: PaperConfig, pairs: Pairs) -> float:
    """Returns the Accuracy of the exported bundle on the curve's pairs."""
    answer = protocol.make_answer(pairs, open_bundle(config.path.parent))
    return protocol.compute_accuracy(answer, pairs, pair_samples.sample_validation(pairs, config.split or ""))


def _score_frames(predictions: Sequence[Prediction], truths: Sequence[np.ndarray[Any, Any]]) -> tuple[float, float]:
    """Returns Accuracy (eq. 19) and MSE (eq. 21)."""
    frame_pairs = list(zip(predictions, truths, strict=True))
    return (
        float(np.mean([compute_accuracy(prediction.frames, true) for prediction, true in frame_pairs])),
        float(np.mean([compute_mse(prediction.frames, true) for prediction, true in frame_pairs])),
    )


def _score_positions(system: BatchPredictor, pairs: Pairs, numbers: Sequence[int]) -> float:
    """Returns the fraction of pairs with both positions exact."""
    predicted = system.predict_positions(_load_words(pairs, numbers))
    truths = pairs.index[list(numbers), 2:4].tolist()
    return float(np.mean([list(positions) == truth for positions, truth in zip(predicted, truths, strict=True)]))


def _load_words(pairs: Pairs, numbers: Sequence[int]) -> list[Words]:
    words = {
        word: np.array(pairs.word(word), np.float32) for word in set(pairs.index[list(numbers), :2].ravel().tolist())
    }
    return [(words[p], words[q]) for p, q in pairs.index[list(numbers), :2].tolist()]


def _load_truth(pairs: Pairs, number: int) -> np.ndarray[Any, Any]:
    return np.asarray(pairs.truth(number)[2], np.float64)


def _make_task(config: PaperConfig, part: TrainedPart, pairs: Pairs) -> Task:
    """Returns a part with the sizes that the bundle states, before its weights are set."""
    scale, system = config.scale or "", config.system or ""
    part_by_name = {
        candidate.name: candidate
        for candidate in scales.make_parts(system, scale, config.fr, 0, config.optimiser or "", config.split or "")
    }
    scale_part = part_by_name[part.name]
    field_names = {field.name for field in fields(scale_part.config)}  # bundles of earlier versions state more
    stored = config.stored["config"][part.name]
    sizes = type(scale_part.config)(**{name: value for name, value in stored.items() if name in field_names})
    system_part = scales.SystemPart(part.name, sizes, scale_part.fr, part.steps, part.batch, scale_part.rate)
    n_numbers = len(config.stored["normaliser"]["mean"])
    identity = Normaliser(torch.zeros(n_numbers), torch.ones(n_numbers))
    return scales.make_task(system_part, identity, config.seed or 0)


def _load_weights(task: Task, path: Path) -> None:
    """Sets a task to a snapshot's weights. Raises ``InputError`` if the file is broken or of another network."""
    try:
        task.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
    except Exception as error:  # a damaged file may raise anything
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: cannot be read as weights ({reason}); no curve is made") from error
