"""The product's own networks, from signing without end to a bundle: one that cuts and times, one that bridges.

Each learns apart, in a folder of its own beside the bundle, and is exported into it when it has learned; a bundle may
hold some of them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from torch import Tensor

from signsplice.errors import InputError
from signsplice.rig.canonical import FEATURE_FPS
from signsplice.splicing import features
from signsplice.splicing.bundle import write_bundle
from signsplice.splicing.features import N_FRAME
from signsplice.splicing.learned import SYSTEM
from signsplice.train import log as logs
from signsplice.train.export import ExportGraph, check_bundle_folder, exported
from signsplice.train.loop import LoopConfig, ProgressCallback, judge, train
from signsplice.train.prefetch import Dataset, prefetched
from signsplice.train.processes import Processes, only_one
from signsplice.train.product import warm_start
from signsplice.train.product.bridge_task import BridgeTask
from signsplice.train.product.cut_data import CutDataset, CuttingTask
from signsplice.train.product.gap_data import GapDataset
from signsplice.train.product.networks.bridge import Bridge, BridgeConfig
from signsplice.train.product.networks.cutting import ChooseGraph, Cutting, CuttingConfig, ReadGraph, TimeGraph
from signsplice.train.task import Task

FILES = {"cutter": ("word.onnx", "cut.onnx", "duration.onnx"), "transition": ("bridge.onnx",)}
NETWORKS = tuple(FILES)
HELD_BACK = 0.1
"""Share of the signers, at least one, that are judged on and not learned from."""
_MEASURED = 8
"""Batches from which mean and spread of what a network sees are taken."""
_GOES_ON = ("more", "corpus")
"""Scales that go on from an earlier training."""
_LEAST_SPREAD = 0.1
"""What hardly varies in the signing that was learned from may vary much in a capture: it must not shout there."""


@dataclass(frozen=True)
class TrainingSchedule:
    """Sizes and how long: steps, draws a batch, rate, draws to judge; whether signing is seen as it was made."""

    config: CuttingConfig | BridgeConfig
    steps: int
    batch: int
    rate: float
    n_judged: int
    as_made: bool = False


SCHEDULES: dict[tuple[str, str], TrainingSchedule] = {
    ("cutter", "smoke"): TrainingSchedule(CuttingConfig(32, 2, 2, 64, 2, 8, 16), 40, 1, 3e-3, 2),
    ("cutter", "ship"): TrainingSchedule(CuttingConfig(), 12_000, 2, 1e-3, 24),
    ("cutter", "more"): TrainingSchedule(CuttingConfig(), 5_000, 2, 5e-4, 24),
    ("cutter", "corpus"): TrainingSchedule(CuttingConfig(), 8_000, 2, 5e-4, 24, as_made=True),
    ("transition", "smoke"): TrainingSchedule(BridgeConfig(32, 2, 2, 64), 20, 4, 3e-3, 8),
    ("transition", "ship"): TrainingSchedule(BridgeConfig(192, 6, 4, 768), 6_000, 32, 8e-4, 512),
    ("transition", "more"): TrainingSchedule(BridgeConfig(192, 6, 4, 768), 4_000, 32, 4e-4, 512),
    ("transition", "corpus"): TrainingSchedule(BridgeConfig(192, 6, 4, 768), 4_000, 32, 4e-4, 512, as_made=True),
}
"""What each network is at each scale. ``more`` goes on from an earlier training, on other signing, and ``corpus`` does
so on a corpus of pairs, whose words and transitions it sees as they are.
"""


@dataclass(frozen=True)
class ProductTraining:
    """What to train: the network, its scale, seed, and steps in place of the scale's; the recipe of an earlier training
    whose weights it begins with.
    """

    network: str
    scale: str = "ship"
    seed: int = 0
    steps: int | None = None
    begins_with: str | None = None

    @property
    def course(self) -> TrainingSchedule:
        """Sizes and how long. Raises ``InputError`` for an unknown network or scale."""
        if (self.network, self.scale) not in SCHEDULES:
            raise InputError(
                f"no network {self.network!r} at scale {self.scale!r}, expected one of {', '.join(NETWORKS)} at "
                f"{' or '.join(dict.fromkeys(scale for _, scale in SCHEDULES))}"
            )
        return SCHEDULES[self.network, self.scale]

    @property
    def n_steps(self) -> int:
        """Steps in all."""
        return self.course.steps if self.steps is None else self.steps


def split(*folders: Path) -> tuple[list[Path], list[Path]]:
    """Parts of signing to learn from and to judge on: the last signers of each folder are held back. Raises
    ``InputError`` for fewer than two.
    """
    learned: list[Path] = []
    held: list[Path] = []
    for folder in folders:
        paths = sorted(folder.glob("signer-*.npz"))
        if len(paths) < 2:
            raise InputError(
                f"{folder}: {len(paths)} signers, expected at least 2; `signsplice synth endless` makes them"
            )
        n_held = max(1, round(HELD_BACK * len(paths)))
        learned += paths[:-n_held]
        held += paths[-n_held:]
    return learned, held


def make(
    own: ProductTraining,
    signing: Sequence[Path],
    out: Path,
    processes: Processes,
    tell: Callable[[str], ProgressCallback] | None = None,
    earlier: Sequence[Path] = (),
) -> None:
    """Train a network on folders of signing, or go on where an earlier call was, and write it into the bundle ``out``.

    ``earlier``: folders of trainings whose checkpoints give the first weights, or bundles that have them; of several
    their mean. Raises ``InputError`` where one holds none, or those of another network, and where the scale asks for
    some and there are none.
    """
    if not earlier and own.scale in _GOES_ON:
        raise InputError(f"scale {own.scale} goes on from an earlier training: name its folder with --from")
    learned, held = split(*signing)
    before = [warm_start.find_warm_start(folder, own.network, FILES[own.network]) for folder in earlier]
    if before:
        own = replace(own, begins_with="+".join(one.recipe for one in before))
    recipe = _recipe(own, learned)
    folder = out.parent / "parts" / f"{own.network}-{own.scale}-seed{own.seed}-{recipe}"
    taught = _taught(learned, before)
    folder.mkdir(parents=True, exist_ok=True)
    if taught is not None:
        (folder / warm_start.TAUGHT).write_text(json.dumps(taught) + "\n")
    course = own.course
    data, valid = _data(own, learned, None), _data(own, held, course.n_judged)
    torch.manual_seed(own.seed)
    task = build(own, data)
    if before:
        warm_start.begin(task, before)
    loop = LoopConfig(
        own.n_steps, course.batch, "adamw", course.rate, own.seed, max(1, own.n_steps // 40), course.n_judged,
        bf16=processes.device.type == "cuda",
    )  # fmt: skip
    check_bundle_folder(out)
    with (
        only_one(folder) if processes.first else nullcontext(),
        prefetched(data, processes.rank, processes.count) as following,
    ):
        train(task, loop, following, valid, folder, recipe, processes, tell and tell(own.network))
        if own.n_steps == 0 and processes.first:  # what it begins with is what it is
            with logs.Log(folder, 0, processes.first) as log:
                log.write(0, **judge(task, valid, loop, processes))
    if processes.first:
        for name, content in product_graphs(task, valid).items():
            (folder / name).write_bytes(content)
        (folder / "facts.json").write_text(
            json.dumps(_facts(own, task, folder, learned, held, taught), indent=1) + "\n"
        )
        assemble(out, {own.network: folder})


def assemble(out: Path, folders: dict[str, Path]) -> None:
    """Put networks into a bundle; those that it has already stay, but for the ones that are named."""
    out.mkdir(parents=True, exist_ok=True)
    head = out / "bundle.json"
    networks: dict[str, Any] = json.loads(head.read_text())["networks"] if head.exists() else {}
    where = {name: folders.get(name, out) for name in (*networks, *folders)}
    networks |= {name: json.loads((folder / "facts.json").read_text()) for name, folder in folders.items()}
    files = {file: (folder / file).read_bytes() for name, folder in where.items() for file in FILES[name]}
    facts = {
        "system": SYSTEM,
        "features": features.VERSION,
        "rate": FEATURE_FPS,
        "networks": {name: networks[name] for name in NETWORKS if name in networks},
        "versions": {"torch": torch.__version__, "onnx": onnx.__version__, "onnxruntime": onnxruntime.__version__},
    }
    write_bundle(out, facts, files)


def build(own: ProductTraining, data: Dataset) -> Task:
    """A network's task; mean and spread of what it sees are those of its first batches."""
    course = own.course
    seen = [data.batch(data.rows(step, course.batch, own.seed), step) for step in range(_MEASURED)]
    spread = _spread([b.tokens[b.mask] for b in seen])
    if isinstance(course.config, CuttingConfig):
        return CuttingTask(Cutting(course.config, *spread))
    assert isinstance(data, GapDataset)
    return BridgeTask(Bridge(course.config, *spread), data.above.tolist())


def _spread(tokens: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    whole = torch.cat(list(tokens))
    return whole.mean(0), whole.std(0).clamp(min=_LEAST_SPREAD)


def _data(own: ProductTraining, paths: Sequence[Path], fixed: int | None) -> Dataset:
    kind = GapDataset if own.network == "transition" else CutDataset
    return kind(paths, own.seed, fixed, own.course.as_made)


def product_graphs(task: Task, valid: Dataset) -> dict[str, bytes]:
    """A task's network as ONNX graphs by file name, compared with torch on what it has not learned from."""
    network = task.network.eval().cpu()
    if isinstance(network, Cutting):
        told = _cutting_graphs(network, [valid.batch([k]) for k in range(3)])
    else:
        # Batches of some, since a size of one would be taken for a constant.
        several = [valid.batch(rows) for rows in ([0, 1, 2], [3], [4, 5])]
        given = [{"tokens": batch.tokens, "mask": batch.mask} for batch in several]
        free: dict[str, tuple[int, ...]] = {"tokens": (0, 1), "mask": (0, 1)}
        told = {"bridge": ExportGraph(network, given[0], ("turns",), free, tuple(given[1:]))}
    return {f"{name}.onnx": exported(name, graph) for name, graph in told.items()}


def _cutting_graphs(network: Cutting, batches: Sequence[Any]) -> dict[str, ExportGraph]:
    words = [batch.tokens[:, k][batch.mask[:, k]][None] for batch in batches for k in (0, 1)]
    with torch.no_grad():
        read = [network.read(tokens) for tokens in words]
    pairs = [
        {"before": p[0], "leave": p[1], "after": q[0], "enter": q[2]}
        for p, q in zip(read[::2], read[1::2], strict=True)
    ]
    ends = [
        {"leaving": p[:, 3, :N_FRAME], "entering": q[:, 5, :N_FRAME], "leave": told["leave"], "enter": told["enter"]}
        for p, q, told in zip(words[::2], words[1::2], pairs, strict=True)
    ]
    tokens = [{"tokens": word} for word in words]
    outputs = ("states", "leave", "enter", "phases")
    return {
        "word": ExportGraph(ReadGraph(network), tokens[0], outputs, {"tokens": (1,)}, tuple(tokens[1:])),
        "cut": ExportGraph(
            ChooseGraph(network), pairs[0], ("left", "entered"), {"before": (1,), "after": (1,)}, tuple(pairs[1:])
        ),
        "duration": ExportGraph(TimeGraph(network), ends[0], ("seconds",), {}, tuple(ends[1:])),
    }


def _recipe(own: ProductTraining, paths: Sequence[Path]) -> str:
    course = own.course
    told = {
        **{name: value for name, value in asdict(own).items() if name != "begins_with" or value is not None},
        "n_steps": own.n_steps,
        "config": asdict(course.config),
        "batch": course.batch,
        "rate": course.rate,
        "features": features.VERSION,
        "signers": [path.name for path in paths],
        **({"as_made": True} if course.as_made else {}),
    }
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]


def _facts(
    own: ProductTraining,
    task: Task,
    folder: Path,
    learned: Sequence[Path],
    held: Sequence[Path],
    taught: dict[str, str] | None,
) -> dict[str, Any]:
    judged = [line for line in logs.lines(folder / logs.NAME) if "loss" not in line]
    return {
        **asdict(own),
        **({} if taught is None else {"taught": taught}),
        "config": asdict(own.course.config),
        "steps": own.n_steps,
        "recipe": _recipe(own, learned),
        "n_parameters": sum(p.numel() for p in task.network.parameters()),
        "signers": [path.stem for path in learned],
        "held_back": [path.stem for path in held],
        "scores": {k: v for k, v in judged[-1].items() if k != "step"} if judged else {},
    }


def _taught(paths: Sequence[Path], before: Sequence[warm_start.WarmStart]) -> dict[str, str] | None:
    """Which corpus of pairs, and which split of it, is among parts of signing, or taught the earlier training; None
    where there is none. Raises ``InputError`` for two.
    """
    found = set()
    found |= {tuple(one.taught.values()) for one in before if one.taught is not None}
    for path in paths:
        with np.load(path) as stored:
            if "corpus" in stored:
                found.add((str(stored["corpus"]), str(stored["split"])))
    if len(found) > 1:
        raise InputError(f"signing of {len(found)} parts of corpora of pairs, expected one: what is judged must be new")
    return dict(zip(("corpus", "split"), *found, strict=True)) if found else None


__all__ = ["FILES", "NETWORKS", "SCHEDULES", "ProductTraining", "assemble", "build", "make", "product_graphs", "split"]
