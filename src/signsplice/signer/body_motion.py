"""Motion of head and trunk during a word, hands that go with the part of the body they are at, and what segments lay
over a trajectory: local movements of the hand, gestures of head and trunk.

The trunk turns and leans a little with the reach of the hands, and the head takes that back: it faces the addressee.
It goes to meet a hand at face or chin, the trunk does not (Tyrone and Mauk 2016). Nothing else moves it, since a look
away and a nod are grammar. All of it begins when the hands leave rest and is over when they are back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from signsplice.motion.arrays import FloatArray
from signsplice.signer import hand, pose, trajectory
from signsplice.signer.carrying import Nearness, carried, kept_away, nearness
from signsplice.signer.phonology import Local, Segment
from signsplice.signer.signer import Signer

if TYPE_CHECKING:
    from signsplice.signer.segment_plan import TimedSegment
    from signsplice.signer.timing import Events

_GAZE = 0.9
"""How much of the trunk's motion the head takes back, so that it keeps facing the addressee."""
_MEET_NOD_DEG, _MEET_TILT_DEG = 4.0, 4.0
"""How far the head goes to meet a hand in front of it, and one at its side."""
_MEET_CM, _MEET_FULL_CM = 10.0, 3.0
"""Distance of a hand from the head's skin from which the head goes to meet it, and at which it has done so."""


def add_body_motion(
    states: FloatArray, events: Events, signer: Signer, fps: float, near: Nearness | None = None
) -> FloatArray:
    """States (T, 65) of an isolated word with motion of head and trunk, where the signer's manner has any, and with
    hands that keep their places on the body, and their distance from its skin where they touch; with ``near``, which
    tells about where they are, their places alone.
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
        states[:, pose.HEAD] -= _GAZE * trunk
    if manner.head_to_hand:
        states[:, pose.HEAD] += manner.head_to_hand * level * _meeting(near, signer, fps)
    states = carried(states, near, right_handed)
    return kept_away(states, near, right_handed) if exact else states


def _level(n_frames: int, events: Events, fps: float) -> FloatArray:
    """Weights (T,) that rise from 0 at ``up`` and are back at 0 at ``down``, with no jump of their acceleration."""
    t = np.arange(n_frames)
    ramp = max(1.0, 0.22 * fps)
    return pose.smooth_step((t - events.up) / ramp) * pose.smooth_step((events.down - t) / ramp)


def _reaching(states: FloatArray, signer: Signer, fps: float) -> FloatArray:
    """Rotation vectors (T, 3) of a trunk that goes with the hands: it turns the shoulder of a hand that reaches
    forward to the front, turns to where both hands are, leans after far hands and away from the side of a high one.
    """
    wrists = pose.hands(states)[..., pose.WRIST] / signer.scale  # (T, 2, 3)
    raised = pose.smooth_step((wrists[..., 1] + 36.0) / 30.0)  # 0 where a hand hangs, 1 in signing space
    out, up, forward = (raised * wrists[..., k] for k in range(3))
    lean = 0.06 * (np.maximum(forward.max(axis=1), 10.0) - 10.0)
    turn = 0.10 * (forward[:, 0] - forward[:, 1]) + 0.12 * (out[:, 0] - out[:, 1])
    aside = 0.06 * ((raised * (up + 20.0))[:, 1] - (raised * (up + 20.0))[:, 0])
    return np.deg2rad(_smoothed(np.stack([lean, turn, aside], axis=-1), fps, 0.12))


def _meeting(near: Nearness, signer: Signer, fps: float) -> FloatArray:
    """Rotation vectors (T, 3) of a head that goes to meet the hands near it: forward to a hand at its front, to the
    side to a hand there.
    """
    weight = pose.smooth_step((_MEET_CM - near.head / signer.scale) / (_MEET_CM - _MEET_FULL_CM))  # (T, 2)
    wide = 2 * round(0.13 * fps) + 1  # early, and for as long as a repeated movement lasts
    weight = _smoothed(maximum_filter1d(weight, wide, axis=0, mode="nearest"), fps, 0.10)
    front = weight.max(axis=1)
    aside = -_smoothed(near.head_side, fps, 0.06) * weight
    return np.asarray(
        np.deg2rad(np.stack([_MEET_NOD_DEG * front, 0.0 * front, _MEET_TILT_DEG * aside.sum(axis=1)], axis=-1))
    )


def _smoothed(values: FloatArray, fps: float, seconds: float) -> FloatArray:
    return np.asarray(gaussian_filter1d(values, seconds * fps, axis=0, mode="nearest"))


def add_local_movement(states: FloatArray, segment: Segment, hands: str, signer: Signer, wrist: bool = True) -> None:
    """Add a segment's local movements to its states (n, 65), in place; ``wrist``: those of the wrist, too."""
    for which, local, phase in _locals(segment, hands):
        if wrist or local.kind not in _WRIST:
            _add_local(states[:, 27 * which : 27 * which + 27], local, phase, signer)


def _locals(segment: Segment, hands: str) -> Iterator[tuple[int, Local, float]]:
    """The local movements of a segment: which hand's (0 strong, 1 weak), and its phase."""
    mirrored = hands in ("symmetric", "alternating")
    for which, local in enumerate((segment.local, segment.local if mirrored else segment.weak_local)):
        while local is not None:
            yield which, local, np.pi if which == 1 and hands == "alternating" else 0.0
            local = local.also


_WRIST = {"twist": (0,), "swing": (1,), "nod": (2,), "stir": (1, 2)}
"""The angles that movements of the wrist change: twist of the forearm, deviation and flexion of the wrist."""


def wrist_movements(segments: Sequence[TimedSegment], hands: str, n_frames: int) -> tuple[FloatArray, FloatArray]:
    """What movements of the wrist add to these angles of both hands (T, 2, 3), radians, and how far they go to either
    side (T, 2, 3).
    """
    added, room = np.zeros((2, n_frames, 2, 3))
    for one in segments:
        for which, local, phase in _locals(one.segment, hands):
            angle, level = _cycles(local, one.end - one.begin + 1, phase)
            size = np.deg2rad(local.amplitude)
            for k, axis in enumerate(_WRIST.get(local.kind, ())):
                part = slice(one.begin, one.end + 1), which, axis
                added[part] += (-abs(size) * np.cos(angle) if k else size * np.sin(angle)) * level
                room[part] += abs(size) * level
    return added, room


def _cycles(local: Local, n: int, phase: float) -> tuple[FloatArray, FloatArray]:
    """The angle (n,) of a local movement in its cycle, and how far (n,) it is made: less at both ends."""
    angle = 2.0 * np.pi * local.cycles * np.linspace(0.0, 1.0, n) + phase
    return angle, trajectory.window(n, max(1, round(0.18 * n)))


def _add_local(hand_states: FloatArray, local: Local, phase: float, signer: Signer) -> None:
    """Add one hand's local movement to its states (n, 27), in place."""
    n = len(hand_states)
    angle, level = _cycles(local, n, phase)
    swing = np.sin(angle) * level
    amplitude = np.deg2rad(local.amplitude)
    if local.kind == "twist":
        hand_states[:, 3] += amplitude * swing
    elif local.kind == "nod":
        hand_states[:, 5] += amplitude * swing
    elif local.kind == "swing":
        hand_states[:, 4] += amplitude * swing
    elif local.kind == "stir":
        hand_states[:, 4] += amplitude * swing
        hand_states[:, 5] += abs(amplitude) * (1.0 - np.cos(angle)) * level
    elif local.kind == "tremble":
        hand_states[:, 0] += local.amplitude * signer.scale * swing
    fingers = hand_states[:, pose.FINGERS][:, :16].reshape(n, 4, 4)
    if local.kind == "wiggle":
        for f in range(4):
            one = np.sin(angle - 1.2 * f) * level
            fingers[:, f, 1] += amplitude * one
            fingers[:, f, 2] += 0.4 * amplitude * (one + level)
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
