"""Trained networks as ONNX graphs, compared with torch before they are kept."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from signsplice.errors import InputError, SignspliceError
from signsplice.formats.atomic import check_place
from signsplice.splicing.bundle import BUNDLE_FILE
from signsplice.splicing.runtime import onnxruntime
from signsplice.splicing.word_features import N_FRAME
from signsplice.train.networks.cutting import ChooseGraph, Cutting, ReadGraph, TimeGraph
from signsplice.train.prefetch import Dataset
from signsplice.train.task import Task

TOLERANCE = 1e-4
"""Largest difference between torch and onnxruntime, relative for numbers above 1."""
_FREE = torch.export.Dim.DYNAMIC
TRANSPOSED = ".T"
"""Suffix of the name of a weight that a graph holds transposed."""


def check_bundle_folder(out: Path) -> None:
    """Raise ``InputError`` if ``out`` holds files but no bundle, so that nothing else is overwritten, or is a link or a
    mount point.
    """
    if out.parent.is_dir():
        check_place(out)
    if out.is_dir() and any(out.iterdir()) and not (out / BUNDLE_FILE).exists() and not any(out.glob("*.onnx")):
        raise InputError(f"{out}: is there already and is no bundle; choose a new name")


@dataclass(frozen=True)
class ExportGraph:
    """A module to export.

    - module: takes the inputs in order and returns a tensor, or a tuple of tensors
    - inputs: example inputs by name
    - outputs: names of the outputs
    - free: dimensions of variable size, by input
    - checks: other inputs to compare on
    - n_named: how many parameters ``module.forward`` names; the other inputs go to its ``*args``; None for all
    """

    module: nn.Module
    inputs: dict[str, Tensor]
    outputs: tuple[str, ...]
    free: dict[str, tuple[int, ...]]
    checks: tuple[dict[str, Tensor], ...]
    n_named: int | None = None


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the exporter's own messages, which are meant for its developers."""
    loggers = [
        logging.getLogger(name) for name in ("torch.__trace", "torch.onnx", "torch.export", "onnxscript", "onnx_ir")
    ]
    levels = [logger.level for logger in loggers]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        try:
            yield
        finally:
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)


def exported(name: str, graph: ExportGraph) -> bytes:
    """A graph as ONNX. Raises ``SignspliceError`` if onnxruntime and torch differ."""
    shapes: list[Any] = [dict.fromkeys(graph.free.get(key, ()), _FREE) or None for key in graph.inputs]
    dynamic: tuple[Any, ...] = tuple(shapes)
    if graph.n_named is not None:
        dynamic = (*shapes[: graph.n_named], tuple(shapes[graph.n_named :]))
    with _quiet():
        program = torch.onnx.export(
            graph.module,
            tuple(graph.inputs.values()),
            dynamo=True,
            dynamic_shapes=dynamic,
            input_names=list(graph.inputs),
            output_names=list(graph.outputs),
            verbose=False,
        )
    if program is None:
        raise SignspliceError(f"{name}: torch made no ONNX program")
    model = _with_weight_names(_without_metadata(program.model_proto), graph.module)
    content: bytes = model.SerializeToString()
    compare(name, graph, content)
    return content


def _without_metadata(model: Any) -> Any:
    """The model without the exporter's notes: source lines with paths of this machine, a third of a small file."""

    def strip(message: Any) -> None:
        for field, value in message.ListFields():
            if field.name in ("metadata_props", "doc_string"):
                message.ClearField(field.name)
            elif field.message_type is not None:
                for inner in (value,) if hasattr(value, "ListFields") else value:
                    strip(inner)

    strip(model)
    return model


def _with_weight_names(model: Any, module: nn.Module) -> Any:
    """The model with the names of its transposed weights restored, so that a training can start from the graph."""
    unnamed = [entry for entry in model.graph.initializer if entry.name.startswith("val_")]
    new_names: dict[str, str] = {}
    for name, weight in module.state_dict().items():
        if weight.dim() != 2:
            continue
        transposed = np.ascontiguousarray(weight.numpy().T)
        for entry in unnamed:
            if tuple(entry.dims) == transposed.shape and np.array_equal(numpy_helper.to_array(entry), transposed):
                new_names[entry.name] = name + TRANSPOSED
                entry.name = name + TRANSPOSED
                unnamed.remove(entry)
                break
    for node in model.graph.node:
        for k, old_name in enumerate(node.input):
            if old_name in new_names:
                node.input[k] = new_names[old_name]
    return model


def compare(name: str, graph: ExportGraph, content: bytes) -> None:
    """Raise ``SignspliceError`` if onnxruntime and torch differ on the example or the other inputs."""
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    used = {entry.name for entry in session.get_inputs()}
    for inputs in (graph.inputs, *graph.checks):
        with torch.no_grad():
            answer = graph.module(*inputs.values())
        expected = (answer,) if isinstance(answer, Tensor) else answer
        found = session.run(list(graph.outputs), {key: v.numpy() for key, v in inputs.items() if key in used})
        for output, a, b in zip(graph.outputs, found, expected, strict=True):
            true = b.numpy()
            if a.shape != true.shape or (
                a.size and np.max(np.abs(a - 1.0 * true) / np.maximum(1, np.abs(true))) > TOLERANCE
            ):
                raise SignspliceError(
                    f"{name}: onnxruntime and torch differ in {output} ({a.shape}, {true.shape}); nothing was exported"
                )


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
