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


def reason(step: int, steps: int, plateau: bool) -> str:
    """Why a finished training ended after ``step`` of at most ``steps`` steps."""
    return STEPS if step >= steps else PLATEAU if plateau else TIME


def of_parts(reasons: Sequence[str]) -> str:
    """Why the training of a system ended: time if any part's did, else steps if any part's did, else plateau."""
    return next((one for one in (TIME, STEPS) if one in reasons), PLATEAU)
