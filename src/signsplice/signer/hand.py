"""The hand's skeleton: bone lengths, joint angles and their limits, and forward kinematics.

Frame: the right hand at rest, its wrist at the origin, fingers along -X, palm facing -Y, thumb side +Z; centimetres for
a signer 1.70 m tall, whose hand is 0.108 of stature long (Drillis and Contini 1966). Mirror x for the left hand.

Lengths: distances between joint centres, as fractions of hand length, after Buchholz, Armstrong and Goldstein (1992,
Ergonomics 35: 261-273). The thumb's phalanges are shortened to the bone lengths of Buryanov and Kotiuk (2010, Int. J.
Morphol. 28: 755-758) plus the bone heads that lie in the joints. The last length of a finger ends inside the pulp, so
that a capsule as thick as the finger ends with the finger. The arch of the knuckles is fixed: the palm does not fold.

Angles: 21 numbers, radians, all 0 at rest (``ANGLES``). A finger's first joint rotates by flexion about the line of the
knuckles, then by spread about the palm's normal; so the spread of a bent finger becomes twist, as the collateral
ligaments enforce (rejected: spread about the bent axis, which parts the fingers sideways in a fist). Flexion is
positive towards the palm. Spread is positive away from the middle finger's line; for the middle finger itself it is
positive towards the index finger. The thumb's first joint has three angles: flexion (the metacarpal swings across the
palm towards the little finger; negative is radial abduction), abduction (out of the palm's plane, away from it) and
opposition (about its own bone, the pulp towards the fingers; it stands for all the twist along the thumb, about 90
degrees in all after Kapandji 1982).

Parts that touch or are touched have names (words/places.txt) or are composed: ``2.tip`` is the tip of the index finger
(1 thumb to 5 little finger), ``23.mid.radial`` the thumb's side of the middle joints of index and middle finger,
``palm/heel`` the middle between two parts. Sides: palmar, dorsal, radial, ulnar.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from signsplice.motion import FloatArray, frozen, rotation
from signsplice.motion.cache import CACHE
from signsplice.signer.tables import sections, vector

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
"""Position of each finger's first joint relative to the wrist, cm."""

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
            *((-20.0, 20.0), (-30.0, 100.0), (-5.0, 105.0), (-5.0, 85.0)) * 3,
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
    forward, down = np.cumsum(_LENGTHS * np.cos(bent), axis=-1), np.cumsum(_LENGTHS * np.sin(bent), axis=-1)
    spread = finger[..., 0] * _SPREAD_SIGN
    offsets = np.stack([-forward * np.cos(spread)[..., None], -down, forward * np.sin(spread)[..., None]], axis=-1)
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


_INDEX = {"Wrist": -1} | {name: n for n, name in enumerate(POINTS)}
_DIGITS = dict(zip("12345", FINGERS, strict=True))
_SKIN = {"Thumb": 0.95, "Index": 0.82, "Middle": 0.83, "Ring": 0.79, "Pinky": 0.7}
"""Distance of the skin from the axis near a finger's tip, cm."""
_SEGMENTS: dict[str, tuple[tuple[str, ...], float, str]] = {
    "tip": (("Tip",), 1.0, "end"),
    "nail": (("3", "Tip", "Tip"), 1.0, "dorsal"),
    "pad": (("3", "Tip", "Tip"), 1.0, "palmar"),
    "mid": (("2",), 1.2, "dorsal"),
    "base": (("1",), 1.4, "dorsal"),
    "side": (("2", "3"), 1.1, "radial"),
}
"""For each part of a finger: the points whose mean it is, its thickness over that at the tip, and its usual side."""
_WRIST = {
    "palmar": (2.8, (0.0, -1.0, 0.0)),
    "dorsal": (2.8, (0.0, 1.0, 0.0)),
    "radial": (2.8, (0.0, 0.0, 1.0)),
    "ulnar": (2.8, (0.0, 0.0, -1.0)),
}
"""Distance of the wrist's skin from its joint, cm, and direction, of each side."""
_COMPOSED = re.compile(
    rf"(?:wrist\.({'|'.join(_WRIST)})|([1-5]{{1,4}})\.({'|'.join(_SEGMENTS)})(?:\.({'|'.join(_WRIST)}))?)"
)


@dataclass(frozen=True)
class HandPart:
    """A part of a hand.

    names: joints and tips; their mean position is the part's centre
    skin: distance of the skin from the centre, cm
    out: direction out of the hand, in the hand's axes; None for a direction that follows the finger
    side: ``end`` or one of the sides, for a direction that follows the finger
    """

    names: tuple[str, ...]
    skin: float
    out: tuple[float, float, float] | None
    side: str = ""

    def centre(self, points: FloatArray) -> FloatArray:
        """The mean position (..., 3) in hands with ``hand.points`` (..., 20, 3)."""
        with_wrist = np.concatenate([points, np.zeros((*points.shape[:-2], 1, 3))], axis=-2)
        return np.asarray(with_wrist[..., [_INDEX[name] for name in self.names], :].mean(axis=-2))

    def normal(self, points: FloatArray) -> FloatArray:
        """The unit vector (3,) out of a hand with ``hand.points`` (20, 3)."""
        if self.out is not None:
            return np.asarray(np.array(self.out) / np.linalg.norm(self.out))
        fingers = dict.fromkeys(re.sub(r"\d|Tip", "", name) for name in self.names)
        number = next(name.removeprefix(next(iter(fingers))) for name in self.names)
        first, last = {"Tip": ("3", "Tip"), "1": ("1", "2"), "2": ("2", "3"), "3": ("3", "Tip")}[number]
        bone = sum(points[_INDEX[f + last]] - points[_INDEX[f + first]] for f in fingers)
        bone = bone / np.linalg.norm(bone)
        thumb = [*fingers] == ["Thumb"]
        radial = np.array([0.0, 0.8, 0.6]) if thumb else np.array([0.0, 0.0, 1.0])  # the radial side
        radial = radial - (radial @ bone) * bone
        radial /= np.linalg.norm(radial)
        dorsal = np.cross(bone, radial)
        return np.asarray(
            {"end": bone, "dorsal": dorsal, "palmar": -dorsal, "radial": radial, "ulnar": -radial}[self.side]
        )


PARTS_OF_HAND = {
    name: HandPart(tuple(names.split(",")), float(skin), vector(direction))
    for name, names, skin, direction in sections(__file__, "places")["parts"]
}
"""The named parts."""


def is_part(text: str) -> bool:
    """Whether a text names a part of the hand, or composes one."""
    return all(name in PARTS_OF_HAND or _COMPOSED.fullmatch(name) is not None for name in text.split("/"))


def hand_part(text: str) -> HandPart:
    """The part of the hand that a text names or composes; see ``is_part``."""
    return PARTS_OF_HAND[text] if text in PARTS_OF_HAND else CACHE.recent(_parse_part, text, most=512)


def _parse_part(text: str) -> HandPart:
    if "/" in text:
        first, second = (hand_part(name) for name in text.split("/", 1))
        names = first.names * len(second.names) + second.names * len(first.names)
        return HandPart(names, 0.5 * (first.skin + second.skin), first.out or second.out or (-1.0, 0.0, 0.0))
    match = _COMPOSED.fullmatch(text)
    assert match is not None
    wrist, digits, segment, side = match.groups()
    if wrist:
        return HandPart(("Wrist",), *_WRIST[wrist])
    ends, thick, usual = _SEGMENTS[segment]
    fingers = [_DIGITS[digit] for digit in digits]
    names = tuple(f + end for f in fingers for end in ends)
    return HandPart(names, thick * sum(_SKIN[f] for f in fingers) / len(fingers), None, side or usual)
