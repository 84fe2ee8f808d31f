"""The paper's systems on clips: positions in, positions out, and back to rotations.

A system learned from the positions of some joints at one frame rate, as coordinates in a fixed cube (``NumberSpace``).
A bundle says which in ``space``; one without it learned from the synthetic signer's 53 joints. Clips need joints of
these names, in any unit; they may have more. A clip at another rate is refused; ``ss.splice`` brings clips to the
system's.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, bone_translations, kinematics, rotation
from signsplice.rig.align import ORIGIN, Placement
from signsplice.rig.info import rig_info
from signsplice.signer.signer import JOINTS, STATURE_CM, skeleton
from signsplice.splicing.bundle import bundle_sha256
from signsplice.splicing.contracts import Cut, Cutter, Gap, Transition
from signsplice.splicing.seam import Seam
from signsplice.splicing.systems import WholeSystem, is_near
from signsplice.splicing.word import AlignedWord
from signsplice_paper.systems import open_bundle
from signsplice_paper.systems.from_positions import HandFit, rotations_from_positions
from signsplice_paper.systems.splicers import PaperSystem, TwoNetworkSystem
from signsplice_workshop.corpora.number_space import NumberSpace, space_of
from signsplice_workshop.corpora.pairs import EXTENT

_ANKLES = np.array([0.0, 7.0, -1.0])
"""Where the standard synthetic signer's ankles stand, cm; others scale it."""
_FACTS = ("scale", "optimiser", "split", "seed", "corpus")


class ClipSplicer(Cutter, Transition, WholeSystem):
    """A trained system that runs whole, as in the paper (``SpliceOptions.system``); also a cutter, and a transition if
    it sees only culled frames.
    """

    learned = True

    def __init__(self, system: PaperSystem, sha256: str | None = None) -> None:
        self.system, config = system, system.config
        self.name, self.fps, self.sha256 = system.name, config.fps, sha256
        self.summary = f"{system.name} of the paper, trained on {config.corpus} ({config.scale})"
        is_moved = config.space is not None and config.stored.get("moved", True)
        self.place = ORIGIN if is_moved else None
        self.facts = {name: getattr(config, name) for name in _FACTS} | {"token_bias": system.token_bias}

    def splice_words(self, before: AlignedWord, after: AlignedWord) -> Seam:
        """The seam at the system's positions, with its number of frames, and its frames."""
        found = self.system.predict(self._numbers(before.clip), self._numbers(after.clip))
        if found.pre is None or found.post is None or not len(found.frames):
            return self.filled_seam(before, after, found.pre, found.post)
        made = clip_of_numbers(
            self._space(before.clip), found.frames, before.clip[: found.pre + 1], after.clip[found.post :]
        )
        endless = len(made) == self.system.most_frames
        line = f"{self.name} stopped after {len(made)} frames, the most that it makes: it gave no sign of an end"
        return self.filled_seam(before, after, found.pre, found.post, made, (line,) if endless else ())

    def stands(self, first: Clip) -> Placement | None:
        """Where the synthetic signer stands, for a first clip that stands elsewhere or faces another way."""
        if self.system.config.space is not None:
            return None
        try:
            ankles = stature(first.skeleton) / STATURE_CM * _ANKLES
        except InputError:  # said where the words are read
            return None
        place = Placement(ankles, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
        return None if is_near(first, place) else place

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
        return clip_of_numbers(self._space(before), _resampled(p[-1], made, q[0], n_frames), before, after)

    def _space(self, clip: Clip) -> NumberSpace:
        """The system's joints and cube, in the clip's unit."""
        stored = self.system.config.space
        if stored is not None:
            unit_cm = 100.0 * rig_info(clip.skeleton).sizes.unit.metres
            x, y, z = (value / unit_cm for value in stored.middle)
            return replace(stored, middle=(x, y, z), side=stored.side / unit_cm)
        unscaled = space_of(skeleton(), (0.0, 0.0, 0.0), 1.0)
        unscaled.indices(clip.skeleton, clip.name)
        height = stature(clip.skeleton)
        return replace(unscaled, middle=(0.0, 0.5 * height, 0.0), side=EXTENT * height)

    def _numbers(self, clip: Clip) -> FloatArray:
        """Positions (T, 3 J) of a clip. Raises ``InputError`` where it lacks a joint, or runs at another rate."""
        fps = self.fps or clip.fps
        if abs(clip.fps - fps) > 1e-3 * fps:
            raise InputError(
                f"{clip.name or 'clip'}: {clip.fps:g} fps, but {self.name} knows only {fps:g}; use --fps {fps:g}"
            )
        try:
            return self._space(clip).numbers(clip)
        except InputError as error:
            raise InputError(
                f"{error}; {self.name} knows only the rig of its own words: bring clips to it with `signsplice convert "
                "IN OUT --onto WORD.bvh`"
            ) from error


def clip_of_numbers(space: NumberSpace, frames: FloatArray, before: Clip, after: Clip) -> Clip:
    """The clip on two clips' skeleton of frames (n, 3 J) between them: no bone changes its length, and hands are fitted
    to both clips. Joints of which the numbers know nothing follow from the frames on either side.
    """
    joints, positions = space.indices(before.skeleton, before.name), space.positions(frames)  # (n, J, 3)
    first, last = before.local_rotations[-1], after.local_rotations[0]
    local = rotations_from_positions(before.skeleton, positions, first, last, joints)
    local = HandFit([before, after], joints).apply(local, positions, first, last)
    alpha = (np.arange(1, len(frames) + 1) / (len(frames) + 1))[:, None]
    translations = None
    if before.translations is not None or after.translations is not None:
        bones = bone_translations(before)[-1], bone_translations(after)[0]
        translations = (1.0 - alpha[..., None]) * bones[0] + alpha[..., None] * bones[1]
    made = Clip(
        skeleton=before.skeleton,
        local_rotations=rotation.continuous(np.concatenate([first[None], local]))[1:],
        root_positions=(1.0 - alpha) * before.root_positions[-1] + alpha * after.root_positions[0],
        fps=before.fps,
        translations=translations,
        channels=None if before.channels is None else before.channels.forgotten(len(frames)),
    )
    if joints[0] == 0:
        return replace(made, root_positions=positions[:, 0])
    shift = positions[:, 0] - kinematics.forward(made, [joints[0]])[1][:, 0]
    return replace(made, root_positions=made.root_positions + shift)


def open_clip_splicer(folder: str | Path, decoding: str | None = None) -> ClipSplicer:
    """The trained system in a folder, for clips. Raises ``InputError`` for a folder without one."""
    system = open_bundle(folder, decoding)
    system.config.require("fps")
    return ClipSplicer(system, bundle_sha256(Path(folder)))


def _resampled(start: FloatArray, frames: FloatArray, end: FloatArray, n_frames: int) -> FloatArray:
    """Frames (n, 3 J) between two kept frames, resampled to (n_frames, 3 J) by linear interpolation in time."""
    trajectory = np.concatenate([start[None], frames.reshape(-1, len(start)), end[None]])  # (n + 2, 3 J)
    if len(trajectory) == n_frames + 2:
        return frames
    at = np.linspace(0.0, len(trajectory) - 1.0, n_frames + 2)[1:-1]
    low = np.minimum(at.astype(int), len(trajectory) - 2)
    alpha = (at - low)[:, None]
    return np.asarray((1.0 - alpha) * trajectory[low] + alpha * trajectory[low + 1])


def stature(bones: Skeleton) -> float:
    """Stature (cm) of the signer whose ``skeleton`` this is, from the legs, which scale with the stature alone; of any
    skeleton with a joint LeftLeg in its own unit. Raises ``InputError`` for one without.
    """
    shin = next((k for k, name in enumerate(bones.names) if name.rpartition(":")[2] == "LeftLeg"), None)
    if shin is None:
        raise InputError(
            f"skeleton: has no joint LeftLeg among {len(bones)}, expected one, as in the synthetic signer's"
        )
    standard = np.linalg.norm(skeleton().offsets[JOINTS["LeftLeg"]])
    return STATURE_CM * float(np.linalg.norm(bones.offsets[shin]) / standard)
