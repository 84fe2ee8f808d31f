"""Signs as text in the notation, which ``notation.parse`` reads back."""

from __future__ import annotations

from dataclasses import replace

from signsplice.signer.notation import lower_cm
from signsplice.signer.phonology import DIRECTIONS, Local, Path, Posture, Segment, Sign, Vector

_WORDS = {vector: word for word, vector in DIRECTIONS.items()}


def notation_text(sign: Sign) -> str:
    """A sign in the notation; reading it gives the same sign, numbers to a thousandth."""
    kind = "" if sign.kind == "sign" else f" kind={sign.kind}"
    lines = [f"{sign.gloss}  hands={sign.hands}{kind}"]
    lines += [f"  source: {sign.source}"] if sign.source else []
    lines += [f"  synonyms: {', '.join(sign.synonyms)}"] if sign.synonyms else []
    lines += [f"  gesture: {one}" for one in sign.gestures]
    strong: Posture | None = None
    weak: Posture | None = None
    for segment in sign.segments:
        words = [segment.kind, *_posture(segment.strong, strong, "", sign.hands)]
        if segment.weak is not None:
            words += _posture(segment.weak, weak, "w.", sign.hands)
        lines.append("  " + " ".join([*words, *_movement(segment)]))
        strong, weak = segment.strong, segment.weak
    return "\n".join(lines) + "\n"


def _posture(posture: Posture, before: Posture | None, prefix: str, hands: str) -> list[str]:
    """The keys of a posture that differ from the one before."""
    anew = before is None or posture.location != before.location
    old = before or Posture("", "", "palm", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    if anew:
        old = replace(old, location="", off=0.0, shift=(0.0, 0.0, 0.0), touch=False)
    lower = lower_cm(posture.location, hands)
    x, y, z = posture.shift
    shift = _numbers((x, y + lower, z))
    keys = {
        "shape": posture.shape if posture.shape != old.shape else "",
        "at": posture.location if anew else "",
        "by": posture.part if posture.part != old.part else "",
        "off": _number(posture.off) if _number(posture.off) != _number(old.off) else "",
        "shift": shift
        if shift != ("0,0,0" if anew else _numbers((old.shift[0], old.shift[1] + lower, old.shift[2])))
        else "",
        "touch": ("yes" if posture.touch else "no") if posture.touch != old.touch else "",
        "palm": _direction(posture.palm) if posture.palm != old.palm else "",
        "fingers": _direction(posture.fingers) if posture.fingers != old.fingers else "",
    }
    return [f"{prefix}{key}={value}" for key, value in keys.items() if value]


def _movement(segment: Segment) -> list[str]:
    """The keys of a segment beside its postures."""
    keys = {
        "path": notation_path(segment.path),
        "w.path": notation_path(segment.weak_path),
        "local": _local(segment.local),
        "w.local": _local(segment.weak_local),
        "times": str(segment.times) if segment.times > 1 else "",
        "return": f"lifted:{_number(segment.lift)}" if segment.lift else "",
        "step": _numbers(segment.step) if any(segment.step) else "",
        "tempo": _number(segment.tempo) if segment.tempo != 1.0 else "",
        "keep": "touch" if segment.keeps else "",
        "for": "" if segment.seconds is None else _number(segment.seconds),
        "head": segment.head,
        "trunk": segment.trunk,
    }
    return [f"{key}={value}" for key, value in keys.items() if value]


def notation_path(path: Path) -> str:
    """A path in the notation; "" for a straight one."""
    if path.kind == "arc":
        return f"arc:{_direction(path.direction)}:{_number(path.size)}"
    if path.kind == "zigzag":
        return f"zigzag:{_direction(path.direction)}:{_number(path.size)}:{_number(path.revolutions)}"
    if path.kind == "circle":
        plane = path.plane or _direction(path.direction)
        text = f"circle:{plane}:{_number(path.size)}:{_number(path.revolutions)}"
        start = "" if path.plane else f":{_direction(path.start)}"
        return text + start + (f":{_number(path.ratio)}" if path.ratio != 1.0 else "")
    return "" if path.kind == "straight" else path.kind


def _local(local: Local | None) -> str:
    if local is None:
        return ""
    more = f"+{_local(local.also)}" if local.also is not None else ""
    return f"{local.kind}:{_number(local.amplitude)}:{_number(local.cycles)}{more}"


def _number(value: float) -> str:
    return f"{round(value, 3) + 0.0:g}"


def _numbers(vector: Vector) -> str:
    return ",".join(map(_number, vector))


def _direction(vector: Vector) -> str:
    """A direction by its word, or as three numbers."""
    near = next(
        (word for v, word in _WORDS.items() if all(abs(a - b) < 5e-4 for a, b in zip(v, vector, strict=True))), ""
    )
    return near or _numbers(vector)
