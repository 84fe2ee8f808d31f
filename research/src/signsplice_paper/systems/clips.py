"""The paper's systems on clips: positions in, positions out, and back to rotations.

A system of the standard corpora reads any rig, on the standard signer's body (``PositionSplicer``). One that learned
from your own clips reads the positions of your rig's joints, as coordinates in a fixed cube (``NumberSpace``, the
bundle's ``space``): clips need joints of these names, in any unit; they may have more.
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
from signsplice.splicing.lptransformer import PositionSplicer, SplicePrediction
from signsplice.splicing.seam import Seam
from signsplice.splicing.systems import WholeSystem
from signsplice.splicing.word import AlignedWord
from signsplice_paper.systems import open_bundle
from signsplice_paper.systems.splicers import PaperSystem
from signsplice_workshop.corpora.number_space import NumberSpace

NEAR_M, NEAR_DEG = 0.1, 10.0
"""A clip of the first one's rig that stands no farther from it, and faces no other way than this, is not moved: the
system learned from words where they were recorded.
"""
_FACTS = ("scale", "optimiser", "split", "seed", "corpus")


class ClipSplicer(PositionSplicer):
    """A trained system that runs whole, as in the paper (``SpliceOptions.system``)."""

    def __init__(self, system: PaperSystem, sha256: str | None = None) -> None:
        self.system, config = system, system.config
        self.name, self.fps, self.sha256 = system.name, config.fps, sha256
        self.summary = f"{system.name} of the paper, trained on {config.corpus} ({config.scale})"
        self.place = ORIGIN if config.space is not None and config.stored.get("moved", True) else None
        self.facts = {name: getattr(config, name) for name in _FACTS} | {"token_bias": system.token_bias}

    def predict_splice(self, before: FloatArray, after: FloatArray) -> SplicePrediction:
        """The splice of two words' numbers (N, K) and (M, K)."""
        predicted, most = self.system.predict(before, after), self.system.most_frames
        line = f"{self.name} stopped after {most} frames, the most that it makes: it gave no sign of an end"
        warnings = (line,) if len(predicted.frames) == most else ()
        return SplicePrediction(predicted.pre, predicted.post, predicted.frames, warnings)

    def splice_words(self, before: AlignedWord, after: AlignedWord) -> Seam:
        """The seam at the system's positions, with its number of frames, and its frames."""
        if self.system.config.space is None:
            return super().splice_words(before, after)
        space = self._space(self.system.config.space, before.clip)
        spliced = self.predict_splice(self._numbers(space, before.clip), self._numbers(space, after.clip))
        made = None
        if spliced.has_frames:
            kept = before.clip[: (spliced.pre or 0) + 1], after.clip[spliced.post :]
            made = clip_of_numbers(space, spliced.frames, *kept)
        return self.filled_seam(before, after, spliced.pre, spliced.post, made, spliced.warnings)

    def place_reference(self, clip: Clip, to: Reference, is_first: bool) -> Reference:
        """What a clip is aligned to: the place of all words that the system learned from; where there is none, the
        first clip's, or where a clip was recorded if that is the same body and place (``NEAR_M``, ``NEAR_DEG``).
        """
        if self.system.config.space is None or (is_first and self.place is None):
            return to
        if self.place is not None:
            return replace(to, placement=self.place)
        if is_same_skeleton(clip.skeleton, to.skeleton) and is_near(clip, to.placement):
            return replace(to, placement=placement(clip))
        return to

    def _space(self, stored: NumberSpace, clip: Clip) -> NumberSpace:
        """The system's joints and cube, in the clip's unit."""
        unit_cm = 100.0 * rig_info(clip.skeleton).sizes.unit.metres
        x, y, z = (value / unit_cm for value in stored.middle)
        return replace(stored, middle=(x, y, z), side=stored.side / unit_cm)

    def _numbers(self, space: NumberSpace, clip: Clip) -> FloatArray:
        """Positions (T, 3 J) of a clip. Raises ``InputError`` where it lacks a joint."""
        try:
            return space.numbers(clip)
        except InputError as error:
            raise InputError(
                f"{error}; {self.name} knows only the rig of its own words: bring clips to it with `signsplice convert "
                "IN OUT --onto WORD.bvh`"
            ) from error


def is_near(clip: Clip, place: Placement) -> bool:
    """Whether a clip's signer stands at a place, nearly: ``NEAR_M``, ``NEAR_DEG``."""
    own = placement(clip)
    metres = rig_info(clip.skeleton).sizes.unit.metres
    least = np.cos(np.deg2rad(NEAR_DEG))
    away = metres * float(np.linalg.norm(own.position - place.position))
    return away <= NEAR_M and own.up @ place.up >= least and own.forward @ place.forward >= least


def clip_of_numbers(space: NumberSpace, frames: FloatArray, before: Clip, after: Clip) -> Clip:
    """The clip on two clips' skeleton of frames (n, 3 J) between them (``clip_of_positions``)."""
    return clip_of_positions(space.positions(frames), before, after, space.indices(before.skeleton, before.name))


def open_clip_splicer(folder: str | Path, decoding: str | None = None) -> WholeSystem:
    """The trained system in a folder, for clips. Raises ``InputError`` for a folder without one."""
    system = open_bundle(folder, decoding)
    system.config.require("fps")
    return ClipSplicer(system, bundle_sha256(Path(folder)))
