"""Two hands that are not each other's mirror image in place and time, and a base hand with a time of its own.

Where hands touch each other or the body, they are where the notation has them: what differs fades out there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from signsplice.body import collision
from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.synth import finger_timing, pose
from signsplice.synth.rng import stream
from signsplice.synth.signer import Signer, skeleton

if TYPE_CHECKING:
    from signsplice.synth.phonology import Sign
    from signsplice.synth.planner import Events

Float = NDArray[np.float64]

TOUCH_CM = 0.5
"""Distance of the skins up to which hands count as touching."""
_FREE_CM = 3.5
"""Distance from there at which hands are as free as in the open."""
_PLACE_CM = (1.5, 3.5)
"""Least and greatest distance of one hand from the mirror image of the other, where both are free."""
_LAG_FRAMES = (0.7, 2.2)
"""Least and greatest lag of one hand, frames of 30 a second."""
_BASE_LAG_S = 0.15
"""How much earlier or later than the strong hand a base hand comes and goes, at most."""
_TRIES = 4
"""How often a base hand's lag is halved where the hands would go through one another, before it has none."""
_DEEPER_CM = 0.1
"""How much deeper than in plain motion hands may go into one another on their way."""
_GIVE_CM = (0.15, 0.4)
"""Least and greatest distance by which a base hand gives way to a touch."""


def in_their_own_time(states: Float, sign: Sign, signer: Signer, take: int, fps: float, events: Events) -> Float:
    """States (T, 63) of a whole word in which hands and fingers differ in place and time as the signer's manner has it;
    the states themselves where it is plain.
    """
    manner = signer.manner
    mirrored, base = sign.hands in ("symmetric", "alternating"), sign.hands == "base"
    if not (manner.finger_stagger or (mirrored and manner.hand_difference) or (base and manner.base_lag)):
        return states
    gaps = skin_gaps(states, signer)
    free = _freedom(gaps, fps)  # (T, 2)
    frames = np.arange(len(states), dtype=np.float64)
    times = np.repeat(frames[:, None], pose.SIZE, axis=1)  # at which time each number is taken, (T, 63)
    shift = np.zeros_like(states)
    if mirrored and manner.hand_difference:
        level = free.min(axis=1) * _within(frames, events.up, events.down, fps)
        lag, place = _difference(frames / fps, sign, signer, take)
        times[:, 27:54] -= (lag * fps / 30.0 * level)[:, None]
        shift[:, 27:30] = place * level[:, None]
    if base and manner.base_lag:
        rng = stream("base_lag", signer.name, sign.gloss, take)
        times[:, 27:54] = _base_times(states, gaps, rng, signer, fps, events)[:, None]
        shift += _give(states, gaps[:, 3], rng, signer, fps)
    if manner.finger_stagger:
        late = finger_timing.delays(signer, sign.gloss, take) * fps / 30.0
        inside = _within(frames, events.start, events.end, fps)
        for which, first in enumerate((6, 33)):
            times[:, first : first + 21] -= (free[:, which] * inside)[:, None] * late[which]
    times = np.clip(np.maximum.accumulate(times, axis=0), 0.0, frames[-1])
    return _at(states, times) + shift


def _at(states: Float, times: Float) -> Float:
    """States (T, 63), each number at a time of its own, frames (T, 63)."""
    taken = states.copy()
    shifted = np.flatnonzero((times != np.arange(len(states))[:, None]).any(axis=0))
    for column in shifted.tolist():
        taken[:, column] = CubicSpline(np.arange(len(states)), states[:, column])(times[:, column])
    return taken


def skin_gaps(states: Float, signer: Signer) -> Float:
    """Distances (T, 4) between skins, cm, negative inside: of the strong hand and of the weak one from head and trunk,
    of the strong hand from the weak hand or arm, and from the weak hand alone.
    """
    signer = replace(signer, left_handed=False)
    bones = skeleton(signer)
    body = body_capsules(bones)
    starts, ends = capsule_ends(body, *kinematics.forward(Clip(bones, *pose.rotations(states, signer), 30.0)))
    groups = body.groups
    solid = [*groups.head, *groups.trunk]
    parts = zip(body.parts, body.sides, strict=True)
    sleeves = [n for n, (part, side) in enumerate(parts) if side == "left" and part in ("sleeve", "cuff")]

    def gap(own: tuple[int, ...], other: list[int]) -> Float:
        return np.asarray(-collision.overlap(starts, ends, body.radii, own, other)[0].max(axis=(1, 2)))

    between = gap(groups.right, list(groups.left))
    on_arm = np.minimum(between, gap(groups.right, sleeves))
    return np.stack([gap(groups.right, solid), gap(groups.left, solid), on_arm, between], axis=1)


def _freedom(gaps: Float, fps: float) -> Float:
    """How free the strong and the weak hand are, (T, 2): 0 around touches, 1 in the open; it changes over some frames,
    so that time never runs backwards.
    """
    nearest = np.minimum(gaps[:, :2], gaps[:, 2:3])
    level = _smooth_step((nearest - TOUCH_CM) / _FREE_CM)
    side = max(1, round(3 * fps / 30.0))
    least = minimum_filter1d(level, 2 * side + 1, axis=0)
    return np.asarray(gaussian_filter1d(least, 0.5 * side, axis=0, radius=side))


def _within(frames: Float, begin: int, end: int, fps: float) -> Float:
    """1 between two frames, 0 outside of them, rising over a third of a second or half of the way."""
    rise = min(10.0 * fps / 30.0, 0.5 * (end - begin))
    inside = np.minimum(frames - begin, end - frames)
    return _smooth_step(inside / max(rise, 1e-9))


def _difference(seconds: Float, sign: Sign, signer: Signer, take: int) -> tuple[float, Float]:
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


def _base_times(
    states: Float, gaps: Float, rng: np.random.Generator, signer: Signer, fps: float, events: Events
) -> Float:
    """At which time (T,), frames, a base hand's motion is taken, so that it comes and goes in its own time and is in
    place while it is touched. It is nearer to the strong hand's time where the hands would go through one another.
    """
    most = signer.manner.base_lag * _BASE_LAG_S * fps
    lags = most * rng.uniform(-1.0, 1.0, 2)
    touched = np.flatnonzero(gaps[events.start : events.end + 1, 2] < TOUCH_CM) + events.start
    middle = (events.start + events.end) // 2
    first, last = (int(touched[0]), int(touched[-1])) if len(touched) else (middle, middle)
    back = len(states) - 1
    wrist = states[:, 27:30]
    for _ in range(_TRIES):
        times = np.arange(len(states), dtype=np.float64)
        leaving = _own_end(
            times[: back - last + 1], wrist[last:][::-1], back - events.down, back - events.end, -lags[1]
        )
        times[: first + 1] = _own_end(times[: first + 1], wrist[: first + 1], events.up, events.start, lags[0])
        times[last:] = back - leaving[::-1]
        deeper = skin_gaps(_weak_at(states, times), signer)[:, 3] < np.minimum(gaps[:, 3], 0.0) - _DEEPER_CM
        crossed = np.array([deeper[: first + 1].any(), deeper[last:].any()])
        if not crossed.any():
            return times
        lags = np.where(crossed, 0.5 * lags, lags)
    return np.arange(len(states), dtype=np.float64)


def _weak_at(states: Float, times: Float) -> Float:
    """States (T, 63) with the weak hand's taken at other times (T,), frames."""
    own = np.tile(np.arange(len(states), dtype=np.float64)[:, None], pose.SIZE)
    own[:, 27:54] = times[:, None]
    return _at(states, own)


def _own_end(times: Float, wrist: Float, up: int, start: int, lag: float) -> Float:
    """Times (n,) at which a weak hand that would be in place at frame ``start`` is ``lag`` frames later: it has to be
    in place at the last of them, and comes earlier instead where it could not. It rests where time stands or turns.
    """
    stop = len(times) - 1
    moves = float(np.ptp(wrist[start:], axis=0).max()) > 0.5
    if lag > 0.0 and (moves or lag > 0.6 * (stop - start)):
        lag = -lag
    lag = max(lag, -0.4 * (start - up))
    own = times.copy()
    coming = slice(up, (start if lag < 0.0 else stop) + 1)
    at, taken = (up, start + lag, coming.stop - 1), (up, start, coming.stop - 1)
    own[coming] = np.interp(times[coming], at, taken)
    return own


def _give(states: Float, gap: Float, rng: np.random.Generator, signer: Signer, fps: float) -> Float:
    """Displacements (T, 63) of both hands together, cm, where the strong one touches the base hand: that gives way in
    the direction of the touch and comes back.
    """
    shift = np.zeros_like(states)
    touching = gap < TOUCH_CM
    frames = np.arange(len(states))
    for onset in (np.flatnonzero(touching[1:] & ~touching[:-1]) + 1).tolist():
        strong = states[max(0, onset - 3) : onset + 1, :3]
        velocity = (strong[-1] - strong[0]) * fps / max(1, len(strong) - 1)  # cm/s
        speed = float(np.linalg.norm(velocity))
        size = float(rng.uniform(*_GIVE_CM)) * signer.manner.base_lag * min(1.0, speed / 20.0)
        u = np.maximum(frames - onset, 0) * 30.0 / fps / 3.0
        push = (size * u**2 * np.exp(2.0 * (1.0 - u)))[:, None] * velocity / max(speed, 1e-9)
        shift[:, :3] += push
        shift[:, 27:30] += push * [-1.0, 1.0, 1.0]
    return shift


def _smooth_step(x: Float) -> Float:
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
