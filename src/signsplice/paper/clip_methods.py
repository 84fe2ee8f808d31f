"""Methods that join the words' own clips, as rows beside the paper's systems: every classical cutter with slerp and
Hermite, and this project's own networks.

They work on rotations; what they make is brought to the 159 numbers by forward kinematics, and the time that this
takes counts as theirs. How long a transition takes is theirs to say or told: with a length of their own the paper's
Accuracy and MSE see little but the length. Rows say what they were told. A classical row's own time is the rule
``tempo``. The networks that ship never saw a word or a signer of the corpus; others may
have been taught a split's training part. They cut as the corpus does, which shortens signs
(``learned-fluent``), and their own time is the learned one without the floor that it has for viewers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from signsplice.errors import InputError
from signsplice.motion.clip import Clip
from signsplice.paper.prediction import Prediction
from signsplice.splicing.cut import CUTTERS, Cut
from signsplice.splicing.duration import DEFAULT_DURATION
from signsplice.splicing.filling import fill, n_shown_frames
from signsplice.splicing.learned import FLUENT, LearnedDuration
from signsplice.splicing.learned import NAME as LEARNED
from signsplice.splicing.methods import ChosenMethods, choose, open_learned
from signsplice.synth.corpus import Pairs, scaled_positions

TRANSITIONS = ("slerp", "hermite")
GIVEN = ("nothing", "length", "positions", "positions and length")
TRUE_POSITIONS = "true-positions"


@dataclass(frozen=True)
class ClipMethod:
    """A cutter and a transition by name; ``given`` is what it is told of the truth, one of ``GIVEN``; ``bundle`` the
    folder of learned parts, by default that which ships.

    Raises ``InputError`` for unknown names, and learned ones where the bundle cannot be read.
    """

    cutter: str
    transition: str
    given: str = "nothing"
    bundle: str | Path | None = None

    def __post_init__(self) -> None:
        if self.given not in GIVEN or ("positions" in self.given) != (self.cutter == TRUE_POSITIONS):
            raise InputError(
                f"{self.cutter} told {self.given!r}, expected one of {', '.join(GIVEN)}, positions for {TRUE_POSITIONS}"
            )
        self.parts  # noqa: B018  # unknown names are refused here

    @property
    def name(self) -> str:
        """cutter+transition."""
        return f"{self.cutter}+{self.transition}"

    @property
    def learned(self) -> bool:
        """Whether a network of this project takes part."""
        return self.cutter == FLUENT or self.transition == LEARNED

    @property
    def taught(self) -> dict[str, str] | None:
        """Which ``corpus`` and ``split`` the networks that take part learned from; None where they never saw one.

        Raises ``InputError`` where they learned from two.
        """
        if not self.learned:
            return None
        found = {
            tuple(facts["taught"].items()) for facts in open_learned(self.bundle).networks.values() if "taught" in facts
        }
        if len(found) > 1:
            raise InputError(f"{self.bundle}: its networks learned from {len(found)} splits, expected one")
        return dict(found.pop()) if found else None

    @property
    def n_parameters(self) -> int:
        """Parameters of the networks that take part, 0 without any."""
        if not self.learned:
            return 0
        facts = open_learned(self.bundle).networks
        timed = isinstance(self.parts.duration, LearnedDuration)
        used = [
            name for name, takes_part in (("cutter", timed), ("transition", self.transition == LEARNED)) if takes_part
        ]
        return sum(facts[name]["n_parameters"] for name in used)

    @cached_property
    def parts(self) -> ChosenMethods:
        """What does the work."""
        cutter = "ends" if self.cutter == TRUE_POSITIONS else self.cutter
        timed = self.cutter == FLUENT or (self.given == "positions" and self.learned)
        parts = choose(cutter, self.transition, LEARNED if timed else DEFAULT_DURATION, self.bundle)
        if not isinstance(parts.duration, LearnedDuration):
            return parts
        product_methods = LearnedDuration(parts.duration.reader, unhurried=False)
        return ChosenMethods(parts.cutter, parts.transition, product_methods, parts.bundle)

    def splice(self, before: Clip, after: Clip, truth: Cut, n_true: int) -> tuple[Cut, Clip]:
        """The splice position and the transition between two words' clips; ``truth`` and ``n_true`` are looked at only
        as far as ``told`` allows.
        """
        # A clip of its own for each pair: nothing that was read of it for another pair is remembered.
        before, after = before[:], after[:]
        cut = truth if "positions" in self.given else self.parts.cutter.cut(before, after)
        n_frames = n_true
        if "length" not in self.given:
            n_frames = max(1, round(self.parts.duration.seconds(before, after, cut) * before.fps))
        n_shown = n_shown_frames(before.fps)
        kept = before[max(0, cut.pre + 1 - n_shown) : cut.pre + 1]
        gap = (kept, after[cut.post : cut.post + n_shown], n_frames)
        return cut, fill(self.parts.transition, [gap], None)[0].clip


class ClipAnswers:
    """A method's row on a corpus: called with a pair's number, it answers with a prediction."""

    def __init__(self, pairs: Pairs, method: ClipMethod) -> None:
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


def classical() -> list[ClipMethod]:
    """Each classical cutter with each transition, its own length and the true one; and both told the true positions."""
    rows = [ClipMethod(c, t, told) for told in ("nothing", "length") for c in CUTTERS for t in TRANSITIONS]
    rows += [ClipMethod(TRUE_POSITIONS, t, told) for told in GIVEN[2:] for t in TRANSITIONS]
    return rows


def product_methods(bundle: str | Path | None = None) -> list[ClipMethod]:
    """The networks of this project: whole, cutter with a classical transition, transition told the truth."""
    rows = [(FLUENT, LEARNED, "nothing"), (FLUENT, "hermite", "nothing")]
    rows += [(TRUE_POSITIONS, LEARNED, told) for told in GIVEN[2:]]
    return [ClipMethod(*row, bundle) for row in rows]


def all_clip_methods() -> list[ClipMethod]:
    """All rows; our own where the networks that ship can be read."""
    return classical() + (product_methods() if choose().bundle is not None else [])
