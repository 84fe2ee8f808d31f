"""Elements, attributes and values of gestural SiGML, and how they are checked."""

from __future__ import annotations

import re
from collections.abc import Iterable

from signsplice.synth.written.elements import Element
from signsplice.synth.written.reading import Reading

BASES = (
    "fist", "flat", "finger2", "finger23", "finger23spread", "finger2345", "pinch12", "pinchall", "pinch12open",
    "cee12", "ceeall", "cee12open",
)  # fmt: skip
BENDS = ("bent", "round", "hooked", "dblbent", "dblhooked", "halfbent")
PLACES = (
    "head", "headtop", "forehead", "eyebrows", "eyes", "nose", "nostrils", "ear", "earlobe", "cheek", "lips", "tongue",
    "teeth", "chin", "underchin", "neck", "shouldertop", "shoulders", "chest", "stomach", "belowstomach", "neutral",
    "upperarm", "elbow", "elbowinside", "lowerarm", "wristback", "wristpulse",
)  # fmt: skip
SITES = (
    "tip", "nail", "pad", "midjoint", "base", "side", "thumbside", "pinkyside", "palm", "handback", "thumbball",
    "wristback", "wristpulse", "lowerarm", "elbow", "elbowinside", "upperarm",
)  # fmt: skip
CONTACTS = ("touch", "close", "armextended", "interlock", "cross", "brushing")
ELLIPSES = {"h": "l", "v": "u", "ur": "ur", "ul": "ul"}
"""Direction of an ellipse's long axis -> letters."""
OPENINGS = {"slack": 0.6, "tight": 1.4}
SIDES = ("right_at", "right_beside", "left_at", "left_beside")
MANNER = ("fast", "slow", "tense", "rest", "halt", "bouncing")
REPEATS = (
    "fromstart", "fromstart_several", "manyrandom", "continue", "continue_several", "reverse", "tofroto", "swap",
)  # fmt: skip
WRISTS = ("nodding", "swinging", "twisting", "stircw", "stirccw")
SILENT = (
    "abs_palmor", "rel_palmor", "approx_location", "thumbcontact", "successivefingers", "contactkind",
    "second_repetition", "realspace", "repetition_incrdecr", "baseshift_size", "second_curve", "ellipse_direction",
)  # fmt: skip
"""Attributes that no source gives a form to."""
_OF_MOTION = "alternating speed brushing incrdecr " + " ".join(MANNER)
KNOWN = {
    tag: frozenset(f"{words} {common}".split())
    for tags, common in (
        ({
            "sign_manual": "both_hands lr_symm ud_symm oi_symm outofphase nondominant holdover",
            "handconfig": "handshape thumbpos mainbend ceeopening second_handshape second_thumbpos second_mainbend "
            "second_ceeopening bend1 bend2 bend3 bend4 bend5 specialfingers exempteddigits opposedfinger contactpair "
            "thumbenclosed extfidir second_extfidir palmor second_palmor",
            "location_bodyarm": "location side second_location second_side contact behind",
            "location_hand": "location side digits second_location second_side second_digits contact",
            "handconstellation": "contact",
        }, ""),
        ({
            "directedmotion": "direction second_direction size second_size curve curve_size "
            "zigzag_style zigzag_size",
            "circularmotion": "axis second_axis size second_size start end clockplus second_clockplus "
            "ellipse_direction ellipse_size zigzag_style zigzag_size",
            "wristmotion": "motion size", "fingerplay": "digits size", "crossmotion": "cross",
            "tgt_motion": "", "par_motion": "", "seq_motion": "fused", "split_motion": "", "nomotion": "",
            "no_motion": "", "changeposture": "",
            "rpt_motion": "repetition repetition_baseshift",
        }, _OF_MOTION),
    )
    for tag, words in tags.items()
}  # fmt: skip
"""Element -> the attributes that are read."""
POSTURES = (
    "handconfig", "split_handconfig", "location_bodyarm", "location_hand", "split_location", "handconstellation",
)  # fmt: skip


class Values:
    """Reads the attributes of one sign's elements.

    reading: of the sign
    """

    def __init__(self, reading: Reading) -> None:
        self.reading = reading

    def check(self, e: Element) -> None:
        """Refuse attributes that are not read; note those that have no form."""
        for key in e.attributes.keys() - KNOWN.get(e.tag, frozenset()):
            if key in SILENT:
                self.reading.note(f"{key} of <{e.tag}> is left out", e.line)
            else:
                self.refuse(e, f"attribute {key[:40]} is not known")

    def refuse(self, e: Element, what: str) -> None:
        """Refuse an element, or note that it is left out."""
        self.reading.refuse(what, f"<{e.tag}>", e.line)

    def unknown(self, e: Element, key: str, expected: str) -> str:
        """Refuse a value; "" where that is left out."""
        self.refuse(e, f"{key}={e.attributes[key][:40]!r}, expected {expected}")
        return ""

    def choice(self, e: Element, key: str, options: Iterable[str]) -> str:
        """One of some words, or "" where the attribute is absent."""
        value = e.attributes.get(key, "")
        return value if value in ("", *options) else self.unknown(e, key, f"one of {' '.join(options)}")

    def flag(self, e: Element, key: str) -> bool:
        """Whether an attribute is true."""
        return self.choice(e, key, ("true", "false")) == "true"

    def number(self, e: Element, key: str) -> float:
        """A factor from 0.1 to 10, 1 where it is absent."""
        return factor(e, key, self.reading)

    def bend(self, e: Element, key: str) -> str:
        """A bend by name, or three digits of quarters."""
        value = e.attributes.get(key, "")
        if value in ("", *BENDS) or re.fullmatch("[0-4]{3}", value):
            return value
        numbers = re.findall(r"[01]\.\d+?(?=[01]\.|$)", value.replace(" ", ""))
        if len(numbers) == 3 and all(float(n) <= 1.0 for n in numbers):
            mended = "".join(str(round(4.0 * float(n))) for n in numbers)
            self.reading.note(f"{key}={value!r} is read as three numbers, {mended} quarters", e.line)
            return mended
        return self.unknown(e, key, f"one of {' '.join(BENDS)} or three digits from 0 to 4")

    def digits(self, e: Element, key: str) -> tuple[int, ...]:
        """Fingers from 1 to 5."""
        value = e.attributes.get(key, "")
        if not re.fullmatch("[1-5]{0,5}", value):
            value = self.unknown(e, key, "digits from 1 to 5")
        return tuple(map(int, value))

    def letters(self, e: Element, key: str) -> str:
        """Letters of a direction, "" where it is absent or its letters cancel."""
        value = e.attributes.get(key, "")
        if not re.fullmatch("[udlroi]{0,6}", value):
            return self.unknown(e, key, "letters of u d l r o i")
        kept = value
        for pair in ("ud", "lr", "oi"):
            if all(letter in kept for letter in pair):
                kept = "".join(letter for letter in kept if letter not in pair)
                self.reading.note(f"{key}={value}: {pair[0]} and {pair[1]} cancel", e.line)
        return kept

    def words(self, e: Element, key: str, needed: bool = False) -> tuple[str, ...]:
        """One direction, or two of which the mean is meant."""
        found = tuple(filter(None, (self.letters(e, key), self.letters(e, f"second_{key}"))))
        if needed and not found:
            raise self.reading.error(f"has no {key}, expected letters of u d l r o i", f"<{e.tag}>", e.line)
        return found


def factor(e: Element, key: str, reading: Reading) -> float:
    """A factor from 0.1 to 10, 1 where the attribute is absent."""
    text = e.attributes.get(key, "1")
    if re.fullmatch(r"\d{0,3}\.?\d{1,4}", text) and 0.1 <= float(text) <= 10.0:
        return float(text)
    reading.refuse(f"{key}={text[:40]!r}, expected a number from 0.1 to 10", f"<{e.tag}>", e.line)
    return 1.0
