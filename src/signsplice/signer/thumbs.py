"""Thumbs that open while fingers of their hand would go through them, as when a fist closes or fingers flick out."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from signsplice.body.capsules import body_capsules
from signsplice.body.clearance import clearances
from signsplice.motion.arrays import FloatArray
from signsplice.motion.curves import fade_window
from signsplice.rig.roles import FINGERS
from signsplice.signer import hand, pose
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.signer import skeleton

_MOST_CM = 0.3
"""How deep a finger may lie in the thumb."""
_OPENINGS = np.linspace(0.0, 1.0, 6)
"""How far a thumb is opened, in steps that are tried in order; 1 is as in handshape 5."""
_REACH = 5
"""Frames around one in which a thumb opens, at most."""
_THUMB = slice(16, 21)
"""Where the thumb's angles are among a hand's."""
_FINGER_BONES = [(3 * f + n, 3 * f + n + 1 if n < 2 else 15 + f) for f in (1, 2, 3, 4) for n in (0, 1, 2)]
_THUMB_BONES = [(1, 2), (2, 15)]
"""Both ends of bones among a hand's points."""
_CAPSULES = [
    [f"right{FINGERS[f]}{bone}" for f in (1, 2, 3, 4) for bone in ("Proximal", "Intermediate", "Distal")],
    ["rightThumbProximal", "rightThumbDistal"],
]


def opened(states: FloatArray, ends: bool = False) -> FloatArray:
    """States (T, 65) with thumbs opened as far as fingers would else lie deeper in them than 3 mm; ``ends``: the frames
    belong between two others, and what is changed fades out towards both.
    """
    angles = pose.hands(states)[..., pose.FINGERS]  # (T, 2, 21)
    open_thumb = HANDSHAPES["5"].angles[_THUMB]
    near = maximum_filter1d(thumb_depth(angles) > _MOST_CM, 2 * _REACH + 1, axis=0, mode="constant")
    if not near.any():
        return states
    tried = np.repeat(angles[near][:, None], len(_OPENINGS), axis=1)  # (N, K, 21)
    tried[..., _THUMB] += _OPENINGS[:, None] * (open_thumb - tried[..., _THUMB])
    depth = thumb_depth(tried)
    free = depth <= _MOST_CM
    chosen = np.where(free.any(axis=1), free.argmax(axis=1), depth.argmin(axis=1))
    needed, most = np.zeros(near.shape), np.ones(near.shape)
    needed[near] = _OPENINGS[chosen]
    beyond = ~free & (np.arange(len(_OPENINGS)) > chosen[:, None])  # a thumb below fingers cannot open
    most[near] = _OPENINGS[np.where(beyond.any(axis=1), beyond.argmax(axis=1) - 1, -1)]
    level = gaussian_filter1d(maximum_filter1d(needed, _REACH, axis=0, mode="nearest"), 1.0, axis=0, mode="nearest")
    level = np.minimum(level, most)
    if ends:
        level = level * fade_window(len(states))[:, None]
    states = states.copy()
    thumbs = pose.hands(states)[..., pose.FINGERS][..., _THUMB]
    thumbs += level[..., None] * (open_thumb - thumbs)
    return states


def thumb_depth(angles: FloatArray) -> FloatArray:
    """Depth (...) of the deepest finger in the thumb of hands with ``angles`` (..., 21), cm, negative where free."""
    points = hand.points(angles)
    body = body_capsules(skeleton())
    radii = [body.radii[[body.keys.index(key) for key in keys]] for keys in _CAPSULES]
    (p, u), (q, v) = (
        (points[..., first, :], points[..., last, :] - points[..., first, :])
        for first, last in (np.transpose(bones).tolist() for bones in (_FINGER_BONES, _THUMB_BONES))
    )
    apart = p[..., :, None, :] - q[..., None, :, :]  # (..., 12, 2, 3)
    u, v = (np.broadcast_to(axis, apart.shape) for axis in (u[..., :, None, :], v[..., None, :, :]))
    own, other = (np.broadcast_to(r, (*apart.shape[:-1], 2)) for r in (radii[0][:, None], radii[1][None]))
    return np.asarray(-clearances(apart, u, v, own, other).distance.min(axis=(-2, -1)))
