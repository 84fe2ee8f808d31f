"""The takes of an FBX file: curves by object and property, in stacked layers. Keys have any times; between them a curve
is held, linear or cubic.

A layer adds to or overrides those below it, in proportion to its weight ("FbxAnimLayer" in the FBX SDK's documentation;
unspecified cases were measured on the SDK).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.fbx_records import FbxObjects, Id, Record, name_of, numbers_of, within
from signsplice.motion import FloatArray, rotation
from signsplice.motion.face import shape_of

_HELD = 0x2
"""Key flag: the value is held until the next key."""
_LINEAR = 0x4
"""Key flag: linear interpolation to the next key."""
_NEXT = 0x100
"""Key flag: a held key shows the next key's value."""
_USER = 0x400
"""Key flag: the file gives the slopes."""
_BROKEN = 0x800
"""Key flag: the file gives different slopes on the left and right."""
_WEIGHTED_RIGHT = 0x1000000
"""Key flag: the file gives the weight of the right tangent."""
_WEIGHTED_NEXT_LEFT = 0x2000000
"""Key flag: the file gives the weight of the next key's left tangent."""
_THIRD = 1.0 / 3.0
"""Weight of a tangent with which time passes evenly."""
_UNIT = 1.0 / 9999.0
"""Files of version 7 store weights of tangents as whole numbers of this unit, as the SDK does."""
_HALVINGS = 40
"""Bisection steps that find the curve parameter of a time."""
_AT_KEY = 1e-7
"""If every frame is within this many seconds of its key, the frames have the keys' values."""


@dataclass(frozen=True)
class Tangents:
    """Interpolation after each of the K keys of a curve.

    flags: (K,) key flags for the span to the next key.
    slopes: (K, 2) units a second: right of the key, and left of the next one.
    weights: (K, 2) lengths of the tangents, as fractions of the time between the keys.
    """

    flags: NDArray[np.int64]
    slopes: FloatArray
    weights: FloatArray


@dataclass(frozen=True)
class KeyCurve:
    """The keys of one number.

    times: (K,) seconds, rising.
    values: (K,)
    read_tangents: reads the tangents; not called if only the values at the keys are needed.
    """

    times: FloatArray
    values: FloatArray
    read_tangents: Callable[[], Tangents]

    def at(self, times: FloatArray) -> FloatArray:
        """Sample the curve at ``times`` (T,); before the first key and after the last, hold the value there."""
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
        values = a + u * (b - a)
        if cubic.any():
            right_slopes, left_slopes = self._slopes(tangents)
            values[cubic] = _bezier(u, a, b, span, right_slopes[low], left_slopes[low], tangents.weights[low])[cubic]
        is_held = ((flags & _HELD) != 0) & (u > 0.0) & (u < 1.0)
        return np.where(is_held, np.where((flags & _NEXT) != 0, b, a), values)

    def _slopes(self, tangents: Tangents) -> tuple[FloatArray, FloatArray]:
        """Return slopes (K - 1,) after each key and before the next. An automatic slope is the mean of two: that of the
        chord between the neighbours, and that of both spans, the shorter weighing more.
        """
        steps = np.diff(self.values) / np.diff(self.times)
        right_slopes, left_slopes = tangents.slopes[:-1, 0].copy(), tangents.slopes[:-1, 1].copy()
        is_auto = (tangents.flags & (_USER | _BROKEN)) == 0
        auto = np.empty(len(self.times))
        auto[0], auto[-1] = steps[0], steps[-1]
        if len(steps) > 1:
            chord = (self.values[2:] - self.values[:-2]) / (self.times[2:] - self.times[:-2])
            weight = (self.times[1:-1] - self.times[:-2]) / (self.times[2:] - self.times[:-2])
            auto[1:-1] = 0.5 * (chord + (1.0 - weight) * steps[:-1] + weight * steps[1:])
        right_slopes[is_auto[:-1]] = auto[:-1][is_auto[:-1]]
        left_slopes[is_auto[1:]] = auto[1:][is_auto[1:]]
        return right_slopes, left_slopes


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
    selected = _select_keys(times, values)
    return KeyCurve(times[selected], values[selected], lambda: _read_tangents(record, as_bits, selected, len(times)))


def _read_tangents(record: Record, as_bits: bool, selected: NDArray[np.bool_] | slice, n_keys: int) -> Tangents:
    """Read the tangents of the ``selected`` ones of an ``AnimationCurve``'s ``n_keys`` keys; each row of its attributes
    applies to one or more keys.
    """
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
    return Tangents(*(np.repeat(rows, counts, axis=0)[selected] for rows in (flags, slopes, weights)))


def read_old_curve(record: Record, ticks: float) -> KeyCurve | None:
    """Read the curve of a ``Channel`` of version 6, or its constant; None if it has neither."""
    keys = record.find("Key")
    if keys is None or not keys.values:
        default = record.numbers("Default")
        return constant(float(default[0])) if len(default) else None
    rows = np.array(list(_old_keys(iter(keys.values))))  # (K, 7)
    times, values = rows[:, 0] / ticks, rows[:, 1]
    selected = _select_keys(times, values)
    rows = rows[selected]
    tangents = Tangents(rows[:, 2].astype(np.int64), rows[:, 3:5], np.clip(rows[:, 5:], 0.0, 1.0))
    return KeyCurve(times[selected], values[selected], lambda: tangents)


def _old_keys(values: Iterator[Any]) -> Iterator[tuple[float, ...]]:
    """Yield time (in the file's units), value, flags, two slopes and two weights of each key of a list.

    Letters follow a key's time and value. C: held (n: it shows the next key's value). L: linear. U: cubic (a: automatic
    slopes; s, b: two slopes follow), then whose tangents have a weight, which follows (a: both, r: right, l: left).
    """
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
    """Return a letter, which binary files hold as a number."""
    return chr(value) if isinstance(value, int) else str(value)


def constant(value: float) -> KeyCurve:
    """Return a constant curve."""
    return KeyCurve(np.zeros(1), np.array([value]), lambda: Tangents(np.zeros(1, np.int64), *np.zeros((2, 1, 2))))


def _select_keys(times: FloatArray, values: FloatArray) -> NDArray[np.bool_] | slice:
    """Select the keys to use: the last of those at the same time. Raises ``InputError`` if a number is not finite or
    times fall.
    """
    steps = times[1:] - times[:-1]
    if not (np.isfinite(times.sum()) and np.isfinite(values.sum())):
        raise InputError("a key is not finite")
    least = steps.min(initial=1.0)
    if least < 0.0:
        raise InputError("a curve's keys go back in time")
    return slice(None) if least > 0.0 else np.append(steps > 0.0, True)


MOVES = ("Lcl Translation", "Lcl Rotation", "Lcl Scaling")
"""The properties that move a model."""
PERCENT = "DeformPercent"
"""The property of a blend shape's channel for its strength, percent."""
_COLUMNS = {"d|X": 0, "d|Y": 1, "d|Z": 2, f"d|{PERCENT}": 0}
"""Name of a number of a property, as its curve is connected -> its place in ``Curves``."""
_OLD_CHANNELS = dict(zip("TRS", MOVES, strict=True))
"""Name of a ``Channel`` of version 6 -> property."""
_ADDITIVE = 0
"""Layer mode: adds to the layers below."""
_OVERRIDE = 1
"""Layer mode: replaces the layers below."""

Curves = tuple[KeyCurve | None, ...]
"""Curves of X, Y and Z, or of one number; None for a number without keys."""


@dataclass(frozen=True)
class Layer:
    """A layer of a take.

    curves: object and property -> curves.
    weight: strength in percent; None for the lowest layer, which always acts in full.
    mode: 0: adds to the layers below; 1: replaces them; else blends with them by its weight.
    by_axis: whether rotations are added angle by angle, not composed.
    adds_scales: whether scales are added, not multiplied.
    """

    curves: Mapping[tuple[Id, str], Curves]
    weight: KeyCurve | None = None
    mode: int = _ADDITIVE
    by_axis: bool = False
    adds_scales: bool = False

    def over(self, below: FloatArray, own: FloatArray, name: str, times: FloatArray, order: str) -> FloatArray:
        """Return the values (T, n) of property ``name`` with this layer: those of the layers below, combined with its
        own. ``order``: axes of the angles.
        """
        if self.weight is None:
            return own
        alpha = np.clip(self.weight.at(times) / 100.0, 0.0, 1.0)[:, None]
        if name == MOVES[1] and not self.by_axis:
            if self.mode == _OVERRIDE:  # the SDK then ignores the weight
                return own
            under, over = quats(below, order), quats(own, order)
            if self.mode == _ADDITIVE:
                return angles(rotation.multiply(under, rotation.slerp(rotation.IDENTITY, over, alpha[:, 0])), order)
            return angles(rotation.slerp(under, over, alpha[:, 0]), order)
        stays = {_ADDITIVE: 1.0, _OVERRIDE: 0.0}.get(self.mode, 1.0 - alpha)
        if name == MOVES[2] and not self.adds_scales:
            return np.copysign(np.abs(below) ** stays * np.abs(own) ** alpha, below * own)
        return stays * below + alpha * own


@dataclass(frozen=True)
class Take:
    """A take of a scene.

    name: the take's name.
    span: start and end in seconds, which may be equal if the file names none.
    layers: the layers with curves, lowest first.
    left_out: names of what it moves that is not read.
    """

    name: str
    span: tuple[float, float]
    layers: tuple[Layer, ...]
    left_out: tuple[str, ...] = ()

    def model_curves(self) -> Iterator[tuple[Id, Curves]]:
        """Yield (model, curves) for every property that moves a model, layer by layer."""
        for layer in self.layers:
            for (key, name), curves in layer.curves.items():
                if name in MOVES:
                    yield key, curves

    def values(self, key: Id, name: str, rest: FloatArray, times: FloatArray, order: str = "XYZ") -> FloatArray:
        """Return a property (T, n) at ``times`` (T,), or (1, n) if it is constant; ``rest``: its values (n,) in the
        file's own pose, for numbers without curves.
        """
        values = rest[None]
        for layer in self.layers:
            curves = layer.curves.get((key, name))
            if curves is None:
                continue
            without_curve = np.full(len(rest), float(name == MOVES[2])) if layer.mode == _ADDITIVE else rest
            layer_values = np.empty((len(times), len(rest)))
            for k, curve in enumerate(curves[: len(rest)]):
                layer_values[:, k] = without_curve[k] if curve is None else curve.at(times)
            values = layer.over(values, layer_values, name, times, order)
        return values[:1] if (values == values[0]).all() else values


def quats(degrees: FloatArray, order: str) -> FloatArray:
    """Return rotations (..., 4) of angles about X, Y and Z (..., 3), degrees, applied in an order."""
    columns = ["XYZ".index(axis) for axis in reversed(order)]
    return rotation.from_euler(np.deg2rad(degrees[..., columns]), order[::-1])


def angles(rotations: FloatArray, order: str) -> FloatArray:
    """Return angles about X, Y and Z (..., 3), degrees, of rotations (..., 4): the inverse of ``quats``."""
    columns = ["XYZ".index(axis) for axis in reversed(order)]
    return np.rad2deg(rotation.to_euler(rotations, order[::-1]))[..., np.argsort(columns)]


def read_takes(objects: FbxObjects, models: Collection[Id]) -> list[Take]:
    """Read the takes of a file, in its order."""
    if objects.has_old_takes:
        return [_old_take(objects, record) for record in within(objects.top, "Takes", ("Take",))]
    driven: dict[Id, list[tuple[Id, str]]] = defaultdict(list)  # by node of curves
    for key in (*models, *(key for key, _ in objects.all("Deformer", "BlendShapeChannel"))):
        for node, name in objects.on(key, "AnimationCurveNode"):
            if name in (*MOVES, PERCENT):
                driven[node].append((key, name))
    takes = []
    for key, record in objects.all("AnimationStack"):
        numbers = numbers_of(record)
        start, stop = (next(iter(numbers.get(name, ())), 0.0) / objects.ticks for name in ("LocalStart", "LocalStop"))
        layers = [_layer(objects, layer, driven) for layer, _ in objects.on(key, "AnimationLayer")]
        if layers and layers[0]:
            layers[0] = Layer(layers[0].curves)  # whatever its weight and mode
        takes.append(Take(name_of(record.values[1]), (start, stop), tuple(filter(None, layers))))
    return takes


def _layer(objects: FbxObjects, key: Id, driven: Mapping[Id, Sequence[tuple[Id, str]]]) -> Layer | None:
    """Read a layer; None if it has no curve or is muted. driven: node of curves -> objects and properties."""
    nodes = [*objects.on(key, "AnimationCurveNode")]
    curves = {moved: _curves(objects, node) for node, _ in nodes for moved in driven.get(node, ())}
    numbers = {name: values[0] for name, values in numbers_of(objects.records[key]).items()}
    if not curves or numbers.get("Mute"):
        return None
    weight = constant(float(numbers.get("Weight", 100.0)))
    for node, name in nodes:
        if name == "Weight":
            weight = next(filter(None, _curves(objects, node, "d|Weight")), weight)
    mode, by_axis, adds = (int(numbers.get(name, 0)) for name in
                           ("BlendMode", "RotationAccumulationMode", "ScaleAccumulationMode"))  # fmt: skip
    return Layer(curves, weight, mode, bool(by_axis), bool(adds))


def _curves(objects: FbxObjects, node: Id, single: str = "") -> Curves:
    """Read the curves of a node, of X, Y and Z or of one number; a number without curve is the node's constant.
    ``single``: name of the one number; if empty, one of ``_COLUMNS``.
    """
    columns = {single: 0} if single else _COLUMNS
    curves: list[KeyCurve | None] = [None] * 3
    for source, what in objects.on(node, "AnimationCurve"):
        if what in columns:
            curves[columns[what]] = read_curve(objects.records[source], objects.ticks, objects.has_bits)
    for name, values in numbers_of(objects.records[node]).items() if None in curves else ():
        if name in columns and curves[columns[name]] is None:
            curves[columns[name]] = constant(float(values[0]))
    return tuple(curves)


def _old_take(objects: FbxObjects, record: Record) -> Take:
    """Read a take of a file of version 6: nested channels by model."""
    span = (record.numbers("LocalTime") / objects.ticks).tolist()
    curves: dict[tuple[Id, str], Curves] = {}
    left_out = []
    for moved in record.all("Model"):
        for channel in moved.all("Channel"):
            if channel.values != ["Transform"]:
                if channel.find("Key") is not None and shape_of(str(*channel.values[:1])) is not None:
                    left_out.append(f"blend shape {channel.values[0]}")
                continue
            for part in channel.all("Channel"):
                name = _OLD_CHANNELS.get(str(part.values[0]), "")
                inner = {axis.values[0]: axis for axis in part.all("Channel") if axis.values}
                if name:
                    curves[moved.values[0], name] = tuple(
                        read_old_curve(inner[axis], objects.ticks) if axis in inner else None for axis in "XYZ"
                    )
    times = (span[0], span[1]) if len(span) == 2 else (0.0, 0.0)
    return Take(name_of(record.values[0]), times, (Layer(curves),) if curves else (), tuple(left_out))
