"""The models of an FBX scene, their hierarchy, and their transforms over time.

A model's matrix is T Roff Rp Rpre R Rpost^-1 Rp^-1 Soff Sp S Sp^-1 (columns; "Transformation Data" in the FBX SDK's
documentation). Children inherit a scale in one of three ways, by their ``InheritType``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.fbx_records import FbxObjects, Id, Record, name_of, numbers_of, within
from signsplice.formats.fbx_takes import MOVES, Take, quats, read_takes
from signsplice.formats.reading import ReadLimits
from signsplice.motion import FloatArray, rotation

_BONES = ("LimbNode", "Limb", "Root")
"""Kinds of models that are joints."""
_NO_JOINT_KINDS = ("Mesh", "Camera", "Light", "Line", "NurbsCurve", "NurbsSurface")
"""Kinds of models that are no joints, even if they move."""
_ORDERS = ("XYZ", "XZY", "YZX", "YXZ", "ZXY", "ZYX", "XYZ")
"""By FBX number: axes in the order of their rotations."""
_RATES = (30, 120, 100, 60, 50, 48, 30, 30, 30 / 1.001, 30 / 1.001, 25, 24, 1000, 24 / 1.001, 0, 96, 72, 60 / 1.001,
          120 / 1.001)  # fmt: skip
"""Frames a second by ``TimeMode``; 0: ``CustomFrameRate``."""
_CUSTOM = 14
"""``TimeMode``: the rate is ``CustomFrameRate``."""
_SCALE_LAST = 0
"""``InheritType``: inherited scale acts in the model's own axes."""
_SCALE_FIRST = 1
"""``InheritType``: inherited scale acts in the parent's axes."""
_SCALE_NOT = 2
"""``InheritType``: inherited scale leaves out the parent's own scale."""


@dataclass(frozen=True)
class Model:
    """A model of a scene: a joint, an empty, a mesh.

    name, kind: as in the file.
    numbers: property -> its numbers.
    """

    name: str
    kind: str
    numbers: Mapping[str, FloatArray]

    def vector(self, name: str, otherwise: float = 0.0) -> FloatArray:
        """Return a property of three numbers (3,)."""
        numbers = self.numbers.get(name, ())
        return np.array(numbers[:3]) if len(numbers) >= 3 else np.full(3, otherwise)

    def number(self, name: str, otherwise: int = 0) -> int:
        """Return a property of one whole number."""
        return int(next(iter(self.numbers.get(name, ())), otherwise))

    @property
    def rotation_order(self) -> str:
        """The axes of its angles in the order of rotation. Raises ``InputError`` for an unknown order."""
        order = self.number("RotationOrder") if self.number("RotationActive") else 0
        if not 0 <= order < len(_ORDERS):
            raise InputError(f"model {self.name!r:.80}: rotation order {order}, expected 0 to {len(_ORDERS) - 1}")
        return _ORDERS[order]


@dataclass(frozen=True)
class Transforms:
    """A model's transforms relative to its parent, over T frames or one.

    quats: (T, 4) rotations.
    positions: (T, 3), with the scaling of the ancestors.
    scales: (T, 3) its own scale.
    scaling: (T, 3, 3) scaling of its axes, including its ancestors'.
    """

    quats: FloatArray
    positions: FloatArray
    scales: FloatArray
    scaling: FloatArray


class FbxScene:
    """The scene in a file.

    objects: all its objects.
    settings: property -> its numbers.
    models: id -> model.
    parents: model -> its parent.
    order: all models, parents first, without cycles.
    takes: in the file's order.
    binds: model -> its world matrix (4, 4) in the bind pose.
    bound: model -> its rotation (4,) in that pose.
    skinned: models that carry skins.
    """

    def __init__(self, content: bytes, file: str, limits: ReadLimits) -> None:
        self.objects = FbxObjects(content, file, limits)
        self.settings = _settings(self.objects.top)
        self.models = {  # in files of version 6 an id is a name with the kind of record in front
            key: Model(name_of(record.values[-2]), str(record.values[-1]), self.objects.numbers_of(record))
            for key, record in self.objects.all("Model")
        }
        self.parents: dict[Id, Id] = {
            source: target for target in self.models for source, what in self.objects.on(target, "Model") if not what
        }
        self.order = self._order()
        self.takes = read_takes(self.objects, self.models)
        self.binds, self.skinned = self._bind_matrices()
        rotations = {key: nearest_rotation(matrix[:3, :3]) for key, matrix in self.binds.items()}
        self.bound = {key: quat for key, quat in rotations.items() if quat is not None}

    @property
    def fps(self) -> float:
        """The file's frame rate; 0 if it names none."""
        mode = int(self._setting("TimeMode", 0))
        rate = _RATES[mode] if 0 <= mode < len(_RATES) else 0
        return float(rate or self._setting("CustomFrameRate", 0.0))

    @property
    def axes(self) -> FloatArray:
        """The matrix (3, 3) from the file's axes to X right, Y up, Z ahead; determinant -1 for left-handed axes."""
        matrix = np.zeros((3, 3))
        for row, (name, usual) in enumerate((("Coord", 0), ("Up", 1), ("Front", 2))):
            matrix[row, int(self._setting(f"{name}Axis", usual)) % 3] = self._setting(f"{name}AxisSign", 1.0)
        return matrix if abs(np.linalg.det(matrix)) == 1.0 else np.eye(3)

    @property
    def metres(self) -> float:
        """The file's unit of length, metres."""
        return self._setting("UnitScaleFactor", 1.0) / 100.0

    def transforms(self, key: Id, take: Take, times: FloatArray, above: Transforms | None) -> Transforms:
        """Return a model's transforms at ``times`` (T,) of a take; ``above``: its parent's."""
        model = self.models[key]
        moved, turned, scale = (self._moves(key, name, take, times) for name in MOVES)
        turned = _rotations(model, turned)
        pivot, scaling_pivot = model.vector("RotationPivot"), model.vector("ScalingPivot")
        inner = model.vector("ScalingOffset") + scaling_pivot - pivot - scale * scaling_pivot
        positions = moved + model.vector("RotationOffset") + pivot
        if inner.any():
            positions = positions + rotation.rotate(turned, inner)
        if above is None:
            return Transforms(turned, positions, scale, scale[:, None] * np.eye(3))
        positions = np.einsum("tab,tb->ta", above.scaling, positions)
        inherits = model.number("InheritType", _SCALE_FIRST)
        return Transforms(turned, positions, scale, _parent_scaling(inherits, above, turned) * scale[:, None])

    def to_axes(self, quats: FloatArray) -> None:
        """Convert rotations (..., 4), in place, from the file's axes to X right, Y up, Z ahead."""
        quats[..., :3] = np.linalg.det(self.axes) * quats[..., :3] @ self.axes.T

    def skeletons(self) -> list[list[Id]]:
        """Return the joints of each skeleton, parents first: bones, or if the file has none, moving models and those
        below them.
        """
        joints = {key for key in self.order if self.models[key].kind in _BONES or key in self.skinned}
        if not joints:
            moved = {key for take in self.takes for key, _ in take.model_curves()}
            for key in self.order:
                is_below = key in moved or self.parents.get(key) in joints
                if is_below and self.models[key].kind not in _NO_JOINT_KINDS:
                    joints.add(key)
        tops: dict[Id, Id] = {}
        skeletons: dict[Id, list[Id]] = {}
        for key in self.order:
            parent = self.parents.get(key)
            if parent in tops:
                tops[key] = tops[parent]
            elif key in joints:
                tops[key] = key
            if key in joints:
                skeletons.setdefault(tops[key], []).append(key)
        return list(skeletons.values())

    def parent_rows(self, order: Sequence[Id]) -> NDArray[np.intp]:
        """Return for each of some models the row of its nearest ancestor among them, -1 for none."""
        rows = {key: row for row, key in enumerate(order)}
        rows_above = []
        for key in order:
            parent = self.parents.get(key)
            while parent is not None and parent not in rows:
                parent = self.parents.get(parent)
            rows_above.append(-1 if parent is None else rows[parent])
        return np.array(rows_above, np.intp)

    def rest_rotation(self, key: Id, zero: bool) -> FloatArray:
        """Return a model's rotation (4,) at rest in the file, or, with ``zero``, for angles of 0."""
        model = self.models[key]
        return _rotations(model, np.zeros(3) if zero else model.vector(MOVES[1]))

    def _order(self) -> list[Id]:
        children: dict[Id | None, list[Id]] = defaultdict(list)
        for key in self.models:
            children[self.parents.get(key)].append(key)
        order, stack = [], children[None][::-1]
        while stack:
            order.append(key := stack.pop())
            stack += reversed(children[key])
        return order

    def _moves(self, key: Id, name: str, take: Take, times: FloatArray) -> FloatArray:
        """Return an animated property over T frames or one: (T, 3)."""
        model = self.models[key]
        rest = model.vector(name, 1.0 if name == MOVES[2] else 0.0)
        return take.values(key, name, rest, times, model.rotation_order)

    def _setting(self, name: str, otherwise: float) -> float:
        return float(next(iter(self.settings.get(name, ())), otherwise))

    def _bind_matrices(self) -> tuple[dict[Id, FloatArray], set[Id]]:
        """Return the matrices of ``binds``, and the models that carry skins."""
        stored: dict[Id, FloatArray] = {}
        skinned = set()
        for _, record in self.objects.all("Pose", "BindPose"):
            for node in record.all("PoseNode"):
                name = node.find("Node")
                if name is not None and name.values:
                    stored[name.values[0]] = node.numbers("Matrix")
        for key, record in self.objects.all("Deformer", "Cluster"):
            for source, _ in self.objects.on(key, "Model"):
                stored[source] = record.numbers("TransformLink")
                skinned.add(source)
        usable = {key: cells for key, cells in stored.items() if key in self.models and len(cells) == 16}
        return {key: cells.reshape(4, 4).T for key, cells in usable.items()}, skinned


def _settings(top: Record) -> dict[str, FloatArray]:
    """Return the file's settings: property -> numbers. Version 6 keeps them among the objects, where later ones count,
    and the frame rate in settings of version 5 besides.
    """
    settings: dict[str, FloatArray] = {}
    for record in (*top.all("GlobalSettings"), *within(top, "Objects", ("GlobalSettings",))):
        settings |= numbers_of(record)
    if not settings.get("TimeMode", np.zeros(1))[0]:
        for record in within(top, "Version5", ("Settings",)):
            rate = record.find("FrameRate")
            text = "" if rate is None else str(*rate.values[:1])
            if text.replace(".", "", 1).isdigit():
                settings |= {"TimeMode": np.array([float(_CUSTOM)]), "CustomFrameRate": np.array([float(text)])}
    return settings


def _parent_scaling(kind: int, above: Transforms, quats: FloatArray) -> FloatArray:
    """Return the scaling (T, 3, 3) that a model with rotations ``quats`` inherits."""
    if kind == _SCALE_NOT:
        return above.scaling / above.scales[..., None]
    scaling = above.scaling
    is_even = np.array_equal(scaling, scaling[:, :1, :1] * np.eye(3))
    if kind == _SCALE_LAST or is_even:
        return scaling
    matrices = rotation.to_matrix(quats)
    return np.asarray(matrices.swapaxes(-1, -2) @ scaling @ matrices)


def _rotations(model: Model, degrees: FloatArray) -> FloatArray:
    """Return a model's rotations (..., 4) for angles (..., 3), degrees."""
    turned = quats(degrees, model.rotation_order)
    if not model.number("RotationActive"):  # the SDK then ignores the pre- and post-rotation
        return turned
    before, after = model.vector("PreRotation"), model.vector("PostRotation")
    if before.any():
        turned = rotation.multiply(quats(before, "XYZ"), turned)
    return rotation.multiply(turned, rotation.inverse(quats(after, "XYZ"))) if after.any() else turned


def nearest_rotation(matrix: FloatArray) -> FloatArray | None:
    """Return the rotation (4,) nearest to a matrix (3, 3); None for a singular or non-finite one."""
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) == 0.0:
        return None
    return rotation.nearest(matrix)
