"""Pauses: a word that ends a phrase is held in its last posture, and the hands continue from there, not from rest.

A pause slows the word down until it stands still. ``with_pause`` holds the word independently of what follows, so that
a stream makes the same frames. The word is left at the end of its pause, and transitions begin there. ``HoldPauses``
then counts the frames of the pause as new frames: kept frames of a sign stay those of its clip, bit for bit, and
readers of a report copy them as before.

Signers mark the end of a phrase by holding its last sign, which takes longer (Liddell and Johnson 1989; Nespor and
Sandler 1999, Language and Speech 42: 143-176). A fifth of the sign's time is therefore added to the hold; slowing the
stroke itself would change recorded frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, concatenate, sample_clip
from signsplice.rig.info import rig_info
from signsplice.splicing.contracts import Cut, Cutter, cut_clips
from signsplice.splicing.letters import last_letter_hold_end
from signsplice.splicing.passes import Pass
from signsplice.splicing.seam import Seam
from signsplice.splicing.tempo import pace
from signsplice.splicing.word import AlignedWord, FrameMap, HeldEnd, cut_words

PAUSES_S = {",": 0.2, ".": 0.5, "?": 0.5, "!": 0.5}
"""Mark -> time that a word is held before it, s, without ``LONGER``."""
LONGER = 0.2
"""Additional hold of the last sign of a phrase, as a fraction of its time."""
_MOST_LONGER_S = 0.3
"""Longest additional hold, s."""
_BRAKE_S = 0.1
"""Time in which a hand that never stands still is stopped, and started again, s."""
_STILL = 0.2
"""Intensity (``tempo.pace``) below which hands and fingers stand still."""
_DRIFT = 0.05
"""Fraction of a pause's motion at constant speed, so that no two of its frames are equal."""


def with_pause(word: AlignedWord, mark: str, cutter: Cutter, speed: float) -> AlignedWord:
    """Holds a word before a mark, one of ``PAUSES_S``, at playback speed ``speed``; returns it unchanged if it has too
    few frames. Raises ``InputError`` for another mark.
    """
    if mark not in PAUSES_S:
        raise InputError(f"pause {mark!r} after {word.clip.name}, expected one of {' '.join(PAUSES_S)}")
    clip, fps = word.clip, word.clip.fps
    if len(clip) < 3:
        return word
    (cut,) = cut_clips(cutter, [clip, clip])
    last, posture = _last_posture(clip, last_letter_hold_end(clip, 0, speed) if word.is_letter else cut.pre, cut.post)
    sources = np.arange(len(word.retimed), dtype=np.float64) if word.frames.sources is None else word.frames.sources
    while last > 0 and sources[word.frames.last(last)] > len(clip) - 2:  # a tempo may go on to the last frame there
        last -= 1
    first = word.frames.last(last) + 1
    longer = min(LONGER * max(0, first - word.frames.first(cut.post)), fps * _MOST_LONGER_S / speed)
    n_frames = round(fps * PAUSES_S[mark] / speed + longer) + max(0, posture - last)
    leave = max(posture, int(sources[first - 1]) + 1)
    n_more = min(round(fps * _BRAKE_S), len(clip) - 1 - leave)
    held_sources = np.concatenate([
        _braking(float(sources[first - 1]), float(leave), n_frames),
        leave + n_more * np.linspace(0.0, 1.0, 2 * n_more + 1)[1:] ** 2,  # from a stand to the recorded speed
        sources[sources > leave + n_more],
    ])  # fmt: skip
    frames = FrameMap(np.concatenate([sources[:first], held_sources]), word.frames.n_left_out)
    retimed = concatenate([word.retimed[:first], sample_clip(clip, held_sources)], name=word.retimed.name)
    return replace(word, retimed=retimed, frames=frames, held=HeldEnd(mark, last, leave))


def _braking(start: float, stop: float, n_frames: int) -> FloatArray:
    """Returns frames (n_frames,) of a clip from ``start`` to ``stop``, without the first: at the recorded speed first,
    if there is time, then more and more slowly.
    """
    u = np.arange(1, n_frames + 1) / n_frames
    eased = 1.0 - (1.0 - u) ** max(1.0, n_frames / (stop - start))
    return np.asarray(start + (stop - start) * ((1.0 - _DRIFT) * eased + _DRIFT * u))


def _last_posture(clip: Clip, left: int, entered: int) -> tuple[int, int]:
    """Returns the last frame of a word that is kept as recorded, and the frame of its last posture, in which hands and
    fingers stand or are slowest, within ``_BRAKE_S`` of frame ``left``, at which a cutter leaves it. A word that does
    not stand there is slowed down before it.
    """
    left = min(left, len(clip) - 2)
    if not rig_info(clip.skeleton).has_arms:
        return left, left
    intensity, reach = pace(clip).intensity, round(clip.fps * _BRAKE_S)
    if intensity[left] < _STILL:
        return left, left
    first = max(min(entered, left), left - reach)
    slowest = first + int(np.argmin(intensity[first : min(left + reach, len(clip) - 2) + 1]))
    return (min(left, slowest) if intensity[slowest] < _STILL else max(first, slowest - reach)), slowest


@dataclass(frozen=True)
class HoldPauses(Pass):
    """The last pass: turns the frames of a pause into new frames of the seam after it."""

    def concerns(self, seam: Seam) -> bool:
        """Whether the word before is held, with or without new frames after it."""
        return seam.before.held is not None

    def change(self, seam: Seam) -> Seam:
        """Returns the seam with the pause before its new frames; unchanged if its word is entered after the pause."""
        before, stop = seam.before_clip, seam.retimed_cut.pre + 1
        cut = Cut(last_kept(seam.before), seam.cut.post)
        seam = replace(seam, cut=cut)
        first = seam.retimed_cut.pre + 1
        if first >= stop:
            return seam
        paused = before[first:stop]
        new = paused if seam.frames is None else concatenate([paused, seam.frames])
        return replace(seam.with_gap(len(new)), frames=new, n_held=stop - first)


def last_kept(word: AlignedWord) -> int:
    """Returns the recorded frame up to which a held word is kept before its pause, at least its entry frame."""
    return word.entry if word.held is None else max(word.held.kept, word.entry)


def last_left(word: AlignedWord, cutter: Cutter, speed: float) -> int:
    """Returns the last recorded frame of a sentence's last word that belongs to its sign, at least its entry frame: the
    one before its pause, or that at which ``cutter`` leaves the word for a copy of it, after the hold of a spelled
    word's last letter at playback speed ``speed``; the last of all if the cutter refuses the word.
    """
    if word.held is not None:
        return last_kept(word)
    try:
        (cut,) = cut_words(cutter, [word, word])
    except InputError:  # no arms are known, for example
        return len(word.clip) - 1
    hold_end = last_letter_hold_end(word.clip, word.entry, speed) if word.arrival_s else 0
    return max(cut.pre, hold_end, word.entry)
