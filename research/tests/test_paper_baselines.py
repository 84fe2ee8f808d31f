"""Baselines in closed form, what a viewer sees, and the bias of the tokens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signsplice_paper import baselines, bias, protocol, viewed
from signsplice_paper.baselines import Linear, Ridge, RidgeAnswers, fitted
from signsplice_paper.extra_metrics import number_layout
from signsplice_paper.position_baselines import WordCuts
from signsplice_paper.prediction import Prediction
from signsplice_paper.systems.splicers import NONE, POST, PRE
from signsplice_workshop.corpora.pairs import Pairs
from toys import corpus


def taught(pairs: Pairs) -> list[int]:
    return pairs.split("random", "train")


def test_the_commonest_cut_is_the_mode_of_the_training_part_and_reads_no_test_pair() -> None:
    pairs = corpus()
    cuts = WordCuts(pairs, "random", commonest=True)
    for number in pairs.split("random", "test"):
        p, q = pairs.index[number, :2].tolist()
        pre, post = cuts(number)
        as_before = [pairs.index[k, 2] for k in taught(pairs) if pairs.index[k, 0] == p]
        as_after = [pairs.index[k, 3] for k in taught(pairs) if pairs.index[k, 1] == q]
        assert not as_before or as_before.count(pre) == max(map(as_before.count, as_before))
        assert not as_after or as_after.count(post) == max(map(as_after.count, as_after))


def test_cuts_of_a_word_that_was_not_taught_lie_in_the_word() -> None:
    pairs = corpus()
    cuts = WordCuts(pairs, "random", commonest=False)
    cuts._cuts = ({}, {})
    for number in range(len(pairs)):
        p, q = pairs.index[number, :2].tolist()
        pre, post = cuts(number)
        assert 0 <= pre < len(pairs.word(p))
        assert 0 <= post < len(pairs.word(q))


def test_regression_finds_a_linear_law_and_the_validation_part_chooses_its_regulariser() -> None:
    rng = np.random.default_rng(0)
    inputs, law = rng.normal(size=(200, 6)), rng.normal(size=(6, 2))
    exact = fitted((inputs, inputs @ law + 3.0), (inputs, inputs @ law + 3.0))
    assert exact.regulariser == min(baselines.REGULARISERS)
    assert np.allclose(exact(inputs), inputs @ law + 3.0, atol=1e-2)
    noise = rng.normal(size=(12, 2))
    noisy = fitted((rng.normal(size=(12, 6)), noise), (rng.normal(size=(100, 6)), np.zeros((100, 2)) + noise.mean(0)))
    assert noisy.regulariser == max(baselines.REGULARISERS), "nothing to learn: the strongest"
    assert isinstance(noisy, Linear)


def test_ridge_answers_are_predictions_with_the_numbers_of_the_corpus() -> None:
    pairs = corpus()
    ridge = Ridge(pairs, "random", fr=2)
    chosen = protocol.choose(pairs, "random", "train")
    answer = RidgeAnswers(ridge, lambda k: (int(pairs.index[k, 2]), int(pairs.index[k, 3])))
    judged = protocol.judge(answer, pairs, chosen)
    assert judged.scores["paa"] == 1.0
    assert judged.scores["accuracy"] > 0.9
    silent = RidgeAnswers(ridge, lambda _: (None, None))(0)
    assert silent.frames.shape == (0, pairs.spaces[0].n_numbers)


def test_the_truth_jumps_nowhere_and_keeps_its_bones_and_a_shaken_one_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewed, "JUMP_DEG", 120.0)  # the toy has half the corpus's frames a second
    pairs = corpus()
    viewer = viewed.Viewer(pairs)
    layout = number_layout(pairs.word_clip(0), pairs.spaces[0])
    views = []
    for number in range(5):
        pre, post, frames = pairs.truth(number)
        true = Prediction(pre, post, frames.astype(np.float64), rotations=pairs.truth(number, "rotations")[2])
        seen = viewer.view(number, true, layout)
        assert (seen.jumps, seen.velocity_error) == (0.0, 0.0)
        assert seen.bone_change < 1e-4
        noise = np.random.default_rng(number).normal(size=frames.shape) * 0.05
        shaken = viewer.view(number, replace(true, frames=true.frames + noise, rotations=None), layout)
        assert shaken.jumps == 1.0
        assert shaken.bone_change > 0.2
        views += [seen, shaken]
    found = viewed.summary(views)
    assert found["joint_jumps"] == 0.5
    assert 0 < found["n_unlike"] < len(views)
    assert np.isnan(viewer.view(0, Prediction(None, None, np.zeros((0, 159))), layout).bone_change)


class Logits:
    """A system whose tokens lack ``number / 10`` of their emission in pair ``number``."""

    def __init__(self, pairs: Pairs) -> None:
        self.pairs, self.lacking = pairs, [k / 10 for k in range(len(pairs.split("random", "valid")))]
        self.asked = 0

    def tokens(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        logits = np.zeros((len(before) + len(after), 3), np.float32)
        logits[:, NONE] = 9.0
        logits[2, PRE], logits[-2, POST] = 9.0 - self.lacking[self.asked], 8.9
        self.asked += 1
        return logits


def test_the_bias_lets_nearly_all_validation_pairs_emit_both_tokens() -> None:
    pairs = corpus()
    system = Logits(pairs)
    found = bias.token_bias(system, pairs, "random")  # type: ignore[arg-type]
    assert found == pytest.approx(max(0.1, *system.lacking, 0.0) + 1e-3, abs=1e-5)
    assert bias.of_margins(np.full(1000, -2.0)) == 0.0, "tokens that win anyway need none"
