"""Weights to start a training from: an earlier training's checkpoint, or a bundle that holds the network.

A bundle's graphs store weights by name, so that the networks that ship can be trained further. 16-bit weights are
widened.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from signsplice.errors import InputError
from signsplice.formats.json_files import read_json
from signsplice.formats.reading import format_errors
from signsplice.splicing.bundle import BUNDLE_FILE, read_config, read_file
from signsplice_workshop.train import checkpoint, records
from signsplice_workshop.train.export import TRANSPOSED, weights_of
from signsplice_workshop.train.tasks import Task

PROVENANCE_FILE = "recipe.json"
"""What a training is made of, in its folder."""
CORPUS_FILE = "taught.json"
"""Which corpus of pairs and which of its splits a training is trained on, in its folder."""
_PREFIX = "network."
"""Prefix of the weights' names in a graph that is a part of a network."""


@dataclass(frozen=True)
class WarmStart:
    """An earlier training of a network.

    - folder: the folder of its checkpoint, or a bundle
    - recipe: the training's recipe; from a bundle, with a hash of the graphs, because the weights may have been tuned
    - trained_on: hash of the corpus of pairs and name of the split that it was trained on, None where on none
    - provenance: what bundle.json of the next training says of this one
    - files: the bundle's graphs, empty for a checkpoint
    """

    folder: Path
    recipe: str
    trained_on: dict[str, str] | None
    provenance: dict[str, Any]
    files: tuple[str, ...] = ()

    def load_into(self, task: Task) -> None:
        """Set a task's network to these weights. Raises ``InputError`` where they are of another network."""
        if not self.files:
            checkpoint.load_weights(self.folder, task)
            return
        config = read_config(self.folder)
        load_graphs(task.network, [read_file(self.folder, config, name) for name in self.files], self.folder)


def find_warm_start(folder: Path, network: str, files: tuple[str, ...]) -> WarmStart:
    """The training whose checkpoint is in a folder, or which the graphs ``files`` of a bundle come from.

    Raises ``InputError`` where the folder is neither, or the bundle does not hold the network.
    """
    if not (folder / BUNDLE_FILE).exists():
        state = checkpoint.read(folder)
        made_of = {"folder": records.portable(folder), "recipe": state["recipe"], "step": int(state["step"])}
        made_of |= _read_json(folder / PROVENANCE_FILE) or {}
        return WarmStart(folder, state["recipe"], _read_json(folder / CORPUS_FILE), made_of)
    config = read_config(folder)
    known = config.networks.get(network)
    if known is None or known.recipe is None:
        raise InputError(
            f"{folder / BUNDLE_FILE}: does not say how its {network} was trained, so training cannot continue from it"
        )
    hashes = {name: config.files.get(name, "") for name in files}
    graphs_hash = hashlib.sha256("".join(hashes.values()).encode()).hexdigest()[:12]
    made_of = {"folder": records.portable(folder), "recipe": known.recipe, "files": hashes}
    made_of |= {key: known.stored[key] for key in records.KEYS if key in known.stored}
    trained_on = None if known.trained_on is None else dict(known.trained_on)
    return WarmStart(folder, f"{known.recipe}@{graphs_hash}", trained_on, made_of, files)


def _read_json(path: Path) -> dict[str, Any] | None:
    return dict(read_json(path, "what a training was made of")) if path.exists() else None


def load_network_entries(out: Path) -> dict[str, Any]:
    """What a bundle says of its networks; nothing where there is none. Raises ``InputError`` where it is broken."""
    head = out / BUNDLE_FILE
    with format_errors(str(head), "description of a trained system"):
        return dict(read_json(head, "a bundle")["networks"]) if head.exists() else {}


def load_graphs(network: nn.Module, graphs: Iterable[bytes], where: Path) -> None:
    """Set a network to the weights that its ONNX graphs store by name. Raises ``InputError`` where one is missing or of
    another shape; ``where`` is named in the message.
    """
    stored: dict[str, Tensor] = {}
    for content in graphs:
        for name, values in weights_of(content).items():
            tensor = torch.from_numpy(np.array(values))
            plain = name.removeprefix(_PREFIX)
            stored[plain.removesuffix(TRANSPOSED)] = tensor.T if plain.endswith(TRANSPOSED) else tensor
    expected = network.state_dict()
    missing = [name for name in expected if name not in stored or stored[name].shape != expected[name].shape]
    if missing:
        raise InputError(
            f"{where}: holds no weights {missing[0]} of shape {tuple(expected[missing[0]].shape)}, so training cannot "
            "continue from it"
        )
    network.load_state_dict({name: stored[name] for name in expected})
