"""The idle hand: one that only goes to rest at a seam, or only comes from it, while the other hand signs.

With the rest of the body it has the time of the transition, and may have to fall from the face to the hip in it. Two
things give it more.

**transition**, the default: where it would pass ``FASTEST_M_S``, the transition is lengthened for the whole body.
**natural**: it goes to rest over the first frames of the next sign, or leaves rest in the last frames of the sign
before, as long as it rests there. Its arm follows one curve over the transition and those frames (``quintic``: minimum
jerk between the velocities of both ends), is led around the body and the other hand, and is as slow as the hands of
people are. All other joints keep the frames of the sign.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import Clip, concatenate, joined, kinematics
from signsplice.rig.info import rig_info
from signsplice.splicing.gap import Cut, FilledGap, Gap, gap_at
from signsplice.splicing.joins.join import PlannedSeam
from signsplice.splicing.methods.duration import most_frames
from signsplice.splicing.methods.transition import find_transition
from signsplice.splicing.passes.collision_avoidance import TOLERANCE_M, avoid_collisions, depths, turn_elbow
from signsplice.splicing.passes.filling import Refill
from signsplice.splicing.passes.idle_hand import IdleHand, arm_joints, idle_hands, is_approached
from signsplice.splicing.passes.seam_pass import GapPass, SeamPass
from signsplice.splicing.words.word import edit_of, edited

TRANSITION, NATURAL = FREE_HANDS = ("transition", "natural")
"""What the idle hand's time may be."""
FASTEST_M_S = 2.2
"""A hand that only goes to rest, or comes from it, is not faster than this."""
_UNHURRIED_M_S = 1.4
"""Nor, under ``natural``, than 9 of 10 hands that people let sink in running signing (15 movements of 0.15 to 0.4 m in
16 sentences of the DGS Corpus: median 0.8 m/s, 1.8 at most).
"""
_ROUNDS = 8


@dataclass(frozen=True)
class WristSpeeds(GapPass):
    """Measures how fast wrists are in new frames, for ``FreeHands``; on rigs whose arms are known."""

    def change_all(self, gaps: Sequence[Gap], filled: Sequence[FilledGap]) -> list[FilledGap]:
        """The same frames with the highest speed of their wrists."""
        return with_peaks(filled, gaps)


@dataclass(frozen=True)
class FreeHands(SeamPass):
    """Idle hands get the time that they need.

    refill: makes the frames of a gap that is lengthened, or whose words were edited.
    natural: they take frames of the signs.
    lengthens: the transition is lengthened where they would be too fast.
    avoids: their arms are led around the body in frames of the signs.
    """

    refill: Refill
    natural: bool
    lengthens: bool
    avoids: bool

    def change(self, seam: PlannedSeam) -> PlannedSeam:
        """The seam with slower idle hands; the seam itself where they are slow enough."""
        seam = self.refill.fresh(seam)
        least = _UNHURRIED_M_S if self.natural else FASTEST_M_S
        if not _is_faster(seam, least):
            return seam
        hands, longest = (
            idle_hands(seam.before_clip, seam.after_clip, seam.retimed_cut),
            most_frames(seam.gap.before.fps),
        )
        done = seam
        for _ in range(_ROUNDS if hands else 0):
            done = seam
            for hand in hands if self.natural else ():
                done = _let_free(done, hand, self.avoids)
            peak = max(_peak_with_rest(done, hand) for hand in hands)
            n_frames = seam.gap.n_frames
            if not self.lengthens or peak <= FASTEST_M_S or n_frames >= longest:
                break
            wanted = math.ceil((n_frames + 1) * peak / FASTEST_M_S) - 1
            seam = self.refill.again(seam, min(max(wanted, n_frames + 1), longest))
        return done


def _let_free(seam: PlannedSeam, hand: IdleHand, avoids: bool) -> PlannedSeam:
    """The seam with one idle hand given as many frames of the sign as it needs, where it has them."""
    n_frames = seam.gap.n_frames
    peak = least = _peak(_window(seam.gap, seam.made.clip), hand.side)
    most = _frames_free(seam, hand)
    best: _ArmPath | None = None
    n_more = 0
    while peak > _UNHURRIED_M_S and n_more < most:
        wanted = math.ceil((n_frames + n_more + 1) * peak / _UNHURRIED_M_S) - 1 - n_frames
        n_more = min(max(wanted, n_more + 1), most)
        path = _arm_path(seam, hand, n_more, avoids)
        peak = path.peak
        # A way around the body may be longer, and faster, than the transition's own.
        if peak < least and path.depth <= max(TOLERANCE_M, seam.made.depth or 0.0):
            best, least = path, peak
    return seam if best is None else _put_in(seam, hand, best)


def _frames_free(seam: PlannedSeam, hand: IdleHand) -> int:
    """Frames of the sign that an idle hand may take: it rests there, up to a frame that it keeps, and the other hand
    does not come near its arm.
    """
    cut, most = seam.retimed_cut, hand.n_rest - 1
    if hand.arrives:
        rest = seam.after_clip[cut.post : cut.post + most] if most > 0 else None
    else:
        most = min(most, cut.pre - seam.before.first_frame)
        rest = seam.before_clip[cut.pre + 1 - most : cut.pre + 1] if most > 0 else None
    if rest is None:
        return 0
    touched = is_approached(rest, hand.side)
    return _first(touched if hand.arrives else touched[::-1])


def _first(flags: NDArray[np.bool_]) -> int:
    """Number of flags before the first that is set."""
    return int(np.argmax(flags)) if flags.any() else len(flags)


@dataclass(frozen=True, eq=False)
class _ArmPath:
    """An idle arm's new frames, among those of the other joints.

    clip: the transition and the ``n_more`` frames of the sign.
    peak: the wrist's highest speed, m/s.
    depth: how deep the hand lies in the body or in the other hand, beyond what both ends call for, m.
    """

    clip: Clip
    n_more: int
    peak: float
    depth: float


def _arm_path(seam: PlannedSeam, hand: IdleHand, n_more: int, avoids: bool) -> _ArmPath:
    """The idle arm on one curve over the transition and ``n_more`` frames of the sign."""
    cut, entry, before, after = seam.retimed_cut, seam.before.first_frame, seam.before_clip, seam.after_clip
    post, stop = cut.post, cut.pre + 1
    if hand.arrives:
        frames = concatenate([seam.made.clip, after[post : post + n_more]])
        gap = gap_at(before, after, Cut(cut.pre, post + n_more), len(frames), entry)
    else:
        frames = concatenate([before[stop - n_more : stop], seam.made.clip])
        gap = gap_at(before, after, Cut(cut.pre - n_more, post), len(frames), entry)
    curve = find_transition("quintic").between(gap)
    new = edited(frames, [edit_of(frames, curve, 0, arm_joints(frames, hand.side))])
    depth = 0.0
    if avoids:
        cleared = avoid_collisions(new, gap.before, gap.after, fixed=1 - hand.side)
        depth = cleared.depth or 0.0
        new = turn_elbow(cleared.clip, gap.before, gap.after, hand.side)
    return _ArmPath(new, n_more, _peak(_window(gap, new), hand.side), depth)


def _put_in(seam: PlannedSeam, hand: IdleHand, path: _ArmPath) -> PlannedSeam:
    """The seam with an arm's new frames in the transition, and as an edit in the sign."""
    cut, n_frames, n_more = seam.retimed_cut, seam.gap.n_frames, path.n_more
    joints = arm_joints(path.clip, hand.side)
    if hand.arrives:
        new = path.clip[:n_frames]
        edit = edit_of(seam.after_clip, path.clip[n_frames:], cut.post, joints)
        seam = replace(seam, entering=(*seam.entering, edit))
    else:
        new = path.clip[n_more:]
        edit = edit_of(seam.before_clip, path.clip[:n_more], cut.pre + 1 - n_more, joints)
        seam = replace(seam, leaving=(*seam.leaving, edit))
    seam = seam.with_gap(n_frames)
    depth = None if seam.made.depth is None else float(depths(new, seam.gap.before, seam.gap.after).max())
    return replace(seam, filled=replace(seam.made, clip=new, depth=depth, peak_m_s=None))


def _window(gap: Gap, new: Clip) -> Clip:
    """New frames with those on either side."""
    return concatenate([gap.before[-1:], new, gap.after[:1]])


def _is_faster(seam: PlannedSeam, speed: float) -> bool:
    """Whether a hand of known arms passes a speed in the transition, m/s."""
    filled = seam.made
    if filled.peak_m_s is None:
        (filled,) = with_peaks([filled], [seam.gap])
    return filled.peak_m_s is not None and filled.peak_m_s > speed


def with_peaks(filled: Sequence[FilledGap], gaps: Sequence[Gap]) -> list[FilledGap]:
    """The new frames of gaps with the highest speed of their wrists; without it on rigs whose arms are not known."""
    out = list(filled)
    known = [row for row, gap in enumerate(gaps) if rig_info(gap.before.skeleton).has_arms]
    for block in joined([(gaps[row].before[-1:], out[row].clip, gaps[row].after[:1]) for row in known]):
        info = rig_info(block.clip.skeleton)
        _, positions = kinematics.forward(block.clip, [info.arm_joints[2], info.arm_joints[5]])
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=-1).max(axis=1)
        for k, frames in block:
            peak = float(steps[frames.start : frames.stop - 1].max(initial=0.0))
            out[known[k]] = replace(out[known[k]], peak_m_s=peak * block.clip.fps * info.sizes.unit.metres)
    return out


def _peak_with_rest(seam: PlannedSeam, hand: IdleHand) -> float:
    """Highest speed of an idle hand in the transition and while it rests, m/s."""
    cut, before, after = seam.retimed_cut, seam.before_clip, seam.after_clip
    start, stop = cut.pre, cut.post + 1
    if hand.arrives:
        stop = cut.post + hand.n_rest
    else:
        start = max(seam.before.first_frame, cut.pre + 1 - hand.n_rest)
    parts = [before[start : cut.pre + 1], seam.made.clip, after[cut.post : stop]]
    return _peak(concatenate(parts), hand.side)


def _peak(clip: Clip, side: int) -> float:
    """Highest speed of a wrist, m/s."""
    info = rig_info(clip.skeleton)
    _, positions = kinematics.forward(clip, [info.arm_joints[3 * side + 2]])
    steps = np.linalg.norm(np.diff(positions[:, 0], axis=0), axis=-1)
    return float(steps.max(initial=0.0)) * clip.fps * info.sizes.unit.metres
