"""How states run in time: minimum-jerk courses through knots, reaches between two motions, and small oscillations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from signsplice.synth import hand, pose
from signsplice.synth.signer import COLLAR, SHOULDER, Signer

if TYPE_CHECKING:
    from collections.abc import Sequence

Float = NDArray[np.float64]

SHOULDERS_CM = 36.0
"""Shoulder width of the standard body, the unit of the travel law."""


def travel_seconds(travel_cm: float, who: Signer) -> float:
    """How long a reach of ``travel_cm`` takes: T = 51 + 149 log2(1 + D / 0.15) ms, D in shoulder widths, over the
    signer's tempo (fitted to 124 gaps of the DGS Corpus).
    """
    widths = travel_cm / (SHOULDERS_CM * who.scale)
    return (0.051 + 0.149 * float(np.log2(1.0 + widths / 0.15))) / who.tempo


@dataclass(frozen=True)
class Knot:
    """A state (63,) at a frame; ``stop``: everything comes to rest there, else it is passed."""

    frame: int
    state: Float
    stop: bool


def through(knots: Sequence[Knot]) -> Float:
    """States of every frame from the first knot to the last, of least jerk: between stops the quintic spline through
    the knots, at rest at both ends (Flash and Hogan 1985 with via points).
    """
    parts = [knots[0].state[None]]
    begin = 0
    for n in range(1, len(knots)):
        if not (knots[n].stop or n == len(knots) - 1):
            continue
        piece = knots[begin : n + 1]
        frames = np.array([knot.frame for knot in piece], np.float64)
        at = np.arange(piece[0].frame + 1, piece[-1].frame + 1)
        if len(piece) == 2 and np.array_equal(piece[0].state, piece[1].state):
            parts.append(np.broadcast_to(piece[0].state, (len(at), pose.SIZE)))
        elif len(at):
            states = np.array([knot.state for knot in piece])
            ends = [(1, np.zeros(pose.SIZE)), (2, np.zeros(pose.SIZE))]
            parts.append(make_interp_spline(frames, states, k=5, bc_type=(ends, ends))(at))  # type: ignore[arg-type]
        begin = n
    return np.concatenate(parts)


# How far ahead of the reach its parts are halfway, as the height of a bump on their progress (0.65 of the way at half
# time for 0.15, the most that never turns back): fingers form early and one after another, the wrist turns with them.
_AHEAD = np.zeros(27)
_AHEAD[pose.TURN] = 0.04
_AHEAD[pose.FINGERS] = np.repeat([0.14, 0.12, 0.10, 0.09, 0.13], [4, 4, 4, 4, 5])
_MOST_AHEAD = 0.15
_LATE_WEAK = -0.08
_AWAY = np.array([-0.25, 0.35, 0.9])  # reaches bow out of the body: outwards, up, forward


def bump(u: Float) -> Float:
    """A hill (...) of height 1 over [0, 1] whose value, slope and curvature are 0 at both ends: 64 u^3 (1 - u)^3."""
    return np.asarray(64.0 * (u * (1.0 - u)) ** 3)


def reach(before: Float, after: Float, n_frames: int, who: Signer) -> Float:
    """The ``n_frames`` states between two motions, of which ``before`` (.., 63) ends and ``after`` (.., 63) begins.

    Place and velocity are those of the two at their ends (one-sided differences over three frames), and 0.4 of their
    accelerations, since all of it makes long ways; the quintic between them is the move of least jerk. Hands bow out by
    the signer's ``arch``, fingers are early, and a weak hand that goes down is late. All of it dies out with its first
    two derivatives at both ends.
    """
    steps = n_frames + 1
    u = (np.arange(1, n_frames + 1) / steps)[:, None]
    start, end = before[-1], after[0]
    path = _quintic(_ends(before[-3:]), tuple((-1) ** n * d for n, d in enumerate(_ends(after[2::-1]))), steps, u)
    hill = bump(u)
    change = end - start
    ahead = np.concatenate([_AHEAD, _AHEAD, np.zeros(9)])
    ahead[ahead > 0.05] -= who.lag
    if change[27 + 1] < -12.0:  # the weak hand goes down
        ahead[27:30] = _LATE_WEAK
    path += hill * np.minimum(ahead, _MOST_AHEAD) * change
    for first in (0, 27):
        way = change[first : first + 3]
        length = float(np.linalg.norm(way))
        if length > 1e-9:
            away = _AWAY - (_AWAY @ way) * way / length**2
            path[:, first : first + 3] += hill * who.arch * length * away
            _round_the_shoulder(path[:, first : first + 3], hill, start[first : first + 3], end[first : first + 3], who)
        fingers = path[:, first : first + 27][:, pose.FINGERS]
        np.clip(fingers, hand.LIMITS[:, 0], hand.LIMITS[:, 1], out=fingers)
    return path


_SHOULDER_ROOM_CM = 23.0
"""How near to its shoulder a wrist may pass: nearer, the elbow would have to swing round."""
_BEFORE = np.array([-0.35, 0.0, 0.94])


def _round_the_shoulder(path: Float, hill: Float, start: Float, end: Float, who: Signer) -> None:
    """Bow a wrist's path (n, 3) forward and out, in place, where it would come nearer to the shoulder than its ends."""
    shoulder = (COLLAR + SHOULDER) * np.array([-who.shoulders, 1.0, 1.0]) * who.scale
    ends = min(float(np.linalg.norm(start - shoulder)), float(np.linalg.norm(end - shoulder)))
    room = min(_SHOULDER_ROOM_CM * who.scale, ends)
    for _ in range(4):
        lack = room - np.linalg.norm(path - shoulder, axis=-1)
        if lack.max() <= 0.0:
            break
        path += hill * float((lack / np.maximum(hill[:, 0], 0.2)).max()) * _BEFORE


def _ends(frames: Float) -> tuple[Float, Float, Float]:
    """Place, velocity and acceleration a frame at the last of up to three frames."""
    zero = np.zeros(frames.shape[1])
    if len(frames) < 2:
        return frames[-1], zero, zero
    if len(frames) < 3:
        return frames[-1], frames[-1] - frames[-2], zero
    a, b, c = frames[-3:]
    return c, 1.5 * c - 2.0 * b + 0.5 * a, 0.4 * (c - 2.0 * b + a)


def _quintic(start: tuple[Float, ...], end: tuple[Float, ...], steps: int, u: Float) -> Float:
    """The polynomial of degree 5 over [0, 1] with given place, velocity and acceleration (a frame) at both ends."""
    (p, v, a), (q, w, b) = start, end
    v, w, a, b = v * steps, w * steps, a * steps**2, b * steps**2
    d = q - p
    c3 = 10.0 * d - 6.0 * v - 4.0 * w + 0.5 * (b - 3.0 * a)
    c4 = -15.0 * d + 8.0 * v + 7.0 * w + 0.5 * (3.0 * a - 2.0 * b)
    c5 = 6.0 * d - 3.0 * (v + w) + 0.5 * (b - a)
    return np.asarray(p + u * (v + u * (0.5 * a + u * (c3 + u * (c4 + u * c5)))))


def small_motions(n_frames: int, fps: float, who: Signer, rng: np.random.Generator) -> Float:
    """Breath, sway and tremor (T, 63) of a standing signer, to be added to a plan."""
    t = np.arange(n_frames) / fps
    out = np.zeros((n_frames, pose.SIZE))

    def wave(hz: float) -> Float:
        """A wave of nearly one frequency: two neighbouring ones with phases of their own."""
        phases = 2.0 * np.pi * rng.random(2)
        return np.asarray(
            0.7 * np.sin(2 * np.pi * hz * t + phases[0]) + 0.3 * np.sin(2 * np.pi * 1.37 * hz * t + phases[1])
        )

    breath = np.deg2rad(who.breath_deg) * wave(who.breath_hz)
    out[:, pose.TRUNK.start] = -breath
    out[:, pose.TRUNK.start + 2] = np.deg2rad(0.35) * wave(who.sway_hz)
    out[:, pose.HEAD.start] = 1.4 * breath + np.deg2rad(0.5) * wave(0.31)
    out[:, pose.HEAD.start + 1] = np.deg2rad(0.7) * wave(0.22)
    out[:, pose.ROOT.start] = who.sway_cm * wave(who.sway_hz)
    out[:, pose.ROOT.start + 2] = 0.7 * who.sway_cm * wave(0.83 * who.sway_hz)
    for first in (0, 27):
        for axis in range(3):
            out[:, first + axis] = who.tremor_cm * wave(who.tremor_hz) + 0.08 * wave(0.4)
    return out


def window(n_frames: int, edge: int) -> Float:
    """A smooth rise from 0 to 1 over ``edge`` frames, a level and a fall (n_frames,)."""
    i = np.arange(n_frames)
    near = np.clip(np.minimum(i, n_frames - 1 - i) / max(edge, 1), 0.0, 1.0)
    return np.asarray(near * near * (3.0 - 2.0 * near))
