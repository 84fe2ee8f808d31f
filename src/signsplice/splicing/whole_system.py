"""Systems that splice two words whole, as the paper's do (eq. 17), in place of a cutter, a duration and a transition.

    Y = [P_1 .. P_pre, O, Q_post .. Q_M]: the system chooses pre, post and the number of frames O, and makes them

Each seam is made from its two words as they are. Where two seams of a word cross (it would be left before the frame at
which it is entered), or a system finds no position, there is no splice of that pair.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip
from signsplice.rig.align import Placement, Reference, is_same_skeleton, placement
from signsplice.rig.info import rig_info
from signsplice.splicing.methods import Method

FPS_TOLERANCE = 1e-3
"""Rates that differ by a smaller fraction are one: frame times in files are rounded."""
NEAR_M, NEAR_DEG = 0.1, 10.0
"""A clip of the first one's rig that stands no farther from it, and faces no other way than this, is not moved: the
system learned from words where they were recorded.
"""


@dataclass(frozen=True, eq=False)
class SystemSplice:
    """What a system makes of two words.

    pre, post: last frame kept of the one, first frame kept of the other; None where the system found none.
    frames: the frames between, on the words' skeleton; None where there are none.
    warnings: what a user should know, one line each.
    """

    pre: int | None
    post: int | None
    frames: Clip | None = None
    warnings: tuple[str, ...] = ()


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
    def splice_words(self, before: Clip, after: Clip) -> SystemSplice:
        """The splice of two words at the system's rate, on one skeleton, from all of their frames."""

    def stands(self, first: Clip) -> Placement | None:
        """Where a sentence that begins with this clip is signed; None: where the clip stands."""
        return None

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
    if fps is not None and not knows_rate(system, fps):
        raise InputError(
            f"SpliceOptions.fps {fps:g}, but {system.name} knows only {system.fps:g}; leave out SpliceOptions.fps"
        )


def knows_rate(system: WholeSystem, fps: float) -> bool:
    """Whether a system takes frames at this rate."""
    return system.fps is None or abs(fps - system.fps) <= FPS_TOLERANCE * system.fps


def output_fps(system: WholeSystem, first: Clip) -> float:
    """The rate of a sentence: the first clip's, where the system knows it, else the system's."""
    return first.fps if knows_rate(system, first.fps) else float(system.fps or first.fps)


def rate_warnings(system: WholeSystem, clip: Clip) -> tuple[str, ...]:
    """A line about a clip that is brought to the rate that the system knows."""
    if knows_rate(system, clip.fps):
        return ()
    return (f"{clip.name}: {clip.fps:g} fps, brought to the {system.fps:g} that {system.name} knows",)


def placed_reference(system: WholeSystem, clip: Clip, to: Reference, is_first: bool) -> Reference:
    """What a clip is aligned to: the place of all words that the system learned from; where there is none, the first
    clip's, or where a clip was recorded if that is the same body and place (``NEAR_M``, ``NEAR_DEG``).
    """
    if system.place is not None:
        return replace(to, placement=system.place)
    if is_first:
        place = system.stands(clip)
        return to if place is None else replace(to, placement=place)
    if is_same_skeleton(clip.skeleton, to.skeleton) and is_near(clip, to.placement):
        return replace(to, placement=placement(clip))
    return to


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
