"""Corpora of version 1, and of version 2 with one frame a word, are read and used like any other."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import GOLDEN

from signing import sign
from signsplice.errors import InputError
from signsplice.signer.signer import PLAIN
from signsplice_workshop.corpora import training_data
from signsplice_workshop.corpora.pairs import VERSION, Pairs, Recipe, write_pairs
from signsplice_workshop.measure import corpus_checks, corpus_difficulty

RECIPE = Recipe(tuple(map(sign, ("I", "MOTHER", "BOOK", "YES"))), fps=15.0, n_other=5, truth="word")
SIGNS = {one.gloss: one for one in RECIPE.signs}


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    """Version 1, as commit c5abc78a makes it: `synth pairs --words 3 --other-signer 2 --fps 10`."""
    folder: Path = tmp_path_factory.mktemp("old") / "pairs"
    with zipfile.ZipFile(GOLDEN / "corpus_v1.zip") as archive:
        archive.extractall(folder)
    return Pairs(folder)


@pytest.fixture(scope="module")
def by_word(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    return Pairs(write_pairs(RECIPE, tmp_path_factory.mktemp("word") / "pairs", processes=1))


def test_version_1_is_read(old: Pairs) -> None:
    assert (old.version, old.by_partner, len(old)) == (1, True, 11)
    assert all(signer.manner == PLAIN for signer in old.signers)
    events = [old.events(k) for k in range(len(old.head["words"]))]
    assert {(e.gap_first_cm, e.gap_last_cm) for e in events} == {(None, None)}
    assert all(isinstance(e.touches_last, bool) and e.up < e.start <= e.end < e.down for e in events)
    for number in range(len(old)):
        p, q = old.index[number, :2].tolist()
        pre, post, new = old.truth(number, "rotations")
        whole = old.utterance(number, "rotations")
        assert np.array_equal(whole[: pre + 1], old.word(p, "rotations")[: pre + 1])
        assert np.array_equal(whole[pre + 1 + len(new) :], old.word(q, "rotations")[post:])
        assert len(old.clip(number)) == len(whole)


def test_version_1_is_measured_but_not_planned_anew(old: Pairs) -> None:
    assert corpus_checks.examine(old).n_misplaced == 0
    assert corpus_checks.score_touches(old).n_postures == 12
    for call in (corpus_checks.replan, lambda pairs, signs: corpus_difficulty.score_reading(pairs, [0], signs)):
        with pytest.raises(InputError, match="version 1, which an earlier commit makes") as caught:
            call(old, SIGNS)
        assert "\n" not in str(caught.value)


def test_both_versions_are_signing(old: Pairs, by_word: Pairs) -> None:
    for made in (old, by_word):
        part = training_data.make_corpus_part(made, [0, 1, 2])
        assert len(part["seams"]) == 3
        p, q = made.index[1, :2].tolist()
        words = sorted(set(made.index[[0, 1, 2], :2].ravel().tolist()))
        assert part["pairs"][words.index(p), words.index(q)].tolist() == made.index[1, [2, 3, 5]].tolist()


def test_by_word_every_word_has_one_frame_on_either_side(by_word: Pairs) -> None:
    assert (by_word.version, by_word.by_partner) == (VERSION, False)
    frames: dict[tuple[str, int], set[int]] = {}
    for p, q, pre, post in by_word.index[:, :4].tolist():
        frames.setdefault(("leave", p), set()).add(pre)
        frames.setdefault(("enter", q), set()).add(post)
    assert len(frames) > 8
    assert all(len(one) == 1 for one in frames.values())
    assert corpus_checks.replan(by_word, SIGNS) == (16, 0)
    (exact,) = corpus_difficulty.score_reading(by_word, list(range(16)), SIGNS, (0.0,))
    assert exact.exact == 1.0


def test_a_folder_of_another_version_is_kept(old: Pairs) -> None:
    before = {path.name: path.read_bytes() for path in old.folder.iterdir()}
    with pytest.raises(
        InputError, match="holds a corpus of version 1, and version 3 is made; choose a new name"
    ) as caught:
        write_pairs(RECIPE, old.folder, processes=1)
    assert "\n" not in str(caught.value)
    assert {path.name: path.read_bytes() for path in old.folder.iterdir()} == before


def test_an_unknown_truth_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no truth 'both', expected one of partner, word"):
        write_pairs(replace(RECIPE, truth="both"), tmp_path / "c", processes=1)
    assert list(tmp_path.iterdir()) == []


def test_touches_of_a_corpus_are_those_of_its_motion(pairs: Pairs) -> None:
    found = corpus_checks.score_touches(pairs)
    assert found.n_postures == 20
    assert 0 < found.n_touching < 20
    assert (found.n_missed, found.n_false) == (0, 0)


def test_touches_that_are_flagged_wrongly_are_found(pairs: Pairs) -> None:
    wrong = Pairs(pairs.folder)
    events = [row["events"] for row in wrong.head["words"]]
    seen = next(e for e in events if e["touches_last"])
    free = next(e for e in events if not e["touches_first"])
    seen["touches_last"], free["touches_first"] = False, True
    found = corpus_checks.score_touches(wrong)
    assert (found.n_missed, found.n_false) == (1, 1)
