"""One hand of a written sign at a time: what is written of it, and the posture in the notation that this makes.

Letters that are written for both hands are the strong hand's; for the weak hand they are exchanged as the kind of hands
says, and are then its own: l is left for either hand.
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
"""Kinds of hands: letters of finger directions, and of palms, that are exchanged for the weak hand; and the signs of
motions in its own directions."""
_SLIDE_CM, _SLIDE_COSINE = 7.0, 0.6
_LEAST_SLIDE = 0.75
"""How much of its way a hand goes at least that slides."""
_UPRIGHT, _TURNED_OUT = 0.7, 0.5
"""Upright fingers whose palm faces out as no forearm turns: its letter is read with the mean of two directions."""
HANGING = Posture("rest", REST, "palm", (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))
"""The posture of a hand that takes no part."""
Words = tuple[str, ...]


def swap_letters(word: str, letters: str) -> str:
    """A word of letters with pairs of them exchanged."""
    pairs = "".join(letters[k : k + 2][::-1] for k in range(0, len(letters), 2))
    return word.translate(str.maketrans(letters, pairs))


def other_side(place: Place) -> Place:
    """A place with left and right exchanged."""
    between = None if place.between is None else other_side(place.between)
    sides = {"right": "left", "left": "right"}
    side, _, rest = place.side.partition("_")
    return replace(place, side=f"{sides[side]}_{rest}" if side in sides else place.side, between=between)


def _of_weak_hand(posture: WrittenPosture, kind: str) -> WrittenPosture:
    """What a posture that is written for both hands says of the weak one."""
    ahead, faces, _ = KINDS[kind]
    return WrittenPosture(
        posture.shape,
        posture.fingers and tuple(swap_letters(word, ahead) for word in posture.fingers),
        posture.palm and tuple(swap_letters(word, faces) for word in posture.palm),
        posture.place and other_side(posture.place),
    )


@dataclass(frozen=True)
class HandState:
    """A hand of a written sign.

    which: 0 strong, 1 weak
    shape, fingers, palm, place: as written last, in this hand's own letters
    posture: what it makes in the notation; None before the first posture
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
        """The posture."""
        return HANGING if self.posture is None else self.posture

    @property
    def axes(self) -> tuple[Vector, Vector]:
        """Where fingers and palm point, in the hand's own directions."""
        assert self.fingers is not None
        assert self.palm is not None
        along, faces = hand_axes(self.fingers, self.palm)
        if along[1] > _UPRIGHT and (-1.0 if self.which else 1.0) * faces[0] > _TURNED_OUT:
            faces = facing(along, self.palm)
        return (_own(along), _own(faces)) if self.which else (along, faces)

    def apply_written_posture(self, posture: WrittenPosture | None, kind: str, literal: bool = False) -> HandState:
        """The hand with what a posture says of it, which is not yet made. ``literal``: it is written for this hand."""
        if posture is None:
            return self
        if self.which and not literal:
            posture = merge_postures(_of_weak_hand(posture, kind), posture.weak) or posture
        names = ("shape", "fingers", "palm", "place")
        return replace(self, **{name: getattr(posture, name) or getattr(self, name) for name in names})

    def at(self, where: Spot, one_handed: bool, touch: bool | None = None) -> HandState:
        """The hand in the posture that it makes at a place."""
        assert self.shape is not None
        along, faces = self.axes
        part = where.part or usual_part(self.shape, where.touches or (one_handed and where.head))
        made = Posture(
            shape_text(self.shape), where.location, part, faces, along, where.off, where.shift,
            touch=where.touches if touch is None else touch,
        )  # fmt: skip
        return replace(self, posture=made)

    def at_place(self, two_handed: bool) -> HandState:
        """The hand in its posture where it is written to be."""
        place = self.place or Place("")
        if self.which:
            place = other_side(place)
        where = spot(place, two_handed)
        if self.which and on_arm(where.location):
            where = Spot("space:2,0,20")
        return self.at(where, not two_handed)

    def move_by(
        self, travel: Vector, weak: Posture | None, before: Posture | None, fast: bool = False, alone: bool = False
    ) -> HandState:
        """The hand after a motion: its palm travels, or where it turns in a touch, the part that touches stays.

        weak: the weak hand's posture now, which the strong one may be at
        before: and before the motion
        fast: it does not slide along the skin
        alone: it does not go along with the weak hand
        """
        assert self.shape is not None
        old = self.current_posture
        along, faces = self.axes
        turned = replace(old, shape=shape_text(self.shape), palm=faces, fingers=along)
        formed = turned.shape == old.shape
        steady = formed and dot(faces, old.palm) > 0.999 and dot(along, old.fingers) > 0.999
        still = unit(travel) is None
        if on_arm(old.location) and (weak != before or alone):
            if not alone and steady and _together(travel, weak, before):
                return self
            return self._in_space(turned, travel, before)
        if steady and still:
            return replace(self, posture=turned)
        if self.meets and old.location.startswith("space:0,") and not (steady and abs(travel[0]) < 0.01):
            return self._in_space(turned, travel, before)
        if steady:
            return replace(self, posture=_shift_posture(turned, travel, weak, fast))
        if still and formed and old.off < 1.0 and not old.location.startswith("space"):
            return replace(self, posture=turned)
        here = palm_point(old, before, self.meets)
        turned = _by_palm(turned)
        shift = plus(plus(here, travel), palm_point(turned, weak), -1.0)
        return replace(self, posture=replace(turned, shift=shift))

    def _in_space(self, turned: Posture, travel: Vector, before: Posture | None) -> HandState:
        """The hand after a motion away from the other hand."""
        location = in_space(plus(palm_point(self.current_posture, before, self.meets), travel))
        return replace(self, posture=replace(_by_palm(turned), location=location))


def _by_palm(posture: Posture) -> Posture:
    """A posture whose palm is at its location."""
    return replace(posture, part="palm", off=0.0, shift=(0.0, 0.0, 0.0), touch=False)


def _together(travel: Vector, weak: Posture | None, before: Posture | None) -> bool:
    """Whether a hand goes along with the weak one, which does not turn meanwhile."""
    if weak is None or before is None:
        return False
    moved = _own(plus(palm_point(weak, None), palm_point(before, None), -1.0))
    apart = plus(travel, moved, -1.0)
    turns = (weak.fingers, weak.palm, weak.shape) != (before.fingers, before.palm, before.shape)
    return not turns and dot(apart, apart) < 1.0


def _own(v: Vector) -> Vector:
    """A vector (right, up, forward) in the weak hand's own directions, or back."""
    return (-v[0], v[1], v[2])


def complete_hand_state(state: HandState, lenient: bool) -> HandState:
    """The hand with a shape and directions. Raises ``InputError`` for what is not written, unless ``lenient``."""
    words = {"shape": "handshape", "fingers": "finger direction", "palm": "palm direction"}
    missing = [words[name] for name in words if getattr(state, name) is None]
    if missing and not lenient:
        raise InputError(f"has no {missing[0]}")
    shape, fingers, palm = state.shape or WrittenShape("flat"), state.fingers or ("o",), state.palm or ("d",)
    return replace(state, shape=shape, fingers=fingers, palm=palm)


def _shift_posture(posture: Posture, travel: Vector, weak: Posture | None, fast: bool) -> Posture:
    """A posture moved by ``travel``; a short way along the skin that it touches it slides."""
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
    """A location on the body so far beside another one; "" where that is halfway of two, or none."""
    name, _, offset = location.partition(":")
    if "/" in location or name == "space" or on_arm(location):
        return ""
    out, up = map(float, offset.split(",")) if offset else (0.0, 0.0)
    return f"{name}:{out + travel[0]:.4g},{up + travel[1]:.4g}"


def _goes(location: str, slid: str, travel: Vector) -> bool:
    """Whether a hand that slides from one location on the body to another goes as far as it is to: skin ends, and
    turns away.
    """
    nobody = weak_arm(None)
    way = locations.locate(slid, nobody).point - locations.locate(location, nobody).point
    return float(way @ (MIRROR * travel)) >= _LEAST_SLIDE * dot(travel, travel)


_IN_PLANE = 0.5
"""How much of the direction to the skin lies in the plane of a circle that begins there, at least."""


def from_skin(path: Path, posture: Posture, weak: Posture | None, meets: bool) -> Path:
    """A circle of a hand at the skin, or at the other hand, that begins where it is nearest to that: it is whole.
    Circles that keep clear of it begin at their top.
    """
    out, up, ahead = (MIRROR * locations.locate(posture.location, weak_arm(weak)).normal).tolist()
    toward = (-out, -up, -ahead) if out or up or ahead else (-float(meets and posture.touch), 0.0, 0.0)
    toward = plus(toward, path.direction, -dot(toward, path.direction))
    start = unit(toward)
    if start is None or dot(toward, toward) < _IN_PLANE**2 or path.size < posture.off:
        return path
    return replace(path, start=start)


def weak_arm(posture: Posture | None) -> WeakArm:
    """The weak arm of the standard signer in a posture."""
    if posture is None or posture.location == REST:
        return WeakArm(STANDARD, locations.resting(STANDARD)[27:54])
    return WeakArm(STANDARD, locations.weak_hand(posture, STANDARD))


def palm_point(posture: Posture, weak: Posture | None, meets: bool = False) -> Vector:
    """The middle of the palm (out, up, forward) of a hand of the standard signer, cm."""
    needed = weak_arm(weak) if on_arm(posture.location) else WeakArm(STANDARD, np.zeros(27))
    point = locations.palm(posture, needed, meets)
    return (-float(point[0]), float(point[1]), float(point[2]))
