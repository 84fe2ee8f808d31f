"""Reading of skeletal animation from glTF 2.0 files: ``.glb``, ``.gltf``, and VRM's ``.vrma``.

Joints keep their hierarchy and names. The skin's bind pose (the file's rest pose, if there is no skin) becomes the
clip's rest pose: with B a joint's global rotation in that pose and L its local rotation in the file, the clip's local
rotation is B_parent L B^-1. Keys may have any times; they are sampled at an even rate, that of the densest keys.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import FormatError
from signsplice.formats.gltf_document import (
    DRIFT,
    EVEN,
    FPS_EXTRA,
    GENERATOR,
    INTERPOLATIONS,
    LEAST_FPS,
    MOST_FPS,
    REPORT_EXTRA,
    ROLES_EXTRA,
    Fields,
    Keys,
    frame_rate,
    others_left,
    printable,
    sample,
    to_rest_axes,
)
from signsplice.formats.gltf_face import FaceReader, target_names, vrm_expressions
from signsplice.formats.json_files import as_object, parse_json, shorten_json
from signsplice.formats.reading import DEFAULT_LIMITS, JOINT_FRAME_BYTES, ReadLimits, stem
from signsplice.motion import Clip, FloatArray, Skeleton, rotation
from signsplice.motion.face import shape_of
from signsplice.rig.roles import ROLES

_AVATAR = "a figure to put signing on is no clip: `signsplice convert` puts clips onto avatars"
_PATHS = ("translation", "rotation", "scale", "weights", "pointer")
"""Paths that a channel may animate; ``pointer`` by an extension."""
_HELD = 1e-5
"""Translations that change by less than this fraction of the longest bone are constant."""


def parse(content: bytes, file: str = "", limits: ReadLimits = DEFAULT_LIMITS, folder: Path | None = None) -> Clip:
    """Parse the first animation in the bytes of a file named ``file`` into a clip in metres, the unit of glTF.

    ``folder``: the folder of its buffer files; if None, no other file is opened. Raises ``FormatError`` if there is no
    animation or joints are scaled unevenly, and the error that its content causes if it is not valid glTF.
    """
    return _AnimationReader(file, content, limits, folder).clip()


class _AnimationReader(FaceReader):
    """A document whose animation is being read."""

    def clip(self) -> Clip:
        animations = self._field(self.json, "animations", [], "the document")
        if not animations:
            raise self._error(f"holds no animation, expected an animated skeleton; {_AVATAR}")
        animation = self._row(animations, 0, "animation")
        targets = self._targets(animation)
        joints, roles = self._joints(targets)
        order = self._joint_order(joints, {node for node, _ in targets})
        joint_nodes = {*order}
        channels = self._channels(animation, {key: n for key, n in targets.items() if key[0] in joint_nodes})
        return self._sample_animation(order, roles, channels, animation)

    def _sample_animation(
        self, order: list[int], roles: Mapping[str, int], channels: Mapping[tuple[int, str], Keys], animation: Fields
    ) -> Clip:
        """Build the clip of joint nodes ``order`` (J), parents first, that an animation moves."""
        times, fps = self._times(channels, animation, len(order))
        rows, parents, names = self._tree(order)
        local_quats, translations = np.empty((len(times), len(order), 4)), np.empty((len(times), len(order), 3))
        rest_quats, offsets, scales = np.empty((len(order), 4)), np.empty((len(order), 3)), np.empty(len(order))
        world_position, world_quat, world_scale = self._world_pose(self.parents.get(order[0]))
        for k, node in enumerate(order):
            position, quat, scale = self._local_pose(node)
            parent_scale = world_scale if k == 0 else scales[parents[k]]
            scales[k] = parent_scale * scale
            rest_quats[k] = quat
            turning, moving = channels.get((node, "rotation")), channels.get((node, "translation"))
            local_quats[:, k] = quat if turning is None else sample(turning, times, fps, rotations=True)
            moved = position if moving is None else sample(moving, times, fps, rotations=False)
            translations[:, k] = parent_scale * moved
            offsets[k] = translations[0, k]  # the animation's first key counts, not the node's own translation
        # The pose of nodes above the skeleton, such as an armature's axes, is applied to the root.
        roots = world_position + rotation.rotate(world_quat, translations[:, 0])
        local_quats[:, 0] = rotation.multiply(world_quat, local_quats[:, 0])
        rest_quats[0] = rotation.multiply(world_quat, rest_quats[0])
        bound = self._bind_rotations(order, parents, rest_quats)
        parent_bound = np.where((parents >= 0)[:, None], bound[parents], rotation.IDENTITY)
        offsets = rotation.rotate(parent_bound, offsets)
        to_rest_axes(local_quats, translations, bound, parent_bound)
        translations[:, 0] = 0.0
        change = float(np.ptp(translations[:, 1:], axis=0).max()) if len(order) > 1 else 0.0
        stretches = change > _HELD * float(np.abs(offsets).max())
        named = {role: names[rows[node]] for role, node in roles.items() if node in rows} or self._roles_from_extras(
            names
        )
        clip = Clip(
            Skeleton(tuple(names), parents, np.concatenate([np.zeros((1, 3)), offsets[1:]]), roles=named or None),
            local_quats,
            roots,
            fps,
            name=printable(animation.get("name"), stem(self.file)),
            translations=translations if stretches else None,
            left_out=left_out(self.json, animation, self._values),
            report=self._report(),
            notes=(*_notes(self.json["animations"]), *self.notes),
            face=self._face(animation, times, fps),
        )
        return self._with_bones(clip)

    def _report(self) -> dict[str, Any] | None:
        """Return the report of a splice in the document's extras; None without, or with a note if it is no JSON."""
        text = as_object(self.json.get("extras")).get(REPORT_EXTRA)
        if not isinstance(text, str):
            return None
        try:
            return as_object(parse_json(text.encode(), "", "a report")) or None
        except FormatError as error:
            self.notes = (*self.notes, f"the report of a splice in it was left out: {error}")
            return None

    def _roles_from_extras(self, names: Sequence[str]) -> dict[str, str]:
        """Return role -> joint name from the extras of a file that we wrote, for existing joints."""
        extras = self.json.get("extras")
        stored = extras.get(ROLES_EXTRA) if isinstance(extras, dict) else None
        pairs = stored.items() if isinstance(stored, dict) else ()
        return {role: name for role, name in pairs if role in ROLES and name in names}

    def _targets(self, animation: Fields) -> dict[tuple[int, str], int]:
        """Return (node, "rotation", "translation" or "scale") -> number of its sampler."""
        samplers: dict[tuple[int, str], Any] = {}
        for number, channel in enumerate(self._field(animation, "channels", list, "animation 0")):
            target = self._field(channel, "target", dict, f"channel {number}")
            node, path = target.get("node"), target.get("path")
            if path not in _PATHS:
                expected = ", ".join(_PATHS)
                raise self._error(f"channel {number}: target.path is {shorten_json(path)}, expected one of {expected}")
            if node is not None and path in ("rotation", "translation", "scale"):
                self._row(self.nodes, node, "joint")
                if (node, path) in samplers:
                    raise self._error(f"channel {number}: {path} of node {node} is animated twice; leave one out")
                samplers[node, path] = channel.get("sampler")
        if not any(path != "scale" for _, path in samplers):
            raise self._error(f"animates no node's rotation or position, expected an animated skeleton; {_AVATAR}")
        return samplers

    def _channels(self, animation: Fields, targets: Mapping[tuple[int, str], int]) -> dict[tuple[int, str], Keys]:
        """Return the keys of rotations and translations; stores constant scales in ``scales``."""
        channels, total = {}, 0
        for (node, path), number in targets.items():
            sampler = self._row(animation.get("samplers"), number, "sampler")
            times, values = self._values(sampler.get("input"))[:, 0], self._values(sampler.get("output"))
            total += values.nbytes  # counted for each channel, even if channels share them
            self.limits.check_memory("keys", total, self.given_bytes, self.file)
            interpolation = self._field(sampler, "interpolation", "LINEAR", f"{path} of node {node}")
            if interpolation not in INTERPOLATIONS:
                what = f"{path} of node {node} is interpolated by {interpolation!r:.80}"
                raise self._error(f"{what}, expected {', '.join(INTERPOLATIONS)}")
            spline = interpolation == "CUBICSPLINE"
            expected = (3 if spline else 1) * len(times)
            if not len(times) or len(values) != expected or np.any(np.diff(times) <= 0.0):
                raise self._error(f"{path} of node {node}: {len(values)} values for {len(times)} rising times")
            if not (np.isfinite(times).all() and np.isfinite(values).all()):
                raise self._error(f"{path} of node {node}: a number is not finite")
            if values.shape[1] != (4 if path == "rotation" else 3):
                raise self._error(f"{path} of node {node} has {values.shape[1]} numbers")
            values = values.reshape(len(times), 3, -1) if spline else values
            at_keys = values[:, 1] if spline else values
            if path == "rotation":
                self._check_rotations(at_keys, f"keys of {self._node_label(node)}")
            if path == "scale":
                if np.ptp(at_keys, axis=0).max() > EVEN * np.abs(at_keys).max():
                    raise self._error(f"node {node} changes its size over time, expected rotations and positions only")
                self.scales[node] = at_keys[0]
                continue
            channels[node, path] = Keys(times, values, interpolation)
        if not channels:
            raise self._error("animates none of its joints, expected an animated skeleton")
        return channels

    def _joints(self, targets: Mapping[tuple[int, str], int]) -> tuple[set[int], dict[str, int]]:
        """Return the joint nodes, and role -> node of a VRM humanoid.

        Joints are those of the skins, else of the humanoid, else all animated nodes and their descendants.
        """
        roles = self._humanoid()
        skinned = {joint for skin in self.skins for joint in skin["joints"]}
        joints = skinned or {*roles.values()} or self._with_descendants({node for node, _ in targets})
        return joints, {role: node for role, node in roles.items() if node in joints}

    def _with_descendants(self, nodes: set[int]) -> set[int]:
        reached = set(nodes)
        for node in self.order:
            if self.parents.get(node) in reached:
                reached.add(node)
        return reached

    def _times(
        self, channels: Mapping[tuple[int, str], Keys], animation: Fields, n_joints: int
    ) -> tuple[FloatArray, float]:
        """Return times (T,) from the first to the last key, and the frame rate: from our extras, else of the densest
        keys.
        """
        start = min(float(keys.times[0]) for keys in channels.values())
        end = max(float(keys.times[-1]) for keys in channels.values())
        fps = self._fps_from_extras(animation, [keys.times - start for keys in channels.values()])
        if fps is None:
            fps = frame_rate(max((keys.times for keys in channels.values()), key=len))
        steps = (end - start) * fps
        self.limits.check_clip(steps, n_joints, fps, steps * n_joints * JOINT_FRAME_BYTES, self.given_bytes, self.file)
        # The last frame shows the last key, at any fraction of a frame; a key less than DRIFT late adds no frame.
        times = start + np.arange(int(np.ceil(steps - 1.01 * DRIFT)) + 1) / fps
        times[-1] = end
        return times, fps

    def _fps_from_extras(self, animation: Fields, times: Sequence[FloatArray]) -> float | None:
        """Return the frame rate in the extras of an animation with keys at ``times``, seconds from the first; None if
        there is none, or if the file is not ours and a key lies between its frames.
        """
        extras = animation.get("extras")
        fps = extras.get(FPS_EXTRA) if isinstance(extras, dict) else None
        if not isinstance(fps, int | float) or not 0.0 < fps <= 1000.0:
            return None
        is_ours = (self.json.get("asset") or {}).get("generator") == GENERATOR
        is_usual = LEAST_FPS <= fps <= MOST_FPS
        if is_ours or (
            is_usual and all(np.abs(seconds * fps - np.rint(seconds * fps)).max() < DRIFT for seconds in times)
        ):
            return float(fps)
        return None

    def _bind_rotations(self, order: Sequence[int], parents: NDArray[np.intp], rest_quats: FloatArray) -> FloatArray:
        """Return global rotations (J, 4) of the bind pose; of the rest pose for joints without skin."""
        bound: dict[int, FloatArray] = {}
        joint_nodes = {*order}
        for skin in self.skins:
            matrices = self._bind_matrices(skin)
            for joint, matrix in () if matrices is None else zip(skin["joints"], matrices, strict=True):
                if joint in joint_nodes and joint not in bound:
                    bound[joint] = rotation.nearest(np.linalg.inv(matrix)[:3, :3])
        rotations = np.empty_like(rest_quats)
        for k, node in enumerate(order):
            parent_quat = rotation.IDENTITY if parents[k] < 0 else rotations[parents[k]]
            rotations[k] = bound[node] if node in bound else rotation.multiply(parent_quat, rest_quats[k])
        return rotations


_POINTER = "KHR_animation_pointer"


def _notes(animations: Sequence[Fields]) -> tuple[str, ...]:
    """Return a line that names the animation read and the others; none if it is the only one."""
    first, *other_names = (printable(as_object(row).get("name"), f"animation {n}") for n, row in enumerate(animations))
    return others_left(f"the file's first animation, {first!r:.80},", other_names)


def left_out(document: Fields, animation: Fields, values: Callable[[int], FloatArray]) -> tuple[str, ...]:
    """Return names of what an animation moves but a clip does not hold: VRM expressions and morph targets that show no
    face, properties that a pointer animates, and channels without a node. ``values``: returns an accessor's.
    """
    rows = [(channel["target"], animation["samplers"][channel["sampler"]]) for channel in animation["channels"]]
    names = [*_vrm(document, {target.get("node") for target, _ in rows})]
    for target, sampler in rows:
        if target.get("node") is None and target["path"] != "pointer":
            names.append(f"{target['path']} of no node")
        elif target["path"] == "weights":
            names += _morph_targets(document, target.get("node"), values(sampler["output"]))
        elif target["path"] == "pointer":
            pointer = as_object(as_object(target.get("extensions")).get(_POINTER)).get("pointer")
            names.append(f"property {pointer}")
    return tuple(dict.fromkeys(name[:80] for name in names if name.isprintable()))


def _vrm(document: Fields, animated: set[Any]) -> Iterator[str]:
    """Yield the animated expressions of a VRM animation that show no face."""
    for name, node in vrm_expressions(document):
        if node in animated and shape_of(name) is None:
            yield f"expression {name}"


def _morph_targets(document: Fields, node: Any, weights: FloatArray) -> list[str]:
    """Return names of a node's morph targets that ``weights`` move and that show no face, or the node's name if the
    targets have none.
    """
    nodes = document.get("nodes") or []
    fields = as_object(nodes[node]) if isinstance(node, int) and 0 <= node < len(nodes) else {}
    if names := target_names(document, node):
        moved = [name for k, name in enumerate(names) if weights.ravel()[k :: len(names)].any()]
        return [f"morph target {name}" for name in moved if shape_of(name) is None]
    return [f"morph targets of {fields.get('name') or f'node {node}'}"]
