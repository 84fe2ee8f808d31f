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
from signsplice_workshop.train.export import TRANSPOSED_SUFFIX, read_weights
from signsplice_workshop.train.tasks import Task

PROVENANCE_FILE = "recipe.json"
"""The provenance of a training, in its folder."""
CORPUS_FILE = "taught.json"
"""The corpus of pairs and the split that a training is trained on, in its folder."""
_PREFIX = "network."
"""Prefix of the weights' names in a graph that is a part of a network."""


@dataclass(frozen=True)
class WarmStart:
    """An earlier training of a network.

    - folder: the folder of its checkpoint, or a bundle
    - recipe: hash of the training's recipe; from a bundle, with a hash of the graphs, as weights may have been tuned
    - trained_on: hash of the corpus of pairs and name of the split that it was trained on, None if on none
    - provenance: what bundle.json of the next training says of this one
    - files: the bundle's graphs, empty for a checkpoint
    """

    folder: Path
    recipe: str
    trained_on: dict[str, str] | None
    provenance: dict[str, Any]
    files: tuple[str, ...] = ()

    def load_into(self, task: Task) -> None:
        """Sets a task's network to these weights. Raises ``InputError`` if they are of another network."""
        if not self.files:
            checkpoint.load_weights(self.folder, task)
            return
        config = read_config(self.folder)
        load_graphs(task.network, [read_file(self.folder, config, name) for name in self.files], self.folder)


def find_warm_start(folder: Path, network: str, files: tuple[str, ...]) -> WarmStart:
    """Returns the training whose checkpoint is in a folder, or from which the graphs ``files`` of a bundle come.

    Raises ``InputError`` if the folder is neither, or the bundle does not hold the network.
    """
    if not (folder / BUNDLE_FILE).exists():
        state = checkpoint.read(folder)
        provenance = {"folder": records.shorten_path(folder), "recipe": state["recipe"], "step": int(state["step"])}
        provenance |= _read_json(folder / PROVENANCE_FILE) or {}
        return WarmStart(folder, state["recipe"], _read_json(folder / CORPUS_FILE), provenance)
    config = read_config(folder)
    entry = config.networks.get(network)
    if entry is None or entry.recipe is None:
        raise InputError(
            f"{folder / BUNDLE_FILE}: does not say how its {network} was trained, so training cannot continue from it"
        )
    hashes = {name: config.files.get(name, "") for name in files}
    graphs_hash = hashlib.sha256("".join(hashes.values()).encode()).hexdigest()[:12]
    provenance = {"folder": records.shorten_path(folder), "recipe": entry.recipe, "files": hashes}
    provenance |= {key: entry.stored[key] for key in records.KEYS if key in entry.stored}
    trained_on = None if entry.trained_on is None else dict(entry.trained_on)
    return WarmStart(folder, f"{entry.recipe}@{graphs_hash}", trained_on, provenance, files)


def _read_json(path: Path) -> dict[str, Any] | None:
    return dict(read_json(path, "what a training was made of")) if path.exists() else None


def load_network_entries(bundle: Path) -> dict[str, Any]:
    """Returns a bundle's entries of its networks; empty if there are none. Raises ``InputError`` if it is broken."""
    head = bundle / BUNDLE_FILE
    with format_errors(str(head), "description of a trained system"):
        return dict(read_json(head, "a bundle")["networks"]) if head.exists() else {}


def load_graphs(network: nn.Module, graphs: Iterable[bytes], path: Path) -> None:
    """Sets a network to the weights that its ONNX graphs store by name. Raises ``InputError`` if one is missing or of
    another shape; the message names ``path``.
    """
    stored: dict[str, Tensor] = {}
    for content in graphs:
        for name, values in read_weights(content).items():
            tensor = torch.from_numpy(np.array(values))
            weight_name = name.removeprefix(_PREFIX)
            stored[weight_name.removesuffix(TRANSPOSED_SUFFIX)] = (
                tensor.T if weight_name.endswith(TRANSPOSED_SUFFIX) else tensor
            )
    expected = network.state_dict()
    missing = [name for name in expected if name not in stored or stored[name].shape != expected[name].shape]
    if missing:
        raise InputError(
            f"{path}: holds no weights {missing[0]} of shape {tuple(expected[missing[0]].shape)}, so training cannot "
            "continue from it"
        )
    network.load_state_dict({name: stored[name] for name in expected})
