"""Faces in glTF documents: weights of morph targets, and the expressions of VRM, there and back.

A target is known by its name (``motion.face_shapes``), or by the expression of a VRM avatar that moves it alone. A gaze
may also be bones of eyes or the look-at of a VRM animation, an open mouth the bone of a jaw (``motion.gaze``). Broken
expressions are passed over, as joints do not depend on them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.body.capsules import Avatar
from signsplice.formats.avatar_face import look_at_of
from signsplice.formats.gltf_document import FACE_EXTRA, VRM_ANIMATION, Fields
from signsplice.formats.gltf_keys import INTERPOLATIONS, Keys, sample
from signsplice.formats.gltf_skeleton import VRM_0, VRM_1, SkeletonDocument
from signsplice.formats.gltf_writer import DocumentWriter
from signsplice.formats.limits import NO_LIMITS
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
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
    shape_of,
    target_weights,
)
from signsplice.rig.info import rig_info

_AT_MOST = "degreesAtMost"
"""Name, in the extras of a look-at, of the degrees of a gaze inward, outward, down and up with its coefficient at 1."""
_LIDS = {"eyeBlinkLeft": "blinkLeft", "eyeBlinkRight": "blinkRight"}
_PRESETS = ("aa", "ih", "ou", "ee", "oh", *_LIDS.values())
"""Presets of a VRM animation; look-at is none of its expressions, and no coefficient says what a person feels."""


class FaceReader(SkeletonDocument):
    """A document whose animated face is being read."""

    def _face(self, animation: Fields, times: FloatArray, fps: float) -> Face | None:
        """The face that an animation shows at ``times`` (T,); None where it moves no target that is known. Raises
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
                values = self._weights(animation, channel["sampler"], times, fps)
                n_bytes += values.nbytes
                self.limits.check_memory("weights of a face", n_bytes, self.given_bytes, self.file)
                for name, track in zip(names, values.T, strict=False):
                    tracks.setdefault(name, track)
        shown = {channel for name in tracks for channel in shape_of(name) or ()}
        if not any(channel.startswith(LOOKS) for channel in shown):
            tracks |= self._look_at(animation, times, fps)
        for name in _names(_object(animation.get("extras")).get(FACE_EXTRA)):
            if channel_of(name) is not None:
                tracks.setdefault(name, np.zeros(len(times)))
        return face_from(list(tracks), np.stack(list(tracks.values()), axis=1)) if tracks else None

    def _look_at(self, animation: Fields, times: FloatArray, fps: float) -> dict[str, FloatArray]:
        """Coefficient -> values (T,) of the gaze of a VRM animation; empty where it has none."""
        fields = _object(_object(_object(self.json.get("extensions")).get(VRM_ANIMATION)).get("lookAt"))
        found: dict[str, FloatArray] = {}
        for channel in animation["channels"]:
            if channel["target"]["path"] == "rotation" and channel["target"].get("node") == fields.get("node", -1):
                quats = self._weights(animation, channel["sampler"], times, fps)
                if quats.shape[1] != 4 or not np.abs(quats).sum(axis=1).all():
                    raise self._error("its look-at is no rotation")
                at_most = _object(fields.get("extras")).get(_AT_MOST)
                valid = isinstance(at_most, list) and len(at_most) == 4 and all(isinstance(v, float) for v in at_most)
                degrees = tuple(at_most) if valid and at_most else LookAt().gaze
                for side in SIDES:
                    found |= eye_coefficients(rotation.normalize(quats), side, degrees)
        return found

    def _with_bones(self, clip: Clip) -> Clip:
        """The clip with the gaze and the open mouth that its bones show, where its face has none of its own."""
        rig = rig_info(clip.skeleton)
        quats = {}
        for role in ("leftEye", "rightEye", "jaw"):
            if (joint := rig.roles.joint(role)) is not None:
                upright = rig.t_pose.rotations[joint]
                turned = rotation.multiply(upright, clip.local_rotations[:, joint])
                quats[role] = rotation.multiply(turned, rotation.inverse(upright))
        found = bone_coefficients(quats, look_at_of(self.json)[0])
        face = clip.face
        found = {name: v for name, v in found.items() if face is None or not (
            has_gaze(face) if name.startswith(LOOKS) else name in face.channels)}  # fmt: skip
        if not found:
            return clip
        values = np.stack(list(found.values()), axis=1)
        if face is not None:
            values = np.concatenate([face.weights, values], axis=1)
        names = (*(() if face is None else face.channels), *found)
        order = sorted(range(len(names)), key=lambda k: ARKIT_CHANNELS.index(names[k]))
        return replace(clip, face=Face(tuple(names[k] for k in order), values[:, order]))

    def _weights(self, animation: Fields, number: int, times: FloatArray, fps: float) -> FloatArray:
        """The values (T, N) of a sampler of N targets, or of a translation."""
        sampler = self._row(animation["samplers"], number, "sampler")
        at, values = self._values(sampler["input"])[:, 0], self._values(sampler["output"])
        interpolation = sampler.get("interpolation", INTERPOLATIONS[0])
        per_key = 3 if interpolation == "CUBICSPLINE" else 1
        width, rest = divmod(values.size, max(1, per_key * len(at)))
        fits = width and not rest and interpolation in INTERPOLATIONS
        if not fits or np.any(np.diff(at) <= 0.0) or not (np.isfinite(at).all() and np.isfinite(values).all()):
            raise self._error(f"a face has {values.size} weights for {len(at)} rising times")
        self.limits.check_memory("weights of a face", 8.0 * len(times) * width, self.given_bytes, self.file)
        values = values.reshape((len(at), 3, width) if per_key == 3 else (len(at), width))
        return sample(Keys(at, values, interpolation), times, fps, rotations=False)


def vrm_expressions(document: Fields) -> Iterator[tuple[str, int]]:
    """The name and the node of each expression of a VRM animation."""
    vrm = _object(_object(document.get("extensions")).get(VRM_ANIMATION))
    for kind in ("preset", "custom"):
        for name, row in _object(_object(vrm.get("expressions")).get(kind)).items():
            node = _object(row).get("node")
            if isinstance(node, int):
                yield name, node


def target_names(document: Fields, node: Any) -> list[str]:
    """The names of the morph targets of a node's mesh: ``targetNames``, or the VRM expression that moves one alone
    where a name is not known. Empty where neither is there.
    """
    nodes = document.get("nodes") or []
    number = _object(nodes[node]).get("mesh") if isinstance(node, int) and 0 <= node < len(nodes) else None
    meshes = document.get("meshes") or []
    mesh = _object(meshes[number]) if isinstance(number, int) and 0 <= number < len(meshes) else {}
    parts = mesh.get("primitives")
    holders = (mesh, parts[0] if isinstance(parts, list) and parts else None)  # older exporters name them in a part
    found = [_object(_object(holder).get("extras")).get("targetNames") for holder in holders]
    named = next(([str(name) for name in names] for names in found if isinstance(names, list) and names), [])
    if any(shape_of(name) is None for name in named) or not named:
        bound = {index: name for name, where, index in _binds(document) if where in (("mesh", number), ("node", node))}
        named += [""] * (max(bound, default=-1) + 1 - len(named))
        named = [bound.get(k, name) if shape_of(name) is None else name for k, name in enumerate(named)]
    return named


def _binds(document: Fields) -> Iterator[tuple[str, tuple[str, Any], int]]:
    """The name, the mesh or node, and the target of each expression of a VRM avatar that moves one target of it."""
    extensions = _object(document.get("extensions"))
    groups = _object(_object(extensions.get(VRM_0)).get("blendShapeMaster")).get("blendShapeGroups")
    rows = [_object(row) for row in groups] if isinstance(groups, list) else []
    named = [(row.get("presetName"), row.get("name"), row.get("binds"), "mesh") for row in rows]
    expressions = _object(_object(extensions.get(VRM_1)).get("expressions"))
    for kind in ("preset", "custom"):
        named += [(name, name, _object(row).get("morphTargetBinds"), "node")
                  for name, row in _object(expressions.get(kind)).items()]  # fmt: skip
    for preset, name, binds, key in named:
        moved = [_object(bind) for bind in binds] if isinstance(binds, list) else []
        targets = [(bind.get(key), bind.get("index")) for bind in moved]
        for where, index in targets:
            if isinstance(index, int) and 0 <= index < 10_000 and [other for other, _ in targets].count(where) == 1:
                yield str(name if preset in (None, "unknown") else preset), (key, where), index


def write_face(writer: DocumentWriter, face: Face, times: int) -> None:
    """Animate the targets of every mesh that has some by name, and name the coefficients at rest, which have none."""
    writer.gltf.animations[0].extras = {FACE_EXTRA: [name for name in face.channels if name not in face.moving]}
    for number, node in enumerate(writer.gltf.nodes):
        mesh = None if node.mesh is None else writer.gltf.meshes[node.mesh]
        names = ((mesh and mesh.extras) or {}).get("targetNames")
        if names:
            writer.channel(number, "weights", times, target_weights(face, names)[0].ravel())


def write_look_at(writer: DocumentWriter, face: Face, times: int, look_at: LookAt) -> Fields:
    """The look-at of a VRM animation: a node that turns as the gaze does, and what a gaze at its limit is."""
    node = writer.node("lookAt")
    writer.gltf.scenes[0].nodes.append(node)
    writer.channel(node, "rotation", times, rotation.continuous(gaze_quats(face, look_at)))
    return {"node": node, "extras": {_AT_MOST: list(look_at.gaze)}}


def write_expressions(
    writer: DocumentWriter, face: Face, times: int, avatar: Collection[str] = ()
) -> dict[str, dict[str, dict[str, int]]]:
    """The expressions of a VRM animation: those of an avatar by their names, or for any avatar the presets of the lids,
    which say the same as their coefficients, and a custom one for each other coefficient. No two move the same.
    """
    presets = (*_PRESETS, *(("blink",) if "blinkLeft" not in avatar else ()))
    names = [name for name in avatar if name in presets or channel_of(name)]
    names = names or [_LIDS.get(channel, channel) for channel in face.channels]
    found: dict[str, dict[str, dict[str, int]]] = {"preset": {}, "custom": {}}
    for name, values in zip(names, target_weights(face, names)[0].T, strict=True):
        node = writer.node(name)
        writer.gltf.scenes[0].nodes.append(node)
        found["preset" if name in presets else "custom"][name] = {"node": node}
        writer.channel(node, "translation", times, np.stack([values, 0 * values, 0 * values], axis=1))
    return found


def lost_in(path: str | Path, clip: Clip) -> tuple[str, ...]:
    """The coefficients of a clip's face that the targets of a .glb file, as written, cannot show."""
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


def _object(value: Any) -> Fields:
    return value if isinstance(value, dict) else {}
