"""A small corpus of pairs, and every part of every system at a size that is trained in seconds."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import torch

from signsplice.synth import notation, training_data
from signsplice.synth.corpus import Pairs, Recipe, write_pairs
from signsplice.synth.signer import STANDARD, skeleton
from signsplice.train.bridge_task import BridgeTask
from signsplice.train.cut_data import CutDataset
from signsplice.train.loop import LoopConfig, train
from signsplice.train.prefetch import Dataset, Rows
from signsplice.train.processes import Processes
from signsplice.train.task import Task
from signsplice.train.training import FILES, ProductTraining, build, dataset
from signsplice_paper.train.networks.cam_stitch import CamStitchConfig
from signsplice_paper.train.networks.convs2s import ConvS2SConfig
from signsplice_paper.train.networks.filling import InterpolationConfig, NatConfig
from signsplice_paper.train.networks.lstm import LstmConfig
from signsplice_paper.train.networks.mixture_density import MixtureConfig
from signsplice_paper.train.networks.skeletal_attention import SkeletalConfig
from signsplice_paper.train.networks.spsn import SpsnConfig
from signsplice_paper.train.networks.tfgn import TransformerConfig
from signsplice_paper.train.pairs_data import PairsData
from signsplice_paper.train.scales import Config, SystemPart, task

GLOSSES = ("HELLO", "DEAF", "SIGN", "YOU", "SEE")
ALONE = Processes(0, 1, torch.device("cpu"))
FR = 3
_T = TransformerConfig(32, 2, 1, 1, 48, 0.0)

CONFIGS: dict[str, tuple[Config, int | None]] = {
    "spsn": (SpsnConfig(32, dropout=0.0), None),
    "spsn-printed": (SpsnConfig(32, "printed", 0.0, steps=False, summary=False), None),
    "spsn-printed-wa": (SpsnConfig(32, "none", 0.0, steps=False, summary=False), None),
    "spsn-eq7": (SpsnConfig(32, "printed", 0.0), None),
    "spsn-frames": (SpsnConfig(32, dropout=0.0, steps=False), None),
    "spsn-no-summary": (SpsnConfig(32, dropout=0.0, summary=False), None),
    "spsn-plain-loss": (SpsnConfig(32, dropout=0.0), None),
    "spsn-wa": (SpsnConfig(32, "none", 0.0), None),
    "tfgn": (_T, FR),
    "tfgn-wc": (replace(_T, marks=True), None),
    "transformer": (replace(_T, tokens=True, steps=True), None),
    "progressive": (TransformerConfig(32, 2, 1, 1, 48, 0.0, counter=True), FR),
    "conv-s2s": (ConvS2SConfig(24, 3, 2, 0.0), None),
    "lstm": (LstmConfig(32), None),
    "nat": (NatConfig(FR, 32, 2, 1, 1, 48, 4, 0.0), FR),
    "interpolation": (InterpolationConfig(FR, 32, 3), FR),
    "mixture": (MixtureConfig(32, 2, 1, 1, 48, 0.0, n_components=3), FR),
    "skeletal": (SkeletalConfig(16, 2, 1, 1, 32, dropout=0.0), FR),
    "cam-stitch": (CamStitchConfig(FR, 32), FR),
}
GENERATORS = ("tfgn", "tfgn-wc", "transformer", "progressive", "conv-s2s", "lstm", "mixture", "skeletal", "cam-stitch")


@cache
def corpus() -> Pairs:
    """Five words at 12 frames a second: 25 pairs, and five by the second signer."""
    if "TOY_CORPUS" in os.environ:
        return Pairs(os.environ["TOY_CORPUS"])
    folder = Path(tempfile.mkdtemp(prefix="signsplice-train-"))
    atexit.register(shutil.rmtree, folder, True)
    signs = notation.everyday()
    return Pairs(write_pairs(Recipe(tuple(signs[g] for g in GLOSSES), fps=12.0, n_other=5), folder / "p", None, 1))


@cache
def signing(n_signers: int, n_words: int, n_seams: int, seed: int) -> Path:
    """A folder of synthetic signing for the product's networks."""
    folder = Path(tempfile.mkdtemp(prefix="signsplice-train-"))
    atexit.register(shutil.rmtree, folder, True)
    plan = training_data.TrainingDataPlan(n_signers, n_words, n_seams, seed=seed)
    training_data.write(plan, folder / "signing", processes=1)
    return folder / "signing"


@cache
def data(part: str = "train", fr: int | None = None, split: str = "random") -> PairsData:
    """A part of the corpus."""
    return PairsData(corpus(), split, part, fr)


def toy(name: str, seed: int = 0) -> Task:
    """A part's task with fresh weights."""
    torch.manual_seed(seed)
    config, fr = CONFIGS[name]
    part = SystemPart(name, config, fr, 10, 8, 1e-2)
    return task(part, data().normaliser(), parents(), seed)


class RecordedDataset:
    """A dataset that records the rows of its batches by step."""

    def __init__(self, whole: Dataset) -> None:
        self.whole = whole
        self.seen: dict[int, list[int]] = {}

    def __len__(self) -> int:
        return len(self.whole)

    def rows(self, step: int, size: int, seed: int) -> Rows:
        return self.whole.rows(step, size, seed)

    def batch(self, rows: Sequence[int] | Rows, step: int = 0) -> Any:
        self.seen[step] = [int(row) for row in rows]
        return self.whole.batch(rows, step)


def train_example(name: str, folder: Path, until: int, processes: Processes = ALONE) -> dict[int, list[int]]:
    """Train a part of the paper's systems, or one of the product's networks, in 32 bits and without dropout, to step
    ``until`` of 20; returns the rows of every step that this process was given.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if name in FILES:
        config = ProductTraining(name, "smoke", batch=4)
        paths = sorted(Path(os.environ.get("TOY_SIGNING") or signing(2, 3, 3, 8)).glob("*.npz"))
        examples, valid = dataset(config, paths), dataset(config, paths, 2)
        if isinstance(examples, CutDataset):  # the processes' parts of a batch have unequal numbers of pairs with truth
            examples.signers[0][0].true_cuts[1:] = -1
        torch.manual_seed(0)
        task = build(config, examples)
    else:
        fr = CONFIGS[name][1]
        task, examples, valid = toy(name), data("train", fr), data("valid", fr)
    recorded = RecordedDataset(examples)
    loop = LoopConfig(20, 4, "adamw", 3e-3, seed=4, every=10, until=until)
    train(task, loop, recorded, valid, folder, "toy", processes)
    return recorded.seen


def empty_graphs(task: Task, valid: Dataset) -> dict[str, bytes]:
    """Empty files in place of the graphs of one of the product's networks."""
    return dict.fromkeys(FILES["transition" if isinstance(task, BridgeTask) else "cutter"], b"")


def parents() -> Sequence[int]:
    """Parents of the 53 joints."""
    return [int(parent) for parent in skeleton(STANDARD).parents]
