"""The paper's systems as cutters and transitions of clips: positions in, positions out, and back to rotations.

They learned from the 53 joints of one skeleton at one rate, as coordinates in a fixed cube, and serve clips of that
skeleton alone; a clip of any other is refused.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, concatenate
from signsplice.paper.prediction import N_NUMBERS, Float
from signsplice.paper.systems import open_bundle
from signsplice.paper.systems.splicers import PaperSystem, TwoNetworkSystem
from signsplice.splicing.cut import Cut
from signsplice.synth.corpus import from_numbers, to_numbers
from signsplice.synth.signer import JOINTS, stature


class ClipSplicer:
    """A trained system as a ``Cutter``, and, where it sees culled frames alone, as a ``Transition``.

    ``splice`` runs it whole, as in the paper: its own positions, its own frames, its own number of them.
    """

    learned = True

    def __init__(self, system: PaperSystem) -> None:
        self.system = system
        self.name = system.name
        self.summary = f"{system.name} of the paper, trained on {system.facts['corpus']} ({system.facts['scale']})"

    def cut(self, before: Clip, after: Clip) -> Cut:
        """Where the system leaves and enters. Raises ``InputError`` where it finds no position."""
        p, q = self._numbers(before), self._numbers(after)
        if isinstance(self.system, TwoNetworkSystem):
            pre, post = self.system.positions(p, q)
        else:
            found = self.system.predict(p, q)
            pre, post = found.pre, found.post
        if pre is None or post is None:
            raise InputError(f"{self.name} finds no splice position for {before.name} and {after.name}; cut by a rule")
        return Cut(pre, post)

    def between(self, before: Clip, after: Clip, n_frames: int) -> Clip:
        """``n_frames`` >= 1 new frames between two stretches that are kept; the system chooses a number itself, and
        what it makes is brought to ``n_frames`` by time.
        """
        if n_frames < 1:
            raise InputError(f"{n_frames} transition frames, expected at least 1")
        if not isinstance(self.system, TwoNetworkSystem) or self.system.fr is None:
            raise InputError(f"{self.name} makes frames of two whole words alone; choose another transition")
        p, q = self._numbers(before), self._numbers(after)
        made = self.system.fill(p, q, len(p) - 1, 0)
        return self._clip(_in_time(p[-1], made, q[0], n_frames), before, after)

    def splice(self, before: Clip, after: Clip) -> Clip:
        """Y of eq. 17: frames of ``before``, the system's transition, frames of ``after``."""
        found = self.system.predict(self._numbers(before), self._numbers(after))
        if found.pre is None or found.post is None:
            raise InputError(f"{self.name} finds no splice position for {before.name} and {after.name}; cut by a rule")
        kept, follows = before[: found.pre + 1], after[found.post :]
        if not len(found.frames):
            return concatenate([kept, follows])
        return concatenate([kept, self._clip(found.frames, kept, follows), follows])

    def _numbers(self, clip: Clip) -> Float:
        """Positions (T, 159) of a clip. Raises ``InputError`` for one that the system did not learn from."""
        names = tuple(name.removeprefix("mixamorig:") for name in clip.skeleton.names)
        if names != tuple(JOINTS):
            raise InputError(
                f"{clip.name or 'clip'}: {len(names)} joints of another skeleton, and {self.name} knows the "
                f"{len(JOINTS)} of the procedural signer alone; choose a classical method"
            )
        fps = self.system.facts["fps"]
        if abs(clip.fps - fps) > 1e-3 * fps:
            raise InputError(
                f"{clip.name or 'clip'}: {clip.fps:g} fps, and {self.name} knows {fps:g} alone; --fps {fps:g}"
            )
        return to_numbers(clip, stature(clip.skeleton))

    def _clip(self, frames: Float, before: Clip, after: Clip) -> Clip:
        """Rotations on the clips' own skeleton of frames (n, 159) that lie between them."""
        places = from_numbers(frames, stature(before.skeleton))
        first, last = before.local_rotations[-1], after.local_rotations[0]
        local = kinematics.rotations_from_positions(before.skeleton, places, first, last)
        return Clip(
            skeleton=before.skeleton,
            local_rotations=rotation.continuous(np.concatenate([first[None], local]))[1:],
            root_positions=places[:, 0],
            fps=before.fps,
            channels=None if before.channels is None else before.channels.forgotten(len(frames)),
        )


def open_clip_splicer(folder: str | Path, decoding: str = "one-by-one") -> ClipSplicer:
    """The trained system in a folder, for clips. Raises ``InputError`` for a folder that holds none."""
    system = open_bundle(folder, decoding)
    if "fps" not in system.facts:
        raise InputError(f"{Path(folder) / 'bundle.json'}: has no 'fps'; export the system anew")
    return ClipSplicer(system)


def _in_time(start: Float, frames: Float, end: Float, n_frames: int) -> Float:
    """Frames (n, 159) between two kept ones, taken at other moments of the same course (linear between frames)."""
    course = np.concatenate([start[None], frames.reshape(-1, N_NUMBERS), end[None]])
    if len(course) == n_frames + 2:
        return frames
    at = np.linspace(0.0, len(course) - 1.0, n_frames + 2)[1:-1]
    low = np.minimum(at.astype(int), len(course) - 2)
    share = (at - low)[:, None]
    return np.asarray((1.0 - share) * course[low] + share * course[low + 1])
