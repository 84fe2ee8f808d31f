"""Signs as linguists write them, mutated: symbols of HamNoSys, elements and values of SiGML."""

from __future__ import annotations

import itertools
import random
import re
from pathlib import Path

from fuzz_mutators import of_text
from signsplice.synth.written import symbols
from signsplice.synth.written.files import WrittenSigns

TESTS = Path(__file__).resolve().parents[1] / "tests" / "synth"
_SYMBOLS = tuple(symbols.SYMBOLS)


def seeds() -> list[bytes]:
    """Gestural SiGML, a table of HamNoSys, and SiGML of HamNoSys with a face."""
    table = (TESTS / "hamnosys_signs.csv").read_text(encoding="utf-8")
    names = table.splitlines()[100].split(",")[2].split()
    face = '<hnm_mouthpicture picture="ro:d"/><hnm_head tag="NO"/>'
    hns = "".join(f"<ham{name}/>\n" for name in names)
    sigml = (
        f'<sigml><hns_sign gloss="A"><hamnosys_nonmanual>{face}</hamnosys_nonmanual>'
        f"<hamnosys_manual>\n{hns}</hamnosys_manual></hns_sign></sigml>"
    )
    return [(TESTS / "written_signs.sigml").read_bytes(), table.encode(), sigml.encode()]


def mutated(content: bytes, rng: random.Random) -> bytes:
    """One symbol, value, element or line changed, added, removed or moved; at times anything."""
    if rng.random() < 0.2:
        return of_text(content, rng)
    text = content.decode("utf-8", "surrogateescape")
    if text.lstrip().startswith("<"):
        return _of_xml(text, rng).encode("utf-8", "surrogateescape")
    at = rng.randrange(len(text) + 1)
    while at < len(text) and text[at] not in symbols.SYMBOLS and rng.random() < 0.98:
        at = (at + 1) % len(text)
    piece = "".join(rng.choices(_SYMBOLS, k=rng.choice((0, 1, 1, 2, 5))))
    if rng.random() < 0.1:
        start = rng.randrange(len(text) + 1)
        piece = text[start : start + rng.randrange(40)]
    return (text[:at] + piece + text[at + rng.choice((0, 1, 1, 3)) :]).encode("utf-8", "surrogateescape")


def _of_xml(text: str, rng: random.Random) -> str:
    values = list(re.finditer(r'"[^"]*"|<[^>]*>', text))
    if not values:
        return text
    one, other = rng.choice(values), rng.choice(values)
    at = rng.choice((one.end(), one.end(), one.start()))
    match rng.randrange(4):
        case 0:  # a value or an element of another place
            return text[: one.start()] + other.group() + text[one.end() :]
        case 1:
            return text[: one.start()] + text[one.end() :]
        case 2:
            return text[:at] + other.group() + text[at:]
        case _:
            start, end = sorted((one.start(), other.end()))
            return text[:at] + text[start : min(end, start + 2000)] + text[at:]


def use(read: WrittenSigns) -> None:
    """What a lexicon makes of signs that were read."""
    for error in itertools.islice(read.refused, 20):
        assert 0 < len(str(error)) < 1500
        assert len(str(error).splitlines()) == 1, str(error)
        assert "case" in str(error), str(error)
    for gloss, sign in read.signs.items():
        assert gloss == sign.gloss
        assert all(len(note.splitlines()) == 1 for note in sign.notes), sign.notes
