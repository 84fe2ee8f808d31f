"""Bundles with 16-bit weights: half the size, arithmetic in 32 bits, and the command that publishes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")

from onnx import TensorProto, helper, numpy_helper  # noqa: E402

from signsplice.errors import InputError  # noqa: E402
from signsplice.splicing.bundle import bundle_sha256  # noqa: E402
from signsplice.splicing.runtime import onnxruntime  # noqa: E402
from signsplice_paper.configs import read_config  # noqa: E402
from signsplice_paper.train.half_weights import FLOAT16, halve_bundle, halved  # noqa: E402
from signsplice_workshop.train.bundles import write_bundle  # noqa: E402

WEIGHTS = np.random.default_rng(0).normal(0.0, 0.1, (64, 64)).astype(np.float32)
BIAS = np.linspace(1e-9, 3.0, 64, dtype=np.float32)


def graph(weights: np.ndarray = WEIGHTS) -> bytes:
    """X @ weights + bias."""
    x, y = (helper.make_tensor_value_info(name, TensorProto.FLOAT, [None, 64]) for name in "xy")
    nodes = [helper.make_node("MatMul", ["x", "w"], ["product"]), helper.make_node("Add", ["product", "b"], ["y"])]
    stored = [numpy_helper.from_array(weights, "w"), numpy_helper.from_array(BIAS, "b")]
    made = helper.make_model(
        helper.make_graph(nodes, "g", [x], [y], stored), opset_imports=[helper.make_opsetid("", 18)], ir_version=9
    )
    return bytes(made.SerializeToString())


def run(content: bytes, x: np.ndarray) -> np.ndarray:
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    return np.asarray(session.run(["y"], {"x": x})[0])


def test_large_weights_lose_half_their_bytes_and_small_ones_nothing() -> None:
    content = halved(graph())
    assert len(content) < 0.6 * len(graph())
    x = np.random.default_rng(1).normal(size=(3, 64)).astype(np.float32)
    expected = x @ WEIGHTS.astype(np.float16).astype(np.float32) + BIAS
    np.testing.assert_allclose(run(content, x), expected, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(run(content, np.zeros((1, 64), np.float32))[0], BIAS)
    beyond = WEIGHTS.copy()
    beyond[0, 0] = 1e6
    np.testing.assert_array_equal(run(halved(graph(beyond)), x), run(graph(beyond), x))


def test_a_bundle_records_what_it_was_made_from(tmp_path: Path) -> None:
    write_bundle(tmp_path / "whole", {"system": "lpt", "fr": 8}, {"spsn.onnx": graph()}, {"spsn.jsonl": b"{}"})
    made = halve_bundle(tmp_path / "whole", tmp_path / "half", {"pairs": 3})
    assert made.precision == FLOAT16
    assert made.stored["halved"] == {"bundle": bundle_sha256(tmp_path / "whole"), "pairs": 3}
    assert (made.system, made.fr) == ("lpt", 8)
    assert sorted(path.name for path in (tmp_path / "half").iterdir()) == ["bundle.json", "spsn.onnx"]
    with pytest.raises(InputError, match="has float16 weights; name the bundle that it was made from"):
        halve_bundle(tmp_path / "half", tmp_path / "quarter", {})
    with pytest.raises(InputError, match="is the bundle itself"):
        halve_bundle(tmp_path / "whole", tmp_path / "whole", {})
    assert read_config(tmp_path / "whole").precision is None
