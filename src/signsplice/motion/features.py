"""What networks are shown of clips: the only definition, for training and for running.

Everything is seen at ``RATE`` frames a second, whatever the clip's own rate; on the canonical humanoid, whatever its
rig; and with the busier hand at the right, so that a mirrored clip is shown the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.canonical import LEFT, RIGHT, ROLES, TIPS, Signing

Float = NDArray[np.float64]

VERSION = 1
RATE = 30.0
"""Frames a second that networks see."""
N_TURNS = 6 * len(ROLES)
N_PLACES = 3 * len(TIPS)
N_FRAME = 2 * (N_TURNS + N_PLACES)
"""Numbers of a frame: turns and places, and their rates."""
_PER_SECOND = 1.0 / 5.0
"""Rates reach some units a second: scaled to about 1."""


@dataclass(frozen=True, eq=False)
class Course:
    """A signing body at any moments: turns as the first two columns of each matrix (T, R, 6), places (T, 12, 3), at
    ``RATE`` frames a second from 0.
    """

    turns: Float
    places: Float
    there: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.turns)


def to_6d(turns: Float) -> Float:
    """The first two columns (..., 6) of rotation matrices (..., 3, 3) (Zhou et al. 2019)."""
    return np.concatenate([turns[..., 0], turns[..., 1]], axis=-1)


def from_6d(values: Float) -> Float:
    """Rotation matrices (..., 3, 3) of six numbers, by Gram and Schmidt."""
    x = values[..., :3] / np.linalg.norm(values[..., :3], axis=-1, keepdims=True)
    y = values[..., 3:] - np.sum(values[..., 3:] * x, axis=-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def course(signing: Signing, times: Float | None = None) -> Course:
    """A signing body at ``times`` (T,), seconds from its first frame; at ``RATE`` over its whole length by default.

    Between frames both are interpolated evenly, turns as six numbers brought back to a rotation; before the first and
    after the last frame the body stays.
    """
    n_frames = len(signing.turns)
    if times is None:
        times = np.arange(int((n_frames - 1) * RATE / signing.fps + 1e-6) + 1) / RATE
    at = np.clip(np.asarray(times, np.float64) * signing.fps, 0.0, n_frames - 1.0)
    low = np.minimum(at.astype(int), max(n_frames - 2, 0))
    share = at - low
    if np.all(np.abs(share - np.round(share)) < 1e-9):
        exact = np.round(at).astype(int)
        return Course(to_6d(signing.turns[exact]), signing.places[exact], signing.there)
    high = np.minimum(low + 1, n_frames - 1)
    turns = to_6d(signing.turns)
    mixed = (1.0 - share)[:, None, None] * turns[low] + share[:, None, None] * turns[high]
    places = (1.0 - share)[:, None, None] * signing.places[low] + share[:, None, None] * signing.places[high]
    return Course(to_6d(from_6d(mixed)), places, signing.there)


def busier_left(*courses: Course) -> bool:
    """Whether the left wrist goes a longer way than the right one, over all courses together."""
    half = len(TIPS) // 2
    ways = [np.linalg.norm(np.diff(c.places[:, [0, half]], axis=0), axis=-1).sum(axis=0) for c in courses]
    left, right = np.sum(ways, axis=0)
    return bool(left > right)


def mirrored(one: Course) -> Course:
    """A course seen in the mirror."""
    flip = np.array([-1.0, 1.0, 1.0])
    order = np.r_[0 : LEFT.start, RIGHT.start : RIGHT.stop, LEFT.start : LEFT.stop]
    # A mirrored rotation is M A M, M = diag(-1, 1, 1): of its two columns x is negated beside the mirrored numbers.
    turns = one.turns[:, order] * np.concatenate([-flip, flip])
    half = len(TIPS) // 2
    places = np.concatenate([one.places[:, half:], one.places[:, :half]], axis=1) * flip
    return Course(turns, places, one.there[order])


def frames(one: Course) -> NDArray[np.float32]:
    """Numbers (T, N_FRAME) of a course: turns, places, and both as rates, to the frame before (0 at the first)."""
    flat = np.concatenate([one.turns.reshape(len(one), -1), one.places.reshape(len(one), -1)], axis=1)
    rates = np.zeros_like(flat)
    rates[1:] = np.diff(flat, axis=0) * (RATE * _PER_SECOND)
    return np.concatenate([flat, rates], axis=1).astype(np.float32)
