"""Baselines in closed form, what a viewer sees, and the bias of the tokens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signsplice_paper import baselines, bias, protocol, viewed
from signsplice_paper.baselines import Linear, Ridge, RidgeAnswers, fit_ridge
from signsplice_paper.position_baselines import WordCuts
from signsplice_paper.prediction import Prediction
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
    exact = fit_ridge((inputs, inputs @ law + 3.0), (inputs, inputs @ law + 3.0))
    assert exact.regulariser == min(baselines.REGULARISERS)
    assert np.allclose(exact(inputs), inputs @ law + 3.0, atol=1e-2)
    noise = rng.normal(size=(12, 2))
    noisy = fit_ridge(
        (rng.normal(size=(12, 6)), noise), (rng.normal(size=(100, 6)), np.zeros((100, 2)) + noise.mean(0))
    )
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
    views = []
    for number in range(5):
        pre, post, frames = pairs.truth(number)
        true = Prediction(pre, post, frames.astype(np.float64), rotations=pairs.truth(number, "rotations")[2])
        seen = viewer.view(number, true)
        assert seen.jumps == 0.0
        assert seen.bone_change < 1e-4
        noise = np.random.default_rng(number).normal(size=frames.shape) * 0.05
        shaken = viewer.view(number, replace(true, frames=true.frames + noise, rotations=None))
        assert shaken.jumps == 1.0
        assert shaken.bone_change > 0.2
        views += [seen, shaken]
    found = viewed.summarise(views)
    assert found["joint_jumps"] == 0.5
    assert np.isnan(viewer.view(0, Prediction(None, None, np.zeros((0, 159)))).bone_change)


def test_frames_with_bones_kept_have_the_lengths_of_the_words_bones() -> None:
    pairs = corpus()
    viewer = viewed.Viewer(pairs)
    pre, post, true = pairs.truth(3)
    noise = np.random.default_rng(0).normal(size=true.shape) * 0.02
    shaken = Prediction(pre, post, true + noise)
    kept = viewer.fit_bones(3, shaken)
    assert (kept.pre, kept.post, kept.frames.shape) == (pre, post, true.shape)
    assert viewer.view(3, shaken).bone_change > 0.1
    assert viewer.view(3, kept).bone_change < 1e-4
    exact = viewer.fit_bones(3, Prediction(pre, post, true.astype(np.float64)))
    assert np.abs(exact.frames - true).mean() < 0.001, "within two millimetres, true frames stay where they are"
    for lost in (replace(shaken, pre=None), replace(shaken, frames=shaken.frames[:0])):
        assert viewer.fit_bones(3, lost) is lost, "nothing to put on a skeleton"


def test_the_bias_lets_nearly_all_validation_pairs_emit_both_tokens() -> None:
    lacking = np.linspace(-1.0, 3.0, 2001)
    found = bias.choose_bias(lacking)
    assert np.mean(lacking < found) >= bias.EMITTED
    assert found < 3.0, "the last pairs do not decide"
    assert bias.choose_bias(np.array([0.5, 0.2])) == pytest.approx(0.501), "of a few pairs, all emit"
    assert bias.choose_bias(np.full(1000, -2.0)) == 0.0, "tokens that win anyway need none"
