"""The takes of an FBX file: curves by object and property, in layers that lie on one another.

A layer adds to those below it or goes over them, as strongly as its weight says ("FbxAnimLayer" in the FBX SDK's
documentation; what it leaves open was measured on the SDK).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.formats.fbx_curves import KeyCurve, constant, read_curve, read_old_curve
from signsplice.formats.fbx_objects import FbxObjects, Id, name_of, numbers_of, within
from signsplice.formats.fbx_records import Record
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.face import shape_of

MOVES = ("Lcl Translation", "Lcl Rotation", "Lcl Scaling")
PERCENT = "DeformPercent"
"""The property of a blend shape's channel that says how strong it is."""
_COLUMNS = {"d|X": 0, "d|Y": 1, "d|Z": 2, f"d|{PERCENT}": 0}
_OLD_CHANNELS = dict(zip("TRS", MOVES, strict=True))
_ADDITIVE, _OVERRIDE = 0, 1

Curves = tuple[KeyCurve | None, ...]
"""Of X, Y and Z, or of one number; None for a number without keys."""


@dataclass(frozen=True)
class Layer:
    """A layer of a take.

    curves: object and property -> curves.
    weight: how strongly it acts, in percent; None for the lowest layer, which always acts in full.
    mode: 0 where it adds to what lies below, 1 where nothing of that stays, else as much stays as its weight leaves.
    by_axis: whether rotations are added angle by angle, not composed.
    adds_scales: whether scales are added, not multiplied.
    """

    curves: Mapping[tuple[Id, str], Curves]
    weight: KeyCurve | None = None
    mode: int = _ADDITIVE
    by_axis: bool = False
    adds_scales: bool = False

    def over(self, below: FloatArray, own: FloatArray, name: str, times: FloatArray, order: str) -> FloatArray:
        """Values (T, n) of a property with those of this layer over those below; ``order``: axes of the angles."""
        if self.weight is None:
            return own
        alpha = np.clip(self.weight.at(times) / 100.0, 0.0, 1.0)[:, None]
        if name == MOVES[1] and not self.by_axis:
            if self.mode == _OVERRIDE:  # the SDK then leaves out the weight
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

    name: of the take.
    span: start and end in seconds, which may be equal where the file names none.
    layers: from the lowest up, those that have curves.
    left_out: what it moves that is not read.
    """

    name: str
    span: tuple[float, float]
    layers: tuple[Layer, ...]
    left_out: tuple[str, ...] = ()

    def moved(self) -> Iterator[tuple[Id, Curves]]:
        """Each model that has curves, with those of a property."""
        for layer in self.layers:
            for (key, name), curves in layer.curves.items():
                if name in MOVES:
                    yield key, curves

    def values(self, key: Id, name: str, rest: FloatArray, times: FloatArray, order: str = "XYZ") -> FloatArray:
        """A property (T, n) at ``times`` (T,), or (1, n) where it does not change; ``rest``: (n,) without curves."""
        found = rest[None]
        for layer in self.layers:
            curves = layer.curves.get((key, name))
            if curves is None:
                continue
            still = np.full(len(rest), float(name == MOVES[2])) if layer.mode == _ADDITIVE else rest
            own = np.empty((len(times), len(rest)))
            for k, curve in enumerate(curves[: len(rest)]):
                own[:, k] = still[k] if curve is None else curve.at(times)
            found = layer.over(found, own, name, times, order)
        return found[:1] if (found == found[0]).all() else found


def quats(degrees: FloatArray, order: str) -> FloatArray:
    """Rotations (..., 4) of angles of X, Y and Z (..., 3) in degrees, which act in an order."""
    columns = ["XYZ".index(axis) for axis in reversed(order)]
    return rotation.from_euler(np.deg2rad(degrees[..., columns]), order[::-1])


def angles(rotations: FloatArray, order: str) -> FloatArray:
    """The angles (..., 3) of X, Y and Z in degrees of rotations (..., 4): ``quats`` backwards."""
    columns = ["XYZ".index(axis) for axis in reversed(order)]
    return np.rad2deg(rotation.to_euler(rotations, order[::-1]))[..., np.argsort(columns)]


def read_takes(objects: FbxObjects, models: Collection[Id]) -> list[Take]:
    """The takes of a file, in its order."""
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
    """A layer; None where it has no curve or is muted. driven: by node of curves the objects and properties."""
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
    """The curves of X, Y and Z, or of one number, of a node; a number without curve is the node's own."""
    columns = {single: 0} if single else _COLUMNS
    found: list[KeyCurve | None] = [None] * 3
    for source, what in objects.on(node, "AnimationCurve"):
        if what in columns:
            found[columns[what]] = read_curve(objects.records[source], objects.ticks, objects.has_bits)
    for name, values in numbers_of(objects.records[node]).items() if None in found else ():
        if name in columns and found[columns[name]] is None:
            found[columns[name]] = constant(float(values[0]))
    return tuple(found)


def _old_take(objects: FbxObjects, record: Record) -> Take:
    """A take of a file of version 6: channels within channels, by model."""
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
