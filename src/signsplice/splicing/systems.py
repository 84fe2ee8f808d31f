"""Systems that splice two words whole, as the paper's do (eq. 17), in place of a cutter, a duration and a transition.

    Y = [P_1 .. P_pre, O, Q_post .. Q_M]: the system chooses pre, post and the number of frames O, and makes them

A system gives seams with their frames, each from its two words as they are. Where two seams of a word cross (it would
be left before the frame at which it is entered), or a system finds no position, there is no splice of that pair.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from signsplice.errors import InputError, SignspliceError
from signsplice.motion import Clip
from signsplice.rig.align import Reference
from signsplice.splicing.contracts import Cut, Method, gap_at
from signsplice.splicing.seam import SYSTEM, Seam
from signsplice.splicing.word import AlignedWord

FPS_TOLERANCE = 1e-3
"""Rates that differ by a smaller fraction are one: frame times in files are rounded."""


class NoSpliceError(SignspliceError):
    """A system has no splice of two words; the message says why."""


class WholeSystem(Method, ABC):
    """A system that chooses where two words are joined, and makes the frames between them.

    fps: the frame rate that it knows; None: any.
    sha256: of its bundle; None where it comes from no file.
    facts: what a report says of it, besides name and sha256.
    """

    fps: float | None = None
    sha256: str | None = None
    facts: Mapping[str, Any] = {}

    @abstractmethod
    def splice_words(self, before: AlignedWord, after: AlignedWord) -> Seam:
        """The seam of two words at the system's rate, on one skeleton, with its frames (``filled_seam``). Raises
        ``NoSpliceError`` where the system has none.
        """

    def filled_seam(
        self,
        before: AlignedWord,
        after: AlignedWord,
        pre: int | None,
        post: int | None,
        frames: Clip | None = None,
        warnings: tuple[str, ...] = (),
    ) -> Seam:
        """The seam of two words whose last frame kept is ``pre`` and first frame kept ``post``, None where the system
        found none, with new ``frames`` between them, None where there are none. Raises ``NoSpliceError`` where a
        position is missing, or the word before would be left before it is entered.
        """
        if pre is None or post is None:
            lacks = {
                (True, True): "neither position",
                (True, False): "no prePosition",
                (False, True): "no postPosition",
            }
            raise NoSpliceError(f"{self.name} finds {lacks[pre is None, post is None]}")
        if pre < before.entry:
            left, entered = (frame + before.frames.n_left_out for frame in (pre, before.entry))
            raise NoSpliceError(
                f"{self.name} leaves the first word at frame {left}, before its entry at frame {entered}"
            )
        cut = Cut(pre, post)
        gap = gap_at(
            before.clip,
            after.clip,
            cut,
            0 if frames is None else len(frames),
            before.entry,
            before.keyed or after.keyed,
        )
        return Seam(SYSTEM, before, replace(after, entry=post), cut, gap, warnings, frames)

    def knows_rate(self, fps: float) -> bool:
        """Whether it takes frames at this rate."""
        return self.fps is None or abs(fps - self.fps) <= FPS_TOLERANCE * self.fps

    def output_fps(self, first: Clip) -> float:
        """The rate of a sentence: the first clip's, where it knows that, else its own."""
        return first.fps if self.knows_rate(first.fps) else float(self.fps or first.fps)

    def rate_warnings(self, clip: Clip) -> tuple[str, ...]:
        """A line about a clip that is brought to the rate that it knows."""
        if self.knows_rate(clip.fps):
            return ()
        return (f"{clip.name}: {clip.fps:g} fps, brought to the {self.fps:g} that {self.name} knows",)

    def place_reference(self, clip: Clip, to: Reference, is_first: bool) -> Reference:
        """What a clip is aligned to: ``to``, the first clip's place, by default."""
        return to

    def report_entry(self) -> dict[str, Any]:
        """The report's ``system``."""
        return {"name": self.name, "bundle": self.sha256, **self.facts}


def check_alone(system: WholeSystem, named: Sequence[str], fps: float | None) -> None:
    """Raise ``InputError`` where a call with a system has ``named`` options for what the system decides itself, or a
    rate that it does not know.
    """
    if not isinstance(system, WholeSystem):
        raise TypeError(f"system is a {type(system).__name__}, expected a name or what open_system(folder) gives")
    if named:
        some = ", ".join(f"SpliceOptions.{name}" for name in named)
        raise InputError(
            f"{system.name} runs whole: it chooses positions, number of frames and frames itself; leave out {some}"
        )
    if fps is not None and not system.knows_rate(fps):
        raise InputError(
            f"SpliceOptions.fps {fps:g}, but {system.name} knows only {system.fps:g}; leave out SpliceOptions.fps"
        )


def misses_message(misses: Sequence[str], n_seams: int) -> str:
    """The message about seams for which a system has no splice."""
    of = f"{len(misses)} of {n_seams} seams: " if n_seams > 1 else ""
    remedy = "SpliceOptions.fill_misses joins such words by the default methods, with a warning"
    return f"{of}{'; '.join(misses)}; {remedy}"
