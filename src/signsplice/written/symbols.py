"""The symbols of HamNoSys 4 by name and code point, and what kinds of them there are (words/hamnosys.txt)."""

from __future__ import annotations

from signsplice.signer.tables import sections

_WORDS = sections(__file__, "hamnosys")
SYMBOLS = {chr(int(first, 16) + n): name for first, *row in _WORDS["symbols"] for n, name in enumerate(row)}
"""Code point -> name, that of the element of HamNoSys SiGML without its ``ham``."""
PUNCTUATION = {" ": "space", "!": "exclaim", ",": "comma", ".": "fullstop", "?": "query"}
"""Marks that say nothing of a sign's form -> their names."""
ALTERNATIVES = {"{": "altbegin", "|": "metaalt", "}": "altend"}
MARKS = {**PUNCTUATION, **ALTERNATIVES}
NAMES = frozenset(SYMBOLS.values())
KINDS = {kind: {pair.partition("=")[0]: pair.rpartition("=")[2] for pair in row} for kind, *row in _WORDS["kinds"]}
"""Kind -> symbol -> what it is in the tree; for a bracket what closes it, for an alias the symbol that is meant."""
SHAPES, THUMBS, BENDS, FINGER_PARTS, HAND_PARTS = (KINDS[kind] for kind in ("shape", "thumb", "bend", "part", "hand"))
PLACES, SIDES, CONTACTS, REPEATS, BRACKETS = (KINDS[kind] for kind in ("place", "side", "contact", "repeat", "bracket"))
DIGITS = {name: int(digit) for name, digit in KINDS["digit"].items()}
