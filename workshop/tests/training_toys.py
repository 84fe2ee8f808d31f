"""A small corpus of pairs, and the product's networks at a size that is trained in seconds."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import torch

from signsplice.signer import notation
from signsplice_workshop.corpora import training_data
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs
from signsplice_workshop.train.cut_data import CutDataset
from signsplice_workshop.train.loop import LoopConfig, train
from signsplice_workshop.train.prefetch import Dataset, Rows
from signsplice_workshop.train.processes import Processes
from signsplice_workshop.train.tasks import BridgeTask, Task
from signsplice_workshop.train.training import FILES, ProductTraining, build, open_dataset

GLOSSES = ("HELLO", "DEAF", "SIGN", "YOU", "SEE")
ALONE = Processes(0, 1, torch.device("cpu"))


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


def product_toy(network: str = "cutter") -> tuple[Task, Dataset, Dataset]:
    """One of the product's networks with fresh weights, what it learns from, and what it is validated on."""
    config = ProductTraining(network, "smoke", batch=4)
    paths = sorted(Path(os.environ.get("TOY_SIGNING") or signing(2, 3, 3, 8)).glob("*.npz"))
    examples, valid = open_dataset(config, paths), open_dataset(config, paths, 2)
    if isinstance(examples, CutDataset):  # the processes' parts of a batch have unequal numbers of pairs with truth
        examples.signers[0][0].true_cuts[1:] = -1
    torch.manual_seed(0)
    return build(config, examples), examples, valid


def train_example(
    made: tuple[Task, Dataset, Dataset], folder: Path, until: int, processes: Processes = ALONE
) -> dict[int, list[int]]:
    """Train a toy in 32 bits and without dropout, to step ``until`` of 20; returns the rows of every step that this
    process was given.
    """
    folder.mkdir(parents=True, exist_ok=True)
    task, examples, valid = made
    recorded = RecordedDataset(examples)
    loop = LoopConfig(20, 4, 3e-3, seed=4, every=10, until=until)
    train(task, loop, recorded, valid, folder, "toy", processes)
    return recorded.seen


def empty_graphs(task: Task, valid: Dataset) -> dict[str, bytes]:
    """Empty files in place of the graphs of one of the product's networks."""
    return dict.fromkeys(FILES["transition" if isinstance(task, BridgeTask) else "cutter"], b"")
