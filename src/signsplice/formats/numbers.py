"""Decimal numbers printed with array operations, many at once.

Motion files are almost nothing but numbers such as ``-12.345678``, and Python's ``repr`` prints them one by one.
"""

from __future__ import annotations

import numpy as np

from signsplice.motion.arrays import FloatArray

_WHOLE, _FRACTION = 6, 8
"""Digits before and after the decimal point that ``format_rows`` prints with array operations."""
_PAIRS = np.frombuffer("".join(f"{n:02d}" for n in range(100)).encode(), np.uint8).reshape(100, 2)


def format_rows(values: FloatArray) -> str:
    """Rows of numbers (R, C) as lines of text; ``float`` reads each number back as the same.

    Numbers with at most 6 digits before and 8 after the point are printed in parallel, without superfluous zeros; rows
    with any other number are printed with Python's ``repr``.
    """
    with np.errstate(over="ignore"):  # what overflows is not plain
        whole = np.rint(np.abs(values) * 10.0**_FRACTION)
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
