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

import torch

from signsplice.synth import notation, training_data
from signsplice.synth.corpus import Pairs, Recipe, write_pairs
from signsplice.synth.signer import STANDARD, skeleton
from signsplice.train.paper.networks.convs2s import ConvS2SConfig
from signsplice.train.paper.networks.filling import InterpolationConfig, NatConfig
from signsplice.train.paper.networks.lstm import LstmConfig
from signsplice.train.paper.networks.spsn import SpsnConfig
from signsplice.train.paper.networks.tfgn import TransformerConfig
from signsplice.train.paper.pairs_data import PairsData
from signsplice.train.paper.scales import Config, SystemPart, task
from signsplice.train.prefetch import Dataset
from signsplice.train.processes import Processes
from signsplice.train.product.bridge_task import BridgeTask
from signsplice.train.product.training import FILES
from signsplice.train.task import Task

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
}
GENERATORS = ("tfgn", "tfgn-wc", "transformer", "progressive", "conv-s2s", "lstm")


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


def empty_graphs(task: Task, valid: Dataset) -> dict[str, bytes]:
    """Empty files in place of the graphs of one of the product's networks."""
    return dict.fromkeys(FILES["transition" if isinstance(task, BridgeTask) else "cutter"], b"")


def parents() -> Sequence[int]:
    """Parents of the 53 joints."""
    return [int(parent) for parent in skeleton(STANDARD).parents]
