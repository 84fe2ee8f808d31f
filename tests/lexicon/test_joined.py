"""Several lexicons as one: the first that has a word counts, and what is hidden behind it is not found."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import signsplice as ss
from signsplice import lexicon
from signsplice.cli.commands import app
from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon.sentence import parse
from signsplice.motion import Clip

OWN = {"HELLO": ("I", ("HEY",)), "ZEBRA": ("SIGN", ()), "MOTHER": ("DEAF", ())}
"""Gloss -> the word that ships whose clip it has here, and synonyms."""


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory, words: dict[str, Clip]) -> Path:
    folder = tmp_path_factory.mktemp("joined") / "own"
    with lexicon.building(folder) as builder:
        for gloss, (source, synonyms) in OWN.items():
            builder.add(words[source], gloss, synonyms=synonyms)
    return folder


def test_the_first_lexicon_that_has_a_word_counts(own: Path, words: dict[str, Clip]) -> None:
    with ss.open_lexicon(own, "default") as joined, ss.open_lexicon("default", own) as reverse:
        for lex, hello in ((joined, words["I"]), (reverse, words["HELLO"])):
            np.testing.assert_allclose(lex.clip("hello").local_rotations, hello.local_rotations, atol=1e-6)
            assert lex.entry("HELLO").n_frames == len(hello)
            assert lex.clip("ZEBRA").name == "ZEBRA"
            assert len(lex.clip("I-GIVE-YOU")), "forms are signed in any place"
            assert lex.lists("thank-you")


def test_every_gloss_is_listed_once_and_found(own: Path) -> None:
    with ss.open_lexicon(own, "default") as joined, ss.open_lexicon() as shipped:
        assert list(joined) == sorted({*OWN, *shipped})
        assert len(joined) == len(shipped) + 1
        assert [entry.gloss for entry in joined.entries()] == list(joined)
        assert all(joined.entry(gloss).gloss == gloss for gloss in joined)
        assert joined.search("zeb")[0].gloss == "ZEBRA"
        assert joined.nearest("ZEBR") == ("ZEBRA",)
        assert not list(joined.faults())
        joined.verify()


def test_a_synonym_stands_for_the_earlier_word_of_its_gloss(own: Path, words: dict[str, Clip]) -> None:
    """What is parsed is looked up again by its gloss, so both have to mean the same word."""
    with ss.open_lexicon(own, "default") as joined:
        assert [parse(word, joined)[0].glosses for word in ("hi", "hey")] == [("HELLO",)] * 2
        assert joined.entry("hi") == joined.entry("hey") == joined.entry("hello")
        np.testing.assert_allclose(joined.clip("hi").local_rotations, words["I"].local_rotations, atol=1e-6)


def test_one_alone_has_its_own_words_only(own: Path) -> None:
    with ss.open_lexicon(own) as alone, pytest.raises(UnknownGlossError, match=r"own: no gloss 'THANK-YOU'"):
        alone.entry("THANK-YOU")
    with ss.open_lexicon("default") as named, ss.open_lexicon() as shipped:
        assert named.glosses == shipped.glosses


def test_a_word_that_none_has_names_all_lexicons(own: Path) -> None:
    with (
        ss.open_lexicon(own, "default") as joined,
        pytest.raises(UnknownGlossError, match="own and the words that ship: no"),
    ):
        joined.clip("QUUX")
    with pytest.raises(InputError, match="no such folder"):
        ss.open_lexicon("default", own / "nothing")


def test_joined_lexicons_are_pickled_for_other_processes(own: Path) -> None:
    with ss.open_lexicon(own, "default") as joined, pickle.loads(pickle.dumps(joined)) as copy:
        assert copy.glosses == joined.glosses
        assert copy.entry("HELLO") == joined.entry("HELLO")


def test_the_command_line_takes_several(own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call = ["sentence", "HELLO THANK-YOU ZEBRA", "--lexicon", str(own), "-o", str(tmp_path / "a.npz"), "--no-spell"]
    with pytest.raises(UnknownGlossError, match="THANK-YOU"):
        app(call, standalone_mode=False)
    app([*call, "--lexicon", "default"], standalone_mode=False)
    assert "2 seams" in capsys.readouterr().out
