"""Training of the two shipped networks, from synthetic signing to a bundle.

One network cuts and times, the other makes transitions. Each is trained alone, in a folder of its own in ``parts``
beside the bundle, and exported into the bundle at the end; a bundle may hold one or both. The folder's name ends
in a hash of everything that the training depends on, the content of its data included, so that the same call continues
an interrupted training and no other.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import onnx
import torch

from signsplice.errors import InputError
from signsplice.formats import atomic
from signsplice.rig.info import FEATURE_FPS
from signsplice.splicing import features
from signsplice.splicing.learned import SYSTEM
from signsplice.splicing.runtime import onnxruntime
from signsplice_workshop.train import records, warm_start
from signsplice_workshop.train.bundles import write_bundle
from signsplice_workshop.train.cut_data import CutDataset
from signsplice_workshop.train.export import check_bundle_folder, export_product_graphs
from signsplice_workshop.train.gap_data import GapDataset
from signsplice_workshop.train.loop import LoopConfig, ProgressCallback, train
from signsplice_workshop.train.networks import Bridge, BridgeConfig, Cutting, CuttingConfig
from signsplice_workshop.train.prefetch import Dataset, group_by_folder, open_signer_file, prefetch_batches
from signsplice_workshop.train.processes import Processes, lock_folder
from signsplice_workshop.train.tasks import BridgeTask, CuttingTask, Task
from signsplice_workshop.train.warm_start import WarmStart

FILES = {"cutter": ("word.onnx", "cut.onnx"), "transition": ("bridge.onnx",)}
NETWORKS = tuple(FILES)
HELD_BACK = 0.1
"""Fraction of the signers of each folder, at least one, that are kept for validation."""
_STATISTICS_BATCHES = 8
"""Number of batches from which the mean and the deviation of a network's inputs are computed."""
_CONTINUED_SCALES = ("more", "corpus")
"""Scales that need an earlier training to start from."""
_MIN_DEVIATION = 0.1
"""Inputs that hardly vary in synthetic signing may vary much in a capture, and must not become huge there."""


@dataclass(frozen=True)
class TrainingSchedule:
    """A network's sizes and how long it is trained.

    - config: sizes
    - steps: number of steps
    - batch: draws in a batch
    - rate: highest learning rate
    - n_judged: validation draws
    - clean: whether the data are used without augmentation
    - n_checks: how often it is validated, and its checkpoint kept, on the way
    """

    config: CuttingConfig | BridgeConfig
    steps: int
    batch: int
    rate: float
    n_judged: int
    clean: bool = False
    n_checks: int = 40


SCHEDULES: dict[tuple[str, str], TrainingSchedule] = {
    ("cutter", "smoke"): TrainingSchedule(CuttingConfig(32, 2, 2, 64, 2, 8, 16), 40, 1, 3e-3, 2),
    ("cutter", "ship"): TrainingSchedule(CuttingConfig(), 14_000, 2, 1e-3, 24),
    ("cutter", "more"): TrainingSchedule(CuttingConfig(), 2_000, 2, 5e-4, 24),
    ("cutter", "corpus"): TrainingSchedule(CuttingConfig(), 8_000, 2, 5e-4, 24, clean=True),
    ("transition", "smoke"): TrainingSchedule(BridgeConfig(32, 2, 2, 64), 20, 4, 3e-3, 8),
    ("transition", "ship"): TrainingSchedule(BridgeConfig(), 8_000, 32, 1e-3, 512),
    ("transition", "more"): TrainingSchedule(BridgeConfig(), 4_000, 32, 5e-4, 512),
    ("transition", "corpus"): TrainingSchedule(BridgeConfig(), 4_000, 32, 5e-4, 512, clean=True),
}
"""Each network at each scale. ``more`` continues an earlier training; ``corpus`` continues one on a corpus of pairs,
whose words and transitions it uses without augmentation.
"""


@dataclass(frozen=True)
class ProductTraining:
    """What to train; its fields are stored in bundle.json.

    - network: one of ``NETWORKS``
    - scale: one of the scales of ``SCHEDULES``
    - seed: of weights, batches and dropout
    - steps, batch: number of steps and draws in a batch, None: the scale's
    - begins_with: recipe of the earlier training that it starts from
    """

    network: str
    scale: str = "ship"
    seed: int = 0
    steps: int | None = None
    begins_with: str | None = None
    batch: int | None = None

    @property
    def schedule(self) -> TrainingSchedule:
        """Returns sizes and length of the training. Raises ``InputError`` for an unknown network or scale."""
        if (self.network, self.scale) not in SCHEDULES:
            raise InputError(
                f"no network {self.network!r} at scale {self.scale!r}, expected one of {', '.join(NETWORKS)} at "
                f"{' or '.join(dict.fromkeys(scale for _, scale in SCHEDULES))}"
            )
        schedule = SCHEDULES[self.network, self.scale]
        return schedule if self.batch is None else replace(schedule, batch=self.batch)

    @property
    def n_steps(self) -> int:
        """Returns the number of steps."""
        return self.schedule.steps if self.steps is None else self.steps


def split(*folders: Path) -> tuple[list[Path], list[Path]]:
    """Returns signers' files to train on and to validate on; the last signers of each folder are held back for
    validation.

    Raises ``InputError`` if a folder has fewer than two signers.
    """
    train_paths: list[Path] = []
    held_back: list[Path] = []
    for folder in folders:
        paths = sorted(folder.glob("signer-*.npz"))
        if len(paths) < 2:
            raise InputError(
                f"{folder}: {len(paths)} signers, expected at least 2; `signsplice synth endless` makes them"
            )
        n_held = max(1, round(HELD_BACK * len(paths)))
        train_paths += paths[:-n_held]
        held_back += paths[-n_held:]
    return train_paths, held_back


def make(
    training: ProductTraining,
    signing: Sequence[Path],
    bundle: Path,
    processes: Processes,
    report_progress: ProgressCallback | None = None,
    start_from: Path | None = None,
) -> None:
    """Trains a network on folders of synthetic signing and writes it into the folder ``bundle``.

    The same call after an interruption continues from the last checkpoint. ``start_from``: folder of a training with a
    checkpoint, or a bundle, to start from. Raises ``InputError`` if it does not hold this network, or if the scale
    needs one and there is none.
    """
    if start_from is None and training.scale in _CONTINUED_SCALES:
        raise InputError(f"scale {training.scale} continues an earlier training: name its folder")
    train_paths, held_back = split(*signing)
    files = FILES[training.network]
    earlier = None if start_from is None else warm_start.find_warm_start(start_from, training.network, files)
    if earlier is not None:
        training = replace(training, begins_with=earlier.recipe)
    hashes = {path: records.hash_file(path) for path in (*train_paths, *held_back)}
    data_hashes = [
        [[hashes[path] for path in folder] for folder in group_by_folder(paths)] for paths in (train_paths, held_back)
    ]
    recipe = _hash_recipe(training, data_hashes, earlier)
    folder = bundle.parent / "parts" / f"{training.network}-{training.scale}-seed{training.seed}-{recipe}"
    trained_on = _find_training_corpus(train_paths, earlier)
    provenance = _describe_provenance(training, signing, hashes, processes, earlier)
    folder.mkdir(parents=True, exist_ok=True)
    if processes.first:
        records.write_json(folder / warm_start.PROVENANCE_FILE, provenance)
        if trained_on is not None:
            records.write_json(folder / warm_start.CORPUS_FILE, trained_on)
    check_bundle_folder(bundle)
    warm_start.load_network_entries(bundle)  # raises an error now instead of after the training
    task, valid = _train_network(training, train_paths, held_back, earlier, folder, recipe, processes, report_progress)
    if processes.first:
        for name, content in export_product_graphs(task, valid).items():
            atomic.write(folder / name, content)
        facts = {
            **asdict(training),
            **provenance,
            **({} if trained_on is None else {"taught": trained_on}),
            "config": asdict(training.schedule.config),
            "steps": training.n_steps,
            "batch": training.schedule.batch,
            "recipe": recipe,
            "n_parameters": sum(parameter.numel() for parameter in task.network.parameters()),
            "signers": [path.stem for path in train_paths],
            "held_back": [path.stem for path in held_back],
            "scores": _read_last_scores(folder),
        }
        records.write_json(folder / "facts.json", facts)
        assemble(bundle, {training.network: folder})


def _train_network(
    training: ProductTraining,
    train_paths: Sequence[Path],
    held_back: Sequence[Path],
    earlier: WarmStart | None,
    folder: Path,
    recipe: str,
    processes: Processes,
    report_progress: ProgressCallback | None,
) -> tuple[Task, Dataset]:
    """Returns the trained network's task, and the validation data."""
    schedule = training.schedule
    data, valid = open_dataset(training, train_paths), open_dataset(training, held_back, schedule.n_judged)
    torch.manual_seed(training.seed)
    task = build(training, data)
    if earlier is not None:
        earlier.load_into(task)
    loop = LoopConfig(
        training.n_steps, schedule.batch, schedule.rate, training.seed,
        max(1, training.n_steps // schedule.n_checks), schedule.n_judged, bf16=processes.device.type == "cuda",
    )  # fmt: skip
    with (
        lock_folder(folder, processes),
        prefetch_batches(data, processes.rank, processes.count) as batches,
    ):
        train(task, loop, batches, valid, folder, recipe, processes, report_progress)
    return task, valid


def assemble(bundle: Path, folders: dict[str, Path]) -> None:
    """Writes the networks in ``folders``, by name, into a bundle; its other networks stay."""
    networks = warm_start.load_network_entries(bundle)
    sources = {name: folders.get(name, bundle) for name in (*networks, *folders)}
    networks |= {name: json.loads((folder / "facts.json").read_text()) for name, folder in folders.items()}
    files = {file: (folder / file).read_bytes() for name, folder in sources.items() for file in FILES[name]}
    facts = {
        "system": SYSTEM,
        "features": features.VERSION,
        "rate": FEATURE_FPS,
        "networks": {name: networks[name] for name in NETWORKS if name in networks},
        "versions": {"torch": torch.__version__, "onnx": onnx.__version__, "onnxruntime": onnxruntime.__version__},
    }
    write_bundle(bundle, facts, files)


def build(training: ProductTraining, data: Dataset) -> Task:
    """Returns a network's task with random weights; it standardises its inputs by the statistics of the first
    batches.
    """
    schedule = training.schedule
    steps = range(_STATISTICS_BATCHES)
    batches = [data.batch(data.rows(step, schedule.batch, training.seed), step) for step in steps]
    has_words = isinstance(schedule.config, CuttingConfig)
    tokens = torch.cat([batch.tokens[batch.mask] if has_words else batch.tokens.flatten(0, 1) for batch in batches])
    statistics = tokens.mean(0), tokens.std(0).clamp(min=_MIN_DEVIATION)
    if isinstance(schedule.config, CuttingConfig):
        return CuttingTask(Cutting(schedule.config, *statistics))
    assert isinstance(data, GapDataset)
    return BridgeTask(Bridge(schedule.config, *statistics), data.role_parents.tolist())


def open_dataset(training: ProductTraining, paths: Sequence[Path], n_fixed: int | None = None) -> Dataset:
    """Returns the data of a network from signers' files; ``n_fixed`` draws for validation, None: to train on."""
    kind = GapDataset if training.network == "transition" else CutDataset
    return kind(paths, training.seed, n_fixed, training.schedule.clean)


def _hash_recipe(training: ProductTraining, data_hashes: list[list[list[str]]], earlier: WarmStart | None) -> str:
    """Returns twelve hex digits that change with everything that a training depends on, except for the code.

    ``data_hashes``: sha256 of the signers' files by folder, to train on and held back. Names of files do not count.
    """
    schedule = training.schedule
    recipe = {
        **{name: value for name, value in asdict(training).items() if name != "steps"},
        "n_steps": training.n_steps,
        "config": asdict(schedule.config),
        "batch": schedule.batch,
        "rate": schedule.rate,
        "clean": schedule.clean,
        "features": features.VERSION,
        "data": data_hashes,
        "start_steps": [] if earlier is None else [earlier.provenance.get("step")],
    }
    return hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()[:12]


def _describe_provenance(
    training: ProductTraining,
    signing: Sequence[Path],
    hashes: dict[Path, str],
    processes: Processes,
    earlier: WarmStart | None,
) -> dict[str, Any]:
    """Returns the command, the seed, the sha256 of the data, and the start of the training.

    Data are named by file; with several folders of signing, by the folder's number in the command, from 1, and file.
    """
    options: dict[str, records.Option] = {
        "signing": signing, "from": None if earlier is None else earlier.folder, "scale": training.scale,
        "steps": training.steps, "batch": training.batch, "seed": training.seed, "device": processes.device.type,
    }  # fmt: skip
    has_several_folders = len(signing) > 1
    data = {
        f"{number}/{path.name}" if has_several_folders else path.name: hashes[path]
        for number, folder in enumerate(signing, 1)
        for path in sorted(hashes)
        if path.parent == folder
    }
    return {
        "command": records.format_command(["train", training.network], options),
        "seed": training.seed,
        "data": data,
        "signsplice": records.find_version(),
        **({} if (commit := records.find_commit()) is None else {"commit": commit}),
        **({} if earlier is None else {"started_from": [earlier.provenance]}),
    }


def _read_last_scores(folder: Path) -> dict[str, float]:
    """Returns the last validation scores in a training's log."""
    judged = [line for line in records.read_lines(folder / records.LOG_FILE) if "loss" not in line]
    return {k: v for k, v in judged[-1].items() if k != "step"} if judged else {}


def _find_training_corpus(paths: Sequence[Path], earlier: WarmStart | None) -> dict[str, str] | None:
    """Returns the corpus of pairs and its split from which signers' files, or the training to start from, come; None if
    none does. Raises ``InputError`` for two, because only what was not trained on can be used for testing.
    """
    splits = set() if earlier is None or earlier.trained_on is None else {tuple(earlier.trained_on.values())}
    for path in paths:
        with open_signer_file(path) as stored:
            if "corpus" in stored:
                splits.add((str(stored["corpus"]), str(stored["split"])))
    if len(splits) > 1:
        raise InputError(f"signing of {len(splits)} splits of corpora of pairs, expected one: tests must stay unseen")
    return dict(zip(("corpus", "split"), *splits, strict=True)) if splits else None
