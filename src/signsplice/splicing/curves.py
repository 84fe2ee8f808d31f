"""The classical transitions: curves over the gap between two signs.

Time runs from 0 at the last frame before to T = (n + 1) / fps at the first frame after; the n frames between are new.
Each joint follows a rotation vector x(t) in the frame of its pose a before: x(0) = 0, x(T) = d = log(a^-1 b),
pose(t) = a exp(x(t)), along the shorter arc. The root's position (and bone lengths, if a file animates them) follows
the same curve. Boundary velocities are those of the frame step outside each end.

**Limited ends.** A cubic or quintic that keeps the boundary velocities v over a long gap overshoots by up to 4/27 v T,
without bound in T, which happens if two clips do not fit together. Here each end's velocity fades out within its own
time tau = min(T, max(tau_0, 3 |d| / |v|)), with d the joint's displacement. For tau = T this is the plain Hermite
curve; 3 |d| / |v| is the bound within which a cubic stays monotone (Fritsch and Carlson 1980). tau_0 goes from 0.4 s
for a velocity along the displacement to 0.2 s for one against it (always 0.2 s for the quintic, which overshoots more).
Velocities at both ends stay exact, and no end overshoots by more than 4/27 |v| max(tau_0, 3 |d| / |v|) (the quintic:
0.22), whatever T is. docs/decisions.md lists costs and gains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, bone_translations, copy_unchecked, rotation
from signsplice.motion.curves import minimum_jerk
from signsplice.splicing.contracts import Gap, Transition, find

AGREEING_FADE_S = 0.4
OPPOSING_FADE_S = 0.2
MONOTONE = 3.0


@dataclass(frozen=True, eq=False)
class CurveProblem:
    """The boundary conditions of a curve, for K vectors: joint rotations, the root's position, bone translations.

    displacement: (K, 3) from the last frame before to the first after.
    velocities: (K, 3) at the end of the sign before and at the beginning of the sign after, per second.
    times: (n,) of the new frames, seconds.
    seconds: T, from the last frame before to the first after.
    accelerations: (K, 3) at both ends; empty if the curve does not use them.
    """

    displacement: FloatArray
    velocities: tuple[FloatArray, FloatArray]
    times: FloatArray
    seconds: float
    accelerations: tuple[FloatArray, ...] = ()


Curve = Callable[[CurveProblem], FloatArray]
"""CurveProblem -> displacements (n, K, 3) at the new frames."""


@dataclass(frozen=True)
class CurveTransition(Transition):
    """A transition that follows a curve.

    curve: CurveProblem -> displacements (n, K, 3) at the new frames.
    normalised_lerp: whether rotations are interpolated as normalised quaternions instead.
    accelerates: whether the curve uses accelerations.
    """

    name: str
    summary: str
    curve: Curve
    normalised_lerp: bool = False
    accelerates: bool = False

    @property
    def identity(self) -> str | None:
        """Its name if it is one of ``TRANSITIONS``, else None."""
        return self.name if TRANSITIONS.get(self.name) is self else None

    def fill(self, gaps: Sequence[Gap]) -> list[Clip]:
        """Returns the new frames of every gap; gaps of one length are solved together."""
        clips: dict[int, Clip] = {}
        for rows in _alike(gaps):
            clips |= zip(rows, self._between([gaps[row] for row in rows]), strict=True)
        return [clips[row] for row in range(len(gaps))]

    def _between(self, gaps: Sequence[Gap]) -> list[Clip]:
        """Returns the new frames of G gaps of one length, skeleton and rate."""
        before, n = gaps[0].before, gaps[0].n_frames
        n_joints, moving_bones = before.local_rotations.shape[1], _moves_bones(gaps[0])
        ends = [(gap.before[-3:], gap.after[:3]) for gap in gaps]
        problem = _curve_problem(ends, n, moving_bones, self.accelerates)
        curved = self.curve(problem)  # (n, G (J + 1), 3), with bones (n, G (2 J + 1), 3)
        curved = curved.reshape(n, len(gaps), -1, 3).swapaxes(0, 1)
        start, end = (np.stack([pair[k].local_rotations[k - 1] for pair in ends])[:, None] for k in (0, 1))
        if self.normalised_lerp:
            alpha = np.arange(1, n + 1)[:, None] / (n + 1)
            rotations = rotation.nlerp(start, end, alpha)
        else:
            rotations = rotation.multiply(start, rotation.exp(curved[:, :, :n_joints]))
        roots = np.stack([clip.root_positions[-1] for clip, _ in ends])[:, None] + curved[:, :, n_joints]
        bones = None
        if moving_bones:
            bones = np.stack([bone_translations(clip)[-1] for clip, _ in ends])[:, None] + curved[:, :, n_joints + 1 :]
            bones = bones.reshape(-1, n_joints, 3)
        joined = Clip(before.skeleton, rotations.reshape(-1, n_joints, 4), roots.reshape(-1, 3), before.fps, "", bones)
        channels = [None if gap.before.channels is None else gap.before.channels.forgotten(n) for gap in gaps]
        return [copy_unchecked(joined[k * n : (k + 1) * n], channels=channel) for k, channel in enumerate(channels)]


def _moves_bones(gap: Gap) -> bool:
    return gap.before.translations is not None or gap.after.translations is not None


def _alike(gaps: Sequence[Gap]) -> list[list[int]]:
    """Groups gaps by length, skeleton and rate. Raises ``InputError`` for a gap without frames."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for row, gap in enumerate(gaps):
        if gap.n_frames < 1:
            raise InputError(f"{gap.n_frames} transition frames, expected at least 1")
        key = (gap.n_frames, id(gap.before.skeleton), gap.before.fps, _moves_bones(gap))
        groups.setdefault(key, []).append(row)
    return list(groups.values())


def _curve_problem(
    ends: Sequence[tuple[Clip, Clip]], n_frames: int, moving_bones: bool, accelerates: bool
) -> CurveProblem:
    """Builds the problem of G gaps of one length from the last frames before and the first after: all joints as
    rotation vectors in the frames of the pose before, the root's position, and, if bones move, every joint's
    translation. A step that a short clip lacks counts as standing still.
    """
    fps = ends[0][0].fps
    # Steps from frame to frame in order; the outermost two only give accelerations.
    steps = slice(0, 5) if accelerates else slice(1, 4)
    rotvecs = rotation.difference(*_steps([[clip.local_rotations for clip in end] for end in ends], steps))
    shifts = np.subtract(*_steps([[clip.root_positions[:, None] for clip in end] for end in ends], steps)[::-1])
    if moving_bones:
        bones = np.subtract(*_steps([[bone_translations(clip) for clip in end] for end in ends], steps)[::-1])
        shifts = np.concatenate([shifts, bones], axis=2)  # (S, G, J + 1, 3)
    leave, over, enter = (len(rotvecs) // 2 + k for k in (-1, 0, 1))
    displacement, v1 = rotvecs[over], rotvecs[enter] * fps
    # At the far end the rotation vector's rate is not the angular velocity (the chain rule of exp).
    rate = rotation.right_jacobian_inverse(displacement, v1)
    problem = CurveProblem(
        displacement=_vectors(displacement, shifts[over]),
        velocities=(
            _vectors(rotvecs[leave], shifts[leave]) * fps,
            _vectors(rate, shifts[enter] * fps),
        ),
        times=np.arange(1, n_frames + 1) / fps,
        seconds=(n_frames + 1) / fps,
    )
    if not accelerates:
        return problem
    # Nor is its second rate, x'' = J(x) w' + (dJ/dt) w, the last by a small step along x'.
    bend = rotation.right_jacobian_inverse(displacement, (rotvecs[4] - rotvecs[3]) * fps**2)
    step = 1e-4 * rate
    ahead, behind = (rotation.right_jacobian_inverse(displacement + side * step, v1) for side in (1.0, -1.0))
    bend = bend + (ahead - behind) / 2e-4
    long = np.array([[len(clip) > 2 for clip in end] for end in ends])[..., None, None]  # (G, 2, 1, 1)
    leaving = _vectors((rotvecs[1] - rotvecs[0]) * long[:, 0], (shifts[1] - shifts[0]) * long[:, 0]) * fps**2
    entering = _vectors(bend * long[:, 1], (shifts[4] - shifts[3]) * fps**2 * long[:, 1])
    return replace(problem, accelerations=(leaving, entering))


def _vectors(rotvecs: FloatArray, shifts: FloatArray) -> FloatArray:
    """Joins rotation vectors (G, J, 3) and shifts (G, M, 3) of G gaps to the vectors of one problem (G (J + M), 3)."""
    return np.concatenate([rotvecs, shifts], axis=1).reshape(-1, 3)


def _steps(ends: Sequence[Sequence[FloatArray]], which: slice) -> tuple[FloatArray, FloatArray]:
    """Returns the starts (S, G, ...) and ends (S, G, ...) of some of the five steps between the last three frames
    before and the first three after, of G gaps. A short clip's edge frame is repeated.
    """
    rows = [[before[max(len(before) - k, 0)] for before, _ in ends] for k in (3, 2, 1)]
    rows += [[after[min(k, len(after) - 1)] for _, after in ends] for k in (0, 1, 2)]
    row = np.array(rows[which.start : which.stop + 1])
    return row[:-1], row[1:]


def _fraction(problem: CurveProblem) -> FloatArray:
    return problem.times[:, None, None] / problem.seconds


def _hold(problem: CurveProblem) -> FloatArray:
    return np.zeros((len(problem.times), *problem.displacement.shape))


def _straight(problem: CurveProblem) -> FloatArray:
    return np.asarray(_fraction(problem) * problem.displacement)


def _minimum_jerk(problem: CurveProblem) -> FloatArray:
    """10 u^3 - 15 u^4 + 6 u^5 (Flash and Hogan 1985): from rest to rest."""
    u = _fraction(problem)
    return np.asarray(minimum_jerk(u) * problem.displacement)


def _hermite(problem: CurveProblem) -> FloatArray:
    u = _fraction(problem)
    curve = u**2 * (3.0 - 2.0 * u) * problem.displacement
    for times, displacement, velocity in _from_both_ends(problem):
        tau = fade_times(displacement, velocity, problem.seconds)
        s = np.minimum(times / tau, 1.0)
        curve = curve + tau * s * (1.0 - s) ** 2 * velocity
    return np.asarray(curve)


def _quintic(problem: CurveProblem) -> FloatArray:
    u = _fraction(problem)
    curve = minimum_jerk(u) * problem.displacement
    for (times, displacement, velocity), acceleration in zip(
        _from_both_ends(problem), problem.accelerations, strict=True
    ):
        tau = fade_times(displacement, velocity, problem.seconds, OPPOSING_FADE_S)
        s = np.minimum(times / tau, 1.0)
        curve = curve + tau * (s + s**3 * (-6.0 + s * (8.0 - 3.0 * s))) * velocity
        # An acceleration from three frames is half noise: it may change the velocity over tau by its size at most.
        size = np.linalg.norm(acceleration, axis=-1, keepdims=True)
        limit = np.linalg.norm(velocity, axis=-1, keepdims=True) / tau
        limited = acceleration * np.minimum(1.0, limit / np.maximum(size, 1e-12))
        curve = curve + 0.5 * tau**2 * s**2 * (1.0 - s) ** 3 * limited
    return np.asarray(curve)


def _inertialize(problem: CurveProblem) -> FloatArray:
    """Jumps to the motion after and lets the offset to the motion before decay by a quintic (Bollo 2018,
    "Inertialization").

    The motion after is its first pose extrapolated back by its velocity, which fades as in ``_hermite``, since earlier
    frames are not kept. The offset and its rate are reduced to their length along the offset, as in the talk; the
    quintic ends at min(T, -5 x0 / v0), so that it does not undershoot, with the talk's clamp on its initial
    acceleration.
    """
    velocity = problem.velocities[1]
    tau = fade_times(problem.displacement, velocity, problem.seconds)

    def target(times: FloatArray) -> FloatArray:
        s = np.minimum((problem.seconds - times) / tau, 1.0)
        return np.asarray(problem.displacement - tau * s * (1.0 - s) ** 2 * velocity)

    start = target(np.zeros((1, 1, 1)))[0]
    s0 = np.minimum(problem.seconds / tau, 1.0)
    rate = (1.0 - s0) * (1.0 - 3.0 * s0) * velocity  # of the target at time 0
    x0 = np.linalg.norm(start, axis=-1, keepdims=True)
    axis = -start / np.maximum(x0, 1e-12)
    v0 = np.minimum(np.sum((problem.velocities[0] - rate) * axis, axis=-1, keepdims=True), 0.0)
    t1 = np.where(v0 < -1e-9, np.minimum(problem.seconds, -5.0 * x0 / np.minimum(v0, -1e-9)), problem.seconds)
    t1 = np.maximum(t1, 1e-9)
    a0 = np.maximum((-8.0 * v0 * t1 - 20.0 * x0) / t1**2, 0.0)
    a = -(a0 * t1**2 + 6.0 * v0 * t1 + 12.0 * x0) / (2.0 * t1**5)
    b = (3.0 * a0 * t1**2 + 16.0 * v0 * t1 + 30.0 * x0) / (2.0 * t1**4)
    c = -(3.0 * a0 * t1**2 + 12.0 * v0 * t1 + 20.0 * x0) / (2.0 * t1**3)
    t = problem.times[:, None, None]
    offset = ((((a * t + b) * t + c) * t + 0.5 * a0) * t + v0) * t + x0
    return np.asarray(target(t) + axis * np.where(t < t1, offset, 0.0))


def _from_both_ends(problem: CurveProblem) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Returns for each end the time since it (n, 1, 1), the displacement to the other end (K, 3), and the velocity away
    from it (K, 3).
    """
    t = problem.times[:, None, None]
    return [
        (t, problem.displacement, problem.velocities[0]),
        (problem.seconds - t, -problem.displacement, -problem.velocities[1]),
    ]


def fade_times(
    displacement: FloatArray, velocity: FloatArray, seconds: float, agreeing: float = AGREEING_FADE_S
) -> FloatArray:
    """Returns the seconds (K, 1) in which an end's velocity (K, 3) fades out: min(T, max(tau_0, 3 |d| / |v|)), with d
    the displacement (K, 3) from that end.

    tau_0 is linear in the cosine: ``agreeing`` for a velocity along the displacement, 0.2 s for one against it.
    """
    speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
    length = np.linalg.norm(displacement, axis=-1, keepdims=True)
    # A displacement shorter than what the velocity covers in about a frame has no reliable direction.
    cosine = np.sum(displacement * velocity, axis=-1, keepdims=True) / np.maximum(
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
CLASSICAL_TRANSITION = "hermite"
"""Used if no network can be read; the default is learned (``options.choose``)."""


def find_transition(name: str) -> Transition:
    """Returns the transition of that name. Raises an ``InputError`` that lists the existing names."""
    return find("transition", name, TRANSITIONS)
