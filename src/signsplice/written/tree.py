"""The tree of a written sign, in frozen values, shared by gestural SiGML, HamNoSys SiGML and HamNoSys text; and how the
hands of a sign work together.

The words come from HamNoSys 4 and gestural SiGML (Elliott, Glauert, Kennaway and Marshall 2004). Direction letters are
from the signer's view: u up, d down, l left, r right, o out, i in. The signer is right-handed. ``None`` means "as
before", and in a first posture "not written".
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace


@dataclass(frozen=True)
class Where:
    """The position of a value, for errors.

    file: name of the file or text
    gloss: the sign's gloss
    symbol: name of the element or symbol in errors
    position: line of an XML file, or number of the symbol in a HamNoSys text; from 1
    """

    file: str = ""
    gloss: str = ""
    symbol: str = ""
    position: int = 0


@dataclass(frozen=True)
class WrittenShape:
    """A composed handshape.

    base: fist, flat, finger2, finger23, finger23spread, finger2345, pinch12, pinchall, pinch12open, cee12, ceeall,
        cee12open
    thumb: out, across, opposed, or "" for the thumb of the base
    bend: bend of the selected fingers: bent, round, hooked, dblbent, dblhooked, halfbent, or ""
    bends: (digit, bend) of single fingers; a bend may be three digits, quarters of each joint's bend
    special: digits selected instead of the base's own (the letter I: finger2 with 5)
    exempt: digits excluded from the group
    opposed: digit that the thumb meets, 0 for the base's own
    pair: two digits that cross or touch, or ()
    crossed: the pair crosses; otherwise it touches
    opening: factor on all bends: 1 for the base, more for tight, less for slack
    thumb_enclosed: the thumb is under the fingers
    between: the second shape, if the handshape is the mean of two
    """

    base: str
    thumb: str = ""
    bend: str = ""
    bends: tuple[tuple[int, str], ...] = ()
    special: tuple[int, ...] = ()
    exempt: tuple[int, ...] = ()
    opposed: int = 0
    pair: tuple[int, ...] = ()
    crossed: bool = False
    opening: float = 1.0
    thumb_enclosed: bool = False
    between: WrittenShape | None = None


@dataclass(frozen=True)
class Site:
    """A part of a hand or an arm.

    part: tip, nail, pad, midjoint, base, side (with digits); thumbside, pinkyside, palm, handback, thumbball,
        wristback, wristpulse, lowerarm, elbow, elbowinside, upperarm
    digits: 1 thumb to 5 little finger; two digits mean between them
    side: palmar, dorsal, radial, ulnar, or ""
    between: the second site, if the part is between two
    """

    part: str
    digits: tuple[int, ...] = ()
    side: str = ""
    between: Site | None = None


@dataclass(frozen=True)
class Place:
    """A place on the body or before it.

    name: head, headtop, forehead, eyebrows, eyes, nose, nostrils, ear, earlobe, cheek, lips, tongue, teeth, chin,
        underchin, neck, shouldertop, shoulders, chest, stomach, belowstomach, neutral, upperarm, elbow, elbowinside,
        lowerarm, wristback, wristpulse; "" for the body without a name
    side: right_at, right_beside, left_at, left_beside, or ""
    contact: touch, close, armextended, interlock, cross, brushing, or "" for none
    behind: the hand is behind the place
    between: the second place, if the place is halfway between two
    hand: the part of the moving hand at the place
    """

    name: str
    side: str = ""
    contact: str = ""
    behind: bool = False
    between: Place | None = None
    hand: Site | None = None


@dataclass(frozen=True)
class Pair:
    """The relation of two hands (a hand constellation).

    weak, strong: the part of each hand that meets the other
    contact: touch, close, interlock, cross, or "" for none
    place: place of the pair on the body
    """

    weak: Site | None = None
    strong: Site | None = None
    contact: str = ""
    place: Place | None = None


@dataclass(frozen=True)
class WrittenPosture:
    """The hands at one time; ``None`` leaves a part as before.

    shape, fingers, palm, place: of the strong hand, or of both hands if ``weak`` says nothing else. ``fingers`` and
        ``palm`` are one or two words of letters (two: the mean)
    weak: differences of the weak hand; its letters are literal, never mirrored
    pair: how the hands meet
    """

    shape: WrittenShape | None = None
    fingers: tuple[str, ...] | None = None
    palm: tuple[str, ...] | None = None
    place: Place | None = None
    pair: Pair | None = None
    weak: WrittenPosture | None = None


@dataclass(frozen=True)
class WrittenManner:
    """The manner of a motion.

    fast, slow, tense, rest, halt, bouncing, fused: as written
    speed: factor on the usual speed
    """

    fast: bool = False
    slow: bool = False
    tense: bool = False
    rest: bool = False
    halt: bool = False
    bouncing: bool = False
    fused: bool = False
    speed: float = 1.0


@dataclass(frozen=True)
class Motion:
    """One action; ``kind`` decides which fields apply.

    kind: straight, circle, nodding, swinging, twisting, stircw, stirccw, fingerplay, posture (a change of posture with
        no path), hold (no motion), parallel, sequence, fusion, split, crossing, swap
    direction: letters of a straight motion or of a circle's axis; two words: the mean
    size: small, big, or ""; ``size_end``: its size at the end
    curve, curve_size: letters of the side to which a straight motion bulges, and the size of the bulge
    zigzag, zigzag_size: wavy, zigzag, or "", and its width
    turns: whole turns of a circle; with ``end``: turns in addition to the arc from ``start`` to ``end``, 0 or more
    start, end: letters of the places on the circle
    ellipse, ellipse_size: letters of the long axis, or of the swings of a zigzag, and small, big, or ""
    digits: fingers of a finger play, or () for its own
    parts: motions of parallel, sequence, fusion; of split: (strong, weak)
    target: posture at the end (a targeted motion)
    brushing, brushing_pair: place, or site of the other hand, along which the hand brushes
    repeat: "", fromstart, fromstart_several, manyrandom, continue, continue_several, reverse, tofroto, swap
    shift: direction letters of the shift of each pass
    alternating: the weak hand is half a cycle late
    manner: manner of the motion
    where: position, for errors
    """

    kind: str
    direction: tuple[str, ...] = ()
    size: str = ""
    size_end: str = ""
    curve: str = ""
    curve_size: str = ""
    zigzag: str = ""
    zigzag_size: str = ""
    turns: float = 1.0
    start: str = ""
    end: str = ""
    ellipse: str = ""
    ellipse_size: str = ""
    digits: tuple[int, ...] = ()
    parts: tuple[Motion, ...] = ()
    target: WrittenPosture | None = None
    brushing: Place | None = None
    brushing_pair: Pair | None = None
    repeat: str = ""
    shift: str = ""
    alternating: bool = False
    manner: WrittenManner = field(default_factory=WrittenManner)
    where: Where = field(default_factory=Where)


@dataclass(frozen=True)
class Tier:
    """A nonmanual item.

    tier: mouth_picture, mouth_gesture, eye_brows, eye_lids, eye_gaze, nose, head, body, shoulder
    code: SAMPA of a mouth picture; the code of the tables of gestural SiGML for the rest
    start: index in its lane, from 0; items with the same index run together
    amount, speed: factors, 1 as usual
    lane: items of one lane follow one another by ``start``; lanes run side by side
    """

    tier: str
    code: str
    start: int = 0
    amount: float = 1.0
    speed: float = 1.0
    lane: str = ""


@dataclass(frozen=True)
class WrittenSign:
    """A written sign, or one part of a compound.

    gloss: the word
    hands: one, weak (the weak hand alone), mirrored, parallel, up_down (mirrored in height), out_in (in depth),
        point (in all three), mirrored_up_down, mirrored_out_in, up_down_out_in (in two), two (each hand as written
        for it)
    alternating: the weak hand is half a cycle late
    holdover: the weak hand stays from the part before
    posture: the first posture
    motions: in sequence
    parts: signs of a compound, in sequence; then posture and motions are empty
    tiers: nonmanual items
    notes: repairs and omissions of the reader, in words
    where: position, for errors
    """

    gloss: str
    hands: str = "one"
    alternating: bool = False
    holdover: bool = False
    posture: WrittenPosture = field(default_factory=WrittenPosture)
    motions: tuple[Motion, ...] = ()
    parts: tuple[WrittenSign, ...] = ()
    tiers: tuple[Tier, ...] = ()
    notes: tuple[str, ...] = ()
    where: Where = field(default_factory=Where)


def merge_postures(before: WrittenPosture | None, after: WrittenPosture | None) -> WrittenPosture | None:
    """Returns both postures as one, with the values of ``after`` where it has any; None if both are None."""
    if before is None or after is None:
        return before or after
    names = ("shape", "fingers", "palm", "place", "pair")
    values = {name: getattr(after, name) or getattr(before, name) for name in names}
    return WrittenPosture(**values, weak=merge_postures(before.weak, after.weak))


def with_weak(strong: WrittenPosture, weak: WrittenPosture) -> WrittenPosture:
    """Returns ``strong`` with the values of ``weak`` for its weak hand, over those that it has."""
    return replace(strong, weak=merge_postures(strong.weak, replace(weak, weak=None)))


def symmetry_kind(sides: bool, heights: bool, depths: bool) -> str:
    """The word of ``WrittenSign.hands`` for hands that mirror each other in some directions."""
    if sides and heights and depths:
        return "point"
    words = [w for w, on in (("mirrored", sides), ("up_down", heights), ("out_in", depths)) if on]
    return "_".join(words) or "parallel"


def all_motions(motions: Iterable[Motion]) -> Iterator[Motion]:
    """Yields motions and their parts, in order."""
    for motion in motions:
        yield motion
        yield from all_motions(motion.parts)


def involves_weak_hand(posture: WrittenPosture, motions: Iterable[Motion]) -> bool:
    """Whether a posture or a motion is also the weak hand's own, or brings the hands together."""
    every = [*all_motions(motions)]
    postures = [p for p in (posture, *(motion.target for motion in every)) if p is not None]
    pairs = [p.pair for p in postures if p.pair is not None]
    meets = any(pair.weak is not None or pair.strong is not None for pair in pairs)
    return meets or any(p.weak is not None for p in postures) or any(motion.kind == "split" for motion in every)


_ON_ARM = ("upperarm", "elbow", "elbowinside", "lowerarm", "wristback", "wristpulse")


def alternates(sign: WrittenSign) -> bool:
    """Whether a sign or any of its motions alternates."""
    return sign.alternating or any(motion.alternating for motion in all_motions(sign.motions))


def splits(motions: Iterable[Motion]) -> bool:
    """Whether any motion is written separately for each hand, or swaps the hands."""
    return any(m.kind in ("split", "swap") or m.repeat == "swap" for m in all_motions(motions))


def is_two_handed(sign: WrittenSign) -> bool:
    """Whether the weak hand takes part in a sign."""
    return sign.hands != "one" or sign.holdover or splits(sign.motions) or any(map(_needs_weak_arm, _postures(sign)))


def _needs_weak_arm(posture: WrittenPosture) -> bool:
    at_arm = posture.place is not None and posture.place.name in _ON_ARM
    return at_arm or posture.weak is not None or (posture.pair is not None and posture.pair.weak is not None)


def is_symmetric(sign: WrittenSign) -> bool:
    """Whether both hands mirror each other throughout the sign."""
    if sign.hands != "mirrored" or sign.holdover or splits(sign.motions):
        return False
    return all(map(_mirrors, _postures(sign)))


def _mirrors(posture: WrittenPosture) -> bool:
    """Whether both hands can mirror each other in a posture."""
    pair, place = posture.pair, posture.place
    pair_mirrors = pair is None or (pair.weak == pair.strong and (pair.place is None or pair.place.contact != "touch"))
    at_arm = place is not None and place.name in _ON_ARM and place.name != "elbowinside"
    return posture.weak is None and pair_mirrors and not at_arm


def _postures(sign: WrittenSign) -> Iterator[WrittenPosture]:
    """Yields the first posture of a sign, the targets of its motions, and the pairs that they brush."""
    yield sign.posture
    for motion in all_motions(sign.motions):
        if motion.target is not None:
            yield motion.target
        if motion.brushing_pair is not None:
            yield WrittenPosture(pair=motion.brushing_pair)
