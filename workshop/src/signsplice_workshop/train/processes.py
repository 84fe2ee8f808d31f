"""Training one network with one process, or with several that `torchrun` started."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import torch
from filelock import FileLock, Timeout
from torch import Tensor, distributed

from signsplice.errors import InputError, SignspliceError

T = TypeVar("T")
_LOCK_S = 60.0
"""Longest time of one attempt to lock a folder; the other processes wait for its result, and not for ever."""
_FIRST_SPEAKS_S = 20.0
"""Time for which the other processes hold back an error: mostly it is the first one's too, and `torchrun` ends them
when that one has reported it.
"""


@dataclass(frozen=True)
class Processes:
    """The processes that train one network.

    - rank: number of this one, from 0
    - count: number of processes
    - device: device of this one
    """

    rank: int
    count: int
    device: torch.device

    @property
    def first(self) -> bool:
        """Returns whether this is the process that validates and writes files."""
        return self.rank == 0

    def broadcast_choice(self, choice: bool) -> bool:
        """Returns the first process's choice, in every process: their clocks and files differ."""
        return self.broadcast_value(choice)

    def broadcast_value(self, value: T) -> T:
        """Returns the first process's value, in every process; it is pickled."""
        values = [value]
        if self.count > 1:
            distributed.broadcast_object_list(values, 0)
        return values[0]


def average_counts(counts: Tensor) -> Tensor:
    """Returns counts (K,) of a process's part of a batch as means over the processes; a total of 0 counts as 1.

    The mean over the processes of sums that are divided by such counts is the loss of the whole batch, and that of
    their gradients its gradient, however unequal the parts' counts are.
    """
    if not distributed.is_initialized():
        return counts.clamp(min=1)
    totals = counts.clone()
    distributed.all_reduce(totals)
    return totals.clamp(min=1) / distributed.get_world_size()


ALONE = Processes(0, 1, torch.device("cpu"))
"""One process on a CPU."""


def pick_device(name: str) -> torch.device:
    """Returns the device with a name; ``auto`` is a GPU if there is one, else the CPU."""
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)


@contextmanager
def lock_folder(folder: Path, processes: Processes) -> Iterator[None]:
    """Waits until no other call trains in a folder, and locks it: of two systems that share a part and are trained at
    once, the second one finds the part trained. All processes of a call wait for its first one.
    """
    lock = FileLock(folder / ".lock")
    while not processes.broadcast_choice(processes.first and _try_acquire(lock)):
        continue
    try:
        yield
    finally:
        lock.release()


def _try_acquire(lock: FileLock) -> bool:
    try:
        lock.acquire(timeout=_LOCK_S)
    except Timeout:
        return False
    return True


@contextmanager
def join_process_group(device: str = "auto") -> Iterator[Processes]:
    """Yields the processes that `torchrun` started, or this one alone; gradients are exchanged by nccl on GPUs, else by
    gloo.

    Raises ``InputError`` if a machine has fewer GPUs than processes, and ``SignspliceError`` if another process has
    ended.
    """
    count = int(os.environ.get("WORLD_SIZE", "1"))
    torch_device = pick_device(device)
    if count == 1:
        yield Processes(0, 1, torch_device)
        return
    rank = int(os.environ["RANK"])
    if torch_device.type == "cuda":
        torch_device = _pick_gpu(int(os.environ.get("LOCAL_RANK", "0")))
        torch.cuda.set_device(torch_device)
    distributed.init_process_group("nccl" if torch_device.type == "cuda" else "gloo")
    try:
        yield Processes(rank, count, torch_device)
        distributed.barrier()  # a process that ends while another still talks to it aborts in gloo's threads
    except SignspliceError:
        if rank:
            time.sleep(_FIRST_SPEAKS_S)
        raise
    except RuntimeError as error:
        if isinstance(error, distributed.DistError) or "gloo" in str(error):
            raise SignspliceError(
                "another process of this training has ended or cannot be reached; the same command continues from the "
                "last checkpoint"
            ) from error
        raise
    finally:
        distributed.destroy_process_group()


def _pick_gpu(local_rank: int) -> torch.device:
    """Returns the GPU of a process, by its number on its machine. Raises ``InputError`` if there are fewer GPUs."""
    if local_rank >= (n_gpus := torch.cuda.device_count()):
        raise InputError(
            f"process {local_rank} of this machine has no GPU of its own, of {n_gpus}; start one process for each GPU, "
            "or train on the device cpu"
        )
    return torch.device("cuda", local_rank)
