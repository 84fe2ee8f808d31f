"""Directions, palms, places, parts of the hand and handshapes of written signs, in the words and vectors of the
notation (ViSiCAST's gestural SiGML; the open player performs).

Vectors are (out, up, forward) of a right-handed signer, with out to the signer's right, as in ``phonology``. Heights,
widths and distances refer to the standard body, cm. Linguists write the neutral space in front of the trunk as
``shoulders``, ``chest`` and ``stomach`` without a touch: the contact sets its distance from the chest joint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.errors import InputError
from signsplice.signer import locations
from signsplice.signer.locations import Location, WeakArm
from signsplice.signer.phonology import DIRECTIONS
from signsplice.signer.signer import STANDARD
from signsplice.signer.tables import Vector, to_vector
from signsplice.written.tree import Place, Site, WrittenShape

_WORDS = {"u": "up", "d": "down", "l": "in", "r": "out", "o": "fwd", "i": "back"}
_LETTERS = {letter: DIRECTIONS[word] for letter, word in _WORDS.items()}
_SMALL = 1e-6
"""Length below which a vector counts as zero."""
_LEVEL = 1e-3
"""Least horizontal component of a direction that counts."""


def dot(a: Vector, b: Vector) -> float:
    """The scalar product of two vectors."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    """Returns ``a + factor * b``."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product in the signer's axes, in which (left, up, forward) is right-handed."""
    return (-(a[1] * b[2] - a[2] * b[1]), a[0] * b[2] - a[2] * b[0], a[1] * b[0] - a[0] * b[1])


def unit(v: Vector) -> Vector | None:
    """The unit vector along ``v``; None if ``v`` is zero."""
    length = math.sqrt(dot(v, v))
    return None if length < _SMALL else (v[0] / length, v[1] / length, v[2] / length)


def direction(words: Sequence[str]) -> Vector:
    """The unit vector of a word of letters, or midway between two. Raises ``InputError`` if the letters cancel."""
    ends = []
    for word in words:
        total: Vector = (0.0, 0.0, 0.0)
        for letter in word:
            if letter not in _LETTERS:
                raise InputError(f"direction {word!r}: {letter!r} is none of {' '.join(_LETTERS)}")
            total = plus(total, _LETTERS[letter])
        if (end := unit(total)) is None:
            raise InputError(f"direction {word!r} points nowhere")
        ends.append(end)
    return _mean(ends)


def _mean(ends: Sequence[Vector]) -> Vector:
    """The unit vector midway between the first and the last; the first if they are opposite."""
    return unit(plus(ends[0], ends[-1])) or ends[0]


def hand_axes(fingers: Sequence[str], palm: Sequence[str]) -> tuple[Vector, Vector]:
    """The unit vectors of the finger and palm directions. Of two finger directions, each is resolved with its own palm
    and the palms are averaged: near upright fingers, a few degrees change the meaning of a palm's letter. Raises
    ``InputError`` if the letters of a direction cancel.
    """
    finger_axis = direction(fingers)
    total: Vector = (0.0, 0.0, 0.0)
    for finger, word in ((fingers[0], palm[0]), (fingers[-1], palm[-1])):
        pointing = direction((finger,))
        palm_axis = _facing(pointing, word, finger_axis[2] < -_LEVEL)
        cosine = dot(pointing, finger_axis)
        if cosine > -0.999:  # turned as the fingers are
            palm_axis = plus(palm_axis, plus(pointing, finger_axis), -dot(palm_axis, finger_axis) / (1.0 + cosine))
        total = plus(total, palm_axis)
    return finger_axis, unit(total) or facing(finger_axis, palm)


def facing(fingers: Vector, words: Sequence[str]) -> Vector:
    """The unit vector of a palm direction, given the finger direction ``fingers``; also gives the side of a curve.
    ``d`` is the lower side in the vertical plane through the fingers. ``l`` is perpendicular to that plane: towards the
    signer's left if the fingers point away, towards the signer if they point left.
    """
    return _mean([_facing(fingers, word) for word in words])


def _facing(fingers: Vector, word: str, back: bool = False) -> Vector:
    """``back``: fingers that point neither away from nor towards the signer count as pointing to the signer."""
    level = math.hypot(fingers[0], fingers[2]) <= _LEVEL
    back = fingers[2] < -_LEVEL or (back and fingers[2] < _LEVEL)
    sideways = unit(cross((0.0, 1.0, 0.0), plus(fingers, (0.0, 0.0, -1.0 if back else 1.0)) if level else fingers))
    assert sideways is not None
    if back:
        sideways = to_vector(-x for x in sideways)
    below = unit(cross(sideways, fingers))
    assert below is not None
    lower = fingers[1] * below[2] * (-1.0 if back else 1.0) if level else -below[1]
    if lower < 0.0:
        below = to_vector(-x for x in below)
    a, b = word.count("d") - word.count("u"), word.count("l") - word.count("r")
    depth = word.count("o") - word.count("i")
    if depth:  # o and i are not letters of a palm: project them onto the plane across the fingers
        literal = (float(-b), float(-a), float(depth))
        if flat := unit(plus(literal, fingers, -dot(literal, fingers))):
            return flat
    return unit(plus((a * below[0], a * below[1], a * below[2]), sideways, b)) or below


_HEIGHTS = {
    "head": 33.0, "neck": 21.0, "shouldertop": 19.0, "shoulders": 14.0, "chest": 5.0, "stomach": -10.0,
    "belowstomach": -22.0, "neutral": 0.0, "": -3.0,
}  # fmt: skip
"""Place with space in front of it -> height above the chest joint, cm."""
_FORWARD = {"close": 25.0, "": 30.0, "armextended": 42.0, "touch": 25.0}
"""Contact -> distance of the hand in front of the chest joint, cm."""
_AT = {"shoulders": 15.0, "shouldertop": 15.0, "head": 6.0, "neck": 6.0}
"""Place -> distance of ``at`` its side from the midline, cm."""
_TRUNK_AT = 12.0
"""The same for all other places, cm."""
_BESIDE = 10.0
"""Distance of ``beside`` from ``at``, cm."""
_SKIN: dict[str, tuple[str, float, float, float]] = {
    "head": ("forehead:0,-4", 4.0, 9.0, 0.0), "headtop": ("crown", 4.0, 9.0, 0.0),
    "forehead": ("forehead", 4.0, 12.0, 0.0), "eyebrows": ("eye:0,3.9", 0.0, 4.5, 3.1),
    "eyes": ("eye:0,0.8", 0.0, 4.5, 3.1), "nose": ("nose", 1.6, 6.0, 0.0), "nostrils": ("nose:0,-1.6", 1.4, 6.0, 0.0),
    "ear": ("ear", 0.0, 0.0, 7.0), "earlobe": ("ear:0,-2.5", 0.0, 0.0, 7.0), "cheek": ("cheek", 0.0, 3.0, 4.5),
    "lips": ("mouth", 2.6, 6.0, 0.0), "tongue": ("mouth", 1.0, 6.0, 0.0), "teeth": ("mouth:0,0.5", 2.0, 6.0, 0.0),
    "chin": ("chin", 2.5, 5.5, 0.0), "underchin": ("under-chin", 2.5, 5.5, 0.0), "neck": ("throat", 3.5, 6.0, 0.0),
    "shouldertop": ("shoulder", 0.0, 0.0, 17.0), "shoulders": ("chest:0,8", 14.0, 17.0, 0.0),
    "chest": ("chest", 9.0, 14.0, 0.0), "stomach": ("belly:0,8", 9.0, 13.0, 0.0),
    "belowstomach": ("belly:0,-4", 9.0, 13.0, 0.0), "neutral": ("chest", 9.0, 14.0, 0.0),
    "": ("belly:0,10", 9.0, 13.0, 0.0),
}  # fmt: skip
"""Place -> location on the skin; offsets of ``at`` a side and ``beside`` it, cm; distance of paired organs from the
midline, cm."""
ON_ARM = {"upperarm": "upper-arm-weak", "elbow": "elbow-weak", "elbowinside": "elbow-weak", "lowerarm": "forearm-weak"}
"""Place on the arm -> location in the notation."""
_HEAD_OFF = {"close": 4.0, "": 0.0, "touch": 0.0, "armextended": 25.0}
"""Contact -> distance of the hand from the head, cm."""
_TOUCHES = ("touch", "interlock", "cross", "brushing")
_TRUNK = frozenset(("neck", "shouldertop", "shoulders", "chest", "stomach", "belowstomach", "neutral", ""))
_PARTS = {
    "palm": "palm", "handback": "back", "thumbside": "radial", "pinkyside": "ulnar", "thumbball": "1.base.palmar",
    "wristback": "wrist.dorsal", "wristpulse": "wrist",
}  # fmt: skip
_SEGMENTS = {"tip": "tip", "nail": "nail", "pad": "pad", "midjoint": "mid", "base": "base", "side": "side"}


@dataclass(frozen=True)
class Spot:
    """The goal of a hand, in words of the notation.

    location: as in ``Posture``
    off: distance from the skin, cm
    shift: displacement from that point, cm
    part: the part of the hand at the goal, or "" for its usual part
    touches: whether the hand touches
    head: whether the goal is at the head
    """

    location: str
    off: float = 0.0
    shift: Vector = (0.0, 0.0, 0.0)
    part: str = ""
    touches: bool = False
    head: bool = False


def spot(place: Place, own_side: bool) -> Spot:
    """Returns the spot of a place; out is to the right. ``own_side``: without a written side the hand is at its own
    (right) side, as in two-handed signs. Raises ``InputError`` if the place is unknown.
    """
    if place.name in ON_ARM or place.name in ("wristback", "wristpulse"):
        return _arm_spot(place)
    if place.name not in _SKIN:
        raise InputError(f"place {place.name!r} is not known, expected one of {', '.join(filter(None, _SKIN))}")
    part = "" if place.hand is None else part_of_hand(place.hand)
    first = _one(place, place.contact, own_side)
    if place.between is None:
        return replace(first, part=part)
    if place.between.name not in _SKIN:
        raise InputError(f"halfway of {place.name!r} and {place.between.name!r} is no place on head or trunk")
    contact = place.contact or place.between.contact
    first, second = (_one(end, contact, own_side) for end in (place, place.between))
    if first.location.startswith("space:") or second.location.startswith("space:"):
        return Spot(in_space(_halfway(first, second)), part=part, head=first.head and second.head)
    location = "/".join(dict.fromkeys((first.location, second.location)))
    middle = Spot(
        location, 0.5 * (first.off + second.off), part=part, touches=first.touches, head=first.head or second.head
    )
    if first.touches:
        return middle
    on_skin = (replace(end, off=0.0, shift=(0.0, 0.0, 0.0)) for end in (first, second))
    return _shift_to_goal(
        middle, plus(point_of(Spot(location)), plus(_halfway(first, second), _halfway(*on_skin), -1.0))
    )


def point_of(where: Spot) -> Vector:
    """Returns the point (out, up, forward) of a spot on head or trunk, or in space, of the standard signer, cm."""
    location = _locate_on_signer(where.location)
    x, y, z = (location.point + where.off * location.normal).tolist()
    return plus((-x, y, z), where.shift)


def _halfway(one: Spot, other: Spot) -> Vector:
    return to_vector(0.5 * (x + y) for x, y in zip(point_of(one), point_of(other), strict=True))


def _locate_on_signer(location: str) -> Location:
    return locations.locate(location, WeakArm(STANDARD, np.zeros(27)))


def _one(place: Place, contact: str, own_side: bool) -> Spot:
    """Returns the spot of a place without its ``between``."""
    location, beside_cm = _skin(place, own_side)
    head = place.name not in _TRUNK
    organ = head and place.name != "head" and not place.side.endswith("beside")
    touches = contact in _TOUCHES or (organ and not contact)
    before = (not head or (place.name == "head" and contact != "close")) and not touches
    if before and not place.behind:
        return Spot(in_space((_sideways(place, own_side), _HEIGHTS[place.name], _FORWARD[contact])), head=head)
    if place.behind:
        back = -16.0 if head else -24.0
        return Spot(in_space((_sideways(place, own_side), _HEIGHTS.get(place.name, 30.0), back)), head=head)
    off = 0.0 if touches else _HEAD_OFF[contact] + 2.0 * (place.name == "head")
    shift = (0.0 if touches else beside_cm, 0.0, 0.0)
    skin_spot = Spot(location, off, shift, touches=touches, head=head)
    if touches or place.name == "head":
        return skin_spot
    # The skin beside an organ may face another direction: place the hand in front of the organ itself.
    x, y, z = (skin_spot.off * _locate_on_signer(location.partition(":")[0]).normal).tolist()
    return _shift_to_goal(skin_spot, plus(point_of(replace(skin_spot, off=0.0)), (-x, y, z)))


def _shift_to_goal(where: Spot, goal: Vector) -> Spot:
    """Sets the shift of a spot that puts the hand at a goal (out, up, forward)."""
    unmoved = replace(where, shift=(0.0, 0.0, 0.0))
    shift = to_vector(round(x - y, 2) + 0.0 for x, y in zip(goal, point_of(unmoved), strict=True))
    return replace(where, shift=shift)


def _side(place: Place, own_side: bool) -> float:
    """Returns 1 for the right side, -1 for the left side, 0 for neither."""
    if place.side.startswith("right"):
        return 1.0
    return -1.0 if place.side.startswith("left") else 1.0 if own_side else 0.0


def _sideways(place: Place, own_side: bool) -> float:
    """Returns how far to the right a place in front of the body is, cm."""
    at_cm = _AT.get(place.name, _TRUNK_AT)
    return _side(place, own_side) * (at_cm + _BESIDE * place.side.endswith("beside"))


def _skin(place: Place, own_side: bool) -> tuple[str, float]:
    """Returns the location on the skin, and how far beside it a hand without touch is, cm."""
    location, at_cm, beside_cm, paired = _SKIN[place.name]
    side = _side(place, own_side) or float(paired > 0.0)
    name, _, offset = location.partition(":")
    up = float(offset.split(",")[1]) if offset else 0.0
    wide = place.side.endswith("beside")
    if paired:
        name += "-weak" * (side < 0.0)
        outward = side * beside_cm * wide
    else:
        outward = side * (beside_cm if wide else at_cm)
    # Beside an organ, a touch is at the side of the head; a hand in the air is farther out.
    text = name + (f":{outward:g},{up:g}" if outward or up else "")
    distance = (at_cm if not paired else 0.0) + _BESIDE - (beside_cm if wide else 0.0) if wide else 0.0
    return text, side * max(distance, 0.0)


def in_space(point: Sequence[float]) -> str:
    """Writes a point (out, up, forward), cm from the chest, in words of the notation."""
    return "space:" + ",".join(f"{round(c, 2) + 0.0:g}" for c in point)


def _arm_spot(place: Place) -> Spot:
    """Returns the spot of a place on the weak arm."""
    location = ON_ARM.get(place.name) or f"base-{_PARTS[place.name]}"
    close = 0.0 if place.contact in _TOUCHES else 3.0 if place.contact == "close" else 0.0
    part = "" if place.hand is None else part_of_hand(place.hand)
    return Spot(location, close, part=part, touches=not close)


def part_of_hand(site: Site) -> str:
    """Writes a part of the hand in the notation's words. Raises ``InputError`` if the part is unknown."""
    if site.between is not None:
        return f"{part_of_hand(replace(site, between=None))}/{part_of_hand(site.between)}"
    if site.part == "wristback" and site.side:  # the only word for a wrist in gestural SiGML
        return f"wrist.{site.side}"
    if site.part in _PARTS:
        return _PARTS[site.part]
    if site.part not in _SEGMENTS:
        raise InputError(f"{site.part!r} is no part of the hand that can touch, expected one of "
                         f"{', '.join((*_SEGMENTS, *_PARTS))}")  # fmt: skip
    if not site.digits:
        return {"base": "heel", "tip": "fingertips", "side": "radial"}.get(site.part, "2345." + _SEGMENTS[site.part])
    side = f".{site.side}" if site.side and site.part not in ("tip", "nail", "pad") else ""
    return "".join(map(str, sorted(site.digits))) + f".{_SEGMENTS[site.part]}{side}"


def usual_part(shape: WrittenShape, touches: bool) -> str:
    """The default part of a hand at a place: one or two selected fingers touch with their tips."""
    if not touches or shape.base in ("fist", "flat", "finger2345", "ceeall"):
        return "palm"
    if shape.special:
        return f"{shape.special[0]}.tip"
    return {"finger2": "2.tip", "finger23": "23.tip", "finger23spread": "23.tip"}.get(shape.base, "12.tip")


def shape_text(shape: WrittenShape) -> str:
    """Writes a handshape in the notation's words (``composed``)."""
    words = [shape.base, *filter(None, (shape.thumb, shape.bend))]
    words += [f"{digit}:{bend}" for digit, bend in shape.bends if digit > 1]
    words += ["s" + "".join(map(str, shape.special))] if shape.special else []
    words += ["x" + "".join(map(str, shape.exempt))] if shape.exempt else []
    words += [f"o{shape.opposed}"] if shape.opposed > 1 else []
    words += [("c" if shape.crossed else "t") + "".join(map(str, shape.pair[:2]))] if len(shape.pair) > 1 else []
    words += [f"w{shape.opening:g}"] if shape.opening != 1.0 else []
    words += ["enclosed"] if shape.thumb_enclosed else []
    text = ".".join(words)
    return text if shape.between is None else f"{text}~{shape_text(replace(shape.between, between=None))}"
