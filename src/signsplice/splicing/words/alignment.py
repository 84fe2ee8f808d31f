"""The first stage of a sentence: every clip becomes a word, aligned to the first one and free of stray frames."""

from __future__ import annotations

from dataclasses import dataclass

from signsplice.body.retarget import align
from signsplice.formats.limits import ReadLimits
from signsplice.lexicon.entry import is_letter
from signsplice.motion.clip import Clip, left_out_warnings
from signsplice.rig.align import Reference, reference
from signsplice.rig.stray_frames import stray_frames, with_ends_held
from signsplice.splicing.whole_system import WholeSystem, output_fps, placed_reference, rate_warnings
from signsplice.splicing.words.word import FrameMap, SentenceWord


@dataclass(frozen=True)
class WordAligner:
    """Makes words of clips.

    fps: the output rate; None: the first clip's, or the rate that the system knows.
    sign_speed: how many times as fast signs play.
    limits: how many frames a clip may have at the output rate.
    system: the system that splices the words whole; None where none does.
    """

    fps: float | None
    sign_speed: float
    limits: ReadLimits
    system: WholeSystem | None = None

    def word(self, clip: Clip, index: int, first: Reference | None) -> tuple[SentenceWord, Reference]:
        """The word of a clip, and what all words are aligned to: ``first``, or this clip where that is None.

        Raises ``LimitError`` for too many frames, ``RigMismatchError`` where rigs have nothing in common.
        """
        fps = first.fps if first else self._output_fps(clip)
        self.limits.check_resampling(clip, fps, self.sign_speed)
        stray, held = stray_frames(clip), with_ends_held(clip)
        to = first or reference(held, fps)
        if self.system is not None:
            to = placed_reference(self.system, held, to, is_first=first is None)
        aligned = align(held, to, self.sign_speed)
        kept = stray.resampled(clip.fps * self.sign_speed / fps, len(aligned.clip))
        recorded = aligned.clip if held is clip else aligned.clip[kept]
        warnings = (*left_out_warnings(clip), *aligned.warnings, *(f"{clip.name}: {line}" for line in stray.warnings))
        if self.system is not None:
            warnings = (*warnings, *rate_warnings(self.system, clip))
        frames = FrameMap(n_left_out=kept.start)
        spelled = is_letter(recorded.name)
        return SentenceWord(index, recorded, recorded, frames, warnings, aligned.contacts, spelled), first or to

    def _output_fps(self, clip: Clip) -> float:
        """The output rate of a sentence that begins with this clip."""
        return self.fps or (clip.fps if self.system is None else output_fps(self.system, clip))
