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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import kinematics
from signsplice.motion.clip import Clip, bone_translations, concatenate, unchecked_copy
from signsplice.motion.joined import joined
from signsplice.rig.info import rig_info
from signsplice.splicing.gap import Gap, gap_at
from signsplice.splicing.methods.cut import Cut
from signsplice.splicing.methods.transition import find_transition
from signsplice.splicing.passes.collision_avoidance import TOLERANCE_M, avoid_collisions, depths, turn_elbow
from signsplice.splicing.passes.filling import FilledGap
from signsplice.splicing.passes.idle_hand import IdleHand, arm_joints, idle_hands, is_approached

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
class Remade:
    """Joints of a sign's span that do not show its clip: an idle arm that was given more time, the fingers of a spelled
    letter that are on their way, the arm of one that slides.

    joints: their names.
    frames: of the output, half-open; outside them these joints too are the clip's.
    """

    joints: tuple[str, ...]
    frames: tuple[int, int]


@dataclass(frozen=True)
class ArmStretch:
    """Frames of a word in which an arm, or a finger, was made anew.

    joints: of the arm or the finger.
    start, stop: frames of the word's clip, half-open.
    """

    joints: tuple[int, ...]
    start: int
    stop: int


@dataclass(frozen=True)
class Rules:
    """What may be done for idle hands.

    natural: they take frames of the signs.
    lengthens: the transition is lengthened where they would be too fast, up to ``longest`` frames.
    avoids: they are led around the body.
    """

    natural: bool
    lengthens: bool
    avoids: bool
    longest: int


@dataclass(frozen=True, eq=False)
class SeamFrames:
    """A seam with all its frames.

    before, after: both words' clips as they are put out.
    cut: where the one is left and the other entered.
    entry: the frame at which the word before was entered.
    gap, filled: the gap between them, and its new frames.
    remade: what was made anew in the word before, and in the word after.
    """

    before: Clip
    after: Clip
    cut: Cut
    entry: int
    gap: Gap
    filled: FilledGap
    remade: tuple[tuple[ArmStretch, ...], tuple[ArmStretch, ...]] = ((), ())

    def refilled(self, n_frames: int, refill: Callable[[Gap], FilledGap]) -> SeamFrames:
        """The seam with a transition of ``n_frames``."""
        gap = gap_at(self.before, self.after, self.cut, n_frames, self.entry)
        return replace(self, gap=gap, filled=refill(gap))


def finish(seam: SeamFrames, rules: Rules, refill: Callable[[Gap], FilledGap]) -> SeamFrames:
    """The seam with the time that its idle hands need; itself where they have it. ``refill`` makes the new frames of
    another gap.
    """
    done, least = seam, _UNHURRIED_M_S if rules.natural else FASTEST_M_S
    if not (rules.natural or rules.lengthens) or not _is_faster(seam, least):
        return seam
    hands = idle_hands(seam.before, seam.after, seam.cut)
    for _ in range(_ROUNDS if hands else 0):
        done = seam
        for hand in hands if rules.natural else ():
            done = _let_free(done, hand, rules.avoids)
        peak = max(_peak_with_rest(done, hand) for hand in hands)
        n_frames = seam.gap.n_frames
        if not rules.lengthens or peak <= FASTEST_M_S or n_frames >= rules.longest:
            break
        wanted = math.ceil((n_frames + 1) * peak / FASTEST_M_S) - 1
        seam = seam.refilled(min(max(wanted, n_frames + 1), rules.longest), refill)
    return done


def _let_free(seam: SeamFrames, hand: IdleHand, avoids: bool) -> SeamFrames:
    """The seam with one idle hand given as many frames of the sign as it needs, where it has them."""
    n_frames = seam.gap.n_frames
    peak = least = _peak(_window(seam.gap, seam.filled.clip), hand.side)
    most = _frames_free(seam, hand)
    best: _RemadeArm | None = None
    n_more = 0
    while peak > _UNHURRIED_M_S and n_more < most:
        wanted = math.ceil((n_frames + n_more + 1) * peak / _UNHURRIED_M_S) - 1 - n_frames
        n_more = min(max(wanted, n_more + 1), most)
        made = _remake(seam, hand, n_more, avoids)
        peak = made.peak
        # A way around the body may be longer, and faster, than the transition's own.
        if peak < least and made.depth <= max(TOLERANCE_M, seam.filled.depth or 0.0):
            best, least = made, peak
    return seam if best is None else _put_in(seam, hand, best)


def _frames_free(seam: SeamFrames, hand: IdleHand) -> int:
    """Frames of the sign that an idle hand may take: it rests there, up to a frame that it keeps, and the other hand
    does not come near its arm.
    """
    cut, most = seam.cut, hand.n_rest - 1
    if hand.arrives:
        rest = seam.after[cut.post : cut.post + most] if most > 0 else None
    else:
        most = min(most, cut.pre - seam.entry)
        rest = seam.before[cut.pre + 1 - most : cut.pre + 1] if most > 0 else None
    if rest is None:
        return 0
    touched = is_approached(rest, hand.side)
    return _first(touched if hand.arrives else touched[::-1])


def _first(flags: NDArray[np.bool_]) -> int:
    """Number of flags before the first that is set."""
    return int(np.argmax(flags)) if flags.any() else len(flags)


@dataclass(frozen=True, eq=False)
class _RemadeArm:
    """An idle arm's new frames, among those of the other joints.

    clip: the transition and the ``n_more`` frames of the sign.
    peak: the wrist's highest speed, m/s.
    depth: how deep the hand lies in the body or in the other hand, beyond what both ends call for, m.
    """

    clip: Clip
    n_more: int
    peak: float
    depth: float


def _remake(seam: SeamFrames, hand: IdleHand, n_more: int, avoids: bool) -> _RemadeArm:
    """The idle arm on one curve over the transition and ``n_more`` frames of the sign."""
    cut, entry = seam.cut, seam.entry
    post, stop = cut.post, cut.pre + 1
    if hand.arrives:
        frames = concatenate([seam.filled.clip, seam.after[post : post + n_more]])
        gap = gap_at(seam.before, seam.after, Cut(cut.pre, post + n_more), len(frames), entry)
    else:
        frames = concatenate([seam.before[stop - n_more : stop], seam.filled.clip])
        gap = gap_at(seam.before, seam.after, Cut(cut.pre - n_more, post), len(frames), entry)
    made = _with_joints(frames, find_transition("quintic").between(gap), 0, arm_joints(frames, hand.side))
    depth = 0.0
    if avoids:
        cleared = avoid_collisions(made, gap.before, gap.after, fixed=1 - hand.side)
        depth = cleared.depth or 0.0
        made = turn_elbow(cleared.clip, gap.before, gap.after, hand.side)
    return _RemadeArm(made, n_more, _peak(_window(gap, made), hand.side), depth)


def _put_in(seam: SeamFrames, hand: IdleHand, made: _RemadeArm) -> SeamFrames:
    """The seam with an arm's new frames in the transition and in the sign."""
    cut, n_frames, n_more = seam.cut, seam.gap.n_frames, made.n_more
    before, after, (leaving, entering) = seam.before, seam.after, seam.remade
    joints = arm_joints(made.clip, hand.side)
    if hand.arrives:
        new = made.clip[:n_frames]
        after = _with_joints(after, made.clip[n_frames:], cut.post, joints)
        entering = (*entering, ArmStretch(joints, cut.post, cut.post + n_more))
    else:
        new, start = made.clip[n_more:], cut.pre + 1 - n_more
        before = _with_joints(before, made.clip[:n_more], start, joints)
        leaving = (*leaving, ArmStretch(joints, start, cut.pre + 1))
    gap = gap_at(before, after, cut, n_frames, seam.entry)
    depth = None if seam.filled.depth is None else float(depths(new, gap.before, gap.after).max())
    filled = replace(seam.filled, clip=new, depth=depth, peak_m_s=None)
    return replace(seam, before=before, after=after, gap=gap, filled=filled, remade=(leaving, entering))


def _with_joints(clip: Clip, new: Clip, start: int, joints: tuple[int, ...]) -> Clip:
    """The clip with some joints as in ``new``, whose frames begin at frame ``start``."""
    rows, columns = np.ix_(np.arange(start, start + len(new)), np.array(joints))
    local = np.array(clip.local_rotations)
    local[rows, columns] = new.local_rotations[:, joints]
    bones = None
    if clip.translations is not None or new.translations is not None:
        bones = np.array(bone_translations(clip))
        bones[rows, columns] = bone_translations(new)[:, joints]
    return unchecked_copy(clip, local_rotations=local, translations=bones)


def _window(gap: Gap, new: Clip) -> Clip:
    """New frames with those on either side."""
    return concatenate([gap.before[-1:], new, gap.after[:1]])


def _is_faster(seam: SeamFrames, speed: float) -> bool:
    """Whether a hand of known arms passes a speed in the transition, m/s."""
    (filled,) = [seam.filled] if seam.filled.peak_m_s is not None else with_peaks([seam.filled], [seam.gap])
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


def _peak_with_rest(seam: SeamFrames, hand: IdleHand) -> float:
    """Highest speed of an idle hand in the transition and while it rests, m/s."""
    cut, parts = seam.cut, [seam.filled.clip]
    if hand.arrives:
        parts = [seam.before[cut.pre : cut.pre + 1], *parts, seam.after[cut.post : cut.post + hand.n_rest]]
    else:
        start = max(seam.entry, cut.pre + 1 - hand.n_rest)
        parts = [seam.before[start : cut.pre + 1], *parts, seam.after[cut.post : cut.post + 1]]
    return _peak(concatenate(parts), hand.side)


def _peak(clip: Clip, side: int) -> float:
    """Highest speed of a wrist, m/s."""
    info = rig_info(clip.skeleton)
    _, positions = kinematics.forward(clip, [info.arm_joints[3 * side + 2]])
    steps = np.linalg.norm(np.diff(positions[:, 0], axis=0), axis=-1)
    return float(steps.max(initial=0.0)) * clip.fps * info.sizes.unit.metres


def remade(stretches: list[ArmStretch], clip: Clip, frames: tuple[int, int], first: int) -> Remade | None:
    """What a span of a word's frames says of its arms that were made anew, the span's first frame being ``first`` in
    the output; None where it holds none. Two stretches are told as one, from the first frame to the last.
    """
    inside = [(one, max(one.start, frames[0]), min(one.stop, frames[1])) for one in stretches]
    inside = [row for row in inside if row[1] < row[2]]
    if not inside:
        return None
    joints = sorted({joint for one, _, _ in inside for joint in one.joints})
    shift = first - frames[0]
    return Remade(
        tuple(clip.skeleton.names[joint] for joint in joints),
        (min(start for _, start, _ in inside) + shift, max(stop for _, _, stop in inside) + shift),
    )
