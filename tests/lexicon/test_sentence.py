"""Parsing lines of glosses: words, fingerspelled words, and unknown words."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from conftest import random_clip

from signsplice import lexicon
from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon import Lexicon
from signsplice.lexicon.sentence import line_glosses, parse


@pytest.fixture(scope="module")
def lex(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lexicon]:
    path = tmp_path_factory.mktemp("lexicon") / "lex"
    clip = random_clip(0, n_frames=2, n_joints=2)
    with lexicon.building(path) as builder:
        for gloss in (
            "HELLO",
            "I",
            "THANK-YOU",
            "BANANA",
            "I-LOVE",
            "I-LOVE-YOU",
            "DONT-KNOW",
            "fs-OK",
            "#JOB",
            "fs-A",
            "fs-B",
            "fs-N",
            "fs-É",
            "fs-7",
        ):
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
        ("A-B", ["fs-A", "fs-B"]),
        ("Hello, I!", ["HELLO", "I"]),
        ("i love you banana", ["I-LOVE-YOU", "BANANA"]),
        ("I LOVE BANANA", ["I-LOVE", "BANANA"]),
        ("don\u2019t know", ["DONT-KNOW"]),
        ("thankyou", ["THANK-YOU"]),
        ("HELLO-BANANA", ["HELLO", "BANANA"]),
        ("fs-ba\u0301n", ["fs-B", "fs-A", "fs-N"]),
        ("A\x07", ["fs-A"]),
    ],
)
def test_a_line_is_parsed_into_glosses(text: str, glosses: list[str], lex: Lexicon) -> None:
    assert [gloss for token in parse(text, lex) for gloss in token.glosses] == glosses


def test_an_unknown_word_is_fingerspelled_with_a_warning(lex: Lexicon) -> None:
    hello, asked, unasked = parse("HELLO fs-ANNA BANNA", lex)
    assert (hello.spelled, asked.spelled, unasked.spelled) == (False, True, True)
    assert (hello.warning, asked.warning) == ("", "")
    assert unasked.token == "BANNA"
    assert unasked.warning == "no gloss 'BANNA': did you mean BANANA? It is spelled; write fs-BANNA to mean that"
    assert unasked.suggestions == ("BANANA",)


def test_compounds_are_named_and_can_be_undone(lex: Lexicon) -> None:
    (joined,) = parse("I love you.", lex)
    assert (joined.token, joined.note) == ("I love you", "'I love you' is read as one gloss, I-LOVE-YOU")
    with pytest.raises(UnknownGlossError):
        parse("I LOVE YOU", lex, spell=False, compounds=False)
    assert parse("HELLO-I", lex, compounds=False)[0].note == "'HELLO-I' is no gloss, and read as HELLO I"
    with pytest.raises(UnknownGlossError, match=r"'love' \(nearest: I-LOVE, I-LOVE-YOU\)"):
        parse("I, love you", lex, spell=False)
    left_out = parse("I, love you", lex)[1]
    assert (left_out.glosses, left_out.suggestions) == ((), ("I-LOVE", "I-LOVE-YOU"))
    assert left_out.warning.startswith(
        "no gloss 'love', and no letters for it: did you mean I-LOVE or I-LOVE-YOU? It is"
    )


def test_what_is_left_out_is_said(lex: Lexicon) -> None:
    wave, hello = parse("\N{WAVING HAND SIGN} hello\N{GRINNING FACE}", lex)
    assert (wave.glosses, hello.glosses) == ((), ("HELLO",))
    assert all("is left out" in token.warning for token in (wave, hello))
    assert not parse("hello...", lex)[0].warning
    assert "spelled as BAN, without accents" in parse("b\u00e1n", lex)[0].warning


def test_all_unknown_words_are_named_in_one_error(lex: Lexicon) -> None:
    with pytest.raises(UnknownGlossError) as caught:
        parse("HALLO, banana-c THANK-YUO A-C X", lex)
    assert set(caught.value.unknown) == {"HALLO", "banana-c", "THANK-YUO", "A-C", "X"}
    assert caught.value.unknown["THANK-YUO"] == ("THANK-YOU",)
    with pytest.raises(UnknownGlossError, match=r"'BANNA' .*nearest: BANANA"):
        parse("I BANNA", lex, spell=False)
    assert len(parse("fs-ANNA", lex, spell=False)[0].glosses) == 4, "marked for spelling, it is spelled all the same"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no gloss in the sentence"),
        (" \n ", "no gloss in the sentence"),
        ("fs-ANTON", "'fs-ANTON' cannot be spelled, there is no letter 'T'"),
        ("#-", "no gloss in the sentence"),
        ("\N{WAVING HAND SIGN}", "no gloss in the sentence"),
        ("3.5", "no gloss '3' .*'5'"),
        ("fs-X", None),
        ("fs-AX", "no letter 'X'"),
        ("fs-", "no gloss in the sentence, .*'fs-' stands for none"),
        ("#", "no gloss in the sentence"),
        ("你好", "no gloss '你好' \\(nothing is near it\\)"),
    ],
)
def test_lines_that_cannot_be_signed_are_refused(text: str, message: str | None, lex: Lexicon) -> None:
    if message is None:
        assert not parse(text, lex)[0].spelled
        return
    with pytest.raises(InputError, match=message):
        parse(text, lex)


@pytest.mark.parametrize(
    ("text", "marks"),
    [
        ("HELLO, I thank-you.", {0: ",", 2: "."}),
        ("Hello! I? THANK-YOU", {0: "!", 1: "?"}),
        ("HELLO... I", {0: "."}),
        ("HELLO ,I", {0: ","}),
        ("HELLO . , I", {0: "."}),
        ("fs-ANNA, #AB.", {3: ",", 5: "."}),
        ("I LOVE YOU; I", {0: ","}),
        ("HELLO-I, I", {1: ","}),
        ("HELLO \N{WAVING HAND SIGN}, I", {0: ","}),
        (", HELLO", {}),
        ("hello \u2014 I: banana", {0: ",", 1: ","}),
        ("\uff28\uff25\uff2c\uff2c\uff2f\uff0cI\u3002", {0: ",", 1: "."}),
        ("HELLO/I (BANANA) 'HI'", {}),
        ("7:7 I", {}),
    ],
)
def test_signing_pauses_where_punctuation_parts_phrases(text: str, marks: dict[int, str], lex: Lexicon) -> None:
    held = [gloss.pause for gloss in line_glosses(parse(text, lex))]
    assert {k: mark for k, mark in enumerate(held) if mark is not None} == marks
