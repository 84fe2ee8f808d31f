"""Fingers that move each in a time of its own: in a sign's changes of handshape, and in reaches."""

from __future__ import annotations

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.synth import pose
from signsplice.synth.rng import stream
from signsplice.synth.signer import Signer

_PER_FINGER = (4, 4, 4, 4, 5)
"""How many of ``hand.ANGLES`` belong to each finger, the thumb last."""
_MOST_FRAMES = 1.2
"""How much earlier or later than the hand a finger moves within a sign at most, frames of 30 a second."""
_HAND_ADVANCE, _FINGER_ADVANCE = 0.12, 0.15
"""How much the timing of all fingers of a hand, and of one more, differs between reaches: height of a bump on time."""
_MOST_ADVANCE = 0.27
"""The most that time may be advanced; from 0.29 on, fingers would go back."""
_SCALE = np.concatenate([np.full(3, 15.0), np.full(24, 0.5)])  # of a hand state: cm, radians


def delays(signer: Signer, gloss: str, take: int) -> FloatArray:
    """How much later than usual each finger angle of both hands moves within a word, (2, 21), frames of 30 a second.

    Half of it is the signer's habit, half the word's.
    """
    fingers = sum(
        0.5 * stream("finger_stagger", *names).uniform(-1.0, 1.0, (2, 5))
        for names in ((signer.name,), (signer.name, gloss, take))
    )
    return np.repeat(signer.manner.finger_stagger * _MOST_FRAMES * fingers, _PER_FINGER, axis=1)


def advances(start: FloatArray, end: FloatArray, leads: FloatArray, signer: Signer) -> FloatArray:
    """How far the time of each number (63,) of a reach between two states is advanced at half time, as a fraction.

    A smooth function of both states, so that equal seams are equal and near ones alike; waves of random phase and
    direction make it differ between reaches and fingers.

    leads: by how much each finger angle's progress leads at half time, (21,)
    """
    advance = np.zeros(pose.SIZE)
    for which, first in enumerate((0, 27)):
        seen = np.concatenate([s[first : first + 27] / _SCALE for s in (start, end)])
        rng = stream("finger_stagger", signer.name, "reach", which)
        waves = np.sin(0.5 * rng.standard_normal((6, len(seen))) @ seen + 2.0 * np.pi * rng.random(6))
        spread = np.repeat(_HAND_ADVANCE * waves[0] + _FINGER_ADVANCE * waves[1:], _PER_FINGER)
        usual = leads / 1.875  # the slope of a minimum-jerk movement at half time
        fingers = advance[first : first + 27][pose.FINGERS]
        fingers += np.clip(usual + signer.manner.finger_stagger * spread, -_MOST_ADVANCE, _MOST_ADVANCE)
    return advance
