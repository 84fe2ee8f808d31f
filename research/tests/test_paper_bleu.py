"""BLEU over frames: worked examples, Papineni's BLEU for symbols, slow references, and its properties."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
from signsplice.motion import FloatArray
from signsplice_paper import bleu
from toys import motion

Symbols = list[int]
symbols = st.lists(st.integers(0, 3), min_size=0, max_size=8)


def spelled(word: Symbols) -> FloatArray:
    return np.repeat(np.array(word, float).reshape(-1, 1), 159, axis=1)


def of(pairs: list[tuple[FloatArray, FloatArray]], tolerance: float = bleu.TOLERANCE) -> bleu.Bleu:
    return bleu.compute_papineni_bleu([bleu.count_ngrams(p, t, [tolerance])[tolerance] for p, t in pairs])


def test_clipping_of_papinenis_example() -> None:
    """Seven times "the" against "the cat is on the mat": 2 / 7, his own example."""
    found = of([(spelled([1] * 7), spelled([1, 2, 3, 4, 1, 5]))])
    assert found.precisions[0] == pytest.approx(2 / 7)
    assert found.precisions[1] == 0.0
    assert found.bleu == pytest.approx((2 / 7, 0.0, 0.0, 0.0))


def test_orders_and_brevity_of_a_worked_example() -> None:
    found = of([(spelled([1, 2, 3, 4]), spelled([1, 2, 3, 5, 4]))])
    assert found.precisions == pytest.approx((1.0, 2 / 3, 0.5, 0.0))
    brevity = math.exp(1 - 5 / 4)
    assert found.brevity == pytest.approx(brevity)
    assert found.bleu[2] == pytest.approx(brevity * (2 / 3 * 0.5) ** (1 / 3))
    assert found.bleu[3] == 0.0


def test_counts_are_summed_over_the_corpus() -> None:
    found = of([(spelled([1, 2]), spelled([1, 2])), (spelled([3, 4, 5, 6]), spelled([7, 8, 9, 9]))])
    assert found.precisions[:2] == pytest.approx((2 / 6, 1 / 4))


def test_empty_predictions_score_zero_and_empty_truths_are_undefined() -> None:
    assert of([(spelled([]), spelled([1, 2, 3, 4]))]).bleu == (0.0, 0.0, 0.0, 0.0)
    short = of([(spelled([1, 2]), spelled([1, 2]))])
    assert short.bleu[:2] == (1.0, 1.0)
    assert all(math.isnan(value) for value in short.bleu[2:]), "no true transition has three frames"


def test_the_matching_is_maximum_not_greedy() -> None:
    """Frame 0 is near both true frames, frame 1 only near the first: a greedy matching would lose one."""
    step = math.sqrt(bleu.TOLERANCE)
    predicted, true = spelled([0, 0]), spelled([0, 0])
    predicted[0], predicted[1] = 0.5 * step, -0.9 * step
    true[0], true[1] = 0.0, 1.2 * step
    assert bleu.count_ngrams(predicted, true)[bleu.TOLERANCE].matched[0] == 2


@given(st.lists(st.tuples(symbols, symbols), min_size=1, max_size=4))
def test_zero_tolerance_gives_papinenis_counts(pairs: list[tuple[Symbols, Symbols]]) -> None:
    for p, t in pairs:
        found = bleu.count_ngrams(spelled(p), spelled(t), [0.0])[0.0]
        for n in range(1, 5):
            a, b = (Counter(tuple(w[k : k + n]) for k in range(len(w) - n + 1)) for w in (p, t))
            assert found.matched[n - 1] == sum((a & b).values()), "clipped counts"
            assert found.predicted[n - 1] == max(0, len(p) - n + 1)


@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 10_000), st.sampled_from([2e-5, 1e-4, 4e-4]))
def test_counts_equal_the_slow_references(n: int, m: int, seed: int, tolerance: float) -> None:
    a, b = motion(n, seed), 0.3 * motion(m, seed + 1)
    found = bleu.count_ngrams(a, b, [tolerance])[tolerance]
    for order in range(1, 5):
        assert found.matched[order - 1] == reference.matched(a, b, order, tolerance)
    equal = (
        bleu.compare_ngrams(bleu.compute_frame_distances(a, b) <= tolerance, 1) if n and m else np.zeros((n, m), bool)
    )
    assert found.matched[0] == reference.matched_by_trying(equal)
    value = of([(a, b)], tolerance).bleu[1]
    if not math.isnan(value):
        assert value == pytest.approx(reference.bleu([(a, b)], 2, tolerance))


@given(st.integers(4, 9), st.integers(4, 9), st.integers(0, 10_000))
def test_a_larger_tolerance_never_lowers_bleu(n: int, m: int, seed: int) -> None:
    a, b = 0.2 * motion(n, seed), 0.2 * motion(m, seed + 1)
    tolerances = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1.0)
    counts = bleu.count_ngrams(a, b, tolerances)
    values = [bleu.compute_papineni_bleu([counts[t]]).bleu for t in tolerances]
    for narrow, wide in pairwise(values):
        assert all(x <= y + 1e-12 for x, y in zip(narrow, wide, strict=True))
    for value in values:
        assert all(0.0 <= x <= 1.0 for x in value)
    brevity = 1.0 if n >= m else math.exp(1 - m / n)
    assert values[-1][0] == pytest.approx(brevity * min(n, m) / n), "all frames are equal, and each matches once"


@given(st.integers(4, 9), st.integers(0, 10_000))
def test_the_truth_scores_one_and_reversed_frames_do_not(n: int, seed: int) -> None:
    a = motion(n, seed)
    assert of([(a, a)], 0.0).bleu == (1.0, 1.0, 1.0, 1.0)
    backwards = of([(a[::-1], a)], 1e-9)
    assert backwards.bleu[0] == 1.0
    assert backwards.precisions[1] == 0.0


def papers(pairs: list[tuple[FloatArray, FloatArray]], tolerance: float = 0.0) -> tuple[float, ...]:
    return bleu.compute_mean_bleu([bleu.count_ngrams(p, t, [tolerance])[tolerance] for p, t in pairs])


def test_the_papers_bleu_is_the_share_of_predicted_ngrams_that_are_found() -> None:
    """Not clipped, one n alone, no brevity penalty; the paper's example counts [T1, T2], [T2, T3], ..."""
    predicted, true = spelled([1, 2, 3, 4]), spelled([9, 1, 2, 7, 3])
    assert papers([(predicted, true)]) == (3 / 4, 1 / 3, 0.0, 0.0)
    assert papers([(spelled([1] * 7), spelled([1, 2, 3, 4, 1, 5]))])[0] == 1.0, "a repeated frame is found each time"
    assert papers([(spelled([1, 2]), spelled([1, 2, 3, 4, 5, 6]))])[:2] == (1.0, 1.0), "no brevity penalty"


def test_the_papers_bleu_is_the_mean_over_pairs_with_true_ngrams() -> None:
    whole, half = (spelled([1, 2, 3, 4]),) * 2, (spelled([1, 9]), spelled([1, 2, 3, 4]))
    silent, short = (spelled([]), spelled([1, 2, 3, 4])), (spelled([1, 2]), spelled([1, 2]))
    assert papers([whole, half])[0] == 0.75, "pairs count alike, whatever their length"
    assert papers([whole, silent])[0] == 0.5, "a pair without predicted frames counts 0"
    assert papers([whole, half])[2] == 0.5, "so does a prediction too short for an n-gram"
    assert papers([whole, short])[2] == 1.0, "a truth too short for an n-gram is left out"
    assert math.isnan(papers([short])[2])


@given(st.lists(st.tuples(symbols, symbols), min_size=1, max_size=4))
def test_the_papers_bleu_of_symbols_by_hand(pairs: list[tuple[Symbols, Symbols]]) -> None:
    found = papers([(spelled(p), spelled(t)) for p, t in pairs])
    for n in range(1, 5):
        shares = []
        for p, t in pairs:
            made, true = ([tuple(w[k : k + n]) for k in range(len(w) - n + 1)] for w in (p, t))
            if true:
                shares.append(sum(gram in true for gram in made) / len(made) if made else 0.0)
        assert found[n - 1] == pytest.approx(np.mean(shares)) if shares else math.isnan(found[n - 1])
