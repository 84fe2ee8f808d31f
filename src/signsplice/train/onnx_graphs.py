"""The product's networks as ONNX graphs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from signsplice.splicing.networks.features import N_FRAME
from signsplice.train.export import ExportGraph, exported
from signsplice.train.networks.cutting import ChooseGraph, Cutting, ReadGraph, TimeGraph
from signsplice.train.prefetch import Dataset
from signsplice.train.task import Task


def product_graphs(task: Task, valid: Dataset) -> dict[str, bytes]:
    """ONNX graphs of a task's network by file name, compared with torch on validation data.

    Raises ``SignspliceError`` where onnxruntime and torch differ.
    """
    network = task.network.eval().cpu()
    if isinstance(network, Cutting):
        graphs = _cutting_graphs(network, [valid.batch([k]) for k in range(3)])
    else:
        # The example is a batch of several gaps, because the exporter would take a size of 1 for a constant.
        batches = [valid.batch(rows) for rows in ([0, 1, 2], [3], [4, 5])]
        inputs = [{"tokens": batch.tokens, "mask": batch.mask} for batch in batches]
        free: dict[str, tuple[int, ...]] = {"tokens": (0, 1), "mask": (0, 1)}
        graphs = {"bridge": ExportGraph(network, inputs[0], ("turns",), free, tuple(inputs[1:]))}
    return {f"{name}.onnx": exported(name, graph) for name, graph in graphs.items()}


def _cutting_graphs(network: Cutting, batches: Sequence[Any]) -> dict[str, ExportGraph]:
    """The graphs of a cutting network, with the first two words of each batch as example and as other inputs."""
    words = [batch.tokens[:, k][batch.mask[:, k]][None] for batch in batches for k in (0, 1)]
    with torch.no_grad():
        readings = [network.read(tokens) for tokens in words]
    pairs = [
        {"before": before[0], "leave": before[1], "after": after[0], "enter": after[2]}
        for before, after in zip(readings[::2], readings[1::2], strict=True)
    ]
    ends = [
        {"leaving": p[:, 3, :N_FRAME], "entering": q[:, 5, :N_FRAME], "leave": pair["leave"], "enter": pair["enter"]}
        for p, q, pair in zip(words[::2], words[1::2], pairs, strict=True)
    ]
    tokens = [{"tokens": word} for word in words]
    outputs = ("states", "leave", "enter", "phases")
    return {
        "word": ExportGraph(ReadGraph(network), tokens[0], outputs, {"tokens": (1,)}, tuple(tokens[1:])),
        "cut": ExportGraph(
            ChooseGraph(network), pairs[0], ("left", "entered"), {"before": (1,), "after": (1,)}, tuple(pairs[1:])
        ),
        "duration": ExportGraph(TimeGraph(network), ends[0], ("seconds",), {}, tuple(ends[1:])),
    }
