"""What an earlier training left to go on from: a folder with its checkpoint, or a bundle that its network is in.

A bundle's graphs hold the weights by name, 8-bit ones as near as they are kept, so that who has the networks that ship
can teach them more.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from signsplice.errors import InputError
from signsplice.splicing.bundle import BUNDLE_FILE, read_facts, read_file
from signsplice.train import checkpoint
from signsplice.train.export import TRANSPOSED
from signsplice.train.quantization import weights_of
from signsplice.train.task import Task

TAUGHT = "taught.json"
"""What a training was taught of a corpus of pairs, in its folder."""
_WRAPPED = "network."
"""How a graph that is a part of a network begins the names of its weights."""


@dataclass(frozen=True)
class WarmStart:
    """An earlier training of a network: its recipe, with a hash of its files where it comes from a bundle, since those
    may have been tuned; and which corpus of pairs and split of it were among what it learned from, None where none was.
    """

    folder: Path
    recipe: str
    taught: dict[str, str] | None
    files: tuple[str, ...] = ()

    def begin(self, task: Task) -> None:
        """Give a task's network these weights. Raises ``InputError`` where they are another network's."""
        if not self.files:
            checkpoint.begin(self.folder, task)
            return
        facts = read_facts(self.folder)
        load(task.network, [read_file(self.folder, facts, name) for name in self.files], self.folder)


def begin(task: Task, earlier: Sequence[WarmStart]) -> None:
    """Give a task's network the weights of an earlier training, of several the mean.

    The mean of networks that went on from the same weights is often better than each (Wortsman et al. 2022).
    """
    states = []
    for one in earlier:
        one.begin(task)
        states.append({name: values.clone() for name, values in task.state_dict().items()})
    task.load_state_dict({name: torch.stack([state[name] for state in states]).mean(0) for name in states[0]})


def find_warm_start(folder: Path, network: str, files: tuple[str, ...]) -> WarmStart:
    """The training that a folder holds the checkpoint of, or that the ``files`` of a bundle come from. Raises
    ``InputError`` where there is neither.
    """
    if not (folder / BUNDLE_FILE).exists():
        path = folder / TAUGHT
        taught = json.loads(path.read_text()) if path.exists() else None
        return WarmStart(folder, checkpoint.read(folder)["recipe"], taught)
    facts = read_facts(folder)
    told: dict[str, Any] = facts.get("networks", {}).get(network, {})
    if "recipe" not in told:
        raise InputError(f"{folder / BUNDLE_FILE}: tells of no {network}, so that it cannot be gone on with")
    kept = hashlib.sha256("".join(facts["files"].get(name, "") for name in files).encode()).hexdigest()[:12]
    return WarmStart(folder, f"{told['recipe']}@{kept}", told.get("taught"), files)


def load(network: nn.Module, graphs: Iterable[bytes], where: Path) -> None:
    """Give a network the weights that its graphs hold by name. Raises ``InputError`` where they do not hold all."""
    stored: dict[str, Tensor] = {}
    for content in graphs:
        for name, values in weights_of(content).items():
            tensor = torch.from_numpy(np.array(values))
            plain = name.removeprefix(_WRAPPED)
            stored[plain.removesuffix(TRANSPOSED)] = tensor.T if plain.endswith(TRANSPOSED) else tensor
    expected = network.state_dict()
    missing = [name for name in expected if name not in stored or stored[name].shape != expected[name].shape]
    if missing:
        raise InputError(
            f"{where}: holds no weights named {missing[0]} of such a size, so that it cannot be gone on with"
        )
    network.load_state_dict({name: stored[name] for name in expected})
