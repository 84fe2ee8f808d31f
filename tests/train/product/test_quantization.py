"""8-bit weights: smaller, nearly the same answers, and a sound bundle."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from click.testing import CliRunner  # noqa: E402

from signing import word  # noqa: E402
from signsplice.cli import app  # noqa: E402
from signsplice.errors import InputError  # noqa: E402
from signsplice.splicing import methods  # noqa: E402
from signsplice.splicing.features import N_TOKEN, N_WORD  # noqa: E402
from signsplice.splicing.learned import open_sessions  # noqa: E402
from signsplice.train import quantization  # noqa: E402
from signsplice.train.product import tuning  # noqa: E402

TINY = Path(__file__).parents[2] / "golden" / "tiny_bundle"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("quantized") / "int8"
    before, after = quantization.quantize_bundle(TINY, out)
    assert after < before
    return out


def test_the_answers_are_nearly_the_same(small: Path) -> None:
    rng = np.random.default_rng(0)
    given = {
        "bridge": {"tokens": rng.normal(0.0, 0.3, (1, 26, N_TOKEN)), "mask": np.ones((1, 26), bool)},
        "word": {"tokens": rng.normal(0.0, 0.3, (1, 60, N_WORD))},
    }
    whole, quick = open_sessions(TINY), open_sessions(small)
    for name, inputs in given.items():
        told = {k: v if v.dtype == bool else v.astype(np.float32) for k, v in inputs.items()}
        for key, exact in whole.run(name, told).items():
            made = quick.run(name, told)[key]
            off = float(np.sqrt(np.mean((made - exact) ** 2)))
            assert 0.0 < off < 0.1 * float(np.sqrt(np.mean(exact**2))), (name, key)


def test_it_splices_and_says_what_it_is(small: Path) -> None:
    learned = methods.open_learned(small)
    before, after = word("MOTHER").clip, word("BOOK").clip
    cut = learned.cutters["learned"].cut(before, after)
    assert 0 <= cut.pre < len(before)
    assert open_sessions(small).facts["precision"] == "int8"
    assert open_sessions(small).facts["networks"] == open_sessions(TINY).facts["networks"]
    for path in small.glob("*.onnx"):
        content = path.read_bytes()
        here = (Path(__file__).parents[3], Path.home(), tempfile.gettempdir())
        assert not any(str(folder).encode() in content for folder in here), "no path of this machine"


def test_weights_are_told_as_the_numbers_they_stand_for(small: Path) -> None:
    whole, bytes_ = (quantization.weights_of((folder / "bridge.onnx").read_bytes()) for folder in (TINY, small))
    named = [name for name, values in whole.items() if ".weight" in name and values.ndim == 2]
    assert len(named) == 6
    for name in named:
        # Seven bits of the largest weight of a column.
        assert np.all(np.abs(bytes_[name] - whole[name]).max(axis=0) <= np.abs(whole[name]).max(axis=0) / 63.0 + 1e-7)


def test_what_ships_can_be_tuned() -> None:
    facts = open_sessions(methods.WEIGHTS).facts
    network = tuning.begun(facts, (methods.WEIGHTS / "bridge.onnx").read_bytes(), methods.WEIGHTS)
    rng = np.random.default_rng(1)
    tokens, mask = rng.normal(0.0, 0.3, (1, 26, N_TOKEN)).astype(np.float32), np.ones((1, 26), bool)
    with torch.no_grad():
        own = network(torch.from_numpy(tokens), torch.from_numpy(mask)).numpy()
    told = open_sessions(methods.WEIGHTS).run("bridge", {"tokens": tokens, "mask": mask})["turns"]
    assert np.sqrt(np.mean((own - told) ** 2)) < 0.1 * np.sqrt(np.mean(own**2))


def test_the_command(tmp_path: Path) -> None:
    told = CliRunner().invoke(app, ["export", str(TINY), "-o", str(tmp_path / "b"), "--int8"], catch_exceptions=False)
    assert re.fullmatch(r".*b: \d\.\d MB in \d\.\d MB\n", told.stdout)
    assert methods.choose(bundle=tmp_path / "b").bundle is not None


def test_what_cannot_be_made_smaller_is_refused(small: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="8-bit weights already"):
        quantization.quantize_bundle(small, tmp_path / "again")
    with pytest.raises(InputError, match="is the bundle itself"):
        quantization.quantize_bundle(TINY, TINY)
    with pytest.raises(InputError, match="no such file"):
        quantization.quantize_bundle(tmp_path / "none", tmp_path / "b")
    assert not (tmp_path / "again").exists()
