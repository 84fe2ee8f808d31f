"""Pauses: a word that ends a phrase is held in its last posture, and the hands go on from there, not from rest.

A pause is the word's own time, slowed to a stand: ``with_pause`` holds the word, whatever comes after it, so that a
stream makes the same frames. The word is left at the end of its pause (``joins.signs``), and transitions begin there.
``HoldPauses`` then counts the frames of the pause as new ones: what is kept of a sign stays bit for bit what its clip
has, and readers of a report copy it as before.

People mark the end of a phrase by holding its last sign, and that sign takes longer (Liddell and Johnson 1989; Nespor
and Sandler 1999, Language and Speech 42: 143-176). A fifth of the sign's time is therefore added to the hold; to slow
the stroke itself would change frames that a signer made.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip, concatenate, sampled
from signsplice.rig.arms import arms, seen_from_trunk
from signsplice.rig.info import rig_info
from signsplice.splicing.gap import Cut, FilledGap
from signsplice.splicing.joins.held_letters import hand_joints, held_until
from signsplice.splicing.joins.join import PlannedSeam
from signsplice.splicing.methods.cut import Cutter, cut_clips
from signsplice.splicing.passes.seam_pass import SeamPass
from signsplice.splicing.words.word import FrameMap, HeldEnd, SentenceWord

PAUSES_S = {",": 0.2, ".": 0.5, "?": 0.5, "!": 0.5}
"""How long a word is held before its mark, beside ``LONGER``."""
LONGER = 0.2
"""How much longer the last sign of a phrase is, as a fraction of its time; it is held for that."""
_MOST_LONGER_S = 0.3
_BRAKE_S = 0.1
"""Time in which a hand that never stands still is brought to a stand, and set going again."""
_BACK_S = 0.4
"""How long after its last posture a word is left at most; cutters that rules make may leave it when the arms fall."""
_STILL_M_S = 0.15
_SLOW = 3.0
"""A hand turns at the end of its last stroke at no more than so many times its least speed around there."""
_LEVER_M = 0.1
"""Length by which rotations of fingers count as movement: a finger's."""
_SMOOTH_S = 0.04
_DRIFT = 0.05
"""Fraction of the way through a pause that is made evenly, so that no frame of it is the one before."""


def with_pause(word: SentenceWord, mark: str, cutter: Cutter, speed: float) -> SentenceWord:
    """A word held before a mark, one of ``PAUSES_S``, when signs play ``speed`` times as fast; the word itself where it
    has too few frames. Raises ``InputError`` for another mark.
    """
    if mark not in PAUSES_S:
        raise InputError(f"pause {mark!r} after {word.clip.name}, expected one of {' '.join(PAUSES_S)}")
    clip, fps = word.clip, word.clip.fps
    if len(clip) < 3:
        return word
    (cut,) = cut_clips(cutter, [clip, clip])
    kept, still = _last_posture(clip, held_until(clip, 0, speed) if word.is_letter else cut.pre, cut.post)
    sources = np.arange(len(word.retimed), dtype=np.float64) if word.frames.sources is None else word.frames.sources
    while kept > 0 and sources[word.frames.last(kept)] > len(clip) - 2:  # a tempo may go on to the last frame there
        kept -= 1
    first = word.frames.last(kept) + 1
    longer = min(LONGER * max(0, first - word.frames.first(cut.post)), fps * _MOST_LONGER_S / speed)
    n_frames = round(fps * PAUSES_S[mark] / speed + longer) + max(0, still.start - kept)
    leave = max(min(still.stop - 1, kept + n_frames), still.start, int(sources[first - 1]) + 1)
    n_more = min(round(fps * _BRAKE_S), len(clip) - 1 - leave)
    held = np.concatenate([
        _braking(float(sources[first - 1]), float(leave), n_frames),
        leave + n_more * np.linspace(0.0, 1.0, 2 * n_more + 1)[1:] ** 2,  # from a stand to the recorded speed
        sources[sources > leave + n_more],
    ])  # fmt: skip
    frames = FrameMap(np.concatenate([sources[:first], held]), word.frames.n_left_out)
    retimed = concatenate([word.retimed[:first], sampled(clip, held)], name=word.retimed.name)
    return replace(word, retimed=retimed, frames=frames, held=HeldEnd(mark, kept, leave))


def _braking(start: float, stop: float, n_frames: int) -> FloatArray:
    """Frames (n_frames,) of a clip from ``start`` to ``stop``, without the first: at the recorded speed first, if there
    is time, and ever more slowly.
    """
    u = np.arange(1, n_frames + 1) / n_frames
    eased = 1.0 - (1.0 - u) ** max(1.0, n_frames / (stop - start))
    return np.asarray(start + (stop - start) * ((1.0 - _DRIFT) * eased + _DRIFT * u))


def _last_posture(clip: Clip, left: int, entered: int) -> tuple[int, range]:
    """The last frame that is kept of a word as recorded before its last posture is held, and the frames in which it is
    in that posture. A cutter may leave a word a little before or after it, at frame ``left``.
    """
    left = min(left, len(clip) - 2)
    if not rig_info(clip.skeleton).has_arms:
        return left, range(left, left + 1)
    speeds = _speeds(clip)
    at = _slowest(speeds, left, max(entered, left - round(clip.fps * _BACK_S)))
    moves = np.flatnonzero(speeds >= _STILL_M_S)
    if speeds[at] >= _STILL_M_S:
        return max(at - round(clip.fps * _BRAKE_S), min(entered, at)), range(at, at + 1)
    start, stop = moves[moves < at].max(initial=-1) + 1, moves[moves > at].min(initial=len(clip))
    kept = min(left, at)
    return kept, range(max(int(start), kept), int(stop))


def _slowest(speeds: FloatArray, left: int, earliest: int) -> int:
    """The frame at which a hand stands, or turns, last of those from ``earliest`` to where it stops slowing down after
    frame ``left``: a turn before the last stroke may be slower.
    """
    end = left
    while end < len(speeds) - 2 and speeds[end + 1] < speeds[end]:
        end += 1
    frames = np.arange(min(earliest, end), end + 1)
    lows = frames[(speeds[frames] <= speeds[np.maximum(frames - 1, 0)]) & (speeds[frames] <= speeds[frames + 1])]
    slow = lows[speeds[lows] <= max(_STILL_M_S, _SLOW * speeds[frames].min())]
    return int(slow[-1] if len(slow) else frames[np.argmin(speeds[frames])])


def _speeds(clip: Clip) -> FloatArray:
    """How fast the faster hand moves in each frame (T,), seen from the trunk, or its fingers about it, m/s."""
    own = arms(clip)
    steps = np.linalg.norm(np.diff(seen_from_trunk(own)[0], axis=0), axis=-1).max(axis=1) * own.metres
    joints = hand_joints(clip, (0, 1))
    angles = rotation.angle_between(clip.local_rotations[1:, joints], clip.local_rotations[:-1, joints])
    speeds = np.maximum(steps, _LEVER_M * angles.max(axis=1, initial=0.0)) * clip.fps  # (T - 1,)
    between = np.append(speeds, speeds[-1]) + np.append(speeds[0], speeds)
    return np.asarray(gaussian_filter1d(0.5 * between, _SMOOTH_S * clip.fps, mode="nearest"))


@dataclass(frozen=True)
class HoldPauses(SeamPass):
    """The last pass: frames of a pause are new frames of the seam after it."""

    def concerns(self, seam: PlannedSeam) -> bool:
        """Whether the word before is held, with or without new frames after it."""
        return seam.before.held is not None

    def change(self, seam: PlannedSeam) -> PlannedSeam:
        """The seam with the pause before its new frames; the seam itself where its word is entered after the pause."""
        before, stop = seam.before_clip, seam.retimed_cut.pre + 1
        cut = Cut(last_kept(seam.before), seam.cut.post)
        seam = replace(seam, cut=cut)
        first = seam.retimed_cut.pre + 1
        if first >= stop:
            return seam
        held = before[first:stop]
        made = (
            FilledGap(held) if seam.filled is None else replace(seam.filled, clip=concatenate([held, seam.made.clip]))
        )
        return replace(seam.with_gap(len(made.clip)), filled=made, n_held=stop - first)


def last_kept(word: SentenceWord) -> int:
    """The recorded frame up to which a held word is kept before its pause: at least the one at which it is entered."""
    return word.entry if word.held is None else max(word.held.kept, word.entry)
