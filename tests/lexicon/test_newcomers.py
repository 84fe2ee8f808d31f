"""What people type who are new to glosses, and what comes of it: newcomers.csv holds, and docs/lexicon.md quotes it."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from signsplice.errors import InputError
from signsplice.lexicon import open_shipped_lexicon
from signsplice.lexicon.lemmas import without_copula
from signsplice.lexicon.sentence import SentenceToken, list_spelled_words, parse

TABLE = Path(__file__).with_name("newcomers.csv")
DOCS = Path(__file__).resolve().parents[2] / "docs" / "lexicon.md"
PARTS = ("fs-", "#", "-", "'", ".", ",", "/", " ", "I", "LOVE", "you", "THANK", "3", "é", "👋", "\u0301", "\x1b")
HEAD = "| typed | signed | said |"


def rows() -> list[tuple[str, str, str]]:
    """The rows of the table: typed, signed, said."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return [(row["typed"], row["signed"], row["said"]) for row in csv.DictReader(file)]


def quoted() -> list[tuple[str, str, str]]:
    """The rows of the table in the documentation."""
    lines = iter(DOCS.read_text(encoding="utf-8").splitlines())
    assert HEAD in lines
    next(lines)
    table = []
    for line in lines:
        if not line.startswith("| "):
            break
        typed, signed, said = line.removeprefix("| ").removesuffix(" |").split(" | ")
        table.append((typed.strip("`"), signed.strip("`"), said.strip()))
    return table


def shown(token: SentenceToken) -> str:
    """A token's gloss, or its letters as one spelled word."""
    letters = [gloss.removeprefix("fs-") for gloss in token.glosses]
    return f"fs-{''.join(letters)}" if token.spelled else " ".join(token.glosses)


def outcome(typed: str) -> tuple[str, str]:
    """What is signed for a line, and what is said about it."""
    with open_shipped_lexicon() as lexicon:
        try:
            tokens = parse(typed, lexicon)
        except InputError as error:
            return "nothing", "error: " + str(error).removeprefix(f"{lexicon.where}: ").partition("; `")[0]
    said = [text for token in tokens for text in (token.note, token.warning) if text]
    return " ".join(filter(None, map(shown, tokens))), re.sub(
        "; write fs-[^ ;]+ to mean that(, or drop function words)?", "", "; ".join(said)
    )


def test_the_table_is_long_enough() -> None:
    assert len(rows()) >= 60
    assert len({typed for typed, _, _ in rows()}) == len(rows())


def test_the_documentation_quotes_the_table() -> None:
    assert len(quoted()) >= 12
    assert set(quoted()) <= set(rows())


@pytest.mark.parametrize(("typed", "signed", "said"), rows())
def test_what_newcomers_type(typed: str, signed: str, said: str) -> None:
    assert outcome(typed) == (signed, said)


@settings(max_examples=15)
@given(st.text(max_size=40) | st.lists(st.sampled_from(PARTS)).map("".join))
def test_any_text_is_signed_or_refused_in_one_line(typed: str) -> None:
    signed, said = outcome(typed)
    assert (signed == "nothing") == said.startswith("error: ")
    assert len(said.splitlines()) <= 1


# --- whole sentences of English ---

SENTENCES = TABLE.with_name("newcomer_sentences.csv")


def sentences() -> list[tuple[str, list[str], list[str]]]:
    """What was typed, what of it is spelled, and what without function words."""
    with SENTENCES.open(encoding="utf-8", newline="") as file:
        return [(typed, a.split(), b.split()) for typed, a, b in list(csv.reader(file))[1:]]


def test_the_documentation_counts_what_is_spelled() -> None:
    table = sentences()
    with open_shipped_lexicon() as lexicon:
        n_tokens = sum(len(parse(typed, lexicon)) for typed, _, _ in table)
    spelled_before, spelled_after = ([row[k] for row in table if row[k]] for k in (1, 2))
    counts = [len(spelled_before), sum(map(len, spelled_before)), n_tokens]
    counts += [len(spelled_after), sum(map(len, spelled_after))]
    text = " ".join(DOCS.read_text(encoding="utf-8").split())
    found = re.search(
        r"40 sentences\S+ as newcomers type them, (\d+) have words that are spelled, (\d+) of (\d+) tokens; "
        r"without function words (\d+), with (\d+)\.",
        text,
    )
    assert len(table) == 40
    assert found
    assert [int(number) for number in found.groups()] == counts


@pytest.mark.parametrize(("typed", "as_typed", "without"), sentences())
def test_what_is_spelled_of_sentences_of_english(typed: str, as_typed: list[str], without: list[str]) -> None:
    with open_shipped_lexicon() as lexicon:
        tokens = parse(typed, lexicon)
        assert list_spelled_words(tokens) == as_typed
        assert [token.token for token in tokens if token.warning] == as_typed, "each is warned of"
        kept = parse(typed, lexicon, drop_function_words=True)
    assert list_spelled_words(kept) == without
    assert all(token.note for token in kept if not token.glosses), "what is left out is said"
    assert [token.token for token in kept] == [token.token for token in tokens]
    for token in tokens:
        parts = [gloss.split("-") for gloss in token.suggestions]
        assert all(len(part) <= len(token.token) for words in parts for part in words if len(words) == 1)


@pytest.mark.parametrize(
    ("word", "meant"), [("frend", "FRIEND"), ("helo", "HELLO"), ("wht", "WHAT"), ("tomorow", "TOMORROW")]
)
def test_a_missing_letter_is_still_found(word: str, meant: str) -> None:
    with open_shipped_lexicon() as lexicon:
        assert meant in parse(word, lexicon)[0].suggestions


@pytest.mark.parametrize("word", ["how", "do", "and", "other", "any", "are", "were"])
def test_a_word_of_english_is_no_part_of_a_longer_one(word: str) -> None:
    with open_shipped_lexicon() as lexicon:
        assert parse(word, lexicon)[0].suggestions == ()


def test_function_words_of_a_compound_or_marked_as_spelled_stay() -> None:
    with open_shipped_lexicon() as lexicon:
        tokens = parse("the fs-the #IS. I do, do you? do", lexicon, drop_function_words=True)
        assert [shown(token) for token in tokens] == ["", "fs-THE", "fs-IS", "I", "fs-DO", "", "YOU", "fs-DO"]
        assert [token.pause for token in tokens] == ["", "", ".", "", ",", "", "?", ""]
        assert [token.note for token in tokens if token.note][:1] == ["'the' has no sign in ASL, and is left out"]
        assert [shown(token) for token in parse("a the", lexicon, drop_function_words=True)] == ["", ""]
    assert without_copula("I'm") == "I"
    assert [without_copula(word) for word in ("youre", "They're", "what's")] == ["you", "They", "what"]
    assert not any(without_copula(word) for word in ("were", "dog's", "its", "mothers", "whats", "I"))
