"""Skeletal animation out of glTF 2.0 files: .glb, .gltf, and VRM's .vrma.

Joints keep their hierarchy and names. The pose in which a skin is bound (the file's own rest, where there is none)
becomes the clip's rest pose: with B a joint's global rotation there and L its local rotation in the file, a clip's is
B_parent L B^-1. Keys may lie anywhere in time; they are sampled at an even rate, that of the file's densest keys.
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
from signsplice.formats.gltf import FPS
from signsplice.formats.gltf import ROLES as TOLD_ROLES
from signsplice.formats.gltf_document import MAX_VALUES, Document
from signsplice.formats.gltf_keys import DRIFT, Keys, frame_rate, sampled
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.roles import ROLES

Float = NDArray[np.float64]

_HELD = 1e-5
"""Places that move by less than this share of the longest bone are held."""
_EVEN = 1e-3
"""Scales along three axes that differ by less than this share are one."""


def read(path: str | Path, animation: str | None = None) -> Clip:
    """The clip of a file's animation, by default its first; metres as the file has them.

    Raises ``FormatError`` where the file is no sound glTF, has no animation (of that name) or scales joints unevenly;
    ``InputError`` where it cannot be read.
    """
    return _read(read_bytes(path), str(path), Path(path).parent, animation)


def parse(content: bytes, file: str = "") -> Clip:
    """The clip that the bytes of a .glb hold; ``file`` is its name. Opens no other file: one that keeps its numbers
    beside itself is refused. Raises ``FormatError``.
    """
    return _read(content, file, None, None)


def _read(content: bytes, file: str, beside: Path | None, animation: str | None) -> Clip:
    try:
        return _File(file, content, beside).clip(animation)
    except FormatError:
        raise
    except InputError as error:
        raise FormatError(f"holds no sound clip ({error})", file=file) from error
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, RecursionError, MemoryError,
            struct.error) as error:  # fmt: skip
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FormatError(f"is no sound glTF file ({reason[:200]})", file=file) from error


class _File(Document):
    """A file whose animation is being read."""

    def __init__(self, file: str, content: bytes, beside: Path | None) -> None:
        super().__init__(file, content, beside)
        self.sizes: dict[int, Float] = {}

    def clip(self, name: str | None) -> Clip:
        animation = self._animation(name)
        targets = self._targets(animation)
        joints, roles = self._joints(targets)
        order = self._order(joints, targets)
        channels = self._channels(animation, {key: n for key, n in targets.items() if key[0] in order})
        times, fps = self._times(channels, animation, len(order))
        return self._made(order, roles, channels, times, fps, animation.name)

    def _made(
        self,
        order: list[int],
        roles: Mapping[str, int],
        channels: Mapping[tuple[int, str], Keys],
        times: Float,
        fps: float,
        name: str | None,
    ) -> Clip:
        rows = {node: k for k, node in enumerate(order)}
        parents = np.array([rows.get(self.parents.get(node, -1), -1) for node in order])
        local, ways = np.empty((len(times), len(order), 4)), np.empty((len(times), len(order), 3))
        still, offsets, scales = np.empty((len(order), 4)), np.empty((len(order), 3)), np.empty(len(order))
        above = self._world(self.parents.get(order[0]))
        for k, node in enumerate(order):
            place, turn, scale = self._pose(node)
            over = above[2] if k == 0 else scales[parents[k]]
            scales[k] = over * scale
            still[k] = turn
            turns, moves = channels.get((node, "rotation")), channels.get((node, "translation"))
            local[:, k] = turn if turns is None else sampled(turns, times, fps, turning=True)
            ways[:, k] = over * (place if moves is None else sampled(moves, times, fps, turning=False))
            offsets[k] = ways[0, k]  # where a joint is held is its place, whatever the file says of rest
        roots = above[0] + rotation.rotate(above[1], ways[:, 0])
        local[:, 0], still[0] = rotation.multiply(above[1], local[:, 0]), rotation.multiply(above[1], still[0])
        bound = self._bound(order, parents, still)
        over = np.where((parents >= 0)[:, None], bound[parents], rotation.IDENTITY)
        local = rotation.normalize(rotation.multiply(rotation.multiply(over, local), rotation.inverse(bound)))
        offsets, ways = rotation.rotate(over, offsets), rotation.rotate(over, ways)
        moving = len(order) > 1 and float(np.ptp(ways[:, 1:], axis=0).max()) > _HELD * float(np.abs(offsets).max())
        names = _different([_name(self.gltf.nodes[node].name, node) for node in order])
        told = {role: names[rows[node]] for role, node in roles.items() if node in rows} or self._told_roles(names)
        return Clip(
            Skeleton(tuple(names), parents, np.concatenate([np.zeros((1, 3)), offsets[1:]]), roles=told or None),
            rotation.continuous(local),
            roots,
            fps,
            name=name or Path(self.file).stem,
            translations=np.concatenate([np.zeros((len(times), 1, 3)), ways[:, 1:]], axis=1) if moving else None,
        )

    def _animation(self, name: str | None) -> Any:
        there = self.gltf.animations or []
        if not there:
            raise self._wrong("holds no animation, expected an animated skeleton")
        if name is None:
            return there[0]
        named = [animation for animation in there if animation.name == name]
        if not named:
            known = ", ".join(repr(animation.name) for animation in there[:8])
            raise self._wrong(f"holds no animation {name!r}, expected one of {known}")
        return named[0]

    def _told_roles(self, names: Sequence[str]) -> dict[str, str]:
        """Roles that a file of ours tells, of joints that are there."""
        told = (self.gltf.extras or {}).get(TOLD_ROLES) if isinstance(self.gltf.extras, dict) else None
        pairs = told.items() if isinstance(told, dict) else ()
        return {role: name for role, name in pairs if role in ROLES and name in names}

    def _targets(self, animation: Any) -> dict[tuple[int, str], int]:
        """Which node's rotation, translation or scale each sampler moves."""
        found: dict[tuple[int, str], int] = {}
        for channel in animation.channels:
            node, path = channel.target.node, channel.target.path
            if node is not None and path in ("rotation", "translation", "scale"):
                self._there(self.gltf.nodes, node, "joint")
                found.setdefault((node, path), channel.sampler)
        if not any(path != "scale" for _, path in found):
            raise self._wrong("animates no node's rotation or place, expected an animated skeleton")
        return found

    def _channels(self, animation: Any, targets: Mapping[tuple[int, str], int]) -> dict[tuple[int, str], Keys]:
        """The keys of those samplers; sizes that stay the same become the nodes' own."""
        found, total = {}, 0
        for (node, path), number in targets.items():
            sampler = self._there(animation.samplers, number, "sampler")
            times, values = self._values(sampler.input)[:, 0], self._values(sampler.output)
            total += values.size
            if total > MAX_VALUES:
                raise self._wrong(f"more than {MAX_VALUES:,} numbers of keys are more than a clip may hold")
            spline = sampler.interpolation == "CUBICSPLINE"
            expected = (3 if spline else 1) * len(times)
            if not len(times) or len(values) != expected or np.any(np.diff(times) <= 0.0):
                raise self._wrong(f"{path} of node {node}: {len(values)} values for {len(times)} rising times")
            if not (np.isfinite(times).all() and np.isfinite(values).all()):
                raise self._wrong(f"{path} of node {node}: a number is not finite")
            if values.shape[1] != (4 if path == "rotation" else 3):
                raise self._wrong(f"{path} of node {node} has {values.shape[1]} numbers")
            values = values.reshape(len(times), 3, -1) if spline else values
            if path == "scale":
                sizes = values[:, 1] if spline else values
                if np.ptp(sizes, axis=0).max() > _EVEN * np.abs(sizes).max():
                    raise self._wrong(f"node {node} changes its size over time, expected rotations and places only")
                self.sizes[node] = sizes[0]
                continue
            found[node, path] = Keys(times, values, sampler.interpolation or "LINEAR")
        if not found:
            raise self._wrong("animates none of its joints, expected an animated skeleton")
        return found

    def _joints(self, targets: Mapping[tuple[int, str], int]) -> tuple[list[int], dict[str, int]]:
        """The nodes that are joints, and the roles of those that the file names."""
        told = {**(self.gltf.extensions or {})}
        humanoid = (
            (told.get("VRMC_vrm_animation") or told.get("VRMC_vrm") or {}).get("humanoid", {}).get("humanBones", {})
        )
        named = {role: int(bone["node"]) for role, bone in humanoid.items() if role in ROLES}
        if len(set(named.values())) < len(named):
            raise self._wrong("its humanoid has one node in two roles")
        roles = {role: node for role, node in named.items() if self._there(self.gltf.nodes, node, "joint")}
        skinned = [int(joint) for skin in self.gltf.skins or [] for joint in skin.joints or []]
        # Without skin and roles: what moves, and all that hangs on it.
        joints = skinned or [*roles.values()] or [node for moving, _ in targets for node in self._tree(moving)]
        joints = list(dict.fromkeys(joints))
        for joint in joints:
            self._there(self.gltf.nodes, joint, "joint")
        return joints, {role: node for role, node in roles.items() if node in joints}

    def _order(self, joints: list[int], targets: Mapping[tuple[int, str], int]) -> list[int]:
        """Joints and what lies between, parents first: from the nearest node above all, or a higher one that moves."""
        lines = [self._line(joint) for joint in joints]
        shared = set.intersection(*(set(line) for line in lines))
        if not shared:
            raise self._wrong("its joints hang from several roots, expected one skeleton")
        nearest = max(shared, key=lambda node: len(self._line(node)))
        moving = {node for node, _ in targets}
        root = next((node for node in reversed(self._line(nearest)) if node in moving), nearest)
        wanted = {node for line in lines for node in line[: line.index(root) + 1]}
        return [node for node in self._tree(root) if node in wanted]

    def _times(self, channels: Mapping[tuple[int, str], Keys], animation: Any, n_joints: int) -> tuple[Float, float]:
        """Even moments from the first to the last key, and their rate: what the file tells, or that of its densest
        keys.
        """
        start = min(float(keys.times[0]) for keys in channels.values())
        end = max(float(keys.times[-1]) for keys in channels.values())
        told = (animation.extras or {}).get(FPS) if isinstance(animation.extras, dict) else None
        if isinstance(told, int | float) and 1.0 <= told <= 1000.0:
            rate = float(told)
        else:
            rate = frame_rate(max((keys.times for keys in channels.values()), key=len))
        length = (end - start) * rate
        if not 4.0 * length * n_joints <= MAX_VALUES:
            raise self._wrong(
                f"{end - start:g} s of {n_joints} joints at {rate:g} a second are more than a clip may hold"
            )
        return start + np.arange(int(length + 1.01 * DRIFT) + 1) / rate, rate

    def _pose(self, node: int) -> tuple[Float, Float, float]:
        """A node's own place (3,), turn (4,) and scale at rest."""
        told = self.gltf.nodes[node]
        if told.matrix:
            matrix = np.array(told.matrix, np.float64).reshape(4, 4).T
            scale = np.linalg.norm(matrix[:3, :3], axis=0)
            place, turn = matrix[:3, 3], rotation.from_matrix(matrix[:3, :3] / np.where(scale == 0.0, 1.0, scale))
        else:
            place = np.array(told.translation or [0.0, 0.0, 0.0], np.float64)
            turn = rotation.normalize(np.array(told.rotation or [0.0, 0.0, 0.0, 1.0], np.float64))
            scale = np.array(told.scale or [1.0, 1.0, 1.0], np.float64)
        scale = self.sizes.get(node, scale)
        if not (scale.min() > 0.0 and np.ptp(scale) <= _EVEN * scale.max()):
            raise self._wrong(f"node {told.name or node!r} is scaled by {scale.tolist()}, expected one positive number")
        return place, turn, float(scale.mean())

    def _world(self, node: int | None) -> tuple[Float, Float, float]:
        """Place, turn and scale of a node in the world at rest; those of the world where there is none."""
        place, turn, scale = np.zeros(3), rotation.IDENTITY, 1.0
        for above in reversed([] if node is None else self._line(node)):
            own_place, own_turn, own_scale = self._pose(above)
            place = place + rotation.rotate(turn, scale * own_place)
            turn, scale = rotation.multiply(turn, own_turn), scale * own_scale
        return place, turn, scale

    def _bound(self, order: Sequence[int], parents: NDArray[np.intp], still: Float) -> Float:
        """Global rotations (J, 4) of the pose in which the skin is bound; of the file's rest where there is no skin."""
        known: dict[int, Float] = {}
        for skin in self.gltf.skins or []:
            if skin.inverseBindMatrices is None:
                continue
            matrices = self._values(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
            if len(matrices) < len(skin.joints) or not np.isfinite(matrices).all():
                raise self._wrong(f"a skin binds {len(skin.joints)} joints with {len(matrices)} sound matrices")
            for joint, matrix in zip(skin.joints, matrices, strict=False):
                turn = np.linalg.inv(matrix)[:3, :3]
                u, _, vt = np.linalg.svd(turn)
                known.setdefault(int(joint), rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt))
        out = np.empty_like(still)
        for k, node in enumerate(order):
            above = rotation.IDENTITY if parents[k] < 0 else out[parents[k]]
            out[k] = known[node] if node in known else rotation.multiply(above, still[k])
        return out


def _name(told: Any, node: int) -> str:
    """A node's name as text that can be written anywhere."""
    name = told.encode("utf-8", "replace").decode() if isinstance(told, str) else ""
    return name or f"node {node}"


def _different(names: Sequence[str]) -> list[str]:
    """The names, those that come again with a number."""
    out: list[str] = []
    taken = set(names)
    for name in names:
        own = name
        if name in out:
            own = next(numbered for n in count(2) if (numbered := f"{name} {n}") not in taken)
            taken.add(own)
        out.append(own)
    return out
