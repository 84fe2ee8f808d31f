"""Methods that splice the words' own clips, as rows next to the paper's systems: classical ones, and this project's
networks.

They work on rotations. Forward kinematics turns their frames into numbers, and that time counts as theirs. A method
either chooses the length of a transition itself or is given the true one, because the paper's Accuracy and MSE mostly
measure the length if it is wrong. Rows state what they were given. All choose the length by the rule ``tempo``. The
networks that ship never saw a word or a signer of the corpus; other bundles may have been trained on the training part
of a split. They cut as the corpus does, which shortens signs (``learned-fluent``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from signsplice.errors import InputError
from signsplice.motion import Clip
from signsplice.splicing.contracts import Cut, gap_at
from signsplice.splicing.durations import RUNNING_S, TravelDuration
from signsplice.splicing.learned import FLUENT, LearnedCutter
from signsplice.splicing.learned import NAME as LEARNED
from signsplice.splicing.options import Methods, choose, open_learned
from signsplice_paper.prediction import Prediction
from signsplice_paper.results import GIVEN
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure.collisions import fill

TRUE_POSITIONS = "true-positions"


@dataclass(frozen=True)
class ClipMethod:
    """A cutter and a transition.

    - cutter: name of the cutter, or ``TRUE_POSITIONS``
    - transition: name of the transition
    - given: the part of the truth that the method is given, one of ``GIVEN``
    - bundle: folder of the learned parts, None for the bundle that ships

    Raises ``InputError`` for unknown names, and for learned parts whose bundle cannot be read.
    """

    cutter: str
    transition: str
    given: str = "nothing"
    bundle: str | Path | None = None

    def __post_init__(self) -> None:
        if self.given not in GIVEN or ("positions" in self.given) != (self.cutter == TRUE_POSITIONS):
            raise InputError(
                f"{self.cutter} given {self.given!r}, expected one of {', '.join(GIVEN)}; "
                f"only {TRUE_POSITIONS} takes positions"
            )
        self.parts  # noqa: B018  # raises for unknown names

    @property
    def name(self) -> str:
        """The name in tables: cutter+transition."""
        return f"{self.cutter}+{self.transition}"

    @property
    def learned(self) -> bool:
        """Whether the method uses a network of this project."""
        return self.cutter == FLUENT or self.transition == LEARNED

    @property
    def n_parameters(self) -> int:
        """Number of parameters of the networks in use."""
        if not self.learned:
            return 0
        networks = open_learned(self.bundle).networks
        in_use = {
            "cutter": self.cutter == FLUENT,
            "transition": self.transition == LEARNED,
        }
        return sum(networks[name].n_parameters for name, used in in_use.items() if used)

    @cached_property
    def parts(self) -> Methods:
        """The cutter, transition and duration of these names."""
        cutter = "ends" if self.cutter == TRUE_POSITIONS else self.cutter
        return choose(cutter, self.transition, TravelDuration(RUNNING_S), self.bundle)

    def splice(self, before: Clip, after: Clip, truth: Cut, n_true: int) -> tuple[Cut, Clip]:
        """Returns the cut and the transition between two words' clips.

        truth, n_true: the true cut and number of transition frames; used only as far as ``given`` allows.
        """
        # Results cached for these words by another pair must not shorten the measured time.
        for clip in (before, after):
            clip.derived.clear()
        if isinstance(self.parts.cutter, LearnedCutter):
            self.parts.cutter.reader.forget(before, after)
        cut = truth if "positions" in self.given else self.parts.cutter.cut_all([before, after])[0]
        n_frames = n_true
        if "length" not in self.given:
            n_frames = max(1, round(self.parts.duration.seconds(before, after, cut) * before.fps))
        return cut, fill(self.parts.transition, [gap_at(before, after, cut, n_frames)], None)[0]


class ClipAnswers:
    """Predictions of a method on a corpus; a callable from a pair's number to its prediction."""

    def __init__(self, pairs: Pairs, method: ClipMethod) -> None:
        self.pairs, self.method = pairs, method
        self._clips: dict[int, Clip] = {}

    def __call__(self, number: int) -> Prediction:
        """Returns the prediction for a pair."""
        p, q, pre, post, _, count = self.pairs.index[number].tolist()
        cut, transition = self.method.splice(self._load_clip(p), self._load_clip(q), Cut(pre, post), count)
        return make_prediction(self.pairs, p, cut, transition)

    def prepare(self, numbers: Sequence[int]) -> None:
        """Reads the words of these pairs in advance, so that reading is not timed."""
        for p in sorted(set(self.pairs.index[list(numbers), :2].ravel().tolist())):
            self._load_clip(p)

    def _load_clip(self, word: int) -> Clip:
        if word not in self._clips:
            self._clips[word] = self.pairs.word_clip(word)
        return self._clips[word]


def make_prediction(pairs: Pairs, word: int, cut: Cut, transition: Clip) -> Prediction:
    """Returns the prediction of a cut and of a transition, given as a clip, after a word."""
    return Prediction(cut.pre, cut.post, pairs.space(word).to_numbers(transition), rotations=transition.local_rotations)


def list_methods() -> list[ClipMethod]:
    """Returns the methods to compare with the paper's systems: a classical one given nothing, one given the truth but
    its frames, and this project's networks.
    """
    rows = [("pose-velocity", "hermite", "nothing"), (TRUE_POSITIONS, "hermite", "positions and length")]
    rows += [(FLUENT, LEARNED, "nothing"), (TRUE_POSITIONS, LEARNED, "positions and length")]
    return [ClipMethod(*row) for row in rows]
