"""The paper's systems as cutters and transitions of clips: positions in, positions out, and back to rotations.

The systems learned from the 53 joints of one skeleton at one frame rate, as coordinates in a fixed cube. A clip of any
other skeleton or rate is refused.
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
from signsplice.splicing.cut import Cut, PairCutter
from signsplice.splicing.gap import Gap
from signsplice.splicing.transition import GapTransition
from signsplice.synth.corpus import scaled_positions, unscaled_positions
from signsplice.synth.signer import JOINTS, stature


class ClipSplicer(PairCutter, GapTransition):
    """A trained system as a cutter, and as a transition if it sees only culled frames.

    ``splice`` runs the system as in the paper, which chooses the positions, the frames and their number.
    """

    learned = True

    def __init__(self, system: PaperSystem) -> None:
        self.system = system
        self.name = system.name
        self.summary = f"{system.name} of the paper, trained on {system.config.corpus} ({system.config.scale})"

    def cut(self, before: Clip, after: Clip) -> Cut:
        """The system's splice position. Raises ``InputError`` if it finds none."""
        p, q = self._numbers(before), self._numbers(after)
        if isinstance(self.system, TwoNetworkSystem):
            pre, post = self.system.positions(p, q)
        else:
            found = self.system.predict(p, q)
            pre, post = found.pre, found.post
        if pre is None or post is None:
            raise InputError(f"{self.name} finds no splice position for {before.name} and {after.name}; cut by a rule")
        return Cut(pre, post)

    def between(self, gap: Gap) -> Clip:
        """The new frames of a gap. The system chooses a number of frames itself, which are resampled to as many as are
        asked for.
        """
        before, after, n_frames = gap.before, gap.after, gap.n_frames
        if n_frames < 1:
            raise InputError(f"{n_frames} transition frames, expected at least 1")
        if not isinstance(self.system, TwoNetworkSystem) or self.system.fr is None:
            raise InputError(f"{self.name} makes frames only from two whole words; choose another transition")
        p, q = self._numbers(before), self._numbers(after)
        made = self.system.fill(p, q, len(p) - 1, 0)
        return self._clip(_resampled(p[-1], made, q[0], n_frames), before, after)

    def splice(self, before: Clip, after: Clip) -> Clip:
        """Y of eq. 17: frames of ``before``, the system's transition, and frames of ``after``."""
        found = self.system.predict(self._numbers(before), self._numbers(after))
        if found.pre is None or found.post is None:
            raise InputError(f"{self.name} finds no splice position for {before.name} and {after.name}; cut by a rule")
        kept, follows = before[: found.pre + 1], after[found.post :]
        if not len(found.frames):
            return concatenate([kept, follows])
        return concatenate([kept, self._clip(found.frames, kept, follows), follows])

    def _numbers(self, clip: Clip) -> Float:
        """Positions (T, 159) of a clip. Raises ``InputError`` for another skeleton or rate than the system's."""
        names = tuple(name.removeprefix("mixamorig:") for name in clip.skeleton.names)
        if names != tuple(JOINTS):
            raise InputError(
                f"{clip.name or 'clip'}: {len(names)} joints of another skeleton, but {self.name} knows only the "
                f"{len(JOINTS)} of the synthetic signer; choose a classical method"
            )
        fps = self.system.config.fps or clip.fps
        if abs(clip.fps - fps) > 1e-3 * fps:
            raise InputError(
                f"{clip.name or 'clip'}: {clip.fps:g} fps, but {self.name} knows only {fps:g}; use --fps {fps:g}"
            )
        return scaled_positions(clip, stature(clip.skeleton))

    def _clip(self, frames: Float, before: Clip, after: Clip) -> Clip:
        """The clip on the words' skeleton of frames (n, 159) between them."""
        positions = unscaled_positions(frames, stature(before.skeleton))  # (n, 53, 3)
        first, last = before.local_rotations[-1], after.local_rotations[0]
        local = kinematics.rotations_from_positions(before.skeleton, positions, first, last)
        return Clip(
            skeleton=before.skeleton,
            local_rotations=rotation.continuous(np.concatenate([first[None], local]))[1:],
            root_positions=positions[:, 0],
            fps=before.fps,
            channels=None if before.channels is None else before.channels.forgotten(len(frames)),
        )


def open_clip_splicer(folder: str | Path, decoding: str = "one-by-one") -> ClipSplicer:
    """The trained system in a folder, for clips. Raises ``InputError`` for a folder without one."""
    system = open_bundle(folder, decoding)
    system.config.require("fps")
    return ClipSplicer(system)


def _resampled(start: Float, frames: Float, end: Float, n_frames: int) -> Float:
    """Frames (n, 159) between two kept frames, resampled to (n_frames, 159) by linear interpolation in time."""
    trajectory = np.concatenate([start[None], frames.reshape(-1, N_NUMBERS), end[None]])  # (n + 2, 159)
    if len(trajectory) == n_frames + 2:
        return frames
    at = np.linspace(0.0, len(trajectory) - 1.0, n_frames + 2)[1:-1]
    low = np.minimum(at.astype(int), len(trajectory) - 2)
    alpha = (at - low)[:, None]
    return np.asarray((1.0 - alpha) * trajectory[low] + alpha * trajectory[low + 1])
