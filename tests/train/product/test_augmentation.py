"""Stretches made various: what they keep, what they change, and that draws are a function of the generator."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch")

from signsplice.motion import rotation
from signsplice.rig.canonical import LEFT, ROLES
from signsplice.train.product import augmentation

N = 60
RNG = np.random.default_rng


def swinging(n: int = N) -> augmentation.Float:
    """Every joint turns about an axis of its own, evenly, 0.02 rad a frame."""
    axes = RNG(3).normal(size=(len(ROLES), 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    return rotation.exp(0.02 * np.arange(n)[:, None, None] * axes)


def steps(turns: augmentation.Float) -> augmentation.Float:
    return rotation.angle_between(turns[1:], turns[:-1])


@pytest.mark.parametrize("seed", range(40))
def test_a_stretch_is_long_enough_and_made_of_rotations(seed: int) -> None:
    made = augmentation.stretch(swinging, RNG(seed))
    again = augmentation.stretch(swinging, RNG(seed))
    np.testing.assert_array_equal(made, again)
    assert made.shape[1:] == (len(ROLES), 4)
    assert len(made) >= 18
    np.testing.assert_allclose(np.linalg.norm(made, axis=-1), 1.0, atol=1e-9)
    assert steps(made).max() < 0.6, "nothing jumps"


def test_of_stretches_some_stand_still_and_most_do_not() -> None:
    moving = np.array([steps(augmentation.stretch(swinging, RNG(seed)))[:, LEFT.stop :].max() for seed in range(300)])
    assert 0.04 < np.mean(moving < 1e-6) < 0.25


def test_a_tempo_keeps_the_way_and_changes_the_time() -> None:
    turns = swinging()
    for tempo in (0.6, 1.7):
        np.testing.assert_allclose(steps(augmentation.at_tempo(turns, tempo)), 0.02 * tempo, atol=1e-6)
    found = set()
    for seed in range(30):
        made = augmentation.at_any_tempo(turns, RNG(seed))
        np.testing.assert_allclose(rotation.angle_between(made[0], turns[0]), 0.0, atol=1e-6)
        along = np.cumsum(steps(made)[:, 0])
        assert (np.diff(along) > 0.0).all(), "never backwards"
        assert along[-1] < 0.02 * N
        found.add(round(float(steps(made)[:, 0].std()), 5))
    assert len(found) > 10, "tempos waver"


def test_too_short_a_take_keeps_its_tempo() -> None:
    turns = swinging(19)
    lengths = {len(augmentation.at_any_tempo(turns, RNG(seed))) for seed in range(60)}
    assert min(lengths) >= 18


def test_joints_that_are_skewed_are_where_they_are_at_another_time() -> None:
    turns = swinging()
    made = augmentation.skewed(turns, RNG(1))
    late = rotation.angle_between(made, turns)[20:-20] / 0.02
    np.testing.assert_allclose(late, np.broadcast_to(late[0], late.shape), atol=1e-4)
    assert 0.2 < late.std() < 3.0


def test_arms_wander_and_the_trunk_hardly() -> None:
    still = np.tile(rotation.IDENTITY, (N, len(ROLES), 1))
    far = np.array(
        [rotation.angle_between(augmentation.wandering(still, RNG(seed)), still).max(0) for seed in range(20)]
    )
    upper_arm, spine = ROLES.index("leftUpperArm"), ROLES.index("spine")
    assert far[:, upper_arm].mean() > 3.0 * far[:, spine].mean()
    assert far[:, spine].mean() > 0.0


def test_what_trembles_trembles_by_so_much() -> None:
    still = np.tile(rotation.IDENTITY, (400, len(ROLES), 1))
    made = rotation.log(augmentation.noisy(still, 0.005, RNG(2)))
    assert made[1:].std() == pytest.approx(0.005, rel=0.05)
    alike = np.mean(made[2:] * made[1:-1]) / np.mean(made[1:] ** 2)
    assert alike == pytest.approx(np.sqrt(0.75) * 0.5, abs=0.05)
