"""Two hands that are not each other's mirror image in place and time, and fingers that are late or early.

Where hands touch each other or the body, they are where the notation has them: what differs fades out there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from signsplice.motion.arrays import FloatArray
from signsplice.synth import finger_timing, hand, pose, trajectory
from signsplice.synth.base_hand import base_motion
from signsplice.synth.clearance import TOUCH_CM, hand_clearances
from signsplice.synth.rng import stream
from signsplice.synth.signer import Signer

if TYPE_CHECKING:
    from signsplice.synth.phonology import Sign

_FREE_CM = 3.5
"""How much farther than that hands are as free as in the open."""
_PLACE_CM = (1.5, 3.5)
"""Least and greatest distance of one hand from the mirror image of the other, where both are free."""
_LAG_FRAMES = (0.5, 1.7)
"""Least and greatest lag of one hand, frames of 30 a second."""


def with_separate_timing(
    states: FloatArray, sign: Sign, signer: Signer, take: int, fps: float, span: tuple[int, int, int, int]
) -> FloatArray:
    """States (T, 63) of a whole word in which hands and fingers differ in place and time as the signer's manner has it;
    the states themselves where it is plain.

    span: the last frame of rest, the first posture, the last one, the first frame of rest again
    """
    up, start, end, down = span
    manner = signer.manner
    mirrored, base = sign.hands in ("symmetric", "alternating"), sign.hands == "base"
    inner = states[start : end + 1, :54].reshape(-1, 2, 27)[..., pose.FINGERS]
    formed = manner.finger_stagger > 0.0 and float(np.ptp(inner, axis=0).max()) > 0.05
    if not (formed or (mirrored and manner.hand_difference) or (base and manner.base_lag)):
        return states
    clearances = hand_clearances(states, signer)
    free = _freedom(clearances, fps)  # (T, 2)
    frames = np.arange(len(states), dtype=np.float64)
    times = np.repeat(frames[:, None], pose.SIZE, axis=1)  # at which time each number is taken, (T, 63)
    shift = np.zeros_like(states)
    if mirrored and manner.hand_difference:
        level = free.min(axis=1) * _within(frames, up, down, fps)
        lag, place = _difference(frames / fps, sign, signer, take)
        times[:, 27:54] -= (lag * fps / 30.0 * level)[:, None]
        shift[:, 27:30] = place * level[:, None]
    if base and manner.base_lag:
        own, shift = base_motion(states, clearances, sign, signer, take, fps, span)
        times[:, 27:54] = own[:, None]
    if formed:
        late = finger_timing.delays(signer, sign.gloss, take) * fps / 30.0
        inside = _within(frames, up, down, fps)
        for which, first in enumerate((6, 33)):
            times[:, first : first + 21] -= (free[:, which] * inside)[:, None] * late[which]
    times = np.clip(np.maximum.accumulate(times, axis=0), 0.0, frames[-1])
    states = trajectory.taken_at(states, times) + shift
    if formed:
        fingers = pose.hands(states)[..., pose.FINGERS]
        np.clip(fingers, hand.LIMITS[:, 0], hand.LIMITS[:, 1], out=fingers)
    return states


def _freedom(clearances: FloatArray, fps: float) -> FloatArray:
    """How free the strong and the weak hand are, (T, 2): 0 around touches, 1 in the open; it changes over some frames,
    so that time never runs backwards.
    """
    nearest = np.minimum(clearances[:, :2], clearances[:, 2:3])
    level = _smooth_step((nearest - TOUCH_CM) / _FREE_CM)
    side = max(1, round(4 * fps / 30.0))
    least = minimum_filter1d(level, 2 * side + 1, axis=0)
    return np.asarray(gaussian_filter1d(least, 0.5 * side, axis=0, radius=side))


def _within(frames: FloatArray, begin: int, end: int, fps: float) -> FloatArray:
    """1 between two frames, 0 outside of them, rising over a third of a second or half of the way."""
    rise = min(10.0 * fps / 30.0, 0.5 * (end - begin))
    inside = np.minimum(frames - begin, end - frames)
    return _smooth_step(inside / max(rise, 1e-9))


def _difference(seconds: FloatArray, sign: Sign, signer: Signer, take: int) -> tuple[float, FloatArray]:
    """By how many frames of 30 a second the weak hand lags, and its displacement (T, 3), cm, that varies slowly about
    one of the word's.
    """
    habit, rng = stream("hand_difference", signer.name), stream("hand_difference", signer.name, sign.gloss, take)
    amount = signer.manner.hand_difference
    lag = amount * float(rng.uniform(*_LAG_FRAMES)) * (1.0 if rng.random() < 0.7 else -1.0)
    direction = 0.6 * habit.standard_normal(3) + 0.8 * rng.standard_normal(3)
    waves = np.sin(2.0 * np.pi * (rng.uniform(0.3, 0.7, 3) * seconds[:, None] + rng.random(3)))
    place = direction / np.linalg.norm(direction) + 0.25 * waves
    return lag, amount * float(rng.uniform(*_PLACE_CM)) * signer.scale * place


def _smooth_step(x: FloatArray) -> FloatArray:
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
