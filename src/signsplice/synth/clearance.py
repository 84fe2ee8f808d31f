"""No hand through head, trunk or the other hand: wrists are pushed out of what they would lie in, smoothly in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import contact, kinematics
from signsplice.motion.clip import Clip
from signsplice.synth import pose
from signsplice.synth.signer import JOINTS, Signer, skeleton

Float = NDArray[np.float64]

TOLERANCE_CM = 0.2
"""Touching may press this deep."""
_ROUNDS = 30


def clear(states: Float, who: Signer, ends: bool = False) -> Float:
    """States (T, 63) with wrists moved out of head, trunk and each other where they lay deeper than the tolerance.

    Each push is spread over about five frames. ``ends``: the frames belong between two others, so that nothing moves
    next to them.
    """
    who = replace(who, left_handed=False)
    level = _fade(len(states)) if ends else np.ones(len(states))
    for n in range(_ROUNDS):
        depth, way = intrusion(states, who)
        gain = 0.6 if n < _ROUNDS // 2 else 1.0  # gently first: hands that meet are both pushed
        push = gain * np.maximum(depth - 0.7 * TOLERANCE_CM, 0.0) * (depth > TOLERANCE_CM)
        if not push.any():
            break
        moves = _spread(push[..., None] * way) * level[:, None, None]
        moved = states.copy()
        for which in (0, 1):
            moved[:, 27 * which : 27 * which + 3] += moves[:, which]
        states = moved
    return states


def intrusion(states: Float, who: Signer) -> tuple[Float, Float]:
    """How deep (T, 2) each hand, strong first, lies in head, trunk or the other hand, cm (negative: free), and the way
    out (T, 2, 3) in the chest's axes, mirrored for the weak hand as its numbers are.
    """
    local, root = pose.rotations(states, who)
    turns, at = kinematics.forward(Clip(skeleton(who), local, root, 30.0))
    depth, way = contact.hands_inside(skeleton(who), turns, at)
    way = np.einsum("tba,thb->tha", turns[:, JOINTS["Spine2"]], way)
    return depth[:, ::-1], way[:, ::-1] * [[[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]]]


_KERNEL = np.array([0.12, 0.35, 0.72, 1.0, 0.72, 0.35, 0.12])


def _spread(push: Float) -> Float:
    """Pushes (T, 2, 3) spread to their neighbours in time: at each frame the sum, no larger than the largest near."""
    flat = push.reshape(len(push), -1)
    padded = np.pad(flat, ((3, 3), (0, 0)))
    summed = np.stack([padded[k : k + len(flat)] * w for k, w in enumerate(_KERNEL)]).sum(axis=0)
    counts = np.pad((np.abs(flat).max(axis=1) > 0).astype(float), 3)
    weights = sum(counts[k : k + len(flat)] * w for k, w in enumerate(_KERNEL))
    return np.asarray((summed / np.maximum(weights, 1.0)[:, None]).reshape(push.shape))


def _fade(n_frames: int) -> Float:
    """0 just outside both ends, 1 well inside, with slope and curvature 0 at the ends (n_frames,)."""
    edge = np.minimum(np.arange(1, n_frames + 1), np.arange(n_frames, 0, -1)) / max(1.6, 0.25 * (n_frames + 1))
    near = np.clip(edge, 0.0, 1.0)
    return np.asarray(near**3 * (10.0 + near * (-15.0 + 6.0 * near)))
