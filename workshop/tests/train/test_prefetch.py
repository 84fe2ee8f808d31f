"""Batches made in advance are the same batches, and the process that makes them ends whatever happens."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from torch import Tensor  # noqa: E402

from signsplice.errors import SignspliceError  # noqa: E402
from signsplice_workshop.train.prefetch import Dataset, Rows, prefetch_batches  # noqa: E402
from training_toys import product_toy  # noqa: E402

PARENT = """
import os, sys
from signsplice_workshop.train.prefetch import prefetch_batches
from test_prefetch import Counting
with prefetch_batches(Counting()) as dataset:
    dataset.batch(dataset.rows(0, 2, 0), 0)
    import multiprocessing
    print(multiprocessing.active_children()[0].pid, flush=True)
    os._exit(1)
"""


class Counting:
    """Batches that say which process made them; that of step 3 cannot be made, and that of step 5 takes its time."""

    def __len__(self) -> int:
        return 100

    def rows(self, step: int, size: int, seed: int) -> Rows:
        return np.arange(step * size, (step + 1) * size)

    def batch(self, rows: Sequence[int] | Rows, step: int = 0) -> tuple[list[int], int]:
        if step == 3:
            raise ValueError("no batch for step 3")
        if step == 5:
            time.sleep(600.0)
        return [int(row) for row in rows], os.getpid()


def batches(dataset: Dataset, *steps: int) -> list[Any]:
    """The batches of some steps."""
    return [dataset.batch(dataset.rows(step, 4, 0), step) for step in steps]


def ends(pid: int) -> bool:
    """Whether a process ends within half a minute."""
    for _ in range(300):
        try:
            os.kill(pid, 0)
            if "\nState:\tZ" in Path(f"/proc/{pid}/status").read_text():
                return True
        except OSError:
            return True
        time.sleep(0.1)
    return False


@pytest.mark.parametrize("network", ["cutter", "transition"])
def test_batches_made_in_advance_are_the_same(network: str) -> None:
    plain = product_toy(network)[1]
    with prefetch_batches(plain) as dataset:
        assert len(dataset) == len(plain)
        for step in (0, 1, 2, 5):
            rows = dataset.rows(step, 4, 0)
            one, other = dataset.batch(rows, step), plain.batch(plain.rows(step, 4, 0), step)
            for field in fields(one):
                value, expected = getattr(one, field.name), getattr(other, field.name)
                same = torch.equal(value, expected) if isinstance(value, Tensor) else value == expected
                assert same, (step, field.name)


def test_each_of_two_ranks_gets_its_rows_from_the_worker() -> None:
    with prefetch_batches(Counting(), rank=1, count=2) as dataset:
        made = [dataset.batch(dataset.rows(step, 4, 0)[1::2], step) for step in range(3)]
    assert [rows for rows, _ in made] == [[1, 3], [5, 7], [9, 11]]
    assert [pid == os.getpid() for _, pid in made] == [True, False, False]


def test_rows_that_were_not_expected_are_made_at_once() -> None:
    with prefetch_batches(Counting()) as dataset:
        dataset.batch(dataset.rows(0, 4, 0), 0)
        assert dataset.batch([7, 8], 1) == ([7, 8], os.getpid())


def test_an_error_in_the_worker_is_raised_with_its_traceback() -> None:
    with prefetch_batches(Counting()) as dataset:
        batches(dataset, 0, 1, 2)
        with pytest.raises(ValueError, match="no batch for step 3"):
            batches(dataset, 3)


def test_a_dead_worker_is_reported() -> None:
    with prefetch_batches(Counting()) as dataset:
        batches(dataset, 0)
        (worker,) = multiprocessing.active_children()
        os.kill(worker.pid or 0, signal.SIGKILL)
        worker.join()
        with pytest.raises(SignspliceError, match="the process that makes batches has ended"):
            batches(dataset, 1, 2)  # that of step 1 may have been ready


def test_the_worker_ends_with_the_block_even_while_it_works() -> None:
    with prefetch_batches(Counting()) as dataset:
        batches(dataset, 4)  # the worker begins step 5
        assert len(multiprocessing.active_children()) == 1
    assert multiprocessing.active_children() == []


def test_the_worker_ends_when_its_parent_is_killed() -> None:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", PARENT]
    parent = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert parent.returncode == 1, parent.stderr
    assert ends(int(parent.stdout))


def test_where_processes_cannot_be_copied_this_one_makes_the_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multiprocessing, "get_all_start_methods", lambda: ["spawn"])
    with prefetch_batches(Counting()) as dataset:
        assert batches(dataset, 0, 1) == [([0, 1, 2, 3], os.getpid()), ([4, 5, 6, 7], os.getpid())]
        assert multiprocessing.active_children() == []
