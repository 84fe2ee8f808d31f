"""Channels of a person and their owners, and arms and heads that no word owns.

A word owns the channels (``roles.CHANNELS``) that it moves, or those that its lexicon names; they keep their local
rotations bit for bit. A channel that it does not own comes from a recording of somebody who stood still around one
word, so it is planned over the sentence: it stays where the last word left it, and moves to its place late and slowly.
An arm's place is low before the body where the signer's arms hang at rest, else where they rest; it sinks to rest in
pauses, in long runs without it, and at the end. It is on its way to the next word that owns it before that begins. No
seam waits for it. This happens while seams are planned, so gaps and collisions see the result; turns of head and trunk
are added later (``carriage``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
import scipy

from signsplice.body import arm_ik, collision
from signsplice.motion import Clip, FloatArray, Skeleton, at_frames, copy_unchecked, kinematics, rotation
from signsplice.motion.curves import minimum_jerk
from signsplice.rig.info import TRUNK, Arms, active_span, arms, rig_info
from signsplice.rig.roles import CHANNELS, SIDES
from signsplice.splicing.collisions import avoid_collisions, depths, turn_elbow
from signsplice.splicing.contracts import Cut
from signsplice.splicing.durations import HUMAN
from signsplice.splicing.word import AlignedWord, ChannelPath

TRANSITION, NATURAL = FREE_HANDS = ("transition", "natural")
"""Modes of idle arms: they go to rest, and leave it, within the transition; or they are planned."""


@dataclass(frozen=True)
class RestLimits:
    """Limits within which a channel rests."""

    distance: float = 0.13
    """Distance of a hand from its rest position, seen from the hips, arm lengths. While the other hand signs, the
    synthetic signer's resting hand stays within 0.12; a hand that signs too has at least 0.20.
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
    """Distance from an arm within which the signing hand may touch it, m: the word then owns that arm."""
    reach: float = 0.55
    """Distance of a wrist from the other arm from which on its hand cannot touch it, arm lengths."""
    turn: float = np.deg2rad(3.0)
    """Range of the turns of a still head or trunk, radians, noise of ``noise_s`` left out."""
    noise_s: float = 0.15
    """Time over which rotations of head and trunk are averaged, s."""


@dataclass(frozen=True)
class IdleArmPlan:
    """Places and times of idle arms. The places are those of people (three captures, 85 s): 0.38 to 0.65 arm lengths
    below the shoulders, 0.2 to 0.35 in front of them, 0.3 to 0.5 beside the middle. Times, speeds and the fractions of
    the way were chosen by eye, on sentences other than those that are measured.
    """

    below: float = 0.53
    """Distance of the low place below the shoulders, arm lengths."""
    in_front: float = 0.25
    """Its distance in front of them, arm lengths."""
    beside: float = 0.37
    """Its distance from the middle, arm lengths."""
    release: float = 0.35
    """Fraction of the way to its place that an arm goes at once: it lets go."""
    finger_release: float = 0.7
    """The same for its fingers: the shape of the last sign beside the next would be read as part of it."""
    release_s: float = 0.4
    """Time in which it lets go, s."""
    stay_s: float = 0.3
    """Time after which it begins to go the rest of the way, s."""
    high: float = 0.75
    """Height, as ``Arms.lift``, from which on a hand is so near the face that it leaves at once."""
    relax_s: float = 1.0
    """Time in which it then moves to its place, s."""
    sinking_a_s: float = 0.06
    """Fraction of the low place that an arm there sinks towards rest in a second: no arm stands quite still."""
    least_sunk: float = 0.75
    """Fraction of the low place down to which it sinks so."""
    sink_after_s: float = 4.0
    """Time after which it sinks to rest in a run of words without it, s."""
    sinking_m_s: float = 0.35
    """Highest speed at which it sinks to rest, if there is time, m/s."""
    rising_m_s: float = 1.5
    """Highest speed at which it goes to the next sign, if there is time, m/s (sinking hands of people: median 0.8)."""
    least_rise_s: float = 0.35
    """Shortest time in which it goes there, s."""
    coasting_deg: float = 10.0
    """Largest rotation of a joint while a moving hand comes to a stand, degrees."""
    leaves_place: float = 0.9
    """Fraction of its height below which the other hand has begun to go to rest at the end of a sentence."""
    checked_s: float = 0.1
    """Time between the frames in which an arm is checked for the body and the other arm, s."""
    head_deg_s: float = 40.0
    """Highest speed at which a head returns from a turn that a word owns, or begins one, degrees/s."""


REST = RestLimits()
PLAN = IdleArmPlan()
_N_STEPS = 8
"""Number of poses along the path of an arm whose length is measured."""


def owned_channels(clip: Clip) -> frozenset[str]:
    """Returns the channels that move in a clip; all if the rig's arms are not known by name."""
    return clip.derived[find_owned_channels]


def find_owned_channels(clip: Clip) -> frozenset[str]:
    """Finds the channels that move in a clip, for ``owned_channels``."""
    if not rig_info(clip.skeleton).has_arms:
        return frozenset(CHANNELS)
    motion, active = arms(clip), range(*active_span(arms(clip)))
    owned = {CHANNELS[side] for side in (0, 1) if not _rests(motion, side) or _is_touched(clip, motion, active, side)}
    for channel in CHANNELS[2:]:
        joints = channel_joints(clip, channel)
        above = kinematics.path_to_root(clip.skeleton, joints[-1]) if joints else []
        highest = max((above.index(joint) for joint in joints if joint in above), default=-1)
        chain = above[: highest + 1]  # all joints from the last one up to the first that lies above it
        if not chain:
            continue
        whole = reduce(rotation.multiply, [clip.local_rotations[:, joint] for joint in reversed(chain)])  # (T, 4)
        turns = rotation.difference(whole[:1], whole)
        smooth = scipy.ndimage.uniform_filter1d(turns, max(1, round(REST.noise_s * clip.fps)), axis=0, mode="nearest")
        if np.linalg.norm(np.ptp(smooth, axis=0)) > REST.turn:
            owned.add(channel)
    return frozenset(owned)


def _rests(motion: Arms, side: int) -> bool:
    """Whether a hand stays in all frames of a clip where it rests in the first."""
    positions = motion.wrists - motion.hips[:, None]  # (T, 2, 3)
    speeds = np.linalg.norm(np.diff(positions[:4], axis=0), axis=-1).max(axis=0, initial=0.0)
    heights, is_still = motion.lift[0], speeds * motion.fps * motion.metres < REST.speed_m_s
    hangs = heights[side] < REST.hanging_height and is_still[side]
    if not (hangs or (heights.max() < REST.folded_height and is_still.all())):
        return False
    distances = np.linalg.norm(positions[:, side] - positions[0, side], axis=-1)
    first = motion.hand_rotations[0, side]
    cosines = 0.5 * (np.einsum("tab,ab->t", motion.hand_rotations[:, side], first) - 1.0)
    return bool((distances < REST.distance * motion.length).all() and (cosines > np.cos(REST.rotation)).all())


def _is_touched(clip: Clip, motion: Arms, frames: range, side: int) -> bool:
    """Whether the hand of the other side comes close to the arm of this side within ``frames``."""
    few = np.array(frames[:: max(1, round(PLAN.checked_s * clip.fps))], np.intp)
    joints = np.stack([part[few, side] for part in (motion.shoulders, motion.elbows, motion.wrists)], axis=1)
    bones = np.diff(joints, axis=1)  # (T, 2, 3)
    other = motion.wrists[few, None, 1 - side]
    squared = collision.segment_distance_squared(other, joints[:, :2], bones, collision.dot(bones, bones))
    few = few[(squared < (REST.reach * motion.length) ** 2).any(axis=1)]
    near = at_frames(clip, few)
    if not len(near):
        return False
    posed = collision.pose_capsules(clip.skeleton, *kinematics.forward(near))
    groups = posed.body.groups
    hand, arm = (groups.right, groups.left_arm) if side == 0 else (groups.left, groups.right_arm)
    arm = (*arm, *(groups.left if side == 0 else groups.right))
    most = REST.other_hand_m / rig_info(clip.skeleton).sizes.unit.metres
    return bool(hand and arm and (posed.nearest(hand, [arm], most)[0] < most).any())


def channel_joints(clip: Clip, channel: str) -> list[int]:
    """Returns the joints of a channel that the rig has: an arm's from the collar bone to the fingertips."""
    return clip.skeleton.derived[find_channel_joints][channel]


def find_channel_joints(skeleton: Skeleton) -> dict[str, list[int]]:
    """Returns the joints of every channel. Raises ``InputError`` if the rig's arms are not known by name."""
    info = rig_info(skeleton)
    roles = info.roles.joints
    collar_bones = [roles.get(f"{side}Shoulder", info.arm_joints[3 * k]) for k, side in enumerate(SIDES)]
    joints = [kinematics.subtree(skeleton, joint) for joint in collar_bones]
    carries_arms = {joint for bone in collar_bones for joint in kinematics.path_to_root(skeleton, bone)}
    trunk, head = ([roles[role] for role in rows if role in roles] for rows in (TRUNK[:3], TRUNK[3:]))
    joints += [trunk, [joint for joint in head if joint not in carries_arms]]  # a neck may carry the collar bones
    return dict(zip(CHANNELS, joints, strict=True))


def carry_channels(
    before: AlignedWord, after: AlignedWord, cut: Cut, n_frames: int, channels: Sequence[str], avoids: bool
) -> tuple[AlignedWord, AlignedWord]:
    """Plans the ``channels`` of two words that only one of them owns, or neither, and returns the words with them.

    cut: in frames of the retimed words.
    n_frames: number of frames between them.
    avoids: whether planned arms are led around the body and the other arm.
    """
    if not rig_info(before.clip.skeleton).has_arms:
        return before, after
    gap_s = (n_frames + 1) / before.clip.fps
    paths: dict[str, ChannelPath] = {}
    for channel in channels:
        joints = channel_joints(before.clip, channel)
        if not joints or channel in before.owns & after.owns:
            continue
        is_arm, target = channel in CHANNELS[:2], after.retimed.local_rotations[cut.post, joints]
        if channel in after.owns:
            before = _lead_out(before, channel, (cut.pre, n_frames + 1), target)
        elif channel in before.owns:
            start = _coast(before.retimed.local_rotations[max(0, cut.pre - 2) : cut.pre + 1, joints], n_frames + 1)
            height = arms(before.retimed).lift[cut.pre, CHANNELS.index(channel)] if is_arm else 1.0
            if height > REST.hanging_height:
                paths[channel] = _begin_path(start, target, is_arm, gap_s, height)
        elif channel in before.paths:
            path = before.paths[channel].later((cut.pre - before.first_frame) / before.clip.fps + gap_s)
            ends_phrase = before.held is not None and before.held.mark != ","
            if is_arm and (ends_phrase or -path.left_s > PLAN.sink_after_s):
                before = _lead_out(before, channel, (cut.pre, n_frames + 1), target, PLAN.sinking_m_s)
            else:
                paths[channel] = path
        if is_arm and avoids and channel in before.planned:
            before = _avoid(before, channel, cut.pre)
    return before, _follow(after, paths, cut.post)


def hold_idle_arms(before: AlignedWord, after: AlignedWord, cut: Cut) -> Clip:
    """Returns the clip of the word after, in which the arms that only one of the words owns are where the word before
    has them at the cut: a duration sees hands that do not travel.
    """
    clip = after.clip
    sides = [channel for channel in CHANNELS[:2] if (channel in before.owns) != (channel in after.owns)]
    if not sides or not rig_info(clip.skeleton).has_arms:
        return clip
    local = np.array(clip.local_rotations)
    for channel in sides:
        joints = channel_joints(clip, channel)
        local[:, joints] = before.clip.local_rotations[cut.pre, joints]
    return copy_unchecked(clip, local_rotations=local)


def _coast(rotations: FloatArray, n_steps: int) -> FloatArray:
    """Returns rotations (K, 4) at which joints come to a stand after the frames (T, K, 4), in ``n_steps`` frames."""
    turn = rotation.difference(rotations[0], rotations[-1]) / max(1, len(rotations) - 1) * n_steps / 3.0  # (K, 3)
    angle = np.linalg.norm(turn, axis=-1, keepdims=True)
    limit = np.deg2rad(PLAN.coasting_deg)
    return rotation.multiply(rotations[-1], rotation.exp(turn * limit / np.maximum(angle, limit)))


def _begin_path(start: FloatArray, place: FloatArray, is_arm: bool, gap_s: float, height: float) -> ChannelPath:
    """Returns the path of a channel that the word before left at ``start`` (K, 4), ``gap_s`` before the word after is
    entered; ``place`` (K, 4): where a head goes; ``height``: of a hand, as ``Arms.lift``.
    """
    if is_arm:
        return ChannelPath(start, -gap_s, (PLAN.stay_s if height < PLAN.high else 0.0) - gap_s, PLAN.relax_s)
    angle = np.rad2deg(rotation.angle_between(start, place).sum())
    return ChannelPath(start, -gap_s, -gap_s, max(gap_s, peak_speed(angle) / PLAN.head_deg_s))


def peak_speed(distance: float) -> float:
    """Returns the highest speed of a minimum-jerk movement over a distance in 1 s."""
    return HUMAN.peak_over_mean * distance


def _follow(word: AlignedWord, paths: Mapping[str, ChannelPath], entry: int) -> AlignedWord:
    """Returns a word whose channels follow ``paths`` from frame ``entry`` on."""
    if not paths:
        return word
    times = np.arange(len(word.retimed) - entry) / word.clip.fps
    for channel, path in paths.items():
        joints = channel_joints(word.clip, channel)
        place, release = word.retimed.local_rotations[entry:, joints], np.zeros(len(joints))
        if channel in CHANNELS[:2]:
            side = CHANNELS.index(channel)
            if (low := find_low_place(word.clip, side)) is not None:
                sunk = PLAN.sinking_a_s * np.maximum(times - path.begin_s - path.seconds, 0.0)
                raised = np.maximum(1.0 - sunk, PLAN.least_sunk)[:, None]  # (T, 1), from rest to the low place
                moved = (low[joints] != place[0]).any(axis=-1)  # the fingers stay
                place = np.repeat(place[:1], len(times), axis=0)
                place[:, moved] = rotation.slerp(place[0, moved], low[joints][moved], raised)
            arm = {joints[0], *rig_info(word.clip.skeleton).arm_joints[3 * side : 3 * side + 3]}
            release = np.array([PLAN.release if joint in arm else PLAN.finger_release for joint in joints])
        released, relaxed = (
            minimum_jerk(np.clip((times - begin_s) / seconds, 0.0, 1.0))[:, None]
            for begin_s, seconds in ((path.left_s, PLAN.release_s), (path.begin_s, path.seconds))
        )
        progress = release * released + (1.0 - release) * relaxed  # (T, K)
        word = _replace(word, channel, joints, entry, rotation.slerp(path.start, place, progress))
    return replace(word, paths=dict(paths))


def _replace(word: AlignedWord, channel: str, joints: Sequence[int], first: int, rotations: FloatArray) -> AlignedWord:
    """Returns the word with planned rotations (n, K, 4) of a channel's joints from frame ``first`` on."""
    local = np.array(word.retimed.local_rotations)
    local[first : first + len(rotations), joints] = rotations
    planned = word.planned if channel in word.planned else (*word.planned, channel)
    recorded = word.retimed if word.recorded is None else word.recorded
    return replace(
        word, retimed=copy_unchecked(word.retimed, local_rotations=local), planned=planned, recorded=recorded
    )


def find_low_place(clip: Clip, side: int) -> FloatArray | None:
    """Returns local rotations (J, 4) of a clip's first frame with one arm at its low place; None if it does not hang
    there.
    """
    return (clip.source_clip or clip).derived[find_low_places][side]


def find_low_places(clip: Clip) -> tuple[FloatArray | None, FloatArray | None]:
    """Finds the low places of both arms, for ``find_low_place``: the first frame with another upper and lower arm."""
    first = at_frames(clip, slice(0, 1))
    motion, arm_joints = arms(first), rig_info(clip.skeleton).arm_joints
    lateral = motion.shoulders[0, 0] - motion.shoulders[0, 1]
    lateral = lateral - (lateral @ motion.up) * motion.up
    lateral = lateral / (np.linalg.norm(lateral) + 1e-12)
    forward = np.cross(lateral, motion.up)
    middle, places = motion.shoulders[0].mean(axis=0), list[FloatArray | None]()
    for side, sign in ((0, 1.0), (1, -1.0)):
        if motion.lift[0, side] > REST.hanging_height:
            places.append(None)
            continue
        offset = sign * PLAN.beside * lateral + PLAN.in_front * forward - PLAN.below * motion.up
        moves = np.zeros((1, 2, 3))
        moves[0, side] = middle + motion.length * offset - motion.wrists[0, side]
        local = np.array(arm_ik.move_wrists(first, moves).local_rotations[0])
        hand = arm_joints[3 * side + 2]
        local[hand] = first.local_rotations[0, hand]  # the hand turns with the forearm
        places.append(local)
    return places[0], places[1]


def _lead_out(
    word: AlignedWord, channel: str, end: tuple[int, int], target: FloatArray, speed_m_s: float = PLAN.rising_m_s
) -> AlignedWord:
    """Returns a word whose channel is on its way to ``target`` (K, 4) in its last frames.

    end: the last frame that is kept, and the number of frames from there to the one that shows the target.
    speed_m_s: highest speed of a hand, if there is time.
    """
    (last, n_more), joints = end, channel_joints(word.clip, channel)
    first, fps, local = word.first_frame, word.clip.fps, word.retimed.local_rotations
    if channel in CHANNELS[:2]:
        travel = _wrist_travel(word, joints, CHANNELS.index(channel), last, target)
        seconds = max(peak_speed(travel) / speed_m_s, PLAN.least_rise_s)
    else:
        angle = np.rad2deg(rotation.angle_between(local[last, joints], target).sum())
        seconds = peak_speed(angle) / PLAN.head_deg_s
    begin = max(first, last + n_more - seconds * fps)
    if begin >= last:
        return word
    frames = np.arange(int(np.ceil(begin)), last + 1)
    progress = minimum_jerk(np.asarray((frames - begin) / (last + n_more - begin)))[:, None]
    rotations = rotation.slerp(local[frames][:, joints], target, progress)
    return _replace(word, channel, joints, int(frames[0]), rotations)


def _wrist_travel(word: AlignedWord, joints: Sequence[int], side: int, frame: int, target: FloatArray) -> float:
    """Returns the length of the path of a wrist from a frame to where its arm is at ``target`` (K, 4), m."""
    steps = at_frames(word.retimed, np.full(_N_STEPS, frame))
    local, progress = np.array(steps.local_rotations), np.linspace(0.0, 1.0, _N_STEPS)[:, None]
    local[:, joints] = rotation.slerp(local[:, joints], target, progress)
    info = rig_info(word.clip.skeleton)
    wrist = info.arm_joints[3 * side + 2]
    _, positions = kinematics.forward(copy_unchecked(steps, local_rotations=local), [wrist])
    return float(np.linalg.norm(np.diff(positions[:, 0], axis=0), axis=-1).sum()) * info.sizes.unit.metres


def _avoid(word: AlignedWord, channel: str, last: int) -> AlignedWord:
    """Returns a word whose planned arm is led around the body and the other arm, between its entry and ``last``."""
    first, step = word.first_frame, max(1, round(PLAN.checked_s * word.clip.fps))
    if last - first < 2:
        return word
    side, checked = CHANNELS.index(channel), np.arange(first + 1, last, step)
    edges = word.retimed[first : first + 1], word.retimed[last : last + 1]
    deep = checked[depths(at_frames(word.retimed, checked), *edges, fixed=1 - side) > 0.0]
    if not len(deep):
        return word
    margin = round(PLAN.release_s * word.clip.fps)
    begin, stop = max(first, int(deep[0]) - margin), min(last, int(deep[-1]) + margin)
    edges = word.retimed[begin : begin + 1], word.retimed[stop : stop + 1]
    cleared = avoid_collisions(word.retimed[begin + 1 : stop], *edges, fixed=1 - side, most_tries=1).clip
    cleared = turn_elbow(cleared, *edges, side)
    joints = channel_joints(word.clip, channel)
    return _replace(word, channel, joints, begin + 1, cleared.local_rotations[:, joints])


def retract(word: AlignedWord, avoids: bool) -> AlignedWord:
    """Returns the last word of a sentence, whose planned arms go to rest as it ends; ``avoids``: as in
    ``carry_channels``.
    """
    recorded, n_frames = word.recorded, len(word.retimed)
    for channel in word.paths if recorded is not None else ():
        assert recorded is not None
        joints = channel_joints(word.clip, channel)
        begin = max(word.first_frame, n_frames - 1 - _retraction_frames(word))
        frames = np.arange(begin, n_frames)
        progress = minimum_jerk((frames - begin) / max(1, n_frames - 1 - begin))[:, None]
        local = word.retimed.local_rotations[begin:, joints]
        word = _replace(
            word, channel, joints, begin, rotation.slerp(local, recorded.local_rotations[begin:, joints], progress)
        )
        if avoids and channel in CHANNELS[:2]:
            word = _avoid(word, channel, n_frames - 1)
    return word


def _retraction_frames(word: AlignedWord) -> int:
    """Returns the number of frames in which the arms of a word go to rest at its end."""
    lift = arms(word.retimed if word.recorded is None else word.recorded).lift.max(axis=1)
    highest = float(lift[word.first_frame :].max())
    away = np.flatnonzero(lift > lift[-1] + PLAN.leaves_place * (highest - lift[-1]))
    return max(len(lift) - 1 - int(away[-1]) if len(away) else 0, round(PLAN.least_rise_s * word.clip.fps))
