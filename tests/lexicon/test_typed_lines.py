"""What is signed of plain sentences: tests/data/typed_lines.tsv says it word by word, written before the reader was."""

from __future__ import annotations

import csv
import sys
import unicodedata
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import random_clip
from hypothesis import example, given
from hypothesis import strategies as st

import signsplice as ss
from signsplice import lexicon
from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon import Lexicon, open_shipped_lexicon
from signsplice.lexicon.languages import read_languages
from signsplice.lexicon.sentence import SentenceToken, count_words, line_warnings, parse

TABLE = Path(__file__).resolve().parents[1] / "data" / "typed_lines.tsv"
SPELLED, LEFT_OUT = "*", "-"
MADE = {
    "de": "ICH HAUS KIND SCHREIBEN GRUSS SCHÖN MUTTER GEHEN STRASSE GUTEN-TAG",
    "nl": "IK HUIS KIND SCHRIJVEN LOPEN GOED FIETS AMSTEL-B_241220_1",
    "fr": "JE ECRIRE MAISON CHEVAL MANGER ECOLE BONJOUR MERCI TO-TELL1^ TREE-2",
    "el": "ΓΡΑΦΩ ΣΠΙΤΙ ΜΗΤΕΡΑ ΚΑΛΗΜΕΡΑ ΝΕΡΟ",
}
LETTERS = {"el": "ΑΒΓΔΕΖΗΘΙΚΛΜΝΞΟΠΡΣΤΥΦΧΨΩ"}


def rows() -> list[tuple[str, str, list[tuple[str, str]]]]:
    """The rows of the table: language, line, (word, what is signed) of each word."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        table = list(csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE))[1:]
    pairs = [[cell.rsplit("=", 1) for cell in words.split(" ")] for _, _, words in table]
    flat = [[(word, said) for typed, said in row for word in typed.split("+")] for row in pairs]
    return [(language, line, words) for (language, line, _), words in zip(table, flat, strict=True)]


@pytest.fixture(scope="module")
def lexicons(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Lexicon]]:
    """The words that ship, and small lexicons of other languages."""
    folder, clip = tmp_path_factory.mktemp("typed"), random_clip(0, n_frames=2, n_joints=2)
    for language, glosses in MADE.items():
        with lexicon.building(folder / language) as builder:
            for letter in LETTERS.get(language, "ABCDEFGHIJKLMNOPQRSTUVWXYZ") + "0123456789":
                builder.add(clip, f"fs-{letter}")
            for gloss in glosses.split():
                builder.add(clip, gloss)
    opened = {language: Lexicon(folder / language) for language in MADE}
    yield opened | {"en": open_shipped_lexicon()}
    for one in opened.values():
        one.close()


def said(tokens: list[SentenceToken]) -> list[tuple[str, str]]:
    """(word, what is signed) of each word of a line."""
    kinds = [(token, SPELLED if token.spelled else "".join(token.glosses) or LEFT_OUT) for token in tokens]
    return [(word, kind) for token, kind in kinds for word in token.token.split()]


def outcomes(lexicons: dict[str, Lexicon]) -> list[tuple[str, str, str]]:
    """(language, what is signed, what should be) of each word of the table."""
    found = list[tuple[str, str, str]]()
    for language, line, words in rows():
        read = said(parse(line, lexicons[language], language=language))
        assert [word for word, _ in read] == [word for word, _ in words], line
        found += [(language, is_said, meant) for (_, is_said), (_, meant) in zip(read, words, strict=True)]
    return found


def test_plain_sentences_become_the_signs_that_there_are(lexicons: dict[str, Lexicon]) -> None:
    assert len(rows()) >= 60
    found = outcomes(lexicons)
    expected = [(is_said, meant) for _, is_said, meant in found if meant not in (SPELLED, LEFT_OUT)]
    wrong = [(is_said, meant) for _, is_said, meant in found if is_said not in (SPELLED, LEFT_OUT, meant)]
    english = [is_said not in (SPELLED, LEFT_OUT) for language, is_said, _ in found if language == "en"]
    hits = sum(is_said == meant for is_said, meant in expected)
    print(f"{hits} of {len(expected)} glosses found, {len(wrong)} of {len(found)} words wrong: {wrong}")
    print(f"{sum(english)} of {len(english)} English words are signed; 80 were, and 3 lines of 42 were refused")
    assert hits >= 0.9 * len(expected)
    assert len(wrong) <= 0.02 * len(found)
    assert sum(is_said == meant for _, is_said, meant in found) >= 0.97 * len(found)
    assert sum(english) > 0.5 * len(english)


def test_without_dictionaries_the_endings_of_english_are_known(
    lexicons: dict[str, Lexicon], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "simplemma", None)
    found = [(is_said, meant) for language, is_said, meant in outcomes(lexicons) if language == "en"]
    expected = [(is_said, meant) for is_said, meant in found if meant not in (SPELLED, LEFT_OUT)]
    print(f"{sum(is_said == meant for is_said, meant in expected)} of {len(expected)} glosses found by endings")
    assert sum(is_said == meant for is_said, meant in expected) >= 0.85 * len(expected)
    assert sum(is_said not in (SPELLED, LEFT_OUT, meant) for is_said, meant in found) <= 0.02 * len(found)


@pytest.mark.parametrize(
    ("typed", "language", "glosses"),
    [
        ("caring hating notes shower later this his thing being", "en", ""),
        ("teachers worker STOPPED making studies I'm theirs", "en", "TEACH WORK STOP MAKE STUDY I"),
        ("tell TO-TELL1 to-tell tree Tree-2 to-tell2", "fr", "TO-TELL1^ TO-TELL1^ TO-TELL1^ TREE-2 TREE-2"),
        ("ecrire ÉCRIRE e\u0301crire écrivons", "fr", "ECRIRE ECRIRE ECRIRE ECRIRE"),
        ("écrivons", "", ""),
        ("Strasse STRAßE Ｓｔｒａße scho\u0308n", "de", "STRASSE STRASSE STRASSE SCHÖN"),
    ],
)
def test_words_are_read_as_glosses(typed: str, language: str, glosses: str, lexicons: dict[str, Lexicon]) -> None:
    tokens = parse(typed, lexicons[language or "fr"], language=language)
    assert " ".join(token.glosses[0] for token in tokens if not token.spelled) == glosses


def test_written_signs_are_found_and_suggested_too(tmp_path: Path) -> None:
    signs = Path(__file__).resolve().parents[1] / "synth" / "written_signs.sigml"
    (tmp_path / "signs.sigml").write_text(signs.read_text("utf-8").replace('"THROW"', '"TO-THROW1^"'), "utf-8")
    with ss.open_lexicon(fallback=tmp_path / "signs.sigml") as words:
        tokens = parse("TO-THROW1 throws throw to throw I throow", words)
        assert [token.glosses[0] for token in tokens[:-1]] == [*["TO-THROW1^"] * 4, "I"]
        assert tokens[-1].suggestions == ("TO-THROW1^",)
        assert "TO-THROW1^" not in words.glosses, "written signs are not listed"


def test_an_own_spelling_wins_and_numbers_have_signs(tmp_path: Path) -> None:
    clip = random_clip(0, n_frames=2, n_joints=2)
    with lexicon.building(tmp_path / "lex") as builder:
        for gloss in ("COTE", "CÔTÉ", "HOW-YOU", "NUMBER-12", "NUMBER-3", "NUMBER-5", "POINT", "TREE", "TREE-2"):
            builder.add(clip, gloss)
    with Lexicon(tmp_path / "lex") as lex:
        for typed, glosses in {
            "côté cote coté": "CÔTÉ COTE COTE",
            "how are you": "HOW-YOU",
            "12 12th 35, 3.5": "NUMBER-12 NUMBER-12 NUMBER-3 NUMBER-5 NUMBER-3 POINT NUMBER-5",
            "tree TREE-2": "TREE TREE-2",
        }.items():
            assert " ".join(gloss for token in parse(typed, lex) for gloss in token.glosses) == glosses


@pytest.mark.parametrize(
    ("typed", "language", "words"),
    [
        ("1,000 3.5 1,234,567.5 0,125", "en", "1000 3 . 5 1234567 . 5 0 , 125"),
        ("1.000 3,5 1.234,56", "de", "1000 3 , 5 1234 , 56"),
        ("$5 5€ $2.50 50% 10:30 3rd v2.5", "en", "5 $ 5 € 2 . 50 $ 50 % 10 30 3rd v2 . 5"),
    ],
)
def test_numbers_keep_their_value(typed: str, language: str, words: str, lexicons: dict[str, Lexicon]) -> None:
    tokens = parse(typed, lexicons["en"], language=language)
    assert " ".join(token.token for token in tokens) == words
    assert all(token.glosses for token in tokens)


def test_what_cannot_be_said_silences_nothing_else(lexicons: dict[str, Lexicon]) -> None:
    lex = lexicons["en"]
    tokens = parse("HELLO fs-ñあ 你好 HELLO#9 \N{WAVING HAND SIGN} FRIEND x", lex)
    assert [token.glosses for token in tokens] == [("HELLO",), (), (), (), (), ("FRIEND",), ("fs-X",)]
    assert all("left out" in token.warning for token in tokens[1:5])
    assert count_words(tokens) == "2 of 7 words signed, 1 spelled (1 letter), 4 left out"
    assert count_words(tokens[:1]) == ""
    with pytest.raises(UnknownGlossError, match="你好"):
        parse("你好 fs-あ", lex)
    with pytest.raises(UnknownGlossError, match="zoe"):
        parse("HELLO zoe signs", lex, spell=False)
    with pytest.raises(InputError, match="no letter 'あ'"):
        parse("HELLO fs-あ", lex, spell=False)
    with pytest.raises(InputError, match="language 'xx': no dictionary"):
        parse("zoe", lex, language="xx")


@given(
    st.text(max_size=60)
    | st.lists(st.sampled_from(["Grüße ", "3.5", "$", "1,000", "fs-", "#", "é", "-", "👋 ", "ß", "SCH", "@gsg"])).map(
        "".join
    ),
    st.sampled_from(["en", "", "el", "gsg", "dse", "gss", "de-ase"]),
)
@example("0:FS-", "en")
@example("HELLO#9 fs-ñ \u0301 ½ 1,2.3 $é ﷺ", "en")
@example("fs-ſch Schſch fs-A@gsg ẞ", "gsg")
def test_any_text_gives_its_words_in_order(text: str, code: str) -> None:
    with ss.open_lexicon() as lex:
        try:
            tokens = parse(f"I {text}", lex, language=code)
        except UnknownGlossError:
            pytest.fail("a line with a gloss was refused")
        assert all(gloss in lex for token in tokens for gloss in token.glosses)
    signed = read_languages(code)[1] or "ase"
    assert {token.language for token in tokens if token.spelled and "@" not in token.token} <= {signed}
    assert all(len(line.splitlines()) == 1 for line in line_warnings(tokens, code))
    letters = [c for c in unicodedata.normalize("NFKC", f"I {text}") if c.isalnum()]
    assert [c for token in tokens for c in unicodedata.normalize("NFKC", token.token) if c.isalnum()] == letters
