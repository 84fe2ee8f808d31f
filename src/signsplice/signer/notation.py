"""Reads and writes the notation of signs, one segment per line (described in full in docs/notation.md).

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
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

from signsplice.errors import FormatError
from signsplice.formats.reading import read_bytes
from signsplice.signer.hand import is_part
from signsplice.signer.handshapes import HANDSHAPES, is_handshape
from signsplice.signer.phonology import (
    DIRECTIONS,
    GESTURE_FORM,
    HANDS,
    HEAD,
    LOCALS,
    LOCATIONS,
    PARTS,
    PATHS,
    PLANES,
    TRUNK,
    Gesture,
    Local,
    Path,
    Posture,
    Segment,
    Sign,
    faults,
    is_location,
    read_gesture,
)
from signsplice.signer.tables import FOLDER, Vector, to_vector

_POSTURE_KEYS = ("shape", "at", "by", "off", "shift", "touch", "palm", "fingers")
_ONLY_M = ("path", "w.path", "local", "w.local", "times", "return", "step", "tempo", "keep")
_KEYS = (*_POSTURE_KEYS, *(f"w.{key}" for key in _POSTURE_KEYS), *_ONLY_M, "for", "head", "trunk")
_LIFT_CM = 3.0
"""How far a hand is lifted if the notation gives no distance, cm."""
_LOWER = ("space", "space-mid", "space-in", "space-out")
"""Places before the chest at which two hands are lower than one."""
_LOWER_CM = 6.0
"""How much lower, cm: otherwise the upper one of two stacked hands would be at the throat."""
_HEADER = re.compile(r"(?P<gloss>[^\s=:]+)\s+hands=(?P<hands>\S+)(?:\s+kind=(?P<kind>\S+))?\s*$")


@dataclass(frozen=True)
class _Line:
    """Position of a line of text, for errors.

    file: name of the text
    number: line number, from 1
    gloss: the sign of the line, or ""
    """

    file: str
    number: int
    gloss: str = ""

    def error(self, message: str) -> FormatError:
        what = f"{self.gloss}: {message}" if self.gloss else message
        what = re.sub(r"\S{61,}", lambda word: word[0][:57] + "...", what)
        return FormatError(what if len(what) <= 600 else what[:597] + "...", file=self.file, line=self.number)


def read(path: str | FilePath) -> dict[str, Sign]:
    """Reads the signs of a file by gloss, in order. Raises ``FormatError`` with file and line for the first error."""
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"is no UTF-8 text ({error.reason} at byte {error.start})", file=str(path)) from error
    return parse(text, str(path))


def parse(text: str, name: str = "<text>") -> dict[str, Sign]:
    """Parses the signs of a text by gloss; ``name`` is the file's name in errors. Raises ``FormatError`` for the first
    error.
    """
    signs: dict[str, Sign] = {}
    for block in _blocks(text, name):
        sign = _sign(block)
        if sign.gloss in signs:
            raise block[0][0].error(f"{sign.gloss} is written twice, expected one block a gloss")
        signs[sign.gloss] = sign
    return signs


def _blocks(text: str, name: str) -> Iterable[list[tuple[_Line, str]]]:
    """Yields the lines of each sign: a header at the margin, then indented lines. # begins a comment."""
    block: list[tuple[_Line, str]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        content = re.sub(r"(^|\s)#( .*|$)", "", raw).rstrip()
        if not content.strip():
            continue
        line = _Line(name, number)
        if content[0].isspace():
            if not block:
                shown = f"{content.strip()[:80]!r}"
                raise line.error(f"{shown} belongs to no sign, expected GLOSS hands=... at the margin first")
            block.append((line, content.strip()))
        else:
            if block:
                yield block
            block = [(line, content)]
    if block:
        yield block


def _sign(block: list[tuple[_Line, str]]) -> Sign:
    first, header = block[0]
    match = _HEADER.fullmatch(header)
    if match is None:
        raise first.error(f"{header[:80]!r}, expected GLOSS hands={'|'.join(HANDS)} [kind=sign|letter]")
    gloss, hands, kind = match["gloss"], match["hands"], match["kind"] or "sign"
    _one_of(first, "hands", hands, HANDS)
    _one_of(first, "kind", kind, ("sign", "letter", "pseudo", "written"))
    notes = {"source": "", "synonyms": ""}
    gestures, segments = list[Gesture](), list[Segment]()
    for position, content in block[1:]:
        line = replace(position, gloss=gloss)
        key, colon, value = content.partition(":")
        if colon and key in notes:
            notes[key] = value.strip()
        elif key == "gesture" and colon:
            if (gesture := read_gesture(value.strip())) is None:
                raise line.error(f"gesture: {value.strip()!r}, expected {GESTURE_FORM}")
            gestures.append(gesture)
        else:
            segments.append(_segment(line, content, hands, segments[-1] if segments else None))
    if any(segment.keeps for segment in segments):  # from touch to touch
        segments = [replace(s, strong=replace(s.strong, on_skin=s.strong.off < 1.0)) for s in segments]
    synonyms = tuple(word.strip() for word in notes["synonyms"].split(",") if word.strip())
    sign = Sign(gloss, hands, tuple(segments), notes["source"], synonyms, kind, tuple(gestures))
    problems = faults(sign)
    if problems:
        raise first.error(f"{gloss}: {problems[0]}")
    return sign


def _segment(line: _Line, content: str, hands: str, before: Segment | None) -> Segment:
    kind, *words = content.split()
    if kind not in ("H", "X", "M"):
        raise line.error(f"{kind!r}, expected a segment H, X or M, or source: synonyms: or gesture:")
    fields: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not value:
            raise line.error(f"{word!r}, expected key=value")
        _one_of(line, "key", key, _KEYS)
        if key in fields:
            raise line.error(f"{key} is given twice")
        if key in _ONLY_M and kind != "M":
            raise line.error(f"{key}= belongs to M, not to {kind}")
        fields[key] = value
    if "tempo" in fields and "for" in fields:
        raise line.error("tempo= and for= both say how long it takes, expected one of them")
    weak_fields = {key[2:]: value for key, value in fields.items() if key.startswith("w.")}
    if weak_fields and hands != "base":
        raise line.error(f"w.{next(iter(weak_fields))}= needs hands=base, not hands={hands}")
    strong = _posture(line, fields, before.strong if before else None, "", hands)
    weak = _posture(line, weak_fields, before.weak if before else None, "w.", hands) if hands == "base" else None
    return Segment(
        kind=kind,
        strong=strong,
        weak=weak,
        path=_path(line, fields["path"]) if "path" in fields else Path(),
        weak_path=_path(line, fields["w.path"], "w.path") if "w.path" in fields else Path(),
        local=_local(line, fields["local"]) if "local" in fields else None,
        weak_local=_local(line, fields["w.local"]) if "w.local" in fields else None,
        times=int(_number(line, "times", fields.get("times", "1"), 1, 8, whole=True)),
        lift=_lift(line, fields["return"]) if "return" in fields else 0.0,
        step=_shift(line, "step", fields["step"]) if "step" in fields else (0.0, 0.0, 0.0),
        keeps=_one_of(line, "keep", fields.get("keep", ""), ("", "touch")) == "touch",
        tempo=_number(line, "tempo", fields.get("tempo", "1"), 0.25, 3.0),
        seconds=_number(line, "for", fields["for"], 0.0, 5.0) if "for" in fields else None,
        head=_one_of(line, "head", fields.get("head", ""), ("", *HEAD)),
        trunk=_one_of(line, "trunk", fields.get("trunk", ""), ("", *TRUNK)),
    )


def _posture(line: _Line, fields: dict[str, str], before: Posture | None, prefix: str, hands: str) -> Posture:
    """The posture of a line. Values that the line omits carry over; a new location resets off and shift."""
    if before is None:
        missing = [key for key in ("shape", "at", "palm", "fingers") if key not in fields]
        if missing:
            raise line.error(f"first segment lacks {prefix}{missing[0]}=")
        before = Posture("", "", "palm", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    changes: dict[str, object] = {}
    if "at" in fields:
        location = _parse_composite(line, f"{prefix}at", fields["at"], LOCATIONS, is_location)
        changes |= {"location": location, "off": 0.0, "touch": False}
    if "shape" in fields:
        changes["shape"] = _parse_composite(line, f"{prefix}shape", fields["shape"], HANDSHAPES, is_handshape)
    if "by" in fields:
        changes["part"] = _parse_composite(line, f"{prefix}by", fields["by"], PARTS, is_part)
    if "touch" in fields:
        changes["touch"] = _one_of(line, f"{prefix}touch", fields["touch"], ("yes", "no")) == "yes"
    if "off" in fields:
        changes["off"] = _number(line, f"{prefix}off", fields["off"], -5.0, 60.0)
    if "at" in fields or "shift" in fields:
        x, y, z = _shift(line, f"{prefix}shift", fields.get("shift", "0,0,0"))
        changes["shift"] = (x, y - lower_cm(str(changes.get("location", before.location)), hands), z)
    for key in ("palm", "fingers"):
        if key in fields:
            changes[key] = _direction(line, fields[key])
    return replace(before, **changes)  # type: ignore[arg-type]


def lower_cm(location: str, hands: str) -> float:
    """How much lower than one hand the hands of a kind are at a location, cm."""
    return _LOWER_CM if location in _LOWER and hands != "one" else 0.0


def _lift(line: _Line, text: str) -> float:
    """How far a hand is lifted on its way back, cm; 0 if it goes back on the same path."""
    kind, colon, distance = text.partition(":")
    _one_of(line, "return", kind, ("lifted", "same"))
    if kind == "same":
        if colon:
            raise line.error(f"return={text}, expected return=same or return=lifted[:CM]")
        return 0.0
    return _number(line, "return", distance, 1.0, 15.0) if colon else _LIFT_CM


def _path(line: _Line, text: str, key: str = "path") -> Path:
    kind, *rest = text.split(":")
    _one_of(line, key, kind, PATHS)
    shapes = {"arc": "arc:DIRECTION:CM", "circle": "circle:PLANE:CM:TURNS", "zigzag": "zigzag:DIRECTION:CM:TURNS"}
    expected = shapes.get(kind, kind)
    if not expected.count(":") <= len(rest) <= expected.count(":") + 2 * (kind == "circle"):
        raise line.error(f"{key}={text}, expected {key}={expected}")
    if kind not in shapes:
        return Path(kind)
    if kind == "circle" and ("," in rest[0] or rest[0].partition("-")[0] in DIRECTIONS):
        return _circle(line, rest, key, text)
    plane = _one_of(line, "plane", rest[0], PLANES) if kind == "circle" else ""
    low, high = (-6.0, 6.0) if plane else (0.5, 8.0)
    revolutions = _number(line, key, rest[2], low, high) if kind != "arc" else 0.0
    if plane and abs(revolutions) < 0.25:
        raise line.error(f"{key}={text}, expected a quarter of a turn or more")
    direction = (0.0, 0.0, 0.0) if plane else _direction(line, rest[0])
    return Path(kind, direction, plane, _number(line, key, rest[1], 0.5, 40.0 if kind == "arc" else 30.0), revolutions)


def _circle(line: _Line, words: list[str], key: str, text: str) -> Path:
    """A circle about an axis, AXIS:CM:TURNS[:START[:RATIO]]."""
    axis = _direction(line, words[0])
    start = _direction(line, words[3]) if len(words) > 3 else (0.0, 1.0, 0.0)
    projection = sum(a * b for a, b in zip(start, axis, strict=True))
    perpendicular = [a - projection * b for a, b in zip(start, axis, strict=True)]
    length = math.sqrt(sum(c * c for c in perpendicular))
    if length < 0.1:
        raise line.error(f"{key}={text}: the circle's start lies on its axis, expected a start across it")
    size, turns = _number(line, key, words[1], 0.5, 30.0), _number(line, key, words[2], -6.0, 6.0)
    ratio = _number(line, key, words[4], 0.1, 10.0) if len(words) > 4 else 1.0
    start = to_vector(c / length for c in perpendicular)
    return Path("circle", axis, size=size, revolutions=turns, start=start, ratio=ratio)


def _local(line: _Line, text: str) -> Local:
    if "+" in text:
        first, rest_of_it = text.split("+", 1)
        return replace(_local(line, first), also=_local(line, rest_of_it))
    kind, *rest = text.split(":")
    _one_of(line, "local", kind, LOCALS)
    if len(rest) > 2:
        raise line.error(f"local={text}, expected local={kind}[:AMPLITUDE[:CYCLES]]")
    amplitude, cycles = LOCALS[kind]
    if rest:
        amplitude = _number(line, "local", rest[0], 0.1 if kind != "stir" else -60.0, 120.0)
    if len(rest) > 1:
        cycles = _number(line, "local", rest[1], 0.5, 10.0)
    return Local(kind, amplitude, cycles)


def _direction(line: _Line, text: str) -> Vector:
    total: Sequence[float] = _shift(line, "direction", text) if "," in text else (0.0, 0.0, 0.0)
    for word in text.split("-") if "," not in text else ():
        total = [a + b for a, b in zip(total, DIRECTIONS[_one_of(line, "direction", word, DIRECTIONS)], strict=True)]
    length = math.sqrt(sum(c * c for c in total))
    if length == 0.0:
        raise line.error(f"direction {text!r} points nowhere")
    return to_vector(c / length for c in total)


def _shift(line: _Line, key: str, text: str) -> Vector:
    words = text.split(",")
    if len(words) != 3:
        raise line.error(f"{key}={text}, expected three numbers in cm: out,up,fwd")
    return to_vector(_number(line, key, word, -60.0, 60.0) for word in words)


def _number(line: _Line, key: str, text: str, low: float, high: float, whole: bool = False) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high or (whole and value != int(value)):
        raise line.error(f"{key}={text}, expected a {'whole ' if whole else ''}number from {low:g} to {high:g}")
    return value


def _parse_composite(line: _Line, key: str, value: str, known: Iterable[str], is_known: Callable[[str], bool]) -> str:
    """A word that may also be composed."""
    return value if is_known(value) else _one_of(line, key, value, known)


def _one_of(line: _Line, key: str, value: str, known: Iterable[str]) -> str:
    known = list(known)
    if value not in known:
        names = [name for name in known if name]
        matches = difflib.get_close_matches(value, names, 3, 0.5)
        hint = f"did you mean {' or '.join(matches)}?" if matches else f"expected one of {', '.join(names)}"
        raise line.error(f"unknown {key} {value!r}; {hint}")
    return value


def alphabet(language: str = "ase") -> dict[str, Sign]:
    """A manual alphabet and digits of this package, by gloss (``fs-A`` ... ``fs-9``), read on each call: the American,
    or that of another signed language of ``languages.ALPHABETS``.
    """
    return read(FOLDER / ("alphabet.signs" if language == "ase" else f"alphabet-{language}.signs"))


def everyday() -> dict[str, Sign]:
    """The everyday words of this package, by gloss, read on each call. No signer has checked them."""
    return read(FOLDER / "everyday.signs")


_WORDS = {vector: word for word, vector in DIRECTIONS.items()}


def notation_text(sign: Sign) -> str:
    """A sign in the notation; reading it gives the same sign, numbers to a thousandth."""
    kind = "" if sign.kind == "sign" else f" kind={sign.kind}"
    lines = [f"{sign.gloss}  hands={sign.hands}{kind}"]
    lines += [f"  source: {sign.source}"] if sign.source else []
    lines += [f"  synonyms: {', '.join(sign.synonyms)}"] if sign.synonyms else []
    lines += [f"  gesture: {gesture}" for gesture in sign.gestures]
    strong: Posture | None = None
    weak: Posture | None = None
    for segment in sign.segments:
        words = [segment.kind, *_posture_words(segment.strong, strong, "", sign.hands)]
        if segment.weak is not None:
            words += _posture_words(segment.weak, weak, "w.", sign.hands)
        lines.append("  " + " ".join([*words, *_movement_words(segment)]))
        strong, weak = segment.strong, segment.weak
    return "\n".join(lines) + "\n"


def _posture_words(posture: Posture, before: Posture | None, prefix: str, hands: str) -> list[str]:
    """The keys of a posture that differ from the previous posture."""
    anew = before is None or posture.location != before.location
    old = before or Posture("", "", "palm", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    if anew:
        old = replace(old, location="", off=0.0, shift=(0.0, 0.0, 0.0), touch=False)
    lower = lower_cm(posture.location, hands)
    x, y, z = posture.shift
    shift = _vector_text((x, y + lower, z))
    was = "0,0,0" if anew else _vector_text((old.shift[0], old.shift[1] + lower, old.shift[2]))
    keys = {
        "shape": posture.shape if posture.shape != old.shape else "",
        "at": posture.location if anew else "",
        "by": posture.part if posture.part != old.part else "",
        "off": _number_text(posture.off) if _number_text(posture.off) != _number_text(old.off) else "",
        "shift": shift if shift != was else "",
        "touch": ("yes" if posture.touch else "no") if posture.touch != old.touch else "",
        "palm": _direction_text(posture.palm) if posture.palm != old.palm else "",
        "fingers": _direction_text(posture.fingers) if posture.fingers != old.fingers else "",
    }
    return [f"{prefix}{key}={value}" for key, value in keys.items() if value]


def _movement_words(segment: Segment) -> list[str]:
    """The keys of a segment apart from its postures."""
    keys = {
        "path": notation_path(segment.path),
        "w.path": notation_path(segment.weak_path),
        "local": _local_text(segment.local),
        "w.local": _local_text(segment.weak_local),
        "times": str(segment.times) if segment.times > 1 else "",
        "return": f"lifted:{_number_text(segment.lift)}" if segment.lift else "",
        "step": _vector_text(segment.step) if any(segment.step) else "",
        "tempo": _number_text(segment.tempo) if segment.tempo != 1.0 else "",
        "keep": "touch" if segment.keeps else "",
        "for": "" if segment.seconds is None else _number_text(segment.seconds),
        "head": segment.head,
        "trunk": segment.trunk,
    }
    return [f"{key}={value}" for key, value in keys.items() if value]


def notation_path(path: Path) -> str:
    """A path in the notation; "" for a straight one."""
    if path.kind == "arc":
        return f"arc:{_direction_text(path.direction)}:{_number_text(path.size)}"
    if path.kind == "zigzag":
        return f"zigzag:{_direction_text(path.direction)}:{_number_text(path.size)}:{_number_text(path.revolutions)}"
    if path.kind == "circle":
        plane = path.plane or _direction_text(path.direction)
        text = f"circle:{plane}:{_number_text(path.size)}:{_number_text(path.revolutions)}"
        start = "" if path.plane else f":{_direction_text(path.start)}"
        return text + start + (f":{_number_text(path.ratio)}" if path.ratio != 1.0 else "")
    return "" if path.kind == "straight" else path.kind


def _local_text(local: Local | None) -> str:
    if local is None:
        return ""
    suffix = f"+{_local_text(local.also)}" if local.also is not None else ""
    return f"{local.kind}:{_number_text(local.amplitude)}:{_number_text(local.cycles)}{suffix}"


def _number_text(value: float) -> str:
    return f"{round(value, 3) + 0.0:g}"


def _vector_text(vector: Vector) -> str:
    return ",".join(map(_number_text, vector))


def _direction_text(vector: Vector) -> str:
    """A direction by its word, or as three numbers."""
    for named, word in _WORDS.items():
        if all(abs(a - b) < 5e-4 for a, b in zip(named, vector, strict=True)):
            return word
    return _vector_text(vector)
