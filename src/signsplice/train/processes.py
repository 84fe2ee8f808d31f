"""Training one network with one process, or with several that `torchrun` started."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import torch
from filelock import FileLock
from torch import distributed


@dataclass(frozen=True)
class Processes:
    """The processes that train one network.

    - rank: number of this one, from 0
    - count: how many there are
    - device: what this one computes on
    """

    rank: int
    count: int
    device: torch.device

    @property
    def first(self) -> bool:
        """Whether this is the process that validates and writes files."""
        return self.rank == 0

    def decided(self, choice: bool) -> bool:
        """The first process's choice, in every process: their clocks and files differ."""
        if self.count == 1:
            return choice
        shared = torch.tensor(int(choice), device=self.device)
        distributed.broadcast(shared, 0)
        return bool(shared.item())


def pick_device(name: str) -> torch.device:
    """The device with a name; ``auto`` is a GPU where there is one, else the CPU."""
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Wait until no other call trains in a folder, and keep others out: of two systems that share a part and are
    trained at once, the second one finds the part trained.
    """
    with FileLock(folder / ".lock"):
        yield


@contextmanager
def joined(device: str = "auto") -> Iterator[Processes]:
    """The processes that `torchrun` started, or this one alone; gradients meet by nccl on GPUs, else by gloo."""
    count = int(os.environ.get("WORLD_SIZE", "1"))
    chosen = pick_device(device)
    if count == 1:
        yield Processes(0, 1, chosen)
        return
    rank = int(os.environ["RANK"])
    if chosen.type == "cuda":
        chosen = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))
        torch.cuda.set_device(chosen)
    distributed.init_process_group("nccl" if chosen.type == "cuda" else "gloo")
    try:
        yield Processes(rank, count, chosen)
    finally:
        distributed.destroy_process_group()
