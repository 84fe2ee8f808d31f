"""Decimal numbers parsed and printed with array operations, many at once.

Motion files are almost nothing but numbers such as ``-12.345678``. Eight digits are parsed with three multiplications
in one 64-bit word (pairs, then fours, then eights are combined), for all numbers of a file in parallel. Only text that
certainly parses to what ``float`` returns is handled here; for any other the result is None, and the caller falls back
to a slower parser.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_WORD = 8
_BLOCK = 1 << 18
"""Bytes parsed at a time, so that the arrays stay in the processor's cache."""

_SPACE, _DIGIT, _DOT, _SIGN, _OTHER = range(5)
_CLASS = np.full(256, _OTHER, np.uint8)
_CLASS[[9, 10, 11, 12, 13, 32]] = _SPACE
_CLASS[48:58] = _DIGIT
_CLASS[46] = _DOT
_CLASS[[43, 45]] = _SIGN

_WHOLE, _FRACTION = 6, 8
"""Digits before and after the decimal point that ``format_rows`` prints with array operations."""
_PAIRS = np.frombuffer("".join(f"{n:02d}" for n in range(100)).encode(), np.uint8).reshape(100, 2)

_MAX_DIGITS = 15
"""An integer of 15 digits is below 2^53; divided once by a power of ten below 10^22 it is correctly rounded (Clinger
1990).
"""


def parse_plain(text: bytes) -> Float | None:
    """The numbers (N,) of a text of plain decimals separated by white space, equal to those of ``float``.

    Plain: an optional sign, at most 8 digits before and 8 after an optional point, 15 in all, no exponent. None if
    the text holds anything else.
    """
    blocks: list[Float] = []
    start = 0
    while start < len(text):
        stop = len(text)
        if stop - start > _BLOCK:
            stop = text.rfind(b"\n", start, start + _BLOCK) + 1 or stop
        block = _parse_block(text[start:stop])
        if block is None:
            return None
        blocks.append(block)
        start = stop
    return np.concatenate(blocks) if blocks else np.empty(0)


def _parse_block(text: bytes) -> Float | None:
    flat = np.frombuffer(b" " * _WORD + text + b" ", np.uint8)
    kind = _CLASS[flat]
    if (kind == _OTHER).any():
        return None
    space = kind == _SPACE
    edges = np.flatnonzero(space[1:] != space[:-1]) + 1
    starts, ends = edges[0::2], edges[1::2]
    signs = np.flatnonzero(kind == _SIGN)
    if not space[signs - 1].all():  # a sign inside a number
        return None
    digits_from = starts + (kind[starts] == _SIGN)
    dots = np.flatnonzero(kind == _DOT)
    owner = np.searchsorted(starts, dots, side="right") - 1
    if np.any(owner[1:] == owner[:-1]):
        return None
    point = ends.copy()
    point[owner] = dots
    n_whole = point - digits_from
    n_fraction = np.maximum(ends - point - 1, 0)
    n_digits = n_whole + n_fraction
    if np.any(n_digits < 1) or np.any(n_digits > _MAX_DIGITS) or np.any(np.maximum(n_whole, n_fraction) > _WORD):
        return None
    words = np.ndarray((len(flat) - _WORD + 1,), "<u8", flat, 0, (1,))  # the eight bytes from each position on
    scale = 10.0 ** np.arange(_WORD + 1)
    power = scale[n_fraction]
    value = (
        _whole_number(words[point - _WORD], n_whole) * power + _whole_number(words[ends - _WORD], n_fraction)
    ) / power
    return np.asarray(np.where(flat[starts] == 45, -value, value))


def _whole_number(words: NDArray[np.uint64], n_digits: NDArray[np.intp]) -> Float:
    """The value (N,) of the last ``n_digits`` (N,) characters of eight-byte words (N,), which are digits."""
    spare = (8 * (_WORD - n_digits)).astype(np.uint64)
    w = ((words ^ np.uint64(0x3030303030303030)) >> spare) << spare  # digits to 0..9, other bytes to 0
    w = (w * np.uint64(10) + (w >> np.uint64(8))) & np.uint64(0x00FF00FF00FF00FF)
    w = (w * np.uint64(100) + (w >> np.uint64(16))) & np.uint64(0x0000FFFF0000FFFF)
    w = (w * np.uint64(10000) + (w >> np.uint64(32))) & np.uint64(0x00000000FFFFFFFF)
    return w.astype(np.float64)


def format_rows(values: Float) -> str:
    """Rows of numbers (R, C) as lines of text; ``float`` reads each number back as the same.

    Numbers with at most 6 digits before and 8 after the point are printed in parallel, without superfluous zeros; rows
    with any other number are printed with Python's ``repr``.
    """
    scaled = np.abs(values) * 10.0**_FRACTION
    whole = np.rint(scaled)
    plain = (whole < 10.0 ** (_WHOLE + _FRACTION)) & (whole / 10.0**_FRACTION == np.abs(values))
    if not plain.all():
        return "\n".join(
            format_rows(row[None]) if fits else " ".join(map(repr, row.tolist()))
            for row, fits in zip(values, plain.all(axis=1), strict=True)
        )
    n_rows, n_columns = values.shape
    remaining = whole.astype(np.int64).ravel()
    # Sign, digits, point, digits, space; then unneeded characters are removed.
    text = np.empty((remaining.size, 1 + _WHOLE + 1 + _FRACTION + 1), np.uint8)
    text[:, 0], text[:, 1 + _WHOLE], text[:, -1] = ord("-"), ord("."), ord(" ")
    text.reshape(n_rows, n_columns, -1)[:, -1, -1] = ord("\n")
    for pair in range((_WHOLE + _FRACTION) // 2):
        remaining, two_digits = np.divmod(remaining, 100)
        at = text.shape[1] - 3 - 2 * pair - (2 * pair >= _FRACTION)
        text[:, at : at + 2] = _PAIRS[two_digits]
    keep = np.ones(text.shape, bool)
    keep[:, 0] = np.signbit(values).ravel()
    digits = text != ord("0")
    keep[:, 1:_WHOLE] = np.logical_or.accumulate(digits[:, 1:_WHOLE], axis=1)
    decimals = digits[:, _WHOLE + 2 : -1]
    keep[:, _WHOLE + 3 : -1] = np.logical_or.accumulate(decimals[:, :0:-1], axis=1)[:, ::-1]
    return text[keep].tobytes()[:-1].decode("ascii")
