"""Kinds of signs, and second passes beside first ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from signing import sign
from signsplice.motion import Clip
from signsplice.signer import notation
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs
from signsplice_workshop.measure import corpus_realism

SIGNS = notation.parse(
    """\
ONE  hands=one
  H  shape=B at=space palm=fwd fingers=up
BOTH  hands=symmetric
  H  shape=B at=chest by=tips palm=back fingers=up-in
OTHER  hands=alternating
  H  shape=B at=space palm=fwd fingers=up
TOUCH  hands=base
  H  shape=1 at=base-palm by=index palm=down fingers=fwd w.shape=B w.at=space-low-mid w.palm=up w.fingers=in-fwd
FACE  hands=one
  H  shape=B at=face-space palm=fwd fingers=up
"""
)
TWICE = notation.parse(
    """\
TWICE  hands=one
  X  shape=B at=space palm=fwd fingers=up
  M  shift=0,8,0 times=2
ONCE  hands=one
  X  shape=B at=space palm=fwd fingers=up
  M  shift=0,8,0
"""
)


def test_kinds_are_shares_of_the_signs_beside_those_of_asl() -> None:
    rows = corpus_realism.compare_kinds(list(SIGNS.values()), "mine")
    assert {row.name: (round(row.ours[0], 9), row.real[0]) for row in rows} == {
        "one-handed, mine": (0.4, 0.39),
        "symmetric or alternating, mine": (0.4, 0.35),
        "first place at the other hand, mine": (0.2, 0.25),
        "first place in neutral space, mine": (0.4, 0.36),
    }
    assert [row.agreement[0] for row in rows] == [True, True, False, True]


def test_kinds_of_words_and_of_pseudo_signs_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corpus_realism, "N_PSEUDO", 3)
    rows = corpus_realism.compare_sign_kinds()
    assert len(rows) == 8
    everyday = list(notation.everyday().values())
    assert rows[0].ours[0] == pytest.approx(sum(one.hands == "one" for one in everyday) / len(everyday))
    assert 3.0 * rows[4].ours[0] == pytest.approx(round(3.0 * rows[4].ours[0]))


def test_second_passes_are_held_against_first_ones(tmp_path: Path) -> None:
    made = Pairs(write_pairs(Recipe(tuple(TWICE.values()), n_other=0), tmp_path / "pairs", processes=1))
    size, time = corpus_realism.measure_second_passes(made)
    begin, end = made.events(0).passes[1]
    first = made.events(0).passes[0]
    assert time.ours[2] == pytest.approx((end - begin) / (first[1] - first[0]))
    assert 0.3 < size.ours[2] < 1.2
    assert size.ours[0] == size.ours[4], "the other word has one pass"
    assert size.spread
    assert size.real == (0.6, 1.0)
    (walking, _) = corpus_realism.measure_second_passes(_Walking(made.folder))
    assert walking.ours == pytest.approx(size.ours, abs=1e-4), "a body that moves adds nothing"


class _Walking(Pairs):
    """A corpus whose signer walks."""

    def word_clip(self, number: int) -> Clip:
        clip = super().word_clip(number)
        return replace(clip, root_positions=clip.root_positions + np.outer(np.arange(len(clip)), [0.0, 0.5, 1.0]))


def test_without_repeated_movements_there_are_no_rows(tmp_path: Path) -> None:
    recipe = Recipe((TWICE["ONCE"], sign("I")), n_other=0)
    assert corpus_realism.measure_second_passes(Pairs(write_pairs(recipe, tmp_path / "pairs", processes=1))) == []
