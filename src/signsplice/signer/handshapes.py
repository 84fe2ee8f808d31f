"""Handshapes as the 21 angles of ``hand.ANGLES``: the shapes of American Sign Language by name (words/handshapes.txt),
others composed as in HamNoSys, and thumbs that open while fingers would go through them.

Their descriptions follow Stokoe, Casterline and Croneberg (1965, A Dictionary of American Sign Language on Linguistic
Principles), Liddell and Johnson (1989, American Sign Language: The Phonological Base), Tennant and Gluszak Brown (1998,
The American Sign Language Handshape Dictionary) and the public page "American manual alphabet" of Wikipedia. The angles
were made for this project: solved once for contact without one finger passing through another (least squares within
``hand.LIMITS``), inspected in pictures, and rounded to a degree. No signer has checked them.

A name is a capital letter of the manual alphabet or a number, with a suffix for a variant: ``-open`` (the thumb or the
contact released), ``-closed`` (closed), ``-bent`` (bent at the knuckles, or crooked), ``-claw`` (all fingers crooked
and spread), ``-flat`` (bent at the knuckles only), ``-small`` (thumb and index finger alone). Some names are words:
index, thumb, horns, hook, rest and ILY. Two names may share one shape, as H and U do: those signs differ by the
direction of the hand or by movement. All are right hands; a left hand has the same angles, mirrored.

Composed: a base, a thumb, bends, what single fingers do, the mean of two. ``finger2.across`` is a fist with a straight
index finger, ``flat.bent.out`` a hand bent at the knuckles, its thumb out, ``flat~finger2345.out`` the mean of two.
After the base, in any order: a thumb (out, across, opposed); a bend of the selected fingers; ``4:bent`` (a bend of one
finger; three digits are quarters of the bend of its joints); ``s25`` (these fingers are selected in place of the
base's), ``x3`` (leaves the group), ``o3`` (the finger that the thumb meets), ``c23`` and ``t23`` (fingers cross,
touch), ``w0.6`` (factor of all bends), ``enclosed`` (the thumb below the fingers).

Bends follow HamNoSys (SiGML of the ViSiCAST project) but take the angles of equal shapes in words/handshapes.txt,
since fists and hooks of 90, 108 and 90 degrees exceed the range of the joints.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from signsplice.body.capsules import body_capsules
from signsplice.body.collision import clearances
from signsplice.motion import FloatArray, frozen
from signsplice.motion.cache import CACHE
from signsplice.motion.curves import fade_window
from signsplice.rig.roles import FINGERS
from signsplice.signer import hand, pose
from signsplice.signer.signer import skeleton
from signsplice.signer.tables import sections


@dataclass(frozen=True)
class ThumbGaps:
    """Distances between thumbs and fingers."""

    pinch_cm: float = 1.5
    """Distance from thumb tip to fingertip of a pinch, cm."""
    cee_cm: float = 4.4
    """Distance from thumb tip to fingertip of a cee, cm."""
    largest_depth_cm: float = 0.3
    """Largest depth of a finger in the thumb, cm."""


@dataclass(frozen=True)
class FingerBends:
    """Bends of fingers of composed handshapes: degrees of MCP, PIP and DIP."""

    straight_deg: tuple[float, float, float] = (2.0, 3.0, 3.0)
    """A straight finger."""
    folded_deg: tuple[float, float, float] = (86.0, 104.0, 67.0)
    """A finger of a fist."""
    tucked_deg: tuple[float, float, float] = (44.0, 104.0, 60.0)
    """A finger that is double bent over the thumb, as in E."""
    meeting_deg: tuple[float, float, float] = (66.0, 92.0, 62.0)
    """A finger of a pinch or cee with a bend that the tables of these lack."""
    quarter_deg: tuple[float, float, float] = (22.5, 27.0, 22.5)
    """A quarter of the bend of each joint."""


_GAPS = ThumbGaps()
_BENDS = FingerBends()


@dataclass(frozen=True, eq=False)
class Handshape:
    """A configuration of the fingers.

    name: the handshape's name
    angles: the 21 angles of ``hand.ANGLES``, radians, read-only
    """

    name: str
    angles: FloatArray

    @cached_property
    def points(self) -> FloatArray:
        """Positions (20, 3) of ``hand.POINTS`` in the wrist's frame of the standard hand, cm."""
        return hand.points(self.angles)


_TABLE = sections(__file__, "handshapes")
_ANGLES = {
    name: frozen(np.deg2rad([float(word) for word in words if word != "|"])) for name, *words in _TABLE["shapes"]
}
_ANGLES |= {name: _ANGLES[shape] for name, shape in _TABLE["aliases"]}
HANDSHAPES = {name: Handshape(name, angles) for name, angles in _ANGLES.items()}
"""Every handshape by name."""


_OPENING_FRAMES = 5
"""Largest number of frames before and after a collision in which a thumb opens."""
_THUMB_OPENINGS = np.linspace(0.0, 1.0, 6)
"""Candidate openings of a thumb, tried in order; 1 is the thumb of handshape 5."""
_THUMB = slice(16, 21)
"""The thumb's angles among a hand's."""
_FINGER_BONES = [(3 * f + n, 3 * f + n + 1 if n < 2 else 15 + f) for f in (1, 2, 3, 4) for n in (0, 1, 2)]
_THUMB_BONES = [(1, 2), (2, 15)]
"""Both ends of bones among a hand's points."""
_CAPSULES = [
    [f"right{FINGERS[f]}{bone}" for f in (1, 2, 3, 4) for bone in ("Proximal", "Intermediate", "Distal")],
    ["rightThumbProximal", "rightThumbDistal"],
]


def open_thumbs(states: FloatArray, ends: bool = False) -> FloatArray:
    """Opens thumbs in states (T, 65) so that fingers lie at most 3 mm deep in them; ``ends``: the frames belong between
    two others, and the changes fade out towards both.
    """
    angles = pose.hands(states)[..., pose.FINGERS]  # (T, 2, 21)
    open_thumb = HANDSHAPES["5"].angles[_THUMB]
    collides = thumb_depth(angles) > _GAPS.largest_depth_cm
    affected = maximum_filter1d(collides, 2 * _OPENING_FRAMES + 1, axis=0, mode="constant")
    if not affected.any():
        return states
    tried = np.repeat(angles[affected][:, None], len(_THUMB_OPENINGS), axis=1)  # (N, K, 21)
    tried[..., _THUMB] += _THUMB_OPENINGS[:, None] * (open_thumb - tried[..., _THUMB])
    depth = thumb_depth(tried)
    free = depth <= _GAPS.largest_depth_cm
    chosen = np.where(free.any(axis=1), free.argmax(axis=1), depth.argmin(axis=1))
    needed, limit = np.zeros(affected.shape), np.ones(affected.shape)
    needed[affected] = _THUMB_OPENINGS[chosen]
    beyond = ~free & (np.arange(len(_THUMB_OPENINGS)) > chosen[:, None])  # a thumb below fingers cannot open
    limit[affected] = _THUMB_OPENINGS[np.where(beyond.any(axis=1), beyond.argmax(axis=1) - 1, -1)]
    level = maximum_filter1d(needed, _OPENING_FRAMES, axis=0, mode="nearest")
    level = gaussian_filter1d(level, 1.0, axis=0, mode="nearest")
    level = np.minimum(level, limit)
    if ends:
        level = level * fade_window(len(states))[:, None]
    states = states.copy()
    thumbs = pose.hands(states)[..., pose.FINGERS][..., _THUMB]
    thumbs += level[..., None] * (open_thumb - thumbs)
    return states


def thumb_depth(angles: FloatArray) -> FloatArray:
    """Depth (...) of the deepest finger in the thumb of hands with ``angles`` (..., 21), cm; negative if free."""
    points = hand.points(angles)
    body = body_capsules(skeleton())
    radii = [body.radii[[body.keys.index(key) for key in keys]] for keys in _CAPSULES]
    (p, u), (q, v) = (
        (points[..., first, :], points[..., last, :] - points[..., first, :])
        for first, last in (np.transpose(bones).tolist() for bones in (_FINGER_BONES, _THUMB_BONES))
    )
    offsets = p[..., :, None, :] - q[..., None, :, :]  # (..., 12, 2, 3)
    u, v = (np.broadcast_to(axis, offsets.shape) for axis in (u[..., :, None, :], v[..., None, :, :]))
    finger_radii, thumb_radii = (
        np.broadcast_to(r, (*offsets.shape[:-1], 2)) for r in (radii[0][:, None], radii[1][None])
    )
    return np.asarray(-clearances(offsets, u, v, finger_radii, thumb_radii).distance.min(axis=(-2, -1)))


BASES: dict[str, str] = {
    "fist": "", "flat": "2345", "finger2": "2", "finger23": "23", "finger23spread": "23", "finger2345": "2345",
    "pinch12": "2", "pinchall": "2345", "pinch12open": "2", "cee12": "2", "ceeall": "2345", "cee12open": "2",
}  # fmt: skip
"""Bases of handshapes with the fingers that they select."""
THUMBS = ("out", "across", "opposed")
_OPEN_BENDS = {
    "halfbent": (45.0, 4.0, 4.0), "bent": (86.0, 4.0, 4.0), "round": (45.0, 52.0, 36.0), "hooked": (8.0, 94.0, 60.0),
    "dblbent": (86.0, 98.0, 6.0), "dblhooked": (84.0, 102.0, 66.0),
}  # fmt: skip
"""Bend -> degrees of MCP, PIP and DIP of fingers that do not meet the thumb."""
_DOUBLE_BENDS = ("dblbent", "dblhooked")
_PINCH_BENDS = {"": (47.0, 50.0, 32.0), "bent": (81.0, 8.0, 4.0), "round": (50.0, 68.0, 60.0)}
_CEE_BENDS = {"": (34.0, 52.0, 33.0), "bent": (62.0, 7.0, 4.0), "round": (40.0, 64.0, 56.0)}
"""The same for fingers of a pinch and of a cee."""
_SPREADS = {"finger23spread": (15.0, -8.0, 0.0, 0.0), "finger2345": (15.0, 3.0, 10.0, 18.0)}
"""Base -> degrees of spread of the four fingers."""
_OPEN_SPREAD = (0.0, 0.0, 9.0, 16.0)
"""The same for bases whose other fingers are open, and for spread bases with other selected fingers."""
_CROSSED_FINGERS = {"23": ((-8.0, 13.0, 4.0, 4.0), (12.0, -8.0, 15.0, 8.0))}
"""Degrees of spread and of the joints of two fingers that cross."""
_THUMB_DEGREES: dict[str, tuple[float, float, float, float, float]] = {
    "side": (14.0, -18.0, 22.0, 20.0, 6.0), "fist": (8.0, -10.0, 31.0, 23.0, 11.0),
    "over": (4.0, 38.0, 35.0, 48.0, 54.0),
    "middle": (10.0, 26.0, 23.0, 45.0, 53.0), "ring": (26.0, 22.0, 26.0, 47.0, 44.0),
    "across": (21.0, -4.0, 38.0, 70.0, 66.0), "out": (-20.0, -12.0, 0.0, -6.0, -10.0),
    "opposed": (-8.0, 44.0, 40.0, 22.0, 16.0), "below": (34.0, -2.0, 28.0, 41.0, 18.0),
    "tucked": (8.0, 16.0, 20.0, 69.0, 61.0),
    "pinch": (10.0, 33.0, 52.0, 24.0, 26.0),
}  # fmt: skip
"""Degrees of the thumb: beside the index finger; of a fist, beside it, across its front, on the middle or the ring
finger; across the palm; out; before the palm; below folded fingers; below fingertips; at the start of the search for a
fingertip."""
_ROOM_OPENINGS = np.linspace(0.0, 1.0, 11)
"""Candidate openings of the thumb of a composed handshape."""


@dataclass(frozen=True)
class _ComposedShape:
    """The words of a composed handshape; see ``tree.WrittenShape`` and the head of this file."""

    base: str
    thumb: str = ""
    bend: str = ""
    bends: dict[int, str] = field(default_factory=dict)
    selected: str = ""
    exempt: str = ""
    opposed: int = 0
    pair: str = ""
    crossed: bool = False
    opening: float = 1.0
    enclosed: bool = False

    @property
    def meets(self) -> bool:
        """Whether the thumb goes to a finger."""
        return self.base.startswith(("pinch", "cee"))

    @property
    def tucks(self) -> bool:
        """Whether double bent fingers of an open hand lie on the thumb."""
        return self.enclosed and self.bend in _DOUBLE_BENDS and self.base in ("flat", "finger2345")


_WORD = re.compile(
    r"(?P<digit>[2-5]):(?P<single>\w+)|s(?P<selected>[1-5]+)|x(?P<exempt>[1-5]+)|o(?P<opposed>[2-5])"
    r"|(?P<kind>[ct])(?P<pair>[1-5]{2})|w(?P<opening>\d(?:\.\d+)?)"
)


def _parse_shape(text: str) -> _ComposedShape | None:
    """Parses a composed shape without ``~``; returns None for any other text."""
    base, *words = re.split(r"(?<!\.w\d)\.", text)
    if base not in BASES:
        return None
    values: dict[str, object] = {"selected": BASES[base]}
    bends: dict[int, str] = {}
    for word in words:
        match = _WORD.fullmatch(word)
        if word in THUMBS:
            values["thumb"] = word
        elif word == "enclosed":
            values["enclosed"] = True
        elif _is_bend(word):
            values["bend"] = word
        elif match is None or (match["single"] and not _is_bend(match["single"])):
            return None
        elif match["digit"]:
            bends[int(match["digit"])] = match["single"]
        elif match["kind"]:
            values |= {"pair": "".join(sorted(match["pair"])), "crossed": match["kind"] == "c"}
        elif match["opening"]:
            values["opening"] = float(match["opening"])
        elif match["opposed"]:
            values["opposed"] = int(match["opposed"])
        else:
            values |= {name: match[name] for name in ("selected", "exempt") if match[name]}
    return _ComposedShape(base, bends=bends, **values)  # type: ignore[arg-type]


def _is_bend(word: str) -> bool:
    return word in _OPEN_BENDS or re.fullmatch(r"[0-4]{3}", word) is not None


def is_handshape(text: str) -> bool:
    """Whether a text names a handshape, or composes one."""
    return text in HANDSHAPES or (text.count("~") <= 1 and all(map(_parse_shape, text.split("~"))))


def handshape(text: str) -> Handshape:
    """The handshape that a text names or composes; see ``is_handshape``."""
    return HANDSHAPES[text] if text in HANDSHAPES else CACHE.recent(_compose_handshape, text, most=1024)


def _compose_handshape(text: str) -> Handshape:
    shapes = [_parse_shape(part) for part in text.split("~")]
    angles = np.mean([_angles(shape) for shape in shapes if shape is not None], axis=0)
    return Handshape(text, frozen(_with_room(angles)))


def _angles(shape: _ComposedShape) -> FloatArray:
    """The 21 angles of ``hand.ANGLES`` of a shape, radians; the fingers are solved before the thumb."""
    degrees = np.zeros(21)
    fingers = degrees[:16].reshape(4, 4)
    for n in range(4):
        fingers[n, 1:] = np.array(_bends(shape, n + 2)) * (shape.opening if shape.meets or shape.bend else 1.0)
    spread = np.array(_SPREADS.get(shape.base, (0.0,) * 4))
    if shape.base.endswith("open") or (shape.base in _SPREADS and set(shape.selected) != set(BASES[shape.base])):
        spread = np.array(_OPEN_SPREAD)
    fingers[:, 0] = spread * (1.0 - fingers[:, 1] / 90.0)
    if shape.pair in _CROSSED_FINGERS and shape.crossed:
        for digit, row in zip(shape.pair, _CROSSED_FINGERS[shape.pair], strict=True):
            fingers[int(digit) - 2] = row
    elif len(shape.pair) == 2 and shape.pair[0] != "1":
        for digit in shape.pair:  # together, or one a little before the other
            fingers[int(digit) - 2, 0] = 0.0
        fingers[int(shape.pair[1]) - 2, 1] += 14.0 * shape.crossed
    degrees[_THUMB] = _THUMB_DEGREES[_thumb(shape)]
    angles = np.clip(np.deg2rad(degrees), *hand.LIMITS.T)
    if shape.pair.startswith("1") and len(shape.pair) == 2 and not shape.meets:
        return _to_finger(angles, int(shape.pair[1]) - 2, _GAPS.pinch_cm, at_tip=False)
    if shape.meets and shape.thumb != "out" and "1" not in shape.exempt:
        is_cee = shape.base.startswith("cee")
        gap = _GAPS.cee_cm * max(0.4, 2.0 - shape.opening) if is_cee else _GAPS.pinch_cm
        return _to_finger(angles, (shape.opposed or int(shape.selected[0])) - 2, gap)
    return angles


def _bends(shape: _ComposedShape, digit: int) -> tuple[float, ...]:
    """Degrees of MCP, PIP and DIP of a finger."""
    single_bend = shape.bends.get(digit)
    chosen = str(digit) in shape.selected and str(digit) not in shape.exempt
    bend = single_bend if single_bend is not None else shape.bend
    if bend.isdigit() and (single_bend is not None or chosen):
        return tuple(int(n) * quarter for n, quarter in zip(bend, _BENDS.quarter_deg, strict=True))
    if single_bend is not None:
        return _OPEN_BENDS[single_bend]
    if shape.base == "fist":  # those named stay bent, the others open
        folded = not shape.selected or chosen
        return _OPEN_BENDS.get(shape.bend, _BENDS.folded_deg) if folded else _BENDS.straight_deg
    if not chosen:
        straight = shape.base.endswith("open") or (shape.meets and str(digit) in shape.exempt)
        straight = straight or (shape.meets and "2" not in shape.selected)  # the thumb passes no folded index finger
        return _BENDS.straight_deg if straight else _BENDS.folded_deg
    if not shape.meets:
        return _BENDS.tucked_deg if shape.tucks else _OPEN_BENDS.get(shape.bend, _BENDS.straight_deg)
    table = _CEE_BENDS if shape.base.startswith("cee") else _PINCH_BENDS
    return table.get(shape.bend, _BENDS.meeting_deg)


def _thumb(shape: _ComposedShape) -> str:
    """Position of the thumb, a name of ``_THUMB_DEGREES``."""
    fist = shape.base in ("fist", "finger2", "finger23", "finger23spread")
    if shape.enclosed and fist:
        return "below"
    if shape.thumb == "out":
        return "out"
    if shape.meets:
        return "pinch"
    if shape.thumb == "opposed":
        return "over" if fist and not shape.bend else "opposed"
    if not fist:
        if shape.tucks:
            return "tucked"
        closed = shape.bend in _DOUBLE_BENDS and len(shape.selected) == 4
        return "side" if shape.thumb != "across" else "over" if closed else "across"
    if shape.base == "fist":
        return "over" if shape.thumb == "across" else "fist"
    return "middle" if "3" not in shape.selected else "ring" if "4" not in shape.selected else "across"


def _to_finger(angles: FloatArray, finger: int, gap_cm: float, at_tip: bool = True) -> FloatArray:
    """Angles (21,) with the thumb's tip before the tip or the middle bone of a finger (0 index), ``gap_cm`` from its
    axis, by damped Gauss-Newton within the limits.
    """
    points = hand.points(angles)
    first = 3 * (finger + 1)
    tip, joint = (points[16 + finger], points[first + 2]) if at_tip else (points[first + 2], points[first + 1])
    bone = (tip - joint) / np.linalg.norm(tip - joint)
    palmar = np.cross([0.0, 0.0, 1.0], bone)
    target = tip + gap_cm * palmar / np.linalg.norm(palmar)
    thumb, usual = angles[_THUMB].copy(), angles[_THUMB].copy()
    steps = np.vstack([np.zeros(5), 1e-3 * np.eye(5)])
    for _ in range(12):
        tried = np.repeat(angles[None], 6, axis=0)
        tried[:, _THUMB] = thumb + steps
        tips = hand.points(tried)[:, 15]
        slope, miss = (tips[1:] - tips[0]).T / 1e-3, target - tips[0]
        normal = slope.T @ slope + 0.3 * np.eye(5)
        thumb = np.clip(
            thumb + np.linalg.solve(normal, slope.T @ miss + 0.05 * (usual - thumb)), *hand.LIMITS[_THUMB].T
        )
    return np.concatenate([angles[:16], thumb])


def _with_room(angles: FloatArray) -> FloatArray:
    """Opens the thumb in angles (21,) so that fingers lie at most 3 mm deep in it."""
    ways = np.deg2rad([_THUMB_DEGREES["out"], _THUMB_DEGREES["over"], _THUMB_DEGREES["opposed"]])
    tried = np.repeat(angles[None], len(ways) * len(_ROOM_OPENINGS), axis=0)
    steps = np.tile(_ROOM_OPENINGS, len(ways))
    tried[:, _THUMB] += steps[:, None] * (np.repeat(ways, len(_ROOM_OPENINGS), axis=0) - angles[_THUMB])
    depth = thumb_depth(tried)
    return np.asarray(tried[np.lexsort((depth, steps, np.maximum(depth, _GAPS.largest_depth_cm)))[0]])
