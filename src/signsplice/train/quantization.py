"""A bundle with 8-bit weights: a third of the size.

Weights of matrix products are stored as signed bytes with one scale a column, and become 32-bit numbers again when the
graph is opened. The products themselves have 32 bits. With 8 bits there too (onnxruntime's dynamic quantisation) they
are faster, but another kind of processor rounds some inputs to the next byte, and then chooses other frames.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import helper, numpy_helper

from signsplice.errors import InputError
from signsplice.splicing.bundle import bundle_sha256, read_file, write_bundle
from signsplice.splicing.learned import open_sessions
from signsplice.splicing.sessions import Array
from signsplice.train import provenance
from signsplice.train.export import check_bundle_folder

INT8 = "int8"
_QUANTIZED, _SCALE, _ZERO_POINT = "_quantized", "_scale", "_zero_point"
"""Endings of the names of 8-bit weights and of what belongs to them, as onnxruntime's own quantisation has them."""
_QUANTIZED_FILES = ("word.onnx", "bridge.onnx")
"""Graphs that are quantised. The small ones, which choose frames and durations, keep 32 bits: they lost accuracy."""


def quantized(content: bytes) -> bytes:
    """A graph whose matrix products take 8-bit weights: byte * scale of the column."""
    model = onnx.load_model_from_string(content)
    graph = model.graph
    stored = {entry.name: entry for entry in graph.initializer}
    names = {node.input[1] for node in graph.node if node.op_type == "MatMul"} & set(stored)
    for name in sorted(names):
        weights = numpy_helper.to_array(stored[name])
        scale = np.maximum(np.abs(weights).max(axis=0), np.finfo(np.float32).tiny) / np.float32(127.0)
        bytes_ = np.rint(weights / scale).astype(np.int8)
        graph.initializer.remove(stored[name])
        graph.initializer.extend(
            numpy_helper.from_array(values, name + ending) for ending, values in ((_QUANTIZED, bytes_), (_SCALE, scale))
        )
        graph.node.insert(0, helper.make_node("DequantizeLinear", [name + _QUANTIZED, name + _SCALE], [name], axis=1))
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def weights_of(content: bytes) -> dict[str, Array]:
    """A graph's weights by name; 8-bit ones are (byte - zero point, if there is one) * scale of the column."""
    weights = {
        entry.name: numpy_helper.to_array(entry) for entry in onnx.load_model_from_string(content).graph.initializer
    }
    for name in [name.removesuffix(_QUANTIZED) for name in weights if name.endswith(_QUANTIZED)]:
        zero = np.asarray(weights.get(name + _ZERO_POINT, 0), np.float32)
        weights[name] = (weights[name + _QUANTIZED].astype(np.float32) - zero) * weights[name + _SCALE]
    return weights


def quantize_bundle(source: Path, out: Path) -> tuple[int, int]:
    """Write a bundle with 8-bit weights into another folder; returns the graphs' bytes before and after.

    The new bundle.json names the command and the bundle it was made from. Raises ``InputError`` where the source is no
    bundle of the product's networks, has 8-bit weights already, or is the folder to write, and as
    ``check_bundle_folder`` does.
    """
    graphs = open_sessions(source)
    if graphs.config.precision == INT8:
        raise InputError(f"{source}: has 8-bit weights already; name the bundle that it was made from")
    if out.exists() and out.samefile(source):
        raise InputError(f"{out}: is the bundle itself; name another folder")
    check_bundle_folder(out)
    files = {name: read_file(source, graphs.config, name) for name in graphs.config.files}
    small = {name: quantized(content) if name in _QUANTIZED_FILES else content for name, content in files.items()}
    made_from = {
        "command": provenance.command(["export", provenance.portable(source)], {"int8": True}),
        "bundle": bundle_sha256(source),
    }
    facts = {k: v for k, v in graphs.config.stored.items() if k not in ("version", "files")}
    write_bundle(out, facts | {"precision": INT8, "quantized": made_from}, small)
    return sum(map(len, files.values())), sum(map(len, small.values()))
