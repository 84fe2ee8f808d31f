"""What moves the face of an avatar: morph targets with the names of ARKit, else expressions of VRM, else other targets;
and bones of eyes and jaw, where these show no gaze and open no mouth.

Names are those of ``extras.targetNames``, which exporters write, and of the expressions of VRM 0.x and 1.0. One kind
alone is used, since expressions move the same targets.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

from signsplice.body.capsules import FaceControl
from signsplice.formats.gltf_document import Fields
from signsplice.formats.gltf_skeleton import VRM_0, VRM_1, SkeletonDocument
from signsplice.motion.face import LOOKS, LookAt, preset_of, shape_of

_RANGES = ("HorizontalInner", "HorizontalOuter", "VerticalDown", "VerticalUp")
_MOST_DEG = 180.0
"""Ranges of look-at beyond this are not valid."""


def face_controls(file: SkeletonDocument) -> tuple[tuple[FaceControl, ...], dict[int, int], tuple[str, ...]]:
    """The controls of a face, node -> number of its morph targets, and VRM's names of expressions that move some; empty
    where none has a known name.
    """
    nodes_of: dict[int, list[int]] = {}
    counts: dict[int, int] = {}
    for node, fields in enumerate(file.nodes):
        mesh = fields.get("mesh")
        primitives = _rows(_rows(file.json.get("meshes"))[mesh].get("primitives")) if mesh is not None else []
        if mesh is not None and primitives and primitives[0].get("targets"):
            nodes_of.setdefault(mesh, []).append(node)
            counts[node] = len(primitives[0]["targets"])
    targets = tuple(_targets(file.json, nodes_of))
    expressions = tuple(_expressions(file.json, nodes_of))
    for controls in (targets, expressions):
        if any(list((shape_of(control.name) or {}).values()) == [1.0] for control in controls):  # a coefficient
            break
    else:
        controls = expressions or targets
    known = tuple(control for control in controls if shape_of(control.name) and control.binds)
    valid = all(0 <= index < counts.get(node, 0) for control in known for node, index, _ in control.binds)
    if not valid:
        raise file._error("an expression of its face names a morph target that does not exist")
    moved = {node for control in known for node, _, _ in control.binds}
    names = tuple(preset_of(control.name) or control.name for control in expressions if control.binds)
    return known, {node: n for node, n in counts.items() if node in moved}, names


def bones_of(
    document: Fields, roles: Collection[str], controls: Sequence[FaceControl]
) -> tuple[tuple[FaceControl, ...], LookAt | None, bool]:
    """The controls of a face that a player uses beside its bones, how its eyes turn, None where they do not, and
    whether its jaw does. VRM's look-at moves either bones or its four presets.
    """
    look_at, is_bones = look_at_of(document)
    eyes = is_bones is not False and "leftEye" in roles and "rightEye" in roles
    used = tuple(c for c in controls if not (eyes and is_bones and c.name.lower().startswith("look")))
    shown = {channel for control in used for channel in shape_of(control.name) or ()}
    eyes = eyes and not any(channel.startswith(LOOKS) for channel in shown)
    return used, look_at if eyes else None, "jaw" in roles and "jawOpen" not in shown


def look_at_of(document: Fields) -> tuple[LookAt, bool | None]:
    """The range maps of a VRM avatar's look-at, the usual ranges where it has none that are valid, and whether it moves
    bones; None where the file does not say so.
    """
    extensions = _object(document.get("extensions"))
    newer, older = _object(extensions.get(VRM_1)).get("lookAt"), _object(extensions.get(VRM_0)).get("firstPerson")
    rows, kind = _object(newer), _object(newer).get("type")
    prefix, keys = "rangeMap", ("inputMaxValue", "outputScale")
    if VRM_1 not in extensions:
        rows, kind = _object(older), _object(older).get("lookAtTypeName")
        prefix, keys = "lookAt", ("xRange", "yRange")
    maps = [_object(rows.get(prefix + name)) for name in _RANGES]
    degrees = [[row.get(key) for row in maps] for key in keys]
    is_bones = None if kind is None else str(kind).lower() == "bone"
    if not is_bones or not all(isinstance(v, int | float) and 0.0 <= v <= _MOST_DEG for row in degrees for v in row):
        return LookAt(), is_bones
    gaze, eyes = (tuple(float(v or 0.0) for v in row) for row in degrees)
    return LookAt(gaze, eyes), is_bones


def _targets(document: Fields, nodes_of: dict[int, list[int]]) -> Iterator[FaceControl]:
    """A control for every name of a morph target, which may be that of several meshes."""
    binds: dict[str, list[tuple[int, int, float]]] = {}
    for mesh, nodes in nodes_of.items():
        fields = document["meshes"][mesh]
        names = (fields.get("extras") or {}).get("targetNames")
        names = names or (fields["primitives"][0].get("extras") or {}).get("targetNames") or ()
        for index, name in enumerate(names):
            binds.setdefault(str(name), []).extend((node, index, 1.0) for node in nodes)
    return (FaceControl(name, tuple(rows)) for name, rows in binds.items())


def _expressions(document: Fields, nodes_of: dict[int, list[int]]) -> Iterator[FaceControl]:
    extensions = document.get("extensions") or {}
    expressions = (extensions.get(VRM_1) or {}).get("expressions") or {}
    for kind in ("preset", "custom"):
        for name, row in (expressions.get(kind) or {}).items():
            found = ((b["node"], b["index"], float(b.get("weight", 1.0))) for b in _rows(row.get("morphTargetBinds")))
            yield FaceControl(name, tuple(found))
    groups = ((extensions.get(VRM_0) or {}).get("blendShapeMaster") or {}).get("blendShapeGroups")
    for row in _rows(groups) if VRM_1 not in extensions else ():
        preset = row.get("presetName")
        name = preset if preset not in (None, "", "unknown") else row.get("name")
        found = (
            (node, b["index"], float(b.get("weight", 100.0)) / 100.0)
            for b in _rows(row.get("binds"))
            for node in nodes_of.get(b["mesh"], ())
        )
        yield FaceControl(str(name), tuple(found))


def _object(value: Any) -> Fields:
    return value if isinstance(value, dict) else {}


def _rows(value: Any) -> list[Fields]:
    return value if isinstance(value, list) else []
