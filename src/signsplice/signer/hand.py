"""The hand's skeleton: bone lengths, joint angles and their limits, and forward kinematics.

Frame: the right hand at rest, its wrist at the origin, fingers along -X, palm facing -Y, thumb side +Z; centimetres for
a signer 1.70 m tall, whose hand is 0.108 of stature long (Drillis and Contini 1966). Mirror x for the left hand.

Lengths: distances between joint centres as fractions of hand length after Buchholz, Armstrong and Goldstein (1992,
Ergonomics 35: 261-273). The thumb's phalanges are shortened to the bone lengths of Buryanov and Kotiuk (2010, Int. J.
Morphol. 28: 755-758) plus the bone heads that lie in the joints. The last length of a finger ends inside the pulp, so
that a capsule as thick as the finger ends where the finger ends. The arch of the knuckles is fixed: the palm does not
fold.

Angles: 21 numbers, radians, all 0 at rest (``ANGLES``). A finger's first joint rotates by flexion about the line of the
knuckles, then by spread about the palm's normal; so the spread of a bent finger becomes twist, as the collateral
ligaments enforce (rejected: spread about the bent axis, which parts the fingers sideways in a fist). Flexion is
positive towards the palm. Spread is positive away from the middle finger's line; for the middle finger itself it is
positive towards the index finger. The thumb's first joint has three angles: flexion (the metacarpal swings across the
palm towards the little finger; negative is radial abduction), abduction (out of the palm's plane, away from it) and
opposition (about its own bone, the pulp towards the fingers; it stands for all the twist along the thumb, about 90
degrees in all after Kapandji 1982).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import frozen

FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")
JOINTS = tuple(f"{finger}{n}" for finger in FINGERS for n in (1, 2, 3))
"""The order of ``rotations``; the thumb's joints are CMC, MCP and IP, a finger's MCP, PIP and DIP."""

POINTS = JOINTS + tuple(f"{finger}Tip" for finger in FINGERS)
"""The order of ``points``."""

ANGLES = (
    *(f"{finger}-{name}" for finger in FINGERS[1:] for name in ("spread", "mcp", "pip", "dip")),
    *(f"Thumb-{name}" for name in ("flexion", "abduction", "opposition", "mcp", "ip")),
)
"""Names of a hand's 21 joint angles, in order."""


KNUCKLES: dict[str, FloatArray] = {
    "Thumb": frozen((-1.9, -1.2, 2.2)),
    "Index": frozen((-8.5, 0.0, 2.9)),
    "Middle": frozen((-8.6, 0.2, 0.7)),
    "Ring": frozen((-8.0, 0.0, -1.45)),
    "Pinky": frozen((-7.3, -0.4, -3.4)),
}
"""Position of each finger's first joint, seen from the wrist, cm."""

PHALANGES: dict[str, tuple[float, float, float]] = {
    "Thumb": (4.3, 3.4, 2.2),
    "Index": (4.5, 2.6, 1.6),
    "Middle": (4.9, 3.0, 1.75),
    "Ring": (4.5, 2.9, 1.75),
    "Pinky": (3.6, 2.1, 1.5),
}
"""Lengths of the three bones of each finger, cm."""

THUMB_DIRECTION: FloatArray = frozen(np.array([-0.72, -0.28, 0.63]) / np.linalg.norm([-0.72, -0.28, 0.63]))
"""Unit direction of the thumb at rest; the fingers point along -X."""

LIMITS: FloatArray = frozen(
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
"""Least and greatest value of each angle, radians, (21, 2). Flexion of the fingers after Hume et al. (1990, J. Hand
Surg. 15A: 240-243); their extension and spread after the American Academy of Orthopaedic Surgeons (1965, Joint Motion),
the little finger's spread after Chatzioglou, Pinar and Govsa (2024, Anat. Cell Biol. 57: 172-182), and 20 degrees of
spread the other way, as crossed fingers show. The thumb has the greatest ranges that Barakat, Field and Taylor found
(2013, Hand 8: 179-182), counted from its rest."""

_SPREAD_SIGN = np.array([1.0, 1.0, -1.0, -1.0])  # about +Y, which rotates -X towards the thumb's side
_LENGTHS = np.array([PHALANGES[finger] for finger in FINGERS[1:]])
_ROOTS = np.array([KNUCKLES[finger] for finger in FINGERS[1:]])

# Axis of the thumb's abduction: perpendicular to the thumb and to the palm's normal.
_OUT = np.array([THUMB_DIRECTION[2], 0.0, -THUMB_DIRECTION[0]]) / np.hypot(THUMB_DIRECTION[0], THUMB_DIRECTION[2])
# Axis of its MCP and IP joints: they bend it half across the palm, half towards the palm's front, given by the plane of
# the nail at rest.
_ACROSS = np.cross(THUMB_DIRECTION, _OUT)
_BEND = np.cos(np.deg2rad(40.0)) * -_ACROSS + np.sin(np.deg2rad(40.0)) * _OUT


def rotations(angles: ArrayLike) -> FloatArray:
    """Local rotations (..., 15, 4), x y z w, of the right hand's ``JOINTS`` for ``angles`` (..., 21)."""
    half = 0.5 * np.asarray(angles, np.float64)
    sin, cos = np.sin(half), np.cos(half)
    quats = np.zeros((*half.shape[:-1], 15, 4))
    finger_sin = sin[..., :16].reshape(*half.shape[:-1], 4, 4)  # (..., finger, angle)
    finger_cos = cos[..., :16].reshape(*half.shape[:-1], 4, 4)
    spread, flexion = finger_sin[..., 0] * _SPREAD_SIGN, finger_sin[..., 1]
    spread_cos, flexion_cos = finger_cos[..., 0], finger_cos[..., 1]
    # The MCP joints: the product of spread about Y and flexion about Z, written out.
    quats[..., 3::3, 0], quats[..., 3::3, 1] = spread * flexion, spread * flexion_cos
    quats[..., 3::3, 2], quats[..., 3::3, 3] = spread_cos * flexion, spread_cos * flexion_cos
    for n in (1, 2):  # PIP and DIP: flexion about Z
        quats[..., 3 + n :: 3, 2], quats[..., 3 + n :: 3, 3] = finger_sin[..., 1 + n], finger_cos[..., 1 + n]
    quats[..., 0, :] = _thumb_base(sin[..., 16:19], cos[..., 16:19])
    quats[..., 1:3, :3] = sin[..., 19:, None] * _BEND
    quats[..., 1:3, 3] = cos[..., 19:]
    return quats


def _thumb_base(sin: FloatArray, cos: FloatArray) -> FloatArray:
    """Rotation (..., 4) of the thumb's CMC from sines and cosines (..., 3) of its half angles: opposition first, then
    abduction, then flexion.
    """
    opposition, abduction = (np.empty((*sin.shape[:-1], 4)) for _ in range(2))
    opposition[..., :3], opposition[..., 3] = sin[..., 2:] * -THUMB_DIRECTION, cos[..., 2]
    abduction[..., :3], abduction[..., 3] = sin[..., 1:2] * _OUT, cos[..., 1]
    x, y, z, w = np.moveaxis(rotation.multiply(abduction, opposition), -1, 0)
    s, c = -sin[..., 0], cos[..., 0]  # flexion is about -Y, from the thumb's side across the palm
    return np.stack([c * x + s * z, c * y + s * w, c * z - s * x, c * w - s * y], axis=-1)


def points(angles: ArrayLike) -> FloatArray:
    """Positions (..., 20, 3) of the right hand's ``POINTS`` in the wrist's frame, cm, for ``angles`` (..., 21)."""
    angles = np.asarray(angles, np.float64)
    lead = angles.shape[:-1]
    positions = np.empty((*lead, 20, 3))
    finger = angles[..., :16].reshape(*lead, 4, 4)
    bent = np.cumsum(finger[..., 1:], axis=-1)  # (..., 4, 3) from the palm's plane, in the finger's own plane
    along, down = np.cumsum(_LENGTHS * np.cos(bent), axis=-1), np.cumsum(_LENGTHS * np.sin(bent), axis=-1)
    spread = finger[..., 0] * _SPREAD_SIGN
    offsets = np.stack([-along * np.cos(spread)[..., None], -down, along * np.sin(spread)[..., None]], axis=-1)
    beyond = _ROOTS[:, None] + offsets  # (..., 4, 3, 3): second joint, third joint, tip
    positions[..., 3:15:3, :] = _ROOTS
    positions[..., 4:15:3, :], positions[..., 5:15:3, :] = beyond[..., 0, :], beyond[..., 1, :]
    positions[..., 16:, :] = beyond[..., 2, :]
    position, quat = np.broadcast_to(KNUCKLES["Thumb"], (*lead, 3)), rotation.IDENTITY
    for n, local in enumerate(np.moveaxis(rotations(angles)[..., :3, :], -2, 0)):
        positions[..., n, :] = position
        quat = rotation.multiply(quat, local)
        position = position + rotation.rotate(quat, THUMB_DIRECTION * PHALANGES["Thumb"][n])
    positions[..., 15, :] = position
    return positions
