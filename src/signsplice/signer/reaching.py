"""Hands of which a part touches: brought into contact and no deeper, and turned where the arm bends no farther."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.signer import pose
from signsplice.signer.avoidance import TOLERANCE_CM, penetration
from signsplice.signer.figure import Figure
from signsplice.signer.signer import COLLAR, SHOULDER, Signer

_ROUNDS = 12
"""How often a hand whose part touches is moved out of what it lies in, or back, at most."""
NEAREST_CM, _MOST_LEAN = 16.5, np.deg2rad(40.0)
"""How near to its shoulder a wrist can be, and how far a hand that touches is turned for that."""


def clear_of_shoulder(
    wrist: FloatArray, quat: FloatArray, part: FloatArray, signer: Signer
) -> tuple[FloatArray, FloatArray]:
    """Wrist (3,) and rotation (4,) of a hand turned about a part of it, ``part`` (3,) from the wrist, so that the wrist
    is not so near to its shoulder that the elbow cannot bend so far.
    """
    shoulder = (COLLAR + SHOULDER) * np.array([-signer.shoulders, 1.0, 1.0]) * signer.scale
    least = NEAREST_CM * signer.scale
    back, away = -part, shoulder - wrist - part
    axis = np.cross(away, back)
    lengths = float(np.linalg.norm(back) * np.linalg.norm(away))
    if np.linalg.norm(wrist - shoulder) >= least or np.linalg.norm(axis) < 1e-6:
        return wrist, quat
    wanted = np.arccos(np.clip((back @ back + away @ away - least**2) / (2.0 * lengths), -1.0, 1.0))
    angle = min(float(wanted - np.arccos(np.clip(back @ away / lengths, -1.0, 1.0))), _MOST_LEAN)
    turn = rotation.exp(angle * axis / np.linalg.norm(axis))
    return wrist + part + rotation.rotate(turn, back), rotation.multiply(turn, quat)


def in_contact(
    hand_state: FloatArray, quat: FloatArray, weak: FloatArray | None, signer: Signer, normal: FloatArray
) -> FloatArray:
    """A hand state (27,) moved as little as may be until the hand is no deeper in the body, or in the other hand, than
    a touch: by turns back to where its part touches, and out of what it lies in, rather along ``normal`` (3,). The
    other hand is ``weak`` (27,), or its mirror image where that is None.
    """
    signer = replace(signer, left_handed=False)
    wanted, made, free = hand_state[:3].copy(), hand_state.copy(), hand_state
    figure = Figure(pose.of_hands(made, made if weak is None else weak)[None], signer)
    for n in range(_ROUNDS):
        state = pose.of_hands(made, made if weak is None else weak)
        depth, out = penetration(state[None], signer, figure=figure)
        if depth[0, 0] > TOLERANCE_CM:
            way = out[0, 0] + normal
            wrist = made[:3] + (depth[0, 0] - 0.5 * TOLERANCE_CM) * (
                0.6 if weak is None else 1.0
            ) * way / np.linalg.norm(way)
        else:
            free = made
            if np.linalg.norm(wanted - made[:3]) < 0.1 or n >= _ROUNDS - 4:
                break
            wrist = 0.5 * (made[:3] + wanted)
        made = np.concatenate([wrist, pose.hand_rotvecs(wrist, quat, signer), hand_state[6:]])
    return free if free is not hand_state else made
