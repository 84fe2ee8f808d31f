"""The benchmark's scorer, numpy alone, gives the scores of the judge; and what it refuses."""

from __future__ import annotations

import ast
import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signsplice_paper import predictions, protocol
from toys import Fake, corpus

FILE = Path(__file__).resolve().parents[1] / "benchmark" / "score.py"


def scorer() -> Any:
    spec = importlib.util.spec_from_file_location("benchmark_score", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "errors",
    [{}, {"longer": 1}, {"longer": -2}, {"late": 1, "off": 0.004}, {"silent": True, "off": 0.011}],
    ids=["true", "longer", "shorter", "late", "silent"],
)
def test_scores_equal_those_of_the_judge(errors: dict[str, Any], tmp_path: Path) -> None:
    pairs, score = corpus(), scorer()
    chosen = protocol.choose(pairs, "random", "train")
    answer = protocol.make_answer(pairs, Fake(pairs, **errors))
    predictions.write(answer, chosen, tmp_path / "made")
    _, truth = score.read_truth(pairs.folder, "random", "train")
    found = score.compute_scores(score.read_predictions(tmp_path / "made", set(truth), 159), truth)
    judged = protocol.judge(answer, pairs, chosen).scores
    assert len(found) == 20
    for name, value in found.items():
        assert value == pytest.approx(judged[name], abs=1e-6, nan_ok=True), name


def test_the_scorer_imports_nothing_but_numpy_and_the_standard_library() -> None:
    tree = ast.parse(FILE.read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names) == {"numpy"}


def test_a_pair_left_out_and_frames_of_another_form_are_refused(tmp_path: Path) -> None:
    pairs, score = corpus(), scorer()
    chosen = protocol.choose(pairs, "random", "train")
    predictions.write(protocol.make_answer(pairs, Fake(pairs)), chosen, tmp_path / "made")
    numbers = set(chosen.pair_numbers)
    with pytest.raises(SystemExit, match="expected each of"):
        score.read_predictions(tmp_path / "made", numbers | {10**6}, 159)
    with pytest.raises(SystemExit, match="expected finite numbers"):
        score.read_predictions(tmp_path / "made", numbers, 12)
    splices = np.load(tmp_path / "made" / "splices.npy")
    np.save(tmp_path / "made" / "splices.npy", splices + np.array([0, 0, 0, 1, 0]))
    with pytest.raises(SystemExit, match=r"not in frames\.npy"):
        score.read_predictions(tmp_path / "made", numbers, 159)
