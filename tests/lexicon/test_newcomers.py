"""What people type who are new to glosses, and what comes of it: newcomers.csv holds, and docs/lexicon.md quotes it."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from signsplice.errors import InputError
from signsplice.lexicon import shipped
from signsplice.lexicon.sentence import SentenceToken, parse

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
    with shipped() as lexicon:
        try:
            tokens = parse(typed, lexicon)
        except InputError as error:
            return "nothing", "error: " + str(error).removeprefix(f"{lexicon.path}: ").partition("; `")[0]
    said = [text for token in tokens for text in (token.note, token.warning) if text]
    return " ".join(filter(None, map(shown, tokens))), re.sub("; write fs-[^ ;]+ to mean that", "", "; ".join(said))


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
