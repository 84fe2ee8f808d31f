"""The curves of an FBX file: their keys, the tangents at the keys, and the values before the first and after the last.

The flags of a key (``KeyAttrFlags``; the FBX SDK's names are in ``FbxAnimCurveDef``) say how the curve runs to the next
key, and which rule gives the slopes on both sides of the key. The rules were measured on FBX2glTF 0.9.7, which holds
the SDK, and ufbx 0.0.5. They differ for flags that the SDK does not write, for the span from an automatic or TCB key to
one of another kind, and for biases of time-independent keys; there the rules are ufbx's.

========== ================================= ===========================================================================
bits       name                              rule
========== ================================= ===========================================================================
0x2        eInterpolationConstant            the value is held until the next key
0x2, 0x100 the same, eConstantNext           the next key's value is shown at once
0x4        eInterpolationLinear              straight; so are spans whose key has no interpolation
0x8        eInterpolationCubic               a Bezier curve, with one of the next four rules, automatic if none is set
0x100      eTangentAuto                      automatic slopes, see ``_auto_slopes``; two numbers bias them, percent
0x200      eTangentTCB                       Kochanek and Bartels (1984), of tension, continuity and bias
0x400      eTangentUser                      the file gives the slopes
0x800      eTangentGenericBreak              none: the slopes left and right of any key are stored apart
0x1000     eTangentGenericClamp              automatic slopes are 0 beside a key of equal value
0x2000     eTangentGenericTimeIndependent    automatic slopes are those of the chord between the neighbours, unbiased
0x4000     eTangentGenericClampProgressive   automatic slopes overshoot no neighbour, and are 0 at the curve's ends
0x300000   eTangentShowLeft, -Right          none: for editors
0x1000000  eWeightedRight                    the file gives the length of the right tangent
0x2000000  eWeightedNextLeft                 the file gives the length of the next key's left tangent
0x30000000 eVelocityRight, -NextLeft         none: both programs ignore the velocities
========== ================================= ===========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.fbx_records import Record
from signsplice.motion import FloatArray

_HELD, _LINEAR, _CUBIC = 0x2, 0x4, 0x8
_AUTO, _TCB, _USER = 0x100, 0x200, 0x400
_NEXT = 0x100
"""Of a held key; the bit of ``_AUTO``."""
_CLAMP, _TIME_INDEPENDENT, _PROGRESSIVE = 0x1000, 0x2000, 0x4000
_WEIGHTED_RIGHT, _WEIGHTED_NEXT_LEFT = 0x1000000, 0x2000000
_KNOWN = 0x33307F0E
"""All bits of the table above."""
_THIRD = 1.0 / 3.0
"""Weight of a tangent with which time passes evenly."""
_UNIT = 1.0 / 9999.0
"""Files of version 7 store weights of tangents as whole numbers of this unit, as the SDK does."""
_EQUAL = 1e-4
"""Values that differ by less than this, in the file's units, are equal to a clamp, as in the SDK."""
_HALVINGS = 40
"""Bisection steps that find the curve parameter of a time."""
_AT_KEY = 1e-7
"""A time within this many seconds of a key's is the key's."""
_AT_END = 1e-9
"""Rounding that is allowed for in a number of repetitions."""


class Tangents(NamedTuple):
    """Interpolation after each of the K keys of a curve.

    flags: (K,) key flags.
    numbers: (K, 3) by the key's rule: the slopes right of the key and left of the next one, units a second; or their
        biases, percent; or tension, continuity and bias.
    weights: (K, 2) lengths of the tangents right of the key and left of the next one, as fractions of the time between
        the keys.
    """

    flags: NDArray[np.int64]
    numbers: FloatArray
    weights: FloatArray


class Beyond(NamedTuple):
    """What a curve does before its first key or after its last.

    mode: C: holds the value there; K: goes on straight; R: repeats the keys; A: repeats them from the value there; M:
        repeats them, every other time backwards.
    repeats: how often it repeats them; negative: without end.
    """

    mode: str = "C"
    repeats: int = -1


@dataclass(frozen=True)
class KeyCurve:
    """The keys of one number.

    times: (K,) seconds, rising; of keys at the same time, the first ends the span before and the last begins the next.
    values: (K,)
    read_tangents: reads the tangents; not called if only the values at the keys are needed.
    beyond: before the first key and after the last.
    oddities: what in the file has no rule, and how it is read.
    """

    times: FloatArray
    values: FloatArray
    read_tangents: Callable[[], Tangents]
    beyond: tuple[Beyond, Beyond] = (Beyond(), Beyond())
    oddities: tuple[str, ...] = ()

    def at(self, times: FloatArray) -> FloatArray:
        """Sample the curve at ``times`` (T,)."""
        if len(self.times) == 1:
            return np.full(len(times), self.values[0])
        if len(self.times) == len(times) and np.abs(self.times - times).max() < _AT_KEY:
            return self.values
        tangents = self.read_tangents()
        right_slopes, left_slopes = _slopes(self.times, self.values, tangents)
        times, offsets = self._fold(times, (right_slopes[0], left_slopes[-1]))
        low = np.clip(np.searchsorted(self.times, times + _AT_KEY, side="right") - 1, 0, len(self.times) - 2)
        span = self.times[low + 1] - self.times[low]
        since = times - self.times[low]
        u = np.clip(np.divide(since, span, out=1.0 * (since >= 0.0), where=span > 0.0), 0.0, 1.0)
        a, b, flags = self.values[low], self.values[low + 1], tangents.flags[low]
        values = np.where(u < 1.0, a + u * (b - a), b)
        cubic = _is_cubic(flags)
        if cubic.any():
            slopes = right_slopes[low], left_slopes[low + 1]
            values[cubic] = _bezier(u, a, b, span, *slopes, tangents.weights[low])[cubic]
        is_held = ((flags & _HELD) != 0) & (since > _AT_KEY) & (u < 1.0)
        return offsets + np.where(is_held, np.where((flags & _NEXT) != 0, b, a), values)

    def _fold(self, times: FloatArray, slopes: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Return the times (T,) within the keys whose values are shown at ``times`` (T,), and what is added (T,).

        slopes: right of the first key and left of the last.
        """
        first, last = self.times[0], self.times[-1]
        folded, offsets, period = times.copy(), np.zeros(len(times)), last - first
        for sign, (mode, repeats), slope in zip((-1.0, 1.0), self.beyond, slopes, strict=True):
            rows = np.flatnonzero(times < first if sign < 0.0 else times > last)
            beyond_s = sign * (times[rows] - (first if sign < 0.0 else last))
            if mode == "K":
                offsets[rows] = sign * slope * beyond_s
            elif mode != "C" and period > 0.0:
                turn = np.floor(beyond_s / period + _AT_END)
                part = np.maximum(beyond_s - turn * period, 0.0)
                if repeats >= 0:
                    part[turn >= repeats], turn = period, np.minimum(turn, repeats - 1)
                if mode == "M":
                    part = np.where(turn % 2 == 0, period - part, part)
                if mode == "A":
                    offsets[rows] = sign * (turn + 1) * (self.values[-1] - self.values[0])
                folded[rows] = first + part if sign > 0.0 else last - part
        return folded, offsets


def _is_cubic(flags: NDArray[np.int64]) -> NDArray[np.bool_]:
    return np.asarray((flags & (_HELD | _CUBIC)) == _CUBIC)


def _slopes(times: FloatArray, values: FloatArray, tangents: Tangents) -> tuple[FloatArray, FloatArray]:
    """Return the slopes (K,) right and left of each key, units a second, by the rules of the keys' flags."""
    flags, numbers, _ = tangents
    spans = np.diff(times)
    steps = np.divide(np.diff(values), spans, out=np.zeros(len(spans)), where=spans > 0.0)
    kinds = np.where(flags & _HELD, _HELD, np.where(flags & _CUBIC, _CUBIC, _LINEAR))[:-1]
    stored = np.where(flags & _TCB, 0.0, numbers[:, :2].T)
    span_slopes = np.choose(kinds // 4, [np.zeros((2, len(steps))), np.stack([steps, steps]), stored[:, :-1]])
    # A key's left slope is stored with the key before.
    right, left = np.append(span_slopes[0], 0.0), np.append(0.0, span_slopes[1])
    before, after = np.append(0.0, spans > 0.0) > 0.0, np.append(spans > 0.0, 0.0) > 0.0  # whether a span is there
    below, above = np.append(0.0, steps), np.append(steps, 0.0)
    is_tcb, is_auto = (_is_cubic(flags) & (flags & (_TCB | _USER) == rule) for rule in (_TCB, 0))
    if is_tcb.any():
        tension, continuity, bias = numbers.T
        share = np.where(before & after, 0.5, 1.0) * (1.0 - tension)
        tcb_left = share * ((1 + bias) * (1 - continuity) * below + (1 - bias) * (1 + continuity) * above)
        tcb_right = share * ((1 + bias) * (1 + continuity) * below + (1 - bias) * (1 - continuity) * above)
        left, right = np.where(is_tcb, tcb_left, left), np.where(is_tcb, tcb_right, right)
    if is_auto.any():
        auto_right, auto_left = _auto_slopes(times, tangents, stored, below, above, before & after)
        left, right = np.where(is_auto, auto_left, left), np.where(is_auto, auto_right, right)
    return right, left


def _auto_slopes(
    times: FloatArray,
    tangents: Tangents,
    stored: FloatArray,
    below: FloatArray,
    above: FloatArray,
    is_inner: NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:
    """Return automatic slopes (K,) right and left of each key.

    The slope is the mean of two: that of the chord between the neighbours, and that of both spans, the shorter weighing
    more; or the first alone. A bias moves it towards the slope of the span on its own side, or, if negative, of the
    other. At the ends it is that of the only span.

    stored: (2, K) biases of the slopes right of each key and left of the next one, percent. below, above: (K,) slopes
    of the spans before and after each key, 0 for none. is_inner: (K,) whether it has both.
    """
    flags, _, weights = tangents
    since, until = np.append(0.0, np.diff(times)), np.append(np.diff(times), 0.0)
    both = np.where(is_inner, since + until, 1.0)
    chord = (since * below + until * above) / both
    weighted = (until * below + since * above) / both
    is_free = (flags & _TIME_INDEPENDENT) != 0
    slope = np.where(is_free, chord, 0.5 * (chord + weighted))
    slopes = []
    biases = stored[0], np.append(0.0, stored[1, :-1])
    lengths = until * weights[:, 0], since * np.append(_THIRD, weights[:-1, 1])
    for bias, sides in zip(biases, ((above, below), (below, above)), strict=True):
        toward = np.where(bias > 0.0, *sides)
        slopes.append(np.where(is_free, slope, slope + np.abs(bias) / 100.0 * (toward - slope)))
    rise, fall = np.abs(until * above), np.abs(since * below)
    is_flat = ((flags & _CLAMP) != 0) & (np.minimum(rise, fall) <= _EQUAL)
    progressive = (flags & _PROGRESSIVE) != 0
    is_flat |= progressive & (below * above <= 0.0)
    steepest = np.minimum(*(np.divide(change, length, out=np.full(len(times), np.inf), where=length > 0.0)
                            for change, length in zip((rise, fall), lengths, strict=True)))  # fmt: skip
    limit = np.where(progressive, steepest, np.inf)
    inner = (np.where(is_flat, 0.0, np.sign(side) * np.minimum(np.abs(side), limit)) for side in slopes)
    ends = np.where(progressive, 0.0, below + above)
    right, left = (np.where(is_inner, side, ends) for side in inner)
    return right, left


def _bezier(
    u: FloatArray, a: FloatArray, b: FloatArray, span: FloatArray, right: FloatArray, left: FloatArray, w: FloatArray
) -> FloatArray:
    """Return values (T,) between two keys of a cubic Bezier curve.

    u: (T,) fraction of the time between the keys. a, b: (T,) values at the keys. span: (T,) time between them, seconds.
    right, left: (T,) slopes after the first key and before the second. w: (T, 2) weights of these tangents.
    """
    first, second = w[:, 0], 1.0 - w[:, 1]
    s = u.copy()
    if np.abs(w - _THIRD).max() > 1e-4:  # otherwise time passes evenly
        low, high = np.zeros_like(u), np.ones_like(u)
        for _ in range(_HALVINGS):
            s = 0.5 * (low + high)
            is_early = 3.0 * (1.0 - s) ** 2 * s * first + 3.0 * (1.0 - s) * s**2 * second + s**3 < u
            low, high = np.where(is_early, s, low), np.where(is_early, high, s)
    after_a, before_b = a + right * span * first, b - left * span * (1.0 - second)
    return np.asarray((1 - s) ** 3 * a + 3 * (1 - s) ** 2 * s * after_a + 3 * (1 - s) * s**2 * before_b + s**3 * b)


def read_curve(record: Record, ticks: float, as_bits: bool) -> KeyCurve | None:
    """Read the curve of an ``AnimationCurve`` (version 7); None if it has no keys.

    ticks: units of time in a second.
    as_bits: whether the bits of key attributes are written as whole numbers.
    """
    times, values = record.numbers("KeyTime") / ticks, record.numbers("KeyValueFloat")
    if len(times) != len(values):
        raise InputError(f"a curve has {len(times)} times and {len(values)} values")
    if not len(times):
        return None
    _check_keys(times, values)
    flags = record.numbers("KeyAttrFlags").astype(np.int64)
    beyond, oddities = _read_beyond(record)
    return KeyCurve(times, values, lambda: _read_tangents(record, flags, as_bits, len(times)), beyond,
                    (*oddities, *_odd_flags(flags)))  # fmt: skip


def _read_tangents(record: Record, flags: NDArray[np.int64], as_bits: bool, n_keys: int) -> Tangents:
    """Read the tangents of an ``AnimationCurve``'s ``n_keys`` keys; each row of its attributes applies to one or more
    keys.
    """
    counts, numbers = record.numbers("KeyAttrRefCount").astype(np.int64), record.numbers("KeyAttrDataFloat")
    if len(flags) != len(counts) or len(numbers) != 4 * len(counts) or (counts < 0).any():
        raise InputError("a curve's attributes do not fit its keys")
    if counts.sum() != n_keys:
        raise InputError(f"a curve has attributes for {counts.sum()} keys, expected {n_keys}")
    bits = numbers.astype(np.int64).astype(np.uint32) if as_bits else numbers.astype(np.float32).view(np.uint32)
    bits = bits.reshape(-1, 4)
    floats = np.ascontiguousarray(bits[:, :3]).view(np.float32).astype(np.float64)
    packed = np.stack([bits[:, 2] & 0xFFFF, bits[:, 2] >> 16], axis=1) * _UNIT
    weighted = np.stack([flags & _WEIGHTED_RIGHT, flags & _WEIGHTED_NEXT_LEFT], axis=1) != 0
    weighted &= _is_cubic(flags)[:, None]
    weights = np.clip(np.where(weighted, packed, _THIRD), 0.0, 1.0)
    return Tangents(*(np.repeat(rows, counts, axis=0) for rows in (flags, floats, weights)))


def _odd_flags(flags: NDArray[np.int64]) -> Iterator[str]:
    """Yield what the table of key flags lacks, and how it is read."""
    unknown = int(np.bitwise_or.reduce(flags, initial=0)) & ~_KNOWN
    if unknown:
        yield f"key flags {unknown:#x}, read as if unset"
    if ((flags & (_HELD | _LINEAR | _CUBIC)) == 0).any():
        yield "keys without interpolation, read as linear"


def _read_beyond(record: Record) -> tuple[tuple[Beyond, Beyond], tuple[str, ...]]:
    """Read what a curve does before and after its keys, and what is unknown of it."""
    sides, oddities = [], []
    for name in ("Pre-Extrapolation", "Post-Extrapolation"):
        part = record.find(name)
        kind = None if part is None else part.find("Type")
        mode = "C" if kind is None or not kind.values else _letter(kind.values[0])
        count = np.empty(0) if part is None else part.numbers("Repetition")
        if mode not in "CKRAM":
            oddities.append(f"{name} {mode!r:.20}, read as constant")
            mode = "C"
        sides.append(Beyond(mode, int(next(iter(count), -1))))
    return (sides[0], sides[1]), tuple(oddities)


def read_old_curve(record: Record, ticks: float) -> KeyCurve | None:
    """Read the curve of a ``Channel`` of version 6, or its constant; None if it has neither."""
    keys = record.find("Key")
    if keys is None or not keys.values:
        default = record.numbers("Default")
        return constant(float(default[0])) if len(default) else None
    rows = np.array(list(_old_keys(iter(keys.values))))  # (K, 8)
    times, values = rows[:, 0] / ticks, rows[:, 1]
    _check_keys(times, values)
    tangents = Tangents(rows[:, 2].astype(np.int64), rows[:, 3:6], np.clip(rows[:, 6:], 0.0, 1.0))
    return KeyCurve(times, values, lambda: tangents, *_read_beyond(record))


def _old_keys(values: Iterator[Any]) -> Iterator[tuple[float, ...]]:
    """Yield time (in the file's units), value, flags, three numbers and two weights of each key of a list.

    Letters follow a key's time and value. C: held (n: it shows the next key's value). L: linear. U: cubic (a: automatic
    slopes; p: the same, then whether, a, two numbers follow, the first the bias on the left of the next key; s, b: two
    slopes follow; t: tension, continuity and bias follow, and no more), then whose tangents have a weight, which
    follows (a: both, r: right, l: left).
    """
    for time in values:
        value, kind = float(next(values)), _letter(next(values))
        flags, numbers, weights = _LINEAR, [0.0, 0.0, 0.0], [_THIRD, _THIRD]
        if kind == "C":
            flags = _HELD | (_NEXT if _letter(next(values)) == "n" else 0)
        elif kind == "U":
            mode = _letter(next(values))
            flags = _CUBIC | {"a": _AUTO, "p": _AUTO, "t": _TCB}.get(mode, _USER)
            if mode == "p" and _letter(next(values)) == "a":
                numbers[1] = float(next(values))
                next(values)  # without effect in the SDK
            for k in range({"s": 2, "b": 2, "t": 3}.get(mode, 0)):
                numbers[k] = float(next(values))
            weight = _letter(next(values)) if mode != "t" else "n"
            for side, letters in enumerate(("ar", "al")):
                if weight in letters:
                    weights[side] = float(next(values))
        elif kind != "L":
            raise InputError(f"a key leads on by {kind!r:.20}, expected L, C or U")
        yield float(time), value, flags, *numbers, *weights


def _letter(value: Any) -> str:
    """Return a letter, which binary files hold as a number."""
    return chr(value) if isinstance(value, int) else str(value)


def constant(value: float) -> KeyCurve:
    """Return a constant curve."""
    return KeyCurve(np.zeros(1), np.array([value]), lambda: Tangents(np.zeros(1, np.int64), *np.zeros((2, 1, 3))))


def _check_keys(times: FloatArray, values: FloatArray) -> None:
    """Raise ``InputError`` if a number is not finite or times fall."""
    if not (np.isfinite(times.sum()) and np.isfinite(values.sum())):
        raise InputError("a key is not finite")
    if (times[1:] < times[:-1]).any():
        raise InputError("a curve's keys go back in time")
