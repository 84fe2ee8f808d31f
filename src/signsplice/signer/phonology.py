"""The phonology of a sign: segments of the Movement-Hold model, each with the parameters of Stokoe and HamNoSys.

A sign is a sequence of segments (Liddell and Johnson 1989). H is a hold, X a posture passed without a hold, M a
movement to a new posture. A posture is a handshape, a part of the hand at a location, and the directions of palm and
fingers. Directions are relative to the signer: ``in`` is towards the weak side, ``out`` towards the strong side, so
that the same text serves a left-handed signer.

Handshapes, locations and parts of the hand are words; those without a name are composed of named ones (``handshapes``,
``locations``, ``hand``).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from signsplice.signer.hand import is_part
from signsplice.signer.handshapes import is_handshape
from signsplice.signer.signer import STANDARD, Signer
from signsplice.signer.tables import Vector, sections

HANDS = {
    "one": "the weak hand hangs",
    "symmetric": "the weak hand mirrors the strong one",
    "alternating": "the weak hand mirrors the strong one half a cycle away",
    "base": "the weak hand has postures and paths of its own (w.shape, w.at, w.palm, w.fingers, w.path)",
}
MIRRORED_HANDS = ("symmetric", "alternating")
"""Kinds of hands that mirror one another; either hand may touch, in other kinds the strong one."""

DIRECTIONS: dict[str, Vector] = {
    "up": (0.0, 1.0, 0.0),
    "down": (0.0, -1.0, 0.0),
    "out": (1.0, 0.0, 0.0),
    "in": (-1.0, 0.0, 0.0),
    "fwd": (0.0, 0.0, 1.0),
    "back": (0.0, 0.0, -1.0),
}
"""Unit vectors (out to the strong side, up, forward). Words can be combined: ``up-in`` lies midway, ``up-up-in`` nearer
to up."""

PLACES = sections(__file__, "places")
"""The tables of locations and parts of the hand, which ``locations`` reads."""
PARTS = tuple(name for name, *_ in PLACES["parts"])
"""Parts of the hand that can be brought to a location."""
LOCATIONS = tuple(name for place in ("body", "arm", "base", "space") for name, *_ in PLACES[place])
"""Locations of a part of the hand, on the surface of the body or in space; words/places.txt describes them."""

NEUTRAL = frozenset(name for name in LOCATIONS if name.startswith("space") or name.endswith("-space"))
ROLES = ("subject", "object")
"""Locations in an agreement verb; ``inflection.agree`` replaces them by loci."""
LOCI = frozenset(name for name in LOCATIONS if name.startswith("locus:")) | set(ROLES)
IN_SPACE = NEUTRAL | {"above-head"} | LOCI
_BODY = frozenset(name for name, *_ in PLACES["body"])
ON_ARM = frozenset(name for name, *_ in PLACES["arm"])
ON_BASE = frozenset(name for name in LOCATIONS if name.startswith("base-") or name == "forearm-weak")

REST = "rest"
"""The location of a hand that hangs, or lies in the signer's rest pose."""


def in_space(location: str) -> bool:
    """Whether a location is in space, not on the body."""
    return location in IN_SPACE or location.startswith("space:") or location == REST


def on_base(location: str) -> bool:
    """Whether a location is on a weak hand or forearm that has postures of its own."""
    return location in ON_BASE or location.startswith("base-")


def on_arm(location: str) -> bool:
    """Whether a location is on the weak arm or its hand."""
    return location in ON_ARM or on_base(location)


_COMPOSED = re.compile(r"(?P<name>[a-z-]+?)(?P<weak>-weak)?(?::-?\d+(?:\.\d+)?,-?\d+(?:\.\d+)?)?")
_POINT = re.compile("space:" + ",".join([r"-?\d+(?:\.\d+)?"] * 3))


def is_location(text: str) -> bool:
    """Whether a text names a location, or composes one: ``space:OUT,UP,FWD`` (cm from the chest), ``base-PART`` (a part
    of the weak hand), ``rest``; of those on head and trunk ``A/B`` (halfway), ``NAME:OUT,UP`` (cm beside it on the
    skin), ``NAME-weak`` (the other side).
    """
    if text in LOCATIONS or text == REST or _POINT.fullmatch(text):
        return True
    if text.startswith("base-"):
        return is_part(text[5:])
    names = [match and (match["name"] if match["name"] in _BODY else match["name"] + (match["weak"] or ""))
             for match in map(_COMPOSED.fullmatch, text.split("/"))]  # fmt: skip
    return 1 <= len(names) <= 2 and all(name in _BODY for name in names)


PATHS = ("straight", "arc", "circle", "zigzag", "none")
PLANES = ("frontal", "sagittal", "horizontal")
LOCALS: dict[str, tuple[float, float]] = {
    "wiggle": (22.0, 2.0),
    "bend": (45.0, 2.0),
    "twist": (30.0, 2.0),
    "nod": (28.0, 2.0),
    "tremble": (0.7, 3.0),
    "swing": (18.0, 2.0),
    "stir": (16.0, 2.0),
}
"""Local movements with their usual amplitude (degrees; cm for tremble) and number of cycles: the fingers flutter one
after another, the fingers bend together, the forearm rotates, the wrist nods, the whole hand shakes, the wrist swings
sideways, the hand stirs (negative amplitude: the other way).
"""

HEAD = ("nod", "shake", "tilt", "tilt-weak")
"""Movements of the head; it tilts to the strong side or to the weak side."""
TRUNK = ("fwd", "back", "out", "in")
"""Directions in which the trunk leans: out to the strong side, in to the weak side."""


@dataclass(frozen=True)
class Posture:
    """A hand that does not move. Vectors are (out, up, forward).

    shape: handshape, a name of ``HANDSHAPES`` or composed
    location: location of the hand, a name of ``LOCATIONS`` or composed
    part: part of the hand at the location, a name of ``PARTS`` or composed
    palm: unit vector that the palm faces along
    fingers: unit vector that the extended fingers would point along
    off: distance of the part from the body's surface, cm
    shift: displacement from there, cm
    on_skin: whether the hand lies on the skin after ``shift``, and no deeper
    touch: whether the part touches there, as far as the rest of the hand allows, which goes no deeper
    """

    shape: str
    location: str
    part: str
    palm: Vector
    fingers: Vector
    off: float = 0.0
    shift: Vector = (0.0, 0.0, 0.0)
    on_skin: bool = False
    touch: bool = False


@dataclass(frozen=True)
class Path:
    """The shape of a movement between two postures.

    kind: one of ``PATHS``
    direction: unit vector along which an ``arc`` bulges and a ``zigzag`` swings; axis of a ``circle`` without a plane,
        by the right-hand rule
    plane: plane of a ``circle``, one of ``PLANES``; "" for a circle about an axis, whose partial turns lead from
        posture to posture
    size: bulge, swing or radius, cm
    revolutions: revolutions of a ``circle`` (negative: the other direction of rotation); swings of a ``zigzag``
    start: unit vector from the middle of a circle about an axis to its start
    ratio: width of that circle across ``start`` over its width along ``start``
    """

    kind: str = "straight"
    direction: Vector = (0.0, 0.0, 0.0)
    plane: str = ""
    size: float = 0.0
    revolutions: float = 0.0
    start: Vector = (0.0, 0.0, 0.0)
    ratio: float = 1.0


@dataclass(frozen=True)
class Local:
    """A local movement, within the hand.

    kind: a name of ``LOCALS``
    amplitude: degrees; cm for ``tremble``
    cycles: how often it repeats
    also: another local movement at the same time, or None
    """

    kind: str
    amplitude: float
    cycles: float
    also: Local | None = None


@dataclass(frozen=True)
class Segment:
    """One segment of a sign. Fields from ``path`` to ``tempo``, ``weak_path``, ``weak_local`` and ``keeps`` belong to M
    alone.

    kind: H, X or M
    strong: the strong hand's posture at the segment's end
    weak: the weak hand's own posture there, or None
    path: the movement's path
    local: local movement, or None
    times: number of passes of the movement; the hand goes back between them
    lift: how far the hand is lifted on its way back, cm; 0 if it goes back on the same path
    step: displacement of each pass from the previous one, cm
    tempo: speed of the movement over the usual one
    seconds: duration, or None if the notation gives none
    head: movement of the head, a name of ``HEAD`` or ""
    trunk: movement of the trunk, a name of ``TRUNK`` or ""
    weak_path: path of a base hand's own movement
    weak_local: local movement of a base hand, or None
    keeps: whether hands stay in touch all the way: with the skin, or with one another if mirrored hands meet
    """

    kind: str
    strong: Posture
    weak: Posture | None = None
    path: Path = Path()
    local: Local | None = None
    times: int = 1
    seconds: float | None = None
    head: str = ""
    trunk: str = ""
    lift: float = 0.0
    step: Vector = (0.0, 0.0, 0.0)
    tempo: float = 1.0
    weak_path: Path = Path()
    weak_local: Local | None = None
    keeps: bool = False

    @property
    def circles(self) -> bool:
        """Whether a hand circles."""
        return "circle" in (self.path.kind, self.weak_path.kind)


_NUMBER = r"(-?[0-9]{1,3}(?:\.[0-9]{1,6})?)"
_GESTURE = re.compile(
    rf"(head|trunk) {_NUMBER},{_NUMBER},{_NUMBER}(?: cycles={_NUMBER})?(?: from={_NUMBER})?(?: to={_NUMBER})?"
)
GESTURE_FORM = "head|trunk FORWARD,LEFT,TILT [cycles=0:20] [from=0:1] [to=0:1], at most 60 degrees"


@dataclass(frozen=True)
class Gesture:
    """A gesture of head or trunk.

    part: head or trunk
    degrees: turns forward, to the left, and towards the right shoulder, degrees
    cycles: number of times it goes there and back; a turn to the side swings to both; 0: it goes there and stays
    begin, end: fractions of the time between the sign's first posture and its last
    """

    part: str
    degrees: tuple[float, float, float]
    cycles: float = 0.0
    begin: float = 0.0
    end: float = 1.0

    def __str__(self) -> str:
        """The gesture in the notation, numbers to a thousandth."""
        numbers = ",".join(f"{round(angle, 3) + 0.0:g}" for angle in self.degrees)
        options = (("cycles", self.cycles, 0.0), ("from", self.begin, 0.0), ("to", self.end, 1.0))
        return " ".join([self.part, numbers, *(f"{key}={round(x, 3):g}" for key, x, usual in options if x != usual)])


def read_gesture(text: str) -> Gesture | None:
    """Parses a gesture in the notation (``GESTURE_FORM``); returns None for any other text."""
    match = _GESTURE.fullmatch(text)
    if match is None:
        return None
    x, y, z, cycles, begin, end = (float(n or usual) for n, usual in zip(match.groups()[1:], "000001", strict=True))
    well = max(abs(x), abs(y), abs(z)) <= 60.0 and 0.0 <= cycles <= 20.0 and 0.0 <= begin < end <= 1.0
    return Gesture(match[1], (x, y, z), cycles, begin, end) if well else None


@dataclass(frozen=True)
class Sign:
    """A sign in notation.

    gloss: its name
    hands: how the hands work together, a name of ``HANDS``
    segments: its segments in order
    source: description of the form, and the work that documents it
    synonyms: other glosses of the same sign
    kind: ``sign``, ``letter`` or ``pseudo``
    gestures: of head and trunk, in their own time
    """

    gloss: str
    hands: str
    segments: tuple[Segment, ...]
    source: str = ""
    synonyms: tuple[str, ...] = ()
    kind: str = "sign"
    gestures: tuple[Gesture, ...] = ()

    @property
    def two_handed(self) -> bool:
        """Whether the weak hand takes part."""
        return self.hands != "one"


def owned_channels(sign: Sign, signer: Signer = STANDARD) -> frozenset[str]:
    """Returns the channels (some of ``roles.CHANNELS``) that are a sign's own if a signer makes it: the strong arm; the
    weak arm if it takes part or is touched; head and trunk if the sign moves them.
    """
    strong, weak = ("left arm", "right arm") if signer.left_handed else ("right arm", "left arm")
    needs_weak = sign.two_handed or any(on_arm(segment.strong.location) for segment in sign.segments)
    moved = {part for segment in sign.segments for part in ("head", "trunk") if getattr(segment, part)}
    return frozenset({strong, *[weak] * needs_weak, *moved, *(gesture.part for gesture in sign.gestures)})


def faults(sign: Sign) -> list[str]:
    """Lists the problems of a sign's segments, one line each; empty for a well-formed sign.

    Symmetry and dominance (Battison 1978) need no check: the notation gives both hands one handshape if they move on
    their own; a weak hand with another handshape is a base, which stays put or moves with the strong hand.
    """
    problems = []
    if not sign.segments:
        return ["has no segment, expected at least one H or X line"]
    if sign.segments[0].kind == "M":
        problems.append("begins with M, expected H or X first, from which to move")
    if all(segment.kind == "X" for segment in sign.segments):
        problems.append("has X alone, expected M or H after it")
    for n, segment in enumerate(sign.segments, 1):
        before = sign.segments[n - 2] if n > 1 else None
        hands = [p for p in (segment.strong, segment.weak) if p is not None]
        problems += [f"segment {n}: unknown handshape {p.shape!r}" for p in hands if not is_handshape(p.shape)]
        problems += [f"segment {n}: unknown location {p.location!r}" for p in hands if not is_location(p.location)]
        problems += [f"segment {n}: unknown part {p.part!r}" for p in hands if not is_part(p.part)]
        if sign.hands != "base" and on_base(segment.strong.location):
            problems.append(f"segment {n}: at={segment.strong.location} needs hands=base, not hands={sign.hands}")
        if segment.kind == "M" and before is not None:
            still = segment.strong == before.strong and segment.weak == before.weak
            swings = {segment.path.kind, segment.weak_path.kind} & {"circle", "zigzag"}
            if still and segment.local is None and segment.weak_local is None and not swings:
                problems.append(f"segment {n}: M moves nothing, expected another posture, a path or a local movement")
            problems += [f"segment {n}: {fault}" for fault in _repetition_faults(segment, before, sign)]
            not_touching = [
                p for p in (before.strong, segment.strong) if segment.keeps and not _is_touch(p, sign.hands)
            ]
            problems += [
                f"segment {n}: keep=touch needs touches at both ends, at={p.location} is none" for p in not_touching[:1]
            ]
        elif before is not None and (segment.strong != before.strong or segment.weak != before.weak):
            problems.append(f"segment {n}: {segment.kind} changes the posture, expected M to move there first")
        for p in hands:
            dot = sum(a * b for a, b in zip(p.palm, p.fingers, strict=True))
            if abs(dot) > 0.9:
                problems.append(f"segment {n}: palm and fingers must be at least 25 degrees from parallel")
            if p.location in LOCI and sign.hands in MIRRORED_HANDS:
                needs = f"at={p.location} needs hands=one or hands=base"
                problems.append(f"segment {n}: {needs}; mirrored hands have no common locus")
    if sum(s.kind == "H" for s in sign.segments) == len(sign.segments) > 1:
        problems.append("has holds only, expected an M between two")
    return problems


def _is_touch(posture: Posture, hands: str) -> bool:
    """Whether a posture is written as a touch of the body, or of hands that mirror one another and meet."""
    meets = hands in MIRRORED_HANDS and posture.location in ("space-mid", "space-low-mid")
    return posture.off < 1.0 and (meets or not in_space(posture.location))


def _repetition_faults(segment: Segment, before: Segment, sign: Sign) -> list[str]:
    """Lists the problems in the repetition of a movement that begins at the posture of the segment ``before``."""
    problems = []
    still = segment.strong == before.strong and segment.weak == before.weak
    moved = any(segment.step)
    for key, is_set in (("return=lifted", segment.lift > 0.0), ("step=", moved)):
        if is_set and segment.times < 2:
            problems.append(f"{key} needs times=2 or more")
        if is_set and sign.hands == "alternating":
            problems.append(f"{key} needs hands that go the same way at a time, not hands=alternating")
        if is_set and still:
            problems.append(f"{key} needs a movement to another posture, from which to return")
    ends = (before.strong.location, segment.strong.location)
    on_body = [location for location in ends if not in_space(location) and not on_base(location)]
    if moved and on_body:
        problems.append(f"step= would leave at={on_body[0]}, expected places in space or at the base hand")
    if moved and segment is not [s for s in sign.segments if s.kind == "M"][-1]:
        problems.append("step= belongs to the sign's last movement")
    return problems
