"""The entry of a word in a lexicon, and the rules for glosses."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass

from signsplice.errors import InputError

KINDS = ("sign", "letter")
LETTER_MARK = "fs-"
"""Prefix of the glosses of letters: fs-A."""


@dataclass(frozen=True)
class Entry:
    """The entry of a word in a lexicon.

    gloss: its label, which is not a translation.
    kind: "sign", or "letter" of the finger alphabet.
    synonyms: other glosses by which it is found.
    fps: frame rate of its clip.
    n_frames: length of its clip.
    signer: who signs.
    source: where the sign's description or recording comes from.
    checked: whether a signer has confirmed that the clip shows this sign.
    rest_before: frames before the sign, of rest or left out by splices; None where the rig's arms are not known.
    rest_after: frames after the sign, likewise.
    sha256: hash of the motion and its skeleton.
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
        """Duration of the clip, rest included."""
        return self.n_frames / self.fps


def gloss_of(text: str) -> str:
    """The gloss that a text stands for: upper case, ``-`` for white space, ``fs-`` before a letter, composed (NFC).

    Raises ``InputError`` where nothing is left or a character is not printable.
    """
    words = "-".join(unicodedata.normalize("NFC", text).split())
    if not words.isprintable() or not words:
        raise InputError(f"gloss {text[:80]!r}, expected printable characters")
    upper = "".join(c.upper() if len(c.upper()) == 1 else c for c in words)  # a sharp s stays one letter
    return LETTER_MARK + upper[3:] if upper.startswith(LETTER_MARK.upper()) and len(upper) > 3 else upper


def letter_gloss(character: str) -> str:
    """The gloss of a letter or digit of the finger alphabet."""
    return gloss_of(LETTER_MARK + character)


def is_letter(gloss: str) -> bool:
    """Whether a gloss is ``fs-`` and one character, in any case."""
    return gloss.lower().startswith(LETTER_MARK) and len(gloss) == len(LETTER_MARK) + 1


def kind_of(gloss: str, kind: str = "") -> str:
    """The given kind, or the one that follows from the gloss.

    Raises ``InputError`` for an unknown kind, or for a letter whose gloss is not ``fs-`` and one character.
    """
    if kind and kind not in KINDS:
        raise InputError(f"kind {kind[:40]!r}, expected {' or '.join(KINDS)}")
    if kind == "letter" and not is_letter(gloss):
        raise InputError(f"letter {gloss[:40]!r}, expected a gloss of {LETTER_MARK} and one character, such as fs-A")
    return kind or ("letter" if is_letter(gloss) else "sign")


def fold(text: str) -> str:
    """The key by which a gloss is looked up: case, outer white space and the encoding of accents do not matter."""
    return unicodedata.normalize("NFC", "-".join(text.split())).casefold()
