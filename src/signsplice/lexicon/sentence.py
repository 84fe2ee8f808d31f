"""A line of glosses -> the words and letters that sign it.

Glosses are labels in the order of signing; a line of them is no translation of a spoken sentence.
"""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass

from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon.entry import LETTER_MARK, letter_gloss
from signsplice.lexicon.reader import Lexicon

SPELLED_MARKS = (LETTER_MARK, "#")
_PAUSE = "-"


@dataclass(frozen=True)
class SentenceToken:
    """A token of a line and how it is signed.

    token: as it was written. glosses: of the entries that sign it, one for a word, one a letter where it is spelled.
    spelled: whether it is. warning: what a user should know of it, or empty.
    """

    token: str
    glosses: tuple[str, ...]
    spelled: bool = False
    warning: str = ""


def parse(text: str, lexicon: Lexicon, spell: bool = True) -> list[SentenceToken]:
    """The units of a line of glosses, split at white space.

    A token that the lexicon has is that word. ``fs-ANNA`` and ``#ANNA`` are spelled, hyphens between their letters left
    out. Any other whose every letter the lexicon has is spelled with a warning, unless ``spell`` is False. Raises
    ``UnknownGlossError`` that names every other and the nearest glosses, ``InputError`` for a line without glosses or a
    letter that there is not.
    """
    tokens = text.split()
    if not tokens:
        raise InputError("no gloss in the sentence, expected at least one")
    units: list[SentenceToken] = []
    unknown: dict[str, tuple[str, ...]] = {}
    for token in tokens:
        if token in lexicon:
            units.append(SentenceToken(token, (lexicon.entry(token).gloss,)))
        elif any(token.lower().startswith(mark) and len(token) > len(mark) for mark in SPELLED_MARKS):
            units.append(_spelled(token, lexicon))
        else:
            letters = _letters(token, lexicon) if spell else ()
            if letters and None not in letters:
                units.append(SentenceToken(token, tuple(filter(None, letters)), True, _warning(token, lexicon)))
            else:
                unknown[token] = lexicon.nearest(token)
    if unknown:
        raise UnknownGlossError(unknown, str(lexicon.path))
    return units


def _spelled(token: str, lexicon: Lexicon) -> SentenceToken:
    """The unit of a token that says itself that it is spelled."""
    mark = next(mark for mark in SPELLED_MARKS if token.lower().startswith(mark))
    word = token[len(mark) :].replace(_PAUSE, "")
    letters = _letters(word, lexicon)
    missing = [c for c, letter in zip(unicodedata.normalize("NFC", word), letters, strict=True) if letter is None]
    if missing or not letters:
        letter = missing[0] if missing else _PAUSE
        raise InputError(
            f"{lexicon.path}: {token!r} cannot be spelled, there is no letter {letter!r}; "
            f"`signsplice lexicon list --search {LETTER_MARK}` shows the letters that there are"
        )
    return SentenceToken(token, tuple(filter(None, letters)), True)


def _letters(word: str, lexicon: Lexicon) -> tuple[str | None, ...]:
    """For each character of a word the gloss of the letter that signs it, None where there is none."""
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
