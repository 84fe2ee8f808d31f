"""8-bit weights: a smaller bundle whose answers are nearly the same."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from conftest import GOLDEN

torch = pytest.importorskip("torch")
onnx = pytest.importorskip("onnx")

from click.testing import CliRunner  # noqa: E402

from signing import word  # noqa: E402
from signsplice.cli.commands import app  # noqa: E402
from signsplice.errors import FormatError, InputError  # noqa: E402
from signsplice.splicing import options as methods  # noqa: E402
from signsplice.splicing.bundle import bundle_sha256, read_config  # noqa: E402
from signsplice.splicing.features import N_TOKEN, N_WORD  # noqa: E402
from signsplice.splicing.learned import open_sessions  # noqa: E402
from signsplice_workshop.train import export, tuning  # noqa: E402

TINY = GOLDEN / "tiny_bundle"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("quantized") / "int8"
    before, after = export.quantize_bundle(TINY, out)
    assert after < before
    return out


def relative_error(found: np.ndarray, expected: np.ndarray) -> float:
    """Root mean square of the difference, as a fraction of that of the expected numbers."""
    return float(np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2)))


def test_the_answers_are_nearly_the_same(small: Path) -> None:
    rng = np.random.default_rng(0)
    tokens = rng.normal(0.0, 0.3, (1, 26, N_TOKEN)).astype(np.float32)
    inputs = {
        "bridge": {"tokens": tokens, "mask": np.ones((1, 26), bool)},
        "word": {"tokens": rng.normal(0.0, 0.3, (1, 60, N_WORD)).astype(np.float32)},
    }
    exact, quantized = open_sessions(TINY), open_sessions(small)
    for name, arrays in inputs.items():
        answers = quantized.run(name, arrays)
        for key, expected in exact.run(name, arrays).items():
            # 0.007 to 0.012; wrong scales would give 0.5 and more.
            assert 0.0 < relative_error(answers[key], expected) < 0.1, (name, key)


def test_a_quantized_bundle_splices(small: Path) -> None:
    before, after = word("MOTHER").clip, word("BOOK").clip
    cut = methods.open_learned(small).cutters["learned"].cut_all([before, after])[0]
    assert 0 <= cut.pre < len(before)


def test_a_quantized_bundle_names_its_origin_and_no_folders(small: Path) -> None:
    stored, source = read_config(small).stored, read_config(TINY).stored
    assert stored["precision"] == "int8"
    assert stored["networks"] == source["networks"]
    assert stored["quantized"]["bundle"] == bundle_sha256(TINY)
    words = stored["quantized"]["command"]
    assert [*words[:2], Path(words[2]).name, *words[3:]] == ["signsplice", "export", "tiny_bundle", "--int8"]
    for path in small.iterdir():
        content = path.read_bytes()
        here = (Path(__file__).parents[3], Path.home(), tempfile.gettempdir())
        assert not any(str(folder).encode() in content for folder in here), "no path of this machine"


def test_stored_bytes_stand_for_nearly_the_same_weights(small: Path) -> None:
    exact, found = (export.weights_of((folder / "bridge.onnx").read_bytes()) for folder in (TINY, small))
    matrices = [name for name, values in exact.items() if ".weight" in name and values.ndim == 2]
    assert len(matrices) == 6
    for name in matrices:
        half_steps = 0.5 * np.abs(exact[name]).max(axis=0) / 127.0
        assert np.all(np.abs(found[name] - exact[name]).max(axis=0) <= half_steps + 1e-7)


def in_8_bits(content: bytes, folder: Path) -> bytes:
    """A graph as version 0.3 exported it: products in 8 bits, by onnxruntime's dynamic quantisation."""
    import signsplice.splicing.runtime  # noqa: F401  (switches the library's telemetry off first)

    pytest.importorskip("onnxruntime.quantization")
    from onnxruntime.quantization import QuantType, quantize_dynamic

    model = onnx.load_model_from_string(content)
    del model.graph.value_info[:]
    quantize_dynamic(
        model, str(folder / "old.onnx"), per_channel=True, reduce_range=True,
        weight_type=QuantType.QInt8, op_types_to_quantize=["MatMul", "Gemm"],
    )  # fmt: skip
    return (folder / "old.onnx").read_bytes()


def test_a_bundle_with_products_in_8_bits_is_written_anew_with_the_same_weights(tmp_path: Path) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    shutil.copytree(TINY, old)
    stored = json.loads((old / "bundle.json").read_text())
    for name in ("word.onnx", "bridge.onnx"):
        content = in_8_bits((TINY / name).read_bytes(), tmp_path)
        (old / name).write_bytes(content)
        stored["files"][name] = hashlib.sha256(content).hexdigest()
    (old / "bundle.json").write_text(json.dumps(stored | {"precision": "int8"}))
    tokens, mask = np.random.default_rng(2).normal(0.0, 0.3, (1, 26, N_TOKEN)), np.ones((1, 26), bool)
    inputs = {"tokens": tokens.astype(np.float32), "mask": mask}
    with pytest.raises(FormatError, match="multiplies in 8 bits"):
        open_sessions(old).run("bridge", inputs)
    export.quantize_bundle(old, new)
    for name in ("word.onnx", "bridge.onnx"):
        before, after = (export.weights_of((folder / name).read_bytes()) for folder in (old, new))
        assert all(np.array_equal(before[key], values) for key, values in after.items())
    expected, found = (open_sessions(bundle).run("bridge", inputs)["turns"] for bundle in (TINY, new))
    assert relative_error(found, expected) < 0.1


def test_products_of_another_kind_are_refused() -> None:
    with pytest.raises(ValueError, match="expected products of the kind MatMul"):
        export.quantized((TINY / "cut.onnx").read_bytes())
    with pytest.raises(ValueError, match="expected products in 8 bits"):
        export.in_32_bits((TINY / "word.onnx").read_bytes())


def test_the_shipped_graph_gives_the_network_to_tune() -> None:
    content = (methods.WEIGHTS / "bridge.onnx").read_bytes()
    network = tuning.network_from_bundle(read_config(methods.WEIGHTS).stored, content, methods.WEIGHTS)
    rng = np.random.default_rng(1)
    tokens, mask = rng.normal(0.0, 0.3, (1, 26, N_TOKEN)).astype(np.float32), np.ones((1, 26), bool)
    with torch.no_grad():
        found = network(torch.from_numpy(tokens), torch.from_numpy(mask)).numpy()
    expected = open_sessions(methods.WEIGHTS).run("bridge", {"tokens": tokens, "mask": mask})["turns"]
    assert relative_error(found, expected) < 1e-5


def test_the_export_command_prints_the_sizes(tmp_path: Path) -> None:
    arguments = ["export", str(TINY), "-o", str(tmp_path / "b"), "--int8"]
    called = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert re.fullmatch(r".*b: \d\.\d MB in \d\.\d MB\n", called.stdout)
    assert methods.choose(bundle=tmp_path / "b").bundle is not None


def test_what_cannot_be_quantized_is_refused(small: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="8-bit weights already"):
        export.quantize_bundle(small, tmp_path / "again")
    with pytest.raises(InputError, match="is the bundle itself"):
        export.quantize_bundle(TINY, TINY)
    with pytest.raises(InputError, match="no such file"):
        export.quantize_bundle(tmp_path / "none", tmp_path / "b")
    assert not (tmp_path / "again").exists()
