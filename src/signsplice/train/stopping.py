"""When a training ends before its last step: on a plateau, when its processor time is spent, or at a deadline.

A plateau and spent processor time are properties of the training, read from its log: an interrupted training ends at
the same validation as one that was not. After them the training is finished. A deadline only interrupts.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from signsplice.errors import SignspliceError
from signsplice.train import log as logs

PLATEAU, STEPS, TIME = "plateau", "steps", "time"
"""Why a training ended: validation improved no more, all steps were done, or its processor time was spent."""
LEAST = 1e-3
"""The fraction of the best validation loss by which a later one has to be lower to count as an improvement."""
LOSS = "valid_loss"
"""Name of the validation loss in a log."""


class DeadlineError(SignspliceError):
    """A deadline has passed. The checkpoint is written, and the same call continues."""


def on_plateau(losses: Sequence[float], patience: int) -> bool:
    """Whether the last ``patience`` validation losses improved on all before by less than ``LEAST``."""
    if len(losses) <= patience:
        return False
    best = min(losses[:-patience])
    return min(losses[-patience:]) > best - LEAST * abs(best)


def losses(folder: Path, step: int) -> list[float]:
    """The validation losses in a training's log up to a step."""
    return [line[LOSS] for line in logs.lines(folder / logs.NAME) if LOSS in line and line["step"] <= step]


def cpu_seconds(folder: Path, step: int) -> float:
    """Processor seconds in a training's log up to a step, of the first process; 0 without a log."""
    lines = logs.lines(folder / logs.NAME)
    return max((line.get("cpu_s", 0.0) for line in lines if line["step"] <= step), default=0.0)


def has_ended(folder: Path, step: int, patience: int | None, most_cpu_s: float | None) -> bool:
    """Whether a training that was called again has ended, at ``step``, before its last step."""
    if most_cpu_s is not None:
        trained = [line for line in logs.lines(folder / logs.NAME) if line["step"] == step and "loss" in line]
        if any(line.get("cpu_s", 0.0) >= most_cpu_s for line in trained):
            return True
    return patience is not None and on_plateau(losses(folder, step), patience)


def reason(folder: Path, steps: int, patience: int | None) -> tuple[int, str]:
    """How many steps a finished training of at most ``steps`` took, and why it ended."""
    step = max((line["step"] for line in logs.lines(folder / logs.NAME)), default=0)
    if step >= steps:
        return step, STEPS
    plateau = patience is not None and on_plateau(losses(folder, step), patience)
    return step, PLATEAU if plateau else TIME
