"""The names of a lexicon that a word which it lacks may have been meant to be."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from signsplice.lexicon.entry import LETTER_MARK

_TIES = 4
"""How many times as many names are compared for ties as are suggested."""


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
        whole = [
            name
            for name in self._with_part.get(word.replace("'", ""), ())
            if spells or not name.startswith(LETTER_MARK)
        ]
        like = extract(
            word,
            self._all if spells else self._signs,
            scorer=Indel.normalized_similarity,
            score_cutoff=similarity,
            limit=_TIES * n,
        )
        like.sort(key=lambda match: (-match[1], OSA.distance(word, match[0])))
        return list(dict.fromkeys([*whole, *(name for name, _, _ in like)]))[:n]
