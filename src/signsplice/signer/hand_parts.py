"""Parts of the hand that touch or are touched: names of words/places.txt, and parts of fingers that are composed.

``2.tip`` is the tip of the index finger (1 thumb to 5 little finger), ``23.mid.radial`` the thumb's side of the middle
joints of index and middle finger, ``palm/heel`` the middle between two parts. Sides: palmar, dorsal, radial, ulnar.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.motion.cache import CACHE
from signsplice.signer import hand
from signsplice.signer.tables import sections, vector

_INDEX = {"Wrist": -1} | {name: n for n, name in enumerate(hand.POINTS)}
_DIGITS = dict(zip("12345", hand.FINGERS, strict=True))
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
"""Points of a finger whose mean a part of it is, its thickness over that at the tip, and its usual side."""
_WRIST = {
    "palmar": (2.8, (0.0, -1.0, 0.0)),
    "dorsal": (2.8, (0.0, 1.0, 0.0)),
    "radial": (2.8, (0.0, 0.0, 1.0)),
    "ulnar": (2.8, (0.0, 0.0, -1.0)),
}
"""Distance of the wrist's skin from its joint, cm, and direction, of each side."""
_SIDES = ("palmar", "dorsal", "radial", "ulnar")
_COMPOSED = re.compile(
    rf"(?:wrist\.({'|'.join(_SIDES)})|([1-5]{{1,4}})\.({'|'.join(_SEGMENTS)})(?:\.({'|'.join(_SIDES)}))?)"
)


@dataclass(frozen=True)
class HandPart:
    """A part of a hand.

    names: joints and tips whose mean position it is
    skin: distance of the skin from there, cm
    out: direction out of the hand there, in the hand's axes; None for one that goes with the finger
    side: ``end`` or one of the sides, for a part whose direction goes with the finger
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
        across = np.array([0.0, 0.8, 0.6]) if thumb else np.array([0.0, 0.0, 1.0])  # the radial side
        across = across - (across @ bone) * bone
        across /= np.linalg.norm(across)
        dorsal = np.cross(bone, across)
        return np.asarray(
            {"end": bone, "dorsal": dorsal, "palmar": -dorsal, "radial": across, "ulnar": -across}[self.side]
        )


PARTS_OF_HAND = {
    name: HandPart(tuple(names.split(",")), float(skin), vector(out))
    for name, names, skin, out in sections(__file__, "places")["parts"]
}
"""The named parts."""


def is_part(text: str) -> bool:
    """Whether a text names a part of the hand, or composes one."""
    return all(name in PARTS_OF_HAND or _COMPOSED.fullmatch(name) is not None for name in text.split("/"))


def hand_part(text: str) -> HandPart:
    """The part of the hand that a text names or composes; see ``is_part``."""
    return PARTS_OF_HAND[text] if text in PARTS_OF_HAND else CACHE.recent(_composed, text, most=512)


def _composed(text: str) -> HandPart:
    if "/" in text:
        one, other = (hand_part(name) for name in text.split("/", 1))
        return HandPart(one.names * len(other.names) + other.names * len(one.names), 0.5 * (one.skin + other.skin),
                    one.out or other.out or (-1.0, 0.0, 0.0))  # fmt: skip
    match = _COMPOSED.fullmatch(text)
    assert match is not None
    wrist, digits, segment, side = match.groups()
    if wrist:
        return HandPart(("Wrist",), *_WRIST[wrist])
    ends, thick, usual = _SEGMENTS[segment]
    fingers = [_DIGITS[digit] for digit in digits]
    names = tuple(f + end for f in fingers for end in ends)
    return HandPart(names, thick * sum(_SKIN[f] for f in fingers) / len(fingers), None, side or usual)
