"""No hand through head, trunk or the other hand: wrists are pushed out of what they would lie in, smoothly in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision, smoothing
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.synth import pose
from signsplice.synth.signer import JOINTS, Signer, skeleton

Float = NDArray[np.float64]

TOLERANCE_CM = 0.2
"""Touching may press this deep."""
_ROUNDS = 30
_KERNEL = np.array([0.12, 0.35, 0.72, 1.0, 0.72, 0.35, 0.12])


def clear(states: Float, who: Signer, ends: bool = False) -> Float:
    """States (T, 63) with wrists moved out of head, trunk and each other where they lay deeper than the tolerance.

    Each push is spread over about five frames. ``ends``: the frames belong between two others, so that nothing moves
    next to them.
    """
    who = replace(who, left_handed=False)
    level = smoothing.fade_window(len(states)) if ends else np.ones(len(states))
    for n in range(_ROUNDS):
        depth, way = intrusion(states, who)
        gain = 0.6 if n < _ROUNDS // 2 else 1.0  # gently first: hands that meet are both pushed
        push = gain * np.maximum(depth - 0.7 * TOLERANCE_CM, 0.0) * (depth > TOLERANCE_CM)
        if not push.any():
            break
        moves = smoothing.spread_in_time(push[..., None] * way, _KERNEL) * level[:, None, None]
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
    depth, way = collision.hand_penetration(skeleton(who), turns, at)
    way = np.einsum("tba,thb->tha", turns[:, JOINTS["Spine2"]], way)
    return depth[:, ::-1], way[:, ::-1] * [[[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]]]
