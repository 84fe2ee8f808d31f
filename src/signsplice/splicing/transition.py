"""Transitions: the frames between two signs.

Every classical method is a curve over the gap. Time runs from 0 at the last frame before to T = (n + 1) / fps at the
first frame after; the n frames between are new. A joint's way is the rotation vector x(t) in the frame of its pose a
before: x(0) = 0, x(T) = log(a^-1 b), pose(t) = a exp(x(t)), the short way round. The root's place (and bone lengths,
where a file animates them) is carried along the same curve. Boundary velocities are those of the one frame step outside
each end.

**Limited ends.** A cubic or quintic that keeps the boundary velocities v over a long gap swings out by up to 4/27 v T,
without bound in T, and the ends of two clips that were never meant for one another make it do so. Here each end's
velocity fades out within its own time tau = min(T, max(tau_0, 3 d / v)), d the joint's whole way. Where tau = T this is
the plain Hermite curve; 3 d / v is the bound within which a cubic stays monotone along its way (Fritsch and Carlson
1980). tau_0 goes from 0.4 s for a velocity that leads along the way to 0.2 s for one that leads against it, where the
clips disagree (the quintic, which swings wider: always 0.2 s). Velocities at both ends stay exact, and no end swings
out by more than 4/27 v max(tau_0, 3 d / v) (the quintic: 0.22), whatever T is. lab/LOG.md has what this
costs and gains on hidden frames of real clips and at true splices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, bone_translations
from signsplice.splicing.method import Method, find

Float = NDArray[np.float64]

AGREEING_FADE_S = 0.4
OPPOSING_FADE_S = 0.2
MONOTONE = 3.0


class Transition(Method, Protocol):
    """Makes the frames between two clips of one skeleton and rate."""

    def between(self, before: Clip, after: Clip, n_frames: int) -> Clip:
        """``n_frames`` >= 1 new frames that lead from the last frame of ``before`` to the first of ``after``.

        The method sees what is kept of both clips and nothing else.
        """
        ...


Gap = tuple[Clip, Clip, int]
"""The sign before, the sign after, as much of each as is kept and shown, and the number of new frames."""


class SentenceTransition(Transition, Protocol):
    """A transition that can fill all gaps of a sentence in one go."""

    def between_all(self, gaps: Sequence[Gap]) -> list[Clip]:
        """New frames for every gap, each as ``between`` makes them."""
        ...


class LimitedTransition(Transition, Protocol):
    """A transition that leaves some gaps to another."""

    def limits(self, gap: Gap) -> tuple[str, ...]:
        """What has to be said of a gap that it leaves to another; nothing where it fills it itself."""
        ...


# Asked by name: to ask the protocols takes as long as a small network.
def fills_together(transition: Transition) -> TypeGuard[SentenceTransition]:
    """Whether a transition can fill all gaps of a sentence in one go."""
    return hasattr(transition, "between_all")


def has_limits(transition: Transition) -> TypeGuard[LimitedTransition]:
    """Whether a transition leaves some gaps to another."""
    return hasattr(transition, "limits")


@dataclass(frozen=True, eq=False)
class CurveProblem:
    """What a curve has to bridge, K ways at once: the ways d (K, 3), the velocities (K, 3) at both ends along them, a
    second, and accelerations (K, 3), empty where the curve does not ask for them; the times (n,) of the new frames and
    T, in seconds.
    """

    displacement: Float
    velocities: tuple[Float, Float]
    times: Float
    seconds: float
    accelerations: tuple[Float, ...] = ()


Curve = Callable[[CurveProblem], Float]


@dataclass(frozen=True)
class CurveTransition:
    """A transition that follows a curve: Ways -> places (n, K, 3) along the ways."""

    name: str
    summary: str
    curve: Curve
    normalised_lerp: bool = False
    accelerates: bool = False
    learned: bool = False

    def between(self, before: Clip, after: Clip, n_frames: int) -> Clip:
        """``n_frames`` >= 1 new frames that lead from the last frame of ``before`` to the first of ``after``."""
        if n_frames < 1:
            raise InputError(f"{n_frames} transition frames, expected at least 1")
        n_joints = len(before.skeleton)
        before, after = before[-3:], after[:3]
        moving = before.translations is not None or after.translations is not None
        gap = _curve_problem(before, after, n_frames, moving, self.accelerates)
        start = before.local_rotations[-1]
        curved = self.curve(gap)
        if self.normalised_lerp:
            share = np.arange(1, n_frames + 1)[:, None] / (n_frames + 1)
            rotations = rotation.nlerp(start, after.local_rotations[0], share)
        else:
            rotations = rotation.multiply(start, rotation.exp(curved[:, :n_joints]))
        return Clip(
            skeleton=before.skeleton,
            local_rotations=rotations,
            root_positions=before.root_positions[-1] + curved[:, n_joints],
            fps=before.fps,
            translations=bone_translations(before)[-1] + curved[:, n_joints + 1 :] if moving else None,
            channels=None if before.channels is None else before.channels.forgotten(n_frames),
        )


def _curve_problem(before: Clip, after: Clip, n_frames: int, moving: bool, accelerates: bool) -> CurveProblem:
    """The gap of all joints as rotation vectors in the frames of the pose before, of the root's place, and, where bones
    are ``moving``, of every joint's translation. A clip too short for a step stands still there.
    """
    fps = before.fps
    # Steps from frame to frame in a row; the outermost two only tell accelerations.
    steps = slice(0, 5) if accelerates else slice(1, 4)
    turns = rotation.difference(*_steps(before.local_rotations, after.local_rotations, steps))
    shifts = np.subtract(*_steps(before.root_positions[:, None], after.root_positions[:, None], steps)[::-1])
    if moving:
        bones = np.subtract(*_steps(bone_translations(before), bone_translations(after), steps)[::-1])
        shifts = np.concatenate([shifts, bones], axis=1)
    leave, over, enter = (len(turns) // 2 + k for k in (-1, 0, 1))
    way, v1 = turns[over], turns[enter] * fps
    # At the far end the rotation vector's rate is not the angular velocity (the chain rule of exp).
    rate = rotation.right_jacobian_inverse(way, v1)
    gap = CurveProblem(
        displacement=np.concatenate([way, shifts[over]]),
        velocities=(np.concatenate([turns[leave], shifts[leave]]) * fps, np.concatenate([rate, shifts[enter] * fps])),
        times=np.arange(1, n_frames + 1) / fps,
        seconds=(n_frames + 1) / fps,
    )
    if not accelerates:
        return gap
    # Nor is its second rate, x'' = J(x) w' + (dJ/dt) w, the last by a small step along x'.
    bend = rotation.right_jacobian_inverse(way, (turns[4] - turns[3]) * fps**2)
    step = 1e-4 * rate
    ahead, behind = (rotation.right_jacobian_inverse(way + side * step, v1) for side in (1.0, -1.0))
    bend = bend + (ahead - behind) / 2e-4
    leaving = np.concatenate([turns[1] - turns[0], shifts[1] - shifts[0]]) * fps**2 * (len(before) > 2)
    entering = np.concatenate([bend, (shifts[4] - shifts[3]) * fps**2]) * (len(after) > 2)
    return replace(gap, accelerations=(leaving, entering))


def _steps(before: Float, after: Float, which: slice) -> tuple[Float, Float]:
    """Of the five steps from frame to frame of the last three before and the first three after, some: from where (S,
    ...), to where (S, ...); a short clip's edge frame is repeated.
    """
    rows = [before[max(len(before) - k, 0)] for k in (3, 2, 1)] + [after[min(k, len(after) - 1)] for k in (0, 1, 2)]
    row = np.stack(rows[which.start : which.stop + 1])
    return row[:-1], row[1:]


def _fraction(gap: CurveProblem) -> Float:
    return gap.times[:, None, None] / gap.seconds


def _hold(gap: CurveProblem) -> Float:
    return np.zeros((len(gap.times), *gap.displacement.shape))


def _straight(gap: CurveProblem) -> Float:
    return np.asarray(_fraction(gap) * gap.displacement)


def _minimum_jerk(gap: CurveProblem) -> Float:
    """10 u^3 - 15 u^4 + 6 u^5 (Flash and Hogan 1985): from rest to rest."""
    u = _fraction(gap)
    return np.asarray(u**3 * (10.0 + u * (-15.0 + 6.0 * u)) * gap.displacement)


def _hermite(gap: CurveProblem) -> Float:
    u = _fraction(gap)
    curve = u**2 * (3.0 - 2.0 * u) * gap.displacement
    for times, way, velocity in _from_both_ends(gap):
        tau = fade_times(way, velocity, gap.seconds)
        s = np.minimum(times / tau, 1.0)
        curve = curve + tau * s * (1.0 - s) ** 2 * velocity
    return np.asarray(curve)


def _quintic(gap: CurveProblem) -> Float:
    u = _fraction(gap)
    curve = u**3 * (10.0 + u * (-15.0 + 6.0 * u)) * gap.displacement
    for (times, way, velocity), acceleration in zip(_from_both_ends(gap), gap.accelerations, strict=True):
        tau = fade_times(way, velocity, gap.seconds, OPPOSING_FADE_S)
        s = np.minimum(times / tau, 1.0)
        curve = curve + tau * (s + s**3 * (-6.0 + s * (8.0 - 3.0 * s))) * velocity
        # An acceleration from three frames is half noise: it may change the velocity over tau by no more than its size.
        size = np.linalg.norm(acceleration, axis=-1, keepdims=True)
        most = np.linalg.norm(velocity, axis=-1, keepdims=True) / tau
        limited = acceleration * np.minimum(1.0, most / np.maximum(size, 1e-12))
        curve = curve + 0.5 * tau**2 * s**2 * (1.0 - s) ** 3 * limited
    return np.asarray(curve)


def _inertialize(gap: CurveProblem) -> Float:
    """Bollo 2018, "Inertialization": jump to the motion after, and let the offset to the motion before die out by a
    quintic.

    The motion after is its first pose carried back along its own velocity, which fades as in Hermite's ends, since the
    frames that came before it are not kept. The offset and its rate are reduced to their length along the offset, as in
    the talk; the quintic ends at min(T, -5 x0 / v0), so that it does not undershoot, with the talk's clamp on its
    start's acceleration.
    """
    velocity = gap.velocities[1]
    tau = fade_times(gap.displacement, velocity, gap.seconds)

    def target(times: Float) -> Float:
        s = np.minimum((gap.seconds - times) / tau, 1.0)
        return np.asarray(gap.displacement - tau * s * (1.0 - s) ** 2 * velocity)

    start = target(np.zeros((1, 1, 1)))[0]
    s0 = np.minimum(gap.seconds / tau, 1.0)
    rate = (1.0 - s0) * (1.0 - 3.0 * s0) * velocity  # of the target at time 0
    x0 = np.linalg.norm(start, axis=-1, keepdims=True)
    axis = -start / np.maximum(x0, 1e-12)
    v0 = np.minimum(np.sum((gap.velocities[0] - rate) * axis, axis=-1, keepdims=True), 0.0)
    t1 = np.where(v0 < -1e-9, np.minimum(gap.seconds, -5.0 * x0 / np.minimum(v0, -1e-9)), gap.seconds)
    t1 = np.maximum(t1, 1e-9)
    a0 = np.maximum((-8.0 * v0 * t1 - 20.0 * x0) / t1**2, 0.0)
    a = -(a0 * t1**2 + 6.0 * v0 * t1 + 12.0 * x0) / (2.0 * t1**5)
    b = (3.0 * a0 * t1**2 + 16.0 * v0 * t1 + 30.0 * x0) / (2.0 * t1**4)
    c = -(3.0 * a0 * t1**2 + 12.0 * v0 * t1 + 20.0 * x0) / (2.0 * t1**3)
    t = gap.times[:, None, None]
    offset = ((((a * t + b) * t + c) * t + 0.5 * a0) * t + v0) * t + x0
    return np.asarray(target(t) + axis * np.where(t < t1, offset, 0.0))


def _from_both_ends(gap: CurveProblem) -> list[tuple[Float, Float, Float]]:
    """Seen from each end: the time since it (n, 1, 1), the way to the other (K, 3), the velocity away from it (K,
    3).
    """
    t = gap.times[:, None, None]
    return [(t, gap.displacement, gap.velocities[0]), (gap.seconds - t, -gap.displacement, -gap.velocities[1])]


def fade_times(way: Float, velocity: Float, seconds: float, agreeing: float = AGREEING_FADE_S) -> Float:
    """Seconds (K, 1) in which an end's velocity (K, 3) fades out: min(T, max(tau_0, 3 |d| / |v|)), d the way (K, 3)
    from there.

    tau_0 goes from ``agreeing``, for a velocity along the way, evenly with the cosine to 0.2 s for one against it.
    """
    speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    # A way shorter than the velocity covers in a frame or so has no direction to speak of.
    cosine = np.sum(way * velocity, axis=-1, keepdims=True) / np.maximum(
        speed * np.maximum(length, 0.03 * speed), 1e-12
    )
    least = OPPOSING_FADE_S + 0.5 * (agreeing - OPPOSING_FADE_S) * (1.0 + cosine)
    return np.asarray(np.minimum(seconds, np.maximum(least, MONOTONE * length / np.maximum(speed, 1e-12))))


TRANSITIONS: dict[str, Transition] = {
    transition.name: transition
    for transition in (
        CurveTransition("hold", "keeps the last pose (a baseline)", _hold),
        CurveTransition("linear", "normalised linear interpolation of rotations", _straight, normalised_lerp=True),
        CurveTransition("slerp", "great-circle interpolation at even speed", _straight),
        CurveTransition("minimum-jerk", "from rest to rest (Flash and Hogan 1985)", _minimum_jerk),
        CurveTransition("hermite", "cubic that keeps both ends' velocities, limited", _hermite),
        CurveTransition(
            "quintic", "keeps both ends' velocities and accelerations, limited", _quintic, accelerates=True
        ),
        CurveTransition("inertialize", "the offset to the next sign dies out (Bollo 2018)", _inertialize),
    )
}
DEFAULT_TRANSITION = "hermite"


def find_transition(name: str) -> Transition:
    """The transition of that name. Raises ``InputError`` that lists the names there are."""
    return find("transition", name, TRANSITIONS)
