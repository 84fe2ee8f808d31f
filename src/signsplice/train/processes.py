"""Several processes that train one network (`torchrun`), or one that trains it alone."""

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
    """Which of how many this one is, and the device it works on."""

    rank: int
    count: int
    device: torch.device

    @property
    def first(self) -> bool:
        """Whether this one writes files and judges."""
        return self.rank == 0


def pick_device(name: str) -> torch.device:
    """The device of a name; auto: a GPU where there is one."""
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Waits until no other call trains in a folder, and keeps others out: systems of one part may be trained side by
    side, and the second finds the part trained.
    """
    with FileLock(folder / ".lock"):
        yield


@contextmanager
def joined(device: str = "auto") -> Iterator[Processes]:
    """The process, among those that `torchrun` started: gradients meet by nccl on GPUs, by gloo elsewhere."""
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
