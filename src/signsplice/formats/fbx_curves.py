"""Animation curves of FBX files: keys at any times, held, linear or cubic between them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.fbx_records import Record
from signsplice.motion.arrays import FloatArray

_HELD, _LINEAR, _NEXT, _USER, _BROKEN = 0x2, 0x4, 0x100, 0x400, 0x800
_WEIGHTED_RIGHT, _WEIGHTED_NEXT_LEFT = 0x1000000, 0x2000000
_THIRD, _UNIT = 1.0 / 3.0, 1.0 / 9999.0
"""The weight of a tangent that leaves time even, and that of one unit in a file, by which the SDK divides."""
_HALVINGS = 40
_AT_KEY = 1e-7
"""Seconds within which a frame is at a key."""


@dataclass(frozen=True)
class Tangents:
    """How the K keys of a curve lead on.

    flags: (K,) to the next key.
    slopes: (K, 2) units a second: on the right of a key, and on the left of the next one.
    weights: (K, 2) how far the tangents reach, as fractions of the time between the keys.
    """

    flags: NDArray[np.int64]
    slopes: FloatArray
    weights: FloatArray


@dataclass(frozen=True)
class KeyCurve:
    """The keys of one number.

    times: (K,) seconds, rising.
    values: (K,)
    read_tangents: reads how the keys lead on; not called where a value is wanted at each key alone.
    """

    times: FloatArray
    values: FloatArray
    read_tangents: Callable[[], Tangents]

    def at(self, times: FloatArray) -> FloatArray:
        """The number at ``times`` (T,); before the first key and after the last, the value there."""
        if len(self.times) == 1:
            return np.full(len(times), self.values[0])
        if len(self.times) == len(times) and np.abs(self.times - times).max() < _AT_KEY:
            return self.values
        tangents = self.read_tangents()
        low = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        span = self.times[low + 1] - self.times[low]
        u = np.clip((times - self.times[low]) / span, 0.0, 1.0)
        a, b, flags = self.values[low], self.values[low + 1], tangents.flags[low]
        cubic = (flags & (_HELD | _LINEAR)) == 0
        out = a + u * (b - a)
        if cubic.any():
            right, left = self._slopes(tangents)
            out[cubic] = _bezier(u, a, b, span, right[low], left[low], tangents.weights[low])[cubic]
        held = ((flags & _HELD) != 0) & (u > 0.0) & (u < 1.0)
        return np.where(held, np.where((flags & _NEXT) != 0, b, a), out)

    def _slopes(self, tangents: Tangents) -> tuple[FloatArray, FloatArray]:
        """Slopes (K - 1,) after each key and before the next; where the file leaves them to its reader, those of the
        chord between the neighbours and of both spans, in equal parts.
        """
        steps = np.diff(self.values) / np.diff(self.times)
        right, left = tangents.slopes[:-1, 0].copy(), tangents.slopes[:-1, 1].copy()
        is_auto = (tangents.flags & (_USER | _BROKEN)) == 0
        auto = np.empty(len(self.times))
        auto[0], auto[-1] = steps[0], steps[-1]
        if len(steps) > 1:
            chord = (self.values[2:] - self.values[:-2]) / (self.times[2:] - self.times[:-2])
            weight = (self.times[1:-1] - self.times[:-2]) / (self.times[2:] - self.times[:-2])
            auto[1:-1] = 0.5 * (chord + (1.0 - weight) * steps[:-1] + weight * steps[1:])
        right[is_auto[:-1]] = auto[:-1][is_auto[:-1]]
        left[is_auto[1:]] = auto[1:][is_auto[1:]]
        return right, left


def _bezier(
    u: FloatArray, a: FloatArray, b: FloatArray, span: FloatArray, right: FloatArray, left: FloatArray, w: FloatArray
) -> FloatArray:
    """Values (T,) between two keys by a cubic Bezier curve whose inner points lie at the fractions ``w`` (T, 2)."""
    first, second = w[:, 0], 1.0 - w[:, 1]
    s = u.copy()
    if np.abs(w - _THIRD).max() > 1e-4:  # else time passes evenly
        low, high = np.zeros_like(u), np.ones_like(u)
        for _ in range(_HALVINGS):
            s = 0.5 * (low + high)
            before = 3.0 * (1.0 - s) ** 2 * s * first + 3.0 * (1.0 - s) * s**2 * second + s**3 < u
            low, high = np.where(before, s, low), np.where(before, high, s)
    rise, fall = a + right * span * first, b - left * span * (1.0 - second)
    return np.asarray((1 - s) ** 3 * a + 3 * (1 - s) ** 2 * s * rise + 3 * (1 - s) * s**2 * fall + s**3 * b)


def read_curve(record: Record, ticks: float, as_bits: bool) -> KeyCurve | None:
    """The curve of an ``AnimationCurve`` (version 7); None where it has no keys.

    ticks: units of time in a second. as_bits: whether the bits of key attributes are written as whole numbers.
    """
    times, values = record.numbers("KeyTime") / ticks, record.numbers("KeyValueFloat")
    if len(times) != len(values):
        raise InputError(f"a curve has {len(times)} times and {len(values)} values")
    if not len(times):
        return None
    kept = _checked_keys(times, values)
    return KeyCurve(times[kept], values[kept], lambda: _read_tangents(record, as_bits, kept, len(times)))


def _read_tangents(record: Record, as_bits: bool, kept: NDArray[np.bool_] | slice, n_keys: int) -> Tangents:
    """How the keys of an ``AnimationCurve`` lead on; each row of its attributes counts for some keys."""
    counts = record.numbers("KeyAttrRefCount").astype(np.int64)
    flags, numbers = record.numbers("KeyAttrFlags").astype(np.int64), record.numbers("KeyAttrDataFloat")
    if len(flags) != len(counts) or len(numbers) != 4 * len(counts) or (counts < 0).any():
        raise InputError("a curve's attributes do not fit its keys")
    if counts.sum() != n_keys:
        raise InputError(f"a curve has attributes for {counts.sum()} keys, expected {n_keys}")
    bits = numbers.astype(np.int64).astype(np.uint32) if as_bits else numbers.astype(np.float32).view(np.uint32)
    bits = bits.reshape(-1, 4)
    slopes = np.ascontiguousarray(bits[:, :2]).view(np.float32).astype(np.float64)
    packed = np.stack([bits[:, 2] & 0xFFFF, bits[:, 2] >> 16], axis=1) * _UNIT
    weighted = np.stack([flags & _WEIGHTED_RIGHT, flags & _WEIGHTED_NEXT_LEFT], axis=1) != 0
    weights = np.clip(np.where(weighted, packed, _THIRD), 0.0, 1.0)
    return Tangents(*(np.repeat(rows, counts, axis=0)[kept] for rows in (flags, slopes, weights)))


def read_old_curve(record: Record, ticks: float) -> KeyCurve | None:
    """The curve of a ``Channel`` of version 6, or its constant; None where it has neither."""
    keys = record.find("Key")
    if keys is None or not keys.values:
        default = record.numbers("Default")
        return constant(float(default[0])) if len(default) else None
    rows = np.array(list(_old_keys(iter(keys.values))))  # (K, 7)
    times, values = rows[:, 0] / ticks, rows[:, 1]
    kept = _checked_keys(times, values)
    rows = rows[kept]
    tangents = Tangents(rows[:, 2].astype(np.int64), rows[:, 3:5], np.clip(rows[:, 5:], 0.0, 1.0))
    return KeyCurve(times[kept], values[kept], lambda: tangents)


def _old_keys(values: Iterator[Any]) -> Iterator[tuple[float, ...]]:
    """Time, value, flags, two slopes and two weights of each key of a list in which letters say what follows."""
    for time in values:
        value, kind = float(next(values)), _letter(next(values))
        flags, slopes, weights = _LINEAR, [0.0, 0.0], [_THIRD, _THIRD]
        if kind == "C":
            flags = _HELD | (_NEXT if _letter(next(values)) == "n" else 0)
        elif kind == "U":
            mode = _letter(next(values))
            flags = 0 if mode == "a" else _USER
            if mode in "sb":
                slopes = [float(next(values)), float(next(values))]
            weight = _letter(next(values))
            for side, letters in enumerate(("ar", "al")):
                if weight in letters:
                    weights[side] = float(next(values))
        elif kind != "L":
            raise InputError(f"a key leads on by {kind!r:.20}, expected L, C or U")
        yield float(time), value, flags, *slopes, *weights


def _letter(value: Any) -> str:
    """A letter, which binary files hold as a number."""
    return chr(value) if isinstance(value, int) else str(value)


def constant(value: float) -> KeyCurve:
    """A curve that has one value at all times."""
    return KeyCurve(np.zeros(1), np.array([value]), lambda: Tangents(np.zeros(1, np.int64), *np.zeros((2, 1, 2))))


def _checked_keys(times: FloatArray, values: FloatArray) -> NDArray[np.bool_] | slice:
    """Which keys count: of those at one time the last. Raises ``InputError`` where they are no curve."""
    steps = times[1:] - times[:-1]
    if not (np.isfinite(times.sum()) and np.isfinite(values.sum())):
        raise InputError("a key is not finite")
    least = steps.min(initial=1.0)
    if least < 0.0:
        raise InputError("a curve's keys go back in time")
    return slice(None) if least > 0.0 else np.append(steps > 0.0, True)
