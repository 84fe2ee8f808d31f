"""Trainings by two processes, as `torchrun` starts them, and what is expected of them."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from signsplice_workshop.train import checkpoint, records
from signsplice_workshop.train.prefetch import Dataset
from signsplice_workshop.train.tasks import Task
from training_toys import corpus, signing, train_example

Make = Callable[[str], tuple[Task, Dataset, Dataset]]
"""Makes a toy by its name: its task, what it learns from, what it is validated on."""
SCRIPT = Path(__file__).parent / "training_process.py"
WAIT_S = 400.0
"""Starting a process that imports torch takes seconds, and minutes on a busy machine."""


def losses(folder: Path) -> dict[int, float]:
    """The losses in a training's log by step."""
    return {line["step"]: line["loss"] for line in records.read_lines(folder / records.LOG_FILE) if "loss" in line}


def free_port() -> str:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return str(free.getsockname()[1])


def environment(**more: str) -> Mapping[str, str]:
    return os.environ | {"OMP_NUM_THREADS": "1", "GLOO_SOCKET_IFNAME": "lo"} | more


def started(command: list[str], output: Path) -> list[subprocess.Popen[bytes]]:
    """Two processes of a command with what `torchrun` tells them; standard error goes to ``output``/0 and 1."""
    told = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": free_port()}
    running = []
    for rank in "01":
        with (output / rank).open("wb") as errors:
            running.append(
                subprocess.Popen(
                    command, env=environment(**told, RANK=rank, LOCAL_RANK=rank), stdout=errors, stderr=errors
                )
            )
    return running


def train_by_two(root: Path, names: Sequence[str], make: Make) -> Path:
    """Train every toy by two processes to the end, and by one process to step 7 and then by two to step 14; each
    process has a folder in ``root``.
    """
    jobs = []
    for name in names:
        train_example(make(name), root / "process0" / name / "resumed", 7)
        jobs += [f"{name}/whole/20", f"{name}/resumed/14"]
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        patched.setenv("TOY_CORPUS", str(corpus().folder))
        patched.setenv("TOY_SIGNING", str(signing(2, 3, 3, 8)))
        running = started([sys.executable, str(SCRIPT), str(root), make.__module__, make.__name__, *jobs], root)
    assert [process.wait(WAIT_S) for process in running] == [0, 0], (root / "0").read_text() + (root / "1").read_text()
    return root


def check_losses(trained: Path, alone_folder: Path, name: str, make: Make) -> None:
    """A toy has the losses of one process, which trains it in another folder, and each row was given to one of two."""
    rows = train_example(make(name), alone_folder, 20)
    alone = losses(alone_folder)
    assert list(alone) == list(range(1, 21))
    assert losses(trained / "process0" / name / "whole") == pytest.approx(alone, rel=1e-5, abs=0.0)
    train_example(make(name), trained / "process0" / name / "resumed", 20)
    assert losses(trained / "process0" / name / "resumed") == pytest.approx(alone, rel=1e-5, abs=0.0)
    parts = [json.loads((trained / f"process{rank}" / name / "whole" / "seen.json").read_text()) for rank in (0, 1)]
    for step, batch in rows.items():
        first, second = (part[str(step)] for part in parts)
        assert sorted(first + second) == sorted(batch), "every row once, by one of them"
        assert len(first) == len(second)


def check_writers(trained: Path, names: Sequence[str]) -> None:
    """The first process has written checkpoints, the other nothing."""
    for name in names:
        for call in ("whole", "resumed"):
            assert (trained / "process0" / name / call / checkpoint.NAME).exists()
            assert [path.name for path in (trained / "process1" / name / call).iterdir()] == ["seen.json"]
