"""Training data of the network that cuts and times: draws are words of one signer with the truth of every pair."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from signsplice.rig.info import FEATURE_FPS
from signsplice.splicing import features
from signsplice.splicing.features import PHASES
from signsplice_workshop.train.cut_data import CutDataset, CutDraw, classify_phases, read_words
from training_toys import signing


@pytest.fixture(scope="module")
def paths() -> list[Path]:
    """The file of one signer with five words."""
    return sorted(signing(1, 5, 0, 6).glob("*.npz"))


def word_lengths(draw: CutDraw) -> list[int]:
    """Frames of every word, from the seconds since the first frame; tokens may repeat the last frame."""
    return [round(float(tokens[-1, -2]) * FEATURE_FPS) + 1 for tokens, _ in draw.words]


def test_a_draw_is_words_of_one_signer_and_their_truth(paths: list[Path]) -> None:
    words = read_words(paths[0])
    clean = CutDataset(paths, n_fixed=3)
    assert clean.n_words == 5
    draw = clean.draw(1)
    flipped = features.left_hand_busier(*words.trajectories)
    known = [features.word_tokens(features.mirror_trajectory(t) if flipped else t) for t in words.trajectories]
    order = [next(k for k, one in enumerate(known) if np.array_equal(one, tokens)) for tokens, _ in draw.words]
    assert sorted(order) == [0, 1, 2, 3, 4]
    for row, p in enumerate(order):
        tokens, phases = draw.words[row]
        assert len(tokens) == len(phases)
        np.testing.assert_array_equal(phases[: len(words.phases[p])], words.phases[p])
        for column, q in enumerate(order):
            pre, post, _ = words.true_cuts[p, q]
            assert (draw.pre[row, column], draw.post[row, column]) == (pre, post)


def test_augmented_words_keep_their_truth(paths: list[Path]) -> None:
    words, dataset = read_words(paths[0]), CutDataset(paths)
    clean_lengths = {len(trajectory) for trajectory in words.trajectories}
    draws = [dataset.draw(number) for number in range(6)]
    lengths = {length for draw in draws for length in word_lengths(draw)}
    assert lengths & {n - 1 for n in clean_lengths}, "sampled between frames there is one frame fewer"
    assert lengths & clean_lengths
    for draw in draws:
        for k, (tokens, phases) in enumerate(draw.words):
            assert len(tokens) == len(phases)
            assert draw.pre[k].max() < len(tokens)
            assert draw.post[:, k].max() < len(tokens)
            sign = np.flatnonzero(np.isin(phases, [PHASES.index("hold"), PHASES.index("stroke")]))
            assert (draw.pre[k] > sign[0] - 3).all(), "no word is left before its sign"


def test_phases_follow_one_another(paths: list[Path]) -> None:
    signs = set()
    for phases in read_words(paths[0]).phases:
        order = [PHASES[k] for k in (int(phases[0]), *(int(b) for a, b in pairwise(phases) if a != b))]
        assert (order[:2], order[-2:]) == (["rest", "preparation"], ["retraction", "rest"])
        signs.add(tuple(order[2:-2]))
    assert signs <= {("hold",), ("stroke",), ("hold", "stroke"), ("stroke", "hold"), ("hold", "stroke", "hold")}


def test_a_posture_is_a_hold_and_movements_are_a_stroke() -> None:
    at = np.arange(9)
    still = classify_phases(at, (1, 3, 6, 8, -1, -1, -1, -1))
    assert [PHASES[k] for k in still] == ["rest"] * 2 + ["preparation"] + ["hold"] * 4 + ["retraction", "rest"]
    moving = classify_phases(at, (1, 3, 6, 8, 3, 4, 4, 5))
    assert [PHASES[k] for k in moving[3:7]] == ["stroke"] * 3 + ["hold"]
