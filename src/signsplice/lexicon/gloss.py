"""Glosses: their spelling, their entries, and suggestions for unknown words.

This module opens no file and loads no database, so that a splice can use it to recognise letters.
"""

from __future__ import annotations

import re
import unicodedata
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from signsplice.errors import InputError

KINDS = ("sign", "letter")
LETTER_MARK = "fs-"
"""Prefix of the glosses of letters: fs-A."""
JOINED_LETTERS = ("SCH",)
"""Letters that together have one sign in a manual alphabet, here the German."""
_LETTER = re.compile(rf"(?is){LETTER_MARK}(?P<letter>{'|'.join(JOINED_LETTERS)}|.)(?:@[a-z]{{3}})?")
"""The gloss of a letter; after @ the signed language of an alphabet that ships."""
_TIES = 4
"""Number of names compared for ties, as a multiple of the number of suggestions."""


@dataclass(frozen=True)
class Entry:
    """The entry of a word in a lexicon.

    gloss: its label; not a translation.
    kind: "sign", or "letter" of the finger alphabet.
    synonyms: other glosses that name it.
    fps: frame rate of its clip.
    n_frames: length of its clip.
    signer: who signs.
    source: origin of the sign's description or recording.
    checked: whether a signer has confirmed that the clip shows this sign.
    rest_before: frames before the sign, which are rest or dropped by splices; None if the rig's arms are unknown.
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
        """Duration of the clip, including rest."""
        return self.n_frames / self.fps


def gloss_of(text: str) -> str:
    """Return the gloss for a text: upper case, ``-`` for white space, ``fs-`` before a letter, composed (NFC).

    Raises ``InputError`` if the gloss would be empty or a character is not printable.
    """
    words = "-".join(unicodedata.normalize("NFC", text).split())
    if not words.isprintable() or not words:
        raise InputError(f"gloss {text[:80]!r}, expected printable characters")
    upper = "".join(c.upper() if len(c.upper()) == 1 else c for c in words)  # a sharp s stays one letter
    return LETTER_MARK + upper[3:] if upper.startswith(LETTER_MARK.upper()) and len(upper) > 3 else upper


def letter_gloss(character: str, language: str = "") -> str:
    """Return the gloss of a letter or digit of the lexicon's finger alphabet, or of that of a signed language which
    ships: fs-A@GSG.
    """
    return gloss_of(LETTER_MARK + character + f"@{language}" * bool(language))


def letter_of(gloss: str) -> str:
    """Return the letter of a letter's gloss, in upper case; empty for other glosses."""
    match = _LETTER.fullmatch(gloss)
    return match["letter"].upper() if match else ""


def is_letter(gloss: str) -> bool:
    """Return whether a gloss is ``fs-`` and one character or one of ``JOINED_LETTERS``, in any case."""
    return bool(_LETTER.fullmatch(gloss))


def kind_of(gloss: str, kind: str = "") -> str:
    """Return the given kind, or the one that follows from the gloss.

    Raises ``InputError`` for an unknown kind, or for a letter whose gloss is that of none (``is_letter``).
    """
    if kind and kind not in KINDS:
        raise InputError(f"kind {kind[:40]!r}, expected {' or '.join(KINDS)}")
    if kind == "letter" and not is_letter(gloss):
        raise InputError(f"letter {gloss[:40]!r}, expected a gloss of {LETTER_MARK} and one character, such as fs-A")
    return kind or ("letter" if is_letter(gloss) else "sign")


def fold(text: str) -> str:
    """Return the lookup key of a gloss, which ignores case, outer white space and the encoding of accents."""
    return unicodedata.normalize("NFC", "-".join(text.split())).casefold()


_LETTERS = str.maketrans(
    {"ł": "l", "ø": "o", "đ": "d", "ħ": "h", "ŧ": "t", "ı": "i", "æ": "ae", "œ": "oe", "þ": "th", "ð": "d"}
)
"""Letters that Unicode does not decompose -> plain letters."""
_ACCENT = 200
"""Combining classes from this on are accents; those below are parts of letters, as in Devanagari and kana."""
_MARKS = "^*?~!+"
"""Marks of corpora after a gloss: TO-TELL1^ is close to the meaning of TO-TELL1."""
_VARIANT = re.compile(rf"[-_]?\d[-_\d]*[a-z]?[{re.escape(_MARKS)}]*$")
"""The suffix of a variant, folded: TREE-2, GEBEN1A, AMSTEL-B_241220_1."""


def plain(text: str) -> str:
    """Return the lookup key of a gloss without accents and typographic forms: écrire is ecrire, Gruß is gruss."""
    folded = fold(text)
    if folded.isascii():
        return folded
    decomposed = unicodedata.normalize("NFKD", folded.translate(_LETTERS))
    return "".join(c for c in decomposed if unicodedata.combining(c) < _ACCENT).casefold()


def readings(name: str) -> tuple[str, ...]:
    """Return the keys by which a name of a lexicon is found, best first: in plain letters, without marks, without the
    suffix of a variant, without *to* before an English verb, without hyphens.
    """
    key = plain(name)
    if key.startswith((LETTER_MARK, "num")):
        return (key,) * 5
    word = _VARIANT.sub("", key).rstrip(_MARKS) or key
    return key, key.rstrip(_MARKS), word, word.removeprefix("to-") or word, word.replace("-", "")


class Suggestions:
    """Finds the names in a lexicon that are most similar to a word that it lacks.

    names: all glosses and synonyms, in plain letters; equally similar ones keep this order.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._all = list(names)
        self._signs = [name for name in self._all if not name.startswith(LETTER_MARK)]
        self._bare = [name.rstrip(_MARKS).removeprefix("to-") for name in self._signs]
        self._with_part: dict[str, list[str]] = defaultdict(list)
        for name in self._all:
            if "-" in name:
                for part in dict.fromkeys((*name.split("-"), *readings(name)[2].split("-"))):
                    self._with_part[part].append(name)

    def nearest(self, word: str, n: int, similarity: float) -> list[str]:
        """Return up to ``n`` names most similar to a word in plain letters, as described for ``Lexicon.nearest``."""
        from rapidfuzz.distance import OSA, Indel  # takes 30 ms, needed only for unknown words
        from rapidfuzz.process import extract

        spells = word.startswith(LETTER_MARK)
        parts = self._with_part.get(word.replace("'", ""), ())
        part_matches = [name for name in parts if spells or not name.startswith(LETTER_MARK)]
        names, bare = (self._all, self._all) if spells else (self._signs, self._bare)
        scorer = Indel.normalized_similarity
        similar = extract(word, bare, scorer=scorer, score_cutoff=similarity, limit=_TIES * n)
        similar.sort(key=lambda match: (-match[1], OSA.distance(word, match[0])))
        return list(dict.fromkeys([*part_matches, *(names[k] for _, _, k in similar)]))[:n]
