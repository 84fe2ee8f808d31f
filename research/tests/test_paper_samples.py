"""Scores on other pairs than the test part: pairs that taught and validation pairs; and the mean transition."""

from __future__ import annotations

import math

import numpy as np
import pytest

from signsplice.signer.signer import stream
from signsplice_paper import mean_transition, pair_samples, protocol
from signsplice_paper.extra_metrics import resample_frames
from toys import Fake, corpus


def test_the_samples_are_fixed_and_of_their_part() -> None:
    pairs = corpus()
    for part in ("train", "test"):
        assert set(pair_samples.sample(pairs, "random", part)) == set(pairs.split("random", part)), "all of a few pairs"
    some = pair_samples.sample(pairs, "random", "train", 4)
    assert some == sorted(some)
    assert len(set(some) & set(pairs.split("random", "train"))) == 4
    assert pair_samples.sample(pairs, "random", "train", 4) == some
    valid, numbers = pair_samples.sample_validation(pairs, "random"), pairs.split("random", "valid")
    order = stream("judged", len(numbers)).permutation(len(numbers))
    assert valid == [numbers[k] for k in order], "the order in which a training judges"
    assert pair_samples.sample_validation(pairs, "random", 1) == valid[:1]
    assert pair_samples.sample_validation(pairs, "unseen-words") == []


def test_paa_and_accuracy_of_some_pairs() -> None:
    pairs = corpus()
    system = Fake(pairs, late=1, off=0.01)
    numbers = pair_samples.sample(pairs, "random", "train")
    assert protocol.compute_paa(protocol.make_position_answer(pairs, system), pairs, numbers) == 0.0
    assert protocol.compute_paa(protocol.make_position_answer(pairs, Fake(pairs)), pairs, numbers) == 1.0
    assert protocol.compute_accuracy(protocol.make_answer(pairs, system), pairs, numbers) == pytest.approx(0.99)
    assert math.isnan(protocol.compute_accuracy(protocol.make_answer(pairs, system), pairs, []))


def test_the_mean_transition_is_of_the_training_part() -> None:
    pairs = corpus()
    numbers = pairs.split("random", "train")
    made = mean_transition.MeanAnswers(pairs, "random")(0)
    count = round(np.mean([pairs.index[k, 5] for k in numbers]))
    assert made.frames.shape == (count, 159)
    assert np.allclose(
        made.frames, np.mean([resample_frames(pairs.truth(k)[2].astype(float), count) for k in numbers], axis=0)
    )
    assert (made.pre, made.post) == (None, None)
