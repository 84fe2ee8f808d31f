"""The best choice over all seams together, beside trying every one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from signsplice.splicing.viterbi import SeamScores, best_path


def drawn(seed: int, sizes: list[tuple[int, ...]]) -> list[SeamScores]:
    rng = np.random.default_rng(seed)
    return [SeamScores(rng.normal(size=(rows, columns)), *firsts) for rows, columns, *firsts in sizes]


def total(seams: list[SeamScores], chosen: list[tuple[int, int]]) -> float:
    return float(
        sum(
            s.scores[left - s.leaves_from, entered - s.enters_from]
            for s, (left, entered) in zip(seams, chosen, strict=True)
        )
    )


def tried(seams: list[SeamScores], least: int) -> float:
    """The best sum by trying everything."""
    ways = [list(np.ndindex(*seam.scores.shape)) for seam in seams]
    sums = []
    for way in itertools.product(*ways):
        chosen = [
            (seam.leaves_from + row, seam.enters_from + column) for seam, (row, column) in zip(seams, way, strict=True)
        ]
        if all(after[0] - before[1] >= least for before, after in itertools.pairwise(chosen)):
            sums.append(total(seams, chosen))
    return max(sums)


@pytest.mark.parametrize("least", [0, 1, 3])
@pytest.mark.parametrize("seed", range(8))
def test_it_is_the_best_of_all(seed: int, least: int) -> None:
    seams = drawn(seed, [(3, 4, 5), (6, 3, 0, 2), (5, 4, 1, 3)])
    chosen = best_path(seams, least)
    assert all(after[0] - before[1] >= least for before, after in itertools.pairwise(chosen))
    assert total(seams, chosen) == pytest.approx(tried(seams, least))


def test_one_seam_takes_its_own_best() -> None:
    (seam,) = drawn(1, [(7, 9, 20)])
    row, column = np.unravel_index(int(seam.scores.argmax()), seam.scores.shape)
    assert best_path([seam]) == [(20 + int(row), int(column))]
    assert best_path([]) == []


def test_words_that_bind_no_one_take_each_seams_best() -> None:
    """Words so long that no choice crosses another."""
    seams = drawn(2, [(5, 6, 40), (5, 6, 40), (5, 6, 40)])
    assert best_path(seams) == [best_path([seam])[0] for seam in seams]


def test_a_word_too_short_to_keep_anything_is_no_dead_end() -> None:
    for seed in range(6):
        chosen = best_path(drawn(seed, [(2, 2, 0), (2, 3, 0), (4, 4, 0)]), least=3)
        assert len(chosen) == 3
        assert (chosen[0][1], chosen[1][0]) == (0, 1), "its two frames, both"
