"""What is written is old and whole or new and whole, whichever operation on the disk is the last, or fails.

After the next call nothing is left over.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import random_clip
from faults import DONE_DESPITE, KILLED, REFUSED, every_operation
from signing import sign
from signsplice import SpliceOptions, lexicon, splice
from signsplice.formats import save
from signsplice.splicing import report
from signsplice.splicing.bundle import write_bundle
from signsplice.synth import corpus, training_data, truth
from signsplice.synth.corpus import Recipe, write_pairs

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")

Content = dict[str, bytes]


def write_splice(folder: Path, seed: int) -> None:
    result = spliced(seed)
    save(result.clip, folder / "out.bvh")
    report.write(report.describe(result, {"load": 1.0, "save": 1.0}), folder / "report.json")


@lru_cache
def spliced(seed: int) -> Any:
    clips = [random_clip(seed), random_clip(seed + 1)]
    clips[1] = clips[1].__class__(
        clips[0].skeleton, *[getattr(clips[1], x) for x in ("local_rotations", "root_positions")], 30.0
    )
    return splice(clips, SpliceOptions("ends", "linear", "fixed"))


def write_words(folder: Path, seed: int) -> None:
    with lexicon.building(folder / "lex") as builder:
        builder.add(random_clip(seed), f"WORD{seed}")


def write_networks(folder: Path, seed: int) -> None:
    write_bundle(
        folder / "bundle", {"system": "lpt"}, {"a.onnx": b"%d" % seed, f"{seed}.onnx": b"x"}, {"a.jsonl": b"{}"}
    )


def write_checkpoint(folder: Path, seed: int) -> None:
    torch = pytest.importorskip("torch")
    from signsplice.train import checkpoint

    network = torch.nn.Linear(2, 2)
    torch.nn.init.constant_(network.weight, seed)
    torch.nn.init.zeros_(network.bias)
    checkpoint.save(folder, seed, network, torch.optim.SGD(network.parameters(), 0.1), "recipe")


def write_corpus(folder: Path, seed: int) -> None:
    write_pairs(Recipe((sign("I"),), seed, n_other=1), folder / "pairs", processes=1)


def write_training_data(folder: Path, seed: int) -> None:
    training_data.write(training_data.TrainingDataPlan(2, 2, 0, seed), folder, processes=1)


WRITERS: dict[str, Callable[[Path, int], None]] = {
    "splice": write_splice,
    "lexicon": write_words,
    "bundle": write_networks,
    "checkpoint": write_checkpoint,
    "pairs": write_corpus,
    "training data": write_training_data,
}


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Motion is computed once, and parts are small: what is tested is how they are written."""
    monkeypatch.setattr(corpus, "_word", word)
    monkeypatch.setattr(truth, "splice", true_splice)
    monkeypatch.setattr(training_data, "part", lambda plan, number: {"turns": np.full(3, plan.seed + number)})


word = lru_cache(corpus._word)
true_splice = lru_cache(truth.splice)


def content(folder: Path) -> dict[str, Content]:
    """Visible name in a folder -> relative path -> content of what is there."""
    return {
        top.name: {
            path.relative_to(folder).as_posix(): path.read_bytes() for path in [top, *top.rglob("*")] if path.is_file()
        }
        for top in folder.iterdir()
        if not top.name.startswith(".")
    }


def assert_whole(found: dict[str, Content], old: dict[str, Content], new: dict[str, Content], at: int) -> None:
    for name in old.keys() | new.keys():
        assert found.get(name) in (old.get(name), new.get(name)), f"{name} after operation {at}"


@pytest.mark.parametrize(
    ("start", "fault"),
    [("new", None), ("replacing", None), ("new", errno.ENOSPC), ("replacing", errno.EIO)],
    ids=["new, kill", "replacing, kill", "new, full disk", "replacing, I/O error"],
)
@pytest.mark.parametrize("writer", WRITERS)
def test_every_operation_may_be_the_last_or_fail(writer: str, start: str, fault: int | None, tmp_path: Path) -> None:
    write = WRITERS[writer]
    (tmp_path / "old").mkdir()
    if start == "replacing":
        write(tmp_path / "old", 1)
    old = content(tmp_path / "old")
    shutil.copytree(tmp_path / "old", tmp_path / "new")
    write(tmp_path / "new", 2)
    new = content(tmp_path / "new")

    def prepare(at: int) -> None:
        shutil.copytree(tmp_path / "old", tmp_path / str(at))

    def faulty(at: int) -> None:
        write(tmp_path / str(at), 2)

    statuses = []
    for at, status in every_operation(prepare, faulty, fault):
        folder = tmp_path / str(at)
        statuses.append(status)
        assert_whole(content(folder), old, new, at)
        write(folder, 2)
        assert content(folder) == new
        assert sorted(os.listdir(folder)) == sorted(new), f"left over after operation {at}"
        shutil.rmtree(folder)
    print(writer, start, fault, len(statuses))
    assert set(statuses) <= ({KILLED} if fault is None else {REFUSED, DONE_DESPITE})
    assert len(statuses) > 5
