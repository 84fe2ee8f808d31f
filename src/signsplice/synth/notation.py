"""The notation in which signs are written, one segment a line (docs/corpus.md has the whole of it).

MOTHER  hands=one
  source: thumb of the open hand taps the chin (Costello 1994)
  synonyms: MOM
  X  shape=5 at=chin by=thumb off=3 palm=in fingers=up
  M  off=0 times=2
  H
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path as FilePath

from signsplice.errors import FormatError
from signsplice.formats.atomic import read_bytes
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.phonology import (
    DIRECTIONS,
    HANDS,
    HEAD,
    LOCALS,
    LOCATIONS,
    PARTS,
    PATHS,
    PLANES,
    TRUNK,
    Local,
    Path,
    Posture,
    Segment,
    Sign,
    Vector,
    faults,
)

_POSTURE_KEYS = ("shape", "at", "by", "off", "shift", "palm", "fingers")
_KEYS = (*_POSTURE_KEYS, *(f"w.{key}" for key in _POSTURE_KEYS), "path", "local", "times", "for", "head", "trunk")
_ONLY_M = ("path", "local", "times")
_HEADER = re.compile(r"(?P<gloss>[^\s=:]+)\s+hands=(?P<hands>\S+)(?:\s+kind=(?P<kind>\S+))?\s*$")


@dataclass(frozen=True)
class _Line:
    """A place in a text and the sign it belongs to, for errors."""

    file: str
    number: int
    gloss: str = ""

    def error(self, what: str) -> FormatError:
        return FormatError(f"{self.gloss}: {what}" if self.gloss else what, file=self.file, line=self.number)


def read(path: str | FilePath) -> dict[str, Sign]:
    """The signs of a file by gloss, in its order. Raises ``FormatError`` with file and line for the first fault."""
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"is no UTF-8 text ({error.reason} at byte {error.start})", file=str(path)) from error
    return parse(text, str(path))


def parse(text: str, name: str = "<text>") -> dict[str, Sign]:
    """The signs of a text by gloss; ``name`` stands for the file in errors. Raises ``FormatError`` for the first
    fault.
    """
    signs: dict[str, Sign] = {}
    for block in _blocks(text, name):
        sign = _sign(block)
        if sign.gloss in signs:
            raise block[0][0].error(f"{sign.gloss} is written twice, expected one block a gloss")
        signs[sign.gloss] = sign
    return signs


def _blocks(text: str, name: str) -> Iterable[list[tuple[_Line, str]]]:
    """Lines of each sign: a header at the margin, then indented lines; # begins a comment."""
    block: list[tuple[_Line, str]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        content = re.sub(r"(^|\s)#( .*|$)", "", raw).rstrip()
        if not content.strip():
            continue
        at = _Line(name, number)
        if content[0].isspace():
            if not block:
                raise at.error(f"{content.strip()!r} belongs to no sign, expected GLOSS hands=... at the margin first")
            block.append((at, content.strip()))
        else:
            if block:
                yield block
            block = [(at, content)]
    if block:
        yield block


def _sign(block: list[tuple[_Line, str]]) -> Sign:
    at, header = block[0]
    match = _HEADER.fullmatch(header)
    if match is None:
        raise at.error(f"{header!r}, expected GLOSS hands={'|'.join(HANDS)} [kind=sign|letter]")
    gloss, hands, kind = match["gloss"], match["hands"], match["kind"] or "sign"
    _one_of(at, "hands", hands, HANDS)
    _one_of(at, "kind", kind, ("sign", "letter", "pseudo"))
    notes = {"source": "", "synonyms": ""}
    segments: list[Segment] = []
    for place, content in block[1:]:
        line = replace(place, gloss=gloss)
        key, colon, value = content.partition(":")
        if colon and key in notes:
            notes[key] = value.strip()
        else:
            segments.append(_segment(line, content, hands, segments[-1] if segments else None))
    synonyms = tuple(word.strip() for word in notes["synonyms"].split(",") if word.strip())
    sign = Sign(gloss, hands, tuple(segments), notes["source"], synonyms, kind)
    wrong = faults(sign)
    if wrong:
        raise at.error(f"{gloss}: {wrong[0]}")
    return sign


def _segment(at: _Line, content: str, hands: str, before: Segment | None) -> Segment:
    kind, *words = content.split()
    if kind not in ("H", "X", "M"):
        raise at.error(f"{kind!r}, expected a segment H, X or M, or source: or synonyms:")
    fields: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not value:
            raise at.error(f"{word!r}, expected key=value")
        _one_of(at, "key", key, _KEYS)
        if key in fields:
            raise at.error(f"{key} is given twice")
        if key in _ONLY_M and kind != "M":
            raise at.error(f"{key}= belongs to M, not to {kind}")
        fields[key] = value
    weak_fields = {key[2:]: value for key, value in fields.items() if key.startswith("w.")}
    if weak_fields and hands != "base":
        raise at.error(f"w.{next(iter(weak_fields))}= needs hands=base, not hands={hands}")
    strong = _posture(at, fields, before.strong if before else None, "")
    weak = _posture(at, weak_fields, before.weak if before else None, "w.") if hands == "base" else None
    return Segment(
        kind=kind,
        strong=strong,
        weak=weak,
        path=_path(at, fields["path"]) if "path" in fields else Path(),
        local=_local(at, fields["local"]) if "local" in fields else None,
        times=int(_number(at, "times", fields.get("times", "1"), 1, 8, whole=True)),
        seconds=_number(at, "for", fields["for"], 0.0, 5.0) if "for" in fields else None,
        head=_one_of(at, "head", fields.get("head", ""), ("", *HEAD)),
        trunk=_one_of(at, "trunk", fields.get("trunk", ""), ("", *TRUNK)),
    )


def _posture(at: _Line, fields: dict[str, str], before: Posture | None, prefix: str) -> Posture:
    """The posture of a line; what it does not say stays as it was. A new place forgets off and shift."""
    if before is None:
        missing = [key for key in ("shape", "at", "palm", "fingers") if key not in fields]
        if missing:
            raise at.error(f"first segment lacks {prefix}{missing[0]}=")
        before = Posture("", "", "palm", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    changes: dict[str, object] = {}
    if "at" in fields:
        changes |= {"place": _one_of(at, f"{prefix}at", fields["at"], LOCATIONS), "off": 0.0, "shift": (0.0, 0.0, 0.0)}
    if "shape" in fields:
        changes["shape"] = _one_of(at, f"{prefix}shape", fields["shape"], HANDSHAPES)
    if "by" in fields:
        changes["part"] = _one_of(at, f"{prefix}by", fields["by"], PARTS)
    if "off" in fields:
        changes["off"] = _number(at, f"{prefix}off", fields["off"], -5.0, 60.0)
    if "shift" in fields:
        changes["shift"] = _shift(at, f"{prefix}shift", fields["shift"])
    for key in ("palm", "fingers"):
        if key in fields:
            changes[key] = _direction(at, fields[key])
    return replace(before, **changes)  # type: ignore[arg-type]


def _path(at: _Line, text: str) -> Path:
    kind, *rest = text.split(":")
    _one_of(at, "path", kind, PATHS)
    shapes = {"arc": "arc:DIRECTION:CM", "circle": "circle:PLANE:CM:TURNS", "zigzag": "zigzag:DIRECTION:CM:TURNS"}
    expected = shapes.get(kind, kind)
    if len(rest) != expected.count(":"):
        raise at.error(f"path={text}, expected path={expected}")
    if kind == "arc":
        return Path(kind, _direction(at, rest[0]), size=_number(at, "path", rest[1], 0.5, 40.0))
    if kind == "circle":
        plane = _one_of(at, "plane", rest[0], PLANES)
        turns = _number(at, "path", rest[2], -6.0, 6.0)
        if abs(turns) < 0.25:
            raise at.error(f"path={text}, expected a quarter of a turn or more")
        return Path(kind, plane=plane, size=_number(at, "path", rest[1], 0.5, 30.0), revolutions=turns)
    if kind == "zigzag":
        turns = _number(at, "path", rest[2], 0.5, 8.0)
        return Path(kind, _direction(at, rest[0]), size=_number(at, "path", rest[1], 0.5, 30.0), revolutions=turns)
    return Path(kind)


def _local(at: _Line, text: str) -> Local:
    kind, *rest = text.split(":")
    _one_of(at, "local", kind, LOCALS)
    if len(rest) > 2:
        raise at.error(f"local={text}, expected local={kind}[:AMPLITUDE[:CYCLES]]")
    amplitude, cycles = LOCALS[kind]
    if rest:
        amplitude = _number(at, "local", rest[0], 0.1, 120.0)
    if len(rest) > 1:
        cycles = _number(at, "local", rest[1], 0.5, 10.0)
    return Local(kind, amplitude, cycles)


def _direction(at: _Line, text: str) -> Vector:
    total = [0.0, 0.0, 0.0]
    for word in text.split("-"):
        _one_of(at, "direction", word, DIRECTIONS)
        total = [a + b for a, b in zip(total, DIRECTIONS[word], strict=True)]
    length = math.sqrt(sum(c * c for c in total))
    if length == 0.0:
        raise at.error(f"direction {text!r} points nowhere")
    x, y, z = (c / length for c in total)
    return x, y, z


def _shift(at: _Line, key: str, text: str) -> Vector:
    words = text.split(",")
    if len(words) != 3:
        raise at.error(f"{key}={text}, expected three numbers in cm: out,up,fwd")
    x, y, z = (_number(at, key, word, -60.0, 60.0) for word in words)
    return x, y, z


def _number(at: _Line, key: str, text: str, low: float, high: float, whole: bool = False) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high or (whole and value != int(value)):
        raise at.error(f"{key}={text}, expected a {'whole ' if whole else ''}number from {low:g} to {high:g}")
    return value


def _one_of(at: _Line, key: str, value: str, known: Iterable[str]) -> str:
    known = list(known)
    if value not in known:
        names = [name for name in known if name]
        near = difflib.get_close_matches(value, names, 3, 0.5)
        hint = f"did you mean {' or '.join(near)}?" if near else f"expected one of {', '.join(names)}"
        raise at.error(f"unknown {key} {value!r}; {hint}")
    return value


_WORDS = FilePath(__file__).parent / "words"


@cache
def alphabet() -> dict[str, Sign]:
    """The American manual alphabet and digits that ship, by gloss (``fs-A`` ... ``fs-9``)."""
    return read(_WORDS / "alphabet.signs")


@cache
def everyday() -> dict[str, Sign]:
    """The everyday words that ship, by gloss. No signer has checked them."""
    return read(_WORDS / "everyday.signs")
