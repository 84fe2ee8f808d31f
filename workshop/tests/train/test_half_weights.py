"""16-bit weights: half the size, arithmetic in 32 bits, and answers that are nearly the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import GOLDEN

torch = pytest.importorskip("torch")
onnx = pytest.importorskip("onnx")

from click.testing import CliRunner  # noqa: E402
from onnx import TensorProto, helper, numpy_helper  # noqa: E402

from signsplice.cli.commands import app  # noqa: E402
from signsplice.errors import InputError  # noqa: E402
from signsplice.splicing import options as methods  # noqa: E402
from signsplice.splicing.bundle import bundle_sha256, read_config  # noqa: E402
from signsplice.splicing.features import N_SEEN, N_TOKEN, N_WORD  # noqa: E402
from signsplice.splicing.learned import open_sessions  # noqa: E402
from signsplice.splicing.runtime import onnxruntime  # noqa: E402
from signsplice_workshop.train.bundles import write_bundle  # noqa: E402
from signsplice_workshop.train.export import FLOAT16, cast_weights_to_float16, halve_bundle, read_weights  # noqa: E402
from signsplice_workshop.train.tuning import read_network  # noqa: E402

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
    content = cast_weights_to_float16(graph())
    assert len(content) < 0.6 * len(graph())
    x = np.random.default_rng(1).normal(size=(3, 64)).astype(np.float32)
    expected = x @ WEIGHTS.astype(np.float16).astype(np.float32) + BIAS
    np.testing.assert_allclose(run(content, x), expected, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(run(content, np.zeros((1, 64), np.float32))[0], BIAS)
    beyond = WEIGHTS.copy()
    beyond[0, 0] = 1e6
    np.testing.assert_array_equal(run(cast_weights_to_float16(graph(beyond)), x), run(graph(beyond), x))


def test_a_bundle_records_what_it_was_made_from(tmp_path: Path) -> None:
    write_bundle(tmp_path / "whole", {"system": "lpt", "fr": 8}, {"spsn.onnx": graph()}, {"spsn.jsonl": b"{}"})
    before, after = halve_bundle(tmp_path / "whole", tmp_path / "half", {"pairs": 3})
    assert after < before
    made = read_config(tmp_path / "half")
    assert made.precision == FLOAT16
    assert made.stored["halved"] == {"bundle": bundle_sha256(tmp_path / "whole"), "pairs": 3}
    assert (made.system, made.stored["fr"]) == ("lpt", 8)
    assert sorted(path.name for path in (tmp_path / "half").iterdir()) == ["bundle.json", "spsn.onnx"]
    with pytest.raises(InputError, match="has float16 weights; name the bundle that it was made from"):
        halve_bundle(tmp_path / "half", tmp_path / "quarter", {})
    with pytest.raises(InputError, match="is the bundle itself"):
        halve_bundle(tmp_path / "whole", tmp_path / "whole", {})
    assert read_config(tmp_path / "whole").precision is None


TINY = GOLDEN / "tiny_bundle"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("halved") / "half"
    halve_bundle(TINY, out)
    return out


def test_the_answers_are_nearly_the_same(small: Path) -> None:
    rng = np.random.default_rng(0)
    shapes = {"bridge": (1, N_SEEN, N_TOKEN), "word": (1, 60, N_WORD)}
    inputs = {name: rng.normal(0.0, 0.3, shape).astype(np.float32) for name, shape in shapes.items()}
    exact, half = open_sessions(TINY), open_sessions(small)
    for name, tokens in inputs.items():
        answers = half.run(name, {"tokens": tokens})
        for key, expected in exact.run(name, {"tokens": tokens}).items():
            error = np.sqrt(np.mean((answers[key] - expected) ** 2) / np.mean(expected**2))
            assert 0.0 < error < 0.01, (name, key)


def test_a_training_can_start_from_the_stored_weights(small: Path) -> None:
    stored, content = read_config(small).stored, (small / "bridge.onnx").read_bytes()
    network = read_network(stored, content, small)
    exact, found = read_weights((TINY / "bridge.onnx").read_bytes()), read_weights(content)
    assert exact.keys() == found.keys()
    assert all(np.allclose(found[name], values, rtol=1e-3, atol=1e-7) for name, values in exact.items())
    tokens = np.random.default_rng(1).normal(0.0, 0.3, (2, N_SEEN, N_TOKEN)).astype(np.float32)
    with torch.no_grad():
        answer = network(torch.from_numpy(tokens)).numpy()
    np.testing.assert_allclose(answer, open_sessions(small).run("bridge", {"tokens": tokens})["turns"], atol=1e-5)


def test_the_export_command_prints_the_sizes(tmp_path: Path) -> None:
    called = CliRunner().invoke(app, ["export", str(TINY), "-o", str(tmp_path / "b")], catch_exceptions=False)
    assert called.stdout.startswith(f"{tmp_path / 'b'}: 0.")
    assert methods.choose(bundle=tmp_path / "b").bundle is not None
