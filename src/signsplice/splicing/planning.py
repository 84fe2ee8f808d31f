"""The second stage of a sentence: the seam of every two neighbouring words is planned, before any frame is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from signsplice.errors import InputError, SignspliceError
from signsplice.lexicon.entry import is_letter
from signsplice.splicing.gap import Cut
from signsplice.splicing.joins.join import PlannedSeam
from signsplice.splicing.joins.letters import LetterJoin
from signsplice.splicing.joins.signs import SignJoin
from signsplice.splicing.joins.systems import NoSpliceError, SystemJoin
from signsplice.splicing.methods.cut import Cutter, cut_clips
from signsplice.splicing.timing import Timing
from signsplice.splicing.whole_system import missing
from signsplice.splicing.words.word import SentenceWord


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

    def plan(self, words: Sequence[SentenceWord], timing: Timing) -> list[PlannedSeam]:
        """The seams of words in order, one fewer than words; each word is entered by the seam before it. ``timing``
        counts the seconds of cuts and durations.
        """
        if len(words) < 2:
            return []
        if self.system is not None:
            return self._plan_by_system(self.system, words, timing)
        seams: list[PlannedSeam] = []
        for after, chosen in zip(words[1:], self._cuts(words, timing), strict=True):
            seams.append(self._joined(seams[-1].after if seams else words[0], after, chosen, timing))
        return seams

    def _plan_by_system(self, system: SystemJoin, words: Sequence[SentenceWord], timing: Timing) -> list[PlannedSeam]:
        """The seams as the system makes them. Raises ``SignspliceError`` that names all pairs for which it has none,
        unless the fallback joins those.
        """
        seams: list[PlannedSeam] = []
        misses: list[str] = []
        before = words[0]
        for after in words[1:]:
            try:
                with timing.of("transition"):
                    seam = system.plan(before, after)
            except NoSpliceError as error:
                if self.fallback is None:
                    misses.append(f"{before.clip.name} -> {after.clip.name}: {error}")
                    before = after
                    continue
                (chosen,) = self._cuts([before, after], timing)
                seam = self._joined(before, after, chosen, timing)
                seam = replace(seam, warnings=(f"{error}: joined by {self.fallback}", *seam.warnings))
            seams.append(seam)
            before = seam.after
        if misses:
            raise SignspliceError(missing(misses, len(words) - 1))
        return seams

    def _cuts(self, words: Sequence[SentenceWord], timing: Timing) -> list[Cut]:
        """The cutter's choice for every two neighbours."""
        with timing.of("cut"):
            return cut_clips(self.cutter, [word.clip for word in words])

    def _joined(self, before: SentenceWord, after: SentenceWord, chosen: Cut, timing: Timing) -> PlannedSeam:
        """The seam of two words at the cutter's choice. Raises ``InputError`` for frames that the words do not have."""
        n_before, n_after = len(before.clip), len(after.clip)
        if not (0 <= chosen.pre < n_before and 0 <= chosen.post < n_after):
            raise InputError(f"cutter {self.cutter.name} chose {chosen} for clips of {n_before} and {n_after} frames")
        if self.spells and not after.starts and is_letter(before.clip.name) and is_letter(after.clip.name):
            with timing.of("cut"):
                return self.letters.plan(before, after, chosen)
        with timing.of("transition"):
            return self.signs.plan(before, after, chosen)
