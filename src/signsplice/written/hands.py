"""One hand of a written sign: what is written for it, and its posture in the notation.

Letters written for both hands apply to the strong hand. The kind of hands says which of them are exchanged for the weak
hand. After the exchange, l means left for either hand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from signsplice.errors import InputError
from signsplice.signer import locations
from signsplice.signer.locations import WeakArm
from signsplice.signer.phonology import REST, Path, Posture, on_arm
from signsplice.signer.pose import MIRROR
from signsplice.signer.signer import STANDARD
from signsplice.signer.tables import Vector
from signsplice.written.tree import Place, WrittenPosture, WrittenShape, merge_postures
from signsplice.written.vocabulary import (
    Spot,
    dot,
    facing,
    hand_axes,
    in_space,
    plus,
    shape_text,
    spot,
    unit,
    usual_part,
)

KINDS: dict[str, tuple[str, str, Vector]] = {
    "mirrored": ("lr", "lr", (1.0, 1.0, 1.0)),
    "two": ("lr", "lr", (1.0, 1.0, 1.0)),
    "one": ("lr", "lr", (1.0, 1.0, 1.0)),
    "weak": ("", "", (-1.0, 1.0, 1.0)),
    "parallel": ("", "lr", (-1.0, 1.0, 1.0)),
    "up_down": ("ud", "ud", (-1.0, -1.0, 1.0)),
    "out_in": ("oi", "", (-1.0, 1.0, -1.0)),
    "point": ("lrudoi", "lrud", (1.0, -1.0, -1.0)),
    "mirrored_up_down": ("lrud", "lrud", (1.0, -1.0, 1.0)),
    "mirrored_out_in": ("lroi", "lr", (1.0, 1.0, -1.0)),
    "up_down_out_in": ("udoi", "ud", (-1.0, -1.0, -1.0)),
}
"""Kind of hands -> letters of finger directions and of palms to exchange for the weak hand, and factors on its motions
in its own axes."""
_SLIDE_CM = 7.0
"""Longest travel that slides along the skin, cm."""
_SLIDE_COSINE = 0.6
"""Largest cosine between travel and skin normal at which the hand slides."""
_LEAST_SLIDE = 0.75
"""Least fraction of its travel that a sliding hand covers."""
_UPRIGHT = 0.7
"""Upward component of the finger direction above which fingers count as upright."""
_TURNED_OUT = 0.5
"""Outward component of the palm direction that no forearm reaches with upright fingers: the palm's letter is then read
with the mean of both finger directions."""
HANGING = Posture("rest", REST, "palm", (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))
"""The posture of an idle hand."""
Words = tuple[str, ...]


def swap_letters(word: str, letters: str) -> str:
    """Exchanges pairs of letters in a word."""
    pairs = "".join(letters[k : k + 2][::-1] for k in range(0, len(letters), 2))
    return word.translate(str.maketrans(letters, pairs))


def other_side(place: Place) -> Place:
    """Exchanges left and right in a place."""
    between = None if place.between is None else other_side(place.between)
    sides = {"right": "left", "left": "right"}
    side, _, rest = place.side.partition("_")
    return replace(place, side=f"{sides[side]}_{rest}" if side in sides else place.side, between=between)


def _of_weak_hand(posture: WrittenPosture, kind: str) -> WrittenPosture:
    """The weak hand's part of a posture written for both hands."""
    finger_letters, palm_letters, _ = KINDS[kind]
    return WrittenPosture(
        posture.shape,
        posture.fingers and tuple(swap_letters(word, finger_letters) for word in posture.fingers),
        posture.palm and tuple(swap_letters(word, palm_letters) for word in posture.palm),
        posture.place and other_side(posture.place),
    )


@dataclass(frozen=True)
class WrittenHand:
    """A hand of a written sign.

    which: 0 strong, 1 weak
    shape, fingers, palm, place: last written values, in this hand's own letters
    posture: its posture in the notation; None before the first posture
    meets: whether the other hand mirrors it, so that both meet on the midline
    """

    which: int
    shape: WrittenShape | None = None
    fingers: Words | None = None
    palm: Words | None = None
    place: Place | None = None
    posture: Posture | None = None
    meets: bool = False

    @property
    def current_posture(self) -> Posture:
        """The posture, or ``HANGING`` before the first."""
        return HANGING if self.posture is None else self.posture

    @property
    def axes(self) -> tuple[Vector, Vector]:
        """Directions of fingers and palm, in the hand's own axes."""
        assert self.fingers is not None
        assert self.palm is not None
        finger_axis, palm_axis = hand_axes(self.fingers, self.palm)
        if finger_axis[1] > _UPRIGHT and (-1.0 if self.which else 1.0) * palm_axis[0] > _TURNED_OUT:
            palm_axis = facing(finger_axis, self.palm)
        return (_own(finger_axis), _own(palm_axis)) if self.which else (finger_axis, palm_axis)

    def apply_written_posture(self, posture: WrittenPosture | None, kind: str, literal: bool = False) -> WrittenHand:
        """Sets the written values of a posture and keeps ``posture``. ``literal``: they are written for this hand."""
        if posture is None:
            return self
        if self.which and not literal:
            posture = merge_postures(_of_weak_hand(posture, kind), posture.weak) or posture
        names = ("shape", "fingers", "palm", "place")
        return replace(self, **{name: getattr(posture, name) or getattr(self, name) for name in names})

    def at(self, where: Spot, one_handed: bool, touch: bool | None = None) -> WrittenHand:
        """Returns the hand with its posture at a spot."""
        assert self.shape is not None
        finger_axis, palm_axis = self.axes
        part = where.part or usual_part(self.shape, where.touches or (one_handed and where.head))
        posture = Posture(
            shape_text(self.shape), where.location, part, palm_axis, finger_axis, where.off, where.shift,
            touch=where.touches if touch is None else touch,
        )  # fmt: skip
        return replace(self, posture=posture)

    def at_place(self, two_handed: bool) -> WrittenHand:
        """Returns the hand with its posture at its written place."""
        place = self.place or Place("")
        if self.which:
            place = other_side(place)
        where = spot(place, two_handed)
        if self.which and on_arm(where.location):
            where = Spot("space:2,0,20")
        return self.at(where, not two_handed)

    def move_by(
        self, travel: Vector, weak: Posture | None, weak_before: Posture | None, fast: bool = False, alone: bool = False
    ) -> WrittenHand:
        """Returns the hand after a motion: the palm travels, but in a touch that only turns the touching part stays.

        weak: the weak hand's current posture, at which the strong hand may be
        weak_before: the weak hand's posture before the motion
        fast: the hand does not slide along the skin
        alone: the hand does not move along with the weak hand
        """
        assert self.shape is not None
        old = self.current_posture
        finger_axis, palm_axis = self.axes
        turned = replace(old, shape=shape_text(self.shape), palm=palm_axis, fingers=finger_axis)
        formed = turned.shape == old.shape
        steady = formed and dot(palm_axis, old.palm) > 0.999 and dot(finger_axis, old.fingers) > 0.999
        still = unit(travel) is None
        if on_arm(old.location) and (weak != weak_before or alone):
            if not alone and steady and _together(travel, weak, weak_before):
                return self
            return self._in_space(turned, travel, weak_before)
        if steady and still:
            return replace(self, posture=turned)
        if self.meets and old.location.startswith("space:0,") and not (steady and abs(travel[0]) < 0.01):
            return self._in_space(turned, travel, weak_before)
        if steady:
            return replace(self, posture=_shift_posture(turned, travel, weak, fast))
        if still and formed and old.off < 1.0 and not old.location.startswith("space"):
            return replace(self, posture=turned)
        old_palm = palm_point(old, weak_before, self.meets)
        turned = _by_palm(turned)
        shift = plus(plus(old_palm, travel), palm_point(turned, weak), -1.0)
        return replace(self, posture=replace(turned, shift=shift))

    def _in_space(self, turned: Posture, travel: Vector, weak_before: Posture | None) -> WrittenHand:
        """Returns the hand after a motion away from the other hand."""
        location = in_space(plus(palm_point(self.current_posture, weak_before, self.meets), travel))
        return replace(self, posture=replace(_by_palm(turned), location=location))


def _by_palm(posture: Posture) -> Posture:
    """Returns the posture with the palm at its location."""
    return replace(posture, part="palm", off=0.0, shift=(0.0, 0.0, 0.0), touch=False)


def _together(travel: Vector, weak: Posture | None, weak_before: Posture | None) -> bool:
    """Whether a hand moves along with the weak hand, and the weak hand does not turn."""
    if weak is None or weak_before is None:
        return False
    moved = _own(plus(palm_point(weak, None), palm_point(weak_before, None), -1.0))
    difference = plus(travel, moved, -1.0)
    turns = (weak.fingers, weak.palm, weak.shape) != (weak_before.fingers, weak_before.palm, weak_before.shape)
    return not turns and dot(difference, difference) < 1.0


def _own(v: Vector) -> Vector:
    """Converts a vector (right, up, forward) to the weak hand's own axes, or back."""
    return (-v[0], v[1], v[2])


def complete_hand(hand: WrittenHand, lenient: bool) -> WrittenHand:
    """Fills in a hand's shape and directions if ``lenient``; otherwise raises ``InputError`` if one is missing."""
    words = {"shape": "handshape", "fingers": "finger direction", "palm": "palm direction"}
    missing = [words[name] for name in words if getattr(hand, name) is None]
    if missing and not lenient:
        raise InputError(f"has no {missing[0]}")
    shape, fingers, palm = hand.shape or WrittenShape("flat"), hand.fingers or ("o",), hand.palm or ("d",)
    return replace(hand, shape=shape, fingers=fingers, palm=palm)


def _shift_posture(posture: Posture, travel: Vector, weak: Posture | None, fast: bool) -> Posture:
    """Moves a posture by ``travel``; it slides if the travel is short and along the skin that it touches."""
    length = dot(travel, travel) ** 0.5
    if posture.touch and not fast and length <= _SLIDE_CM:
        normal = locations.locate(posture.location, weak_arm(weak)).normal * MIRROR
        if normal.any() and abs(float(normal @ np.array(travel))) < _SLIDE_COSINE * length:
            slid = _offset_location(posture.location, travel)
            if slid and normal[2] > 0.6 and _goes(posture.location, slid, travel):
                return replace(posture, location=slid)
            if on_arm(posture.location):
                return replace(posture, shift=plus(posture.shift, travel))
    return replace(posture, shift=plus(posture.shift, travel), touch=False)


def _offset_location(location: str, travel: Vector) -> str:
    """Returns a location on the body shifted by ``travel``; "" for a midpoint or a location that cannot shift."""
    name, _, offset = location.partition(":")
    if "/" in location or name == "space" or on_arm(location):
        return ""
    outward, up = map(float, offset.split(",")) if offset else (0.0, 0.0)
    return f"{name}:{outward + travel[0]:.4g},{up + travel[1]:.4g}"


def _goes(location: str, slid: str, travel: Vector) -> bool:
    """Whether a slide between two body locations covers enough of ``travel``: skin may end or turn away."""
    resting = weak_arm(None)
    displacement = locations.locate(slid, resting).point - locations.locate(location, resting).point
    return float(displacement @ (MIRROR * travel)) >= _LEAST_SLIDE * dot(travel, travel)


_IN_PLANE = 0.5
"""Least component of the direction to the skin in the plane of a circle that begins there."""


def from_skin(path: Path, posture: Posture, weak: Posture | None, meets: bool) -> Path:
    """Starts a circle near the skin or the other hand at its nearest point. Circles that keep clear of it start at
    their top.
    """
    outward, up, forward = (MIRROR * locations.locate(posture.location, weak_arm(weak)).normal).tolist()
    toward = (-outward, -up, -forward) if outward or up or forward else (-float(meets and posture.touch), 0.0, 0.0)
    toward = plus(toward, path.direction, -dot(toward, path.direction))
    start = unit(toward)
    if start is None or dot(toward, toward) < _IN_PLANE**2 or path.size < posture.off:
        return path
    return replace(path, start=start)


def weak_arm(posture: Posture | None) -> WeakArm:
    """Returns the weak arm of the standard signer in a posture."""
    if posture is None or posture.location == REST:
        return WeakArm(STANDARD, locations.resting(STANDARD)[27:54])
    return WeakArm(STANDARD, locations.weak_hand(posture, STANDARD))


def palm_point(posture: Posture, weak: Posture | None, meets: bool = False) -> Vector:
    """Returns the palm centre (out, up, forward) of the standard signer's hand, cm."""
    needed = weak_arm(weak) if on_arm(posture.location) else WeakArm(STANDARD, np.zeros(27))
    point = locations.palm(posture, needed, meets)
    return (-float(point[0]), float(point[1]), float(point[2]))
