"""A bundle with 8-bit weights: a quarter of the size, and faster on processors with 8-bit products.

Weights of matrix products become signed bytes with one scale a column; their inputs are quantised when the graph runs
(onnxruntime's dynamic quantisation). Only seven of the eight bits are used, because sums of two 8-bit products overflow
on processors without VNNI.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper

from signsplice.errors import InputError
from signsplice.splicing.bundle import bundle_sha256, read_file, write_bundle
from signsplice.splicing.learned import open_sessions
from signsplice.splicing.sessions import Array
from signsplice.train import provenance
from signsplice.train.export import check_bundle_folder

INT8 = "int8"
_QUANTIZED_SUFFIX = "_quantized"
"""Ending of the names that onnxruntime gives to 8-bit weights."""
_QUANTIZED_FILES = ("word.onnx", "bridge.onnx")
"""Graphs that are quantised. The small ones, which choose frames and durations, keep 32 bits: they lost accuracy."""


def quantized(content: bytes) -> bytes:
    """A graph with 8-bit weights."""
    from onnxruntime.quantization import QuantType, quantize_dynamic

    model = onnx.load_model_from_string(content)
    # The exporter's shapes are from before it transposed weights; without them onnxruntime infers the right ones.
    del model.graph.value_info[:]
    with tempfile.TemporaryDirectory(prefix="signsplice-int8-") as folder, _quiet():
        path = Path(folder) / "int8.onnx"
        quantize_dynamic(
            model, str(path), per_channel=True, reduce_range=True,
            weight_type=QuantType.QInt8, op_types_to_quantize=["MatMul", "Gemm"],
        )  # fmt: skip
        return path.read_bytes()


def weights_of(content: bytes) -> dict[str, Array]:
    """A graph's weights by name, 8-bit ones dequantised: (byte - zero point) * scale of the column."""
    weights = {
        entry.name: numpy_helper.to_array(entry) for entry in onnx.load_model_from_string(content).graph.initializer
    }
    for quantized_name in [name for name in weights if name.endswith(_QUANTIZED_SUFFIX)]:
        name = quantized_name.removesuffix(_QUANTIZED_SUFFIX)
        zero, scale = weights[f"{name}_zero_point"].astype(np.float32), weights[f"{name}_scale"]
        weights[name] = (weights[quantized_name].astype(np.float32) - zero) * scale
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


@contextmanager
def _quiet() -> Iterator[None]:
    """Hide onnxruntime's advice to preprocess graphs first, which makes no difference for these."""
    root = logging.getLogger()
    level = root.level
    root.setLevel(logging.ERROR)
    try:
        yield
    finally:
        root.setLevel(level)
