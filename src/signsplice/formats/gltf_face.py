"""Faces in glTF documents: an avatar's face controls, and reading and writing of morph target weights, VRM expressions
and face bones.

A target is recognised by its name (``motion.face``), from ``extras.targetNames``, which exporters write, or by the VRM
expression, 0.x or 1.0, that moves it alone. An avatar's face is moved by targets with ARKit's names, else by
expressions, else by other targets: by one kind only, since expressions move the same targets. Eye bones or the look-at
of a VRM animation may also hold the gaze, and a jaw bone the open mouth. Broken expressions in a clip's file are
skipped, since joints do not depend on them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.body.capsules import Avatar, FaceControl
from signsplice.formats.gltf_document import (
    FACE_EXTRA,
    INTERPOLATIONS,
    VRM_0,
    VRM_1,
    VRM_ANIMATION,
    Fields,
    Keys,
    SkeletonDocument,
    sample,
)
from signsplice.formats.gltf_writer import DocumentWriter
from signsplice.formats.json_files import as_object
from signsplice.formats.reading import NO_LIMITS
from signsplice.motion import Clip, FloatArray, rotation
from signsplice.motion.face import (
    ARKIT_CHANNELS,
    LOOKS,
    SIDES,
    Face,
    LookAt,
    bone_coefficients,
    channel_of,
    eye_coefficients,
    face_from,
    gaze_quats,
    has_gaze,
    preset_of,
    shape_of,
    target_weights,
)
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FACE_BONES

_RANGES = ("HorizontalInner", "HorizontalOuter", "VerticalDown", "VerticalUp")
_MOST_DEG = 180.0
"""Largest valid range of a look-at, degrees."""


def face_controls(file: SkeletonDocument) -> tuple[tuple[FaceControl, ...], dict[int, int], tuple[str, ...]]:
    """Return the face controls with known names, node -> number of its morph targets for nodes that these move, and
    VRM's names of all expressions that move targets. Raises ``FormatError`` if a control moves a target that does not
    exist.
    """
    nodes_of: dict[int, list[int]] = {}
    counts: dict[int, int] = {}
    for node, fields in enumerate(file.nodes):
        mesh: Any = fields.get("mesh")
        primitives = [] if mesh is None else _rows(file._row(file.json.get("meshes"), mesh, "mesh").get("primitives"))
        if primitives and file._field(primitives[0], "targets", [], f"a primitive of mesh {mesh}"):
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


def split_controls(
    document: Fields, roles: Collection[str], controls: Sequence[FaceControl]
) -> tuple[tuple[FaceControl, ...], LookAt | None, bool]:
    """Return the face controls that a player uses beside bones, the look-at of the eye bones (None if no bones move the
    eyes), and whether a jaw bone opens the mouth. VRM's look-at moves either bones or its four presets.
    """
    look_at, is_bones = look_at_of(document)
    turns_eyes = is_bones is not False and "leftEye" in roles and "rightEye" in roles
    used = tuple(c for c in controls if not (turns_eyes and is_bones and c.name.lower().startswith("look")))
    shown = {channel for control in used for channel in shape_of(control.name) or ()}
    turns_eyes = turns_eyes and not any(channel.startswith(LOOKS) for channel in shown)
    return used, look_at if turns_eyes else None, "jaw" in roles and "jawOpen" not in shown


def look_at_of(document: Fields) -> tuple[LookAt, bool | None]:
    """Return the range maps of a VRM avatar's look-at, by default the usual ranges, and whether it moves bones; None if
    the file does not say.
    """
    extensions = as_object(document.get("extensions"))
    newer, older = as_object(extensions.get(VRM_1)).get("lookAt"), as_object(extensions.get(VRM_0)).get("firstPerson")
    rows, kind = as_object(newer), as_object(newer).get("type")
    prefix, keys = "rangeMap", ("inputMaxValue", "outputScale")
    if VRM_1 not in extensions:
        rows, kind = as_object(older), as_object(older).get("lookAtTypeName")
        prefix, keys = "lookAt", ("xRange", "yRange")
    maps = [as_object(rows.get(prefix + name)) for name in _RANGES]
    degrees = [[row.get(key) for row in maps] for key in keys]
    is_bones = None if kind is None else str(kind).lower() == "bone"
    if not is_bones or not all(isinstance(v, int | float) and 0.0 <= v <= _MOST_DEG for row in degrees for v in row):
        return LookAt(), is_bones
    gaze, eyes = (tuple(float(v or 0.0) for v in row) for row in degrees)
    return LookAt(gaze, eyes), is_bones


def _targets(document: Fields, nodes_of: dict[int, list[int]]) -> Iterator[FaceControl]:
    """Yield a control for every name of a morph target; several meshes may share a name."""
    binds: dict[str, list[tuple[int, int, float]]] = {}
    for mesh, nodes in nodes_of.items():
        fields = document["meshes"][mesh]
        names = as_object(fields.get("extras")).get("targetNames")
        names = names or as_object(fields["primitives"][0].get("extras")).get("targetNames")
        for index, name in enumerate(_rows(names)):
            binds.setdefault(str(name), []).extend((node, index, 1.0) for node in nodes)
    return (FaceControl(name, tuple(rows)) for name, rows in binds.items())


def _expressions(document: Fields, nodes_of: dict[int, list[int]]) -> Iterator[FaceControl]:
    extensions = as_object(document.get("extensions"))
    expressions = as_object(as_object(extensions.get(VRM_1)).get("expressions"))
    for kind in ("preset", "custom"):
        for name, row in as_object(expressions.get(kind)).items():
            rows = map(as_object, _rows(as_object(row).get("morphTargetBinds")))
            binds = ((b["node"], b["index"], float(b.get("weight", 1.0))) for b in rows)
            yield FaceControl(name, tuple(binds))
    groups = as_object(as_object(extensions.get(VRM_0)).get("blendShapeMaster")).get("blendShapeGroups")
    for row in map(as_object, _rows(groups)) if VRM_1 not in extensions else ():
        preset = row.get("presetName")
        name = str(preset if preset not in (None, "", "unknown") else row.get("name"))
        binds = (
            (node, b["index"], float(b.get("weight", 100.0)) / 100.0)
            for b in map(as_object, _rows(row.get("binds")))
            for node in nodes_of.get(b["mesh"], ())
        )
        yield FaceControl(name, tuple(binds))


def _rows(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


_AT_MOST = "degreesAtMost"
"""Our extra of a look-at: degrees of a gaze inward, outward, down and up with its coefficient at 1."""
_LIDS = {"eyeBlinkLeft": "blinkLeft", "eyeBlinkRight": "blinkRight"}
_PRESETS = ("aa", "ih", "ou", "ee", "oh", *_LIDS.values())
"""Presets that a VRM animation gets: all but look-at, which is no expression, and emotions, which no coefficient
shows; ``blink`` only for avatars that lack ``blinkLeft``.
"""


class FaceReader(SkeletonDocument):
    """A document whose animated face is being read."""

    def _face(self, animation: Fields, times: FloatArray, fps: float) -> Face | None:
        """Return the face that an animation shows at ``times`` (T,); None if it moves no known target. Raises
        ``FormatError`` for keys that do not fit.
        """
        tracks, n_bytes = dict[str, FloatArray](), 0
        expressions = {node: name for name, node in vrm_expressions(self.json)}
        for channel in animation["channels"]:
            node, path, names = channel["target"].get("node"), channel["target"]["path"], list[str]()
            if path == "translation" and node in expressions:
                names = [expressions[node]]
            elif path == "weights":
                names = target_names(self.json, node)
            if any(shape_of(name) is not None for name in names):
                values = self._weights(animation, channel.get("sampler"), times, fps)
                n_bytes += values.nbytes
                self.limits.check_memory("weights of a face", n_bytes, self.given_bytes, self.file)
                for name, track in zip(names, values.T, strict=False):  # of a translation X holds the weight
                    tracks.setdefault(name, track)
        shown = {channel for name in tracks for channel in shape_of(name) or ()}
        if not any(channel.startswith(LOOKS) for channel in shown):
            tracks |= self._look_at(animation, times, fps)
        for name in _names(as_object(animation.get("extras")).get(FACE_EXTRA)):
            if channel_of(name) is not None:
                tracks.setdefault(name, np.zeros(len(times)))
        return face_from(list(tracks), np.stack(list(tracks.values()), axis=1)) if tracks else None

    def _look_at(self, animation: Fields, times: FloatArray, fps: float) -> dict[str, FloatArray]:
        """Return coefficient -> values (T,) of a VRM animation's gaze; empty if it has none."""
        fields = as_object(as_object(as_object(self.json.get("extensions")).get(VRM_ANIMATION)).get("lookAt"))
        coefficients: dict[str, FloatArray] = {}
        for channel in animation["channels"]:
            if channel["target"]["path"] == "rotation" and channel["target"].get("node") == fields.get("node", -1):
                quats = self._weights(animation, channel.get("sampler"), times, fps)
                if quats.shape[1] != 4 or not np.abs(quats).sum(axis=1).all():
                    raise self._error("its look-at is no rotation")
                at_most = as_object(fields.get("extras")).get(_AT_MOST)
                valid = isinstance(at_most, list) and len(at_most) == 4 and all(isinstance(v, float) for v in at_most)
                degrees = tuple(at_most) if valid and at_most else LookAt().gaze
                for side in SIDES:
                    coefficients |= eye_coefficients(rotation.normalize(quats), side, degrees)
        return coefficients

    def _with_bones(self, clip: Clip) -> Clip:
        """Return the clip with gaze and open mouth from its bones, if its face has none."""
        rig = rig_info(clip.skeleton)
        quats = {}
        for role in FACE_BONES:
            if (joint := rig.roles.joint(role)) is not None:
                upright = rig.t_pose.rotations[joint]
                turned = rotation.multiply(upright, clip.local_rotations[:, joint])
                quats[role] = rotation.multiply(turned, rotation.inverse(upright))
        coefficients = bone_coefficients(quats, look_at_of(self.json)[0])
        face = clip.face
        coefficients = {name: v for name, v in coefficients.items() if face is None or not (
            has_gaze(face) if name.startswith(LOOKS) else name in face.channels)}  # fmt: skip
        if not coefficients:
            return clip
        values = np.stack(list(coefficients.values()), axis=1)
        if face is not None:
            values = np.concatenate([face.weights, values], axis=1)
        names = (*(() if face is None else face.channels), *coefficients)
        order = sorted(range(len(names)), key=lambda k: ARKIT_CHANNELS.index(names[k]))
        return replace(clip, face=Face(tuple(names[k] for k in order), values[:, order]))

    def _weights(self, animation: Fields, number: Any, times: FloatArray, fps: float) -> FloatArray:
        """Sample the values (T, N) of N targets, or of a translation or rotation."""
        sampler = self._row(animation.get("samplers"), number, "sampler")
        key_times, values = self._values(sampler.get("input"))[:, 0], self._values(sampler.get("output"))
        interpolation = sampler.get("interpolation", INTERPOLATIONS[0])
        per_key = 3 if interpolation == "CUBICSPLINE" else 1
        width, rest = divmod(values.size, max(1, per_key * len(key_times)))
        fits = width and not rest and interpolation in INTERPOLATIONS
        if (
            not fits
            or np.any(np.diff(key_times) <= 0.0)
            or not (np.isfinite(key_times).all() and np.isfinite(values).all())
        ):
            raise self._error(f"a face has {values.size} weights for {len(key_times)} rising times")
        self.limits.check_memory("weights of a face", 8.0 * len(times) * width, self.given_bytes, self.file)
        values = values.reshape((len(key_times), 3, width) if per_key == 3 else (len(key_times), width))
        return sample(Keys(key_times, values, interpolation), times, fps, rotations=False)


def vrm_expressions(document: Fields) -> Iterator[tuple[str, int]]:
    """Yield the name and the node of each expression of a VRM animation."""
    vrm = as_object(as_object(document.get("extensions")).get(VRM_ANIMATION))
    for kind in ("preset", "custom"):
        for name, row in as_object(as_object(vrm.get("expressions")).get(kind)).items():
            node = as_object(row).get("node")
            if isinstance(node, int):
                yield name, node


def target_names(document: Fields, node: Any) -> list[str]:
    """Return the names of the morph targets of a node's mesh: ``targetNames``, or, for an unknown name, the VRM
    expression that moves the target alone. Empty if there is neither.
    """
    nodes = document.get("nodes") or []
    number = as_object(nodes[node]).get("mesh") if isinstance(node, int) and 0 <= node < len(nodes) else None
    meshes = document.get("meshes") or []
    mesh = as_object(meshes[number]) if isinstance(number, int) and 0 <= number < len(meshes) else {}
    primitives = mesh.get("primitives")
    first_primitive = primitives[0] if isinstance(primitives, list) and primitives else None
    holders = (mesh, first_primitive)  # older exporters name them in a primitive
    name_lists = [as_object(as_object(holder).get("extras")).get("targetNames") for holder in holders]
    named = next(([str(name) for name in names] for names in name_lists if isinstance(names, list) and names), [])
    if any(shape_of(name) is None for name in named) or not named:
        bound = {index: name for name, where, index in _binds(document) if where in (("mesh", number), ("node", node))}
        named += [""] * (max(bound, default=-1) + 1 - len(named))
        named = [bound.get(k, name) if shape_of(name) is None else name for k, name in enumerate(named)]
    return named


def _binds(document: Fields) -> Iterator[tuple[str, tuple[str, Any], int]]:
    """Yield name, mesh or node, and target of each VRM expression that moves one target of that mesh or node."""
    extensions = as_object(document.get("extensions"))
    groups = as_object(as_object(extensions.get(VRM_0)).get("blendShapeMaster")).get("blendShapeGroups")
    rows = [as_object(row) for row in groups] if isinstance(groups, list) else []
    named = [(row.get("presetName"), row.get("name"), row.get("binds"), "mesh") for row in rows]
    expressions = as_object(as_object(extensions.get(VRM_1)).get("expressions"))
    for kind in ("preset", "custom"):
        named += [(name, name, as_object(row).get("morphTargetBinds"), "node")
                  for name, row in as_object(expressions.get(kind)).items()]  # fmt: skip
    for preset, name, binds, key in named:
        moved = [as_object(bind) for bind in binds] if isinstance(binds, list) else []
        targets = [(bind.get(key), bind.get("index")) for bind in moved]
        for where, index in targets:
            if isinstance(index, int) and 0 <= index < 10_000 and [holder for holder, _ in targets].count(where) == 1:
                yield str(name if preset in (None, "unknown") else preset), (key, where), index


def write_face(writer: DocumentWriter, face: Face, times: int) -> None:
    """Animate the named targets of every mesh, and list the coefficients that stay at rest. ``times``: number of the
    accessor of key times.
    """
    writer.gltf.animations[0].extras = {FACE_EXTRA: [name for name in face.channels if name not in face.moving]}
    for number, node in enumerate(writer.gltf.nodes):
        mesh = None if node.mesh is None else writer.gltf.meshes[node.mesh]
        names = ((mesh and mesh.extras) or {}).get("targetNames")
        if names:
            writer.channel(number, "weights", times, target_weights(face, names)[0].ravel())


def write_look_at(writer: DocumentWriter, face: Face, times: int, look_at: LookAt) -> Fields:
    """Write the gaze of a VRM animation as a node that turns. Returns the extension's ``lookAt``, with the angles of a
    gaze at its limit. ``times``: number of the accessor of key times.
    """
    node = writer.node("lookAt")
    writer.gltf.scenes[0].nodes.append(node)
    writer.channel(node, "rotation", times, rotation.continuous(gaze_quats(face, look_at)))
    return {"node": node, "extras": {_AT_MOST: list(look_at.gaze)}}


def write_expressions(
    writer: DocumentWriter, face: Face, times: int, avatar: Collection[str] = ()
) -> dict[str, dict[str, dict[str, int]]]:
    """Write the expressions of a VRM animation: those of an avatar by name, or, for any avatar, the presets of the
    lids, which equal their coefficients, and a custom one for each other coefficient. No two move the same. Returns the
    extension's ``expressions``.

    times: number of the accessor of key times.
    avatar: names of the avatar's expressions; empty for any avatar.
    """
    presets = (*_PRESETS, *(("blink",) if "blinkLeft" not in avatar else ()))
    names = [name for name in avatar if name in presets or channel_of(name)]
    names = names or [_LIDS.get(channel, channel) for channel in face.channels]
    expressions: dict[str, dict[str, dict[str, int]]] = {"preset": {}, "custom": {}}
    for name, values in zip(names, target_weights(face, names)[0].T, strict=True):
        node = writer.node(name)
        writer.gltf.scenes[0].nodes.append(node)
        expressions["preset" if name in presets else "custom"][name] = {"node": node}
        writer.channel(node, "translation", times, np.stack([values, 0 * values, 0 * values], axis=1))
    return expressions


def lost_in(path: str | Path, clip: Clip) -> tuple[str, ...]:
    """Return the coefficients of a clip's face that the targets of a written .glb file cannot show."""
    if clip.face is None:
        return ()
    document = SkeletonDocument(str(path), Path(path).read_bytes(), NO_LIMITS, None)
    names = {name for node in range(len(document.nodes)) for name in target_names(document.json, node)}
    file = clip.skeleton.file if isinstance(clip.skeleton, Avatar) else None
    bones = () if file is None else (*LOOKS * (file.look_at is not None), *("jawOpen",) * file.opens_jaw)
    lost = target_weights(clip.face, sorted(names))[1]
    return tuple(name for name in lost if not (bones and name.startswith(bones)))


def _names(value: Any) -> list[str]:
    return [name for name in value if isinstance(name, str)] if isinstance(value, list) else []
