"""Augmented takes: what each change keeps, what it changes, and that it depends on the generator alone."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch")

from signsplice.motion import FloatArray, rotation
from signsplice.rig.info import LEFT, ROLES
from signsplice_workshop.train import gap_data

N_FRAMES = 60
RNG = np.random.default_rng


def swinging(n_frames: int = N_FRAMES) -> FloatArray:
    """Every joint rotates about an axis of its own, evenly, 0.02 rad a frame."""
    axes = RNG(3).normal(size=(len(ROLES), 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    return rotation.exp(0.02 * np.arange(n_frames)[:, None, None] * axes)


def step_angles(quats: FloatArray) -> FloatArray:
    """Angles (T - 1, R) from every frame to the next."""
    return rotation.angle_between(quats[1:], quats[:-1])


@pytest.mark.parametrize("seed", range(40))
def test_an_augmented_take_is_long_enough_and_smooth(seed: int) -> None:
    take = gap_data.draw_augmented_take(swinging, RNG(seed))
    np.testing.assert_array_equal(take, gap_data.draw_augmented_take(swinging, RNG(seed)))
    assert take.shape[1:] == (len(ROLES), 4)
    assert len(take) >= 18
    np.testing.assert_allclose(np.linalg.norm(take, axis=-1), 1.0, atol=1e-9)
    assert step_angles(take).max() < 0.6


def test_a_small_fraction_of_the_takes_stands_still() -> None:
    takes = (gap_data.draw_augmented_take(swinging, RNG(seed)) for seed in range(300))
    motion = np.array([step_angles(take)[:, LEFT.stop :].max() for take in takes])
    assert 0.04 < np.mean(motion < 1e-6) < 0.25


def test_a_tempo_keeps_the_path_and_changes_the_time() -> None:
    quats = swinging()
    for tempo in (0.6, 1.7):
        np.testing.assert_allclose(step_angles(gap_data.with_tempo(quats, tempo)), 0.02 * tempo, atol=1e-6)
    variations = set()
    for seed in range(30):
        changed = gap_data.with_random_tempo(quats, RNG(seed))
        np.testing.assert_allclose(rotation.angle_between(changed[0], quats[0]), 0.0, atol=1e-6)
        travel = np.cumsum(step_angles(changed)[:, 0])
        assert (np.diff(travel) > 0.0).all(), "never backwards"
        assert travel[-1] < 0.02 * N_FRAMES
        variations.add(round(float(step_angles(changed)[:, 0].std()), 5))
    assert len(variations) > 10, "tempos vary within a take"


def test_a_short_take_does_not_become_shorter_than_a_window() -> None:
    lengths = {len(gap_data.with_random_tempo(swinging(19), RNG(seed))) for seed in range(60)}
    assert min(lengths) >= 18


def test_joint_lags_are_constant_over_a_take() -> None:
    quats = swinging()
    lagged = gap_data.with_joint_lags(quats, RNG(1))
    lags = rotation.angle_between(lagged, quats)[20:-20] / 0.02
    np.testing.assert_allclose(lags, np.broadcast_to(lags[0], lags.shape), atol=1e-4)
    assert 0.2 < lags.std() < 3.0


def test_arms_wander_more_than_the_trunk() -> None:
    still = np.tile(rotation.IDENTITY, (N_FRAMES, len(ROLES), 1))
    takes = [gap_data.with_wandering_arms(still, RNG(seed)) for seed in range(20)]
    angles = np.array([rotation.angle_between(take, still).max(0) for take in takes])
    upper_arm, spine = ROLES.index("leftUpperArm"), ROLES.index("spine")
    assert angles[:, upper_arm].mean() > 3.0 * angles[:, spine].mean()
    assert angles[:, spine].mean() > 0.0


def test_noise_has_the_given_deviation_and_correlation() -> None:
    still = np.tile(rotation.IDENTITY, (400, len(ROLES), 1))
    noise = rotation.log(gap_data.with_noise(still, 0.005, RNG(2)))
    assert noise[1:].std() == pytest.approx(0.005, rel=0.05)
    correlation = np.mean(noise[2:] * noise[1:-1]) / np.mean(noise[1:] ** 2)
    assert correlation == pytest.approx(np.sqrt(0.75) * 0.5, abs=0.05)


def test_the_left_arm_comes_from_another_take() -> None:
    rng = RNG(0)
    one, other = (rotation.normalize(rng.normal(size=(n, len(ROLES), 4))) for n in (12, 9))
    mixed = gap_data.with_left_arm_of(one, other)
    assert len(mixed) == 9
    np.testing.assert_array_equal(mixed[:, LEFT], other[:, LEFT])
    np.testing.assert_array_equal(mixed[:, : LEFT.start], one[:9, : LEFT.start])
    np.testing.assert_array_equal(mixed[:, LEFT.stop :], one[:9, LEFT.stop :])
