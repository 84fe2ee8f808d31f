"""SiGML of HamNoSys (``hns_sign``) as a tree: its elements are the symbols by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from signsplice.synth.written import hamnosys, hamnosys_tokens
from signsplice.synth.written.elements import Element
from signsplice.synth.written.hamnosys_row import Token
from signsplice.synth.written.reading import Reading
from signsplice.synth.written.tiers import hns_tiers
from signsplice.synth.written.tree import WrittenSign


def sign(element: Element, reading: Reading) -> WrittenSign:
    """The tree of an ``hns_sign``. Raises ``FormatError`` for what is not understood, or notes it where the reading is
    lenient.
    """
    tiers = hns_tiers((e for e in _descendants(element) if e.tag.startswith("hnm_")), reading)
    found = list[Token]()
    for e in _descendants(element):
        if e.tag.startswith("ham") and not e.tag.startswith("hamnosys"):
            found += hamnosys_tokens.named(e.tag.removeprefix("ham"), f"<{e.tag[:60]}>", e.line, reading)
        elif not e.tag.startswith(("hnm_", "hamnosys", "hns_")):
            reading.refuse("is no symbol of HamNoSys 4", f"<{e.tag}>", e.line)
    if not found:
        raise reading.error("has no symbol of HamNoSys", f"<{element.tag}>", element.line)
    made = hamnosys.sign(found, reading)
    return replace(made, tiers=tuple(tiers))


def _descendants(element: Element) -> Iterator[Element]:
    for child in element.children:
        yield child
        yield from _descendants(child)
