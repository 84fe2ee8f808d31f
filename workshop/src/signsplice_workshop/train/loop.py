"""The training loop, the same for every network.

The optimiser is AdamW, whose rate rises over a short warm-up and falls to 0 along half a cosine; gradients are clipped
to norm 1. A subclass of ``LoopConfig`` may train by another, end earlier, and keep more, as the paper's does.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn
from torch.nn.parallel import DistributedDataParallel

from signsplice.errors import InputError, SignspliceError
from signsplice.signer.signer import stream
from signsplice_workshop.train import checkpoint
from signsplice_workshop.train.prefetch import Dataset
from signsplice_workshop.train.processes import Processes
from signsplice_workshop.train.records import Log, read_cpu_seconds
from signsplice_workshop.train.tasks import Task

_WARM_UP = 0.05
"""Fraction of the steps over which AdamW's rate rises."""
CHECKPOINT_S = 120.0
"""Longest time without a checkpoint, if validations are rarer."""
_MAX_GRADIENT_NORM = 1.0
_DIVERGED = "the training has diverged; its last checkpoint is still good, and another seed or a lower rate may help"

ProgressCallback = Callable[[int, int, dict[str, float]], None]
"""Called with the step, the number of steps, and the latest numbers by name: a loss with its rate, or scores; none if a
training continues.
"""


@dataclass(frozen=True)
class LoopConfig:
    """How to train.

    - steps: number of steps
    - batch: examples in a batch
    - rate: highest learning rate
    - seed: of batches and dropout
    - every: steps from one validation and checkpoint to the next
    - n_judged: number of validation examples
    - bf16: whether to compute in bfloat16
    - until: the step to stop at, as an interruption would; None: ``steps``
    """

    steps: int
    batch: int
    rate: float
    seed: int
    every: int = 250
    n_judged: int = 256
    bf16: bool = False
    until: int | None = None

    def optimiser(self, weights: list[nn.Parameter]) -> torch.optim.Optimizer:
        """Returns the optimiser of a network's trainable weights."""
        return torch.optim.AdamW(weights, lr=self.rate, weight_decay=0.01)

    def rate_at(self, step: int) -> float:
        """Returns the learning rate of a step, which counts from 0."""
        cosine = 0.5 * (1.0 + math.cos(math.pi * step / self.steps))
        return self.rate * min(1.0, (step + 1) / max(1.0, _WARM_UP * self.steps)) * cosine

    def has_ended(self, folder: Path, step: int, processes: Processes) -> bool:
        """Returns whether the training ends at this step, by its log, before the last one."""
        return False

    def interruption(self, step: int, processes: Processes) -> SignspliceError | None:
        """Returns the error that interrupts this call after this step, until it is repeated; None for no
        interruption.
        """
        return None

    def scores(self, task: Task, batch: Any) -> dict[str, float]:
        """Returns the scores of a validation batch by name."""
        return task.judge(batch)

    def on_validation_end(self, folder: Path, step: int, task: Task) -> None:
        """Keeps results of a validation besides its scores and the checkpoint; nothing by default."""


def train(
    task: Task,
    loop: LoopConfig,
    data: Dataset,
    valid: Dataset,
    folder: Path,
    recipe: str,
    processes: Processes,
    report_progress: ProgressCallback | None = None,
) -> int:
    """Trains ``task`` in place, from the folder's checkpoint on if there is one; returns the number of steps done.

    Raises ``InputError`` if there are no examples or the processes cannot divide a batch evenly, ``SignspliceError`` if
    it diverges, and ``loop.interruption``.
    """
    if not len(data):
        raise InputError("no pair to train on; choose a split with some, or make a corpus of more words")
    if (n_examples := len(data.rows(0, loop.batch, loop.seed))) % processes.count:
        raise InputError(
            f"batches of {n_examples} examples cannot be divided among {processes.count} processes; choose a number of "
            "processes that divides them"
        )
    if (first_recipe := processes.broadcast_value(recipe)) != recipe:
        raise InputError(
            f"process {processes.rank} has other data or options than process 0 ({recipe}, not {first_recipe})"
        )
    task.to(processes.device)
    optimiser = loop.optimiser([parameter for parameter in task.parameters() if parameter.requires_grad])
    step = checkpoint.load(folder, task, optimiser, recipe, processes)
    wrapped_task = DistributedDataParallel(task) if processes.count > 1 else task
    end = loop.steps if loop.until is None else min(loop.until, loop.steps)
    report = report_progress or (lambda *_: None)
    if step:
        report(step, loop.steps, {})
    with Log(folder, step, processes.first) as log, _report_interrupt(
        _Call(task, optimiser, loop, valid, folder, recipe, processes, log, report, step)
    ) as call:  # fmt: skip
        if loop.has_ended(folder, step, processes):
            end = step
        while step < end:
            call.save_if_due(step)
            loss = _train_step(wrapped_task, optimiser, loop, data, step, processes)
            step += 1
            if step % max(1, loop.every // 10) == 0 or step == end:
                call.log_loss(step, loss)
                if loop.has_ended(folder, step, processes):
                    end = step
            if step % loop.every == 0 or step == end:
                call.validate(step)
                if loop.has_ended(folder, step, processes):
                    end = step
    return step


class _Call:
    """What one call of ``train`` writes while it trains; ``first``: the step that it started from."""

    def __init__(
        self, task: Task, optimiser: torch.optim.Optimizer, loop: LoopConfig, valid: Dataset, folder: Path, recipe: str,
        processes: Processes, log: Log, report: ProgressCallback, first: int,
    ) -> None:  # fmt: skip
        self.task, self.optimiser, self.loop, self.valid = task, optimiser, loop, valid
        self.folder, self.recipe, self.processes = folder, recipe, processes
        self.log, self.report, self.first = log, report, first
        self.saved_step = first
        self.started = self.saved = time.perf_counter()
        self.cpu_before = read_cpu_seconds(folder, first) - time.process_time()

    @property
    def cpu_s(self) -> float:
        """Returns the processor seconds of this process's part of the training, in this call and those before."""
        return round(self.cpu_before + time.process_time(), 3)

    def log_loss(self, step: int, loss: torch.Tensor) -> None:
        mean = _average_loss(loss, self.processes)
        if not math.isfinite(mean):
            raise SignspliceError(f"the loss of step {step} is {mean}: {_DIVERGED}")
        numbers = {
            "loss": mean,
            "rate": self.loop.rate_at(step - 1),
            "seconds_a_step": (time.perf_counter() - self.started) / (step - self.first),
            "cpu_s": self.cpu_s,
        }
        self.log.write(step, **numbers)
        self.report(step, self.loop.steps, numbers)

    def validate(self, step: int) -> None:
        _check_weights(self.task, step)
        if not self.processes.first:
            return
        scores = judge(self.task, self.valid, self.loop, self.processes)
        self.log.write(step, **scores, cpu_s=self.cpu_s)
        self.report(step, self.loop.steps, scores)
        self.save(step)
        self.loop.on_validation_end(self.folder, step, self.task)

    def save(self, step: int) -> None:
        checkpoint.save(self.folder, step, self.task, self.optimiser, self.recipe)
        self.saved, self.saved_step = time.perf_counter(), step

    def save_if_due(self, step: int) -> None:
        """Writes a checkpoint if the last one is long ago or the call is interrupted; raises the interruption."""
        interruption = self.loop.interruption(step, self.processes)
        is_due = self.processes.first and time.perf_counter() - self.saved > CHECKPOINT_S
        if interruption is None and not is_due:
            return
        if step > self.first:
            _check_weights(self.task, step)
            if self.processes.first:
                self.log.write(step, cpu_s=self.cpu_s)
                self.save(step)
        if interruption is not None:
            raise interruption


@contextmanager
def _report_interrupt(call: _Call) -> Iterator[_Call]:
    """Yields the call; an interrupt of it says which step is kept."""
    try:
        yield call
    except KeyboardInterrupt:
        message = f"step {call.saved_step} of {call.loop.steps} is kept in {call.folder}" if call.saved_step else ""
        raise KeyboardInterrupt(f"{message or 'no step is kept yet'}; the same command continues from there") from None


def _train_step(
    task: nn.Module, optimiser: torch.optim.Optimizer, loop: LoopConfig, data: Dataset, step: int, processes: Processes
) -> torch.Tensor:
    """Returns the loss () of one step on this process's part of the batch."""
    torch.manual_seed(int(stream("dropout", loop.seed, step, processes.rank).integers(2**62)))
    rows = data.rows(step, loop.batch, loop.seed)[processes.rank :: processes.count]
    batch = data.batch(rows, step).to(processes.device)
    for group in optimiser.param_groups:
        group["lr"] = loop.rate_at(step)
    task.train()
    with torch.autocast(processes.device.type, torch.bfloat16, enabled=loop.bf16):
        loss: torch.Tensor = task(batch)
    optimiser.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    nn.utils.clip_grad_norm_(task.parameters(), _MAX_GRADIENT_NORM)
    optimiser.step()
    return loss.detach()


def _average_loss(loss: torch.Tensor, processes: Processes) -> float:
    """Returns the loss of the whole batch: the mean over the processes."""
    if processes.count > 1:
        torch.distributed.all_reduce(loss)
        loss = loss / processes.count
    return loss.item()


def _check_weights(task: nn.Module, step: int) -> None:
    """Raises ``SignspliceError`` if a weight is not finite, before the weights are saved."""
    if not all(bool(torch.isfinite(parameter).all()) for parameter in task.parameters()):
        raise SignspliceError(f"a weight is not finite after step {step}: {_DIVERGED}")


@torch.no_grad()
def judge(task: Task, valid: Dataset, loop: LoopConfig, processes: Processes) -> dict[str, float]:
    """Returns scores on the first ``n_judged`` validation examples of a fixed random order; empty if there are none."""
    if not len(valid):
        return {}
    task.eval()
    rows = stream("judged", len(valid)).permutation(len(valid))[: loop.n_judged]
    batch_scores = []
    for k in range(0, len(rows), 64):
        batch = valid.batch(rows[k : k + 64]).to(processes.device)
        batch_scores.append((loop.scores(task, batch), len(rows[k : k + 64])))
    names = sorted({name for scores, _ in batch_scores for name in scores})
    return {
        name: sum(scores[name] * n_examples for scores, n_examples in batch_scores if name in scores)
        / sum(n_examples for scores, n_examples in batch_scores if name in scores)
        for name in names
    }
