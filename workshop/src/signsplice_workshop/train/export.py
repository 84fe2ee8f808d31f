"""Trained networks as ONNX graphs, compared with torch before they are kept; and bundles with 8-bit weights.

In these, weights of matrix products are stored as signed bytes with one scale a column, and become 32-bit numbers again
when the graph is opened. The products themselves have 32 bits. With 8 bits there too (onnxruntime's dynamic
quantisation) they are faster, but another kind of processor rounds some inputs to the next byte, and then chooses other
frames.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import ModelProto, NodeProto, helper, numpy_helper
from torch import Tensor, nn

from signsplice.errors import InputError, SignspliceError
from signsplice.formats.atomic import check_place
from signsplice.splicing.bundle import BUNDLE_FILE, Array, bundle_sha256, multiplies_in_8_bits, read_file
from signsplice.splicing.learned import open_sessions
from signsplice.splicing.runtime import onnxruntime
from signsplice_workshop.train import records
from signsplice_workshop.train.bundles import write_bundle
from signsplice_workshop.train.networks import ChooseGraph, Cutting, ReadGraph
from signsplice_workshop.train.prefetch import Dataset
from signsplice_workshop.train.tasks import Task

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
        inputs = [{"tokens": valid.batch(rows).tokens} for rows in ([0, 1, 2], [3], [4, 5])]
        graphs = {"bridge": ExportGraph(network, inputs[0], ("turns",), {"tokens": (0,)}, tuple(inputs[1:]))}
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
    tokens = [{"tokens": word} for word in words]
    outputs = ("states", "leave", "enter", "phases")
    return {
        "word": ExportGraph(ReadGraph(network), tokens[0], outputs, {"tokens": (1,)}, tuple(tokens[1:])),
        "cut": ExportGraph(
            ChooseGraph(network), pairs[0], ("left", "entered"), {"before": (1,), "after": (1,)}, tuple(pairs[1:])
        ),
    }


INT8 = "int8"
QUANTIZED, SCALE, ZERO_POINT = "_quantized", "_scale", "_zero_point"
"""Endings of the names of 8-bit weights and of what belongs to them, as onnxruntime's own quantisation has them."""
_QUANTIZED_FILES = ("word.onnx", "bridge.onnx")
"""Graphs that are quantised. The small ones, which choose frames and durations, keep 32 bits: they lost accuracy."""


def quantized(content: bytes) -> bytes:
    """A graph whose matrix products take 8-bit weights: byte * scale of the column. Raises ``ValueError`` where none of
    its products has stored weights, or some are of another kind.
    """
    model = onnx.load_model_from_string(content)
    graph = model.graph
    stored = {entry.name: entry for entry in graph.initializer}
    names = {node.input[1] for node in graph.node if node.op_type == "MatMul"} & set(stored)
    if not names or any(node.op_type == "Gemm" for node in graph.node):
        raise ValueError("expected products of the kind MatMul with stored weights, and none of the kind Gemm")
    for name in sorted(names):
        weights = numpy_helper.to_array(stored[name])
        largest = np.abs(weights).max(axis=0)
        scale = np.where(largest > 0.0, largest, 1.0).astype(np.float32) / np.float32(127.0)
        graph.initializer.remove(stored[name])
        for ending, values in ((QUANTIZED, np.rint(weights / scale).astype(np.int8)), (SCALE, scale)):
            graph.initializer.append(numpy_helper.from_array(values, name + ending))
        graph.node.insert(0, _dequantized(name))
    return _stored(model)


def in_32_bits(content: bytes) -> bytes:
    """A graph with products in 8 bits, as ``export --int8`` made them up to version 0.3, with the same weights in
    products in 32 bits. Raises ``ValueError`` where it is none.
    """
    model = onnx.load_model_from_string(content)
    graph = model.graph
    bytes_of = {node.output[0]: node for node in graph.node if node.op_type == "DynamicQuantizeLinear"}
    users = {name: node for node in graph.node for name in node.input}
    dropped, products = [*bytes_of.values()], {}
    for product in (node for node in graph.node if node.op_type == "MatMulInteger"):
        name, source = product.input[1].removesuffix(QUANTIZED), bytes_of[product.input[0]]
        cast = users[product.output[0]]
        scaled = users[cast.output[0]]
        (scales,) = (node for node in graph.node if set(node.output) & set(scaled.input) - set(cast.output))
        if {source.output[1], name + SCALE} != set(scales.input):
            raise ValueError(f"{product.name}: expected a product times the scales of its inputs")
        products[product.output[0]] = helper.make_node(
            "MatMul", [source.input[0], name], scaled.output, name=product.name
        )
        dropped += [cast, scaled, scales]
    gone = {node.output[0] for node in dropped}
    nodes = [products.get(node.output[0], node) for node in graph.node if node.output[0] not in gone]
    weights = sorted({node.input[1] for node in products.values()})
    stored = {entry.name: numpy_helper.to_array(entry) for entry in graph.initializer}
    if not weights or any(stored[name + ZERO_POINT].any() for name in weights):
        raise ValueError("expected products in 8 bits, of weights whose zero point is 0")
    used = {name for node in nodes for name in node.input}
    used |= {name + ending for name in weights for ending in (QUANTIZED, SCALE)}
    kept = [numpy_helper.from_array(values, name) for name, values in stored.items() if name in used]
    nodes = [_copy(node) for node in (*map(_dequantized, weights), *nodes)]
    for field, entries in ((graph.node, nodes), (graph.initializer, kept)):
        del field[:]
        field.extend(entries)
    return _stored(model)


def _dequantized(name: str) -> NodeProto:
    return helper.make_node("DequantizeLinear", [name + QUANTIZED, name + SCALE], [name], name + "_dequantized", axis=1)


def _copy(node: NodeProto) -> NodeProto:
    copy = NodeProto()
    copy.CopyFrom(node)
    return copy


def _stored(model: ModelProto) -> bytes:
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


def weights_of(content: bytes) -> dict[str, Array]:
    """A graph's weights by name; 8-bit ones are (byte - zero point, if there is one) * scale of the column."""
    weights = {
        entry.name: numpy_helper.to_array(entry) for entry in onnx.load_model_from_string(content).graph.initializer
    }
    for name in [name.removesuffix(QUANTIZED) for name in weights if name.endswith(QUANTIZED)]:
        zero = np.asarray(weights.get(name + ZERO_POINT, 0), np.float32)
        weights[name] = (weights[name + QUANTIZED].astype(np.float32) - zero) * weights[name + SCALE]
    return weights


def quantize_bundle(source: Path, out: Path) -> tuple[int, int]:
    """Write a bundle with 8-bit weights into another folder; returns the graphs' bytes before and after. Of one with
    products in 8 bits the weights stay as they are.

    The new bundle.json names the command and the bundle it was made from. Raises ``InputError`` where the source is no
    bundle of the product's networks, is of this kind already, or is the folder to write, and as ``check_bundle_folder``
    does.
    """
    graphs = open_sessions(source)
    if out.exists() and out.samefile(source):
        raise InputError(f"{out}: is the bundle itself; name another folder")
    check_bundle_folder(out)
    files = {name: read_file(source, graphs.config, name) for name in graphs.config.files}
    change = quantized
    if graphs.config.precision == INT8:
        if not any(multiplies_in_8_bits(content) for content in files.values()):
            raise InputError(f"{source}: has 8-bit weights already; name the bundle that it was made from")
        change = in_32_bits
    small = {name: change(content) if name in _QUANTIZED_FILES else content for name, content in files.items()}
    made_from = {
        "command": records.command(["export", records.portable(source)], {"int8": True}),
        "bundle": bundle_sha256(source),
    }
    facts = {k: v for k, v in graphs.config.stored.items() if k not in ("version", "files")}
    write_bundle(out, facts | {"precision": INT8, "quantized": made_from}, small)
    return sum(map(len, files.values())), sum(map(len, small.values()))
