"""splicing.transition: the curves against their formulas, and what holds for every one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import random_clip
from scipy.interpolate import CubicHermiteSpline

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, concatenate, rotation
from signsplice.splicing.gap import Gap
from signsplice.splicing.methods.transition import TRANSITIONS, fade_times, find_transition

NAMES = list(TRANSITIONS)


def one_joint(angles: FloatArray, fps: float = 100.0) -> Clip:
    """A joint that is rotated about z by ``angles`` (T,), radians, and moved along x by the same numbers."""
    skeleton = Skeleton(("a",), np.array([-1]), np.zeros((1, 3)))
    rotvecs = np.zeros((len(angles), 1, 3))
    rotvecs[:, 0, 2] = angles
    positions = np.zeros((len(angles), 3))
    positions[:, 0] = angles
    return Clip(skeleton, rotation.exp(rotvecs), positions, fps)


def filled(name: str, before: FloatArray, after: FloatArray, n: int, fps: float = 100.0) -> FloatArray:
    """Angles (n + 2,) from the last frame before to the first after."""
    clip = find_transition(name).between(Gap(one_joint(before, fps), one_joint(after, fps), n))
    angles = rotation.log(clip.local_rotations)[:, 0, 2]
    assert np.allclose(clip.root_positions[:, 0], angles, atol=1e-9), "the root's position follows the same curve"
    return np.concatenate([before[-1:], angles, after[:1]])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("n", [1, 2, 9, 40])
def test_every_transition_makes_as_many_frames_as_asked(name: str, n: int, words: dict[str, Clip]) -> None:
    before, after = words["HELLO"][:40], words["SIGN"][20:]
    out = find_transition(name).between(Gap(before, after, n))
    assert len(out) == n
    assert out.fps == before.fps
    assert out.skeleton is before.skeleton
    with pytest.raises(InputError, match="at least 1"):
        find_transition(name).between(Gap(before, after, 0))


@pytest.mark.parametrize("name", [n for n in NAMES if n != "hold"])
def test_no_frame_jumps_from_the_one_before_it(name: str, words: dict[str, Clip]) -> None:
    """With many frames all steps are small, those at both ends too."""
    before, after = words["HELLO"][:40], words["SIGN"][20:]
    whole = concatenate([before, find_transition(name).between(Gap(before, after, 200)), after])
    steps = rotation.angle_between(whole.local_rotations[39:240], whole.local_rotations[40:241])
    assert steps.max() < np.deg2rad(12.0)


@pytest.mark.parametrize("name", NAMES)
def test_a_curve_depends_on_three_frames_of_either_side(name: str, words: dict[str, Clip]) -> None:
    before, after = words["HELLO"][:40], words["SIGN"][20:]
    transition = find_transition(name)
    a = transition.between(Gap(before, after, 8))
    b = transition.between(Gap(before[-3:], after[:3], 8))
    assert np.array_equal(a.local_rotations, b.local_rotations)


def test_slerp_linear_and_minimum_jerk_follow_their_formulas() -> None:
    before, after = np.zeros(3), np.full(3, 1.2)
    u = np.arange(0, 11) / 10.0
    assert np.allclose(filled("slerp", before, after, 9), 1.2 * u)
    assert np.allclose(filled("minimum-jerk", before, after, 9), 1.2 * (10 * u**3 - 15 * u**4 + 6 * u**5))
    assert np.allclose(filled("hold", before, after, 9)[:-1], 0.0)
    lerp = find_transition("linear").between(Gap(one_joint(before), one_joint(after), 9)).local_rotations
    plain = (1 - u[1:-1, None]) * np.array([0, 0, 0, 1.0]) + u[1:-1, None] * np.array([0, 0, np.sin(0.6), np.cos(0.6)])
    assert np.allclose(lerp[:, 0], plain / np.linalg.norm(plain, axis=-1, keepdims=True))


@pytest.mark.parametrize("name", ["hermite", "quintic", "inertialize"])
def test_motion_at_constant_speed_is_filled_exactly(name: str) -> None:
    angles = np.linspace(0.0, 2.0, 41)
    out = filled(name, angles[:15], angles[26:], 11)
    tolerance = 1e-7 if name != "inertialize" else 0.05
    assert np.allclose(out, angles[14:27], atol=tolerance)


def test_hermite_is_the_plain_cubic_where_no_limit_applies() -> None:
    """Within 0.3 s it is scipy's CubicHermiteSpline through the same ends with the same velocities."""
    before, after = np.array([-0.02, -0.01, 0.0]), np.array([1.0, 1.03, 1.06])
    spline = CubicHermiteSpline([0.0, 0.3], [0.0, 1.0], [1.0, 3.0])
    assert np.allclose(filled("hermite", before, after, 29), spline(np.arange(31) / 100.0), atol=1e-9)


@pytest.mark.parametrize("name", ["hermite", "quintic"])
def test_velocities_at_both_ends_are_kept(name: str) -> None:
    """In the limit of small steps the angular velocity is continuous, also where rotation vectors are long."""
    rng = np.random.default_rng(2)
    fps = 2000.0
    skeleton = Skeleton(("a",), np.array([-1]), np.zeros((1, 3)))

    def clip(start: FloatArray, w: FloatArray) -> Clip:
        q = rotation.multiply(start, rotation.exp(w * np.arange(3)[:, None] / fps))
        return Clip(skeleton, q[:, None], np.zeros((3, 3)), fps)

    for _ in range(10):
        w0, w1 = rng.normal(size=(2, 3)) * 3.0
        before = clip(rotation.exp(rng.normal(size=3)), w0)
        after = clip(rotation.exp(rng.normal(size=3)), w1)
        out = find_transition(name).between(Gap(before, after, 600)).local_rotations[:, 0]
        first = rotation.difference(before.local_rotations[-1, 0], out[0]) * fps
        last = rotation.difference(out[-1], after.local_rotations[0, 0]) * fps
        assert np.allclose(first, w0, atol=0.15)
        assert np.allclose(last, w1, atol=0.15)


@pytest.mark.parametrize(("name", "swing", "agreeing"), [("hermite", 4 / 27, 0.4), ("quintic", 0.22, 0.2)])
@pytest.mark.parametrize("seconds", [0.2, 0.5, 2.0, 8.0])
@pytest.mark.parametrize(("v0", "v1"), [(8.0, 8.0), (-8.0, 8.0), (8.0, -8.0), (-8.0, -8.0), (20.0, 0.0)])
def test_disagreeing_velocities_do_not_overshoot(
    name: str, swing: float, agreeing: float, seconds: float, v0: float, v1: float
) -> None:
    """However long the gap, no end swings farther beyond the displacement than its velocity carries it in its own
    fading time.
    """
    displacement = 0.5
    before, after = v0 * np.array([-0.02, -0.01, 0.0]), displacement + v1 * np.array([0.0, 0.01, 0.02])
    out = filled(name, before, after, round(seconds * 100) - 1)
    taus = [min(seconds, max(agreeing if v > 0 else 0.2, 3.0 * displacement / abs(v))) if v else 0.0 for v in (v0, v1)]
    bound = sum(swing * abs(v) * tau for v, tau in zip((v0, v1), taus, strict=True))
    assert out.max() < displacement + bound + 1e-9
    assert out.min() > -bound - 1e-9
    if seconds == 8.0:
        plain = 4 / 27 * max(abs(v0), abs(v1)) * seconds
        assert out.max() - displacement < 0.25 * plain, "the plain curve would swing out at least four times as far"


def test_hermite_is_monotone_where_velocities_agree() -> None:
    for seconds in (0.1, 0.3):
        for v in (0.5, 2.0, 5.0, 14.0):
            displacement = v * seconds / 3.0 * 1.01  # Fritsch and Carlson's bound
            before, after = v * np.array([-0.02, -0.01, 0.0]), displacement + v * np.array([0.0, 0.01, 0.02])
            out = filled("hermite", before, after, round(seconds * 100) - 1)
            assert np.all(np.diff(out) > -1e-9)


def test_fading_times_follow_their_formula() -> None:
    displacement, velocity = np.array([[0.5, 0.0, 0.0]]), np.array([[2.0, 0.0, 0.0]])
    assert fade_times(displacement, velocity, 5.0)[0, 0] == pytest.approx(0.75)
    assert fade_times(displacement, velocity, 0.2)[0, 0] == pytest.approx(0.2)
    assert fade_times(displacement, 5 * velocity, 5.0)[0, 0] == pytest.approx(0.4)
    assert fade_times(displacement, -5 * velocity, 5.0)[0, 0] == pytest.approx(0.2)
    assert fade_times(0 * displacement, 5 * velocity, 5.0)[0, 0] == pytest.approx(0.3)
    assert fade_times(displacement, 0 * velocity, 5.0)[0, 0] == pytest.approx(5.0)


def test_inertialize_reaches_its_target_without_overshoot() -> None:
    out = filled("inertialize", np.zeros(3), np.full(3, 1.0), 39)
    assert np.all(np.diff(out) > -1e-9)
    assert out.max() <= 1.0 + 1e-9
    fast = filled("inertialize", 9.0 * np.array([-0.02, -0.01, 0.0]), np.full(3, 1.0), 39)
    assert fast.max() <= 1.0 + 1e-9
    assert fast[1] - fast[0] > out[1] - out[0], "the velocity before goes on"


@pytest.mark.parametrize("name", NAMES)
def test_clips_of_one_frame_have_no_velocity(name: str) -> None:
    clip = random_clip(3)
    out = find_transition(name).between(Gap(clip[:1], clip[10:11], 5))
    assert np.isfinite(out.local_rotations).all()


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("hold", "inertialize")])
def test_a_gap_reversed_in_time_gives_the_frames_reversed(name: str) -> None:
    """All but hold and inertialize, which treat both ends differently."""
    clip = random_clip(5)
    reverse = replace(clip, local_rotations=clip.local_rotations[::-1], root_positions=clip.root_positions[::-1])
    forwards = find_transition(name).between(Gap(clip[:8], clip[13:], 5))
    backwards = find_transition(name).between(Gap(reverse[:7], reverse[12:], 5))
    # Only the frame of reference of the rotation vectors differs, by terms of third order.
    assert np.all(rotation.angle_between(forwards.local_rotations, backwards.local_rotations[::-1]) < 0.02)


@pytest.mark.parametrize("name", NAMES)
def test_animated_bones_follow_the_same_curve_as_the_root(name: str) -> None:
    clip = random_clip(6)
    growth = np.linspace(1.0, 2.0, 20)[:, None, None]
    clip = replace(
        clip,
        translations=np.tile(clip.skeleton.offsets, (20, 1, 1)) * growth,
        root_positions=np.ones((20, 3)) * growth[:, 0],
    )
    out = find_transition(name).between(Gap(clip[:8], clip[12:], 4))
    assert out.translations is not None
    assert np.allclose(out.translations, clip.skeleton.offsets * out.root_positions[:, :1, None], atol=1e-9)
    if name in ("slerp", "linear", "hermite", "quintic"):
        assert np.allclose(out.root_positions, clip.root_positions[8:12], atol=1e-9)


def test_quintic_keeps_accelerations_at_both_ends() -> None:
    """Compared with the derivatives of exp(3 t u + 3 t^2 v) about a random pose, where rotation vectors are long."""
    rng = np.random.default_rng(8)
    fps, n = 4000.0, 800
    for _ in range(5):
        pose = rotation.exp(rng.normal(size=3))
        u, v = rng.normal(size=(2, 3)) * 1.2
        t = (np.arange(-4, n + 6) / fps)[:, None]
        q = rotation.multiply(pose, rotation.exp(t * u * 3.0 + t**2 * v * 3.0))[:, None]
        skeleton = Skeleton(("a",), np.array([-1]), np.zeros((1, 3)))
        clip = Clip(skeleton, q, np.zeros((len(q), 3)), fps)
        out = find_transition("quintic").between(Gap(clip[:5], clip[5 + n :], n))
        whole = concatenate([clip[:5], out, clip[5 + n :]]).local_rotations[:, 0]
        rates = rotation.difference(whole[:-1], whole[1:]) * fps
        accelerations = np.diff(rates, axis=0) * fps
        expected = np.diff(rotation.difference(q[:-1, 0], q[1:, 0]) * fps, axis=0) * fps
        for frame in (6, n + 1):
            assert np.allclose(accelerations[frame], expected[frame], atol=0.5)


def inertialized_offset(x0: float, v0: float, t1: float, t: float) -> float:
    """The offset at time t by the formulas of Bollo's talk (2018), for one number."""
    t1 = min(t1, -5.0 * x0 / v0) if v0 < 0.0 else t1
    a0 = max((-8.0 * v0 * t1 - 20.0 * x0) / t1**2, 0.0)
    a = -(a0 * t1**2 + 6.0 * v0 * t1 + 12.0 * x0) / (2.0 * t1**5)
    b = (3.0 * a0 * t1**2 + 16.0 * v0 * t1 + 30.0 * x0) / (2.0 * t1**4)
    c = -(3.0 * a0 * t1**2 + 12.0 * v0 * t1 + 20.0 * x0) / (2.0 * t1**3)
    return a * t**5 + b * t**4 + c * t**3 + 0.5 * a0 * t**2 + v0 * t + x0 if t < t1 else 0.0


@pytest.mark.parametrize("rate", [0.0, 2.0, 9.0, 40.0])
def test_inertialize_follows_the_published_quintic(rate: float) -> None:
    out = filled("inertialize", rate * np.array([-0.02, -0.01, 0.0]), np.full(3, 1.0), 39)
    expected = [1.0 - inertialized_offset(1.0, -rate, 0.4, k / 100.0) for k in range(41)]
    assert np.allclose(out, expected, atol=1e-9)


def test_an_unknown_transition_is_refused() -> None:
    with pytest.raises(InputError, match="no transition 'cubic', expected one of hold, linear"):
        find_transition("cubic")
