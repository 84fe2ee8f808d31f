"""The hand: how long its bones are, which angles move it, how far they go, and where that puts every joint.

Frame: the right hand at rest, its wrist at the origin, fingers along -X, palm facing -Y, thumb side +Z; centimetres of
a signer 1.70 m tall, whose hand is 0.108 of stature long (Drillis and Contini 1966). Mirror x for the left hand.

Lengths: segments between joint centres as shares of hand length after Buchholz, Armstrong and Goldstein (1992,
Ergonomics 35: 261-273), the thumb's phalanges shortened to the bone lengths of Buryanov and Kotiuk (2010, Int. J.
Morphol. 28: 755-758) plus the heads that lie in the joints. The last length of a finger ends inside the pulp, so that a
capsule as thick as the finger ends where the finger ends. The arch of the knuckles is fixed: the palm does not fold.

Angles: 21 numbers, radians, all 0 at rest (``ANGLES``). A finger's first joint turns by spread about the palm's normal
after flexion about the knuckles' line, so that a bent finger's spread becomes twist, as the collateral ligaments have
it. Flexion is positive towards the palm. Spread is positive away from the middle finger's line; the middle finger's own
is positive towards the index (rejected: fingers that spread about the bent axis, which part sideways in a fist). The
thumb's first joint has flexion (the metacarpal swings across the palm, towards the little finger; negative is radial
abduction), abduction (out of the palm's plane, away from it) and opposition (about its own bone, the pulp towards the
fingers; it stands for all the twist along the thumb, about 90 degrees in all after Kapandji 1982).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signsplice.motion import rotation

Float = NDArray[np.float64]

FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")
JOINTS = tuple(f"{finger}{n}" for finger in FINGERS for n in (1, 2, 3))
"""The order of ``rotations``; the thumb's joints are CMC, MCP and IP, a finger's MCP, PIP and DIP."""

POINTS = JOINTS + tuple(f"{finger}Tip" for finger in FINGERS)
"""The order of ``points``."""

ANGLES = (
    *(f"{finger}-{name}" for finger in FINGERS[1:] for name in ("spread", "mcp", "pip", "dip")),
    *(f"Thumb-{name}" for name in ("flexion", "abduction", "opposition", "mcp", "ip")),
)
"""What the 21 numbers of a hand's configuration are."""


def _fixed(values: ArrayLike) -> Float:
    array = np.array(values, np.float64)
    array.flags.writeable = False
    return array


KNUCKLES: dict[str, Float] = {
    "Thumb": _fixed((-1.9, -1.2, 2.2)),
    "Index": _fixed((-8.5, 0.0, 2.9)),
    "Middle": _fixed((-8.6, 0.2, 0.7)),
    "Ring": _fixed((-8.0, 0.0, -1.45)),
    "Pinky": _fixed((-7.3, -0.4, -3.4)),
}
"""From the wrist to the first joint of each finger, cm."""

PHALANGES: dict[str, tuple[float, float, float]] = {
    "Thumb": (4.3, 3.4, 2.2),
    "Index": (4.5, 2.6, 1.6),
    "Middle": (4.9, 3.0, 1.75),
    "Ring": (4.5, 2.9, 1.75),
    "Pinky": (3.6, 2.1, 1.5),
}
"""Lengths of the three bones of each finger, cm."""

THUMB_DIRECTION: Float = _fixed(np.array([-0.72, -0.28, 0.63]) / np.linalg.norm([-0.72, -0.28, 0.63]))
"""Which way the thumb points at rest; the fingers point along -X."""

LIMITS: Float = _fixed(
    np.deg2rad(
        [
            *((-20.0, 20.0), (-30.0, 100.0), (-5.0, 105.0), (-5.0, 85.0)),
            *((-20.0, 20.0), (-30.0, 100.0), (-5.0, 105.0), (-5.0, 85.0)),
            *((-20.0, 20.0), (-30.0, 100.0), (-5.0, 105.0), (-5.0, 85.0)),
            *((-20.0, 35.0), (-30.0, 100.0), (-5.0, 105.0), (-5.0, 85.0)),
            *((-25.0, 50.0), (-25.0, 45.0), (-25.0, 65.0), (-10.0, 70.0), (-15.0, 88.0)),
        ]
    )
)
"""How far each angle goes, (21, 2). Flexion of the fingers after Hume et al. (1990, J. Hand Surg. 15A: 240-243); their
extension and spread after the American Academy of Orthopaedic Surgeons (1965, Joint Motion), the little finger's spread
after Chatzioglou, Pinar and Govsa (2024, Anat. Cell Biol. 57: 172-182), and as far the other way, as crossed fingers
show; the thumb the most that Barakat, Field and Taylor found (2013, Hand 8: 179-182), counted from its rest."""

_SPREAD_SIGN = np.array([1.0, 1.0, -1.0, -1.0])  # about +Y, which turns -X towards the thumb's side
_LENGTHS = np.array([PHALANGES[finger] for finger in FINGERS[1:]])
_ROOTS = np.array([KNUCKLES[finger] for finger in FINGERS[1:]])

# The thumb's axes. Out of the palm's plane: square to the thumb and to the palm's normal.
_OUT = np.array([THUMB_DIRECTION[2], 0.0, -THUMB_DIRECTION[0]]) / np.hypot(THUMB_DIRECTION[0], THUMB_DIRECTION[2])
# Its own joints bend it half across the palm, half towards the palm's front, as the nail's plane lies at rest.
_ACROSS = np.cross(THUMB_DIRECTION, _OUT)
_BEND = np.cos(np.deg2rad(40.0)) * -_ACROSS + np.sin(np.deg2rad(40.0)) * _OUT


def rotations(angles: ArrayLike) -> Float:
    """Local rotations (..., 15, 4) x y z w of the right hand's ``JOINTS`` for ``angles`` (..., 21)."""
    half = 0.5 * np.asarray(angles, np.float64)
    sin, cos = np.sin(half), np.cos(half)
    out = np.zeros((*half.shape[:-1], 15, 4))
    finger_sin = sin[..., :16].reshape(*half.shape[:-1], 4, 4)
    finger_cos = cos[..., :16].reshape(*half.shape[:-1], 4, 4)
    spread, flexion = finger_sin[..., 0] * _SPREAD_SIGN, finger_sin[..., 1]
    spread_cos, flexion_cos = finger_cos[..., 0], finger_cos[..., 1]
    out[..., 3::3, 0], out[..., 3::3, 1] = spread * flexion, spread * flexion_cos
    out[..., 3::3, 2], out[..., 3::3, 3] = spread_cos * flexion, spread_cos * flexion_cos
    for n in (1, 2):
        out[..., 3 + n :: 3, 2], out[..., 3 + n :: 3, 3] = finger_sin[..., 1 + n], finger_cos[..., 1 + n]
    out[..., 0, :] = _thumb_base(sin[..., 16:19], cos[..., 16:19])
    out[..., 1:3, :3] = sin[..., 19:, None] * _BEND
    out[..., 1:3, 3] = cos[..., 19:]
    return out


def _thumb_base(sin: Float, cos: Float) -> Float:
    """Rotation (..., 4) of the thumb's CMC from sines and cosines (..., 3) of its half angles: opposition first, then
    abduction, then flexion.
    """
    opposition, abduction = (np.empty((*sin.shape[:-1], 4)) for _ in range(2))
    opposition[..., :3], opposition[..., 3] = sin[..., 2:] * -THUMB_DIRECTION, cos[..., 2]
    abduction[..., :3], abduction[..., 3] = sin[..., 1:2] * _OUT, cos[..., 1]
    x, y, z, w = np.moveaxis(rotation.multiply(abduction, opposition), -1, 0)
    s, c = -sin[..., 0], cos[..., 0]  # flexion turns about -Y, from the thumb's side across the palm
    return np.stack([c * x + s * z, c * y + s * w, c * z - s * x, c * w - s * y], axis=-1)


def points(angles: ArrayLike) -> Float:
    """Places (..., 20, 3) of the right hand's ``POINTS`` in the wrist's frame, cm, for ``angles`` (..., 21)."""
    angles = np.asarray(angles, np.float64)
    lead = angles.shape[:-1]
    out = np.empty((*lead, 20, 3))
    finger = angles[..., :16].reshape(*lead, 4, 4)
    bent = np.cumsum(finger[..., 1:], axis=-1)  # (..., 4, 3) from the palm's plane, in the finger's own plane
    along, down = np.cumsum(_LENGTHS * np.cos(bent), axis=-1), np.cumsum(_LENGTHS * np.sin(bent), axis=-1)
    aside = finger[..., 0] * _SPREAD_SIGN
    steps = np.stack([-along * np.cos(aside)[..., None], -down, along * np.sin(aside)[..., None]], axis=-1)
    places = _ROOTS[:, None] + steps  # (..., 4, 3, 3): second joint, third joint, tip
    out[..., 3:15:3, :] = _ROOTS
    out[..., 4:15:3, :], out[..., 5:15:3, :] = places[..., 0, :], places[..., 1, :]
    out[..., 16:, :] = places[..., 2, :]
    place, turn = np.broadcast_to(KNUCKLES["Thumb"], (*lead, 3)), rotation.IDENTITY
    for n, local in enumerate(np.moveaxis(rotations(angles)[..., :3, :], -2, 0)):
        out[..., n, :] = place
        turn = rotation.multiply(turn, local)
        place = place + rotation.rotate(turn, THUMB_DIRECTION * PHALANGES["Thumb"][n])
    out[..., 15, :] = place
    return out
