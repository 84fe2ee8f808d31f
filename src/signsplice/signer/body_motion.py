"""Moves head and trunk during a word, keeps hands at their places on the body, and adds the overlays of segments: local
movements of the hand, gestures of head and trunk.

The trunk turns and leans a little with the reach of the hands; the head compensates and faces the addressee. The head
goes to meet a hand at face or chin, the trunk does not (Tyrone and Mauk 2016). Nothing else moves the head, since
looking away and nodding are grammar. This motion begins when the hands leave rest and ends when they are back.

Hands are given relative to the chest, and places on the body for an upright head and trunk. A part of the body carries
a hand rigidly if it touches, less with distance, not at all in free space. Hanging hands stay beside the hips.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from signsplice.body.collision import PosedCapsules
from signsplice.motion import Clip, FloatArray, rotation
from signsplice.motion.curves import between, sparse
from signsplice.motion.kinematics import forward, rest_positions
from signsplice.signer import hand, pose, trajectory
from signsplice.signer.figure import Figure
from signsplice.signer.phonology import MIRRORED_HANDS, Gesture, Local, Segment
from signsplice.signer.signer import JOINTS, Signer, skeleton
from signsplice.signer.timing import Events, TimedSegment


@dataclass(frozen=True)
class HandCarrying:
    """How far parts of the body carry hands, by distance."""

    free_cm: float = 14.0
    """Distance from the skin at which a hand is free, cm."""
    held_cm: float = 0.5
    """Distance from the skin below which a hand is carried fully, cm."""
    weight_decay_cm: float = 1.0
    """Additional distance of a part of the body that divides its weight by e, cm."""
    together_cm: float = 8.0
    """Distance of two hands up to which they are carried alike, cm."""
    hanging_cm: tuple[float, float] = (24.0, 38.0)
    """Distances below the chest at which a hand begins to hang, and hangs fully, cm."""
    touch_cm: float = 2.0
    """Distance from the skin up to which it is kept although the wrist's limits would change it, cm."""
    correction_rounds: int = 3
    """Number of corrections of that distance."""
    correction_smoothing_frames: float = 1.0
    """Standard deviation of the Gaussian that spreads a correction in time, frames."""


@dataclass(frozen=True)
class HeadAndTrunk:
    """Motion of head and trunk with the hands, and the timing of gestures."""

    head_compensation: float = 0.9
    """Fraction of the trunk's motion that the head compensates to keep facing the addressee."""
    meeting_nod_deg: float = 4.0
    """Nod of the head to meet a hand in front of it, degrees."""
    meeting_tilt_deg: float = 4.0
    """Tilt of the head to meet a hand at its side, degrees."""
    meeting_begin_cm: float = 10.0
    """Distance of a hand from the head's skin at which the head begins to meet it, cm."""
    meeting_full_cm: float = 3.0
    """Distance of a hand from the head's skin at which the head has moved fully, cm."""
    gesture_ramp_s: float = 0.22
    """Time in which a gesture rises, and falls, seconds."""
    fastest_cycles_hz: float = 2.5
    """Largest number of nods or shakes a second."""


_CARRYING = HandCarrying()
_HEAD_AND_TRUNK = HeadAndTrunk()

_CARRIERS = ("Head", "Neck", "Spine2", "Hips")
"""Joints that carry parts of the body, and so hands. The chest carries the parts of all other joints."""
_HEAD = 0
"""Index of the head in ``_CARRIERS``."""
_CHEST = 2
"""Index of the chest in ``_CARRIERS``."""
_HIPS = 3
"""Index of the hips in ``_CARRIERS``."""


@dataclass(frozen=True)
class Nearness:
    """Positions of the hands (strong, weak) of an upright right-handed signer relative to the body.

    weights: (T, 2, 4) how far head, neck, chest and hips carry each hand; the rest is free
    clearances: (T, 2, 4) distance of each hand's skin from that of each of these, cm, negative inside
    apart: (T,) distance of the hands from one another or a forearm, cm, at most ``together_cm`` by the signer's scale
    head_side: (T, 2) side of the head at which each hand is, from -1 (strong side) over 0 (front) to 1 (weak side)
    """

    weights: FloatArray
    clearances: FloatArray
    apart: FloatArray
    head_side: FloatArray

    @property
    def head(self) -> FloatArray:
        """Distance (T, 2) of each hand's skin from the head's, cm."""
        return self.clearances[..., _HEAD]


def nearness(states: FloatArray, signer: Signer, most: float = np.inf) -> Nearness:
    """``Nearness`` of the hands of states (T, 65) with head and trunk made upright. ``most``, cm, at least
    ``free_cm`` times the signer's scale, limits the distances; a hanging hand counts as this far.
    """
    upright = states.copy()
    upright[:, 54:] = 0.0
    capsules = Figure(upright, signer).pose_arms(upright).capsules
    begins, hangs = _CARRYING.hanging_cm
    height = pose.hands(states)[..., 1] / signer.scale
    hanging = pose.smooth_step((-height - begins) / (hangs - begins))[..., None]
    clearances, directions = _clearances(capsules, most, hanging[..., 0] < 1.0 if np.isfinite(most) else None)
    hand_distance = _apart(capsules, _CARRYING.together_cm * signer.scale)
    weights = _weights(clearances / signer.scale, hand_distance / signer.scale)
    weights = hanging * np.eye(len(_CARRIERS))[_HIPS] + (1.0 - hanging) * weights
    return Nearness(weights, clearances, hand_distance, directions[..., _HEAD, 0])


def approximate_nearness(states: FloatArray, signer: Signer, fps: float) -> Nearness:
    """``nearness`` about 8 times a second, interpolated linearly, and limited to the range that carries hands."""
    frames = sparse(len(states), fps / 7.5)
    sampled = nearness(states[frames], signer, _CARRYING.free_cm * signer.scale)
    return Nearness(*(between(x, frames) for x in vars(sampled).values()))


def _clearances(
    capsules: PosedCapsules, most: float = np.inf, where: NDArray[np.bool_] | None = None
) -> tuple[FloatArray, FloatArray]:
    """Distances (T, 2, 4) of both hands' skin from that of the carriers, cm, and the directions (T, 2, 4, 3) away from
    it in the chest's axes; ``most`` and 0 if all are farther, or outside ``where`` (T, 2).
    """
    body, names = capsules.body, list(JOINTS)
    solid = (*body.groups.head, *body.groups.trunk)
    carriers = [n if (n := names[body.joints[k]]) in _CARRIERS else "Spine2" for k in solid]
    parts = [[k for k, n in zip(solid, carriers, strict=True) if n == name] for name in _CARRIERS]
    size = (len(capsules.starts), 2, len(_CARRIERS))
    clearances, directions = np.full(size, most), np.zeros((*size, 3))
    for n, group in enumerate((body.groups.right, body.groups.left)):
        rows = slice(None) if where is None else where[:, n]
        clearances[rows, n], directions[rows, n] = capsules[rows].nearest(group, parts, most)
    return clearances, directions


def _apart(capsules: PosedCapsules, most: float) -> FloatArray:
    """Distances (T,) of the hands from one another or a forearm, cm, at most ``most``."""
    body = capsules.body
    hands = body.groups.right, body.groups.left
    parts = [*zip(body.parts, body.sides, strict=True)]
    arms = [[n for n, part in enumerate(parts) if part == ("cuff", side)] for side in ("right", "left")]
    depths = [capsules.nearest(hands[n], ((*hands[1 - n], *arms[1 - n]),), most)[0][:, 0] for n in (0, 1)]
    return np.minimum(*depths)


def _weights(clearances: FloatArray, apart: FloatArray) -> FloatArray:
    """Weights (T, 2, 4) from the distances of hands to parts of the body (T, 2, 4) and to one another (T,), cm."""
    nearest = clearances.min(axis=-1, keepdims=True)
    weights = np.exp((nearest - clearances) / _CARRYING.weight_decay_cm)
    weights /= weights.sum(axis=-1, keepdims=True)
    weights = weights * pose.smooth_step((_CARRYING.free_cm - nearest) / (_CARRYING.free_cm - _CARRYING.held_cm))
    together_cm = _CARRYING.together_cm
    alike = 0.5 * pose.smooth_step((together_cm - apart) / (together_cm - _CARRYING.held_cm))[:, None, None]
    return np.asarray((1.0 - alike) * weights + alike * weights[:, ::-1])


def attach_hands_to_body(states: FloatArray, near: Nearness, signer: Signer) -> FloatArray:
    """Moves the hands of a right-handed signer's states (T, 65) with the head and trunk of ``states``."""
    turns, places = _carriers(states, signer)
    rest = rest_positions(skeleton(signer))[[JOINTS[name] for name in _CARRIERS]]
    rest = rest - rest[_CHEST]
    moved = states.copy()
    quats = pose.hand_rotations(states, signer)
    for n, (mirror, mirror_quat) in enumerate(zip(pose.MIRRORS, (np.ones(4), pose.MIRROR_QUAT), strict=True)):
        wrist = pose.hands(states)[:, n, pose.WRIST] * mirror
        moves = rotation.rotate(turns, wrist[:, None] - rest) + places - wrist[:, None]  # (T, 4, 3)
        wrist = (wrist + np.einsum("tk,tkc->tc", near.weights[:, n], moves)) * mirror
        turn = rotation.exp(np.einsum("tk,tkc->tc", near.weights[:, n], rotation.log(turns)))
        quat = rotation.multiply(turn, quats[:, n] * mirror_quat) * mirror_quat
        hand = pose.hands(moved)[:, n]
        hand[:, pose.WRIST], hand[:, pose.ROTVEC] = wrist, pose.hand_rotvecs(wrist, quat, signer)
    return moved


def _carriers(states: FloatArray, signer: Signer) -> tuple[FloatArray, FloatArray]:
    """Rotations (T, 4, 4) and positions (T, 4, 3), cm, of the carriers in the chest's axes and from the chest."""
    joints = [JOINTS[name] for name in _CARRIERS]
    upright = Clip(skeleton(signer), *pose.without_arms(states, signer), 30.0)
    rotations, positions = forward(upright, joints)
    chest = rotations[:, _CHEST]
    turns = rotation.from_matrix(np.einsum("tba,tkbc->tkac", chest, rotations))
    return turns, np.einsum("tba,tkb->tka", chest, positions - positions[:, _CHEST, None])


def keep_distances(states: FloatArray, near: Nearness, signer: Signer) -> FloatArray:
    """Restores small distances of hands from the skin in states (T, 65): a wrist at its limits does not follow the body
    fully.
    """
    states = states.copy()
    nearest = near.clearances.argmin(axis=-1)[..., None]  # (T, 2, 1)
    targets = np.take_along_axis(near.clearances, nearest, axis=-1)
    touch_cm = _CARRYING.touch_cm
    weight = pose.smooth_step((touch_cm - targets / signer.scale) / (touch_cm - _CARRYING.held_cm))
    frames = weight.any(axis=(1, 2))
    pushes = np.zeros((len(states), 2, 3))
    nearest, targets, weight = nearest[frames], targets[frames], weight[frames]
    if not frames.any():
        return states
    figure = Figure(states[frames], signer)
    for _ in range(_CARRYING.correction_rounds):
        clearances, directions = _clearances(figure.pose_arms(states[frames]).capsules)
        missing = weight * (targets - np.take_along_axis(clearances, nearest, axis=-1))  # (F, 2, 1)
        pushes[frames] = missing * np.take_along_axis(directions, nearest[..., None], axis=2)[:, :, 0]
        push = gaussian_filter1d(pushes, _CARRYING.correction_smoothing_frames, axis=0, mode="nearest")
        pose.hands(states)[..., pose.WRIST] += push * pose.MIRRORS
    return states


def add_body_motion(
    states: FloatArray, events: Events, signer: Signer, fps: float, near: Nearness | None = None
) -> FloatArray:
    """Adds motion of head and trunk to the states (T, 65) of a word if the signer's manner has any. Hands keep their
    places on the body, and touching hands their distance from its skin; with ``near``, an approximation, they keep
    their places alone.
    """
    manner = signer.manner
    if not manner.body_motion and not manner.head_to_hand:
        return states
    right_handed = replace(signer, left_handed=False)
    exact, near = near is None, near or nearness(states, right_handed)
    states = states.copy()
    level = _level(len(states), events, fps)[:, None]
    if manner.body_motion:
        trunk = manner.body_motion * level * _reaching(states, signer, fps)
        states[:, pose.TRUNK] += trunk
        states[:, pose.HEAD] -= _HEAD_AND_TRUNK.head_compensation * trunk
    if manner.head_to_hand:
        states[:, pose.HEAD] += manner.head_to_hand * level * _meeting(near, signer, fps)
    states = attach_hands_to_body(states, near, right_handed)
    return keep_distances(states, near, right_handed) if exact else states


def _level(n_frames: int, events: Events, fps: float) -> FloatArray:
    """Weights (T,) that rise from 0 at ``up`` and fall to 0 at ``down``, with continuous acceleration."""
    t = np.arange(n_frames)
    ramp = max(1.0, 0.22 * fps)
    return pose.smooth_step((t - events.up) / ramp) * pose.smooth_step((events.down - t) / ramp)


def _reaching(states: FloatArray, signer: Signer, fps: float) -> FloatArray:
    """Rotation vectors (T, 3) of a trunk that follows the hands: it turns the shoulder of a hand that reaches forward
    to the front, turns towards both hands, leans after far hands and away from the side of a high one.
    """
    wrists = pose.hands(states)[..., pose.WRIST] / signer.scale  # (T, 2, 3)
    raised = pose.smooth_step((wrists[..., 1] + 36.0) / 30.0)  # 0 for a hanging hand, 1 in signing space
    outward, up, forward = (raised * wrists[..., k] for k in range(3))
    lean = 0.06 * (np.maximum(forward.max(axis=1), 10.0) - 10.0)
    turn = 0.10 * (forward[:, 0] - forward[:, 1]) + 0.12 * (outward[:, 0] - outward[:, 1])
    aside = 0.06 * ((raised * (up + 20.0))[:, 1] - (raised * (up + 20.0))[:, 0])
    return np.deg2rad(_smooth(np.stack([lean, turn, aside], axis=-1), fps, 0.12))


def _meeting(near: Nearness, signer: Signer, fps: float) -> FloatArray:
    """Rotation vectors (T, 3) of a head that goes to meet the hands near it: forwards to a hand in front, sideways to a
    hand at its side.
    """
    begin, full = _HEAD_AND_TRUNK.meeting_begin_cm, _HEAD_AND_TRUNK.meeting_full_cm
    weight = pose.smooth_step((begin - near.head / signer.scale) / (begin - full))  # (T, 2)
    wide = 2 * round(0.13 * fps) + 1  # early, and for as long as a repeated movement lasts
    weight = _smooth(maximum_filter1d(weight, wide, axis=0, mode="nearest"), fps, 0.10)
    front = weight.max(axis=1)
    aside = -_smooth(near.head_side, fps, 0.06) * weight
    nod, tilt = _HEAD_AND_TRUNK.meeting_nod_deg * front, _HEAD_AND_TRUNK.meeting_tilt_deg * aside.sum(axis=1)
    return np.asarray(np.deg2rad(np.stack([nod, 0.0 * front, tilt], axis=-1)))


def _smooth(values: FloatArray, fps: float, seconds: float) -> FloatArray:
    return np.asarray(gaussian_filter1d(values, seconds * fps, axis=0, mode="nearest"))


def add_local_movement(states: FloatArray, segment: Segment, hands: str, signer: Signer, wrist: bool = True) -> None:
    """Add a segment's local movements to its states (n, 65), in place; ``wrist``: include those of the wrist."""
    for which, local, phase in _locals(segment, hands):
        if wrist or local.kind not in _WRIST_ANGLES:
            _add_local(states[:, 27 * which : 27 * which + 27], local, phase, signer)


def _locals(segment: Segment, hands: str) -> Iterator[tuple[int, Local, float]]:
    """Yields the hand (0 strong, 1 weak), the movement and the phase of each local movement of a segment."""
    mirrored = hands in MIRRORED_HANDS
    for which, local in enumerate((segment.local, segment.local if mirrored else segment.weak_local)):
        while local is not None:
            yield which, local, np.pi if which == 1 and hands == "alternating" else 0.0
            local = local.also


_WRIST_ANGLES = {"twist": (0,), "swing": (1,), "nod": (2,), "stir": (1, 2)}
"""Indices of the angles that wrist movements change: 0 forearm twist, 1 wrist deviation, 2 wrist flexion."""


def wrist_movements(segments: Sequence[TimedSegment], hands: str, n_frames: int) -> tuple[FloatArray, FloatArray]:
    """Angles (T, 2, 3) that wrist movements add to both hands, and their amplitudes (T, 2, 3), radians."""
    added, room = np.zeros((2, n_frames, 2, 3))
    for timed in segments:
        for which, local, phase in _locals(timed.segment, hands):
            angle, level = _cycles(local, timed.end - timed.begin + 1, phase)
            size = np.deg2rad(local.amplitude)
            for k, axis in enumerate(_WRIST_ANGLES.get(local.kind, ())):
                part = slice(timed.begin, timed.end + 1), which, axis
                added[part] += (-abs(size) * np.cos(angle) if k else size * np.sin(angle)) * level
                room[part] += abs(size) * level
    return added, room


def _cycles(local: Local, n: int, phase: float) -> tuple[FloatArray, FloatArray]:
    """The phase angle (n,) of a local movement, and its weight (n,), which falls at both ends."""
    angle = 2.0 * np.pi * local.cycles * np.linspace(0.0, 1.0, n) + phase
    return angle, trajectory.window(n, max(1, round(0.18 * n)))


def _add_local(hand_states: FloatArray, local: Local, phase: float, signer: Signer) -> None:
    """Add one hand's local movement to its states (n, 27), in place."""
    n = len(hand_states)
    angle, level = _cycles(local, n, phase)
    swing = np.sin(angle) * level
    amplitude = np.deg2rad(local.amplitude)
    for k, axis in enumerate(_WRIST_ANGLES.get(local.kind, ())):
        hand_states[:, 3 + axis] += abs(amplitude) * (1.0 - np.cos(angle)) * level if k else amplitude * swing
    if local.kind == "tremble":
        hand_states[:, 0] += local.amplitude * signer.scale * swing
    fingers = hand_states[:, pose.FINGERS][:, :16].reshape(n, 4, 4)
    if local.kind == "wiggle":
        for f in range(4):
            flutter = np.sin(angle - 1.2 * f) * level
            fingers[:, f, 1] += amplitude * flutter
            fingers[:, f, 2] += 0.4 * amplitude * (flutter + level)
    elif local.kind == "bend":
        close = 0.5 * (1.0 - np.cos(angle)) * level
        fingers[:, :, 1] += (amplitude * close)[:, None]
    angles = hand_states[:, pose.FINGERS]
    np.clip(angles, hand.LIMITS[:, 0], hand.LIMITS[:, 1], out=angles)


def add_gesture(states: FloatArray, segment: Segment, begin: int, end: int, fps: float) -> None:
    """Add a segment's head and trunk movement to states (T, 65) of the whole word, in place.

    The gesture begins a little before frame ``begin`` and ends a little after ``end``.
    """
    margin = round(0.2 * fps)
    frames = slice(max(begin - margin, 0), min(end + margin + 1, len(states)))
    n = frames.stop - frames.start
    u, level = np.linspace(0.0, 1.0, n), trajectory.window(n, margin + 1)
    head, trunk = states[frames, pose.HEAD], states[frames, pose.TRUNK]
    cycles = max(1.0, round(2.2 * n / fps))
    swing = np.sin(2.0 * np.pi * cycles * u) * level
    if segment.head == "nod":
        head[:, 0] += np.deg2rad(9.0) * 0.5 * (1.0 - np.cos(2.0 * np.pi * cycles * u)) * level
    elif segment.head == "shake":
        head[:, 1] += np.deg2rad(11.0) * swing
    elif segment.head:
        head[:, 2] += np.deg2rad(8.0 if segment.head == "tilt" else -8.0) * level
    lean = {"fwd": (0, 6.0), "back": (0, -5.0), "out": (2, 5.0), "in": (2, -5.0)}
    if segment.trunk:
        axis, angle = lean[segment.trunk]
        trunk[:, axis] += np.deg2rad(angle) * level


def add_gestures(states: FloatArray, gestures: tuple[Gesture, ...], events: Events, fps: float) -> None:
    """Add gestures to the states (T, 65) of a word of a right-handed signer, in place."""
    for gesture in gestures:
        height = gesture_level(len(states), fps, (events.start, events.end), gesture, bool(gesture.degrees[1]))
        part = pose.HEAD if gesture.part == "head" else pose.TRUNK
        states[:, part] += height[:, None] * np.deg2rad(gesture.degrees)


def gesture_level(
    n_frames: int, fps: float, hands: tuple[int, int], gesture: Gesture, swings: bool = False
) -> FloatArray:
    """Weight (T,) of a gesture over time; the hands sign between the two frames ``hands``. ``swings``: a gesture with
    cycles goes to both sides instead of there and back.
    """
    t = np.arange(n_frames) / fps
    start, seconds = hands[0] / fps, max((hands[1] - hands[0]) / fps, 0.3)
    first, last = start + gesture.begin * seconds, start + gesture.end * seconds
    ramp_s = _HEAD_AND_TRUNK.gesture_ramp_s
    height = pose.smooth_step((t - first + ramp_s) / ramp_s) * pose.smooth_step((last + ramp_s - t) / ramp_s)
    if gesture.cycles:
        most = float(np.floor(_HEAD_AND_TRUNK.fastest_cycles_hz * (last - first)))
        cycles = max(1.0, min(gesture.cycles, most))
        phase = 2.0 * np.pi * cycles * np.clip((t - first) / (last - first), 0.0, 1.0)
        height = height * (np.sin(phase) if swings else 0.5 - 0.5 * np.cos(phase))
    return height
