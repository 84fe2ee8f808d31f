"""What makes the procedural signer less regular than it is: stretches of its signing as people and captures have them.

A network that could tell a stretch from its ends alone would be too sure of itself on captures. So a tempo wavers,
joints run ahead or behind, an arm comes from another take; in some stretches nothing is signed at all, bodies stand
still and arms wander. Captures hold more that the signer does not do: bodies that stand, are marked and rigged a little
otherwise, trunks and shoulders that sway, noise. All functions take turns (T, R, 4), a quaternion for each role,
and give some, as many as they say; what they draw is a function of the generator alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import rotation
from signsplice.rig.canonical import ARM, FEATURE_FPS, LEFT, RIGHT
from signsplice.splicing import features

Float = NDArray[np.float64]

NOISY = 0.3
NOISE_RAD = (0.001, 0.008)
"""Least and most spread of a noisy capture's turns, from frame to frame alike by half."""
STILL, WANDERING = 0.12, 0.18
"""Shares of the hidden stretches in which a body stands still, and in which its arms wander."""
WANDER_RAD, WANDER_HZ = 0.4, (0.15, 1.5)
"""Most spread of the turns that make them wander."""
TEMPOS = (0.6, 1.7)
WAVERING = 0.7
"""Share of the hidden stretches whose tempo wavers."""
WAVERS = 0.5
"""Most spread of that, of the tempo's logarithm, ``WAVER_HZ``."""
WAVER_HZ = (0.5, 3.0)
SKEWED = 0.6
"""Share of the hidden stretches whose joints run ahead or behind."""
SKEW = 2.5
"""Most spread of that, frames."""
SET = 0.6
"""Share of the gaps whose joints are turned by so much throughout."""
SET_RAD = 0.25
"""Most spread of that."""
SWAYING = 0.4
SWAY_RAD = 0.1
"""Most spread of slow turns of all joints, ``SWAY_HZ``."""
SWAY_HZ = (0.2, 2.0)
EXCHANGED = 0.3
"""Share of the hidden stretches whose left arm is another take's."""
_SHORTEST = features.MIN_GAP_FRAMES + 2 * features.CONTEXT
"""Frames of a take in which a gap can be hidden well."""


def stretch(take: Callable[[], Float], rng: np.random.Generator, idle: bool = True) -> Float:
    """A take of ``take``, at least as many frames of it as a gap is hidden in, as various as people are; ``idle``: in
    some nothing is signed.
    """
    turns = at_any_tempo(take(), rng)
    kind = rng.random() if idle else 1.0
    if kind < STILL or rng.random() < 0.5 * (kind < STILL + WANDERING):
        turns = np.repeat(turns[int(rng.integers(len(turns)))][None], len(turns), axis=0)
    if STILL <= kind < STILL + WANDERING:
        turns = wandering(turns, rng)
    if rng.random() < EXCHANGED:
        turns = exchanged(turns, take())
    if rng.random() < SKEWED:
        turns = skewed(turns, rng)
    return turns


def at_any_tempo(turns: Float, rng: np.random.Generator) -> Float:
    """A take at a tempo of its own, unless too little were left of it."""
    tempo = float(rng.uniform(*TEMPOS)) if rng.random() < 0.7 else 1.0
    out = at_tempo(turns, _wavering(tempo, len(turns), rng) if rng.random() < WAVERING else tempo)
    return out if len(out) >= _SHORTEST else turns


def at_tempo(turns: Float, tempo: float | Float) -> Float:
    """The same motion ``tempo`` times as fast, one number or one for each frame."""
    if isinstance(tempo, float):
        at = np.arange(0.0, len(turns) - 1.0, tempo)
    else:
        at = np.cumsum(tempo) - tempo[0]
        at = at[at < len(turns) - 1.0]
    low = at.astype(int)
    return rotation.nlerp(turns[low], turns[low + 1], (at - low)[:, None])


def _wavering(tempo: float, n_frames: int, rng: np.random.Generator) -> Float:
    """Tempos that waver around one, as many as its frames need."""
    times = np.arange(int(2.0 * n_frames / tempo) + 1) / FEATURE_FPS
    rates, phases = rng.uniform(*WAVER_HZ, 3), rng.uniform(0.0, 2.0 * np.pi, 3)
    waves = np.sin(2.0 * np.pi * rates * times[:, None] + phases).sum(axis=1) * np.sqrt(2.0 / 3.0)
    return np.asarray(tempo * np.exp(rng.uniform(0.0, WAVERS) * waves))


def wandering(turns: Float, rng: np.random.Generator) -> Float:
    """Turns with arms and hands that wander besides, by no plan."""
    spread = np.full(turns.shape[1], 0.15)
    for side in (LEFT, RIGHT):
        spread[side.start + 1 : side.start + len(ARM)] = 1.0
    size = rng.normal(0.0, rng.uniform(0.05, WANDER_RAD), (turns.shape[1], 3)) * spread[:, None]
    return _swaying(turns, size, WANDER_HZ, 3, rng)


def _swaying(turns: Float, size: Float, hz: tuple[float, float], n_waves: int, rng: np.random.Generator) -> Float:
    """Turns with every joint turned besides by waves of ``size`` (R, 3)."""
    times = np.arange(len(turns))[:, None, None, None] / FEATURE_FPS
    shape = (*size.shape, n_waves)
    rates, phases = rng.uniform(*hz, shape), rng.uniform(0.0, 2.0 * np.pi, shape)
    waves = np.sin(2.0 * np.pi * rates * times + phases).sum(axis=-1) / np.sqrt(n_waves)
    return rotation.multiply(turns, rotation.exp(size * waves))


def skewed(turns: Float, rng: np.random.Generator) -> Float:
    """Turns whose joints run ahead or behind, each by so much throughout."""
    late = rng.normal(0.0, rng.uniform(0.0, SKEW), turns.shape[1])
    at = np.clip(np.arange(len(turns))[:, None] + late, 0.0, len(turns) - 1.001)
    low, rows = at.astype(int), np.arange(turns.shape[1])
    return rotation.nlerp(turns[low, rows], turns[low + 1, rows], at - low)


def exchanged(turns: Float, other: Float) -> Float:
    """Turns with the left arm of another take, as far as both go."""
    n_frames = min(len(turns), len(other))
    out = turns[:n_frames].copy()
    out[:, LEFT] = other[:n_frames, LEFT]
    return out


def elsewhere(turns: Float, rng: np.random.Generator) -> Float:
    """Turns of a body that stands or is rigged a little otherwise, and one that sways."""
    n_roles = turns.shape[1]
    if rng.random() < SET:
        turns = rotation.multiply(turns, rotation.exp(rng.normal(0.0, rng.uniform(0.0, SET_RAD), (n_roles, 3))))
    if rng.random() < SWAYING:
        turns = _swaying(turns, rng.normal(0.0, rng.uniform(0.0, SWAY_RAD), (n_roles, 3)), SWAY_HZ, 1, rng)
    return turns


def noisy(turns: Float, spread: float, rng: np.random.Generator) -> Float:
    """Turns that tremble by ``spread`` rad, from frame to frame alike by half."""
    white = rng.normal(0.0, spread, (len(turns), turns.shape[1], 3))
    white[1:] = 0.5 * white[:-1] + np.sqrt(0.75) * white[1:]
    return rotation.multiply(turns, rotation.exp(white))
