"""A system from a corpus of pairs to a bundle: its parts trained or found trained, exported, and put together."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import onnx
import onnxruntime
import torch

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.splicing.bundle import write_bundle
from signsplice.synth.corpus import Pairs
from signsplice.synth.signer import skeleton
from signsplice.train import checkpoint
from signsplice.train import log as logs
from signsplice.train.export import check_bundle_folder, paper_graphs
from signsplice.train.loop import SGD_RATE, LoopConfig, ProgressCallback, train
from signsplice.train.paper.networks.generator import Generator
from signsplice.train.paper.pairs_data import PairsData
from signsplice.train.paper.scales import SystemPart, parts, task
from signsplice.train.paper.tasks import MOST_FRAMES, token_bias
from signsplice.train.processes import Processes, only_one
from signsplice.train.task import Task

_TRAINED_AS = {"unseen-signer": "random"}
"""Splits whose training part is another's."""


@dataclass(frozen=True)
class Training:
    """What to train and how.

    ``n_judged`` validation pairs are judged ``n_judgements`` times, None: 4 at smoke scale, else 20. ``bf16``, None:
    on GPUs.
    """

    system: str
    scale: str
    optimiser: str = "adamw"
    split: str = "random"
    seed: int = 0
    fr: int | None = None
    steps: int | None = None
    bf16: bool | None = None
    n_judgements: int | None = None
    n_judged: int = 256


def make(
    training: Training,
    pairs: Pairs,
    out: Path,
    shared: Path,
    processes: Processes,
    tell: Callable[[str], ProgressCallback] | None = None,
) -> None:
    """Train what is not trained yet, and write the bundle into ``out``.

    Checkpoints lie in ``shared``, a folder a part, where other systems with the same parts find them. The same call
    after an interruption goes on from the last one. ``tell``: part's name -> who is told of its progress.
    """
    chosen = parts(training.system, training.scale, training.fr, training.steps, training.optimiser, training.split)
    check_bundle_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    tasks = []
    for part in chosen:
        folder = part_folder(shared, part, training, pairs)
        folder.mkdir(parents=True, exist_ok=True)
        with only_one(folder) if processes.first else nullcontext():
            told = None if tell is None else tell(part.name)
            tasks.append(trained(part, training, pairs, folder, processes, told))
    if processes.first:
        _write(training, pairs, chosen, tasks, out, [part_folder(shared, part, training, pairs) for part in chosen])


def recipe(part: SystemPart, training: Training, pairs: Pairs) -> str:
    """Twelve hex digits that change with everything that a trained part is told; not with the code that makes it."""
    told = {
        "part": part.name,
        **part.facts(),
        "optimiser": training.optimiser,
        "split": _TRAINED_AS.get(training.split, training.split),
        "seed": training.seed,
        "corpus": pairs.head["hash"],
    }
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]


def part_folder(shared: Path, part: SystemPart, training: Training, pairs: Pairs) -> Path:
    """Where a part's checkpoint and log lie."""
    fr = "" if part.fr is None else f"-fr{part.fr}"
    split = _TRAINED_AS.get(training.split, training.split)
    name = f"{part.name}{fr}-{training.scale}-{training.optimiser}-{split}-seed{training.seed}"
    return shared / f"{name}-{recipe(part, training, pairs)}"


def trained(
    part: SystemPart,
    training: Training,
    pairs: Pairs,
    folder: Path,
    processes: Processes,
    tell: ProgressCallback | None = None,
    until: int | None = None,
) -> Task:
    """A part's task, trained; ``until``: only so far."""
    data = PairsData(pairs, training.split, "train", part.fr)
    valid = PairsData(pairs, training.split, "valid", part.fr)
    if not len(data):
        raise InputError(f"{pairs.folder}: no pair in {training.split} train; make a corpus of more words")
    n_judgements = training.n_judgements or (4 if training.scale == "smoke" else 20)
    torch.manual_seed(training.seed)
    made = task(part, data.normaliser(), skeleton(pairs.signers[0]).parents.tolist(), training.seed)
    loop = LoopConfig(
        steps=part.steps,
        batch=part.batch,
        optimiser=training.optimiser,
        rate=part.rate,
        seed=training.seed,
        every=max(1, part.steps // n_judgements),
        n_judged=training.n_judged,
        bf16=processes.device.type == "cuda" if training.bf16 is None else training.bf16,
        until=until,
    )
    train(made, loop, data, valid, folder, recipe(part, training, pairs), processes, tell)
    return made


def _write(
    training: Training, pairs: Pairs, chosen: tuple[SystemPart, ...], tasks: list[Task], out: Path, folders: list[Path]
) -> None:
    files: dict[str, bytes] = {}
    for part, made, folder in zip(chosen, tasks, folders, strict=True):
        files |= _exported(part, made, folder)
    told = facts(training, pairs, chosen, tasks, folders)
    if training.steps != 0:
        told["runs"]["token_bias"] = token_bias(tasks[0], PairsData(pairs, training.split, "valid"))
    write_bundle(out, told, files)
    for part, folder in zip(chosen, folders, strict=True):
        shutil.copyfile(folder / logs.NAME, out / f"{part.name}.jsonl")


def _exported(part: SystemPart, made: Task, folder: Path) -> dict[str, bytes]:
    """A part's graphs; those that lie beside its checkpoint and are newer are not made again."""
    kept = sorted(folder.glob("*.onnx"))
    trained_at = (folder / checkpoint.NAME).stat().st_mtime_ns
    if kept and min(path.stat().st_mtime_ns for path in kept) > trained_at:
        return {path.name: path.read_bytes() for path in kept}
    files = paper_graphs(made.network, part.fr)
    for path in kept:
        path.unlink()
    for name, content in files.items():
        with replacing(folder / name) as temporary:
            temporary.write_bytes(content)
    return files


def facts(
    training: Training, pairs: Pairs, chosen: tuple[SystemPart, ...], tasks: list[Task], folders: list[Path]
) -> dict[str, Any]:
    """What a bundle says of itself, but its files; ``folders`` hold the parts' logs."""
    frames = tasks[-1].network
    normaliser: Any = frames.normaliser
    generator = frames if isinstance(frames, Generator) else None
    return {
        "system": training.system,
        "config": {part.name: part.facts()["config"] for part in chosen},
        "scale": training.scale,
        "optimiser": training.optimiser,
        "split": training.split,
        "corpus": pairs.head["hash"],
        "fps": pairs.head["fps"],
        "seed": training.seed,
        "steps": sum(part.steps for part in chosen),
        "fr": chosen[-1].fr,
        "parts": {
            part.name: {
                **{k: v for k, v in part.facts().items() if k != "config"},
                "rate": SGD_RATE if training.optimiser == "sgd" else part.rate,
                "scores": _last_scores(folder),
            }
            for part, folder in zip(chosen, folders, strict=True)
        },
        "normaliser": {"mean": normaliser.mean.tolist(), "deviation": normaliser.deviation.tolist()},
        "n_parameters": sum(p.numel() for made in tasks for p in made.network.parameters()),
        "versions": {"torch": torch.__version__, "onnx": onnx.__version__, "onnxruntime": onnxruntime.__version__},
        "runs": {
            "positions": "encoder" if len(chosen) == 1 else "spsn",
            "frames": "filler" if generator is None else "generator",
            "concurrent": generator is not None and generator.concurrent,
            "n_fed": 159 if generator is None else generator.n_fed,
            "most_frames": MOST_FRAMES,
        },
    }


def _last_scores(folder: Path) -> dict[str, float]:
    """A part's last scores on validation pairs."""
    judged = [line for line in logs.lines(folder / logs.NAME) if {"accuracy", "pta"} & set(line)]
    return {k: v for k, v in judged[-1].items() if k != "step"} if judged else {}
