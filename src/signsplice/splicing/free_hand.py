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
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip, bone_translations, concatenate, unchecked_copy
from signsplice.rig.arms import Arms, arms
from signsplice.rig.info import rig_info
from signsplice.splicing.collision_avoidance import TOLERANCE_M, avoid_collisions, depths
from signsplice.splicing.cut import Cut
from signsplice.splicing.filling import FilledGap
from signsplice.splicing.gap import Gap, gap_at
from signsplice.splicing.transition import find_transition

Float = NDArray[np.float64]

TRANSITION, NATURAL = FREE_HANDS = ("transition", "natural")
"""What the idle hand's time may be."""
FASTEST_M_S = 2.2
"""A hand that only goes to rest, or comes from it, is not faster than this."""
_UNHURRIED_M_S = 1.4
"""Nor, under ``natural``, than 9 of 10 hands that people let sink in running signing (15 movements of 0.15 to 0.4 m in
16 sentences of the DGS Corpus: median 0.8 m/s, 1.8 at most).
"""
_NEAR_REST = 0.1
"""A hand this near to where it rests, in arm lengths, is at rest: arms that hang sway."""
_HANGING, _LOW = 0.25, 0.6
"""Height, in arm lengths above a hanging wrist, up to which an arm hangs; up to which both hands rest where both are
still (folded before the belly, held before the waist).
"""
_STILL_M_S = 0.15
_CLEAR_M = 0.03
"""A signing hand this near to the other arm may be about to touch it: that arm keeps its frames from there on."""
_ROUNDS = 8


@dataclass(frozen=True)
class Remade:
    """Joints of a sign's span that do not show its clip: an idle arm that was given more time.

    joints: their names.
    frames: of the output, half-open; outside them these joints too are the clip's.
    """

    joints: tuple[str, ...]
    frames: tuple[int, int]


@dataclass(frozen=True)
class ArmStretch:
    """Frames of a word in which one arm was made anew.

    joints: of the arm.
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


@dataclass(frozen=True)
class IdleHand:
    """A hand that is at rest on one side of a seam and away from it on the other.

    side: 0 left, 1 right.
    arrives: it goes to rest; else it comes from it.
    n_rest: frames next to the seam in which it rests.
    """

    side: int
    arrives: bool
    n_rest: int


def idle_hands(before: Clip, after: Clip, cut: Cut) -> list[IdleHand]:
    """The idle hands of a seam; none on a rig whose arms are not known by name."""
    if not rig_info(before.skeleton).has_arms:
        return []
    p, q = arms(before), arms(after)
    found = []
    for side in (0, 1):
        left = _frames_at_rest(p, side, cut.pre, -1)
        entered = _frames_at_rest(q, side, cut.post, 1)
        if bool(left) != bool(entered):
            found.append(IdleHand(side, entered > 0, left or entered))
    return found


def _frames_at_rest(motion: Arms, side: int, frame: int, step: int) -> int:
    """Frames from one on, forwards or backwards, in which a hand is where it rests at that end of the clip (step 1: the
    beginning); 0 where it does not rest there.
    """
    end = 0 if step > 0 else -1
    places = motion.wrists - motion.shoulders  # (T, 2, 3)
    edge = places[:4] if step > 0 else places[-4:]
    speeds = np.linalg.norm(np.diff(edge, axis=0), axis=-1).max(axis=0, initial=0.0) * motion.fps * motion.metres
    heights, is_still = motion.lift[end], speeds < _STILL_M_S
    hangs = heights[side] < _HANGING and is_still[side]
    if not (hangs or (heights.max() < _LOW and is_still.all())):
        return 0
    near = np.linalg.norm(places[:, side] - places[end, side], axis=-1) < _NEAR_REST * motion.length
    run = near[frame::step]
    return len(run) if run.all() else int(np.argmin(run))


def finish(seam: SeamFrames, rules: Rules, refill: Callable[[Gap], FilledGap]) -> SeamFrames:
    """The seam with the time that its idle hands need; itself where they have it. ``refill`` makes the new frames of
    another gap.
    """
    hands = idle_hands(seam.before, seam.after, seam.cut)
    done = seam
    for _ in range(_ROUNDS if hands else 0):
        done = seam
        for hand in hands if rules.natural else ():
            done = _let_free(done, hand, rules.avoids)
        peak = max(_peak(_window(done.gap, done.filled.clip), hand.side) for hand in hands)
        n_frames = seam.gap.n_frames
        if not rules.lengthens or peak <= FASTEST_M_S or n_frames >= rules.longest:
            break
        wanted = math.ceil((n_frames + 1) * peak / FASTEST_M_S) - 1
        seam = seam.refilled(min(max(wanted, n_frames + 1), rules.longest), refill)
    return done


def _let_free(seam: SeamFrames, hand: IdleHand, avoids: bool) -> SeamFrames:
    """The seam with one idle hand given as many frames of the sign as it needs, where it has them."""
    n_frames = seam.gap.n_frames
    peak = _peak(_window(seam.gap, seam.filled.clip), hand.side)
    most = _frames_free(seam, hand)
    best: _RemadeArm | None = None
    n_more = 0
    while peak > _UNHURRIED_M_S and n_more < most:
        wanted = math.ceil((n_frames + n_more + 1) * peak / _UNHURRIED_M_S) - 1 - n_frames
        n_more = min(max(wanted, n_more + 1), most)
        made = _remake(seam, hand, n_more, avoids)
        if made.depth <= TOLERANCE_M or best is None:
            best = made
        peak = made.peak
    if best is None or best.depth > max(TOLERANCE_M, seam.filled.depth or 0.0):
        return seam
    return _put_in(seam, hand, best)


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
    touched = _is_approached(rest, hand.side)
    return _first(touched if hand.arrives else touched[::-1])


def _first(flags: NDArray[np.bool_]) -> int:
    """Number of flags before the first that is set."""
    return int(np.argmax(flags)) if flags.any() else len(flags)


def _is_approached(clip: Clip, side: int) -> NDArray[np.bool_]:
    """For every frame (T,) whether the hand of the other side is near the arm of this one."""
    posed = collision.posed_capsules(clip.skeleton, *kinematics.forward(clip))
    body = posed.body
    own = [
        n for n, of in enumerate(body.sides) if of == ("left", "right")[side] and body.parts[n] not in ("leg", "shoe")
    ]
    other = body.groups.right if side == 0 else body.groups.left
    if not own or not other:
        return np.zeros(len(clip), bool)
    overlap, _ = collision.overlap(posed.starts, posed.ends, body.radii, other, own)
    return np.asarray(-overlap.max(axis=(1, 2)) * rig_info(clip.skeleton).sizes.unit.metres < _CLEAR_M)


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
        made, depth = cleared.clip, cleared.depth or 0.0
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
    filled = replace(seam.filled, clip=new, depth=depth)
    return replace(seam, before=before, after=after, gap=gap, filled=filled, remade=(leaving, entering))


def arm_joints(clip: Clip, side: int) -> tuple[int, ...]:
    """Every joint of an arm, from the collarbone to the fingertips, where the rig's arms are known."""
    info = rig_info(clip.skeleton)
    collarbone = info.roles.joints.get(f"{('left', 'right')[side]}Shoulder", info.arm_joints[3 * side])
    return tuple(kinematics.subtree(clip.skeleton, collarbone))


def _with_joints(clip: Clip, new: Clip, start: int, joints: tuple[int, ...]) -> Clip:
    """The clip with some joints as in ``new``, whose frames begin at frame ``start``."""
    rows, columns = np.ix_(np.arange(start, start + len(new)), joints)
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
