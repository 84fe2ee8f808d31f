"""The paper's systems on clips: positions in, positions out, and back to rotations.

A system of the standard corpora reads any rig, on the standard signer's body (``JointPositionSplicer``). One that
learned from your own clips reads the positions of your rig's joints, as coordinates in a fixed cube (``NumberSpace``,
the bundle's ``space``): clips need joints of these names, in any unit; they may have more.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray
from signsplice.rig.align import ORIGIN, Placement, Reference, is_same_skeleton, placement
from signsplice.rig.info import rig_info
from signsplice.splicing.bundle import bundle_sha256
from signsplice.splicing.from_positions import clip_of_positions
from signsplice.splicing.lptransformer import JointPositionSplicer, SplicePrediction
from signsplice.splicing.seam import Seam
from signsplice.splicing.systems import WholeSystem
from signsplice.splicing.word import AlignedWord
from signsplice_paper.systems import open_bundle
from signsplice_paper.systems.splicers import PaperSystem
from signsplice_workshop.corpora.number_space import NumberSpace

NEAR_M, NEAR_DEG = 0.1, 10.0
"""Largest distance, m, and angle, degrees, to the first clip up to which a clip of the same rig is not moved: the
system learned from words where they were recorded.
"""
_FACTS = ("scale", "optimiser", "split", "seed", "corpus")


class ClipSplicer(JointPositionSplicer):
    """A trained system that splices words by itself, as in the paper (``SpliceOptions.system``)."""

    def __init__(self, system: PaperSystem, sha256: str | None = None) -> None:
        self.system, config = system, system.config
        self.name, self.fps, self.sha256 = system.name, config.fps, sha256
        self.summary = f"{system.name} of the paper, trained on {config.corpus} ({config.scale})"
        self.place = ORIGIN if config.space is not None and config.stored.get("moved", True) else None
        self.facts = {name: getattr(config, name) for name in _FACTS} | {"token_bias": system.token_bias}

    def predict_splice(self, before: FloatArray, after: FloatArray) -> SplicePrediction:
        """Returns the splice of two words' numbers (N, K) and (M, K)."""
        prediction, most_frames = self.system.predict(before, after), self.system.most_frames
        warning = f"{self.name} stopped after {most_frames} frames, the most that it makes: it gave no sign of an end"
        warnings = (warning,) if len(prediction.frames) == most_frames else ()
        return SplicePrediction(prediction.pre, prediction.post, prediction.frames, warnings)

    def splice_words(self, before: AlignedWord, after: AlignedWord) -> Seam:
        """Returns the seam at the positions that the system predicts, with its frames."""
        if self.system.config.space is None:
            return super().splice_words(before, after)
        space = self._scale_space(self.system.config.space, before.clip)
        spliced = self.predict_splice(self._read_numbers(space, before.clip), self._read_numbers(space, after.clip))
        new_clip = None
        if spliced.has_frames:
            kept_clips = before.clip[: (spliced.pre or 0) + 1], after.clip[spliced.post :]
            new_clip = clip_of_numbers(space, spliced.frames, *kept_clips)
        return self.filled_seam(before, after, spliced.pre, spliced.post, new_clip, spliced.warnings)

    def place_reference(self, clip: Clip, to: Reference, is_first: bool) -> Reference:
        """Returns the reference to which a clip is aligned: the place of all words that the system learned from. If
        there is none: the first clip's place, or the clip's own if its body and place are the same (``NEAR_M``,
        ``NEAR_DEG``).
        """
        if self.system.config.space is None or (is_first and self.place is None):
            return to
        if self.place is not None:
            return replace(to, placement=self.place)
        if is_same_skeleton(clip.skeleton, to.skeleton) and is_near(clip, to.placement):
            return replace(to, placement=placement(clip))
        return to

    def _scale_space(self, stored: NumberSpace, clip: Clip) -> NumberSpace:
        """Returns the system's joints and cube, in the clip's unit."""
        unit_cm = 100.0 * rig_info(clip.skeleton).sizes.unit.metres
        x, y, z = (value / unit_cm for value in stored.middle)
        return replace(stored, middle=(x, y, z), side=stored.side / unit_cm)

    def _read_numbers(self, space: NumberSpace, clip: Clip) -> FloatArray:
        """Returns the positions (T, 3 J) of a clip. Raises ``InputError`` if it lacks a joint."""
        try:
            return space.to_numbers(clip)
        except InputError as error:
            raise InputError(
                f"{error}; {self.name} knows only the rig of its own words: bring clips to it with `signsplice convert "
                "IN OUT --onto WORD.bvh`"
            ) from error


def is_near(clip: Clip, place: Placement) -> bool:
    """Returns whether a clip's signer stands at a place, within ``NEAR_M`` and ``NEAR_DEG``."""
    clip_place = placement(clip)
    metres = rig_info(clip.skeleton).sizes.unit.metres
    least_cosine = np.cos(np.deg2rad(NEAR_DEG))
    distance_m = metres * float(np.linalg.norm(clip_place.position - place.position))
    return (
        distance_m <= NEAR_M
        and clip_place.up @ place.up >= least_cosine
        and clip_place.forward @ place.forward >= least_cosine
    )


def clip_of_numbers(space: NumberSpace, frames: FloatArray, before: Clip, after: Clip) -> Clip:
    """Returns a clip on two clips' skeleton of the frames (n, 3 J) between them (``clip_of_positions``)."""
    return clip_of_positions(space.to_positions(frames), before, after, space.find_joints(before.skeleton, before.name))


def open_clip_splicer(folder: str | Path, decoding: str | None = None) -> WholeSystem:
    """Returns the trained system in a folder, for clips. Raises ``InputError`` for a folder without one."""
    system = open_bundle(folder, decoding)
    system.config.require("fps")
    return ClipSplicer(system, bundle_sha256(Path(folder)))
