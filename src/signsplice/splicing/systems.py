"""Systems that splice two words whole, as the paper's do (eq. 17), in place of a cutter, a duration and a transition.

    Y = [P_1 .. P_pre, O, Q_post .. Q_M]: the system chooses pre, post and the number of frames O, and makes them

A system gives seams with their frames, each from its two words as they are. Where two seams of a word cross (it would
be left before the frame at which it is entered), or a system finds no position, there is no splice of that pair.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError, SignspliceError
from signsplice.motion import Clip
from signsplice.rig.align import Placement, Reference, is_same_skeleton, placement
from signsplice.rig.info import rig_info
from signsplice.splicing.contracts import Cut, Method, gap_at
from signsplice.splicing.seam import SYSTEM, Seam
from signsplice.splicing.word import AlignedWord

FPS_TOLERANCE = 1e-3
"""Rates that differ by a smaller fraction are one: frame times in files are rounded."""
NEAR_M, NEAR_DEG = 0.1, 10.0
"""A clip of the first one's rig that stands no farther from it, and faces no other way than this, is not moved: the
system learned from words where they were recorded.
"""


class NoSpliceError(SignspliceError):
    """A system has no splice of two words; the message says why."""


class WholeSystem(Method, ABC):
    """A system that chooses where two words are joined, and makes the frames between them.

    fps: the frame rate that it knows; None: any.
    sha256: of its bundle; None where it comes from no file.
    facts: what a report says of it, besides name and sha256.
    place: where every word stood that it learned from; None: where each was recorded.
    """

    fps: float | None = None
    sha256: str | None = None
    facts: Mapping[str, Any] = {}
    place: Placement | None = None

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

    def stands(self, first: Clip) -> Placement | None:
        """Where a sentence that begins with this clip is signed; None: where the clip stands."""
        return None

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
        """What a clip is aligned to: the place of all words that the system learned from; where there is none, the
        first clip's, or where a clip was recorded if that is the same body and place (``NEAR_M``, ``NEAR_DEG``).
        """
        if self.place is not None:
            return replace(to, placement=self.place)
        if is_first:
            place = self.stands(clip)
            return to if place is None else replace(to, placement=place)
        if is_same_skeleton(clip.skeleton, to.skeleton) and is_near(clip, to.placement):
            return replace(to, placement=placement(clip))
        return to

    def described(self) -> dict[str, Any]:
        """The report's ``system``."""
        return {"name": self.name, "bundle": self.sha256, **self.facts}


def check_alone(system: WholeSystem, named: Sequence[str], fps: float | None) -> None:
    """Raise ``InputError`` where a call with a system has ``named`` options for what the system decides itself, or a
    rate that it does not know.
    """
    if not isinstance(system, WholeSystem):
        raise TypeError(f"system is a {type(system).__name__}, expected what open_clip_splicer(folder) gives")
    if named:
        some = ", ".join(f"SpliceOptions.{name}" for name in named)
        raise InputError(
            f"{system.name} runs whole: it chooses positions, number of frames and frames itself; leave out {some}"
        )
    if fps is not None and not system.knows_rate(fps):
        raise InputError(
            f"SpliceOptions.fps {fps:g}, but {system.name} knows only {system.fps:g}; leave out SpliceOptions.fps"
        )


def is_near(clip: Clip, place: Placement) -> bool:
    """Whether a clip's signer stands at a place, nearly: ``NEAR_M``, ``NEAR_DEG``."""
    own = placement(clip)
    metres = rig_info(clip.skeleton).sizes.unit.metres
    least = np.cos(np.deg2rad(NEAR_DEG))
    away = metres * float(np.linalg.norm(own.position - place.position))
    return away <= NEAR_M and own.up @ place.up >= least and own.forward @ place.forward >= least


def misses_message(misses: Sequence[str], n_seams: int) -> str:
    """The message about seams for which a system has no splice."""
    of = f"{len(misses)} of {n_seams} seams: " if n_seams > 1 else ""
    remedy = "SpliceOptions.fill_misses joins such words by the default methods, with a warning"
    return f"{of}{'; '.join(misses)}; {remedy}"


GROUP = "signsplice.systems"
"""Entry points of other distributions, each a function that opens a folder: it returns a ``WholeSystem``, or raises
``InputError`` for a folder that is none of its systems.
"""


def open_system(folder: str | Path) -> WholeSystem:
    """The trained system in a folder. Raises ``InputError`` where no installed distribution opens it."""
    refusal = InputError(f"{folder}: a system that signsplice-paper opens: install it (pip install ./research)")
    for entry in entry_points(group=GROUP):
        try:
            system: WholeSystem = entry.load()(folder)
            return system
        except InputError as error:
            refusal = error
    raise refusal
