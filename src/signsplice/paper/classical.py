"""The traditional methods behind the paper, as rows beside its systems: every classical cutter with slerp and Hermite.

They work on the words' clips (rotations); what they make is brought to the 159 numbers by forward kinematics, and the
time that this takes counts as theirs. How long a transition takes is either theirs to say (the engine's rule
``auto``) or told: with a length of their own the paper's Accuracy and MSE see little but the length. Rows say what
they were told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from signsplice.errors import InputError
from signsplice.motion.clip import Clip
from signsplice.paper.prediction import Prediction
from signsplice.splicing.cut import CUTTERS, Cut, find_cutter
from signsplice.splicing.duration import find_duration
from signsplice.splicing.transition import find_transition
from signsplice.synth.corpus import Pairs, scaled_positions

TRANSITIONS = ("slerp", "hermite")
DURATION = "auto"
CONTEXT = 8
TOLD = ("nothing", "length", "positions", "positions and length")
TRUE_POSITIONS = "true-positions"


@dataclass(frozen=True)
class Classical:
    """A cutter and a transition by name; ``told`` is what it is told of the truth, one of ``TOLD``."""

    cutter: str
    transition: str
    told: str = "nothing"

    def __post_init__(self) -> None:
        if self.told not in TOLD or ("positions" in self.told) != (self.cutter == TRUE_POSITIONS):
            raise InputError(
                f"{self.cutter} told {self.told!r}, expected one of {', '.join(TOLD)}, positions for {TRUE_POSITIONS}"
            )
        find_transition(self.transition)
        if self.cutter != TRUE_POSITIONS:
            find_cutter(self.cutter)

    @property
    def name(self) -> str:
        """cutter+transition."""
        return f"{self.cutter}+{self.transition}"

    def splice(self, before: Clip, after: Clip, truth: Cut, n_true: int) -> tuple[Cut, Clip]:
        """The splice position and the transition between two words' clips; ``truth`` and ``n_true`` are looked at only
        as far as ``told`` allows.
        """
        # A clip of its own for each pair: nothing about the arms is remembered from another pair.
        before, after = before[:], after[:]
        cut = truth if "positions" in self.told else find_cutter(self.cutter).cut(before, after)
        n_frames = n_true
        if "length" not in self.told:
            seconds = find_duration(DURATION).seconds(before, after, cut)
            n_frames = max(1, round(seconds * before.fps))
        kept = before[max(0, cut.pre + 1 - CONTEXT) : cut.pre + 1]
        made = find_transition(self.transition).between(kept, after[cut.post : cut.post + CONTEXT], n_frames)
        return cut, made


class ClassicalAnswers:
    """A classical row on a corpus: called with a pair's number, it answers with a prediction."""

    def __init__(self, pairs: Pairs, method: Classical) -> None:
        self.pairs, self.method = pairs, method
        self._clips: dict[int, Clip] = {}

    def __call__(self, number: int) -> Prediction:
        """The prediction for a pair."""
        p, q, pre, post, _, count = self.pairs.index[number].tolist()
        cut, made = self.method.splice(self._clip(p), self._clip(q), Cut(pre, post), count)
        who = self.pairs.signers[0 if p < len(self.pairs.head["words"]) // 2 else 1]
        frames = scaled_positions(made.local_rotations, made.root_positions, who, made.fps)
        return Prediction(cut.pre, cut.post, frames)

    def prepare(self, numbers: Sequence[int]) -> None:
        """Read the words of some pairs, so that reading them is not timed."""
        for p in sorted(set(self.pairs.index[list(numbers), :2].ravel().tolist())):
            self._clip(p)

    def _clip(self, word: int) -> Clip:
        if word not in self._clips:
            self._clips[word] = self.pairs.word_clip(word)
        return self._clips[word]


def every() -> list[Classical]:
    """All rows: each cutter with each transition, its own length and the true one; and both told the true positions."""
    rows = [Classical(c, t, told) for told in ("nothing", "length") for c in CUTTERS for t in TRANSITIONS]
    rows += [Classical(TRUE_POSITIONS, t, told) for told in TOLD[2:] for t in TRANSITIONS]
    return rows
