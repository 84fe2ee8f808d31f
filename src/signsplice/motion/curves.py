"""Curves of movements over time."""

from __future__ import annotations

from typing import TypeVar

from signsplice.motion.arrays import FloatArray

Number = TypeVar("Number", float, FloatArray)


def minimum_jerk(u: Number, height: float = 1.0) -> Number:
    """Progress 10 u^3 - 15 u^4 + 6 u^5 at times ``u``, 0 to 1: from rest to rest (Flash and Hogan 1985), also the
    smooth step of degree 5. ``height`` is multiplied first.
    """
    return height * u**3 * (10.0 + u * (-15.0 + 6.0 * u))


def minimum_jerk_by_powers(u: FloatArray) -> FloatArray:
    """``minimum_jerk`` as a sum of powers. It differs in the last bit: the fingers between letters and the true cuts of
    stored corpora were made with it.
    """
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
