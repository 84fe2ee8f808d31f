"""Makes the two hands differ from mirror images in place and time, and fingers late or early.

The differences fade out where hands touch each other or the body, so that touches follow the notation. A base hand
comes and goes in its own time, and gives way a little to touches.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from signsplice.motion import FloatArray
from signsplice.signer import pose, trajectory
from signsplice.signer.body_motion import Nearness
from signsplice.signer.collisions import TOUCH_CM, between_hands, hand_clearances, penetration
from signsplice.signer.phonology import MIRRORED_HANDS
from signsplice.signer.signer import Signer, stream
from signsplice.signer.timing import Events, SignTake

_FREE_CM = 3.5
"""Additional distance beyond ``TOUCH_CM`` at which hands are as free as in the open, cm."""
_PLACE_CM = (1.5, 3.5)
"""Least and greatest distance of one free hand from the mirror image of the other, cm."""
_LAG_FRAMES = (0.5, 1.7)
"""Least and greatest lag of one hand, frames of 30 a second."""


def with_separate_timing(
    states: FloatArray, take: SignTake, events: Events, near: Nearness | None = None
) -> FloatArray:
    """Makes hands and fingers of a whole word's states (T, 65) differ in place and time according to the signer's
    manner; returns the states unchanged if it is plain.

    near: nearness of the hands, if known
    """
    sign, signer, fps, manner = take.sign, take.signer, take.fps, take.signer.manner
    mirrored, base = sign.hands in MIRRORED_HANDS, sign.hands == "base"
    inner = states[events.start : events.end + 1, :54].reshape(-1, 2, 27)[..., pose.FINGERS]
    formed = manner.finger_stagger > 0.0 and float(np.ptp(inner, axis=0).max()) > 0.05
    if not (formed or (mirrored and manner.hand_difference) or (base and manner.base_lag)):
        return states
    if near is None or base:
        clearances = hand_clearances(states, signer, TOUCH_CM + _FREE_CM)
    else:
        clearances = np.column_stack([near.clearances.min(axis=-1), near.apart])
    free = _freedom(clearances, fps)  # (T, 2)
    frames = np.arange(len(states), dtype=np.float64)
    times = np.repeat(frames[:, None], pose.SIZE, axis=1)  # time at which each number is taken, (T, 65)
    shift, inside = np.zeros_like(states), _within(frames, events.up, events.down, fps)
    if mirrored and manner.hand_difference:
        level = free.min(axis=1) * inside
        lag, place = _difference(frames / fps, take)
        times[:, 27:54] -= (lag * fps / 30.0 * level)[:, None]
        shift[:, 27:30] = place * level[:, None]
    if base and manner.base_lag:
        base_times, shift = base_motion(states, clearances, take, events)
        times[:, 27:54] = base_times[:, None]
    if formed:
        late = trajectory.delays(signer, sign.gloss, take.number) * fps / 30.0
        for which, first in enumerate((6, 33)):
            times[:, first : first + 21] -= (free[:, which] * inside)[:, None] * late[which]
    times = np.clip(np.maximum.accumulate(times, axis=0), 0.0, frames[-1])
    states = trajectory.warp_time(states, times) + shift
    if formed:
        trajectory.clip_fingers(states)
    return states


def _freedom(clearances: FloatArray, fps: float) -> FloatArray:
    """Freedom (T, 2) of the strong and the weak hand: 0 around touches, 1 in the open; it changes over some frames, so
    that time never runs backwards.
    """
    nearest = np.minimum(clearances[:, :2], clearances[:, 2:3])
    level = _smooth_step((nearest - TOUCH_CM) / _FREE_CM)
    side = max(1, round(4 * fps / 30.0))
    least = minimum_filter1d(level, 2 * side + 1, axis=0)
    return np.asarray(gaussian_filter1d(least, 0.5 * side, axis=0, radius=side))


def _within(frames: FloatArray, begin: int, end: int, fps: float) -> FloatArray:
    """1 between two frames, 0 outside; it rises over a third of a second or half of the interval."""
    rise = min(10.0 * fps / 30.0, 0.5 * (end - begin))
    inside = np.minimum(frames - begin, end - frames)
    return _smooth_step(inside / max(rise, 1e-9))


def _difference(seconds: FloatArray, take: SignTake) -> tuple[float, FloatArray]:
    """Lag of the weak hand, frames of 30 a second, and its displacement (T, 3), cm, which varies slowly about one that
    the word fixes.
    """
    signer, label = take.signer, "hand_difference"
    habit, rng = stream(label, signer.name), stream(label, signer.name, take.sign.gloss, take.number)
    amount = signer.manner.hand_difference
    lag = amount * float(rng.uniform(*_LAG_FRAMES)) * (1.0 if rng.random() < 0.7 else -1.0)
    direction = 0.6 * habit.standard_normal(3) + 0.8 * rng.standard_normal(3)
    waves = np.sin(2.0 * np.pi * (rng.uniform(0.3, 0.7, 3) * seconds[:, None] + rng.random(3)))
    place = direction / np.linalg.norm(direction) + 0.25 * waves
    return lag, amount * float(rng.uniform(*_PLACE_CM)) * signer.scale * place


def _smooth_step(x: FloatArray) -> FloatArray:
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


_LAG_S = 0.15
"""Largest lead or lag of a base hand relative to the strong hand, seconds."""
_ATTEMPTS = ((1.0, 0.0), (1.0, 3.0), (1.0, 6.0), (0.5, 0.0), (0.5, 3.0), (0.5, 6.0))
"""Pairs of a fraction of the lag and a detour, cm, tried in turn until hands do not go through one another."""
_DEEPER_CM = 0.1
"""How much deeper than in plain motion hands may go into one another on their way, cm."""
_GIVE_CM = (0.15, 0.4)
"""Least and greatest distance by which a base hand gives way to a touch, cm."""


def base_motion(
    states: FloatArray, clearances: FloatArray, take: SignTake, events: Events
) -> tuple[FloatArray, FloatArray]:
    """Times (T,), frames, at which a base hand's motion is taken, so that it comes and goes in its own time and is in
    place while it is touched; and the displacements (T, 65), cm, of both hands for that.

    clearances: ``hand_clearances`` of the states, exact up to ``TOUCH_CM`` at least
    """
    signer, fps, start, end = take.signer, take.fps, events.start, events.end
    rng = stream("base_lag", signer.name, take.sign.gloss, take.number)
    lags = signer.manner.base_lag * _LAG_S * fps * rng.uniform(-1.0, 1.0, 2)
    touched = np.flatnonzero(clearances[start : end + 1, 2] < TOUCH_CM) + start
    middle = (start + end) // 2
    first, last = (int(touched[0]), int(touched[-1])) if len(touched) else (middle, middle)
    back = len(states) - 1
    times, shift = np.arange(len(states), dtype=np.float64), _give(states, clearances[:, 3], rng, take)
    warped, displacement = _coming(
        states[: first + 1], clearances[: first + 1, 3], events.up, start, float(lags[0]), signer
    )
    times[: first + 1] = warped
    shift[: first + 1, :3] += displacement
    ends = back - events.down, back - end
    warped, displacement = _coming(states[last:][::-1], clearances[last:, 3][::-1], *ends, -float(lags[1]), signer)
    times[last:] = back - warped[::-1]
    shift[last:, :3] += displacement[::-1]
    return times, shift


def _coming(
    states: FloatArray, clearance: FloatArray, up: int, start: int, lag: float, signer: Signer
) -> tuple[FloatArray, FloatArray]:
    """Times (n,) at which a base hand's motion is taken that ends in a touch at the last of the states (n, 65), and the
    strong wrist's displacement (n, 3), cm: it goes round the base hand if that is in its way. If every attempt fails,
    the base hand comes with the strong one.

    clearance: distance of the hands' skins in plain motion, (n,)
    """
    frames = np.arange(len(states), dtype=np.float64)
    u = np.clip((frames - up) / max(1, start - up), 0.0, 1.0)
    hill = trajectory.bump(u**2)[:, None]  # highest near the touch, where the base hand is in the way
    direction = penetration(states[-1:], signer, 1e9)[1][0, 0]
    for fraction, detour in _ATTEMPTS:
        times = _own_times(frames, states[:, 27:30], up, start, fraction * lag)
        displacement = detour * signer.scale * hill * direction
        tried = trajectory.warp_time(
            states, np.column_stack([*[frames] * 27, *[times] * 27, *[frames] * (pose.SIZE - 54)])
        )
        tried[:, :3] += displacement
        if (between_hands(tried, signer, most=0.0) >= np.minimum(clearance, 0.0) - _DEEPER_CM).all():
            return times, displacement
    return frames, np.zeros((len(states), 3))


def _own_times(frames: FloatArray, wrist: FloatArray, up: int, start: int, lag: float) -> FloatArray:
    """Times (n,) that delay a base hand, in place at frame ``start``, by ``lag`` frames, or advance it if it would be
    late for the last frame. The hand rests while time stands or turns.
    """
    stop = len(frames) - 1
    moves = float(np.ptp(wrist[start:], axis=0).max()) > 0.5
    if lag > 0.0 and (moves or lag > 0.6 * (stop - start)):
        lag = -lag
    lag = max(lag, -0.4 * (start - up))
    warped = frames.copy()
    coming = slice(up, (start if lag < 0.0 else stop) + 1)
    warped[coming] = np.interp(frames[coming], (up, start + lag, coming.stop - 1), (up, start, coming.stop - 1))
    return warped


def _give(states: FloatArray, clearance: FloatArray, rng: np.random.Generator, take: SignTake) -> FloatArray:
    """Displacements (T, 65), cm, of both hands together at touches of the base hand, which gives way in the direction
    of the touch and comes back.
    """
    shift = np.zeros_like(states)
    touching = clearance < TOUCH_CM
    frames = np.arange(len(states))
    for onset in (np.flatnonzero(touching[1:] & ~touching[:-1]) + 1).tolist():
        strong = states[max(0, onset - 3) : onset + 1, :3]
        velocity = (strong[-1] - strong[0]) * take.fps / max(1, len(strong) - 1)  # cm/s
        speed = float(np.linalg.norm(velocity))
        size = float(rng.uniform(*_GIVE_CM)) * take.signer.manner.base_lag * min(1.0, speed / 20.0)
        u = np.maximum(frames - onset, 0) * 30.0 / take.fps / 3.0
        push = (size * u**2 * np.exp(2.0 * (1.0 - u)))[:, None] * velocity / max(speed, 1e-9)
        shift[:, :3] += push
        shift[:, 27:30] += push * pose.MIRROR
    return shift
