"""What a lexicon tells of a word: its gloss and other names, its rate and length, who signs and who has checked it."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass

from signsplice.errors import InputError

KINDS = ("sign", "letter")
LETTER_MARK = "fs-"
"""Glosses of letters begin so: fs-A."""


@dataclass(frozen=True)
class Entry:
    """A word of a lexicon.

    gloss: its label, which is no translation. kind: "sign", or "letter" of the finger alphabet. synonyms: other glosses
    it is found by. fps, n_frames: of its clip. signer: who signs. source: where the sign's description or recording
    comes from. checked: a signer has said that the clip shows this sign. rest_before, rest_after: frames of rest at
    either end, None where the rig's arms are not known. sha256: of the motion and its skeleton.
    """

    gloss: str
    kind: str
    synonyms: tuple[str, ...]
    fps: float
    n_frames: int
    signer: str
    source: str
    checked: bool
    rest_before: int | None
    rest_after: int | None
    sha256: str

    @property
    def seconds(self) -> float:
        """How long the word plays, rest included."""
        return self.n_frames / self.fps


def gloss_of(text: str) -> str:
    """The gloss that a text means: upper case, ``-`` for white space, ``fs-`` before a letter; composed (NFC).

    Raises ``InputError`` where nothing is left or a character cannot be printed.
    """
    words = "-".join(unicodedata.normalize("NFC", text).split())
    if not words.isprintable() or not words:
        raise InputError(f"gloss {text!r}, expected printable characters")
    upper = "".join(c.upper() if len(c.upper()) == 1 else c for c in words)  # a sharp s is one letter, not two
    return LETTER_MARK + upper[3:] if upper.startswith(LETTER_MARK.upper()) and len(upper) > 3 else upper


def letter_gloss(character: str) -> str:
    """The gloss of a letter or digit of the finger alphabet."""
    return gloss_of(LETTER_MARK + character)


def is_letter(gloss: str) -> bool:
    """Whether a gloss is ``fs-`` and one character."""
    return gloss.startswith(LETTER_MARK) and len(gloss) == len(LETTER_MARK) + 1


def kind_of(gloss: str, kind: str = "") -> str:
    """The kind given, or the one that the gloss tells. Raises ``InputError`` for a kind that there is not, or a letter
    whose gloss is none.
    """
    if kind and kind not in KINDS:
        raise InputError(f"kind {kind!r}, expected {' or '.join(KINDS)}")
    if kind == "letter" and not is_letter(gloss):
        raise InputError(f"letter {gloss!r}, expected a gloss of {LETTER_MARK} and one character, such as fs-A")
    return kind or ("letter" if is_letter(gloss) else "sign")


def fold(text: str) -> str:
    """What a gloss is looked up by: case, white space at its ends and the way accents are coded do not count."""
    return unicodedata.normalize("NFC", "-".join(text.split())).casefold()
