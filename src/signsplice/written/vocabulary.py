"""Directions, palms, places, parts of the hand and handshapes of written signs, in the words and vectors of the
notation (ViSiCAST's gestural SiGML; the open player performs).

Vectors are (out, up, forward) of a right-handed signer, out being the signer's right, as in ``phonology``. Heights,
widths and distances are those of the standard body, cm. Neutral space before the trunk is what linguists write as
``shoulders``, ``chest`` and ``stomach`` without a touch: its distance from the chest joint follows the contact.
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
_LEVEL = 1e-3
"""Least part of a direction that counts."""


def dot(a: Vector, b: Vector) -> float:
    """The scalar product of two vectors."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    """A vector and a multiple of another one, added."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product as a right-handed signer's axes have it, in which (left, up, forward) are right-handed."""
    return (-(a[1] * b[2] - a[2] * b[1]), a[0] * b[2] - a[2] * b[0], a[1] * b[0] - a[0] * b[1])


def unit(v: Vector) -> Vector | None:
    """The unit vector along ``v``; None where it has no length."""
    length = math.sqrt(dot(v, v))
    return None if length < _SMALL else (v[0] / length, v[1] / length, v[2] / length)


def direction(words: Sequence[str]) -> Vector:
    """The unit vector of one word of letters, or midway between two. Raises ``InputError`` where it points nowhere."""
    ends = []
    for word in words:
        total: Vector = (0.0, 0.0, 0.0)
        for letter in word:
            if letter not in _LETTERS:
                raise InputError(f"direction {word!r}: {letter!r} is none of {' '.join(_LETTERS)}")
            total = plus(total, _LETTERS[letter])
        if (one := unit(total)) is None:
            raise InputError(f"direction {word!r} points nowhere")
        ends.append(one)
    return _mean(ends)


def _mean(ends: Sequence[Vector]) -> Vector:
    """Midway between the first and the last of some unit vectors; of opposite ones the first."""
    return unit(plus(ends[0], ends[-1])) or ends[0]


def hand_axes(fingers: Sequence[str], palm: Sequence[str]) -> tuple[Vector, Vector]:
    """The unit vectors along which fingers point and a palm faces. Of two directions each is resolved with its own palm
    before they are averaged: near upright fingers a palm's letter turns with a few degrees of theirs. Raises
    ``InputError`` where they point nowhere.
    """
    along = direction(fingers)
    total: Vector = (0.0, 0.0, 0.0)
    for finger, word in ((fingers[0], palm[0]), (fingers[-1], palm[-1])):
        own = direction((finger,))
        faces = _facing(own, word, along[2] < -_LEVEL)
        cosine = dot(own, along)
        if cosine > -0.999:  # turned as the fingers are
            faces = plus(faces, plus(own, along), -dot(faces, along) / (1.0 + cosine))
        total = plus(total, faces)
    return along, unit(total) or facing(along, palm)


def facing(fingers: Vector, words: Sequence[str]) -> Vector:
    """The unit vector that a palm faces whose fingers point along ``fingers``: the same reading that gives a curve its
    side. ``d`` is the lower side in the vertical plane through the fingers, ``l`` across it, towards the signer's left
    where the fingers point away and towards the signer where they point left.
    """
    return _mean([_facing(fingers, word) for word in words])


def _facing(fingers: Vector, word: str, back: bool = False) -> Vector:
    """``back``: fingers that point neither away nor towards the signer count as if they pointed to the signer."""
    level = math.hypot(fingers[0], fingers[2]) <= _LEVEL
    back = fingers[2] < -_LEVEL or (back and fingers[2] < _LEVEL)
    across = unit(cross((0.0, 1.0, 0.0), plus(fingers, (0.0, 0.0, -1.0 if back else 1.0)) if level else fingers))
    assert across is not None
    if back:
        across = to_vector(-x for x in across)
    below = unit(cross(across, fingers))
    assert below is not None
    lower = fingers[1] * below[2] * (-1.0 if back else 1.0) if level else -below[1]
    if lower < 0.0:
        below = to_vector(-x for x in below)
    a, b = word.count("d") - word.count("u"), word.count("l") - word.count("r")
    depth = word.count("o") - word.count("i")
    if depth:  # no letter of a palm: as nearly as the fingers allow
        literal = (float(-b), float(-a), float(depth))
        if flat := unit(plus(literal, fingers, -dot(literal, fingers))):
            return flat
    return unit(plus((a * below[0], a * below[1], a * below[2]), across, b)) or below


_HEIGHTS = {
    "head": 33.0, "neck": 21.0, "shouldertop": 19.0, "shoulders": 14.0, "chest": 5.0, "stomach": -10.0,
    "belowstomach": -22.0, "neutral": 0.0, "": -3.0,
}  # fmt: skip
"""Heights above the chest joint of places that have space before them."""
_FORWARD = {"close": 25.0, "": 30.0, "armextended": 42.0, "touch": 25.0}
"""How far before the chest joint the hand is there."""
_AT = {"shoulders": 15.0, "shouldertop": 15.0, "head": 6.0, "neck": 6.0}
_TRUNK_AT, _BESIDE = 12.0, 10.0
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
"""Place on the skin; how far to a side is ``at`` that side, and ``beside`` it; from the midline for paired organs."""
ON_ARM = {"upperarm": "upper-arm-weak", "elbow": "elbow-weak", "elbowinside": "elbow-weak", "lowerarm": "forearm-weak"}
_HEAD_OFF = {"close": 4.0, "": 0.0, "touch": 0.0, "armextended": 25.0}
_TOUCHES = ("touch", "interlock", "cross", "brushing")
_TRUNK = frozenset(("neck", "shouldertop", "shoulders", "chest", "stomach", "belowstomach", "neutral", ""))
_PARTS = {
    "palm": "palm", "handback": "back", "thumbside": "radial", "pinkyside": "ulnar", "thumbball": "1.base.palmar",
    "wristback": "wrist.dorsal", "wristpulse": "wrist",
}  # fmt: skip
_SEGMENTS = {"tip": "tip", "nail": "nail", "pad": "pad", "midjoint": "mid", "base": "base", "side": "side"}


@dataclass(frozen=True)
class Spot:
    """Where a hand is to be, in words of the notation.

    location: as of ``Posture``
    off: distance from the skin, cm
    shift: displacement from there, cm
    part: the part of the hand that is there, or "" for its usual one
    touches: whether it is a touch
    head: whether it is at the head
    """

    location: str
    off: float = 0.0
    shift: Vector = (0.0, 0.0, 0.0)
    part: str = ""
    touches: bool = False
    head: bool = False


def spot(place: Place, own_side: bool) -> Spot:
    """Where a place is, out being to the right. ``own_side``: a hand without a written side is at its own, the right
    one, as of two hands. Raises ``InputError`` for what is no place.
    """
    if place.name in ON_ARM or place.name in ("wristback", "wristpulse"):
        return _arm_spot(place)
    if place.name not in _SKIN:
        raise InputError(f"place {place.name!r} is not known, expected one of {', '.join(filter(None, _SKIN))}")
    part = "" if place.hand is None else part_of_hand(place.hand)
    one = _one(place, place.contact, own_side)
    if place.between is None:
        return replace(one, part=part)
    if place.between.name not in _SKIN:
        raise InputError(f"halfway of {place.name!r} and {place.between.name!r} is no place on head or trunk")
    contact = place.contact or place.between.contact
    one, other = (_one(end, contact, own_side) for end in (place, place.between))
    if one.location.startswith("space:") or other.location.startswith("space:"):
        return Spot(in_space(_halfway(one, other)), part=part, head=one.head and other.head)
    location = "/".join(dict.fromkeys((one.location, other.location)))
    found = Spot(location, 0.5 * (one.off + other.off), part=part, touches=one.touches, head=one.head or other.head)
    if one.touches:
        return found
    on_skin = (replace(end, off=0.0, shift=(0.0, 0.0, 0.0)) for end in (one, other))
    return _shift_to_goal(found, plus(point_of(Spot(location)), plus(_halfway(one, other), _halfway(*on_skin), -1.0)))


def point_of(where: Spot) -> Vector:
    """Where a place on head or trunk, or in space, is of the standard signer (out, up, forward), cm."""
    found = _locate_on_signer(where.location)
    x, y, z = (found.point + where.off * found.normal).tolist()
    return plus((-x, y, z), where.shift)


def _halfway(one: Spot, other: Spot) -> Vector:
    return to_vector(0.5 * (x + y) for x, y in zip(point_of(one), point_of(other), strict=True))


def _locate_on_signer(location: str) -> Location:
    return locations.locate(location, WeakArm(STANDARD, np.zeros(27)))


def _one(place: Place, contact: str, own_side: bool) -> Spot:
    """Where a place is, without the other one that it is halfway to."""
    location, beside = _skin(place, own_side)
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
    shift = (0.0 if touches else beside, 0.0, 0.0)
    found = Spot(location, off, shift, touches=touches, head=head)
    if touches or place.name == "head":
        return found
    # The skin beside an organ may face elsewhere: a hand is before the organ itself.
    x, y, z = (found.off * _locate_on_signer(location.partition(":")[0]).normal).tolist()
    return _shift_to_goal(found, plus(point_of(replace(found, off=0.0)), (-x, y, z)))


def _shift_to_goal(where: Spot, goal: Vector) -> Spot:
    """A place with the displacement that puts a hand at a goal (out, up, forward)."""
    unmoved = replace(where, shift=(0.0, 0.0, 0.0))
    shift = to_vector(round(x - y, 2) + 0.0 for x, y in zip(goal, point_of(unmoved), strict=True))
    return replace(where, shift=shift)


def _side(place: Place, own_side: bool) -> float:
    """1 for the right side, -1 for the left one, 0 for neither."""
    if place.side.startswith("right"):
        return 1.0
    return -1.0 if place.side.startswith("left") else 1.0 if own_side else 0.0


def _sideways(place: Place, own_side: bool) -> float:
    """How far to the right a place before the body is, cm."""
    at = _AT.get(place.name, _TRUNK_AT)
    return _side(place, own_side) * (at + _BESIDE * place.side.endswith("beside"))


def _skin(place: Place, own_side: bool) -> tuple[str, float]:
    """The place on the skin, and how far beside it a hand is that does not touch, cm."""
    location, at, beside, paired = _SKIN[place.name]
    side = _side(place, own_side) or float(paired > 0.0)
    name, _, offset = location.partition(":")
    up = float(offset.split(",")[1]) if offset else 0.0
    wide = place.side.endswith("beside")
    if paired:
        name += "-weak" * (side < 0.0)
        out = side * beside * wide
    else:
        out = side * (beside if wide else at)
    # beside an organ, a touch is at the side of the head; a hand in the air is farther out
    text = name + (f":{out:g},{up:g}" if out or up else "")
    away = (at if not paired else 0.0) + _BESIDE - (beside if wide else 0.0) if wide else 0.0
    return text, side * max(away, 0.0)


def in_space(point: Sequence[float]) -> str:
    """A point (out, up, forward), cm from the chest, in words of the notation."""
    return "space:" + ",".join(f"{round(c, 2) + 0.0:g}" for c in point)


def _arm_spot(place: Place) -> Spot:
    """A place on the weak arm."""
    location = ON_ARM.get(place.name) or f"base-{_PARTS[place.name]}"
    close = 0.0 if place.contact in _TOUCHES else 3.0 if place.contact == "close" else 0.0
    part = "" if place.hand is None else part_of_hand(place.hand)
    return Spot(location, close, part=part, touches=not close)


def part_of_hand(site: Site) -> str:
    """A part of the hand in the notation's words. Raises ``InputError`` for what is none."""
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
    """The part of a hand that is at a place where none is written: a touch of one or two fingers is by their tips."""
    if not touches or shape.base in ("fist", "flat", "finger2345", "ceeall"):
        return "palm"
    if shape.special:
        return f"{shape.special[0]}.tip"
    return {"finger2": "2.tip", "finger23": "23.tip", "finger23spread": "23.tip"}.get(shape.base, "12.tip")


def shape_text(shape: WrittenShape) -> str:
    """A handshape in the notation's words (``composed``)."""
    words = [shape.base, *filter(None, (shape.thumb, shape.bend))]
    words += [f"{digit}:{bend}" for digit, bend in shape.bends if digit > 1]
    words += ["s" + "".join(map(str, shape.special))] if shape.special else []
    words += ["x" + "".join(map(str, shape.exempt))] if shape.exempt else []
    words += [f"o{shape.opposed}"] if shape.opposed > 1 else []
    words += [("c" if shape.crossed else "t") + "".join(map(str, shape.pair[:2]))] if len(shape.pair) > 1 else []
    words += [f"w{shape.opening:g}"] if shape.opening != 1.0 else []
    words += ["enclosed"] if shape.thumb_enclosed else []
    own = ".".join(words)
    return own if shape.between is None else f"{own}~{shape_text(replace(shape.between, between=None))}"
