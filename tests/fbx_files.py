"""FBX files written by hand, as text of versions 7.4 and 6.1 and as binary, and where their models are by products of
matrices.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from signsplice.body.capsules import Avatar, MeshPart
from signsplice.formats.fbx_records import MAGIC, Record, read_records
from signsplice.motion import FloatArray, kinematics

TICKS = 46186158000
ORDERS = ("XYZ", "XZY", "YZX", "YXZ", "ZXY", "ZYX")
MOVES = {"T": "Lcl Translation", "R": "Lcl Rotation", "S": "Lcl Scaling"}
Keys = Sequence[tuple[float, float]]
SIDES = ("Pre-Extrapolation", "Post-Extrapolation")


@dataclass(frozen=True)
class Curve:
    """Keys with flags, each with its own or all with one; ``numbers``: the bits of four attributes for each flag;
    ``beyond``: before the first key and after the last, as a letter and a count, "R 2".
    """

    keys: Keys
    flags: Sequence[int]
    numbers: Sequence[Sequence[int | str]]
    beyond: Sequence[str] = ("C -1", "C -1")

    def extrapolation(self) -> list[str]:
        pairs = [(side, *beyond.split()) for side, beyond in zip(SIDES, self.beyond, strict=True) if beyond != "C -1"]
        return [f"\t\t{side}: {{\n\t\t\tType: {kind}\n\t\t\tRepetition: {count}\n\t\t}}" for side, kind, count in pairs]


@dataclass(frozen=True)
class Over:
    """A layer over the first: the moves of its nodes, and its properties (``Weight``, ``BlendMode``, ...) by name."""

    nodes: Sequence[Node]
    more: Mapping[str, float] = field(default_factory=dict)
    weights: Keys = ()


@dataclass(frozen=True)
class Node:
    """A model; ``moves``: (T, R or S, axis) -> keys of time and value; ``curves``: the same with flags, in version 7;
    ``more``: other properties by name.
    """

    name: str
    parent: str = ""
    at: Sequence[float] = (0.0, 0.0, 0.0)
    turned: Sequence[float] = (0.0, 0.0, 0.0)
    scale: Sequence[float] = (1.0, 1.0, 1.0)
    kind: str = "LimbNode"
    order: int = 0
    inherit: int = 1
    more: Mapping[str, Sequence[float]] = field(default_factory=dict)
    moves: Mapping[tuple[str, int], Keys] = field(default_factory=dict)
    curves: Mapping[tuple[str, int], Curve] = field(default_factory=dict)

    def properties(self) -> dict[str, Sequence[float]]:
        own = {MOVES["T"]: self.at, MOVES["R"]: self.turned, MOVES["S"]: self.scale}
        return (
            own
            | dict(self.more)
            | {"RotationOrder": (self.order,), "InheritType": (self.inherit,), "RotationActive": (1,)}
        )

    def value(self, move: str, times: FloatArray) -> FloatArray:
        """(T, 3) with straight lines between keys."""
        rest = {"T": self.at, "R": self.turned, "S": self.scale}[move]
        columns = []
        for axis in range(3):
            keys = self.moves.get((move, axis), ((0.0, rest[axis]),))
            columns.append(np.interp(times, [key[0] for key in keys], [key[1] for key in keys]))
        return np.stack(columns, axis=1)


def positions(nodes: Sequence[Node], times: FloatArray) -> dict[str, FloatArray]:
    """Name -> positions (T, 3) in the file's axes and unit, by the matrices of the FBX SDK's documentation."""
    rotations: dict[str, FloatArray] = {}  # of the world, without scale
    linear: dict[str, FloatArray] = {}
    origins: dict[str, FloatArray] = {}
    for node in nodes:
        vector = {name: np.array(values, float) for name, values in node.more.items()}
        zero = np.zeros(3)
        axes = ORDERS[node.order]
        angles = node.value("R", times)[:, ["XYZ".index(axis) for axis in axes]]
        r = Rotation.from_euler(axes.lower(), angles, degrees=True).as_matrix()  # lower case: about fixed axes
        pre = Rotation.from_euler("xyz", vector.get("PreRotation", zero), degrees=True).as_matrix()
        post = Rotation.from_euler("xyz", vector.get("PostRotation", zero), degrees=True).as_matrix()
        r = pre @ r @ post.T
        s = node.value("S", times)[:, :, None] * np.eye(3)
        pivot, offset = vector.get("RotationPivot", zero), vector.get("RotationOffset", zero)
        spivot, soffset = vector.get("ScalingPivot", zero), vector.get("ScalingOffset", zero)
        inner = soffset + spivot - (s @ spivot)
        at = node.value("T", times) + offset + pivot + np.einsum("tab,tb->ta", r, inner - pivot)
        if not node.parent:
            rotations[node.name], linear[node.name], origins[node.name] = r, r @ s, at
            continue
        over_r, over = rotations[node.parent], linear[node.parent]
        parent = next(other for other in nodes if other.name == node.parent)
        shear = over_r.swapaxes(1, 2) @ over
        if node.inherit == 1:
            linear[node.name] = over @ r @ s
        elif node.inherit == 0:
            linear[node.name] = over_r @ r @ shear @ s
        else:
            own = parent.value("S", times)[:, :, None] * np.eye(3)
            linear[node.name] = over_r @ r @ np.linalg.inv(own) @ shear @ s
        rotations[node.name] = over_r @ r
        origins[node.name] = origins[node.parent] + np.einsum("tab,tb->ta", over, at)
    return origins


def text_7(
    nodes: Sequence[Node],
    settings: Mapping[str, float] | None = None,
    takes: Mapping[str, Sequence[Node]] | None = None,
    span: tuple[float, float] = (0.0, 1.0),
    flags: int = 4,
    attributes: str = "0,0,0,0",
    over: Sequence[Over] = (),
    templates: Mapping[str, Mapping[str, Sequence[float]]] | None = None,
) -> bytes:
    """A text file of version 7.4; ``takes``: name -> nodes whose moves it has, by default one of ``nodes``' own;
    ``over``: layers of the first take over its first one.

    ``flags``, ``attributes``: of all keys, by default straight lines. ``templates``: name of a record and of a class,
    "Model FbxNode" -> properties.
    """
    ids = {node.name: 1000 + n for n, node in enumerate(nodes)}
    lines = [
        "; FBX 7.4.0 project file",
        "FBXHeaderExtension:  {",
        "\tFBXHeaderVersion: 1003",
        "\tFBXVersion: 7400",
        "}",
    ]
    lines += ["GlobalSettings:  {", "\tVersion: 1000", "\tProperties70:  {"]
    usual = {"UpAxis": 1, "UpAxisSign": 1, "FrontAxis": 2, "FrontAxisSign": 1, "CoordAxis": 0, "CoordAxisSign": 1}
    for name, value in (usual | {"UnitScaleFactor": 1.0, "TimeMode": 6} | dict(settings or {})).items():
        kind = {"UnitScaleFactor": '"double", "Number"', "TimeMode": '"enum", ""'}.get(name, '"int", "Integer"')
        lines.append(f'\t\tP: "{name}", {kind}, "",{value}')
    lines += ["\t}", "}", "Objects:  {"]
    links = []
    for node in nodes:
        own = ids[node.name]
        if node.kind == "LimbNode":
            lines += [
                f'\tNodeAttribute: {own + 500}, "NodeAttribute::", "LimbNode" {{',
                '\t\tTypeFlags: "Skeleton"',
                "\t}",
            ]
            links.append(f'C: "OO",{own + 500},{own}')
        lines += [f'\tModel: {own}, "Model::{node.name}", "{node.kind}" {{', "\t\tVersion: 232", "\t\tProperties70:  {"]
        for name, values in node.properties().items():
            lines.append(f'\t\t\tP: "{name}", {_kind(name, values)}, "A",{",".join(map(repr, values))}')
        lines += ["\t\t}", "\t\tShading: Y", "\t}"]
        links.append(f'C: "OO",{own},{ids.get(node.parent, 0)}')
    for number, (take, moving) in enumerate((takes or {"Take 001": nodes}).items()):
        stack, layers = 10 + number, [Over(moving), *(over if number == 0 else ())]
        for level, layer in enumerate(layers):
            made, links_made = _layer(30 + number + 10 * level, layer, ids, flags, attributes.split(","), stack)
            lines, links = lines + made, links + links_made
        lines += [f'\tAnimationStack: {stack}, "AnimStack::{take}", "" {{', "\t\tProperties70:  {"]
        for name, seconds in (("LocalStart", span[0]), ("LocalStop", span[1])):
            lines.append(f'\t\t\tP: "{name}", "KTime", "Time", "",{round(seconds * TICKS)}')
        lines += ["\t\t}", "\t}"]
    links = [f"\t{link}" for link in links]
    return _with_definitions([*lines, "}", "Connections:  {", *links, "}"], templates or {})


def _layer(
    key: int, layer: Over, ids: Mapping[str, int], flags: int, attributes: Sequence[str], stack: int
) -> tuple[list[str], list[str]]:
    """The objects of a layer, and their connections."""
    lines, links = [f'\tAnimationLayer: {key}, "AnimLayer::{key}", "" {{', "\t\tProperties70:  {"], []
    for name, value in layer.more.items():
        kind = {"Weight": '"Number", ""', "Mute": '"bool", ""'}.get(name, '"enum", ""')
        lines.append(f'\t\t\tP: "{name}", {kind}, "A",{value}')
    lines += ["\t\t}", "\t}"]
    links.append(f'C: "OO",{key},{stack}')
    for node in layer.nodes:
        for n, move in enumerate("TRS"):
            curves = {key: Curve(keys, [flags], [attributes]) for key, keys in node.moves.items()} | {**node.curves}
            axes = [axis for kind, axis in curves if kind == move]
            at = 100_000 * (key - 29) + 10 * (10 * ids[node.name] + n)
            if axes:
                lines += _curve_node(at, node, move)
                links += [f'C: "OO",{at},{key}', f'C: "OP",{at},{ids[node.name]}, "{MOVES[move]}"']
            for axis in axes:
                lines += _curve(at + axis + 1, curves[move, axis])
                links.append(f'C: "OP",{at + axis + 1},{at}, "d|{"XYZ"[axis]}"')
    if layer.weights:
        at = 100_000 * (key - 29)
        lines += [f'\tAnimationCurveNode: {at}, "AnimCurveNode::Weight", "" {{', "\t\tProperties70:  {",
                  '\t\t\tP: "d|Weight", "Number", "", "A",100', "\t\t}", "\t}"]  # fmt: skip
        lines += _curve(at + 1, Curve(layer.weights, [flags], [attributes]))
        links += [f'C: "OO",{at},{key}', f'C: "OP",{at},{key}, "Weight"', f'C: "OP",{at + 1},{at}, "d|Weight"']
    return lines, links


def _kind(name: str, values: Sequence[float]) -> str:
    """The type of a property, as the file names it."""
    if name == "RotationActive":
        return '"bool", ""'
    if name in MOVES.values():
        return f'"{name}", ""'
    return '"enum", ""' if len(values) == 1 else '"Vector3D", "Vector"'


def _curve_node(at: int, node: Node, move: str) -> list[str]:
    rest = {"T": node.at, "R": node.turned, "S": node.scale}[move]
    numbers = [f'\t\t\tP: "d|{axis}", "Number", "", "A",{rest[k]}' for k, axis in enumerate("XYZ")]
    return [
        f'\tAnimationCurveNode: {at}, "AnimCurveNode::{move}", "" {{',
        "\t\tProperties70:  {",
        *numbers,
        "\t\t}",
        "\t}",
    ]


def _curve(at: int, curve: Curve) -> list[str]:
    keys, n_rows = curve.keys, len(curve.flags)
    lines = [f'\tAnimationCurve: {at}, "AnimCurve::", "" {{', f"\t\tDefault: {keys[0][1]}", "\t\tKeyVer: 4008"]
    for name, cells in (
        ("KeyTime", [round(key[0] * TICKS) for key in keys]),
        ("KeyValueFloat", [key[1] for key in keys]),
        ("KeyAttrFlags", curve.flags),
        ("KeyAttrDataFloat", [number for row in curve.numbers for number in row]),
        ("KeyAttrRefCount", [1] * n_rows if n_rows == len(keys) else [len(keys)]),
    ):
        lines += [f"\t\t{name}: *{len(cells)} {{", f"\t\t\ta: {','.join(map(str, cells))}", "\t\t}"]
    return [*lines, *curve.extrapolation(), "\t}"]


def text_6(nodes: Sequence[Node], span: tuple[float, float] = (0.0, 1.0), rule: str = "L") -> bytes:
    """A text file of version 6.1 with one take; ``rule``: of all keys, by default straight lines."""
    lines = [
        "; FBX 6.1.0 project file",
        "FBXHeaderExtension:  {",
        "\tFBXHeaderVersion: 1003",
        "\tFBXVersion: 6100",
        "}",
    ]
    lines += ["Objects:  {"]
    for node in nodes:
        lines += [
            f'\tModel: "Model::{node.name}", "{"Limb" if node.kind == "LimbNode" else node.kind}" {{',
            "\t\tVersion: 232",
            "\t\tProperties60:  {",
        ]
        for name, values in node.properties().items():
            lines.append(f'\t\t\tProperty: "{name}", {_kind(name, values)},{",".join(map(repr, values))}')
        lines += [
            "\t\t}",
            "\t\tMultiLayer: 0",
            "\t\tShading: Y",
            '\t\tCulling: "CullingOff"',
            '\t\tTypeFlags: "Skeleton"',
            "\t}",
        ]
    lines += [
        "\tGlobalSettings: {",
        "\t\tVersion: 1000",
        "\t\tProperties60:  {",
        '\t\t\tProperty: "UnitScaleFactor", "double", "",1',
        "\t\t}",
        "\t}",
        "}",
        "Connections:  {",
    ]
    lines += [f'\tConnect: "OO", "Model::{node.name}", "Model::{node.parent or "Scene"}"' for node in nodes]
    lines += ["}", "Takes:  {", '\tCurrent: "Take 001"', '\tTake: "Take 001" {', '\t\tFileName: "Take_001.tak"']
    lines += [
        f"\t\t{name}: {round(span[0] * TICKS)},{round(span[1] * TICKS)}" for name in ("LocalTime", "ReferenceTime")
    ]
    for node in nodes:
        if not node.moves:
            continue
        lines += [f'\t\tModel: "Model::{node.name}" {{', "\t\t\tVersion: 1.1", '\t\t\tChannel: "Transform" {']
        for n, move in enumerate("TRS"):
            rest = {"T": node.at, "R": node.turned, "S": node.scale}[move]
            lines += [f'\t\t\t\tChannel: "{move}" {{']
            for axis, letter in enumerate("XYZ"):
                keys = node.moves.get((move, axis), ())
                lines += [
                    f'\t\t\t\t\tChannel: "{letter}" {{',
                    f"\t\t\t\t\t\tDefault: {rest[axis]}",
                    "\t\t\t\t\t\tKeyVer: 4005",
                    f"\t\t\t\t\t\tKeyCount: {len(keys)}",
                ]
                if keys:
                    lines.append("\t\t\t\t\t\tKey: " + ",\n\t".join(f"{round(t * TICKS)},{v},{rule}" for t, v in keys))
                lines += ["\t\t\t\t\t}"]
            lines += [f"\t\t\t\t\tLayerType: {n + 1}", "\t\t\t\t}"]
        lines += ["\t\t\t}", "\t\t}"]
    lines += ["\t}", "}"]
    return _with_definitions(lines)


def _with_definitions(
    lines: Sequence[str], templates: Mapping[str, Mapping[str, Sequence[float]]] | None = None
) -> bytes:
    """The file of lines with the counts of its objects, without which the FBX SDK reads none, and templates."""
    top = lines.index("Objects:  {")
    stop = lines.index("}", top)
    names = [
        line.split(":")[0].strip() for line in lines[top + 1 : stop] if line.startswith("\t") and line[1] not in "\t}"
    ]
    counts = []
    for name in dict.fromkeys([*names, *(key.split()[0] for key in templates or ())]):
        counts += [f'\tObjectType: "{name}" {{', f"\t\tCount: {names.count(name)}"]
        for key, properties in (templates or {}).items():
            if key.split()[0] == name:
                rows = [
                    f'\t\t\t\tP: "{what}", {_kind(what, values)}, "A",{",".join(map(repr, values))}'
                    for what, values in properties.items()
                ]
                head = f'\t\tPropertyTemplate: "{key.split()[1]}" {{'
                counts += [head, "\t\t\tProperties70:  {", *rows, "\t\t\t}", "\t\t}"]
        counts.append("\t}")
    definitions = ["Definitions:  {", "\tVersion: 100", f"\tCount: {len(names)}", *counts, "}"]
    return ("\n".join([*lines[:top], *definitions, *lines[top:]]) + "\n").encode()


ARRAYS = {"KeyTime": "l", "KeyValueFloat": "f", "KeyAttrFlags": "i", "KeyAttrDataFloat": "I", "KeyAttrRefCount": "i"}
"""Record of a list of numbers -> type; I: bits, which are written as numbers of 32 bits."""


def as_binary(text: bytes, version: int = 7400, arrays: Mapping[str, np.ndarray] | None = None) -> bytes:
    """The same file of version 7 in the binary form; texts that are names of ``arrays`` become these, packed."""
    wide = version >= 7500
    at = len(MAGIC) + 4
    body = b""
    for record in read_records(text, "text.fbx")[0].children:
        body += _binary(record, at + len(body), wide, arrays or {})
    return MAGIC + struct.pack("<I", version) + body + bytes(25 if wide else 13)


def _binary(record: Record, at: int, wide: bool, arrays: Mapping[str, np.ndarray]) -> bytes:
    if record.name in ARRAYS:
        kind, numbers = ARRAYS[record.name], next(child.values for child in record.children)
        size = 8 if kind == "l" else 4
        code, raw = kind.replace("I", "f").encode(), [int(n) & 0xFFFFFFFF if kind == "I" else n for n in numbers]
        cells = struct.pack(f"<{len(raw)}{kind.replace('l', 'q')}", *raw)
        values, n_values, children = code + struct.pack("<III", len(raw), 0, size * len(raw)) + cells, 1, list[Record]()
    else:
        cells = b"".join(_packed(arrays[value]) if value in arrays else _scalar(value) for value in record.values)
        values, n_values, children = cells, len(record.values), record.children
    head = "<QQQB" if wide else "<IIIB"
    start = at + struct.calcsize(head) + len(record.name) + len(values)
    below = b""
    for child in children:
        below += _binary(child, start + len(below), wide, arrays)
    below += bytes(struct.calcsize(head)) if children else b""
    return struct.pack(head, start + len(below), n_values, len(values), len(record.name)) + (
        record.name.encode() + values + below
    )


def _packed(values: np.ndarray) -> bytes:
    packed = zlib.compress(values.tobytes())
    return {"f": b"d", "i": b"i"}[values.dtype.kind] + struct.pack("<III", values.size, 1, len(packed)) + packed


def character(avatar: Avatar, parts: Sequence[MeshPart], others: Sequence[Node] = (), n_shapes: int = 0) -> bytes:
    """A binary file with an avatar in one mesh of parts, four weights a vertex, and blend shapes of its first 20,000
    vertices. others: further models.
    """
    nodes = [Node(name, avatar.names[parent] if parent >= 0 else "", 100.0 * offset)
             for name, parent, offset in zip(avatar.names, avatar.parents, avatar.offsets, strict=True)]  # fmt: skip
    nodes = [replace(node, at=tuple(map(float, node.at))) for node in nodes]
    lines = text_7([*nodes, *others, Node("Body", kind="Mesh")]).decode().splitlines()
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = 100.0 * np.concatenate([part.vertices for part in parts])
    corners = np.concatenate([part.triangles + first for part, first in zip(parts, firsts, strict=False)])
    corners[:, 2] = ~corners[:, 2]
    arrays: dict[str, np.ndarray] = {"at": vertices.ravel(), "corners": corners.ravel().astype(np.int32)}
    objects = ['\tGeometry: 9000, "Geometry::Body", "Mesh" {', '\t\tVertices: "at"',
               '\t\tPolygonVertexIndex: "corners"', "\t}",
               '\tDeformer: 9001, "Deformer::Skin", "Skin" {', "\t}"]  # fmt: skip
    links = [f'C: "OO",9000,{1000 + len(nodes) + len(others)}', 'C: "OO",9001,9000']
    main = np.concatenate([part.joints[:, 0] for part in parts])
    carriers = [main]  # each vertex hangs a little on three joints above its own
    for _ in range(3):
        carriers.append(np.maximum(avatar.parents[carriers[-1]], 0))
    rest = 100.0 * kinematics.rest_positions(avatar)
    for joint in range(len(avatar)):
        index, weights = np.flatnonzero(np.any([own == joint for own in carriers], axis=0)), np.zeros(len(main))
        for own, weight in zip(carriers, (0.97, 0.01, 0.01, 0.01), strict=True):
            weights[own == joint] += weight
        bind = np.eye(4)
        bind[3, :3] = rest[joint]
        own_arrays: dict[str, np.ndarray] = {"Indexes": index.astype(np.int32), "Weights": weights[index],
                      "Transform": np.linalg.inv(bind).ravel(), "TransformLink": bind.ravel()}  # fmt: skip
        objects.append(f'\tDeformer: {9100 + joint}, "SubDeformer::", "Cluster" {{')
        objects += [f'\t\t{name}: "{name}{joint}"' for name in own_arrays] + ["\t}"]
        arrays |= {f"{name}{joint}": values for name, values in own_arrays.items()}
        links += [f'C: "OO",{9100 + joint},9001', f'C: "OO",{1000 + joint},{9100 + joint}']
    moved = np.arange(min(len(main), 20_000), dtype=np.int32)
    arrays |= {"moved": moved, "moves": np.tile([0.0, 0.0, 1.0], len(moved))}
    if n_shapes:
        objects += ['\tDeformer: 9002, "Deformer::Shapes", "BlendShape" {', "\t}"]
        links.append('C: "OO",9002,9000')
    for n in range(n_shapes):
        channel, shape = 10_000 + 2 * n, 10_001 + 2 * n
        objects += [f'\tDeformer: {channel}, "SubDeformer::shape{n}", "BlendShapeChannel" {{', "\t}",
                    f'\tGeometry: {shape}, "Geometry::shape{n}", "Shape" {{', '\t\tIndexes: "moved"',
                    '\t\tVertices: "moves"', "\t}"]  # fmt: skip
        links += [f'C: "OO",{channel},9002', f'C: "OO",{shape},{channel}']
    stop = lines.index("}", lines.index("Objects:  {"))
    return as_binary("\n".join([*lines[:stop], *objects, *lines[stop:-1], *links, "}"]).encode(), arrays=arrays)


def _scalar(value: float | str) -> bytes:
    if isinstance(value, str):
        kind, colons, name = value.partition("::")
        letters = (f"{name}\0\1{kind}" if colons else value).encode()
        return b"S" + struct.pack("<I", len(letters)) + letters
    return b"L" + struct.pack("<q", value) if isinstance(value, int) else b"D" + struct.pack("<d", value)
