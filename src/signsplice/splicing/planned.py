"""The words of a sentence and their seams while the sentence is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from signsplice.motion.clip import Clip
from signsplice.splicing.gap import Gap
from signsplice.splicing.methods.cut import Cut
from signsplice.splicing.passes.filling import FilledGap
from signsplice.splicing.passes.fingerspelling import LetterSeam
from signsplice.splicing.passes.free_hand import ArmStretch
from signsplice.splicing.passes.letter_blending import MovingFinger
from signsplice.splicing.passes.tempo import Played
from signsplice.splicing.seam import Seam


@dataclass(eq=False)
class SentenceWord:
    """A word of a sentence, aligned to the first one.

    index: its number in the sentence.
    clip: its aligned clip, without the frames at its ends that do not belong to it. The cutter's cuts, ``entry`` and
        the cut of a planned seam count its frames.
    played: the same as it is played; ``played.cut`` counts frames as they are played.
    shown: the same as it is put out, with idle arms that were made anew; ``remade`` and the
        gaps count its frames, which are those of ``played``.
    warnings: about the clip, one line each.
    starts: whether it is no letter that goes on with the spelled word before it.
    transition_s: how long the way from the letter before was planned to take, 0 where there is none.
    entry: the frame at which it is entered.
    seam: the seam by which it is entered.
    n_left_out: how many frames are left out at its beginning.
    remade: where idle arms were made anew in it.
    slid_m: how far it is slid to the side, as a doubled letter.
    fingers: those of a letter that are on their way from or to its neighbour; ``shown`` is without them.
    """

    index: int
    clip: Clip
    played: Played
    shown: Clip
    warnings: tuple[str, ...]
    starts: bool = False
    transition_s: float = 0.0
    entry: int = 0
    seam: Seam | None = None
    n_left_out: int = 0
    remade: list[ArmStretch] = field(default_factory=list)
    slid_m: float = 0.0
    fingers: list[MovingFinger] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class PlannedSeam:
    """Two words, where the first is left and the second entered, the gap between them, warnings about it, and their
    seam as letters of one spelled word, where they are.

    made: the frames between, where a system made them with the cut; None where a transition has to, or there are none.
    """

    before: SentenceWord
    after: SentenceWord
    cut: Cut
    gap: Gap
    warnings: tuple[str, ...]
    letters: LetterSeam | None = None
    made: Clip | None = None


@dataclass(frozen=True, eq=False)
class PlannedWords:
    """Words that are added to a sentence, before any frame is made.

    new: the words.
    last: the last word of the sentence with them; None where there is none.
    seams: their seams in order, that of the first new word with the word before it among them.
    """

    new: Sequence[SentenceWord]
    last: SentenceWord | None
    seams: Sequence[PlannedSeam]

    @property
    def gaps(self) -> list[Gap]:
        """The gaps for which frames have to be made."""
        return [planned.gap for planned in self.seams if planned.gap.n_frames and planned.made is None]


@dataclass(frozen=True, eq=False)
class FinishedWords:
    """Words with all their frames.

    seams: each with its new frames, None where it has none.
    """

    seams: Sequence[tuple[PlannedSeam, FilledGap | None]]

    @property
    def windows(self) -> tuple[list[Gap], list[FilledGap | None]]:
        """The gaps, and their new frames."""
        return [planned.gap for planned, _ in self.seams], [filled for _, filled in self.seams]
