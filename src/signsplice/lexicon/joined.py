"""Several lexicons as one, in which the first that has a word counts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

from signsplice.errors import UnknownGlossError
from signsplice.lexicon.entry import Entry, fold
from signsplice.lexicon.index import Head
from signsplice.lexicon.reader import Lexicon
from signsplice.motion import Clip
from signsplice.progress import Progress


class JoinedLexicon(Lexicon):
    """Open lexicons as one. A name stands for the word of the first lexicon that has it as a gloss or synonym; a word
    whose gloss an earlier one has cannot be found. Closing it closes them. ``path`` is that of the first.
    """

    def __init__(self, parts: Sequence[Lexicon]) -> None:
        self._parts, self.path = tuple(parts), parts[0].path
        forms = " and ".join(dict.fromkeys(part.form for part in parts))
        self._head = Head(forms, 0, sum(part.n_bytes for part in parts), "")

    def __reduce__(self) -> tuple[type[Lexicon], tuple[tuple[Lexicon, ...]]]:  # type: ignore[override]
        return type(self), (self._parts,)

    @property
    def parts(self) -> tuple[Lexicon, ...]:
        """The lexicons, in the order in which they are asked."""
        return self._parts

    @property
    def where(self) -> str:
        """Where their words are, for messages."""
        return " and ".join(part.where for part in self._parts)

    def close(self) -> None:
        """Close every lexicon."""
        for part in self._parts:
            part.close()

    def __len__(self) -> int:
        return len(self._named)

    def __contains__(self, gloss: object) -> bool:
        return any(gloss in part for part in self._parts)

    def lists(self, gloss: object) -> bool:
        """As ``Lexicon.lists``."""
        return any(part.lists(gloss) for part in self._parts)

    @cached_property
    def glosses(self) -> tuple[str, ...]:
        """The glosses of all words that can be found, sorted; without synonyms."""
        return tuple(entry.gloss for entry, _ in self._named)

    def entry(self, gloss: str) -> Entry:
        """As ``Lexicon.entry``."""
        part, found = self._part(gloss)
        return part.entry(found)

    def clip(self, gloss: str) -> Clip:
        """As ``Lexicon.clip``; clips of several lexicons may differ in rig and rate."""
        part, found = self._part(gloss)
        return part.clip(found)

    def faults(self, progress: Progress | None = None) -> Iterator[str]:
        """As ``Lexicon.faults``, of every lexicon."""
        return (line for part in self._parts for line in part.faults(progress))

    def verify(self) -> None:
        """As ``Lexicon.verify``, of every lexicon."""
        for part in self._parts:
            part.verify()

    def warnings(self, progress: Progress | None = None) -> Iterator[str]:
        """As ``Lexicon.warnings``, of every lexicon."""
        return (line for part in self._parts for line in part.warnings(progress))

    def _part(self, gloss: str) -> tuple[Lexicon, str]:
        """The lexicon whose word a name stands for, and the gloss by which that lexicon has it."""
        for k, part in enumerate(self._parts):
            if gloss in part:
                found = part.entry(gloss).gloss
                # A synonym of a word whose gloss an earlier lexicon has: the sign of that name is the earlier one's.
                return self._part(found) if any(found in one for one in self._parts[:k]) else (part, found)
        raise UnknownGlossError({gloss: self.nearest(gloss)}, self.where)

    @cached_property
    def _named(self) -> list[tuple[Entry, list[str]]]:
        rows, seen = list[tuple[Entry, list[str]]](), set[str]()
        for part in self._parts:
            found = part._named
            rows += (row for row in found if fold(row[0].gloss) not in seen)
            seen |= {name for _, names in found for name in names}
        return sorted(rows, key=lambda row: row[0].gloss)

    @cached_property
    def _shown(self) -> dict[str, str]:
        return {folded: shown for part in reversed(self._parts) for folded, shown in part._shown.items()}
