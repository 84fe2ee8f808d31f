"""Hasty movements that stay short of their place, and signs at the head that are made lower.

Faster signing lowers signs at the forehead (Tyrone and Mauk 2010, Journal of Phonetics 38: 317-328) and leaves
movements short of their targets (Mauk 2003, Undershoot in two modalities, University of Texas). A touch stays a touch.
"""

from __future__ import annotations

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.synth import pose
from signsplice.synth.clearance import TOUCH_CM, hand_clearances
from signsplice.synth.locations import ON_HEAD
from signsplice.synth.paths import translated
from signsplice.synth.phonology import Sign
from signsplice.synth.signer import Signer

_USUAL_CM, _MOST_CM = 0.5, 2.0
"""How far short a movement stays at the usual tempo, and at most."""
_OF_DISTANCE = 0.1
"""The most that a movement stays short, as a fraction of its distance."""
_LOWER = 0.5
"""How much lower still signs at the head are made, over how far short movements stay; both together are limited."""


def short_cm(tempo: float, signer: Signer) -> float:
    """How far short of its place a movement of a tempo (1 is usual) stays, cm: a few mm to 2 cm."""
    return signer.manner.undershoot * min(_USUAL_CM * tempo**3, _MOST_CM) * signer.scale


def undershot(
    pairs: list[tuple[FloatArray, FloatArray]],
    sign: Sign,
    touching: list[bool],
    rest: FloatArray,
    tempo: float,
    signer: Signer,
) -> list[tuple[FloatArray, FloatArray]]:
    """Strong and weak hand's states (27,) in a sign's segments, the strong one moved towards the segment before, in the
    first towards ``rest`` (63,), unless it touches there; a weak hand that mirrors it moves too. A posture that is kept
    stays the same.
    """
    amount = short_cm(tempo, signer)
    if amount == 0.0:
        return pairs
    states = np.array([np.concatenate([*pair, np.zeros(9)]) for pair in pairs])
    near = hand_clearances(states, signer)[:, [0, 2]].min(axis=1) < TOUCH_CM
    moved: list[tuple[FloatArray, FloatArray]] = []
    for n, (strong, weak) in enumerate(pairs):
        if n and np.array_equal(strong, pairs[n - 1][0]):
            moved.append((moved[-1][0], moved[-1][0] if weak is strong else weak))
            continue
        before = states[n - 1] if n else rest
        if touching[n] or near[n]:
            moved.append((strong, weak))
            continue
        back = before[pose.WRIST] - strong[pose.WRIST]
        shift = back * min(amount / max(float(np.linalg.norm(back)), 1e-9), _OF_DISTANCE)
        if sign.segments[n].strong.location in ON_HEAD:
            shift = shift - np.array([0.0, _LOWER * amount, 0.0])
            shift *= min(1.0, _MOST_CM * signer.manner.undershoot * signer.scale / float(np.linalg.norm(shift)))
        short = translated(strong, shift, signer)
        moved.append((short, short if weak is strong else weak))
    return moved
