"""The models of an FBX scene, how they hang together, and their transforms over time.

A model's matrix is T Roff Rp Rpre R Rpost^-1 Rp^-1 Soff Sp S Sp^-1 (columns; "Transformation Data" in the FBX SDK's
documentation). A scale reaches the models below in one of three ways, by their ``InheritType``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.formats.fbx_curves import KeyCurve, constant, read_curve, read_old_curve
from signsplice.formats.fbx_records import MAGIC, Record, read_records
from signsplice.formats.gltf_skeleton import printable
from signsplice.formats.limits import ReadLimits
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray

Id = int | str
MOVES = ("Lcl Translation", "Lcl Rotation", "Lcl Scaling")
_ORDERS = ("XYZ", "XZY", "YZX", "YXZ", "ZXY", "ZYX", "XYZ")
"""By number: the axes in the order in which they act."""
_RATES = (30, 120, 100, 60, 50, 48, 30, 30, 30 / 1.001, 30 / 1.001, 25, 24, 1000, 24 / 1.001, 0, 96, 72, 60 / 1.001)
"""Frames a second by ``TimeMode``; 0: ``CustomFrameRate``."""
_TICKS, _NEW_TICKS, _OLD_DEFINITION, _DEFINED_FROM = 46186158000.0, 141120000.0, 127, 1004
"""Units of time in a second, of nearly all files and of those that say so in a header of at least this version."""
_SCALE_LAST, _SCALE_FIRST, _SCALE_NOT = 0, 1, 2
"""``InheritType``: the scale from above acts in the model's axes, in its parent's, or without its parent's own."""
_NEW_FORM, _BITS_FROM = 7000, 7200
"""From these versions on, takes are objects, and text files write the bits of key attributes as whole numbers."""
_AXES = {"d|X": 0, "d|Y": 1, "d|Z": 2}
_OLD_CHANNELS = dict(zip("TRS", MOVES, strict=True))
_WANTED = ("Model", "AnimationStack", "AnimationLayer", "AnimationCurveNode", "AnimationCurve", "Deformer", "Pose")


@dataclass(frozen=True)
class Model:
    """A model of a scene: a joint, an empty, a mesh.

    name, kind: as the file has them.
    numbers: property -> its numbers.
    """

    name: str
    kind: str
    numbers: Mapping[str, FloatArray]

    def vector(self, name: str, otherwise: float = 0.0) -> FloatArray:
        """A property of three numbers (3,)."""
        found = self.numbers.get(name, ())
        return np.array(found[:3]) if len(found) >= 3 else np.full(3, otherwise)

    def number(self, name: str, otherwise: int = 0) -> int:
        """A property of one whole number."""
        return int(next(iter(self.numbers.get(name, ())), otherwise))


@dataclass(frozen=True)
class Take:
    """A take of a scene.

    name: of the take.
    span: start and end in seconds, which may be equal where the file names none.
    curves: model and property -> curves of X, Y and Z, None for a number without keys.
    shapes: names of blend shapes that it moves.
    """

    name: str
    span: tuple[float, float]
    curves: Mapping[tuple[Id, str], tuple[KeyCurve | None, ...]]
    shapes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Transforms:
    """A model's transforms relative to the model above it, over T frames or one.

    quats: (T, 4) rotations.
    positions: (T, 3), scaled as what lies above scales them.
    scales: (T, 3) its own scale.
    scaling: (T, 3, 3) by how much its own axes are scaled, with all that lies above.
    """

    quats: FloatArray
    positions: FloatArray
    scales: FloatArray
    scaling: FloatArray


class FbxScene:
    """What a file holds.

    settings: property -> its numbers.
    models: id -> model.
    parents: model -> the model above it.
    order: all models, each after the one above it; without those that hang below themselves.
    takes: in the file's order.
    bound: model -> its rotation (4,) in the world in the pose in which skins are bound.
    skinned: models that carry skins.
    """

    def __init__(self, content: bytes, file: str, limits: ReadLimits) -> None:
        top, self._version = read_records(content, file, limits)
        self._is_text = not content.startswith(MAGIC[:20])
        settings, header = top.find("GlobalSettings"), top.find("FBXHeaderExtension")
        self.settings = {} if settings is None else _numbers(settings)
        self._ticks = _TICKS if header is None else _ticks(header)
        self._objects = {record.values[0]: record for record in _within(top, "Objects", _WANTED) if record.values}
        self.models = {key: _model(record) for key, record in self._objects.items() if record.name == "Model"}
        self.parents: dict[Id, Id] = {}
        self._sources: dict[Any, list[tuple[Any, str]]] = defaultdict(list)
        for record in _within(top, "Connections", ("C", "Connect")):
            _, source, target, what = (*record.values, "")[:4]
            self._sources[target].append((source, what))
            if source in self.models and target in self.models and not what:
                self.parents[source] = target
        self.order = self._order()
        self.takes = self._takes() if self._version >= _NEW_FORM else self._old_takes(top)
        self.bound, self.skinned = self._bind_rotations()

    @property
    def fps(self) -> float:
        """The frame rate that the file names."""
        mode = int(self._setting("TimeMode", 0))
        rate = _RATES[mode] if 0 <= mode < len(_RATES) else 0
        return float(rate or self._setting("CustomFrameRate", 0.0))

    @property
    def axes(self) -> FloatArray:
        """The matrix (3, 3) that takes the file's axes to X right, Y up, Z ahead; of determinant -1 where its axes are
        left-handed.
        """
        out = np.zeros((3, 3))
        for row, (name, usual) in enumerate((("Coord", 0), ("Up", 1), ("Front", 2))):
            out[row, int(self._setting(f"{name}Axis", usual)) % 3] = self._setting(f"{name}AxisSign", 1.0)
        return out if abs(np.linalg.det(out)) == 1.0 else np.eye(3)

    @property
    def metres(self) -> float:
        """The file's unit of length."""
        return self._setting("UnitScaleFactor", 1.0) / 100.0

    def transforms(self, key: Id, take: Take, times: FloatArray, above: Transforms | None) -> Transforms:
        """A model's transforms at ``times`` (T,) of a take; ``above``: those of the model above it."""
        model = self.models[key]
        moved, turned, scale = (self._moves(key, name, take, times) for name in MOVES)
        quats = _rotations(model, turned)
        pivot, scaling_pivot = model.vector("RotationPivot"), model.vector("ScalingPivot")
        inner = model.vector("ScalingOffset") + scaling_pivot - pivot - scale * scaling_pivot
        positions = moved + model.vector("RotationOffset") + pivot
        if inner.any():
            positions = positions + rotation.rotate(quats, inner)
        if above is None:
            return Transforms(quats, positions, scale, scale[:, None] * np.eye(3))
        positions = np.einsum("tab,tb->ta", above.scaling, positions)
        inherits = model.number("InheritType", _SCALE_FIRST)
        return Transforms(quats, positions, scale, _inherited(inherits, above, quats) * scale[:, None])

    def rest_rotation(self, key: Id, zero: bool) -> FloatArray:
        """A model's rotation (4,) as the file has it at rest, or, for ``zero``, with angles of 0."""
        model = self.models[key]
        return _rotations(model, np.zeros(3) if zero else model.vector(MOVES[1]))

    def _order(self) -> list[Id]:
        children: dict[Id | None, list[Id]] = defaultdict(list)
        for key in self.models:
            children[self.parents.get(key)].append(key)
        found, stack = [], children[None][::-1]
        while stack:
            found.append(key := stack.pop())
            stack += reversed(children[key])
        return found

    def _moves(self, key: Id, name: str, take: Take, times: FloatArray) -> FloatArray:
        """A property that moves, over T frames or one: (T, 3)."""
        rest = self.models[key].vector(name, 1.0 if name == MOVES[2] else 0.0)
        curves = take.curves.get((key, name))
        if curves is None:
            return rest[None]
        found = np.empty((len(times), 3))
        for k, curve in enumerate(curves):
            found[:, k] = rest[k] if curve is None else curve.at(times)
        return found[:1] if (found == found[0]).all() else found

    def _setting(self, name: str, otherwise: float) -> float:
        return float(next(iter(self.settings.get(name, ())), otherwise))

    def _takes(self) -> list[Take]:
        """The takes of a file of version 7: stacks of layers, which hold nodes of up to three curves."""
        takes = []
        for key, record in self._objects.items():
            if record.name != "AnimationStack":
                continue
            numbers = _numbers(record)
            start, stop = (next(iter(numbers.get(name, ())), 0.0) / self._ticks for name in ("LocalStart", "LocalStop"))
            layers = [source for source, _ in self._sources[key] if self._is(source, "AnimationLayer")]
            curves = next(filter(None, map(self._layer, layers)), {})
            takes.append(Take(_name(record.values[1]), (start, stop), curves, self._moved_shapes(layers)))
        return takes

    def _layer(self, layer: Id) -> dict[tuple[Id, str], tuple[KeyCurve | None, ...]]:
        """The curves of a layer by model and property."""
        nodes = {source for source, _ in self._sources[layer] if self._is(source, "AnimationCurveNode")}
        found: dict[tuple[Id, str], tuple[KeyCurve | None, ...]] = {}
        for model in self.models:
            for node, name in self._sources[model]:
                if node in nodes and name in MOVES:
                    found[model, name] = self._curves(node)
        return found

    def _curves(self, node: Id) -> tuple[KeyCurve | None, ...]:
        """The curves of X, Y and Z of a node; a number without curve is the node's own."""
        numbers = _numbers(self._objects[node])
        own = (numbers.get(f"d|{axis}") for axis in "XYZ")
        found = [None if value is None else constant(float(value[0])) for value in own]
        for source, what in self._sources[node]:
            if self._is(source, "AnimationCurve") and what in _AXES:
                curve = read_curve(self._objects[source], self._ticks, self._is_text and self._version >= _BITS_FROM)
                found[_AXES[what]] = curve or found[_AXES[what]]
        return tuple(found)

    def _moved_shapes(self, layers: Collection[Id]) -> tuple[str, ...]:
        """The names of blend shapes that layers move."""
        nodes = {source for layer in layers for source, _ in self._sources[layer]}
        shapes = [record for record in self._objects.values() if record.values[-1] == "BlendShapeChannel"]
        moved = [shape for shape in shapes if any(source in nodes for source, _ in self._sources[shape.values[0]])]
        return tuple(f"blend shape {_name(shape.values[1])}" for shape in moved)

    def _old_takes(self, top: Record) -> list[Take]:
        """The takes of a file of version 6: channels within channels, by model."""
        takes = []
        for record in _within(top, "Takes", ("Take",)):
            span = (record.numbers("LocalTime") / self._ticks).tolist()
            curves: dict[tuple[Id, str], tuple[KeyCurve | None, ...]] = {}
            for moved in record.all("Model"):
                channels = [part for part in moved.all("Channel") if part.values == ["Transform"]]
                for part in (part for channel in channels for part in channel.all("Channel")):
                    name = _OLD_CHANNELS.get(str(part.values[0]), "")
                    inner = {axis.values[0]: axis for axis in part.all("Channel") if axis.values}
                    axes = [read_old_curve(inner[axis], self._ticks) if axis in inner else None for axis in "XYZ"]
                    if name:
                        curves[moved.values[0], name] = tuple(axes)
            takes.append(Take(_name(record.values[0]), (span[0], span[1]) if len(span) == 2 else (0.0, 0.0), curves))
        return takes

    def _is(self, key: Id, kind: str) -> bool:
        return key in self._objects and self._objects[key].name == kind

    def _bind_rotations(self) -> tuple[dict[Id, FloatArray], set[Id]]:
        """Model -> rotation (4,) where its skin is bound or in a bind pose, and the models that carry skins."""
        found: dict[Id, FloatArray] = {}
        skinned = set()
        for record in self._objects.values():
            if record.name == "Pose" and record.values[-1] == "BindPose":
                for node in record.all("PoseNode"):
                    name = node.find("Node")
                    if name is not None and name.values:
                        found[name.values[0]] = node.numbers("Matrix")
        for key, record in self._objects.items():
            if record.name == "Deformer" and record.values[-1] == "Cluster":
                for source, _ in self._sources[key]:
                    found[source] = record.numbers("TransformLink")
                    skinned.add(source)
        usable = {key: matrix for key, matrix in found.items() if key in self.models and len(matrix) == 16}
        rotations = {key: _nearest_rotation(matrix.reshape(4, 4).T[:3, :3]) for key, matrix in usable.items()}
        return {key: quat for key, quat in rotations.items() if quat is not None}, skinned & {*self.models}


def _inherited(kind: int, above: Transforms, quats: FloatArray) -> FloatArray:
    """The scaling (T, 3, 3) that reaches a model with rotations ``quats`` from above."""
    if kind == _SCALE_NOT:
        return above.scaling / above.scales[..., None]
    scaling = above.scaling
    is_even = np.array_equal(scaling, scaling[:, :1, :1] * np.eye(3))
    if kind == _SCALE_LAST or is_even:
        return scaling
    matrices = rotation.to_matrix(quats)
    return np.asarray(matrices.swapaxes(-1, -2) @ scaling @ matrices)


def _rotations(model: Model, angles: FloatArray) -> FloatArray:
    """Rotations (..., 4) of a model for angles (..., 3) in degrees."""
    if not model.number("RotationActive"):  # the SDK then leaves out all below
        return _quats(angles, _ORDERS[0])
    order = model.number("RotationOrder")
    if not 0 <= order < len(_ORDERS):
        raise InputError(f"model {model.name!r:.80}: rotation order {order}, expected 0 to {len(_ORDERS) - 1}")
    quats = _quats(angles, _ORDERS[order])
    before, after = model.vector("PreRotation"), model.vector("PostRotation")
    if before.any():
        quats = rotation.multiply(_quats(before, "XYZ"), quats)
    return rotation.multiply(quats, rotation.inverse(_quats(after, "XYZ"))) if after.any() else quats


def _quats(angles: FloatArray, order: str) -> FloatArray:
    """Rotations (..., 4) of angles of X, Y and Z (..., 3) in degrees, which act in an order."""
    columns = ["XYZ".index(axis) for axis in reversed(order)]
    return rotation.from_euler(np.deg2rad(angles[..., columns]), order[::-1])


def _nearest_rotation(matrix: FloatArray) -> FloatArray | None:
    """The rotation (4,) nearest to a matrix (3, 3); None where there is none."""
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) == 0.0:
        return None
    u, _, vt = np.linalg.svd(matrix)
    return rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def _within(top: Record, name: str, kinds: Collection[str]) -> list[Record]:
    """The records of some kinds within a part of the file; none where it lacks the part."""
    part = top.find(name)
    return [] if part is None else [record for record in part.children if record.name in kinds]


def _numbers(record: Record) -> dict[str, FloatArray]:
    """Property -> its numbers, of a record's properties in the form of version 7 or 6."""
    found: dict[str, FloatArray] = {}
    for name, kind, first in (("Properties70", "P", 4), ("Properties60", "Property", 3)):
        part = record.find(name)
        for row in part.all(kind) if part is not None else ():
            numbers = row.values[first:]
            if numbers and all(isinstance(number, int | float) for number in numbers):
                found[row.values[0]] = np.array(numbers, np.float64)
    return found


def _model(record: Record) -> Model:
    """A model; its id, in files of version 6, is its name with the kind of record in front."""
    return Model(_name(record.values[-2]), str(record.values[-1]), _numbers(record))


def _name(text: Any) -> str:
    """A name without the kind of record that stands before it, or, in binary files, behind it."""
    return printable(str(text).split("\x00\x01")[0].rpartition("::")[2], "unnamed")


def _ticks(header: Record) -> float:
    """Units of time in a second, as a file's header defines them."""
    flags, version = header.find("OtherFlags"), header.numbers("FBXHeaderVersion")
    defined = np.empty(0) if flags is None else flags.numbers("TCDefinition")
    if len(defined) and len(version) and version[0] >= _DEFINED_FROM and defined[0] != _OLD_DEFINITION:
        return _NEW_TICKS
    return _TICKS
