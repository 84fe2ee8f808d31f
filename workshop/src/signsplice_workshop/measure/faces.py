"""Makes random faces, and finds the faults of a face at a seam: jumps, and blinks that are cut in half.

No recordings of faces are at hand: ``random_face`` wanders more than people's faces do, and its lids blink as theirs
do.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from signsplice.motion import Clip, FloatArray, copy_unchecked
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.splicing.contracts import Cut
from signsplice.splicing.faces import EASING, LIDS, largest_step

SIGNATURE = f"face:random,jump-over-{EASING.step_percentile:g}%-or-even-step,lids-apart"
LID_COLUMNS = [ARKIT_CHANNELS.index(name) for name in LIDS]
_BLINK_S = 0.4
"""Time from a seam within which a blink that is under way there began or ends, s."""
_MIN_CLOSING, _CLOSED = 0.08, 0.6
"""Lids that close by the first and open again before they reach the second blink by half."""


def random_face(seed: int, n_frames: int, fps: float = 30.0, channels: tuple[str, ...] = ARKIT_CHANNELS) -> Face:
    """Returns a face whose lids close every few seconds and whose other coefficients wander."""
    rng = np.random.default_rng(seed)
    noise = gaussian_filter1d(rng.normal(size=(n_frames, 52)), fps * rng.uniform(0.05, 0.25), axis=0, mode="nearest")
    weights = np.clip(noise * rng.uniform(0.3, 1.2) + rng.uniform(-0.2, 0.3, 52), 0.0, 1.0)
    weights[:, LID_COLUMNS] = _draw_lids(rng, n_frames, fps)[:, None]
    return Face(channels, weights[:, [ARKIT_CHANNELS.index(name) for name in channels]])


def add_random_face(clip: Clip, seed: int, channels: tuple[str, ...] = ARKIT_CHANNELS) -> Clip:
    """Returns a clip with ``random_face``."""
    return copy_unchecked(clip, face=random_face(seed, len(clip), clip.fps, channels))


def _draw_lids(rng: np.random.Generator, n_frames: int, fps: float) -> FloatArray:
    """Returns lids (T,) with blinks of 0.2 to 0.35 s."""
    lids, frame = np.full(n_frames, rng.uniform(0.0, 0.12)), int(rng.integers(0, int(0.5 * fps) + 1))
    while frame < n_frames:
        closing, opening = (max(2, round(fps * rng.uniform(*times))) for times in ((0.08, 0.12), (0.12, 0.22)))
        blink = np.r_[np.linspace(0.0, 1.0, closing + 1)[1:], np.linspace(1.0, 0.0, opening + 1)[1:]]
        part = blink[: n_frames - frame] * rng.uniform(0.75, 1.0)
        lids[frame : frame + len(part)] = np.maximum(lids[frame : frame + len(part)], part)
        frame += len(blink) + int(rng.integers(int(0.3 * fps), int(2.0 * fps)))
    return lids


def find_half_blinks(lids: FloatArray) -> list[int]:
    """Returns the frames at which lids (T,) that were closing open again before they are closed."""
    signs = np.sign(np.where(np.abs(np.diff(lids)) < 1e-9, 0.0, np.diff(lids)))
    turns = [0, *(k for k in range(1, len(lids) - 1) if signs[k - 1] != signs[k]), len(lids) - 1]
    neighbours = zip(turns, turns[1:], turns[2:], strict=False)
    return [
        b for a, b, c in neighbours if min(lids[b] - lids[a], lids[b] - lids[c]) > _MIN_CLOSING and lids[b] < _CLOSED
    ]


def join_linearly(before: Clip, after: Clip, cut: Cut, n_frames: int) -> Face | None:
    """Returns the face of a clip up to its cut, ``n_frames`` on a straight line, and the face of the next clip; None if
    one has none.
    """
    if before.face is None or after.face is None:
        return None
    a, b = before.face.of(ARKIT_CHANNELS)[: cut.pre + 1], after.face.of(ARKIT_CHANNELS)[cut.post :]
    gap_weights = a[-1] + np.arange(1, n_frames + 1)[:, None] / (n_frames + 1) * (b[0] - a[-1])
    return Face(ARKIT_CHANNELS, np.concatenate([a, gap_weights, b]))


def find_faults(face: Face | None, gap: tuple[int, int], before: Clip, after: Clip) -> tuple[bool, bool]:
    """Returns whether a face with new frames ``gap`` between those of two clips jumps there, and whether it blinks by
    half. It jumps if a coefficient other than lids changes by more than in most frames of the two, and than even
    steps would. False if one has no face.
    """
    if face is None or before.face is None or after.face is None:
        return False, False
    first, stop = gap
    weights, start = face.of(ARKIT_CHANNELS), max(0, first - round(_BLINK_S * before.fps))
    seam = np.delete(weights[first - 1 : stop + 1], LID_COLUMNS, axis=1)
    even_step = np.abs(seam[-1] - seam[0]) / (len(seam) - 1)
    limit = max(largest_step(before.face, after.face), largest_step(face[:first], face[stop:]))  # also at a tempo
    largest_allowed = np.maximum(limit, even_step) + 1e-9
    lids = weights[start : stop + round(_BLINK_S * before.fps), LID_COLUMNS[0]]
    half_blinks = [start + k for k in find_half_blinks(lids) if first - 1 <= start + k <= stop]
    return bool((np.abs(np.diff(seam, axis=0)).max(axis=0) > largest_allowed).any()), bool(half_blinks)
