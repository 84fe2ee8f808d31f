"""lexicon.lexicon: the words that ship have forms, which the synthetic signer makes; other lexicons do not."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from signing import SIGNS
from signsplice import lexicon
from signsplice.errors import UnknownGlossError
from signsplice.lexicon.lexicon import SHIPPED, FormsOfSigns, Lexicon, open_lexicon
from signsplice.lexicon.sentence import parse
from signsplice.signer import inflection, phonology, planner
from signsplice.splicing.word import words_of


@pytest.fixture(scope="module")
def words() -> Iterator[Lexicon]:
    with open_lexicon() as opened:
        yield opened


@pytest.mark.parametrize(
    ("typed", "gloss"),
    [
        ("2-GIVE-1", "2-GIVE-1"),
        ("I-GIVE-YOU", "1-GIVE-2"),
        ("you-give-me", "2-GIVE-1"),
        ("SHE-ASK-HIM-HABITUAL", None),
        ("I-ask-her-continuative", "1-ASK-3-CONTINUATIVE"),
        ("TELL-ME", "TELL-1"),
        ("book-plural", "BOOK-PLURAL"),
        ("LOOK-HABITUAL", "LOOK-HABITUAL"),
        ("MOTHER-PLURAL", None),
        ("I-BOOK-YOU", None),
        ("1-GIVE-1", None),
        ("NOTHING-PLURAL", None),
        ("BOOK", "BOOK"),
    ],
)
def test_a_gloss_names_a_form_or_a_word_or_neither(typed: str, gloss: str | None, words: Lexicon) -> None:
    assert (typed in words) == (gloss is not None)
    if gloss is None:
        with pytest.raises(UnknownGlossError):
            words.clip(typed)
        return
    clip, entry = words.clip(typed), words.entry(typed)
    assert clip.name == entry.gloss == gloss
    assert (len(clip), clip.fps) == (entry.n_frames, entry.fps)
    assert clip.skeleton is words.clip("BOOK").skeleton


def test_a_form_moves_as_the_signer_makes_it(words: Lexicon) -> None:
    made = planner.synthesize_word(inflection.form(SIGNS, "2-GIVE-1")).clip
    assert np.array_equal(words.clip("2-GIVE-1").local_rotations, made.local_rotations)
    entry, given = words.entry("2-GIVE-1"), words.entry("GIVE")
    assert (entry.kind, entry.signer, entry.source) == ("sign", given.signer, given.source)
    assert not entry.checked
    assert entry.sha256 != given.sha256
    assert words.clip("2-give-1") is words.clip("YOU-GIVE-ME"), "it is kept"


def test_words_and_forms_own_the_arms_that_sign_them(words: Lexicon) -> None:
    one, both = frozenset({"right arm"}), frozenset({"left arm", "right arm"})
    owned = {"I": one, "2-GIVE-1": one, "BOOK": both, "BOOK-PLURAL": both, "YES": one | {"head"}}
    assert {gloss: words.owns(gloss) for gloss in owned} == owned
    line = words_of(parse("I BOOK 2-GIVE-1", words), words.clip, owns_of=words.owns)
    assert [word.owns for word in line] == [one, both, one]
    assert words.owns("2-GIVE-1") == phonology.owned_channels(inflection.form(SIGNS, "2-GIVE-1"))


def test_forms_are_in_no_list(words: Lexicon) -> None:
    words.clip("BOOK-PLURAL")
    assert "BOOK-PLURAL" not in words.glosses
    assert not words.lists("BOOK-PLURAL")
    assert not words.search("BOOK-PLURAL")
    with lexicon.open_shipped_lexicon() as plain:
        assert words.glosses == plain.glosses
        assert "BOOK-PLURAL" not in plain


def test_a_line_is_read_with_forms(words: Lexicon) -> None:
    tokens = parse("I-GIVE-YOU, book-plural 2_give_1. MOTHER-PLURAL I GIVE YOU", words)
    assert [token.glosses for token in tokens[:3]] == [("1-GIVE-2",), ("BOOK-PLURAL",), ("2-GIVE-1",)]
    assert [token.pause for token in tokens[:3]] == [",", "", "."]
    assert tokens[3].spelled, "it has no such form: as any unknown word"
    assert [token.glosses for token in tokens[4:]] == [("I",), ("GIVE",), ("YOU",)], "typed apart, they are words"


def test_other_lexicons_have_no_forms(tmp_path: Path, words: Lexicon) -> None:
    with lexicon.building(tmp_path / "lex") as builder:
        for gloss in ("GIVE", "I", "YOU"):
            builder.add(words.clip(gloss))
    with open_lexicon(tmp_path / "lex") as mine:
        assert not any(isinstance(source, FormsOfSigns) for source in mine.sources)
        (given, *_) = parse("I-GIVE-YOU", mine)
        assert given.note == "'I-GIVE-YOU' is no gloss, and read as I GIVE YOU"


def test_it_opens_by_path_and_in_another_process() -> None:
    with open_lexicon(SHIPPED) as by_path:
        copy = pickle.loads(pickle.dumps(by_path))
        assert type(by_path.sources[1]) is type(copy.sources[1]) is FormsOfSigns
        assert "2-GIVE-1" in copy
        copy.close()
