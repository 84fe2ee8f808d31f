"""Random changes that make the synthetic signer's motion as varied as people and captures are.

The synthetic signer is too regular: a network could predict a hidden stretch from its two ends alone, and would then be
overconfident on captures. So some stretches get a varying tempo, joints that lag, or the left arm of another take; in
others nothing is signed while the body stands still and the arms wander. Captures also differ in how bodies stand, are
marked and are rigged, they sway, and they are noisy.

All functions take canonical rotations, quaternions (T, R, 4) with one for each role of ``rig.canonical.ROLES``, and
return an array of that form, with the number of frames that they state. Everything random comes from the generator that
they are given.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from signsplice.motion import FloatArray, rotation
from signsplice.rig.info import FEATURE_FPS, LEFT, RIGHT
from signsplice.rig.roles import ARM
from signsplice.splicing.networks import gap_features

STILL, WANDERING = 0.12, 0.18
"""Fractions of the hidden stretches in which the body stands still, and in which the arms wander."""
WANDER_RAD, WANDER_HZ = 0.4, (0.15, 1.5)
"""Largest standard deviation of the wandering rotations, and the range of their frequencies."""
TEMPO_RANGE = (0.6, 1.7)
TEMPO_PROBABILITY = 0.7
TEMPO_WAVES_PROBABILITY = 0.7
TEMPO_WAVES = 0.5
"""Largest standard deviation of the logarithm of a tempo that varies within a stretch."""
TEMPO_WAVES_HZ = (0.5, 3.0)
LAG_PROBABILITY = 0.6
LAG_FRAMES = 2.5
"""Largest standard deviation of the lags of single joints."""
OFFSET_PROBABILITY = 0.6
OFFSET_RAD = 0.25
"""Largest standard deviation of constant rotations added to all joints."""
SWAY_PROBABILITY = 0.4
SWAY_RAD, SWAY_HZ = 0.1, (0.2, 2.0)
"""Largest standard deviation of slow rotations added to all joints, and the range of their frequencies."""
NOISE_PROBABILITY = 0.3
NOISE_RAD = (0.001, 0.008)
"""Range of the standard deviation of noise."""
OTHER_ARM_PROBABILITY = 0.3
_MIN_FRAMES = gap_features.MIN_GAP_FRAMES + 2 * gap_features.N_CONTEXT
"""The shortest gap with all the frames that the network sees on either side."""


def augmented_take(draw_take: Callable[[], FloatArray], rng: np.random.Generator, idle: bool = True) -> FloatArray:
    """One take of ``draw_take`` with a random tempo, lags, another take's left arm; at least ``_MIN_FRAMES`` long.

    ``idle``: a fraction of the results shows no signing, but a body that stands still or arms that wander.
    """
    quats = with_random_tempo(draw_take(), rng)
    kind = rng.random() if idle else 1.0
    if kind < STILL or rng.random() < 0.5 * (kind < STILL + WANDERING):
        quats = np.repeat(quats[int(rng.integers(len(quats)))][None], len(quats), axis=0)
    if STILL <= kind < STILL + WANDERING:
        quats = with_wandering_arms(quats, rng)
    if rng.random() < OTHER_ARM_PROBABILITY:
        quats = with_left_arm_of(quats, draw_take())
    if rng.random() < LAG_PROBABILITY:
        quats = with_joint_lags(quats, rng)
    return quats


def with_random_tempo(quats: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The motion at a random tempo; unchanged where it would become shorter than ``_MIN_FRAMES``."""
    tempo = float(rng.uniform(*TEMPO_RANGE)) if rng.random() < TEMPO_PROBABILITY else 1.0
    varies = rng.random() < TEMPO_WAVES_PROBABILITY
    out = with_tempo(quats, _varying_tempo(tempo, len(quats), rng) if varies else tempo)
    return out if len(out) >= _MIN_FRAMES else quats


def with_tempo(quats: FloatArray, tempo: float | FloatArray) -> FloatArray:
    """The same motion ``tempo`` times as fast; ``tempo`` is one number, or one for each frame of the result."""
    if isinstance(tempo, float):
        at = np.arange(0.0, len(quats) - 1.0, tempo)
    else:
        at = np.cumsum(tempo) - tempo[0]
        at = at[at < len(quats) - 1.0]
    low = at.astype(int)
    return rotation.nlerp(quats[low], quats[low + 1], (at - low)[:, None])


def _varying_tempo(tempo: float, n_frames: int, rng: np.random.Generator) -> FloatArray:
    """Tempos that vary around one value, enough of them to reach the end of ``n_frames``."""
    times = np.arange(int(2.0 * n_frames / tempo) + 1) / FEATURE_FPS
    rates, phases = rng.uniform(*TEMPO_WAVES_HZ, 3), rng.uniform(0.0, 2.0 * np.pi, 3)
    waves = np.sin(2.0 * np.pi * rates * times[:, None] + phases).sum(axis=1) * np.sqrt(2.0 / 3.0)
    return np.asarray(tempo * np.exp(rng.uniform(0.0, TEMPO_WAVES) * waves))


def with_wandering_arms(quats: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The motion with slow random rotations added: large ones to arms and hands, small ones to all other joints."""
    scale = np.full(quats.shape[1], 0.15)  # (R,)
    for side in (LEFT, RIGHT):
        scale[side.start + 1 : side.start + len(ARM)] = 1.0
    rotvecs = rng.normal(0.0, rng.uniform(0.05, WANDER_RAD), (quats.shape[1], 3)) * scale[:, None]
    return _with_waves(quats, rotvecs, WANDER_HZ, 3, rng)


def _with_waves(
    quats: FloatArray, rotvecs: FloatArray, hz: tuple[float, float], n_waves: int, rng: np.random.Generator
) -> FloatArray:
    """The motion with every joint rotated by ``n_waves`` sine waves of amplitude ``rotvecs`` (R, 3)."""
    times = np.arange(len(quats))[:, None, None, None] / FEATURE_FPS  # (T, 1, 1, 1)
    shape = (*rotvecs.shape, n_waves)
    rates, phases = rng.uniform(*hz, shape), rng.uniform(0.0, 2.0 * np.pi, shape)
    waves = np.sin(2.0 * np.pi * rates * times + phases).sum(axis=-1) / np.sqrt(n_waves)  # (T, R, 3)
    return rotation.multiply(quats, rotation.exp(rotvecs * waves))


def with_joint_lags(quats: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The motion with every joint delayed or advanced by a constant time of its own."""
    lags = rng.normal(0.0, rng.uniform(0.0, LAG_FRAMES), quats.shape[1])
    at = np.clip(np.arange(len(quats))[:, None] + lags, 0.0, len(quats) - 1.001)  # (T, R)
    low, roles = at.astype(int), np.arange(quats.shape[1])
    return rotation.nlerp(quats[low, roles], quats[low + 1, roles], at - low)


def with_left_arm_of(quats: FloatArray, other: FloatArray) -> FloatArray:
    """The motion with the left arm of another take; as many frames as the shorter of the two."""
    n_frames = min(len(quats), len(other))
    out = quats[:n_frames].copy()
    out[:, LEFT] = other[:n_frames, LEFT]
    return out


def with_offsets_and_sway(quats: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The motion of a body that stands or is rigged a little differently, or that sways; each with a probability."""
    n_roles = quats.shape[1]
    if rng.random() < OFFSET_PROBABILITY:
        rotvecs = rng.normal(0.0, rng.uniform(0.0, OFFSET_RAD), (n_roles, 3))
        quats = rotation.multiply(quats, rotation.exp(rotvecs))
    if rng.random() < SWAY_PROBABILITY:
        quats = _with_waves(quats, rng.normal(0.0, rng.uniform(0.0, SWAY_RAD), (n_roles, 3)), SWAY_HZ, 1, rng)
    return quats


def with_noise(quats: FloatArray, deviation: float, rng: np.random.Generator) -> FloatArray:
    """The motion with noise of standard ``deviation``, rad; noise of neighbouring frames is correlated."""
    white = rng.normal(0.0, deviation, (len(quats), quats.shape[1], 3))
    white[1:] = 0.5 * white[:-1] + np.sqrt(0.75) * white[1:]
    return rotation.multiply(quats, rotation.exp(white))
