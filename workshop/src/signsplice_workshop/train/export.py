"""Exports trained networks as ONNX graphs, compared with torch before they are kept; and bundles with 16-bit
weights.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

from signsplice.errors import InputError, SignspliceError
from signsplice.formats.atomic import check_place
from signsplice.splicing.bundle import BUNDLE_FILE, Array, bundle_sha256, read_config, read_file
from signsplice.splicing.runtime import onnxruntime
from signsplice_workshop.train.bundles import write_bundle
from signsplice_workshop.train.networks import ChooseGraph, Cutting, ReadGraph
from signsplice_workshop.train.prefetch import Dataset
from signsplice_workshop.train.tasks import Task

TOLERANCE = 1e-4
"""Largest difference between torch and onnxruntime, relative for numbers above 1."""
_FREE = torch.export.Dim.DYNAMIC
TRANSPOSED_SUFFIX = ".T"
"""Suffix of the name of a weight that a graph holds transposed."""


def check_bundle_folder(folder: Path) -> None:
    """Raises ``InputError`` if ``folder`` is a link or a mount point, or holds files but no bundle.json and no ONNX
    file: such a folder is not overwritten.
    """
    if folder.parent.is_dir():
        check_place(folder)
    if (
        folder.is_dir()
        and any(folder.iterdir())
        and not (folder / BUNDLE_FILE).exists()
        and not any(folder.glob("*.onnx"))
    ):
        raise InputError(f"{folder}: is there already and is no bundle; choose a new name")


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
def _silence_exporter() -> Iterator[None]:
    """Silences the exporter's own messages, which are meant for its developers."""
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


def export_onnx(name: str, graph: ExportGraph) -> bytes:
    """Returns a graph as ONNX. Raises ``SignspliceError`` if onnxruntime and torch differ."""
    shapes: list[Any] = [dict.fromkeys(graph.free.get(key, ()), _FREE) or None for key in graph.inputs]
    dynamic: tuple[Any, ...] = tuple(shapes)
    if graph.n_named is not None:
        dynamic = (*shapes[: graph.n_named], tuple(shapes[graph.n_named :]))
    with _silence_exporter():
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
    model = _restore_weight_names(_strip_metadata(program.model_proto), graph.module)
    content: bytes = model.SerializeToString()
    compare(name, graph, content)
    return content


def _strip_metadata(model: Any) -> Any:
    """Returns the model without the exporter's notes: source lines with paths of this machine, a third of a small
    file.
    """

    def strip(message: Any) -> None:
        for field, value in message.ListFields():
            if field.name in ("metadata_props", "doc_string"):
                message.ClearField(field.name)
            elif field.message_type is not None:
                for inner in (value,) if hasattr(value, "ListFields") else value:
                    strip(inner)

    strip(model)
    return model


def _restore_weight_names(model: Any, module: nn.Module) -> Any:
    """Returns the model with the names of its transposed weights restored, so that a training can start from the
    graph.
    """
    unnamed = [entry for entry in model.graph.initializer if entry.name.startswith("val_")]
    new_names: dict[str, str] = {}
    for name, weight in module.state_dict().items():
        if weight.dim() != 2:
            continue
        transposed = np.ascontiguousarray(weight.numpy().T)
        for entry in unnamed:
            if tuple(entry.dims) == transposed.shape and np.array_equal(numpy_helper.to_array(entry), transposed):
                new_names[entry.name] = name + TRANSPOSED_SUFFIX
                entry.name = name + TRANSPOSED_SUFFIX
                unnamed.remove(entry)
                break
    for node in model.graph.node:
        for k, old_name in enumerate(node.input):
            if old_name in new_names:
                node.input[k] = new_names[old_name]
    return model


def compare(name: str, graph: ExportGraph, content: bytes) -> None:
    """Raises ``SignspliceError`` if onnxruntime and torch differ, or give NaN, on the example or the other inputs."""
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    used = {entry.name for entry in session.get_inputs()}
    for inputs in (graph.inputs, *graph.checks):
        with torch.no_grad():
            torch_output = graph.module(*inputs.values())
        expected = (torch_output,) if isinstance(torch_output, Tensor) else torch_output
        results = session.run(list(graph.outputs), {key: value.numpy() for key, value in inputs.items() if key in used})
        for output, actual, true_tensor in zip(graph.outputs, results, expected, strict=True):
            true = true_tensor.numpy()
            if actual.shape != true.shape or (
                actual.size and not np.max(np.abs(actual - 1.0 * true) / np.maximum(1, np.abs(true))) <= TOLERANCE
            ):
                raise SignspliceError(
                    f"{name}: onnxruntime and torch differ in {output} ({actual.shape}, {true.shape}); nothing was "
                    "exported"
                )


def export_product_graphs(task: Task, valid: Dataset) -> dict[str, bytes]:
    """Returns the ONNX graphs of one of this project's own networks by file name, compared with torch on validation
    data: word.onnx (reads one word) and cut.onnx (scores every frame of two words for leaving, ``left``, and entering,
    ``entered``) of the network that cuts, or bridge.onnx of the one for transitions. The input ``tokens`` of word.onnx
    and bridge.onnx are the features of a word's or a gap's frames.

    Raises ``SignspliceError`` if onnxruntime and torch differ.
    """
    network = task.network.eval().cpu()
    if isinstance(network, Cutting):
        graphs = _make_cutting_graphs(network, [valid.batch([k]) for k in range(3)])
    else:
        # The example is a batch of several gaps, because the exporter would take a size of 1 for a constant.
        inputs = [{"tokens": valid.batch(rows).tokens} for rows in ([0, 1, 2], [3], [4, 5])]
        graphs = {"bridge": ExportGraph(network, inputs[0], ("turns",), {"tokens": (0,)}, tuple(inputs[1:]))}
    return {f"{name}.onnx": export_onnx(name, graph) for name, graph in graphs.items()}


def _make_cutting_graphs(network: Cutting, batches: Sequence[Any]) -> dict[str, ExportGraph]:
    """Returns the graphs of a cutting network, with the first two words of each batch as example and as other
    inputs. ``leave`` and ``enter`` are the summaries of the words for leaving and for entering.
    """
    words = [batch.tokens[:, k][batch.mask[:, k]][None] for batch in batches for k in (0, 1)]
    with torch.no_grad():
        readings = [network.read(tokens) for tokens in words]
    pairs = [
        {"before": before[0], "leave": before[1], "after": after[0], "enter": after[2]}
        for before, after in zip(readings[::2], readings[1::2], strict=True)
    ]
    tokens = [{"tokens": word} for word in words]
    outputs = ("states", "leave", "enter", "phases")
    return {
        "word": ExportGraph(ReadGraph(network), tokens[0], outputs, {"tokens": (1,)}, tuple(tokens[1:])),
        "cut": ExportGraph(
            ChooseGraph(network), pairs[0], ("left", "entered"), {"before": (1,), "after": (1,)}, tuple(pairs[1:])
        ),
    }


FLOAT16 = "float16"
_MIN_HALVED_SIZE = 1024
"""Smaller arrays (biases, the numbers' mean and deviation) keep 32 bits."""
HALF_SUFFIX = "_float16"
"""Suffix of the name of a weight that is stored in 16 bits."""


def cast_weights_to_float16(content: bytes) -> bytes:
    """Returns a graph with its larger weights stored in 16 bits, which it widens to 32 when it is opened. All
    arithmetic stays in 32 bits; weights above 6e-5 lose up to one part in 2,000 of themselves, smaller ones more.
    """
    model = onnx.load_model_from_string(content)
    casts = []
    for entry in model.graph.initializer:
        weights = numpy_helper.to_array(entry)
        if (
            weights.dtype != np.float32
            or weights.size < _MIN_HALVED_SIZE
            or np.abs(weights).max() > np.finfo(np.float16).max
        ):
            continue
        name = entry.name
        entry.CopyFrom(numpy_helper.from_array(weights.astype(np.float16), name + HALF_SUFFIX))
        casts.append(helper.make_node("Cast", [name + HALF_SUFFIX], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    return bytes(model.SerializeToString())


def read_weights(content: bytes) -> dict[str, Array]:
    """Returns a graph's weights by name, those of 16 bits widened to 32."""
    stored = onnx.load_model_from_string(content).graph.initializer
    weights = ((entry.name.removesuffix(HALF_SUFFIX), numpy_helper.to_array(entry)) for entry in stored)
    return {name: array.astype(np.float32) if array.dtype == np.float16 else array for name, array in weights}


def halve_bundle(source: Path, folder: Path, facts: Mapping[str, Any] | None = None) -> tuple[int, int]:
    """Writes a bundle with 16-bit weights into another folder; returns the graphs' total sizes before and after, bytes.

    bundle.json has ``precision`` and, in ``halved``, the sha256 of the source bundle with ``facts``. Raises
    ``InputError`` if the source is no bundle, has other than 32-bit weights, or is the folder to write, and as
    ``check_bundle_folder`` does.
    """
    config = read_config(source)
    if config.precision is not None:
        raise InputError(f"{source}: has {config.precision} weights; name the bundle that it was made from")
    if folder.exists() and folder.samefile(source):
        raise InputError(f"{folder}: is the bundle itself; name another folder")
    check_bundle_folder(folder)
    files = {name: read_file(source, config, name) for name in config.files}
    half_files = {name: cast_weights_to_float16(content) for name, content in files.items()}
    stored = {k: v for k, v in config.stored.items() if k not in ("version", "files")}
    stored |= {"precision": FLOAT16, "halved": {"bundle": bundle_sha256(source), **(facts or {})}}
    write_bundle(folder, stored, half_files)
    return sum(map(len, files.values())), sum(map(len, half_files.values()))
