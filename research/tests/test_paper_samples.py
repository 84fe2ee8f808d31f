"""Scores on other pairs than the test part: pairs that taught, validation pairs, pairs by their margin; the mean."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.signer import notation
from signsplice.signer.signer import stream
from signsplice_paper import margins, mean_transition, pair_samples, protocol
from signsplice_paper.extra_metrics import stretched
from signsplice_paper.margins import cut_margins
from signsplice_workshop.corpora import truth
from toys import Fake, corpus


def test_the_samples_are_fixed_and_of_their_part() -> None:
    pairs = corpus()
    taught, valid = pair_samples.taught(pairs, "random"), pair_samples.validation(pairs, "random")
    assert set(taught) == set(pairs.split("random", "train")), "all of a part smaller than the sample"
    numbers = pairs.split("random", "valid")
    order = stream("judged", len(numbers)).permutation(len(numbers))
    assert valid == [numbers[k] for k in order], "the order in which a training judges"
    assert pair_samples.validation(pairs, "random", 1) == valid[:1]
    assert pair_samples.validation(pairs, "unseen-words") == []


def test_paa_and_accuracy_of_some_pairs() -> None:
    pairs = corpus()
    system = Fake(pairs, late=1, off=0.01)
    numbers = pair_samples.taught(pairs, "random")
    assert protocol.paa(protocol.positions(pairs, system), pairs, numbers) == 0.0
    assert protocol.paa(protocol.positions(pairs, Fake(pairs)), pairs, numbers) == 1.0
    assert protocol.accuracy(protocol.answers(pairs, system), pairs, numbers) == pytest.approx(0.99)
    assert math.isnan(protocol.accuracy(protocol.answers(pairs, system), pairs, []))


def test_pairs_are_grouped_by_their_margin() -> None:
    off = {1: (0, 0), 2: (0, 1), 3: (0, 0), 4: None, 5: (0, 0), 6: (2, 0)}
    found = pair_samples.by_margin(off, {1: 0.0, 2: 0.0999, 3: 0.1, 4: 0.4, 5: 0.5})
    assert [found[f"n_margin_{n}"] for n in range(1, 5)] == [2, 1, 0, 1]
    assert [found[f"paa_margin_{n}"] for n in (1, 2, 4)] == [0.5, 1.0, 1.0]
    assert math.isnan(found["paa_margin_3"])
    assert pair_samples.by_margin(off, {}) == {}
    assert len(pair_samples.margin_names()) == len(pair_samples.MARGINS) + 1


@pytest.mark.parametrize(
    ("cut", "frame", "margin"),
    [
        (truth.CutTime(10, 2.4), 12, 0.1),
        (truth.CutTime(10, 2.6), 13, 0.1),
        (truth.CutTime(10, -2.4), 8, 0.1),
        (truth.CutTime(10, 0.0), 10, 0.5),
        (truth.CutTime(10, -2.9, towards_posture=True), 8, 0.1),
        (truth.CutTime(10, -2.1, towards_posture=True), 8, 0.1),
        (truth.CutTime(10, -0.1, towards_posture=True), 10, 0.5),
        (truth.CutTime(10, 0.8, towards_posture=True), 10, 0.2),
    ],
)
def test_a_cut_moved_by_its_margin_is_rounded_to_another_frame(cut: truth.CutTime, frame: int, margin: float) -> None:
    assert cut.frame == frame
    assert margins.margin(cut) == pytest.approx(margin)
    moved = [
        truth.CutTime(cut.posture, cut.frames + sign * (margin + 1e-6), cut.towards_posture).frame for sign in (-1, 1)
    ]
    if margin < 0.5:
        assert any(other != frame for other in moved)
    near = [truth.CutTime(cut.posture, cut.frames + sign * 0.9 * margin, cut.towards_posture).frame for sign in (-1, 1)]
    assert near == [frame, frame]


def test_margins_are_those_of_the_corpus_and_stored(tmp_path: Path) -> None:
    pairs, path = corpus(), tmp_path / "margins.json"
    numbers = list(range(0, len(pairs), 4))
    said: list[str] = []
    found = margins.of_pairs(path, pairs, numbers, said.append)
    assert set(found) == set(numbers), "every cut is planned anew as it is stored"
    assert all(0.0 <= margin <= 0.5 for margin in found.values())
    assert len(said) == 1
    assert margins.of_pairs(path, pairs, numbers, said.append) == found
    assert len(said) == 1, "a second call reads the file"
    signs = {gloss: sign for gloss, sign in notation.everyday().items() if gloss != "DEAF"}
    glosses = [word["gloss"] for word in pairs.head["words"]]
    left_out = {k for k in numbers if "DEAF" in {glosses[p] for p in pairs.index[k, :2].tolist()}}
    assert set(cut_margins(pairs, numbers, signs)) == set(numbers) - left_out
    path.write_text(json.dumps({"corpus": "another", "margins": {"1": 0.1}}))
    assert margins.known(path, pairs) == {}
    path.write_text("[]")
    with pytest.raises(InputError, match=r"margins.json: holds no margins"):
        margins.known(path, pairs)


def test_the_mean_transition_is_of_the_training_part() -> None:
    pairs = corpus()
    numbers = pairs.split("random", "train")
    made = mean_transition.MeanAnswers(pairs, "random")(0)
    count = round(np.mean([pairs.index[k, 5] for k in numbers]))
    assert made.frames.shape == (count, 159)
    assert np.allclose(
        made.frames, np.mean([stretched(pairs.truth(k)[2].astype(float), count) for k in numbers], axis=0)
    )
    assert (made.pre, made.post) == (None, None)
