"""Gestural SiGML (``hamgestural_sign``) as a tree: elements and values of the DTD of the University of East Anglia.

docs/hamnosys.md lists the decisions that the sources leave open.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from signsplice.signer.tables import sections
from signsplice.written.nonmanual import gestural_tiers
from signsplice.written.reading import Element, Reading, factor
from signsplice.written.tree import (
    Motion,
    Pair,
    Place,
    Site,
    WrittenManner,
    WrittenPosture,
    WrittenShape,
    WrittenSign,
    involves_weak_hand,
    merge_postures,
    symmetry_kind,
    with_weak,
)

_WORDS = sections(__file__, "sigml")
_VALUES = {key: tuple(values) for key, *values in _WORDS["values"]}
((_, *MANNER), (_, *_OTHER)) = _WORDS["motions"]
_SILENT = frozenset(_WORDS["silent"][0][1:])
KNOWN = {
    tag: frozenset([*names, *MANNER, *_OTHER] if "motion" in tag or tag in ("fingerplay", "changeposture") else names)
    for tag, *names in _WORDS["attributes"]
}
"""Element -> its known attributes."""
POSTURES = (
    "handconfig", "split_handconfig", "location_bodyarm", "location_hand", "split_location", "handconstellation",
)  # fmt: skip


_ELLIPSES = {"h": "l", "v": "u", "ur": "ur", "ul": "ul"}
"""Direction of an ellipse's long axis -> letters."""
_OPENINGS = {"slack": 0.6, "tight": 1.4}
"""Value of ``ceeopening`` -> ``WrittenShape.opening``."""
_GROWTH = {"increasing": "big", "decreasing": "small"}
"""Value of ``incrdecr`` -> size at the end."""


def sign(element: Element, reading: Reading) -> WrittenSign:
    """Parses a ``hamgestural_sign``. Raises ``FormatError`` on unknown content, or notes it if reading is lenient."""
    manual = [child for child in element.children if child.tag == "sign_manual"]
    for child in element.children:
        if child.tag not in ("sign_manual", "sign_nonmanual"):
            reading.refuse("is no part of a sign that is known", f"<{child.tag}>", child.line)
    if len(manual) != 1:
        raise reading.error(f"has {len(manual)} sign_manual, expected one", f"<{element.tag}>", element.line)
    tiers = tuple(
        item for child in element.children if child.tag == "sign_nonmanual" for item in gestural_tiers(child, reading)
    )
    parsed = _Gestural(reading).manual(manual[0])
    return replace(parsed, tiers=tiers, notes=tuple(reading.notes))


class _Gestural:
    """Parses one sign.

    reading: collects errors and notes of the sign
    """

    def __init__(self, reading: Reading) -> None:
        self.reading = reading

    def manual(self, e: Element) -> WrittenSign:
        """Parses a sign, or a part of a compound."""
        self.check(e)
        where = self.reading.where("<sign_manual>", e.line)
        parts = [child for child in e.children if child.tag == "sign_manual"]
        if parts:
            for child in e.children:
                if child.tag != "sign_manual":
                    self.refuse(child, "stands beside the parts of a compound")
            inherited = {key: value for key, value in e.attributes.items() if value == "true"}
            inner = [replace(part, attributes={**inherited, **part.attributes}) for part in parts]
            return WrittenSign(self.reading.gloss, parts=tuple(map(self.manual, inner)), where=where)
        posture, motions = WrittenPosture(), list[Motion]()
        for child in e.children:
            if child.tag not in POSTURES:
                motions.append(self.motion(child))
            elif motions:
                self.reading.note(f"<{child.tag}> after the first motion is left out", child.line)
            else:
                posture = merge_postures(posture, self.posture(child)) or posture
        if not e.children:
            raise self.reading.error("is empty, expected hand configurations", "<sign_manual>", e.line)
        return WrittenSign(
            self.reading.gloss, self.hands(e, posture, motions), self.flag(e, "outofphase"),
            self.flag(e, "holdover"), posture, tuple(motions), where=where,
        )  # fmt: skip

    def hands(self, e: Element, posture: WrittenPosture, motions: list[Motion]) -> str:
        """Returns how the hands of a part work together, a word of ``WrittenSign.hands``."""
        both, *flips = (self.flag(e, key) for key in ("both_hands", "lr_symm", "ud_symm", "oi_symm"))
        if self.flag(e, "nondominant"):
            return "weak"
        if not both and not any(flips):
            return "two" if involves_weak_hand(posture, motions) else "one"
        return symmetry_kind(*flips)

    # --- postures

    def posture(self, e: Element, weak: bool = False) -> WrittenPosture:
        """Parses one element of a posture; ``weak``: it is the weak hand's half of a split."""
        self.check(e)
        if e.tag == "handconfig":
            fingers, palm = self.words(e, "extfidir"), self.words(e, "palmor")
            return WrittenPosture(self.shape(e), fingers or None, palm or None)
        if e.tag == "location_bodyarm":
            return WrittenPosture(place=self.place(e))
        if e.tag == "location_hand":
            strong_sites = [self.site(child, not weak) for child in e.children if child.tag == "location_hand"]
            sites = self.site(e, weak), strong_sites[0] if strong_sites else None
            weak_site, strong_site = sites[::-1] if weak else sites
            pair = Pair(weak_site, strong_site, self.choice(e, "contact"))
            return WrittenPosture(pair=pair)
        if e.tag == "handconstellation":
            return self.constellation(e)
        if e.tag not in ("split_handconfig", "split_location"):
            self.refuse(e, "is no part of a posture that is known")
            return WrittenPosture()
        if len(e.children) != 2:
            self.reading.note(f"<{e.tag}> has {len(e.children)} children, expected 2", e.line)
        halves = [self.posture(child, weak=n == 1) for n, child in enumerate(e.children[:2])]
        return with_weak(halves[0], halves[1]) if len(halves) == 2 else halves[0] if halves else WrittenPosture()

    def constellation(self, e: Element) -> WrittenPosture:
        """Parses a hand constellation: first the site on the weak hand, then the site on the strong hand."""
        sites, place = list[Site | None](), None
        for child in e.children:
            if child.tag == "location_hand":
                sites.append(self.site(child, weak=not sites))
            elif child.tag == "location_bodyarm":
                place = self.place(child)
            else:
                self.refuse(child, "is no part of a hand constellation")
        if len(sites) > 2:
            self.refuse(e, f"has {len(sites)} sites, expected two at most")
        weak, strong = [*sites, None, None][:2]
        return WrittenPosture(pair=Pair(weak, strong, self.choice(e, "contact"), place))

    def shape(self, e: Element) -> WrittenShape | None:
        """Parses the handshape of a ``handconfig``; None if it has no handshape."""
        base = self.choice(e, "handshape")
        if not base:
            modifiers = (k for k in e.attributes if k in KNOWN[e.tag] and "extfidir" not in k and "palmor" not in k)
            if key := next(modifiers, ""):
                self.refuse(e, f"{key} without a handshape")
            return None
        between = self.choice(e, "second_handshape")
        second = WrittenShape(
            between, self.choice(e, "second_thumbpos"), self.bend(e, "second_mainbend"),
            opening=_OPENINGS.get(self.choice(e, "second_ceeopening"), 1.0),
        )  # fmt: skip
        pair = self.digits(e, "contactpair")
        bends = tuple((n, bend) for n in range(1, 6) if (bend := self.bend(e, f"bend{n}")))
        return WrittenShape(
            base, self.choice(e, "thumbpos"), self.bend(e, "mainbend"), bends,
            self.digits(e, "specialfingers"), self.digits(e, "exempteddigits"),
            (self.digits(e, "opposedfinger") or (0,))[0], pair, bool(pair) and 1 not in pair,
            _OPENINGS.get(self.choice(e, "ceeopening"), 1.0), self.flag(e, "thumbenclosed"),
            second if between else None,
        )  # fmt: skip

    def place(self, e: Element) -> Place:
        """Parses a place on the body."""
        self.check(e)
        hand_sites = [self.site(child, weak=False) for child in e.children if child.tag == "location_hand"]
        for child in e.children:
            if child.tag != "location_hand":
                self.refuse(child, "is no part of a place")
        side = self.choice(e, "side")
        if side and "_" not in side:
            self.reading.note(f"side={side} of <location_bodyarm> is left out", e.line)
            side = ""
        second_place = Place(self.choice(e, "second_location"), self.choice(e, "second_side"))
        name, behind = self.choice(e, "location"), self.flag(e, "behind")
        contact, between = self.choice(e, "contact"), second_place if second_place.name else None
        return Place(name, side, contact, behind, between, hand_sites[0] if hand_sites else None)

    def site(self, e: Element, weak: bool) -> Site | None:
        """Parses a part of a hand; None if the element names no part."""
        self.check(e)
        part, digits = self.choice(e, "location"), self.digits(e, "digits")
        if not part and digits:
            self.reading.note("<location_hand> without a location is read as the finger's midjoint", e.line)
        second_part, second_digits = self.choice(e, "second_location"), self.digits(e, "second_digits")
        second = None
        if second_part or second_digits:
            second = Site(second_part or part or "midjoint", second_digits or digits, self.side(e, "second_side", weak))
        return Site(part or "midjoint", digits, self.side(e, "side", weak), second) if part or digits else None

    def side(self, e: Element, key: str, weak: bool) -> str:
        """Parses a side of a finger. Left and right are as seen on the finger's own hand, fingers up and palm away from
        the signer. This holds for mirrored signs too, in which the strong hand meets the outer side of the weak index.
        """
        side = self.choice(e, key)
        if "_" in side:
            return "radial" if side.startswith("left") != weak else "ulnar"
        return "dorsal" if side == "back" else side

    # --- motions

    def motion(self, e: Element) -> Motion:
        """Parses one action."""
        if e.tag not in KNOWN or e.tag == "sign_manual" or e.tag in POSTURES:
            self.refuse(e, "is no element that is known")
            return Motion("hold", where=self.reading.where(f"<{e.tag}>", e.line))
        self.check(e)
        makers = {"tgt_motion": self.parse_target_motion, "rpt_motion": self.parse_repetition}
        motion = makers[e.tag](e) if e.tag in makers else self.simple(e)
        manner_word = self.choice(e, "manner")
        flags = {key: True for key in MANNER if self.flag(e, key) or manner_word == key}
        manner = replace(motion.manner, speed=motion.manner.speed * factor(e, "speed", self.reading), **flags)
        alternating = motion.alternating or self.flag(e, "alternating")
        return replace(motion, manner=manner, alternating=alternating, where=self.reading.where(f"<{e.tag}>", e.line))

    def simple(self, e: Element) -> Motion:
        """Parses a motion other than a targeted motion or a repetition."""
        tag = e.tag
        if tag in ("par_motion", "seq_motion", "split_motion"):
            kind = {"par_motion": "parallel", "split_motion": "split"}.get(tag, "sequence")
            parts = tuple(map(self.motion, e.children))
            if len(parts) != 2 if kind == "split" else not parts:
                raise self.reading.error(f"has {len(parts)} motions, expected 2", f"<{tag}>", e.line)
            fused = self.flag(e, "fused")
            return Motion("fusion" if fused else kind, parts=parts, manner=WrittenManner(fused=fused))
        size, brushing = self.choice(e, "size"), self.brushing(e)
        common: dict[str, Any] = {
            "size": size,
            "size_end": _GROWTH.get(self.choice(e, "incrdecr")) or self.choice(e, "second_size"),
            "zigzag": self.choice(e, "zigzag_style"),
            "zigzag_size": self.choice(e, "zigzag_size"),
            "brushing": brushing.place,
            "brushing_pair": brushing.pair,
        }
        if tag == "directedmotion":
            return Motion(
                "straight", self.words(e, "direction", needed=True), curve=self.letters(e, "curve"),
                curve_size=self.choice(e, "curve_size"), **common,
            )  # fmt: skip
        if tag == "circularmotion":
            start, end = self.letters(e, "start"), self.letters(e, "end")
            extra = sum(self.flag(e, key) for key in ("clockplus", "second_clockplus"))
            return Motion(
                "circle", self.words(e, "axis", needed=True), turns=float(extra + (not end)), start=start, end=end,
                ellipse=_ELLIPSES.get(self.choice(e, "ellipse_direction"), ""),
                ellipse_size=self.choice(e, "ellipse_size"), **common,
            )  # fmt: skip
        if tag == "wristmotion":
            kind = self.choice(e, "motion")
            if not kind:
                self.refuse(e, "has no motion, expected one such as nodding")
            return Motion(kind or "hold", size=size)
        kinds = {"fingerplay": "fingerplay", "crossmotion": "crossing", "changeposture": "posture"}
        if tag == "no_motion":
            self.reading.note("<no_motion> is read as <nomotion>", e.line)
        return Motion(kinds.get(tag, "hold"), size=size, digits=self.digits(e, "digits"))

    def brushing(self, e: Element) -> WrittenPosture:
        """Parses the place within a motion's element that the hand brushes along."""
        place = Place("", contact="brushing")
        posture = WrittenPosture(place=place) if self.flag(e, "brushing") else None
        for child in e.children:
            if child.tag in ("location_bodyarm", "location_hand"):
                posture = merge_postures(posture, self.posture(child))
            else:
                self.refuse(child, f"is no part of <{e.tag}>")
        return posture or WrittenPosture()

    def parse_target_motion(self, e: Element) -> Motion:
        """Parses a motion that ends in a posture."""
        inner, posture = list[Motion](), WrittenPosture()
        for child in e.children:
            if child.tag in POSTURES:
                posture = merge_postures(posture, self.posture(child)) or posture
            else:
                inner.append(self.motion(child))
        if len(inner) > 1:
            self.refuse(e, f"has {len(inner)} motions, expected one")
        motion = inner[0] if inner else Motion("posture")
        return replace(motion, target=merge_postures(motion.target, posture))

    def parse_repetition(self, e: Element) -> Motion:
        """Parses a repeated motion."""
        parts = tuple(map(self.motion, e.children))
        if not parts:
            raise self.reading.error("repeats no motion", "<rpt_motion>", e.line)
        as_sequence = len(parts) > 1 or parts[0].repeat
        motion = Motion("sequence", parts=parts) if as_sequence else parts[0]
        repeat, shift = self.choice(e, "repetition"), self.letters(e, "repetition_baseshift")
        return replace(motion, repeat=repeat or "fromstart", shift=shift)

    # --- attributes

    def check(self, e: Element) -> None:
        """Refuse unknown attributes, and note attributes that do not affect the motion."""
        for key in sorted(e.attributes.keys() - KNOWN.get(e.tag, frozenset())):
            if key in _SILENT:
                self.reading.note(f"{key} of <{e.tag}> is left out", e.line)
            else:
                self.refuse(e, f"attribute {key[:40]} is not known")

    def refuse(self, e: Element, what: str) -> None:
        """Refuse an element, or note that it is left out."""
        self.reading.refuse(what, f"<{e.tag}>", e.line)

    def unknown(self, e: Element, key: str, expected: str) -> str:
        """Refuse a value, or return "" if the reading is lenient."""
        self.refuse(e, f"{key}={e.attributes[key][:40]!r}, expected {expected}")
        return ""

    def choice(self, e: Element, key: str) -> str:
        """Returns the attribute if it is an allowed word, "" if it is absent."""
        plain = re.sub("^second_", "", key)
        options = _VALUES.get(f"{e.tag}.{plain}") or _VALUES.get(plain, ("true", "false"))
        value = e.attributes.get(key, "")
        return value if value in ("", *options) else self.unknown(e, key, f"one of {' '.join(options)}")

    def flag(self, e: Element, key: str) -> bool:
        """Whether an attribute is true."""
        return self.choice(e, key) == "true"

    def bend(self, e: Element, key: str) -> str:
        """Parses a bend: a name, or three digits (quarters of full bend)."""
        value = e.attributes.get(key, "")
        if value in ("", *_VALUES["mainbend"]) or re.fullmatch("[0-4]{3}", value):
            return value
        numbers = re.findall(r"[01]\.\d+?(?=[01]\.|$)", value.replace(" ", ""))
        if len(numbers) == 3 and all(float(n) <= 1.0 for n in numbers):
            mended = "".join(str(round(4.0 * float(n))) for n in numbers)
            self.reading.note(f"{key}={value!r} is read as three numbers, {mended} quarters", e.line)
            return mended
        return self.unknown(e, key, f"one of {' '.join(_VALUES['mainbend'])} or three digits from 0 to 4")

    def digits(self, e: Element, key: str) -> tuple[int, ...]:
        """Parses finger digits from 1 to 5."""
        value = e.attributes.get(key, "")
        if not re.fullmatch("[1-5]{0,5}", value):
            value = self.unknown(e, key, "digits from 1 to 5")
        return tuple(map(int, value))

    def letters(self, e: Element, key: str) -> str:
        """Parses the letters of a direction; "" if absent or if its letters cancel."""
        value = e.attributes.get(key, "")
        if not re.fullmatch("[udlroi]{0,6}", value):
            return self.unknown(e, key, "letters of u d l r o i")
        remaining = value
        for pair in ("ud", "lr", "oi"):
            if all(letter in remaining for letter in pair):
                remaining = "".join(letter for letter in remaining if letter not in pair)
                self.reading.note(f"{key}={value}: {pair[0]} and {pair[1]} cancel", e.line)
        return remaining

    def words(self, e: Element, key: str, needed: bool = False) -> tuple[str, ...]:
        """Parses one direction, or two whose mean is meant."""
        words = tuple(filter(None, (self.letters(e, key), self.letters(e, f"second_{key}"))))
        if needed and not words:
            raise self.reading.error(f"has no {key}, expected letters of u d l r o i", f"<{e.tag}>", e.line)
        return words
