"""Small corpora and systems that need no network."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signsplice.motion import FloatArray
from signsplice.signer import notation
from signsplice_paper import bleu, bundles, curve, metrics, results
from signsplice_paper.configs import read_config
from signsplice_paper.curve import Curve
from signsplice_paper.prediction import Prediction
from signsplice_paper.results import ResultRow
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs

GOLDEN = Path(__file__).parent / "golden"
DOCS = Path(__file__).resolve().parents[1] / "docs"
"""The committed results and pages."""
GLOSSES = ("HELLO", "DEAF", "SIGN", "YOU", "SEE")


@cache
def _folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="signsplice-paper-"))
    atexit.register(shutil.rmtree, folder, True)
    return folder


@cache
def corpus() -> Pairs:
    """Five words, 25 pairs, and five by the second signer."""
    signs = notation.everyday()
    return Pairs(write_pairs(Recipe(tuple(signs[g] for g in GLOSSES), fps=15.0, n_other=5), _folder() / "p", None, 1))


@cache
def golden() -> Pairs:
    """Two words, four pairs, all of them test pairs of the random split."""
    folder = _folder() / "golden"
    folder.mkdir()
    with np.load(GOLDEN / "paper_pairs.npz") as file:
        for name in file.files:
            if name == "head":
                (folder / "corpus.json").write_text(str(file[name]))
            else:
                np.save(folder / f"{name}.npy", file[name])
    return Pairs(folder)


@dataclass(frozen=True)
class Fake:
    """A system that knows the truth of every pair of a corpus by its words, with errors on request.

    - longer: extra frames at the end, negative for missing ones
    - late: frames by which pre is too early
    - off: error of every number
    - silent: whether both tokens are missing
    """

    pairs: Pairs
    name: str = "fake"
    longer: int = 0
    late: int = 0
    off: float = 0.0
    silent: bool = False

    def predict(self, before: FloatArray, after: FloatArray) -> Prediction:
        pre, post, frames = self._truth(before, after)
        out = np.asarray(frames, np.float64) + self.off
        out = (
            np.concatenate([out, np.repeat(out[-1:], self.longer, axis=0)]) if self.longer >= 0 else out[: self.longer]
        )
        return Prediction(None if self.silent else pre - self.late, None if self.silent else post, out)

    def positions(self, before: FloatArray, after: FloatArray) -> tuple[int | None, int | None]:
        found = self.predict(before, after)
        return found.pre, found.post

    def _truth(self, before: FloatArray, after: FloatArray) -> tuple[int, int, Any]:
        for number in range(len(self.pairs)):
            p, q = self.pairs.index[number, :2].tolist()
            if np.array_equal(self.pairs.word(p), before) and np.array_equal(self.pairs.word(q), after):
                return self.pairs.truth(number)
        raise AssertionError("words of no pair")


def row(system: str = "lpt-plus", **changes: Any) -> ResultRow:
    """A row with plausible scores."""
    scores = {
        "accuracy": 0.98,
        "mse": 0.0016,
        "ms_mean": 10.0,
        "ms_median": 9.0,
        "pta": 0.99,
        "paa": 0.9,
        "paa_all": 0.8,
    }
    scores |= {f"bleu-{n}": 0.9 - 0.1 * n for n in range(1, 5)}
    scores |= {f"bleu-4@{t:g}": 0.5 for t in bleu.TOLERANCES}
    scores |= changes.pop("scores", {})
    fields: dict[str, Any] = {
        "split": "random",
        "scale": "cpu",
        "optimiser": "adamw",
        "fr": 8,
        "seed": 0,
        "steps": 100,
        "corpus": "c0ffee",
        "protocol": "paper|corpus:c0ffee|split:random",
        "metrics_id": results.hash_signatures(),
        "n_pairs": 3,
        "machine": "a machine",
    }
    return ResultRow(system, scores=scores, **(fields | changes))


def committed_results() -> results.Results:
    """The committed results; a test is skipped while they are missing, or of an earlier version."""
    path = DOCS / results.FILE
    if not path.is_file() or json.loads(path.read_text(encoding="utf-8"))["version"] != results.VERSION:
        pytest.skip(f"{path}: holds no results of version {results.VERSION} yet")
    return results.load(path)


def of_rows(*rows: ResultRow) -> results.Results:
    """Results with these rows."""
    return results.Results().merge(rows)


def write_bundle(folder: Path, pairs: Pairs, last: float = 0.999, **changes: Any) -> Path:
    """A bundle without networks, and with a curve that ends at the Accuracy ``last``."""
    contents = {
        "version": 1,
        "system": "lpt-plus",
        "config": {},
        "fr": 8,
        "scale": "smoke",
        "optimiser": "adamw",
        "split": "random",
        "corpus": pairs.head["hash"],
        "seed": 0,
        "steps": 20,
        "files": {},
        "n_parameters": 123,
    }
    folder.mkdir(parents=True)
    (folder / "bundle.json").write_text(json.dumps(contents | changes))
    known = bundles.make_result_row(read_config(folder))
    points = [(64.0 * step, None, last + (step - 20) / 100.0, 0.01, 0.9, 0.8) for step in range(5, 25, 5)]
    made = Curve(
        known.system, "random", known.scale, known.optimiser, known.fr, known.seed,
        points, curve.COLUMNS, known.bundle or "", known.corpus, 3,
    )  # fmt: skip
    curve.save(made, folder)
    return folder


def motion(n: int, seed: int = 0) -> FloatArray:
    """Frames (n, 159) of a smooth random motion."""
    rng = np.random.default_rng(seed)
    return np.asarray(np.cumsum(rng.normal(size=(n, metrics.NUMBERS)) * 0.01, axis=0))
