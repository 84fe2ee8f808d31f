"""Difficulty of a corpus, against cases that can be counted by hand."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from signsplice.signer import notation
from signsplice.splicing.curves import TRANSITIONS
from signsplice.splicing.cutters import CUTTERS
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure import corpus_difficulty

SIGNS = {**notation.everyday(), **notation.alphabet()}


def test_accuracy_of_cuts_counted_by_hand() -> None:
    cuts = [(1, 2), (3, 4), (5, 9), (7, 7)]
    truth = [(0, 1, 1, 2), (0, 1, 3, 7), (1, 0, 8, 9), (1, 0, 6, 9)]
    found = corpus_difficulty._score_cuts("rule", cuts, truth)
    assert found.exact == pytest.approx(1 / 4)
    assert found.leave == pytest.approx(2 / 4)
    assert found.enter == pytest.approx(2 / 4)
    assert found.near == pytest.approx(2 / 4), "the first, and the last, which is one and two frames off"
    assert found.distance == pytest.approx((0 + 0 + 0 + 3 + 3 + 0 + 1 + 2) / 8)


def test_every_cutter_and_rule_is_scored(pairs: Pairs) -> None:
    numbers, train = [1, 7, 13, 19], list(range(25))
    calls: list[tuple[int, int]] = []
    scores = corpus_difficulty.score_cutters(pairs, numbers, train, lambda done, total: calls.append((done, total)))
    rows = {row.rule: row for row in scores}
    assert calls == [(n, len(CUTTERS)) for n in range(1, len(CUTTERS) + 1)]
    assert list(rows)[: len(CUTTERS)] == [cutter.name for cutter in CUTTERS.values()]
    truth = pairs.index[numbers, :4].tolist()
    for name in ("ends", "pose-velocity"):
        distances = []
        for p, q, pre, post in truth:
            cut = CUTTERS[name].cut(pairs.word_clip(p), pairs.word_clip(q))
            distances.append((abs(cut.pre - pre), abs(cut.post - post)))
        assert rows[name].distance == pytest.approx(np.mean(distances))
        assert rows[name].exact == np.mean([a == (0, 0) for a in distances])
    ends = "events known: leave at the end of the sign, enter at its start"
    distances = [(abs(pairs.events(p).end - pre), abs(pairs.events(q).start - post)) for p, q, pre, post in truth]
    assert rows[ends].leave == np.mean([a == 0 for a, _ in distances])
    assert rows[ends].enter == np.mean([b == 0 for _, b in distances])
    assert rows[ends].distance == pytest.approx(np.mean(distances))


def test_a_reader_is_right_without_error_and_often_wrong_with_much(pairs: Pairs) -> None:
    numbers = list(range(25))
    exactly, badly = corpus_difficulty.score_reading(pairs, numbers, SIGNS, (0.0, 8.0))
    assert (exactly.error_cm, exactly.exact, exactly.near) == (0.0, 1.0, 1.0)
    assert 0.0 < badly.exact < badly.near <= 1.0
    assert corpus_difficulty.score_reading(pairs, numbers, SIGNS, (8.0,)) == [badly]
    (none,) = corpus_difficulty.score_reading(pairs, numbers, {}, (1.0,))
    assert (none.exact, none.near) == (0.0, 0.0), "no sign known: no pair"


def test_a_reader_who_sees_to_5_mm_is_nearly_always_right(pairs: Pairs) -> None:
    (seen,) = corpus_difficulty.score_reading(pairs, list(range(25)), SIGNS, (0.5,))
    assert seen.exact >= 0.88
    assert seen.near == 1.0


def test_fitted_rules_use_the_most_frequent_offsets(pairs: Pairs) -> None:
    numbers = list(range(25))
    rows = corpus_difficulty.score_cutters(pairs, numbers, numbers)
    leave: Counter[int] = Counter()
    enter: Counter[int] = Counter()
    for p, q, pre, post in pairs.index[numbers, :4].tolist():
        before, after = pairs.events(p), pairs.events(q)
        leave[pre - (before.passes[-1][1] if before.passes else before.end)] += 1
        enter[post - (after.first[0] if after.first else after.start)] += 1
    (row,) = (row for row in rows if "best constants" in row.rule)
    assert row.leave == pytest.approx(leave.most_common(1)[0][1] / 25)
    assert row.enter == pytest.approx(enter.most_common(1)[0][1] / 25)
    by_word = rows[-1]
    assert by_word.rule == "words known: the most frequent cut of each word"
    best = [
        Counter(int(pairs.index[k, column]) for k in numbers if pairs.index[k, 0 if column == 2 else 1] == w)
        for column in (2, 3)
        for w in range(5)
    ]
    assert by_word.leave == pytest.approx(sum(counts.most_common(1)[0][1] for counts in best[:5]) / 25)
    assert by_word.enter == pytest.approx(sum(counts.most_common(1)[0][1] for counts in best[5:]) / 25)


def test_the_rule_of_each_word_needs_every_word_in_training(pairs: Pairs) -> None:
    rows = corpus_difficulty.score_cutters(pairs, [1], [7, 8])
    assert all("each word" not in row.rule for row in rows)


def test_classical_transitions_are_scored(pairs: Pairs) -> None:
    rows, true_jump = corpus_difficulty.score_transitions(pairs, [1, 7, 13])
    scores = {row.transition: row for row in rows}
    assert list(scores) == [transition.name for transition in TRANSITIONS.values()]
    assert scores["hold"].position_error > scores["slerp"].position_error > 0.0
    assert scores["hold"].motion_ratio < scores["slerp"].motion_ratio
    assert scores["hold"].velocity_jump > scores["hermite"].velocity_jump
    assert 0.0 < true_jump < scores["hold"].velocity_jump
