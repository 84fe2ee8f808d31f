"""What one call of the engine wants; mistakes of callers as errors that say what was given and what is expected."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits
from signsplice.motion import Clip
from signsplice.splicing.face_rules import check_rules
from signsplice.splicing.methods import choice as methods
from signsplice.splicing.methods.choice import ChosenMethods
from signsplice.splicing.methods.cut import CLASSICAL_CUTTER, Cutter
from signsplice.splicing.methods.duration import CLASSICAL_DURATION, MAX_TRANSITION_S, Duration
from signsplice.splicing.methods.learned import NAME
from signsplice.splicing.methods.transition import CLASSICAL_TRANSITION, Transition
from signsplice.splicing.passes import free_hand
from signsplice.splicing.tempo import CITATION, seconds_a_sign
from signsplice.splicing.whole_system import WholeSystem, check_alone

_DECIDED_BY_SYSTEM = (
    "cutter", "transition", "duration", "bundle", "transition_time", "tempo", "avoid_collisions", "free_hand",
)  # fmt: skip


@dataclass(frozen=True)
class SpliceOptions:
    """What one call wants.

    cutter, transition, duration: a name, or an object of that class; None: the learned one, or the classical default
        where the networks cannot be read (``choice.choose``).
    bundle: folder of the networks; None: those that ship.
    transition_time: length of every transition, seconds, in place of the duration.
    sign_speed: how many times as fast signs play.
    tempo: "citation": as recorded; "natural": as in running signing; or how many seconds a sign takes with its
        transition. Holds and slow parts are shortened until it does, as far as human speeds allow.
    fps: output rate; None: the first clip's.
    avoid_collisions: whether hands are led around head, trunk and each other; None: where the transition is learned.
    free_hand: how much time a hand has that only goes to rest at a seam, or comes from it. "transition": that of the
        transition, which is lengthened where the hand would pass 2.2 m/s, unless the call names a transition or a time;
        "natural": frames of the signs too, as long as the hand rests in them.
    face_rules: rules by which words without a face of their own have one, some of ``face_rules.RULES``.
    limits: how many frames a clip may have at the output rate.
    system: a system that splices whole words, in place of cutter, transition, duration and what goes with them.
    fill_misses: whether words for which the system has no splice are joined by the defaults, with a warning; else they
        are an error.

    Raises ``InputError`` for a number out of range, and for what cannot be combined with a system.
    """

    cutter: str | Cutter | None = None
    transition: str | Transition | None = None
    duration: str | Duration | None = None
    bundle: str | Path | None = None
    transition_time: float | None = None
    sign_speed: float = 1.0
    tempo: str | float = CITATION
    fps: float | None = None
    avoid_collisions: bool | None = None
    free_hand: str = free_hand.TRANSITION
    face_rules: tuple[str, ...] = ()
    limits: ReadLimits = DEFAULT_LIMITS
    system: WholeSystem | None = None
    fill_misses: bool = False

    def __post_init__(self) -> None:
        limits = (
            ("transition time", self.transition_time, 0.0, MAX_TRANSITION_S, "s"),
            ("sign speed", self.sign_speed, 0.1, 10.0, ""),
            ("fps", self.fps, 1.0, 1000.0, ""),
        )
        for what, value, least, most, unit in limits:
            if value is not None and not least <= value <= most:
                raise InputError(f"{what} {value:g}{unit}, expected {least:g} to {most:g}{unit}")
        seconds_a_sign(self.tempo)
        if self.free_hand not in free_hand.FREE_HANDS:
            raise InputError(f"free hand {self.free_hand!r}, expected one of {', '.join(free_hand.FREE_HANDS)}")
        check_rules(self.face_rules)
        if self.system is not None:
            decided = {field.name: field.default for field in fields(self) if field.name in _DECIDED_BY_SYSTEM}
            named = [name for name, default in decided.items() if getattr(self, name) not in (default, methods.AUTO)]
            check_alone(self.system, named, self.fps)
        elif self.fill_misses:
            raise InputError(
                "SpliceOptions.fill_misses goes with SpliceOptions.system: it says what becomes of words for which "
                "that has no splice"
            )

    def chosen_methods(self) -> ChosenMethods:
        """The methods of the call; no network is read for a system whose misses are not filled, which needs none."""
        if self.system is None or self.fill_misses:
            return methods.choose(self.cutter, self.transition, self.duration, self.bundle)
        return methods.choose(CLASSICAL_CUTTER, CLASSICAL_TRANSITION, CLASSICAL_DURATION)

    def has_own(self, kind: str) -> bool:
        """Whether the call names a cutter, transition or duration (``kind``) other than the default."""
        return getattr(self, kind) not in (None, methods.AUTO, NAME)

    @property
    def lengthens(self) -> bool:
        """Whether transitions are lengthened for an idle hand: the call names neither them nor their time."""
        return self.transition_time is None and not (self.has_own("transition") or self.has_own("duration"))


_SOURCES = "a file's is load(path), a gloss's open_lexicon(path).clip(gloss)"


def not_clips(clips: Clip | str) -> TypeError:
    """The error for one clip, or a text, in place of the clips of a sentence."""
    if isinstance(clips, Clip):
        return TypeError("clips is one Clip, expected a list of them: splice([a, b])")
    return TypeError(f"clips is the text {clips[:60]!r}, expected a list of Clips; {_SOURCES}")


def not_a_clip(clip: object, index: int) -> TypeError:
    """The error for something else among the clips of a sentence."""
    what = repr(clip)[:60] if isinstance(clip, str) else f"a {type(clip).__name__}"
    return TypeError(f"clip {index} is {what}, expected a Clip; {_SOURCES}")


def not_options(options: object) -> TypeError:
    """The error for something else in place of options: often the second of two clips."""
    hint = "; clips go into one list: splice([a, b])" if isinstance(options, Clip) else ""
    return TypeError(f"options is a {type(options).__name__}, expected SpliceOptions{hint}")
