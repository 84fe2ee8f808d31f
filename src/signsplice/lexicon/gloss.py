"""Glosses: how they are written, what an entry says of one, and which are most like a word that is none.

It opens no file and loads no database, so that a splice may ask what a letter is.
"""

from __future__ import annotations

import unicodedata
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from signsplice.errors import InputError

KINDS = ("sign", "letter")
LETTER_MARK = "fs-"
"""Prefix of the glosses of letters: fs-A."""
_TIES = 4
"""How many times as many names are compared for ties as are suggested."""


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


class Suggestions:
    """Finds the names in a lexicon most like a word that it lacks.

    names: all glosses and synonyms, folded; of those that are equally like a word, the first ones come first.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._all = list(names)
        self._signs = [name for name in self._all if not name.startswith(LETTER_MARK)]
        self._with_part: dict[str, list[str]] = defaultdict(list)
        for name in self._all:
            if "-" in name:
                for part in dict.fromkeys(name.split("-")):
                    self._with_part[part].append(name)

    def nearest(self, word: str, n: int, similarity: float) -> list[str]:
        """Up to ``n`` names most like a folded word, as ``Lexicon.nearest`` says."""
        from rapidfuzz.distance import OSA, Indel  # 30 ms, which only unknown words cost
        from rapidfuzz.process import extract

        spells = word.startswith(LETTER_MARK)
        parts = self._with_part.get(word.replace("'", ""), ())
        whole = [name for name in parts if spells or not name.startswith(LETTER_MARK)]
        names, scorer = self._all if spells else self._signs, Indel.normalized_similarity
        similar = extract(word, names, scorer=scorer, score_cutoff=similarity, limit=_TIES * n)
        similar.sort(key=lambda match: (-match[1], OSA.distance(word, match[0])))
        return list(dict.fromkeys([*whole, *(name for name, _, _ in similar)]))[:n]
