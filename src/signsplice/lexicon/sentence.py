"""A line of glosses parsed into the words and letters that sign it.

Glosses are labels in the order of signing; a line of glosses is not a translation of a spoken sentence.
"""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass

from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon.entry import LETTER_MARK, letter_gloss
from signsplice.lexicon.reader import Lexicon

SPELLED_MARKS = (LETTER_MARK, "#")
"""Prefixes of tokens to fingerspell."""
_HYPHEN = "-"


@dataclass(frozen=True)
class SentenceToken:
    """A token of a line of glosses, and how it is signed.

    token: the token as written.
    glosses: of the entries that sign it: the word's, or one for each letter.
    spelled: whether it is fingerspelled.
    warning: what a user should know about it, or empty.
    """

    token: str
    glosses: tuple[str, ...]
    spelled: bool = False
    warning: str = ""


def parse(text: str, lexicon: Lexicon, spell: bool = True) -> list[SentenceToken]:
    """The tokens of a line of glosses, split at white space, and how each is signed.

    A token that the lexicon has is that word. ``fs-ANNA`` and ``#ANNA`` are fingerspelled; hyphens between letters are
    ignored. Any other token is fingerspelled with a warning if the lexicon has all its letters and ``spell`` is True.
    Raises ``UnknownGlossError`` that names every token left and similar glosses; ``InputError`` for a line without
    glosses, or a letter that the lexicon lacks.
    """
    tokens = text.split()
    if not tokens:
        raise InputError("no gloss in the sentence, expected at least one")
    readings: list[SentenceToken] = []
    unknown: dict[str, tuple[str, ...]] = {}
    for token in tokens:
        if token in lexicon:
            readings.append(SentenceToken(token, (lexicon.entry(token).gloss,)))
        elif any(token.lower().startswith(mark) and len(token) > len(mark) for mark in SPELLED_MARKS):
            readings.append(_spelled(token, lexicon))
        else:
            letters = _letters(token, lexicon) if spell else ()
            if letters and None not in letters:
                readings.append(SentenceToken(token, tuple(filter(None, letters)), True, _warning(token, lexicon)))
            else:
                unknown[token] = lexicon.nearest(token)
    if unknown:
        raise UnknownGlossError(unknown, str(lexicon.path))
    return readings


def _spelled(token: str, lexicon: Lexicon) -> SentenceToken:
    """The letters of a token with one of ``SPELLED_MARKS``."""
    mark = next(mark for mark in SPELLED_MARKS if token.lower().startswith(mark))
    word = token[len(mark) :].replace(_HYPHEN, "")
    letters = _letters(word, lexicon)
    missing = [c for c, letter in zip(unicodedata.normalize("NFC", word), letters, strict=True) if letter is None]
    if missing or not letters:
        letter = missing[0] if missing else _HYPHEN
        raise InputError(
            f"{lexicon.path}: {token!r} cannot be spelled, there is no letter {letter!r}; "
            f"`signsplice lexicon list --search {LETTER_MARK}` shows the letters that there are"
        )
    return SentenceToken(token, tuple(filter(None, letters)), True)


def _letters(word: str, lexicon: Lexicon) -> tuple[str | None, ...]:
    """For each character of a word the gloss of its letter, None where the lexicon has none."""
    found: list[str | None] = []
    for character in unicodedata.normalize("NFC", word):
        gloss = letter_gloss(character) if character.isprintable() else ""
        entry = lexicon.entry(gloss) if gloss in lexicon else None
        found.append(entry.gloss if entry is not None and entry.kind == "letter" else None)
    return tuple(found)


def _warning(token: str, lexicon: Lexicon) -> str:
    nearest = lexicon.nearest(token)
    near = f"nearest: {', '.join(nearest)}" if nearest else "nothing is near it"
    return f"no gloss {token!r} ({near}), so it is spelled; write {LETTER_MARK}{token} to mean that"
