"""The takes of an FBX file: curves by object and property, in stacked layers.

A layer adds to or overrides those below it, in proportion to its weight ("FbxAnimLayer" in the FBX SDK's documentation;
unspecified cases were measured on the SDK).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.formats.fbx_curves import KeyCurve, constant, read_curve, read_old_curve
from signsplice.formats.fbx_records import FbxObjects, Id, Record, name_of, within
from signsplice.motion import FloatArray, rotation
from signsplice.motion.face import shape_of

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

    def notes(self) -> tuple[str, ...]:
        """Return what no rule of the format reads in its curves, with the number of these curves."""
        tracks = (curves for layer in self.layers for curves in layer.curves.values())
        counts = Counter(oddity for curves in tracks for curve in curves if curve for oddity in curve.oddities)
        return tuple(f"curves with {oddity}: {count}" for oddity, count in counts.items())

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
        numbers = objects.numbers_of(record)
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
    numbers = {name: values[0] for name, values in objects.numbers_of(objects.records[key]).items()}
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
    for name, values in objects.numbers_of(objects.records[node]).items() if None in curves else ():
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
