"""Hands of written signs that give way a little in direction where a wrist or forearm would else bend far.

Up to the easy ranges directions are as they are written; they are a little wider than the 40 degrees of flexion and of
extension, and 40 from side to side, with which people do daily tasks (Ryu et al. 1991, Journal of Hand Surgery 16A:
409-419). Beyond, a hand yields by a part of the rest, never by more than ``YIELDS``; at a joint's limit it misses the
rest.
"""

from __future__ import annotations

import numpy as np

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.signer import elbows, pose
from signsplice.signer.arm_costs import MARGIN
from signsplice.signer.signer import Signer

YIELDS = np.deg2rad(8.0)
"""The most by which a hand yields."""
_EASY = np.deg2rad([[-78.0, 78.0], [-28.0, 18.0], [-48.0, 52.0]])
"""Twist of the forearm, deviation and flexion of the wrist from which on it does."""
_LIMITS = np.array([[-pose.FOREARM_LIMIT, pose.FOREARM_LIMIT], *pose.WRIST_LIMITS])
_SLOW = np.deg2rad(18.0)
"""How far beyond them it yields by 63 % of that."""


def directed(states: FloatArray, written: FloatArray, signer: Signer) -> FloatArray:
    """States (T, 65) whose hands have the rotations ``written`` (T, 2, 4) in the chest's axes, with the elbows where
    they are.
    """
    arm, swivels = elbows.solved(states, signer)
    return elbows.turned(states, arm, rotation.multiply(rotation.inverse(arm.fore), written), swivels, signer)


def beyond(angles: FloatArray) -> FloatArray:
    """How far twist, deviation and flexion (..., 3) are beyond the easy ranges."""
    return np.asarray(angles - np.clip(angles, *_EASY.T))


def eased(
    states: FloatArray,
    written: FloatArray,
    signer: Signer,
    added: FloatArray | float = 0.0,
    room: FloatArray | float = 0.0,
) -> FloatArray:
    """The same, as nearly as is easy, with what movements of forearm and wrist have ``added`` to their angles
    (T, 2, 3); these have ``room`` (T, 2, 3) to either side before a joint's limit.
    """
    arm, swivels = elbows.solved(states, signer)
    wrist = pose.wrist_at(arm, rotation.multiply(rotation.inverse(arm.fore), written), swivels)
    angles = np.stack([wrist.twist, wrist.deviation, wrist.flexion], axis=-1)  # (T, 2, 3)
    off = beyond(angles)
    size = np.linalg.norm(off, axis=-1, keepdims=True)
    missed = np.linalg.norm(angles - np.clip(angles, *_LIMITS.T), axis=-1, keepdims=True)
    share = (1.0 - np.exp(-size / _SLOW)) * np.maximum(0.0, 1.0 - missed / YIELDS)
    angles = angles - YIELDS * share * off / np.maximum(size, 1e-9)
    # Limits are approached softly from MARGIN before them on, which a movement needs free; without one nothing changes.
    inner = room + MARGIN * (2.0 * np.minimum(room / MARGIN, 1.0) - 1.0)
    angles = np.where(room > 0.0, np.clip(angles, _LIMITS[:, 0] + inner, _LIMITS[:, 1] - inner), angles) + added
    twist, swing = (np.pad(part, ((0, 0), (0, 0), side)) for part, side in
                    ((angles[..., :1], (0, 2)), (angles[..., 1:], (1, 0))))  # fmt: skip
    made = rotation.multiply(rotation.exp(twist), rotation.exp(swing))
    axis = rotation.rotate(rotation.inverse(arm.fore), arm.direction)
    quats = rotation.multiply(rotation.exp(swivels[..., None] * axis), made)
    return elbows.turned(states, arm, quats, swivels, signer)
