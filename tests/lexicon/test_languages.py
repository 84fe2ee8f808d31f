"""Signed languages of words and letters: who says them, which letters spell, and what a line says of several."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from conftest import random_clip
from hypothesis import given
from hypothesis import strategies as st

import signsplice as ss
from signsplice import lexicon
from signsplice.errors import InputError, UnknownGlossError
from signsplice.formats import save
from signsplice.lexicon import Lexicon
from signsplice.lexicon.gloss import is_letter, letter_of
from signsplice.lexicon.languages import ALPHABETS, read_languages
from signsplice.lexicon.sentence import line_warnings, parse
from signsplice.signer import checks, notation, planner
from signsplice.splicing.letters import cut_letters

LATIN = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
SIGNS = Path(__file__).resolve().parents[1] / "synth" / "written_signs.sigml"


@pytest.fixture
def words(tmp_path: Path) -> Iterator[dict[str, Lexicon]]:
    """A lexicon of German signs without letters, and one that names no language."""
    clip = random_clip(0, n_frames=2, n_joints=2)
    for name, extensions in {"gsg": {"language": b"gsg"}, "none": {}}.items():
        with lexicon.building(tmp_path / name) as builder:
            builder.add(clip, "HAUS", extensions=extensions)
            builder.add(clip, "BAUM", extensions=extensions)
    with ss.open_lexicon(tmp_path / "gsg", "default") as german, ss.open_lexicon(tmp_path / "none") as unnamed:
        yield {"gsg": german, "none": unnamed}


@pytest.mark.parametrize(
    ("code", "languages"),
    [("en", ("en", "")), ("", ("", "")), ("gsg", ("de", "gsg")), ("sgn-dse", ("nl", "dse")), ("en-gsg", ("en", "gsg")),
     ("ins", ("en", "ins")), ("GSG", ("de", "gsg"))],
)  # fmt: skip
def test_a_code_names_a_spoken_or_a_signed_language_or_both(code: str, languages: tuple[str, str]) -> None:
    assert read_languages(code) == languages


@pytest.mark.parametrize("code", ["e", "german", "pt-BR", "en-", "g3g", "\N{GREEK SMALL LETTER ALPHA}\u03b2"])
def test_other_codes_are_refused(code: str) -> None:
    with pytest.raises(InputError, match="expected that of the words"):
        read_languages(code)


@given(st.text(max_size=12) | st.from_regex("(sgn-)?[a-zA-Z]{1,4}(-[a-z]{1,4})?", fullmatch=True))
def test_any_code_is_read_or_refused(code: str) -> None:
    with suppress(InputError):
        spoken, signed = read_languages(code)
        assert len(spoken) in (0, 2, 3)
        assert len(signed) in (0, 3)


@pytest.mark.parametrize("language", ALPHABETS)
def test_an_alphabet_has_all_letters_and_digits_and_can_be_signed(language: str) -> None:
    signs = notation.alphabet(language)
    assert {f"fs-{letter}" for letter in LATIN} <= signs.keys()
    assert all(is_letter(gloss) and sign.kind == "letter" and sign.source for gloss, sign in signs.items())
    if language != "ase":  # P and Q point down, as in the American alphabet
        strained = [line for sign in signs.values() for line in checks.warnings(planner.synthesize_word(sign))]
        assert [line for line in strained if not line.startswith(("fs-P:", "fs-Q:"))] == []


def test_the_german_alphabet_has_its_own_letters() -> None:
    assert {"fs-Ä", "fs-Ö", "fs-Ü", "fs-ß", "fs-SCH"} <= notation.alphabet("gsg").keys()
    assert (letter_of("fs-SCH@GSG"), letter_of("fs-a"), letter_of("HOUSE")) == ("SCH", "A", "")


def test_words_and_letters_say_their_language(words: dict[str, Lexicon]) -> None:
    german = words["gsg"]
    assert (german.language, words["none"].language) == ("gsg", "")
    codes = {gloss: german.language_of(gloss) for gloss in ("HAUS", "HELLO", "2-GIVE-1", "fs-A", "fs-A@dse")}
    assert codes == {"HAUS": "gsg", "HELLO": "ase", "2-GIVE-1": "ase", "fs-A": "ase", "fs-A@dse": "dse"}
    with pickle.loads(pickle.dumps(german)) as copy:
        assert (copy.language, copy.clip("fs-ß@gsg").name, copy.entry("fs-ß@gsg").kind) == ("gsg", "fs-ß@GSG", "letter")


def test_a_word_is_spelled_in_the_alphabet_of_its_sentence(words: dict[str, Lexicon]) -> None:
    haus, schoen = parse("Haus Schön", words["gsg"])
    assert (haus.language, schoen.language) == ("gsg", "gsg")
    assert schoen.glosses == ("fs-SCH@GSG", "fs-Ö@GSG", "fs-N@GSG")
    with ss.open_lexicon() as shipped:
        assert parse("zoë", shipped)[0].glosses == ("fs-Z", "fs-O", "fs-E")
        assert parse("zoë", shipped, language="dse")[0].glosses == ("fs-Z@DSE", "fs-O@DSE", "fs-E@DSE")
        hello, zoe = parse("hello zoe fs-B", shipped, language="gss")[:2]
        with pytest.raises(UnknownGlossError, match="the words that ship, without letters of gss: no gloss 'zoe'"):
            parse("zoe", shipped, language="gss")
        marked = parse("fs-a@gsg, hello@gsg fs-Schß@gsg.", shipped)
    assert [(token.glosses, token.pause) for token in marked[:2]] == [(("fs-A@GSG",), ","), (("HELLO",), "")]
    assert (marked[-1].glosses, marked[-1].pause) == (("fs-SCH@GSG", "fs-ß@GSG"), ".")
    assert (hello.language, zoe.glosses) == ("ase", ())
    assert "no letters of gss for it" in zoe.warning
    assert parse("Haus zoe", words["none"])[1].glosses == (), "its language is unknown, and so is its alphabet"
    assert parse("Haus zoe", words["none"], language="gsg")[1].language == "gsg"


def test_a_line_of_several_languages_says_so_or_is_refused(words: dict[str, Lexicon]) -> None:
    tokens = parse("Haus hello baum", words["gsg"])
    assert line_warnings(tokens) == ["signs of several languages: gsg (Haus, baum); ase (hello)"]
    assert line_warnings(tokens, "gsg") == ["signs of other languages than gsg: ase (hello)"]
    with pytest.raises(InputError, match=r"ase \(hello\), expected one language"):
        parse("Haus hello baum", words["gsg"], one_language=True)
    with pytest.raises(InputError, match="signs of other languages than dse: gsg"):
        parse("Haus", words["gsg"], language="dse", one_language=True)
    for line, code in {"Haus Schön": "gsg", "hello": "en"}.items():
        assert line_warnings(parse(line, words["gsg"], language=code, one_language=True), code) == []


def test_a_line_that_is_mostly_spelled_says_so() -> None:
    with ss.open_lexicon() as shipped:
        assert line_warnings(parse("hello brave new globe", shipped)) == [
            "3 of 4 words are spelled, letter by letter (13 letters)"
        ]
        assert line_warnings(parse("frend", shipped)) == line_warnings(parse("hello my name anna", shipped)) == []


def test_written_signs_that_name_no_language_are_of_the_named_one() -> None:
    with ss.open_lexicon(fallback=SIGNS) as words:
        assert line_warnings(parse("hello throw", words)) == [
            "signs of several languages: ase (hello); unnamed (throw)"
        ]
    with ss.open_lexicon(fallback=SIGNS, language="dse") as words:
        assert words.where == f"{SIGNS} and the words that ship"
        assert [token.language for token in parse("throw zoe", words, language="dse", one_language=True)] == ["dse"] * 2
        with pytest.raises(InputError, match="than dse: ase"):
            parse("throw hello", words, language="dse", one_language=True)


def test_a_build_stores_the_language_of_its_words(tmp_path: Path) -> None:
    (tmp_path / "clips").mkdir()
    for gloss in ("haus", "house"):
        save(random_clip(0, n_frames=4, n_joints=3), tmp_path / "clips" / f"{gloss}.npz")
    table = tmp_path / "clips" / "glosses.csv"
    table.write_text("file,language\nhouse.npz,ase\n", "utf-8")
    lexicon.build(tmp_path / "clips", tmp_path / "lex", language="gsg")
    with ss.open_lexicon(tmp_path / "lex") as built:
        assert [built.language_of(gloss) for gloss in ("HAUS", "HOUSE")] == ["gsg", "ase"]
    table.write_text("file,language\nhouse.npz,german\n", "utf-8")
    with pytest.raises(InputError, match=r"csv:2: language 'german', expected three letters, such as ase"):
        lexicon.build(tmp_path / "clips", tmp_path / "lex")
    with pytest.raises(InputError, match="language 'english'"):
        lexicon.build(tmp_path / "clips", tmp_path / "lex", language="english")


def test_doubled_letters_of_german_and_dutch_slide_and_movements_are_kept_whole() -> None:
    with ss.open_lexicon() as words:
        for name, slides in {"fs-S": False, "fs-S@gsg": True, "fs-A@dse": True, "fs-A@ase": False}.items():
            clip = words.clip(name)
            cut = cut_letters(clip, clip, 0, 0.0)
            assert cut is not None
            assert (cut.is_doubled, cut.slides) == (True, slides), name
        moved, still = words.clip("fs-Ö@gsg"), words.clip("fs-O@gsg")
        held = [cut_letters(clip, words.clip("fs-B@gsg"), 20, 0.1) for clip in (moved, still)]
    assert held[0] is not None
    assert held[1] is not None
    assert held[0].cut.pre > held[1].cut.pre + 0.2 * moved.fps
