"""Signs as linguists write them, mutated: symbols of HamNoSys, elements and values of SiGML."""

from __future__ import annotations

import itertools
import random
import re
from pathlib import Path

import numpy as np

from fuzz_mutators import of_text
from signsplice.errors import InputError
from signsplice.written import signing, symbols
from signsplice.written.compiler import compile_sign
from signsplice.written.files import WrittenSigns

TESTS = Path(__file__).resolve().parents[2] / "tests" / "synth"
MOST_SECONDS, MOST_STEP_DEG = 60.0, 90.0
"""What no sign exceeds: its length, and how far a joint turns in a frame of 30 a second."""
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
    """What a lexicon makes of signs that were read: some are compiled, and one is signed."""
    for error in itertools.islice(read.refused, 20):
        _check(error, "case")
    for gloss, sign in read.signs.items():
        assert gloss == sign.gloss
        assert all(len(note.splitlines()) == 1 for note in sign.notes), sign.notes
    made = None
    for sign in random.Random(len(read.signs)).sample(list(read.signs.values()), min(len(read.signs), 12)):
        try:
            compile_sign(sign)
            made = sign
        except InputError as error:
            _check(error, sign.gloss)
    if made is None:
        return
    clip = signing.animate_sign(made)
    assert np.isfinite(clip.local_rotations).all()
    assert np.isfinite(clip.root_positions).all()
    assert clip.seconds < MOST_SECONDS, f"{made.gloss}: {clip.seconds:.0f} s"
    dots = np.abs((clip.local_rotations[1:] * clip.local_rotations[:-1]).sum(axis=-1))
    step_deg = np.rad2deg(2.0 * np.arccos(np.minimum(dots, 1.0))).max()
    assert step_deg < MOST_STEP_DEG, f"{made.gloss}: a joint turns by {step_deg:.0f} degrees in a frame"


def _check(error: InputError, name: str) -> None:
    text = str(error)
    assert 0 < len(text) < 1500
    assert len(text.splitlines()) == 1, text
    assert name in text, text
