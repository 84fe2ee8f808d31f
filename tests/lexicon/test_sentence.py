"""Parsing lines of glosses: words, fingerspelled words, and unknown words."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from conftest import random_clip
from signsplice import lexicon
from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon import Lexicon
from signsplice.lexicon.sentence import parse


@pytest.fixture(scope="module")
def lex(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lexicon]:
    path = tmp_path_factory.mktemp("lexicon") / "lex"
    clip = random_clip(0, n_frames=2, n_joints=2)
    with lexicon.building(path) as builder:
        for gloss in ("HELLO", "I", "THANK-YOU", "BANANA", "fs-OK", "#JOB", "fs-A", "fs-B", "fs-N", "fs-É", "fs-7"):
            builder.add(clip, gloss, synonyms=["HI"] if gloss == "HELLO" else [])
        builder.add(clip, "fs-X", kind="sign")
    with lexicon.open(path) as opened:
        yield opened


@pytest.mark.parametrize(
    ("text", "glosses"),
    [
        ("HELLO I", ["HELLO", "I"]),
        ("  hello\tTHANK-YOU \n i", ["HELLO", "THANK-YOU", "I"]),
        ("hi", ["HELLO"]),
        ("fs-ok #job", ["fs-OK", "#JOB"]),
        ("fs-ABBA", ["fs-A", "fs-B", "fs-B", "fs-A"]),
        ("#anna", ["fs-A", "fs-N", "fs-N", "fs-A"]),
        ("FS-b-a-7", ["fs-B", "fs-A", "fs-7"]),
        ("fs-e\u0301a", ["fs-É", "fs-A"]),
        ("A", ["fs-A"]),
        ("anna", ["fs-A", "fs-N", "fs-N", "fs-A"]),
    ],
)
def test_a_line_is_parsed_into_glosses(text: str, glosses: list[str], lex: Lexicon) -> None:
    assert [gloss for token in parse(text, lex) for gloss in token.glosses] == glosses


def test_an_unknown_word_is_fingerspelled_with_a_warning(lex: Lexicon) -> None:
    hello, asked, unasked = parse("HELLO fs-ANNA BANNA", lex)
    assert (hello.spelled, asked.spelled, unasked.spelled) == (False, True, True)
    assert (hello.warning, asked.warning) == ("", "")
    assert unasked.token == "BANNA"
    assert unasked.warning == ("no gloss 'BANNA' (nearest: BANANA), so it is spelled; write fs-BANNA to mean that")


def test_all_unknown_words_are_named_in_one_error(lex: Lexicon) -> None:
    with pytest.raises(UnknownGlossError) as caught:
        parse("HALLO I banana2 THANKYOU A-B X", lex)
    assert set(caught.value.unknown) == {"HALLO", "banana2", "THANKYOU", "A-B", "X"}
    assert caught.value.unknown["THANKYOU"] == ("THANK-YOU",)
    with pytest.raises(UnknownGlossError, match=r"'BANNA' .*nearest: BANANA"):
        parse("I BANNA", lex, spell=False)
    assert len(parse("fs-ANNA", lex, spell=False)[0].glosses) == 4, "marked for spelling, it is spelled all the same"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no gloss in the sentence"),
        (" \n ", "no gloss in the sentence"),
        ("fs-ANTON", "'fs-ANTON' cannot be spelled, there is no letter 'T'"),
        ("#-", "cannot be spelled"),
        ("fs-X", None),
        ("fs-AX", "no letter 'X'"),
        ("fs-", "no gloss 'fs-'"),
        ("#", "no gloss '#'"),
        ("你好", "no gloss '你好' \\(nothing is near it\\)"),
        ("A\x07", "no gloss"),
    ],
)
def test_lines_that_cannot_be_signed_are_refused(text: str, message: str | None, lex: Lexicon) -> None:
    if message is None:
        assert not parse(text, lex)[0].spelled
        return
    with pytest.raises(InputError, match=message):
        parse(text, lex)
