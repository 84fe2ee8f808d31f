"""The training loop, the same for every network.

Optimisers: SGD with the paper's initial rate 1e-3 and no momentum; AdamW with a short warm-up. Both rates decrease to 0
along half a cosine, and gradients are clipped to norm 1; the paper specifies neither.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn
from torch.nn.parallel import DistributedDataParallel

from signsplice.errors import InputError, SignspliceError
from signsplice.synth.rng import stream
from signsplice.train import checkpoint
from signsplice.train.log import NAME, Log, lines
from signsplice.train.prefetch import Dataset
from signsplice.train.processes import Processes
from signsplice.train.task import Task

OPTIMISERS = ("adamw", "sgd")
SGD_RATE = 1e-3
_WARM_UP = 0.05
"""Fraction of the steps over which AdamW's rate rises."""
_MAX_GRADIENT_NORM = 1.0
_DIVERGED = "the training has diverged; its last checkpoint is still good, and another seed or a lower rate may help"

ProgressCallback = Callable[[int, int, dict[str, float]], None]
"""Called with the step, the number of steps, and the latest numbers by name: a loss with its rate, or scores."""


@dataclass(frozen=True)
class LoopConfig:
    """How to train.

    - steps: number of steps
    - batch: examples in a batch
    - optimiser: one of ``OPTIMISERS``
    - rate: highest learning rate of AdamW; SGD has the paper's
    - seed: of batches and dropout
    - every: steps from one validation and checkpoint to the next
    - n_judged: validation examples
    - bf16: whether to compute in bfloat16
    - until: the step to stop at, as an interruption would; None: ``steps``
    - snapshots: whether to keep the weights of every validation
    """

    steps: int
    batch: int
    optimiser: str
    rate: float
    seed: int
    every: int = 250
    n_judged: int = 256
    bf16: bool = False
    until: int | None = None
    snapshots: bool = False


def make_optimiser(network: nn.Module, loop: LoopConfig) -> torch.optim.Optimizer:
    """An optimiser of a network's trainable weights. Raises ``InputError`` for an unknown name."""
    weights = [p for p in network.parameters() if p.requires_grad]
    if loop.optimiser == "sgd":
        return torch.optim.SGD(weights, lr=SGD_RATE)
    if loop.optimiser == "adamw":
        return torch.optim.AdamW(weights, lr=loop.rate, weight_decay=0.01)
    raise InputError(f"optimiser {loop.optimiser!r}, expected one of {', '.join(OPTIMISERS)}")


def rate(loop: LoopConfig, step: int) -> float:
    """The learning rate of a step, which counts from 0."""
    cosine = 0.5 * (1.0 + math.cos(math.pi * step / loop.steps))
    if loop.optimiser == "sgd":
        return SGD_RATE * cosine
    return loop.rate * min(1.0, (step + 1) / max(1.0, _WARM_UP * loop.steps)) * cosine


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
    """Train ``task`` in place, from the folder's checkpoint on if there is one; returns the number of steps done.

    Raises ``InputError`` where there are no examples, or the processes cannot divide a batch evenly, and
    ``SignspliceError`` where the training diverges.
    """
    if not len(data):
        raise InputError("no pair to train on; choose a split with some, or make a corpus of more words")
    if min(loop.batch, len(data)) % processes.count:
        raise InputError(
            f"batches of {min(loop.batch, len(data))} examples cannot be divided among {processes.count} processes"
        )
    task.to(processes.device)
    optimiser = make_optimiser(task, loop)
    step = checkpoint.load(folder, task, optimiser, recipe)
    wrapped = DistributedDataParallel(task) if processes.count > 1 else task
    end = loop.steps if loop.until is None else min(loop.until, loop.steps)
    report = report_progress or (lambda *_: None)
    started, first = time.perf_counter(), step
    cpu_before = _cpu_seconds(folder, step) - time.process_time()
    with Log(folder, step, processes.first) as log:
        while step < end:
            loss = _step(wrapped, optimiser, loop, data, step, processes)
            step += 1
            if step % max(1, loop.every // 10) == 0 or step == end:
                numbers = {
                    "loss": _finite(_mean(loss, processes), step),
                    "rate": rate(loop, step - 1),
                    "seconds_a_step": (time.perf_counter() - started) / (step - first),
                    "cpu_s": cpu_before + time.process_time(),
                }
                log.write(step, **numbers)
                report(step, loop.steps, numbers)
            if step % loop.every == 0 or step == end:
                _check_weights(task, step)
            if (step % loop.every == 0 or step == end) and processes.first:
                scores = judge(task, valid, loop, processes)
                log.write(step, **scores, cpu_s=cpu_before + time.process_time())
                report(step, loop.steps, scores)
                checkpoint.save(folder, step, task, optimiser, recipe)
                if loop.snapshots:
                    checkpoint.save_snapshot(folder, step, task)
        if end == 0 and processes.first:
            checkpoint.save(folder, step, task, optimiser, recipe)
    return step


def _step(
    task: nn.Module, optimiser: torch.optim.Optimizer, loop: LoopConfig, data: Dataset, step: int, processes: Processes
) -> torch.Tensor:
    """The loss () of one step on this process's part of the batch."""
    torch.manual_seed(int(stream("dropout", loop.seed, step, processes.rank).integers(2**62)))
    rows = data.rows(step, loop.batch, loop.seed)[processes.rank :: processes.count]
    batch = data.batch(rows, step).to(processes.device)
    for group in optimiser.param_groups:
        group["lr"] = rate(loop, step)
    task.train()
    with torch.autocast(processes.device.type, torch.bfloat16, enabled=loop.bf16):
        loss: torch.Tensor = task(batch)
    optimiser.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    nn.utils.clip_grad_norm_(task.parameters(), _MAX_GRADIENT_NORM)
    optimiser.step()
    return loss.detach()


def _mean(loss: torch.Tensor, processes: Processes) -> float:
    """The loss of the whole batch: the mean over the processes."""
    if processes.count > 1:
        torch.distributed.all_reduce(loss)
        loss = loss / processes.count
    return loss.item()


def _cpu_seconds(folder: Path, step: int) -> float:
    """Processor seconds that this process's part of the training took up to ``step``, from its log; 0 without one."""
    return max((line.get("cpu_s", 0.0) for line in lines(folder / NAME) if line["step"] <= step), default=0.0)


def _finite(loss: float, step: int) -> float:
    if not math.isfinite(loss):
        raise SignspliceError(f"the loss of step {step} is {loss}: {_DIVERGED}")
    return loss


def _check_weights(task: nn.Module, step: int) -> None:
    """Raise ``SignspliceError`` where a weight is not finite, before the weights are saved."""
    if not all(bool(torch.isfinite(p).all()) for p in task.parameters()):
        raise SignspliceError(f"a weight is not finite after step {step}: {_DIVERGED}")


@torch.no_grad()
def judge(task: Task, valid: Dataset, loop: LoopConfig, processes: Processes) -> dict[str, float]:
    """Scores on the first ``n_judged`` validation examples of a fixed random order; empty where there are none."""
    if not len(valid):
        return {}
    task.eval()
    rows = stream("judged", len(valid)).permutation(len(valid))[: loop.n_judged]
    batches = [rows[k : k + 64] for k in range(0, len(rows), 64)]
    scored = [(task.judge(valid.batch(batch).to(processes.device)), len(batch)) for batch in batches]
    names = sorted({name for scores, _ in scored for name in scores})
    return {
        name: sum(scores[name] * n for scores, n in scored if name in scores)
        / sum(n for scores, n in scored if name in scores)
        for name in names
    }
