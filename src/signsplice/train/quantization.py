"""A bundle with 8-bit weights: a quarter of the size, and quicker where processors multiply bytes.

Weights of matrix products become signed bytes with a scale for every column, and what they meet is brought to bytes as
it comes (onnxruntime's dynamic quantisation). Seven of the eight bits are used: sums of two products of eight overflow
on processors without VNNI.
"""

from __future__ import annotations

import json
import logging
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper

from signsplice.errors import InputError
from signsplice.splicing.bundle import read_file, write_bundle
from signsplice.splicing.learned import open_sessions
from signsplice.splicing.sessions import Array

INT8 = "int8"
_BYTES = "_quantized"
"""How onnxruntime names a weight of bytes."""
_LARGE = ("word.onnx", "bridge.onnx")
"""Graphs whose weights become bytes; the small ones, which choose frames and tell times, stay as exact as they are."""


def quantized(content: bytes) -> bytes:
    """A graph with 8-bit weights."""
    from onnxruntime.quantization import QuantType, quantize_dynamic

    model = onnx.load_model_from_string(content)
    # Shapes are told anew: the exporter's are those from before it turned weights over.
    del model.graph.value_info[:]
    with tempfile.TemporaryDirectory(prefix="signsplice-int8-") as folder, _quiet():
        path = Path(folder) / "int8.onnx"
        quantize_dynamic(
            model, str(path), per_channel=True, reduce_range=True,
            weight_type=QuantType.QInt8, op_types_to_quantize=["MatMul", "Gemm"],
        )  # fmt: skip
        return path.read_bytes()


def weights_of(content: bytes) -> dict[str, Array]:
    """A graph's weights by name; those that are bytes as the numbers that they stand for, (byte - zero point) * scale a
    column.
    """
    held = {
        entry.name: numpy_helper.to_array(entry) for entry in onnx.load_model_from_string(content).graph.initializer
    }
    for name in [name for name in held if name.endswith(_BYTES)]:
        plain = name.removesuffix(_BYTES)
        zero, scale = held[f"{plain}_zero_point"].astype(np.float32), held[f"{plain}_scale"]
        held[plain] = (held[name].astype(np.float32) - zero) * scale
    return held


def quantize_bundle(source: Path, out: Path) -> tuple[int, int]:
    """Write a bundle's graphs with 8-bit weights into another folder; bytes of the graphs before and after.

    Raises ``InputError`` where the source is no bundle of this project's networks, has 8-bit weights already, or is the
    folder to write.
    """
    graphs = open_sessions(source)
    if graphs.facts.get("precision") == INT8:
        raise InputError(f"{source}: has 8-bit weights already; name the bundle that it was made from")
    if out.resolve() == source.resolve():
        raise InputError(f"{out}: is the bundle itself; name another folder")
    files = {name: read_file(source, graphs.facts, name) for name in graphs.facts["files"]}
    small = {name: quantized(content) if name in _LARGE else content for name, content in files.items()}
    out.mkdir(parents=True, exist_ok=True)
    facts = {k: v for k, v in graphs.facts.items() if k not in ("version", "files")}
    write_bundle(out, json.loads(json.dumps(facts)) | {"precision": INT8}, small)
    return sum(map(len, files.values())), sum(map(len, small.values()))


@contextmanager
def _quiet() -> Iterator[None]:
    """Advice to prepare graphs in another way first, which changes nothing for these, is left out."""
    root = logging.getLogger()
    level = root.level
    root.setLevel(logging.ERROR)
    try:
        yield
    finally:
        root.setLevel(level)
