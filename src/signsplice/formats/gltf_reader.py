"""Skeletal animation read from glTF 2.0 files: ``.glb``, ``.gltf``, and VRM's ``.vrma``.

Joints keep their hierarchy and names. The pose in which the skin is bound (the file's rest pose, if there is no skin)
becomes the clip's rest pose: with B a joint's global rotation in that pose and L its local rotation in the file, the
clip's local rotation is B_parent L B^-1. Keys may be at any times; they are sampled at an even rate, that of the
densest keys.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import FormatError, InputError
from signsplice.formats.atomic import read_bytes
from signsplice.formats.gltf_document import FPS_EXTRA, MAX_VALUES, ROLES_EXTRA, VRM_ANIMATION, Document
from signsplice.formats.gltf_keys import DRIFT, Keys, frame_rate, sample
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.roles import ROLES

Float = NDArray[np.float64]

_HELD = 1e-5
"""Translations that change by less than this fraction of the longest bone are constant."""
_EVEN = 1e-3
"""Scales along three axes, or over time, that differ by less than this fraction are equal."""


def read(path: str | Path, animation: str | None = None) -> Clip:
    """The clip of a file's animation, by default the first; in metres, the unit of glTF.

    Raises ``FormatError`` where the file is not valid glTF, has no animation (of that name) or scales joints unevenly;
    ``InputError`` where it cannot be read.
    """
    return _read(read_bytes(path), str(path), Path(path).parent, animation)


def parse(content: bytes, file: str = "") -> Clip:
    """The clip of the first animation in the bytes of a file named ``file``. Opens no other file: a document that
    refers to one is refused. Raises ``FormatError``.
    """
    return _read(content, file, None, None)


def _read(content: bytes, file: str, folder: Path | None, animation: str | None) -> Clip:
    try:
        return _AnimationReader(file, content, folder).clip(animation)
    except FormatError:
        raise
    except InputError as error:
        raise FormatError(f"holds no valid clip ({error})", file=file) from error
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, RecursionError, MemoryError,
            struct.error) as error:  # fmt: skip
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FormatError(f"is no valid glTF file ({reason[:200]})", file=file) from error


class _AnimationReader(Document):
    """A document whose animation is being read."""

    def __init__(self, file: str, content: bytes, folder: Path | None) -> None:
        super().__init__(file, content, folder)
        self.scales: dict[int, Float] = {}  # node -> scale (3,), where the animation sets it

    def clip(self, name: str | None) -> Clip:
        animation = self._animation(name)
        targets = self._targets(animation)
        joints, roles = self._joints(targets)
        order = self._order(joints, targets)
        channels = self._channels(animation, {key: n for key, n in targets.items() if key[0] in order})
        times, fps = self._times(channels, animation, len(order))
        return self._sampled_clip(order, roles, channels, times, fps, animation.name)

    def _sampled_clip(
        self,
        order: list[int],
        roles: Mapping[str, int],
        channels: Mapping[tuple[int, str], Keys],
        times: Float,
        fps: float,
        name: str | None,
    ) -> Clip:
        """The clip of joint nodes ``order`` (J), parents first, at ``times`` (T,)."""
        rows = {node: k for k, node in enumerate(order)}
        parents = np.array([rows.get(self.parents.get(node, -1), -1) for node in order])
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
        # What is above the skeleton, such as an armature's axes, goes into the root.
        roots = world_position + rotation.rotate(world_quat, translations[:, 0])
        local_quats[:, 0] = rotation.multiply(world_quat, local_quats[:, 0])
        rest_quats[0] = rotation.multiply(world_quat, rest_quats[0])
        bound = self._bind_rotations(order, parents, rest_quats)
        parent_bound = np.where((parents >= 0)[:, None], bound[parents], rotation.IDENTITY)
        local_quats = rotation.multiply(rotation.multiply(parent_bound, local_quats), rotation.inverse(bound))
        offsets, translations = rotation.rotate(parent_bound, offsets), rotation.rotate(parent_bound, translations)
        change = float(np.ptp(translations[:, 1:], axis=0).max()) if len(order) > 1 else 0.0
        stretches = change > _HELD * float(np.abs(offsets).max())
        names = _unique([_printable(self.gltf.nodes[node].name, node) for node in order])
        named = {role: names[rows[node]] for role, node in roles.items() if node in rows} or self._stored_roles(names)
        return Clip(
            Skeleton(tuple(names), parents, np.concatenate([np.zeros((1, 3)), offsets[1:]]), roles=named or None),
            rotation.continuous(rotation.normalize(local_quats)),
            roots,
            fps,
            name=name or Path(self.file).stem,
            translations=np.concatenate([np.zeros((len(times), 1, 3)), translations[:, 1:]], axis=1)
            if stretches
            else None,
        )

    def _animation(self, name: str | None) -> Any:
        """The animation of a name, or the first one."""
        animations = self.gltf.animations or []
        if not animations:
            raise self._error("holds no animation, expected an animated skeleton")
        if name is None:
            return animations[0]
        named = [animation for animation in animations if animation.name == name]
        if not named:
            names = ", ".join(repr(animation.name) for animation in animations[:8])
            raise self._error(f"holds no animation {name!r}, expected one of {names}")
        return named[0]

    def _stored_roles(self, names: Sequence[str]) -> dict[str, str]:
        """Role -> joint name from the extras of a file that we wrote, for joints that exist."""
        stored = (self.gltf.extras or {}).get(ROLES_EXTRA) if isinstance(self.gltf.extras, dict) else None
        pairs = stored.items() if isinstance(stored, dict) else ()
        return {role: name for role, name in pairs if role in ROLES and name in names}

    def _targets(self, animation: Any) -> dict[tuple[int, str], int]:
        """(node, "rotation", "translation" or "scale") -> number of the sampler that animates it."""
        found: dict[tuple[int, str], int] = {}
        for channel in animation.channels:
            node, path = channel.target.node, channel.target.path
            if node is not None and path in ("rotation", "translation", "scale"):
                self._row(self.gltf.nodes, node, "joint")
                found.setdefault((node, path), channel.sampler)
        if not any(path != "scale" for _, path in found):
            raise self._error("animates no node's rotation or position, expected an animated skeleton")
        return found

    def _channels(self, animation: Any, targets: Mapping[tuple[int, str], int]) -> dict[tuple[int, str], Keys]:
        """The keys of rotations and translations. A scale that does not change over time goes to ``scales``."""
        found, total = {}, 0
        for (node, path), number in targets.items():
            sampler = self._row(animation.samplers, number, "sampler")
            times, values = self._values(sampler.input)[:, 0], self._values(sampler.output)
            total += values.size
            if total > MAX_VALUES:
                raise self._error(f"more than {MAX_VALUES:,} numbers of keys are more than a clip may hold")
            spline = sampler.interpolation == "CUBICSPLINE"
            expected = (3 if spline else 1) * len(times)
            if not len(times) or len(values) != expected or np.any(np.diff(times) <= 0.0):
                raise self._error(f"{path} of node {node}: {len(values)} values for {len(times)} rising times")
            if not (np.isfinite(times).all() and np.isfinite(values).all()):
                raise self._error(f"{path} of node {node}: a number is not finite")
            if values.shape[1] != (4 if path == "rotation" else 3):
                raise self._error(f"{path} of node {node} has {values.shape[1]} numbers")
            values = values.reshape(len(times), 3, -1) if spline else values
            if path == "scale":
                scales = values[:, 1] if spline else values
                if np.ptp(scales, axis=0).max() > _EVEN * np.abs(scales).max():
                    raise self._error(f"node {node} changes its size over time, expected rotations and positions only")
                self.scales[node] = scales[0]
                continue
            found[node, path] = Keys(times, values, sampler.interpolation or "LINEAR")
        if not found:
            raise self._error("animates none of its joints, expected an animated skeleton")
        return found

    def _joints(self, targets: Mapping[tuple[int, str], int]) -> tuple[list[int], dict[str, int]]:
        """The nodes that are joints, and role -> node of a VRM humanoid.

        Joints are those of the skins, else of the humanoid, else all animated nodes with their descendants.
        """
        extensions = {**(self.gltf.extensions or {})}
        vrm = extensions.get(VRM_ANIMATION) or extensions.get("VRMC_vrm") or {}
        humanoid = vrm.get("humanoid", {}).get("humanBones", {})
        named = {role: int(bone["node"]) for role, bone in humanoid.items() if role in ROLES}
        if len(set(named.values())) < len(named):
            raise self._error("its humanoid has one node in two roles")
        roles = {role: node for role, node in named.items() if self._row(self.gltf.nodes, node, "joint")}
        skinned = [int(joint) for skin in self.gltf.skins or [] for joint in skin.joints or []]
        joints = skinned or [*roles.values()] or [node for animated, _ in targets for node in self._subtree(animated)]
        joints = list(dict.fromkeys(joints))
        for joint in joints:
            self._row(self.gltf.nodes, joint, "joint")
        return joints, {role: node for role, node in roles.items() if node in joints}

    def _order(self, joints: list[int], targets: Mapping[tuple[int, str], int]) -> list[int]:
        """The joints and the nodes between them, parents first.

        The root is the nearest common ancestor of all joints, or the highest animated node above it.
        """
        paths = [self._path_to_root(joint) for joint in joints]
        shared = set.intersection(*(set(path) for path in paths))
        if not shared:
            raise self._error("its joints hang from several roots, expected one skeleton")
        nearest = max(shared, key=lambda node: len(self._path_to_root(node)))
        animated = {node for node, _ in targets}
        root = next((node for node in reversed(self._path_to_root(nearest)) if node in animated), nearest)
        wanted = {node for path in paths for node in path[: path.index(root) + 1]}
        return [node for node in self._subtree(root) if node in wanted]

    def _times(self, channels: Mapping[tuple[int, str], Keys], animation: Any, n_joints: int) -> tuple[Float, float]:
        """Times (T,) from the first to the last key, and the frame rate: that of our extras, else of the densest
        keys.
        """
        start = min(float(keys.times[0]) for keys in channels.values())
        end = max(float(keys.times[-1]) for keys in channels.values())
        stored = (animation.extras or {}).get(FPS_EXTRA) if isinstance(animation.extras, dict) else None
        if isinstance(stored, int | float) and 1.0 <= stored <= 1000.0:
            fps = float(stored)
        else:
            fps = frame_rate(max((keys.times for keys in channels.values()), key=len))
        n_frames = (end - start) * fps
        if not 4.0 * n_frames * n_joints <= MAX_VALUES:
            raise self._error(
                f"{end - start:g} s of {n_joints} joints at {fps:g} a second are more than a clip may hold"
            )
        return start + np.arange(int(n_frames + 1.01 * DRIFT) + 1) / fps, fps

    def _local_pose(self, node: int) -> tuple[Float, Float, float]:
        """A node's own position (3,), rotation (4,) and scale at rest, relative to its parent."""
        fields = self.gltf.nodes[node]
        if fields.matrix:
            matrix = np.array(fields.matrix, np.float64).reshape(4, 4).T
            scale = np.linalg.norm(matrix[:3, :3], axis=0)
            position, quat = matrix[:3, 3], rotation.from_matrix(matrix[:3, :3] / np.where(scale == 0.0, 1.0, scale))
        else:
            position = np.array(fields.translation or [0.0, 0.0, 0.0], np.float64)
            quat = rotation.normalize(np.array(fields.rotation or [0.0, 0.0, 0.0, 1.0], np.float64))
            scale = np.array(fields.scale or [1.0, 1.0, 1.0], np.float64)
        scale = self.scales.get(node, scale)
        if not (scale.min() > 0.0 and np.ptp(scale) <= _EVEN * scale.max()):
            name = fields.name or node
            raise self._error(f"node {name!r} is scaled by {scale.tolist()}, expected one positive number")
        return position, quat, float(scale.mean())

    def _world_pose(self, node: int | None) -> tuple[Float, Float, float]:
        """Position (3,), rotation (4,) and scale of a node in the world at rest; the identity for None."""
        position, quat, scale = np.zeros(3), rotation.IDENTITY, 1.0
        for ancestor in reversed([] if node is None else self._path_to_root(node)):
            local_position, local_quat, local_scale = self._local_pose(ancestor)
            position = position + rotation.rotate(quat, scale * local_position)
            quat, scale = rotation.multiply(quat, local_quat), scale * local_scale
        return position, quat, scale

    def _bind_rotations(self, order: Sequence[int], parents: NDArray[np.intp], rest_quats: Float) -> Float:
        """Global rotations (J, 4) of the pose in which the skin is bound; of the rest pose for joints without skin."""
        bound: dict[int, Float] = {}
        for skin in self.gltf.skins or []:
            if skin.inverseBindMatrices is None:
                continue
            matrices = self._values(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
            if len(matrices) < len(skin.joints) or not np.isfinite(matrices).all():
                raise self._error(f"a skin binds {len(skin.joints)} joints with {len(matrices)} valid matrices")
            for joint, matrix in zip(skin.joints, matrices, strict=False):
                u, _, vt = np.linalg.svd(np.linalg.inv(matrix)[:3, :3])
                bound.setdefault(int(joint), rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt))
        out = np.empty_like(rest_quats)
        for k, node in enumerate(order):
            parent_quat = rotation.IDENTITY if parents[k] < 0 else out[parents[k]]
            out[k] = bound[node] if node in bound else rotation.multiply(parent_quat, rest_quats[k])
        return out


def _printable(name: Any, node: int) -> str:
    """A node's name as text that can be written to any file."""
    text = name.encode("utf-8", "replace").decode() if isinstance(name, str) else ""
    return text or f"node {node}"


def _unique(names: Sequence[str]) -> list[str]:
    """The names; one that is already taken gets a number."""
    out: list[str] = []
    taken = set(names)
    for name in names:
        unique = name
        if name in out:
            unique = next(numbered for n in count(2) if (numbered := f"{name} {n}") not in taken)
            taken.add(unique)
        out.append(unique)
    return out
