"""Letters of directions as vectors, and where a palm faces (ViSiCAST's gestural SiGML; the open player performs).

Vectors are (out, up, forward) of a right-handed signer, out being the signer's right, as in ``phonology``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from signsplice.errors import InputError
from signsplice.signer.phonology import Vector

_LETTERS: dict[str, Vector] = {
    "u": (0.0, 1.0, 0.0),
    "d": (0.0, -1.0, 0.0),
    "l": (-1.0, 0.0, 0.0),
    "r": (1.0, 0.0, 0.0),
    "o": (0.0, 0.0, 1.0),
    "i": (0.0, 0.0, -1.0),
}
_SMALL = 1e-6
_LEVEL = 1e-3
"""Least part of a direction that counts."""


def dot(a: Vector, b: Vector) -> float:
    """The scalar product of two vectors."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    """A vector and a multiple of another one, added."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product as a right-handed signer's axes have it, in which (left, up, forward) are right-handed."""
    x, y, z = (-a[0], a[1], a[2]), (-b[0], b[1], b[2]), None
    z = (x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0])
    return (-z[0], z[1], z[2])


def unit(v: Vector) -> Vector | None:
    """The unit vector along ``v``; None where it has no length."""
    length = math.sqrt(dot(v, v))
    return None if length < _SMALL else (v[0] / length, v[1] / length, v[2] / length)


def direction(words: Sequence[str]) -> Vector:
    """The unit vector of one word of letters, or midway between two. Raises ``InputError`` where it points nowhere."""
    ends = []
    for word in words:
        total: Vector = (0.0, 0.0, 0.0)
        for letter in word:
            if letter not in _LETTERS:
                raise InputError(f"direction {word!r}: {letter!r} is none of {' '.join(_LETTERS)}")
            total = plus(total, _LETTERS[letter])
        one = unit(total)
        if one is None:
            raise InputError(f"direction {word!r} points nowhere")
        ends.append(one)
    between = unit(plus(ends[0], ends[-1]))
    return ends[0] if between is None else between  # of two opposite ones the first


def oriented(fingers: Sequence[str], palm: Sequence[str]) -> tuple[Vector, Vector]:
    """The unit vectors along which fingers point and a palm faces. Of two directions each is resolved with its own palm
    before they are averaged: near upright fingers a palm's letter turns with a few degrees of theirs. Raises
    ``InputError`` where they point nowhere.
    """
    along = direction(fingers)
    total: Vector = (0.0, 0.0, 0.0)
    for finger, word in ((fingers[0], palm[0]), (fingers[-1], palm[-1])):
        own = direction((finger,))
        faces = _facing(own, word, along[2] < -_LEVEL)
        cosine = dot(own, along)
        if cosine > -0.999:  # turned as the fingers are
            faces = plus(faces, plus(own, along), -dot(faces, along) / (1.0 + cosine))
        total = plus(total, faces)
    between = unit(total)
    return along, facing(along, palm) if between is None else between


def facing(fingers: Vector, words: Sequence[str]) -> Vector:
    """The unit vector that a palm faces whose fingers point along ``fingers``: the same reading that gives a curve its
    side. ``d`` is the lower side in the vertical plane through the fingers, ``l`` across it, towards the signer's left
    where the fingers point away and towards the signer where they point left.
    """
    ends = [_facing(fingers, word) for word in words]
    between = unit(plus(ends[0], ends[-1]))
    return ends[0] if between is None else between


def _facing(fingers: Vector, word: str, back: bool = False) -> Vector:
    """``back``: fingers that point neither away nor towards the signer count as if they pointed to the signer."""
    level = math.hypot(fingers[0], fingers[2]) <= _LEVEL
    back = fingers[2] < -_LEVEL or (back and fingers[2] < _LEVEL)
    across = unit(cross((0.0, 1.0, 0.0), plus(fingers, (0.0, 0.0, -1.0 if back else 1.0)) if level else fingers))
    assert across is not None
    if back:
        across = (-across[0], -across[1], -across[2])
    below = unit(cross(across, fingers))
    assert below is not None
    lower = fingers[1] * below[2] * (-1.0 if back else 1.0) if level else -below[1]
    if lower < 0.0:
        below = (-below[0], -below[1], -below[2])
    a, b = word.count("d") - word.count("u"), word.count("l") - word.count("r")
    depth = word.count("o") - word.count("i")
    if depth:  # no letter of a palm: as nearly as the fingers allow
        literal = (float(-b), float(-a), float(depth))
        flat = unit(plus(literal, fingers, -dot(literal, fingers)))
        if flat is not None:
            return flat
    found = unit(plus((a * below[0], a * below[1], a * below[2]), across, b))
    return below if found is None else found
