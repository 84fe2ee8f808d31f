"""The paper's scores: worked examples, slow references, and the metrics beyond the paper's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
from signsplice.motion import FloatArray
from signsplice.rig import metrics as scores
from signsplice_paper import bleu, extra_metrics, metrics
from signsplice_paper.prediction import Prediction
from signsplice_workshop.measure import motion_scores
from toys import corpus, motion


def frames(*values: float) -> FloatArray:
    """One frame for each value, with all its numbers equal to the value."""
    return np.repeat(np.array(values, float)[:, None], 159, axis=1)


def test_accuracy_of_worked_examples() -> None:
    assert metrics.compute_accuracy(frames(0.1, 0.2), frames(0.1, 0.2)) == 1.0
    assert metrics.compute_accuracy(frames(0.1, 0.2), frames(0.1, 0.0)) == pytest.approx(0.9)
    assert metrics.compute_accuracy(frames(0.0, 0.0), frames(0.1, -0.1)) == pytest.approx(0.9), "errors do not cancel"
    assert metrics.compute_accuracy(frames(0.1), frames(0.1, 0.1, 0.1), sigma=0.05) == pytest.approx(0.9)
    assert metrics.compute_accuracy(frames(*[0.0] * 30), frames(0.0), sigma=0.05) == pytest.approx(-0.45), "as printed"


def test_mse_of_worked_examples() -> None:
    assert metrics.compute_mse(frames(0.1, 0.2), frames(0.1, 0.2)) == 0.0
    assert metrics.compute_mse(frames(0.1, 0.3), frames(0.0, 0.1)) == pytest.approx(0.01 + 0.04), "frames are summed"
    one = frames(0.0)
    one[0, 0] = 0.3
    assert metrics.compute_mse(one, frames(0.0)) == pytest.approx(0.09 / 159), "numbers are averaged"
    assert metrics.compute_mse(frames(0.0), frames(0.0, 0.0, 0.0), frame_cost=9.0 / 159) == pytest.approx(36.0 / 159)


def test_an_extra_frame_costs_as_much_as_a_just_visible_error() -> None:
    long, true = frames(0.0, 0.0), frames(0.0)
    visible = frames(math.sqrt(metrics.VISIBLE))
    assert metrics.compute_mse(long, true) == pytest.approx(metrics.compute_mse(visible, true))
    assert metrics.compute_accuracy(long, true) == pytest.approx(metrics.compute_accuracy(visible, true))
    assert metrics.compute_mse(long, true) == pytest.approx(0.002)


@given(st.integers(1, 6), st.integers(1, 6), st.integers(0, 1000))
def test_accuracy_and_mse_equal_the_slow_reference(n: int, m: int, seed: int) -> None:
    a, b = motion(n, seed), motion(m, seed + 1)
    assert metrics.compute_accuracy(a, b) == pytest.approx(reference.accuracy(a, b, metrics.SIGMA))
    assert metrics.compute_mse(a, b) == pytest.approx(reference.squared_error(a, b, 0.5639148872))


def score_of(
    prediction: Prediction, true: tuple[int, int, FloatArray], words: tuple[FloatArray, FloatArray] | None = None
) -> metrics.PairScore:
    clip = corpus().word_clip(0)
    layout = extra_metrics.make_number_layout(clip, corpus().spaces[0])
    return metrics.score(prediction, true, words or (motion(20, 8), motion(20, 9)), layout)


def test_pta_and_paa_of_worked_examples() -> None:
    true = (5, 6, motion(5))
    rows = [
        score_of(Prediction(5, 6, true[2]), true),
        score_of(Prediction(5, 7, true[2]), true),
        score_of(Prediction(None, 6, true[2]), true),
        score_of(Prediction(5, None, true[2]), true),
    ]
    found = metrics.summarise(rows)
    assert found["pta"] == 0.5
    assert found["paa"] == 0.5
    assert found["paa_all"] == 0.25
    assert found["positions_off"] == 0.25
    assert found["accuracy"] == 1.0, "frames count without tokens"
    assert found["bleu-4"] == 1.0


def test_paa_is_undefined_without_tokens() -> None:
    true = (5, 6, motion(5))
    found = metrics.summarise([score_of(Prediction(None, None, np.empty((0, 159))), true)] * 2)
    assert found["pta"] == 0.0
    assert math.isnan(found["paa"])
    assert found["paa_all"] == 0.0
    assert found["bleu-1"] == 0.0
    assert found["mse"] == pytest.approx(25 * 0.002)
    assert math.isnan(found["motion_ratio"])


def test_errors_and_lengths_are_measured_apart() -> None:
    true = (5, 6, frames(0.0, 0.0))
    near, long = frames(0.1, 0.1), frames(0.0, 0.0, 0.0, 0.0)
    found = metrics.summarise([score_of(Prediction(5, 6, made), true) for made in (near, long)])
    assert found["mse_equal"] == pytest.approx(0.02), "the pair of another length is left out"
    assert found["accuracy_equal"] == pytest.approx(0.9)
    assert found["mse@0.0005"] == pytest.approx((0.02 + 4 * 0.0005) / 2)
    assert found["mse@0.002"] == found["mse"] == pytest.approx((0.02 + 4 * 0.002) / 2)
    assert found["mse@0.008"] == pytest.approx((0.02 + 4 * 0.008) / 2)
    assert (found["length_exact"], found["length_ratio"], found["n_frames"]) == (0.5, 1.5, 2.0)


def test_near_positions_are_counted_among_the_pairs_with_both_tokens() -> None:
    true = (5, 6, motion(5))
    positions = ((5, 6), (5, 7), (3, 7), (5, None))
    found = metrics.summarise([score_of(Prediction(pre, post, true[2]), true) for pre, post in positions])
    assert (found["pta"], found["paa"], found["paa_all"]) == (3 / 4, 1 / 3, 1 / 4)
    assert (found["within_1"], found["within_2"]) == (2 / 3, 1.0)


def test_another_number_of_numbers_keeps_the_cost_of_a_frame() -> None:
    few = np.full((2, 9), 0.1)
    assert metrics.compute_mse(few, np.zeros((2, 9))) == pytest.approx(0.02)
    assert metrics.compute_mse(few, np.zeros((3, 9))) == pytest.approx(metrics.VISIBLE)


def test_signatures_state_every_parameter() -> None:
    assert f"sigma:{metrics.SIGMA:.4f}" in metrics.SIGNATURES["accuracy"]
    assert f"lambda^2/K:{metrics.VISIBLE:g}" in metrics.SIGNATURES["mse"]
    assert f"msd<={bleu.TOLERANCE:g}" in metrics.SIGNATURES["bleu"]
    assert "of:predicted" in metrics.SIGNATURES["paa"]
    for name in ("accuracy", "mse", "bleu"):
        assert "compared:transition" in metrics.SIGNATURES[name]
    assert len(set(metrics.SIGNATURES.values())) == len(metrics.SIGNATURES)


def test_the_utterance_is_kept_frames_around_the_transition() -> None:
    before, after, new = motion(10, 1), motion(12, 2), motion(3, 3)
    whole = extra_metrics.join_utterance(before, after, Prediction(6, 4, new))
    assert whole is not None
    assert np.array_equal(whole, np.concatenate([before[:7], new, after[4:]]))
    assert extra_metrics.join_utterance(before, after, Prediction(None, 4, new)) is None
    pairs = corpus()
    pre, post, true = pairs.truth(7)
    p, q = pairs.index[7, :2].tolist()
    whole = extra_metrics.join_utterance(pairs.word(p), pairs.word(q), Prediction(pre, post, true))
    assert np.array_equal(np.asarray(whole), pairs.utterance(7)), "equals the utterance of the corpus"


def test_the_truth_has_no_error_and_the_smoothness_of_its_clip() -> None:
    pairs = corpus()
    pre, post, frames_ = pairs.truth(3)
    p, q = pairs.index[3, :2].tolist()
    words = pairs.word(p).astype(float), pairs.word(q).astype(float)
    found = metrics.summarise([score_of(Prediction(pre, post, frames_.astype(float)), (pre, post, frames_), words)])
    assert found["position_error"] < 1e-3, "the corpus stores 32 bits"
    assert found["motion_ratio"] == pytest.approx(1.0)
    clip = pairs.clip(3)
    wrists = [clip.skeleton.names.index(n) for n in clip.skeleton.names if n.endswith("Hand")]
    positions = motion_scores.relative_positions(clip, wrists)
    jump = scores.velocity_jump(positions / 100.0, pre + 1, pre + 1 + len(frames_), clip.fps)
    assert found["velocity_jump"] == pytest.approx(jump, rel=0.05), "m/s, scaled back"


def test_first_frames_and_later_ones_have_errors_of_their_own() -> None:
    pairs = corpus()
    pre, post, true = pairs.truth(3)
    p, q = pairs.index[3, :2].tolist()
    words = pairs.word(p).astype(float), pairs.word(q).astype(float)
    made = true.astype(float)
    made[2:] += 0.1 * motion(len(made) - 2)
    found = metrics.summarise([score_of(Prediction(pre, post, made), (pre, post, true.astype(float)), words)])
    assert found["first_frames_error"] == 0.0
    assert found["later_frames_error"] > 0.0
    assert found["velocity_error"] > 0.0
    late = metrics.summarise([score_of(Prediction(pre, post, made[1:]), (pre, post, true.astype(float)), words)])
    assert late["first_frames_error"] > 0.0, "frames are compared by their number, without stretching"


def test_held_frames_move_too_little_and_jump() -> None:
    pairs = corpus()
    pre, post, true = pairs.truth(3)
    p, q = pairs.index[3, :2].tolist()
    words = pairs.word(p).astype(float), pairs.word(q).astype(float)
    held = np.repeat(words[0][pre : pre + 1], len(true), axis=0)
    found = metrics.summarise([score_of(Prediction(pre, post, held), (pre, post, true), words)])
    right = metrics.summarise([score_of(Prediction(pre, post, true.astype(float)), (pre, post, true), words)])
    assert found["motion_ratio"] < 1.0
    assert found["velocity_jump"] > 2.0 * right["velocity_jump"]
    assert found["position_error"] > 20.0


def test_stretching_keeps_the_ends() -> None:
    x = motion(5)
    for count in (1, 2, 5, 9):
        y = extra_metrics.resample_frames(x, count)
        assert y.shape == (count, 159)
        assert np.allclose(y[0], x[0])
        assert count == 1 or np.allclose(y[-1], x[-1])
    assert np.allclose(extra_metrics.resample_frames(x[:1], 4), x[0])


def test_the_error_of_each_frame_is_counted_from_the_first_in_cm() -> None:
    layout = extra_metrics.NumberLayout(
        hips=0, arms=(1, 2), tips=(2,), wrists=(1, 2), arm_length=0.3, metres=2.0, fps=30.0
    )
    true = np.zeros((5, 159))
    made = np.zeros((3, 159))
    made[1, 3] = 0.01  # joint 1, 2 cm in x
    made[2, [3, 7]] = 0.02  # joints 1 and 2, 4 cm each
    assert np.allclose(extra_metrics.measure_frame_errors(made, true, layout), [0.0, 1.0, 4.0])
    moved = made + np.tile([0.1, 0.0, 0.0], 53)
    assert np.allclose(extra_metrics.measure_frame_errors(moved, true, layout), [0.0, 1.0, 4.0]), "seen from the hips"
    nan = float("nan")
    pairs = [extra_metrics.PairMotion(nan, errors, *[nan] * 5) for errors in ((1.0, 2.0, 6.0), (3.0,), ())]
    found = extra_metrics.summarise(pairs)
    assert found["first_frames_error"] == pytest.approx((1.0 + 2.0 + 3.0) / 3)
    assert found["later_frames_error"] == 6.0
    assert [found[f"frame_error-{n}"] for n in (1, 2, 3)] == [2.0, 2.0, 6.0]
    assert np.isnan(found["frame_error-4"])
