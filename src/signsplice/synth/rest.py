"""Where a signer's hands are between signs."""

from __future__ import annotations

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.synth import locations, pose
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.phonology import Posture
from signsplice.synth.rng import stream
from signsplice.synth.signer import HANGING, Signer

_HELD = {
    "folded": (
        Posture("rest", "belly", "palm", (0.0, 0.3, -0.95), (-0.8, -0.6, 0.0), off=5.0),
        Posture("rest", "belly", "palm", (0.0, 0.3, -0.95), (-0.8, -0.6, 0.0), off=1.0, shift=(0.0, -2.0, 0.0)),
    ),
    "bent": (Posture("rest", "waist", "palm", (-0.9, -0.3, 0.0), (-0.3, -0.2, 0.93), off=7.0, shift=(3.0, 0.0, 0.0)),)
    * 2,
    "low": (
        Posture("rest", "belly", "palm", (-0.2, 0.1, -0.97), (-0.5, -0.86, 0.0), off=5.0, shift=(2.0, -13.0, 3.0)),
        Posture("rest", "belly", "palm", (-0.2, 0.1, -0.97), (-0.5, -0.86, 0.0), off=2.0, shift=(2.0, -15.0, 1.0)),
    ),
}
"""Postures of the strong and the weak hand at each rest but hanging."""
_HELD_LOWER_CM = 2.0
"""How much lower than these postures hands rest."""


def resting(signer: Signer, *names: str | int) -> FloatArray:
    """The state (63,) of a signer at rest; ``names`` seed its small variations."""
    rng = stream("rest", signer.name, *names)
    state = np.zeros(pose.SIZE)
    if signer.rest != HANGING:
        for first, posture in zip((0, 27), _HELD[signer.rest], strict=True):
            hand_state = locations.weak_hand(posture, signer)
            offset = np.array([0.0, 2.0 * signer.rest_out_cm - _HELD_LOWER_CM, 0.0])
            hand_state[:3] += 0.6 * rng.standard_normal(3) + offset
            hand_state[6:] *= 1.0 + 0.06 * rng.standard_normal()
            state[first : first + 27] = hand_state
        return state
    for first in (0, 27):
        jitter = 0.6 * rng.standard_normal(3)
        wrist = np.array([-26.0 - signer.rest_out_cm, -39.5, 4.0 + signer.rest_fwd_cm]) + jitter
        arms = 0.5 * (signer.arms + 1.0)
        wrist = wrist * np.array([signer.shoulders, arms, 1.0]) * signer.scale
        state[first : first + 3] = wrist
        quat = locations.facing((-1.0, 0.0, -0.25), (0.05, -1.0, 0.12))
        state[first + 3 : first + 6] = pose.hand_rotvecs(wrist, quat, signer)
        state[first + 6 : first + 27] = HANDSHAPES["rest"].angles * (1.0 + 0.06 * rng.standard_normal())
    return state
