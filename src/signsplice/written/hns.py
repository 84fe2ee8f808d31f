"""SiGML of HamNoSys (``hns_sign``) as a tree: its elements are the symbols by name."""

from __future__ import annotations

from dataclasses import replace

from signsplice.written import hamnosys, hamnosys_tokens
from signsplice.written.elements import Element, below
from signsplice.written.hamnosys_row import Token
from signsplice.written.reading import Reading
from signsplice.written.tiers import hns_tiers
from signsplice.written.tree import WrittenSign


def sign(element: Element, reading: Reading) -> WrittenSign:
    """The tree of an ``hns_sign``. Raises ``FormatError`` for what is not understood, or notes it where the reading is
    lenient.
    """
    tiers = hns_tiers((e for e in below(element) if e.tag.startswith("hnm_")), reading)
    found = list[Token]()
    for e in below(element):
        if e.tag.startswith("ham") and not e.tag.startswith("hamnosys"):
            found += hamnosys_tokens.named(e.tag.removeprefix("ham"), f"<{e.tag[:60]}>", e.line, reading)
        elif e.children and not e.tag.startswith(("hnm_", "hamnosys", "hns_")):
            reading.note(f"<{e.tag[:60]}> is left out, what is in it is read", e.line)
        elif not e.tag.startswith(("hnm_", "hamnosys", "hns_")):
            reading.refuse("is no symbol of HamNoSys 4", f"<{e.tag}>", e.line)
    written = "".join(e.text for e in (element, *element.named("hamnosys_manual"))).strip()
    if not found and (written := written or element.attributes.get("hamnosys", "")):
        found = hamnosys_tokens.tokens(written, reading)
    if not found:
        raise reading.error("has no symbol of HamNoSys", f"<{element.tag}>", element.line)
    made = hamnosys.sign(found, reading)
    return replace(made, tiers=(*made.tiers, *tiers))
