"""Forearms and wrists that turn no faster than people turn them.

The forearm's twist that a written hand needs, and the wrist's swing, can pass half a turn: then they would go from one
of their limits to the other in a frame. The twist of such an arm is chosen anew, on one path over the whole word
(Viterbi 1967): near to what is written, and turned over in its own time where it must be; the swing is smoothed there.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from signsplice.body import swivel
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.signer import elbows, pose
from signsplice.signer.signer import Signer

_FASTEST = 18.0
"""Speed of a forearm's turn, radians a second, from which on its twist is chosen anew."""
_SWUNG = 0.6
"""Share of a wrist's swing that counts as such a turn: people nod with up to 12 radians a second."""
_GRID = np.deg2rad(np.linspace(-92.0, 92.0, 25))
_MISSED = 0.5
"""Angle by which a twist misses what is written that costs 1, radians."""
_CHANGE = 4.2
"""Change of the twist that costs 1 a frame, radians a second."""
_WIDTH_S, _AROUND_S = 0.045, 0.25
"""Standard deviation of the Gaussian that smooths what was chosen, and how far around it that is taken, seconds."""


def steadied(states: FloatArray, signer: Signer, fps: float) -> FloatArray:
    """States (T, 65) in which no forearm or wrist turns over in a frame; the states themselves where none did."""
    arm, wrist = pose.posed_arms(states, signer)
    kept = np.clip(wrist.twist, -pose.FOREARM_LIMIT, pose.FOREARM_LIMIT)
    turned = kept.copy()
    swing = np.clip(np.stack([wrist.deviation, wrist.flexion], axis=-1), *pose.WRIST_LIMITS.T)
    fast = (
        np.maximum(np.abs(np.diff(kept, axis=0)), _SWUNG * np.linalg.norm(np.diff(swing, axis=0), axis=-1)) * fps
        > _FASTEST
    )  # (T - 1, 2)
    if not fast.any():
        return states
    for which in np.flatnonzero(fast.any(axis=0)):
        path = _path(wrist.twist[:, which], fps)
        odd = np.abs(path - kept[:, which]) > _MISSED
        odd[1:] |= fast[:, which]
        near = maximum_filter1d(odd.astype(np.float64), 2 * round(_AROUND_S * fps) + 1)
        near = gaussian_filter1d(near, 0.4 * _AROUND_S * fps)
        path = gaussian_filter1d(path, _WIDTH_S * fps, mode="nearest")
        turned[:, which] += near * (path - kept[:, which])
        smooth = gaussian_filter1d(swing[:, which], _WIDTH_S * fps, axis=0, mode="nearest")
        swing[:, which] += near[:, None] * (smooth - swing[:, which])
    axis = rotation.rotate(rotation.inverse(arm.fore), arm.direction)
    zero = np.zeros_like(turned)
    quats = rotation.multiply(
        rotation.exp(wrist.swivel[..., None] * axis),
        rotation.multiply(
            rotation.exp(np.stack([turned, zero, zero], axis=-1)),
            rotation.exp(np.concatenate([zero[..., None], swing], axis=-1)),
        ),
    )
    made = states.copy()
    fast = fast.any(axis=0)
    pose.hands(made)[:, fast, pose.ROTVEC] = rotation.log(quats)[:, fast]
    return elbows.kept(made, states, signer)


def _path(twist: FloatArray, fps: float) -> FloatArray:
    """The twist (T,) of least cost for a wanted one (T,), in which half a turn may be added or taken away."""
    missed = np.angle(np.exp(1j * (twist[:, None] - _GRID)))
    change = np.square((_GRID[:, None] - _GRID) * fps / _CHANGE)
    return np.asarray(_GRID[swivel.smoothest(np.square(missed / _MISSED), [change] * (len(twist) - 1))])
