"""Mutates signs as linguists write them: symbols of HamNoSys, elements and values of SiGML."""

from __future__ import annotations

import itertools
import random
import re
from pathlib import Path

import numpy as np

from fuzz_mutators import mutate_text
from signsplice.errors import InputError
from signsplice.signer.signer import JOINTS
from signsplice.written import signing, symbols
from signsplice.written.compiler import compile_sign
from signsplice.written.files import WrittenSigns

TESTS = Path(__file__).resolve().parents[2] / "tests" / "synth"
MAX_SECONDS, MAX_STEP_DEG = 60.0, 90.0
"""Limits of every sign: its length, s, and the turn of a joint in a frame at 30 fps, degrees, that no note tells of."""
_SYMBOLS = tuple(symbols.SYMBOLS)
_ARMS = [JOINTS[side + part] for side in ("Left", "Right") for part in ("Arm", "ForeArm", "Hand")]


def make_seeds() -> list[bytes]:
    """Returns gestural SiGML, a table of HamNoSys, and SiGML of HamNoSys with a face."""
    table = (TESTS / "hamnosys_signs.csv").read_text(encoding="utf-8")
    names = table.splitlines()[100].split(",")[2].split()
    face = '<hnm_mouthpicture picture="ro:d"/><hnm_head tag="NO"/>'
    hns = "".join(f"<ham{name}/>\n" for name in names)
    sigml = (
        f'<sigml><hns_sign gloss="A"><hamnosys_nonmanual>{face}</hamnosys_nonmanual>'
        f"<hamnosys_manual>\n{hns}</hamnosys_manual></hns_sign></sigml>"
    )
    return [(TESTS / "written_signs.sigml").read_bytes(), table.encode(), sigml.encode()]


def mutate_signs(content: bytes, rng: random.Random) -> bytes:
    """Returns a text with one symbol, value, element or line changed, added, removed or moved; at times anything."""
    if rng.random() < 0.2:
        return mutate_text(content, rng)
    text = content.decode("utf-8", "surrogateescape")
    if text.lstrip().startswith("<"):
        return _mutate_xml(text, rng).encode("utf-8", "surrogateescape")
    position = rng.randrange(len(text) + 1)
    while position < len(text) and text[position] not in symbols.SYMBOLS and rng.random() < 0.98:
        position = (position + 1) % len(text)
    piece = "".join(rng.choices(_SYMBOLS, k=rng.choice((0, 1, 1, 2, 5))))
    if rng.random() < 0.1:
        start = rng.randrange(len(text) + 1)
        piece = text[start : start + rng.randrange(40)]
    return (text[:position] + piece + text[position + rng.choice((0, 1, 1, 3)) :]).encode("utf-8", "surrogateescape")


def _mutate_xml(text: str, rng: random.Random) -> str:
    values = list(re.finditer(r'"[^"]*"|<[^>]*>', text))
    if not values:
        return text
    piece, other_piece = rng.choice(values), rng.choice(values)
    position = rng.choice((piece.end(), piece.end(), piece.start()))
    match rng.randrange(4):
        case 0:  # a value or an element of another place
            return text[: piece.start()] + other_piece.group() + text[piece.end() :]
        case 1:
            return text[: piece.start()] + text[piece.end() :]
        case 2:
            return text[:position] + other_piece.group() + text[position:]
        case _:
            start, end = sorted((piece.start(), other_piece.end()))
            return text[:position] + text[start : min(end, start + 2000)] + text[position:]


def use(written_signs: WrittenSigns) -> None:
    """Does what a lexicon does with signs that were read: compiles some, and animates one."""
    for error in itertools.islice(written_signs.refused, 20):
        _check_message(error, "case")
    for gloss, sign in written_signs.signs.items():
        assert gloss == sign.gloss
        assert all(len(note.splitlines()) == 1 for note in sign.notes), sign.notes
    compiled = None
    for sign in random.Random(len(written_signs.signs)).sample(
        list(written_signs.signs.values()), min(len(written_signs.signs), 12)
    ):
        try:
            compile_sign(sign)
            compiled = sign
        except InputError as error:
            _check_message(error, sign.gloss)
    if compiled is None:
        return
    clip = signing.animate_sign(compiled)
    assert np.isfinite(clip.local_rotations).all()
    assert np.isfinite(clip.root_positions).all()
    assert clip.seconds < MAX_SECONDS, f"{compiled.gloss}: {clip.seconds:.0f} s"
    dots = np.abs((clip.local_rotations[1:] * clip.local_rotations[:-1]).sum(axis=-1))
    if any("jumps" in note or "turns over" in note for note in clip.notes):  # the clip tells of its arms
        dots = np.delete(dots, _ARMS, axis=-1)
    step_deg = np.rad2deg(2.0 * np.arccos(np.minimum(dots, 1.0))).max()
    assert step_deg < MAX_STEP_DEG, f"{compiled.gloss}: a joint turns by {step_deg:.0f} degrees in a frame"


def _check_message(error: InputError, name: str) -> None:
    text = str(error)
    assert 0 < len(text) < 1500
    assert len(text.splitlines()) == 1, text
    assert name in text, text
