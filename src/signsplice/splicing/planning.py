"""The second stage of a sentence: the seam of every two neighbouring words is planned, before any frame is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from signsplice.errors import SignspliceError
from signsplice.splicing.gap import Cut
from signsplice.splicing.joins.join import PlannedSeam
from signsplice.splicing.joins.letters import LetterJoin
from signsplice.splicing.joins.signs import SignJoin
from signsplice.splicing.joins.systems import NoSpliceError, SystemJoin
from signsplice.splicing.methods.cut import Cutter
from signsplice.splicing.whole_system import misses_message
from signsplice.splicing.words.word import SentenceWord, cut_words


@dataclass(frozen=True)
class Planner:
    """Plans the seams of words in order, each by one of three joins.

    cutter: chooses the cuts of all signs together.
    signs, letters: the joins of words, and of letters of one spelled word.
    spells: whether letters are joined as such; not where the user chose a cutter.
    system: joins the words instead; None where no system is asked for.
    fallback: names of the methods that join words for which the system has no splice; None: that is an error.
    """

    cutter: Cutter
    signs: SignJoin
    letters: LetterJoin
    spells: bool = True
    system: SystemJoin | None = None
    fallback: str | None = None

    def cuts(self, words: Sequence[SentenceWord]) -> list[Cut]:
        """The cutter's choice for every two neighbours; none where a system joins them."""
        return cut_words(self.cutter, words) if self.system is None and len(words) > 1 else []

    def plan(self, words: Sequence[SentenceWord], cuts: Sequence[Cut]) -> list[PlannedSeam]:
        """The seams of words in order, one fewer than words; each word is entered by the seam before it. ``cuts``: of
        the words, by ``cuts``.
        """
        if self.system is not None:
            return self._plan_by_system(self.system, words)
        seams: list[PlannedSeam] = []
        for after, chosen in zip(words[1:], cuts, strict=True):
            seams.append(self._joined(seams[-1].after if seams else words[0], after, chosen))
        return seams

    def _plan_by_system(self, system: SystemJoin, words: Sequence[SentenceWord]) -> list[PlannedSeam]:
        """The seams as the system makes them. Raises ``SignspliceError`` that names all pairs for which it has none,
        unless the fallback joins those.
        """
        seams: list[PlannedSeam] = []
        misses: list[str] = []
        for k, word in enumerate(words[1:]):
            before = seams[-1].after if seams and seams[-1].after.index == words[k].index else words[k]
            try:
                seams.append(system.plan(before, word))
            except NoSpliceError as error:
                if self.fallback is None:
                    misses.append(f"{before.clip.name} -> {word.clip.name}: {error}")
                    continue
                (chosen,) = cut_words(self.cutter, [before, word])
                seam = self._joined(before, word, chosen)
                seams.append(replace(seam, warnings=(f"{error}: joined by {self.fallback}", *seam.warnings)))
        if misses:
            raise SignspliceError(misses_message(misses, len(words) - 1))
        return seams

    def _joined(self, before: SentenceWord, after: SentenceWord, chosen: Cut) -> PlannedSeam:
        """The seam of two words at the cutter's choice."""
        if self.spells and not after.starts and before.is_letter and after.is_letter and before.held is None:
            return self.letters.plan(before, after, chosen)
        return self.signs.plan(before, after, chosen)
