"""splicing.viterbi: the best cuts of a whole sentence, compared with trying all of them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from signsplice.splicing.learned import SeamScores, best_path


def random_seams(seed: int, sizes: list[tuple[int, ...]]) -> list[SeamScores]:
    """Seams with random scores; ``sizes`` has (rows, columns, leaves_from) or (..., enters_from) of each."""
    rng = np.random.default_rng(seed)
    return [SeamScores(rng.normal(size=(rows, columns)), *firsts) for rows, columns, *firsts in sizes]


def total(seams: list[SeamScores], chosen: list[tuple[int, int]]) -> float:
    """The sum of the scores of the chosen frames."""
    return float(
        sum(
            seam.scores[left - seam.leaves_from, entered - seam.enters_from]
            for seam, (left, entered) in zip(seams, chosen, strict=True)
        )
    )


def highest_total(seams: list[SeamScores], least: int) -> float:
    """The highest sum of scores, found by trying all choices."""
    cells = [list(np.ndindex(*seam.scores.shape)) for seam in seams]
    sums = []
    for choice in itertools.product(*cells):
        chosen = [
            (seam.leaves_from + row, seam.enters_from + column)
            for seam, (row, column) in zip(seams, choice, strict=True)
        ]
        if all(after[0] - before[1] >= least for before, after in itertools.pairwise(chosen)):
            sums.append(total(seams, chosen))
    return max(sums)


@pytest.mark.parametrize("least", [0, 1, 3])
@pytest.mark.parametrize("seed", range(8))
def test_no_other_choice_has_a_higher_sum(seed: int, least: int) -> None:
    seams = random_seams(seed, [(3, 4, 5), (6, 3, 0, 2), (5, 4, 1, 3)])
    chosen = best_path(seams, least)
    assert all(after[0] - before[1] >= least for before, after in itertools.pairwise(chosen))
    assert total(seams, chosen) == pytest.approx(highest_total(seams, least))


def test_a_single_seam_takes_its_highest_score() -> None:
    (seam,) = random_seams(1, [(7, 9, 20)])
    row, column = np.unravel_index(int(seam.scores.argmax()), seam.scores.shape)
    assert best_path([seam]) == [(20 + int(row), int(column))]
    assert best_path([]) == []


def test_in_long_words_every_seam_takes_its_highest_score() -> None:
    """Where the choice for one seam rules out none for the next, all take their best."""
    seams = random_seams(2, [(5, 6, 40), (5, 6, 40), (5, 6, 40)])
    assert best_path(seams) == [best_path([seam])[0] for seam in seams]


def test_a_word_that_is_too_short_keeps_what_it_has() -> None:
    for seed in range(6):
        chosen = best_path(random_seams(seed, [(2, 2, 0), (2, 3, 0), (4, 4, 0)]), least=3)
        assert len(chosen) == 3
        assert (chosen[0][1], chosen[1][0]) == (0, 1), "both of its frames"
