"""Checkpoints: a training's complete state at a step, written whole or not at all.

No state of random generators is stored, because batches, noise and dropout are drawn from the seed and the step.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import nn

from signsplice.errors import InputError
from signsplice.formats import atomic
from signsplice_workshop.train.processes import ALONE, Processes

NAME = "checkpoint.pt"


def save(folder: Path, step: int, network: nn.Module, optimiser: torch.optim.Optimizer, recipe: str) -> None:
    """Writes the state after ``step`` steps. ``recipe``: hash of all that the training depends on except the code."""
    state = {"step": step, "recipe": recipe, "network": network.state_dict(), "optimiser": optimiser.state_dict()}
    content = io.BytesIO()  # in memory first: torch would report a full disk by an error of its own
    torch.save(state, content)
    atomic.write(folder / NAME, content.getbuffer())


def load(
    folder: Path,
    network: nn.Module,
    optimiser: torch.optim.Optimizer | None,
    recipe: str,
    processes: Processes = ALONE,
) -> int:
    """Returns the number of steps done, with network and optimiser set to the checkpoint's state; 0 if there is none.

    The first process reads it and sends it to the others, whose machines may not have it. Raises ``InputError`` if it
    is broken or of another training.
    """
    path = folder / NAME
    state = processes.broadcast_value(read(folder) if processes.first and path.exists() else None)
    if state is None:
        return 0
    if state["recipe"] != recipe:
        raise InputError(f"{path}: of another training ({state['recipe']}, not {recipe}); name another folder")
    with _convert_read_errors(path):
        network.load_state_dict(state["network"])
        if optimiser is not None:
            optimiser.load_state_dict(state["optimiser"])
    return int(state["step"])


def read(folder: Path) -> dict[str, Any]:
    """Returns a checkpoint's step, recipe, network and optimiser. Raises ``InputError`` if it is missing or broken."""
    with _convert_read_errors(folder / NAME):
        state: dict[str, Any] = torch.load(folder / NAME, map_location="cpu", weights_only=True)
        return {name: state[name] for name in ("step", "recipe", "network", "optimiser")}


def load_weights(folder: Path, network: nn.Module) -> None:
    """Sets a network to the weights of a checkpoint. Raises ``InputError`` if that is missing, broken, or of another
    network.
    """
    state = read(folder)
    with _convert_read_errors(folder / NAME):
        network.load_state_dict(state["network"])


@contextmanager
def _convert_read_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # a damaged file may raise anything
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: cannot be read ({reason}); remove it to start again from step 0") from error
