"""Idle hands: at a seam, those that only go to rest, or only come from it, while the other hand signs.

With the rest of the body such a hand has the time of the transition, and may have to fall from the face to the hip in
it. Two things give it more.

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
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.motion import Clip, batch_clips, concatenate, kinematics
from signsplice.rig.info import Arms, arms, rig_info
from signsplice.rig.roles import SIDES
from signsplice.splicing.collisions import TOLERANCE_M, avoid_collisions, depths, turn_elbow
from signsplice.splicing.contracts import Cut, Gap, gap_at
from signsplice.splicing.curves import find_transition
from signsplice.splicing.durations import most_frames
from signsplice.splicing.passes import Pass, Refill
from signsplice.splicing.seam import Seam
from signsplice.splicing.word import apply_edits, edit_of

_NEAR_REST, _TURNED_RAD = 0.13, np.deg2rad(20.0)
"""A hand is at rest where it is this near to where it rests from the hips, in arm lengths, and turned by no more than
this. While the other hand signs, that of the synthetic signer stays within 0.12 and 16 degrees, however it rests; one
that signs too has 0.20 at least. (From the shoulders, which sway, it is 0.20 against 0.22.)
"""
_HANGING, _LOW = 0.25, 0.6
"""Height, in arm lengths above a hanging wrist, up to which an arm hangs; up to which both hands rest where both are
still (folded before the belly, held before the waist).
"""
_STILL_M_S = 0.3
_CLEAR_M = 0.03
"""A signing hand this near to the other arm may be about to touch it: that arm keeps its frames from there on."""


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
    positions = motion.wrists - motion.hips[:, None]  # (T, 2, 3)
    edge = positions[:4] if step > 0 else positions[-4:]
    speeds = np.linalg.norm(np.diff(edge, axis=0), axis=-1).max(axis=0, initial=0.0) * motion.fps * motion.metres
    heights, is_still = motion.lift[end], speeds < _STILL_M_S
    hangs = heights[side] < _HANGING and is_still[side]
    if not (hangs or (heights.max() < _LOW and is_still.all())):
        return 0
    here, there = slice(frame, None, step), motion.hand_rotations[end, side]
    near = np.linalg.norm(positions[here, side] - positions[end, side], axis=-1) < _NEAR_REST * motion.length
    cosines = 0.5 * (np.einsum("tab,ab->t", motion.hand_rotations[here, side], there) - 1.0)
    run = near & (cosines > np.cos(_TURNED_RAD))
    return len(run) if run.all() else int(np.argmin(run))


def is_approached(clip: Clip, side: int) -> NDArray[np.bool_]:
    """For every frame (T,) whether the hand of the other side is near the arm of this one."""
    posed = collision.pose_capsules(clip.skeleton, *kinematics.forward(clip))
    body = posed.body
    own = [n for n, of in enumerate(body.sides) if of == SIDES[side] and body.parts[n] not in ("leg", "shoe")]
    other = body.groups.right if side == 0 else body.groups.left
    if not own or not other:
        return np.zeros(len(clip), bool)
    overlap, _ = collision.overlap(posed.starts, posed.ends, body.radii, other, own)
    return np.asarray(-overlap.max(axis=(1, 2)) * rig_info(clip.skeleton).sizes.unit.metres < _CLEAR_M)


def arm_joints(clip: Clip, side: int) -> tuple[int, ...]:
    """Every joint of an arm, from the collarbone to the fingertips, where the rig's arms are known."""
    info = rig_info(clip.skeleton)
    collarbone = info.roles.joints.get(f"{SIDES[side]}Shoulder", info.arm_joints[3 * side])
    return tuple(kinematics.subtree(clip.skeleton, collarbone))


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
class WristSpeeds(Pass):
    """Measures how fast wrists are in new frames, for ``FreeHands``; on rigs whose arms are known."""

    batches: ClassVar[bool] = True

    def change_all(self, seams: Sequence[Seam]) -> list[Seam]:
        """The seams with the highest speed of their wrists."""
        return with_peaks(seams)


@dataclass(frozen=True)
class FreeHands(Pass):
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

    def change(self, seam: Seam) -> Seam:
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


def _let_free(seam: Seam, hand: IdleHand, avoids: bool) -> Seam:
    """The seam with one idle hand given as many frames of the sign as it needs, where it has them."""
    n_frames = seam.gap.n_frames
    peak = least = _peak(_window(seam.gap, seam.new_frames), hand.side)
    most = _frames_free(seam, hand)
    best: _ArmPath | None = None
    n_more = 0
    while peak > _UNHURRIED_M_S and n_more < most:
        wanted = math.ceil((n_frames + n_more + 1) * peak / _UNHURRIED_M_S) - 1 - n_frames
        n_more = min(max(wanted, n_more + 1), most)
        path = _arm_path(seam, hand, n_more, avoids)
        peak = path.peak
        # A way around the body may be longer, and faster, than the transition's own.
        if peak < least and path.depth <= max(TOLERANCE_M, seam.depth or 0.0):
            best, least = path, peak
    return seam if best is None else _apply_arm_path(seam, hand, best)


def _frames_free(seam: Seam, hand: IdleHand) -> int:
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


def _arm_path(seam: Seam, hand: IdleHand, n_more: int, avoids: bool) -> _ArmPath:
    """The idle arm on one curve over the transition and ``n_more`` frames of the sign."""
    cut, entry, before, after = seam.retimed_cut, seam.before.first_frame, seam.before_clip, seam.after_clip
    post, stop = cut.post, cut.pre + 1
    if hand.arrives:
        frames = concatenate([seam.new_frames, after[post : post + n_more]])
        gap = gap_at(before, after, Cut(cut.pre, post + n_more), len(frames), entry, seam.gap.keyed)
    else:
        frames = concatenate([before[stop - n_more : stop], seam.new_frames])
        gap = gap_at(before, after, Cut(cut.pre - n_more, post), len(frames), entry, seam.gap.keyed)
    curve = find_transition("quintic").between(gap)
    new = apply_edits(frames, [edit_of(frames, curve, 0, arm_joints(frames, hand.side))])
    depth = 0.0
    if avoids:
        cleared = avoid_collisions(new, gap.before, gap.after, fixed=1 - hand.side)
        depth = cleared.depth or 0.0
        new = turn_elbow(cleared.clip, gap.before, gap.after, hand.side)
    return _ArmPath(new, n_more, _peak(_window(gap, new), hand.side), depth)


def _apply_arm_path(seam: Seam, hand: IdleHand, path: _ArmPath) -> Seam:
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
    depth = None if seam.depth is None else float(depths(new, seam.gap.before, seam.gap.after).max())
    return replace(seam, frames=new, depth=depth, peak_m_s=None)


def _window(gap: Gap, new: Clip) -> Clip:
    """New frames with those on either side."""
    return concatenate([gap.before[-1:], new, gap.after[:1]])


def _is_faster(seam: Seam, speed: float) -> bool:
    """Whether a hand of known arms passes a speed in the transition, m/s."""
    if seam.peak_m_s is None:
        (seam,) = with_peaks([seam])
    return seam.peak_m_s is not None and seam.peak_m_s > speed


def with_peaks(seams: Sequence[Seam]) -> list[Seam]:
    """The seams with the highest speed of wrists in their new frames; without it on rigs whose arms are not known."""
    out = list(seams)
    for block in batch_clips([(seam.gap.before[-1:], seam.new_frames, seam.gap.after[:1]) for seam in seams]):
        info = rig_info(block.clip.skeleton)
        if not info.has_arms:
            continue
        _, positions = kinematics.forward(block.clip, [info.arm_joints[2], info.arm_joints[5]])
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=-1).max(axis=1)
        for k, frames in block:
            peak = float(steps[frames.start : frames.stop - 1].max(initial=0.0))
            out[k] = replace(out[k], peak_m_s=peak * block.clip.fps * info.sizes.unit.metres)
    return out


def _peak_with_rest(seam: Seam, hand: IdleHand) -> float:
    """Highest speed of an idle hand in the transition and while it rests, m/s."""
    cut, before, after = seam.retimed_cut, seam.before_clip, seam.after_clip
    start, stop = cut.pre, cut.post + 1
    if hand.arrives:
        stop = cut.post + hand.n_rest
    else:
        start = max(seam.before.first_frame, cut.pre + 1 - hand.n_rest)
    parts = [before[start : cut.pre + 1], seam.new_frames, after[cut.post : stop]]
    return _peak(concatenate(parts), hand.side)


def _peak(clip: Clip, side: int) -> float:
    """Highest speed of a wrist, m/s."""
    info = rig_info(clip.skeleton)
    _, positions = kinematics.forward(clip, [info.arm_joints[3 * side + 2]])
    steps = np.linalg.norm(np.diff(positions[:, 0], axis=0), axis=-1)
    return float(steps.max(initial=0.0)) * clip.fps * info.sizes.unit.metres
