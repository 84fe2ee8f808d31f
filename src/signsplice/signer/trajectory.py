"""States over time: minimum-jerk trajectories through knots, reaches between two motions, small oscillations, and a low
pass that preserves touches and repeated movements.

Each finger has its own timing in a sign's changes of handshape and in reaches.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, make_interp_spline

from signsplice.motion import FloatArray
from signsplice.signer import hand, pose
from signsplice.signer.signer import PLAIN, Signer, shoulder, stream


@dataclass(frozen=True)
class LowPass:
    """Limits of the smoothing of a word's states near repeated movements and touches."""

    pass_share: float = 0.18
    """Largest standard deviation of the smoothing over the duration of a movement's shortest pass: a repeated movement
    keeps 85 % of its size."""
    touch_frames: float = 0.4
    """Largest standard deviation of the smoothing at a touch, frames: hands come and go as straight as before."""
    correction_reach: float = 4.0
    """Distance from a touch in time at which the correction of its posture ends, in standard deviations."""


@dataclass(frozen=True)
class HandPaths:
    """Speed and form of paths between postures, and the timing of fingers on them."""

    largest_delay_frames: float = 1.2
    """Largest lead or lag of a finger relative to the hand within a sign, frames of 30 a second."""
    hand_advance: float = 0.12
    """Difference between reaches in the timing of all fingers of a hand: height of a bump on time, 0 to 1."""
    finger_advance: float = 0.15
    """Further difference in the timing of a single finger: height of a bump on time, 0 to 1."""
    largest_advance: float = 0.27
    """Largest advance of time; from 0.29 on, fingers would go back."""
    shoulder_width_cm: float = 36.0
    """Shoulder width of the standard body, the unit of the travel law, cm."""
    flow: float = 0.6
    """Speed of hands at a first or last knot without a stop, over the speed of the path there."""
    largest_lead: float = 0.15
    """Largest lead of a part of a state at half time of a reach: the largest that never reverses."""
    falling_weak_lead: float = -0.08
    """Lead of a weak hand that goes down: it lags."""
    shoulder_distance_cm: float = 23.0
    """Least distance at which a wrist passes its shoulder, cm; any nearer, the elbow would have to swing round."""
    largest_shoulder_bow_cm: float = 16.0
    """Largest bow of a path around the shoulder, cm; plain motion has no limit and sometimes throws a hand forward."""


_LOW_PASS = LowPass()
_PATHS = HandPaths()


def low_passed(
    states: FloatArray, deviation: float, passes: Sequence[tuple[int, int]] = (), touches: Sequence[int] = ()
) -> FloatArray:
    """Smooths states (T, 65) in time by a Gaussian of standard deviation ``deviation``, frames.

    The first and the last frame stay unchanged. The smoothing is weaker within repeated ``passes``, [begin, end] each,
    near both ends of the word, and near the frames ``touches``. Those frames stay unchanged; a correction that fades
    with distance moves the frames around them.
    """
    n = len(states)
    width = _deviations(n, deviation, passes, touches)
    frames = np.arange(n)
    weights = (frames - frames[:, None]) / np.maximum(width, 1e-3)[:, None]
    weights *= weights
    weights *= -0.5
    np.exp(weights, out=weights)
    weights /= weights.sum(axis=1, keepdims=True)
    smooth = weights @ states
    centres = np.array(sorted(set(touches)), np.intp)
    if not len(centres):
        return np.asarray(smooth)
    radius = max(_LOW_PASS.correction_reach * deviation, 2.0)
    factors = np.linalg.solve(wendland(centres, centres, radius), states[centres] - smooth[centres])
    return np.asarray(smooth + wendland(frames, centres, radius) @ factors)


def _deviations(
    n_frames: int, deviation: float, passes: Sequence[tuple[int, int]], touches: Sequence[int]
) -> FloatArray:
    """The smoothing's standard deviation (T,) in each frame, frames; it changes by at most 1 in 3 frames."""
    frames = np.arange(n_frames)
    widths = np.minimum(deviation, np.minimum(frames, n_frames - 1 - frames) / 3.0)
    if len(passes) > 1:
        least = _LOW_PASS.pass_share * min(stop - begin for begin, stop in passes)
        distance = np.maximum(np.maximum(passes[0][0] - frames, frames - passes[-1][1]), 0)
        widths = np.minimum(widths, least + distance / 3.0)
    for touch in touches:
        widths = np.minimum(widths, _LOW_PASS.touch_frames + np.abs(frames - touch) / 3.0)
    return np.asarray(widths, np.float64)


def wendland(frames: NDArray[np.intp], centres: NDArray[np.intp], radius: float) -> FloatArray:
    """Wendland's function (F, C) of the distance in frames: 1 at 0, 0 from ``radius`` on, twice differentiable, and
    positive definite, so that it can interpolate any values at the centres.
    """
    distance = np.clip(np.abs(frames[:, None] - centres) / radius, 0.0, 1.0)
    return np.asarray((1.0 - distance) ** 4 * (4.0 * distance + 1.0))


_PER_FINGER = (4, 4, 4, 4, 5)
"""How many of ``hand.ANGLES`` belong to each finger, the thumb last."""
_HAND_STATE_SCALES = np.concatenate([np.full(3, 15.0), np.full(24, 0.5)])
"""Usual sizes of the numbers of a hand state: cm of the wrist, then radians."""


def delays(signer: Signer, gloss: str, take: int) -> FloatArray:
    """Delays (2, 21) of the finger angles of both hands within a word, frames of 30 a second.

    Half of a delay is the signer's habit, half belongs to the word.
    """
    rngs = stream("finger_stagger", signer.name), stream("finger_stagger", signer.name, gloss, take)
    fingers = sum(0.5 * rng.uniform(-1.0, 1.0, (2, 5)) for rng in rngs)
    return np.repeat(signer.manner.finger_stagger * _PATHS.largest_delay_frames * fingers, _PER_FINGER, axis=1)


def advances(start: FloatArray, end: FloatArray, leads: FloatArray, signer: Signer) -> FloatArray:
    """Advance (65,) of the time of each number at half time of a reach between two states, as a fraction.

    It is a smooth function of both states, so that equal seams get equal advances and similar seams similar ones; waves
    of random phase and direction make it differ between reaches and fingers.

    leads: lead of each finger angle's progress at half time, (21,)
    """
    advance = np.zeros(pose.SIZE)
    for which, first in enumerate((0, 27)):
        seen = np.concatenate([s[first : first + 27] / _HAND_STATE_SCALES for s in (start, end)])
        rng = stream("finger_stagger", signer.name, "reach", which)
        waves = np.sin(0.5 * rng.standard_normal((6, len(seen))) @ seen + 2.0 * np.pi * rng.random(6))
        spread = np.repeat(_PATHS.hand_advance * waves[0] + _PATHS.finger_advance * waves[1:], _PER_FINGER)
        usual = leads / 1.875  # the slope of a minimum-jerk movement at half time
        fingers = advance[first : first + 27][pose.FINGERS]
        most = _PATHS.largest_advance
        fingers += np.clip(usual + signer.manner.finger_stagger * spread, -most, most)
    return advance


def travel_seconds(travel_cm: float, signer: Signer) -> float:
    """Duration, seconds, of a reach of ``travel_cm`` by the travel law T = 51 + 149 log2(1 + D / 0.15) ms, D in
    shoulder widths, over the signer's tempo (fitted to 124 gaps of the DGS Corpus).
    """
    widths = travel_cm / (_PATHS.shoulder_width_cm * signer.scale)
    return (0.051 + 0.149 * float(np.log2(1.0 + widths / 0.15))) / signer.tempo


@dataclass(frozen=True)
class Knot:
    """A state that a trajectory passes.

    frame: its frame; a fraction lies between two frames
    state: the state, (65,)
    stop: whether everything comes to rest there; otherwise the first and the last knot are passed at speed
    """

    frame: float
    state: FloatArray
    stop: bool


def through(knots: Sequence[Knot]) -> FloatArray:
    """Minimum-jerk states (T, 65) of every whole frame from the first knot to the last: between stops the quintic
    spline through the knots, at rest at both ends (Flash and Hogan 1985 with via points) or at speed at the first and
    the last knot.
    """
    parts = [knots[0].state[None]] if knots[0].frame == int(knots[0].frame) else []
    begin = 0
    for n in range(1, len(knots)):
        if not (knots[n].stop or n == len(knots) - 1):
            continue
        piece = knots[begin : n + 1]
        frames = np.array([knot.frame for knot in piece], np.float64)
        inner = np.arange(math.floor(piece[0].frame) + 1, math.floor(piece[-1].frame) + 1)
        if len(piece) == 2 and np.array_equal(piece[0].state, piece[1].state):
            parts.append(np.broadcast_to(piece[0].state, (len(inner), pose.SIZE)))
        elif len(inner):
            states = np.array([knot.state for knot in piece])
            speeds = (_speed(frames, states), _speed(frames[::-1], states[::-1]))
            ends = [
                [(1, np.zeros(pose.SIZE) if knot.stop else _PATHS.flow * speed), (2, np.zeros(pose.SIZE))]
                for knot, speed in zip((piece[0], piece[-1]), speeds, strict=True)
            ]
            parts.append(make_interp_spline(frames, states, k=5, bc_type=tuple(ends))(inner))  # type: ignore[arg-type]
        begin = n
    return np.concatenate(parts)


def _speed(frames: FloatArray, states: FloatArray) -> FloatArray:
    """Velocity (65,), per frame, at the first knot: of the parabola through three knots, or of the chord of two."""
    slopes = np.diff(states[:3], axis=0) / np.diff(frames[:3])[:, None]
    if len(slopes) < 2:
        return np.asarray(slopes[0])
    share = (frames[1] - frames[0]) / (frames[2] - frames[0])
    return np.asarray(slopes[0] + share * (slopes[0] - slopes[1]))


_HALFWAY_LEADS = np.concatenate([np.zeros(3), np.full(3, 0.04), np.repeat([0.14, 0.12, 0.10, 0.09, 0.13], _PER_FINGER)])
"""Lead of each number of a hand state at half time of a reach: the height of a bump on its progress. 0.15 is progress
0.65 at half time. Fingers form early, one after another, as the hand rotates."""
_BOW_DIRECTION = np.array([-0.25, 0.35, 0.9])
"""Direction of a reach's bow: outwards, up and forward, away from the body."""


def bump(u: FloatArray) -> FloatArray:
    """A bump (...) of height 1 over [0, 1] with value, slope and curvature 0 at both ends: 64 u^3 (1 - u)^3."""
    return np.asarray(64.0 * (u * (1.0 - u)) ** 3)


def reach(
    before: FloatArray, after: FloatArray, n_frames: int, signer: Signer, at: FloatArray | None = None
) -> FloatArray:
    """The ``n_frames`` states between two motions: the end of ``before`` (.., 65) and the start of ``after`` (.., 65).

    The quintic (minimum jerk) takes position and velocity from the two ends (one-sided differences over three frames)
    and 0.4 of the acceleration, since the full acceleration makes long detours. Hands bow outwards by the signer's
    ``arch``, fingers lead, each in its own time, and a weak hand that goes down lags. All of these fade out at both
    ends, with their first two derivatives. ``at``: times of the frames between both ends, 0 to 1, instead of even ones.
    """
    steps = n_frames + 1
    u = (np.arange(1, n_frames + 1) / steps if at is None else at)[:, None]  # (n, 1)
    start, end = before[-1], after[0]
    hill = bump(u)
    change = end - start
    lead = np.concatenate([_HALFWAY_LEADS, _HALFWAY_LEADS, np.zeros(pose.SIZE - 54)])
    lead[lead > 0.05] -= signer.lag
    times = u
    if signer.manner.finger_stagger:  # fingers are advanced in time, which leaves more room than a lead
        times = u + hill * advances(start, end, lead[pose.FINGERS], signer)  # (n, 65)
        lead[6:27] = lead[33:54] = 0.0
    states = joining(before, after, steps, times)
    if change[27 + 1] < -12.0:  # the weak hand goes down
        lead[27:30] = _PATHS.falling_weak_lead
    states += hill * np.minimum(lead, _PATHS.largest_lead) * change
    for first in (0, 27):
        wrist = slice(first, first + 3)
        length = float(np.linalg.norm(change[wrist]))
        if length > 1e-9:
            bow = _BOW_DIRECTION - (_BOW_DIRECTION @ change[wrist]) * change[wrist] / length**2
            states[:, wrist] += hill * signer.arch * length * bow
            _avoid_shoulder(states[:, wrist], hill, start[wrist], end[wrist], signer)
    clip_fingers(states)
    return states


def clip_fingers(states: FloatArray) -> None:
    """Clip the finger angles of states (T, 65) to their limits, in place."""
    fingers = pose.hands(states)[..., pose.FINGERS]
    np.clip(fingers, hand.LIMITS[:, 0], hand.LIMITS[:, 1], out=fingers)


def from_rest_to_rest(knots: Sequence[Knot], rest: FloatArray, up: int, down: int, signer: Signer) -> FloatArray:
    """States of every whole frame of the preparation (``up`` frames to the first knot), the trajectory, and the
    retraction (``down`` frames from the last knot).
    """
    core, still = through(knots), _still(rest)
    first, last = knots[0].frame, knots[-1].frame
    end = core[-1] if last == round(last) else knots[-1].state
    rising = np.arange(1.0, up + 1 + math.ceil(first)) / (up + 1 + first)
    stop = round(last) + down + 1
    falling = (np.arange(math.floor(last) + 1.0, stop) - last) / (stop - last)
    preparation = reach(still, _passing(knots[0].state, core[1] - core[0], knots[0].stop), up, signer, rising)
    retraction = reach(_passing(end, core[-2] - core[-1], knots[-1].stop)[::-1], still, down, signer, falling)
    return np.concatenate([preparation, core, retraction])


def _still(state: FloatArray) -> FloatArray:
    return np.broadcast_to(state, (3, pose.SIZE))


def _passing(state: FloatArray, step: FloatArray, stop: bool) -> FloatArray:
    """Three frames (3, 65) from a state on: at rest, or with a step from frame to frame."""
    return _still(state) if stop else state + np.arange(3)[:, None] * step


_SHOULDER_BOW_DIRECTION = np.array([-0.35, 0.0, 0.94])
"""Direction in which a path bows around the shoulder: outwards and forward."""


def _avoid_shoulder(path: FloatArray, hill: FloatArray, start: FloatArray, end: FloatArray, signer: Signer) -> None:
    """Bow a wrist's path (n, 3) forward and out, in place, if it would come nearer to the shoulder than its ends."""
    centre = shoulder(signer) * signer.scale
    ends = min(float(np.linalg.norm(start - centre)), float(np.linalg.norm(end - centre)))
    least = min(_PATHS.shoulder_distance_cm * signer.scale, ends)
    remaining = np.inf if signer.manner == PLAIN else _PATHS.largest_shoulder_bow_cm * signer.scale
    for _ in range(4):
        lack = least - np.linalg.norm(path - centre, axis=-1)
        if lack.max() <= 0.0:
            break
        bow = min(float((lack / np.maximum(hill[:, 0], 0.2)).max()), remaining)
        remaining -= bow
        path += hill * bow * _SHOULDER_BOW_DIRECTION


def joining(before: FloatArray, after: FloatArray, steps: int, u: FloatArray) -> FloatArray:
    """The quintic (n, K) from the end of ``before`` (.., K) to the start of ``after`` (.., K), which are ``steps``
    frames apart, at times ``u`` (n, 1 or K), 0 to 1.
    """
    arriving = tuple((-1) ** n * d for n, d in enumerate(_end_derivatives(after[2::-1])))
    return _quintic(_end_derivatives(before[-3:]), arriving, steps, u)


def _end_derivatives(frames: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """State, velocity and acceleration (per frame) at the last of up to three frames."""
    zero = np.zeros(frames.shape[1])
    if len(frames) < 2:
        return frames[-1], zero, zero
    if len(frames) < 3:
        return frames[-1], frames[-1] - frames[-2], zero
    a, b, c = frames[-3:]
    return c, 1.5 * c - 2.0 * b + 0.5 * a, 0.4 * (c - 2.0 * b + a)


def _quintic(start: tuple[FloatArray, ...], end: tuple[FloatArray, ...], steps: int, u: FloatArray) -> FloatArray:
    """The polynomial of degree 5 over [0, 1] with given state, velocity and acceleration (per frame) at both ends."""
    (p, v, a), (q, w, b) = start, end
    v, w, a, b = v * steps, w * steps, a * steps**2, b * steps**2
    d = q - p
    c3 = 10.0 * d - 6.0 * v - 4.0 * w + 0.5 * (b - 3.0 * a)
    c4 = -15.0 * d + 8.0 * v + 7.0 * w + 0.5 * (3.0 * a - 2.0 * b)
    c5 = 6.0 * d - 3.0 * (v + w) + 0.5 * (b - a)
    return np.asarray(p + u * (v + u * (0.5 * a + u * (c3 + u * (c4 + u * c5)))))


def warp_time(states: FloatArray, times: FloatArray) -> FloatArray:
    """States (T, 65) with each number taken at its own time, frames (T, 65); between frames by a cubic spline."""
    frames = np.arange(len(states))
    taken = states.copy()
    each, group = np.unique(times, axis=1, return_inverse=True)
    group = group.ravel()
    for n, column_times in enumerate(each.T):
        if (column_times != frames).any():
            taken[:, group == n] = CubicSpline(frames, states[:, group == n])(column_times)
    return taken


def small_motions(n_frames: int, fps: float, signer: Signer, rng: np.random.Generator) -> FloatArray:
    """Breath, sway and tremor (T, 65) of a standing signer, to be added to states."""
    t = np.arange(n_frames) / fps
    motion = np.zeros((n_frames, pose.SIZE))

    def wave(hz: float) -> FloatArray:
        """A wave of nearly one frequency: the sum of two close frequencies with random phases."""
        phases = 2.0 * np.pi * rng.random(2)
        return np.asarray(
            0.7 * np.sin(2 * np.pi * hz * t + phases[0]) + 0.3 * np.sin(2 * np.pi * 1.37 * hz * t + phases[1])
        )

    breath = np.deg2rad(signer.breath_deg) * wave(signer.breath_hz)
    motion[:, pose.TRUNK.start] = -breath
    motion[:, pose.TRUNK.start + 2] = np.deg2rad(0.35) * wave(signer.sway_hz)
    motion[:, pose.HEAD.start] = 1.4 * breath + np.deg2rad(0.5) * wave(0.31)
    motion[:, pose.HEAD.start + 1] = np.deg2rad(0.7) * wave(0.22)
    motion[:, pose.ROOT.start] = signer.sway_cm * wave(signer.sway_hz)
    motion[:, pose.ROOT.start + 2] = 0.7 * signer.sway_cm * wave(0.83 * signer.sway_hz)
    for first in (0, 27):
        for axis in range(3):
            motion[:, first + axis] = signer.tremor_cm * wave(signer.tremor_hz) + 0.08 * wave(0.4)
    return motion


def window(n_frames: int, edge: int) -> FloatArray:
    """Weights (n_frames,) that rise smoothly from 0 to 1 over ``edge`` frames, stay there and fall again."""
    i = np.arange(n_frames)
    from_end = np.clip(np.minimum(i, n_frames - 1 - i) / max(edge, 1), 0.0, 1.0)
    return np.asarray(from_end * from_end * (3.0 - 2.0 * from_end))
