"""When the training of a part ends before its last step: on a plateau, when its processor time is spent, or at a
deadline; and SGD, by which the paper trains.

A plateau and spent processor time are properties of the training, read from its log: an interrupted training ends at
the same validation as one that was not. After them the training is finished. A deadline only interrupts.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn

from signsplice.errors import InputError, SignspliceError
from signsplice.formats.atomic import replacing
from signsplice_workshop.train import records
from signsplice_workshop.train.loop import LoopConfig
from signsplice_workshop.train.processes import Processes
from signsplice_workshop.train.tasks import Task

OPTIMISERS = ("adamw", "sgd")
SGD_RATE = 1e-3
"""The paper's initial rate. It names no later one: the rate is constant until validation stops improving."""
SNAPSHOTS = "snapshots"
"""Folder of the weights at every validation, beside the checkpoint."""
PLATEAU, STEPS, TIME = "plateau", "steps", "time"
"""Why a training ended: validation stopped improving, all steps were done, or its processor time was spent."""
LEAST_IMPROVEMENT = 1e-3
"""Fraction of the best validation loss by which a later one must be lower to count as an improvement."""
VALIDATION_LOSS = "valid_loss"
"""Name of the validation loss in a log; ``loss`` is that of training."""


def highest_rate(method: str, rate: float) -> float:
    """Returns the highest learning rate of an optimiser, for a part that AdamW trains with ``rate``."""
    return SGD_RATE if method == "sgd" else rate


class DeadlineError(SignspliceError):
    """Raised when a deadline has passed. The checkpoint is written, and the same call continues."""


@dataclass(frozen=True)
class PaperLoop(LoopConfig):
    """How a part of a system is trained.

    - method: one of ``OPTIMISERS``; sgd has no momentum, and a rate of its own
    - snapshots: whether to keep the weights of every validation, from which curves of whole systems are judged later
    - patience: number of validations in a row without improvement that ends the training; None: it ends after ``steps``
    - most_cpu_s: processor seconds that end the training, None for no limit
    - deadline: value of ``time.monotonic``, s, at which this call is interrupted, None for never

    Raises ``InputError`` for an unknown method.
    """

    method: str = "adamw"
    snapshots: bool = False
    patience: int | None = None
    most_cpu_s: float | None = None
    deadline: float | None = None

    def __post_init__(self) -> None:
        if self.method not in OPTIMISERS:
            raise InputError(f"optimiser {self.method!r}, expected one of {', '.join(OPTIMISERS)}")

    def optimiser(self, weights: list[nn.Parameter]) -> torch.optim.Optimizer:
        """Returns SGD without momentum, or AdamW."""
        if self.method == "adamw":
            return super().optimiser(weights)
        return torch.optim.SGD(weights, lr=SGD_RATE)

    def rate_at(self, step: int) -> float:
        """Returns the learning rate of a step, which counts from 0."""
        return SGD_RATE if self.method == "sgd" else super().rate_at(step)

    def has_ended(self, folder: Path, step: int, processes: Processes) -> bool:
        """Returns whether validation is on a plateau, or the processor time is spent."""
        if self.patience is None and self.most_cpu_s is None:
            return False
        return processes.broadcast_choice(has_ended(folder, step, self.patience, self.most_cpu_s))

    def interruption(self, step: int, processes: Processes) -> SignspliceError | None:
        """Returns a ``DeadlineError`` if time is up."""
        if self.deadline is None or not processes.broadcast_choice(time.monotonic() >= self.deadline):
            return None
        return DeadlineError(f"time is up after step {step} of {self.steps}; the same call continues")

    def scores(self, task: Task, batch: Any) -> dict[str, float]:
        """Returns the scores of a validation batch, and its loss if the training may end on a plateau."""
        loss = {} if self.patience is None else {VALIDATION_LOSS: task(batch).item()}
        return super().scores(task, batch) | loss

    def on_validation_end(self, folder: Path, step: int, task: Task) -> None:
        """Writes a snapshot."""
        if self.snapshots:
            path = snapshot_path(folder, step)
            path.parent.mkdir(exist_ok=True)
            with replacing(path) as temporary_file:
                torch.save(task.state_dict(), temporary_file)


def snapshot_path(folder: Path, step: int) -> Path:
    """Returns the file of the weights after ``step`` steps."""
    return folder / SNAPSHOTS / f"{step:07d}.pt"


def on_plateau(losses: Sequence[float], patience: int) -> bool:
    """Returns whether the last ``patience`` validation losses improve on all before by less than
    ``LEAST_IMPROVEMENT``.
    """
    if len(losses) <= patience:
        return False
    best = min(losses[:-patience])
    return min(losses[-patience:]) > best - LEAST_IMPROVEMENT * abs(best)


def read_losses(folder: Path, step: int) -> list[float]:
    """Returns the validation losses in a training's log up to a step."""
    return [
        line[VALIDATION_LOSS]
        for line in records.read_lines(folder / records.LOG_FILE)
        if VALIDATION_LOSS in line and line["step"] <= step
    ]


def has_ended(folder: Path, step: int, patience: int | None, most_cpu_s: float | None) -> bool:
    """Returns whether a training has ended, at ``step``, before its last step."""
    if most_cpu_s is not None:
        loss_lines = [
            line for line in records.read_lines(folder / records.LOG_FILE) if line["step"] == step and "loss" in line
        ]
        if any(line.get("cpu_s", 0.0) >= most_cpu_s for line in loss_lines):
            return True
    return patience is not None and on_plateau(read_losses(folder, step), patience)


def find_reason(folder: Path, steps: int, patience: int | None) -> tuple[int, str]:
    """Returns how many steps a finished training of at most ``steps`` took, and why it ended."""
    step = max((line["step"] for line in records.read_lines(folder / records.LOG_FILE)), default=0)
    if step >= steps:
        return step, STEPS
    is_on_plateau = patience is not None and on_plateau(read_losses(folder, step), patience)
    return step, PLATEAU if is_on_plateau else TIME
