"""Elements, attributes and values of gestural SiGML, and how they are checked."""

from __future__ import annotations

import re

from signsplice.signer.tables import sections
from signsplice.written.elements import Element
from signsplice.written.reading import Reading

_WORDS = sections(__file__, "sigml")
_VALUES = {key: tuple(values) for key, *values in _WORDS["values"]}
((_, *MANNER), (_, *_OTHER)) = _WORDS["motions"]
_SILENT = frozenset(_WORDS["silent"][0][1:])
KNOWN = {
    tag: frozenset([*own, *MANNER, *_OTHER] if "motion" in tag or tag in ("fingerplay", "changeposture") else own)
    for tag, *own in _WORDS["attributes"]
}
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
        for key in sorted(e.attributes.keys() - KNOWN.get(e.tag, frozenset())):
            if key in _SILENT:
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

    def choice(self, e: Element, key: str) -> str:
        """One of the words that an attribute may have, or "" where it is absent."""
        plain = re.sub("^second_", "", key)
        options = _VALUES.get(f"{e.tag}.{plain}") or _VALUES.get(plain, ("true", "false"))
        value = e.attributes.get(key, "")
        return value if value in ("", *options) else self.unknown(e, key, f"one of {' '.join(options)}")

    def flag(self, e: Element, key: str) -> bool:
        """Whether an attribute is true."""
        return self.choice(e, key) == "true"

    def bend(self, e: Element, key: str) -> str:
        """A bend by name, or three digits of quarters."""
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
