"""Keeps hands out of head, trunk and one another: wrists are pushed out of collisions, smoothly in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.motion import curves, kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.synth import pose
from signsplice.synth.signer import JOINTS, Signer, skeleton

TOLERANCE_CM = 0.2
"""Depth up to which a touch may press into the body."""
NEAR_CM = 1.0
"""Distance from the skin up to which a hand may be meant to touch it."""
_ROUNDS = 30
_STUCK_CM = 0.35
"""Depth from which a hand that is still in the body after these rounds is pushed on, in a steadier direction."""
_KERNEL = np.array([0.12, 0.35, 0.72, 1.0, 0.72, 0.35, 0.12])


def clear_collisions(states: FloatArray, signer: Signer, ends: bool = False) -> FloatArray:
    """States (T, 63) with wrists moved out of head, trunk and each other where they lay deeper than the tolerance.

    Each push is spread over about five frames. ``ends``: the frames belong between two others; pushes fade out towards
    both ends, so that their neighbours fit.
    """
    signer = replace(signer, left_handed=False)
    level = curves.fade_window(len(states)) if ends else np.ones(len(states))
    mean = np.zeros((len(states), 2, 3))
    for n in range(2 * _ROUNDS):
        depth, out = penetration(states, signer)
        if n >= _ROUNDS:
            if depth.max() < _STUCK_CM:
                break
            # On either side of a nose or a finger by turns: the mean direction leads out.
            mean = 0.8 * mean + 0.2 * out
            out = mean / (np.linalg.norm(mean, axis=-1, keepdims=True) + 1e-9)
        gain = 0.6 if n < _ROUNDS // 2 else 1.0  # gently first: of two hands that meet, both are pushed
        push = gain * np.maximum(depth - 0.7 * TOLERANCE_CM, 0.0) * (depth > TOLERANCE_CM)
        if not push.any():
            break
        displacements = curves.spread_in_time(push[..., None] * out, _KERNEL) * level[:, None, None]  # (T, 2, 3)
        moved = states.copy()
        for which in (0, 1):
            moved[:, 27 * which : 27 * which + 3] += displacements[:, which]
        states = moved
    return states


def penetration(states: FloatArray, signer: Signer) -> tuple[FloatArray, FloatArray]:
    """Depth (T, 2) of each hand, strong first, in head, trunk or the other hand, cm, negative where it is free; and the
    unit direction (T, 2, 3) out of there in the chest's axes, mirrored for the weak hand as its state is.
    """
    local_quats, roots = pose.rotations(states, signer)
    rotations, positions = kinematics.forward(Clip(skeleton(signer), local_quats, roots, 30.0))
    depth, out = collision.hand_penetration(skeleton(signer), rotations, positions)
    out = np.einsum("tba,thb->tha", rotations[:, JOINTS["Spine2"]], out)
    return depth[:, ::-1], out[:, ::-1] * [[[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]]]


def touching(states: FloatArray, signer: Signer) -> NDArray[np.bool_]:
    """Whether either hand touches head, trunk or the other hand, or nearly does (T,)."""
    depth, _ = penetration(states, replace(signer, left_handed=False))
    return np.asarray(depth.max(axis=1) > -NEAR_CM)
