"""The training loop: one, visible, the same for every network.

Optimisers: SGD with the paper's initial rate 1e-3, no momentum; AdamW with a short warm-up. Both rates fall along a
half cosine to nothing; gradients are clipped to length 1 (neither is said in the paper).
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
from signsplice.train.log import Log
from signsplice.train.prefetch import Dataset
from signsplice.train.processes import Processes
from signsplice.train.task import Task

OPTIMISERS = ("adamw", "sgd")
SGD_RATE = 1e-3
_WARM_UP = 0.05
_CLIP = 1.0
_BLOWN_UP = "the training has blown up; its last checkpoint is sound, and another seed or a lower rate may help"

ProgressCallback = Callable[[int, int, dict[str, float]], None]
"""Step, all steps, and the newest numbers."""


@dataclass(frozen=True)
class LoopConfig:
    """How to train: steps in all, pairs a batch, optimiser and its rate, seed; how often to judge and save, how many
    validation pairs to judge; bf16 where wanted; ``until``: stop there, as an interruption would.
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


def make_optimiser(network: nn.Module, loop: LoopConfig) -> torch.optim.Optimizer:
    """The optimiser of a network's weights. Raises ``InputError`` for an unknown name."""
    weights = [p for p in network.parameters() if p.requires_grad]
    if loop.optimiser == "sgd":
        return torch.optim.SGD(weights, lr=SGD_RATE)
    if loop.optimiser == "adamw":
        return torch.optim.AdamW(weights, lr=loop.rate, weight_decay=0.01)
    raise InputError(f"optimiser {loop.optimiser!r}, expected one of {', '.join(OPTIMISERS)}")


def rate(loop: LoopConfig, step: int) -> float:
    """The learning rate of a step, from 0."""
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
    tell: ProgressCallback | None = None,
) -> int:
    """Train ``task`` in place from where its folder's checkpoint left it; steps done.

    Raises ``InputError`` where there are no pairs, or a batch cannot be shared evenly by the processes.
    """
    if not len(data):
        raise InputError("no pair to train on; choose a split with some, or make a corpus of more words")
    if min(loop.batch, len(data)) % processes.count:
        raise InputError(
            f"batches of {min(loop.batch, len(data))} pairs cannot be shared by {processes.count} processes"
        )
    task.to(processes.device)
    optimiser = make_optimiser(task, loop)
    step = checkpoint.load(folder, task, optimiser, recipe)
    wrapped = DistributedDataParallel(task) if processes.count > 1 else task
    end = loop.steps if loop.until is None else min(loop.until, loop.steps)
    begun, first = time.perf_counter(), step
    with Log(folder, step, processes.first) as log:
        while step < end:
            loss = _step(wrapped, optimiser, loop, data, step, processes)
            step += 1
            if step % max(1, loop.every // 10) == 0 or step == end:
                passed = time.perf_counter() - begun
                seconds = passed / (step - first)
                numbers = {
                    "loss": _finite(_mean(loss, processes), step),
                    "rate": rate(loop, step - 1),
                    "seconds_a_step": seconds,
                }
                log.write(step, **numbers)
                if tell is not None:
                    tell(step, loop.steps, numbers)
            if step % loop.every == 0 or step == end:
                _check_weights(task, step)
            if (step % loop.every == 0 or step == end) and processes.first:
                scores = judge(task, valid, loop, processes)
                log.write(step, **scores)
                if tell is not None:
                    tell(step, loop.steps, scores)
                checkpoint.save(folder, step, task, optimiser, recipe)
        if end == 0 and processes.first:
            checkpoint.save(folder, step, task, optimiser, recipe)
    return step


def _step(
    task: nn.Module, optimiser: torch.optim.Optimizer, loop: LoopConfig, data: Dataset, step: int, processes: Processes
) -> torch.Tensor:
    """One step on this process's share of the batch; its loss."""
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
    nn.utils.clip_grad_norm_(task.parameters(), _CLIP)
    optimiser.step()
    return loss.detach()


def _mean(loss: torch.Tensor, processes: Processes) -> float:
    """The loss of the whole batch."""
    if processes.count > 1:
        torch.distributed.all_reduce(loss)
        loss = loss / processes.count
    return loss.item()


def _finite(loss: float, step: int) -> float:
    if not math.isfinite(loss):
        raise SignspliceError(f"the loss of step {step} is {loss}: {_BLOWN_UP}")
    return loss


def _check_weights(task: nn.Module, step: int) -> None:
    """Raise ``SignspliceError`` before weights are saved that nothing can be learned from any more."""
    if not all(bool(torch.isfinite(p).all()) for p in task.parameters()):
        raise SignspliceError(f"a weight is not finite after step {step}: {_BLOWN_UP}")


@torch.no_grad()
def judge(task: Task, valid: Dataset, loop: LoopConfig, processes: Processes) -> dict[str, float]:
    """Scores on the first pairs of a fixed order of the validation part."""
    if not len(valid):
        return {}
    task.eval()
    rows = stream("judged", len(valid)).permutation(len(valid))[: loop.n_judged]
    shares = [rows[k : k + 64] for k in range(0, len(rows), 64)]
    scores = [task.judge(valid.batch(share).to(processes.device)) for share in shares]
    names = {name for score in scores for name in score}
    return {
        name: sum(score[name] * len(share) for score, share in zip(scores, shares, strict=True) if name in score)
        / sum(len(share) for score, share in zip(scores, shares, strict=True) if name in score)
        for name in sorted(names)
    }
