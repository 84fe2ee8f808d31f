"""Faces for tests: random coefficients that move smoothly, and lids that blink."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.splicing.passes.face_seams import LIDS

LID_COLUMNS = [ARKIT_CHANNELS.index(name) for name in LIDS]


def random_face(seed: int, n_frames: int, fps: float = 30.0, channels: tuple[str, ...] = ARKIT_CHANNELS) -> Face:
    """A face whose lids close every few seconds and whose other coefficients wander."""
    rng = np.random.default_rng(seed)
    noise = gaussian_filter1d(rng.normal(size=(n_frames, 52)), fps * rng.uniform(0.05, 0.25), axis=0, mode="nearest")
    weights = np.clip(noise * rng.uniform(0.3, 1.2) + rng.uniform(-0.2, 0.3, 52), 0.0, 1.0)
    weights[:, LID_COLUMNS] = blinking(rng, n_frames, fps)[:, None]
    return Face(channels, weights[:, [ARKIT_CHANNELS.index(name) for name in channels]])


def blinking(rng: np.random.Generator, n_frames: int, fps: float) -> FloatArray:
    """Lids (T,) with blinks of 0.2 to 0.35 s."""
    lids, at = np.full(n_frames, rng.uniform(0.0, 0.12)), int(rng.integers(0, int(0.5 * fps) + 1))
    while at < n_frames:
        closing, opening = (max(2, round(fps * rng.uniform(*times))) for times in ((0.08, 0.12), (0.12, 0.22)))
        blink = np.r_[np.linspace(0.0, 1.0, closing + 1)[1:], np.linspace(1.0, 0.0, opening + 1)[1:]]
        part = blink[: n_frames - at] * rng.uniform(0.75, 1.0)
        lids[at : at + len(part)] = np.maximum(lids[at : at + len(part)], part)
        at += len(blink) + int(rng.integers(int(0.3 * fps), int(2.0 * fps)))
    return lids


def half_blinks(lids: FloatArray) -> list[int]:
    """Frames at which lids (T,) that were closing open again before they are closed."""
    signs = np.sign(np.where(np.abs(np.diff(lids)) < 1e-9, 0.0, np.diff(lids)))
    turns = [0, *(k for k in range(1, len(lids) - 1) if signs[k - 1] != signs[k]), len(lids) - 1]
    around = zip(turns, turns[1:], turns[2:], strict=False)
    return [b for a, b, c in around if min(lids[b] - lids[a], lids[b] - lids[c]) > 0.08 and lids[b] < 0.6]


def with_random_face(clip: Clip, seed: int, channels: tuple[str, ...] = ARKIT_CHANNELS) -> Clip:
    """A clip with ``random_face``."""
    return replace(clip, face=random_face(seed, len(clip), clip.fps, channels))
