"""Idle hands: hands that only move to or from rest at a seam, while the other hand signs.

Like the rest of the body such a hand moves within the transition, and may have to fall from the face to the hip. Two
modes give it more time.

**transition**, the default: if it would exceed ``SPEEDS.largest_m_s``, the transition is lengthened for the whole body.
**natural**: it moves to rest over the first frames of the next sign, or leaves rest in the last frames of the sign
before, as long as it rests there. Its arm follows one curve over the transition and those frames (``quintic``: minimum
jerk between the velocities of both ends), avoids the body and the other hand, and is as slow as human hands if those
frames suffice. All other joints keep the frames of the sign.
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


@dataclass(frozen=True)
class RestLimits:
    """Limits within which a hand rests."""

    distance: float = 0.13
    """Distance from its rest position, seen from the hips, within which a hand rests, arm lengths. While the other hand
    signs, the synthetic signer's resting hand stays within 0.12; a hand that signs too has at least 0.20. (From the
    shoulders, which sway, the values are 0.20 and 0.22.)
    """
    rotation: float = np.deg2rad(20.0)
    """Largest rotation of a resting hand, radians; the synthetic signer's stays within 16 degrees."""
    hanging_height: float = 0.25
    """Height above a hanging wrist up to which an arm hangs, arm lengths."""
    folded_height: float = 0.6
    """Height up to which both hands rest if both are still (folded at the belly, held at the waist), arm lengths."""
    speed_m_s: float = 0.3
    """Speed below which a hand is still, m/s."""
    other_hand_m: float = 0.03
    """Distance from the arm within which the signing hand may touch it soon, m: the arm then keeps its frames."""


@dataclass(frozen=True)
class IdleHandSpeeds:
    """Largest speeds of idle hands, and the number of attempts to reach them."""

    largest_m_s: float = 2.2
    """Largest speed of an idle hand, m/s."""
    natural_m_s: float = 1.4
    """Largest speed under ``natural``, m/s: that of 9 of 10 sinking hands in running signing (15 movements of 0.15 to
    0.4 m in 16 sentences of the DGS Corpus: median 0.8 m/s, at most 1.8).
    """
    most_tries: int = 8
    """Largest number of lengths of a transition that are tried, the planned one included."""


_REST = RestLimits()
SPEEDS = IdleHandSpeeds()


@dataclass(frozen=True)
class IdleHand:
    """A hand that rests on one side of a seam and is away from rest on the other.

    side: 0 left, 1 right.
    arrives: whether it moves to rest; else it leaves rest.
    n_rest: number of frames next to the seam in which it rests.
    """

    side: int
    arrives: bool
    n_rest: int


def idle_hands(before: Clip, after: Clip, cut: Cut) -> list[IdleHand]:
    """Returns the idle hands of a seam; none if the rig's arms are not known by name."""
    if not rig_info(before.skeleton).has_arms:
        return []
    arms_before, arms_after = arms(before), arms(after)
    hands = []
    for side in (0, 1):
        n_rest_before = _frames_at_rest(arms_before, side, cut.pre, -1)
        n_rest_after = _frames_at_rest(arms_after, side, cut.post, 1)
        if bool(n_rest_before) != bool(n_rest_after):
            hands.append(IdleHand(side, n_rest_after > 0, n_rest_before or n_rest_after))
    return hands


def _frames_at_rest(motion: Arms, side: int, frame: int, step: int) -> int:
    """Counts the frames from ``frame`` on in which a hand stays where it rests at one end of the clip: counting
    forwards (``step`` 1) at its beginning, backwards (-1) at its end; 0 if it does not rest there.
    """
    end = 0 if step > 0 else -1
    positions = motion.wrists - motion.hips[:, None]  # (T, 2, 3)
    edge = positions[:4] if step > 0 else positions[-4:]
    speeds = np.linalg.norm(np.diff(edge, axis=0), axis=-1).max(axis=0, initial=0.0) * motion.fps * motion.metres
    heights, is_still = motion.lift[end], speeds < _REST.speed_m_s
    hangs = heights[side] < _REST.hanging_height and is_still[side]
    if not (hangs or (heights.max() < _REST.folded_height and is_still.all())):
        return 0
    frames, end_rotation = slice(frame, None, step), motion.hand_rotations[end, side]
    is_close = np.linalg.norm(positions[frames, side] - positions[end, side], axis=-1) < _REST.distance * motion.length
    cosines = 0.5 * (np.einsum("tab,ab->t", motion.hand_rotations[frames, side], end_rotation) - 1.0)
    rests = is_close & (cosines > np.cos(_REST.rotation))
    return len(rests) if rests.all() else int(np.argmin(rests))


def is_approached(clip: Clip, side: int) -> NDArray[np.bool_]:
    """Returns for every frame (T,) whether the hand of the other side is close to the arm of this side."""
    posed = collision.pose_capsules(clip.skeleton, *kinematics.forward(clip))
    body = posed.body
    arm_capsules = [n for n, of in enumerate(body.sides) if of == SIDES[side] and body.parts[n] not in ("leg", "shoe")]
    hand_capsules = body.groups.right if side == 0 else body.groups.left
    if not arm_capsules or not hand_capsules:
        return np.zeros(len(clip), bool)
    overlap, _ = collision.overlap(posed.starts, posed.ends, body.radii, hand_capsules, arm_capsules)
    return np.asarray(-overlap.max(axis=(1, 2)) * rig_info(clip.skeleton).sizes.unit.metres < _REST.other_hand_m)


def arm_joints(clip: Clip, side: int) -> tuple[int, ...]:
    """Returns every joint of an arm, from the collarbone to the fingertips; the rig's arms must be known."""
    info = rig_info(clip.skeleton)
    collarbone = info.roles.joints.get(f"{SIDES[side]}Shoulder", info.arm_joints[3 * side])
    return tuple(kinematics.subtree(clip.skeleton, collarbone))


TRANSITION, NATURAL = FREE_HANDS = ("transition", "natural")
"""Modes for the time of idle hands."""


@dataclass(frozen=True)
class WristSpeeds(Pass):
    """Measures the speed of wrists in new frames, for ``FreeHands``, if the rig's arms are known."""

    batches: ClassVar[bool] = True

    def change_all(self, seams: Sequence[Seam]) -> list[Seam]:
        """Returns the seams with the highest speed of their wrists."""
        return with_peaks(seams)


@dataclass(frozen=True)
class FreeHands(Pass):
    """Gives idle hands the time that they need.

    refill: makes the frames of a gap that is lengthened, or whose words were edited.
    natural: whether idle hands take frames of the signs.
    lengthens: whether the transition is lengthened if they would be too fast.
    avoids: whether their arms are led around the body in frames of the signs.
    """

    refill: Refill
    natural: bool
    lengthens: bool
    avoids: bool

    def change(self, seam: Seam) -> Seam:
        """Returns the seam with slower idle hands, or unchanged if they are slow enough."""
        seam = self.refill.fresh(seam)
        limit_m_s = SPEEDS.natural_m_s if self.natural else SPEEDS.largest_m_s
        if not _is_faster(seam, limit_m_s):
            return seam
        hands, longest = (
            idle_hands(seam.before_clip, seam.after_clip, seam.retimed_cut),
            most_frames(seam.gap.before.fps),
        )
        done = seam
        for _ in range(SPEEDS.most_tries if hands else 0):
            done = seam
            for hand in hands if self.natural else ():
                done = _slow_hand(done, hand, self.avoids)
            peak = max(_peak_with_rest(done, hand) for hand in hands)
            n_frames = seam.gap.n_frames
            if not self.lengthens or peak <= SPEEDS.largest_m_s or n_frames >= longest:
                break
            n_needed = math.ceil((n_frames + 1) * peak / SPEEDS.largest_m_s) - 1
            seam = self.refill.again(seam, min(max(n_needed, n_frames + 1), longest))
        return done


def _slow_hand(seam: Seam, hand: IdleHand, avoids: bool) -> Seam:
    """Returns the seam with as many frames of the sign for one idle hand as it needs and ``_n_frames_free`` allows."""
    n_frames = seam.gap.n_frames
    peak = lowest_peak = _peak(_window(seam.gap, seam.new_frames), hand.side)
    limit = _n_frames_free(seam, hand)
    best: _ArmPath | None = None
    n_more = 0
    while peak > SPEEDS.natural_m_s and n_more < limit:
        n_wanted = math.ceil((n_frames + n_more + 1) * peak / SPEEDS.natural_m_s) - 1 - n_frames
        n_more = min(max(n_wanted, n_more + 1), limit)
        path = _arm_path(seam, hand, n_more, avoids)
        peak = path.peak
        # A path around the body may be longer, and faster, than the transition's own.
        if peak < lowest_peak and path.depth <= max(TOLERANCE_M, seam.depth or 0.0):
            best, lowest_peak = path, peak
    return seam if best is None else _apply_arm_path(seam, hand, best)


def _n_frames_free(seam: Seam, hand: IdleHand) -> int:
    """Returns the number of frames of the sign that an idle hand may take: it rests in them and in one more, and the
    other hand is not close to its arm.
    """
    cut, limit = seam.retimed_cut, hand.n_rest - 1
    if hand.arrives:
        rest = seam.after_clip[cut.post : cut.post + limit] if limit > 0 else None
    else:
        limit = min(limit, cut.pre - seam.before.first_frame)
        rest = seam.before_clip[cut.pre + 1 - limit : cut.pre + 1] if limit > 0 else None
    if rest is None:
        return 0
    touched = is_approached(rest, hand.side)
    return _first(touched if hand.arrives else touched[::-1])


def _first(flags: NDArray[np.bool_]) -> int:
    """Returns the number of flags before the first that is set."""
    return int(np.argmax(flags)) if flags.any() else len(flags)


@dataclass(frozen=True, eq=False)
class _ArmPath:
    """An idle arm's new frames, with those of the other joints.

    clip: the transition and the ``n_more`` frames of the sign.
    peak: the wrist's highest speed, m/s.
    depth: depth of the hand in the body or in the other hand, beyond that of both ends, m; 0 without collision
        avoidance.
    """

    clip: Clip
    n_more: int
    peak: float
    depth: float


def _arm_path(seam: Seam, hand: IdleHand, n_more: int, avoids: bool) -> _ArmPath:
    """Returns the idle arm on one curve over the transition and ``n_more`` frames of the sign."""
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
    """Puts an arm's new frames into the seam's transition, and as an edit into the sign."""
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
    """Joins the new frames and one frame on either side."""
    return concatenate([gap.before[-1:], new, gap.after[:1]])


def _is_faster(seam: Seam, speed: float) -> bool:
    """Whether a hand of known arms exceeds ``speed`` in the transition, m/s."""
    if seam.peak_m_s is None:
        (seam,) = with_peaks([seam])
    return seam.peak_m_s is not None and seam.peak_m_s > speed


def with_peaks(seams: Sequence[Seam]) -> list[Seam]:
    """Returns the seams with the highest speed of wrists in their new frames, if the rig's arms are known."""
    measured = list(seams)
    for block in batch_clips([(seam.gap.before[-1:], seam.new_frames, seam.gap.after[:1]) for seam in seams]):
        info = rig_info(block.clip.skeleton)
        if not info.has_arms:
            continue
        _, positions = kinematics.forward(block.clip, [info.arm_joints[2], info.arm_joints[5]])
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=-1).max(axis=1)
        for k, frames in block:
            peak = float(steps[frames.start : frames.stop - 1].max(initial=0.0))
            measured[k] = replace(measured[k], peak_m_s=peak * block.clip.fps * info.sizes.unit.metres)
    return measured


def _peak_with_rest(seam: Seam, hand: IdleHand) -> float:
    """Returns the highest speed of an idle hand in the transition and while it rests, m/s."""
    cut, before, after = seam.retimed_cut, seam.before_clip, seam.after_clip
    start, stop = cut.pre, cut.post + 1
    if hand.arrives:
        stop = cut.post + hand.n_rest
    else:
        start = max(seam.before.first_frame, cut.pre + 1 - hand.n_rest)
    parts = [before[start : cut.pre + 1], seam.new_frames, after[cut.post : stop]]
    return _peak(concatenate(parts), hand.side)


def _peak(clip: Clip, side: int) -> float:
    """Returns the highest speed of a wrist, m/s."""
    info = rig_info(clip.skeleton)
    _, positions = kinematics.forward(clip, [info.arm_joints[3 * side + 2]])
    steps = np.linalg.norm(np.diff(positions[:, 0], axis=0), axis=-1)
    return float(steps.max(initial=0.0)) * clip.fps * info.sizes.unit.metres
