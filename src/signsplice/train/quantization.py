"""A bundle with 8-bit weights: a third of the size.

Weights of matrix products are stored as signed bytes with one scale a column, and become 32-bit numbers again when the
graph is opened. The products themselves have 32 bits. With 8 bits there too (onnxruntime's dynamic quantisation) they
are faster, but another kind of processor rounds some inputs to the next byte, and then chooses other frames.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import ModelProto, NodeProto, helper, numpy_helper

from signsplice.errors import InputError
from signsplice.splicing.bundle import Array, bundle_sha256, multiplies_in_8_bits, read_file, write_bundle
from signsplice.splicing.learned import open_sessions
from signsplice.train import provenance
from signsplice.train.export import check_bundle_folder

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
        "command": provenance.command(["export", provenance.portable(source)], {"int8": True}),
        "bundle": bundle_sha256(source),
    }
    facts = {k: v for k, v in graphs.config.stored.items() if k not in ("version", "files")}
    write_bundle(out, facts | {"precision": INT8, "quantized": made_from}, small)
    return sum(map(len, files.values())), sum(map(len, small.values()))
