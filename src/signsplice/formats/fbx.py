"""Reading of skeletal animation from FBX files, binary and text, of versions 6 and 7; clips are in metres, Y up.

Joints are the file's bones, or, if it has none, all moving models with their descendants; of several skeletons, the one
with most body parts is read. The bind pose of skins becomes the rest pose, as in ``gltf_reader``, else the pose with
all angles 0, since the pose that is stored at rest differs between files of one rig. Faces are blend shapes that a take
moves, recognised by name (``motion.face``).
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np

from signsplice.errors import FormatError
from signsplice.formats.fbx_records import FbxObjects, Id, name_of, numbers_of
from signsplice.formats.fbx_scene import FbxScene, Transforms
from signsplice.formats.fbx_takes import MOVES, PERCENT, Take
from signsplice.formats.gltf_document import (
    DRIFT,
    LEAST_FPS,
    MOST_FPS,
    USUAL_FPS,
    frame_rate,
    others_left,
    to_rest_axes,
    unique,
)
from signsplice.formats.reading import DEFAULT_LIMITS, JOINT_FRAME_BYTES, ReadLimits, stem
from signsplice.motion import Clip, FloatArray, Skeleton, rotation
from signsplice.motion.face import Face, face_from, shape_of
from signsplice.rig.info import rig_info


def face_of(objects: FbxObjects, take: Take, times: FloatArray) -> tuple[Face | None, tuple[str, ...]]:
    """Return the face that a take shows at ``times`` (T,), None if it moves no known blend shape, and the unknown blend
    shapes that it moves. Of blend shapes with the same name, the first counts.
    """
    tracks, unknown = dict[str, FloatArray](), dict[str, None]()
    for key, record in objects.all("Deformer", "BlendShapeChannel"):
        name = name_of(record.values[1])
        if not any((key, PERCENT) in layer.curves for layer in take.layers) or name in tracks:
            continue
        if shape_of(name) is None:
            unknown[f"blend shape {name}"] = None
            continue
        percent = numbers_of(record).get(PERCENT, record.numbers(PERCENT))
        rest = np.concatenate([percent, objects.numbers_of(record).get(PERCENT, ()), [0.0]])[:1]
        percent = take.values(key, PERCENT, rest, times)
        tracks[name] = np.broadcast_to(percent[:, 0] / 100.0, len(times))
    face = face_from(list(tracks), np.stack(list(tracks.values()), axis=1)) if tracks else None
    return face, tuple(unknown)


_CONSTANT = 1e-5
"""Translations that change by less than this fraction of the longest bone are constant."""
_LEAST_JOINTS = 3
"""A skeleton with fewer joints ranks last."""
_MOST_NAMED = 5
"""Most takes that an error message names."""


def parse(content: bytes, file: str = "", limits: ReadLimits = DEFAULT_LIMITS, take: str = "") -> Clip:
    """Parse a take in the bytes of a file named ``file``, by default the first that moves its joints, into a clip.

    Raises ``FormatError`` if the take or a skeleton is missing, and the error that the content causes if it is not FBX.
    """
    return _Reader(FbxScene(content, file, limits), file, len(content), limits).clip(take)


class _Reader:
    """A scene whose animation is being read."""

    def __init__(self, scene: FbxScene, file: str, n_bytes: int, limits: ReadLimits) -> None:
        self.scene, self.file, self.n_bytes, self.limits = scene, file, n_bytes, limits

    def clip(self, name: str) -> Clip:
        """Return the clip of a take; without a name, of the first that moves a joint."""
        skeletons = self.scene.skeletons()
        if not skeletons:
            raise self._error("holds neither bones nor models that move, expected an animated skeleton")
        take = self._take(name, {key for order in skeletons for key in order})
        ranks = [self._rank(order, take) for order in skeletons] if len(skeletons) > 1 else [(0, 0)]
        order = skeletons.pop(ranks.index(max(ranks)))
        times, fps = self._times(take, order)
        quats, positions = self._sample_animation(take, order, times)
        clip = self._build_clip(order, quats, positions, fps)
        tops = [self.scene.models[joints[0]].name for joints in skeletons if len(joints) > 1]
        takes = [unread_take.name for unread_take in self.scene.takes if unread_take is not take and unread_take.layers]
        skeleton_read = f"the skeleton below {self.scene.models[order[0]].name!r:.80}"
        notes = [*others_left(f"the take {take.name!r:.80}", takes), *others_left(skeleton_read, tops), *take.notes()]
        face, shapes = face_of(self.scene.objects, take, times)
        return replace(clip, face=face, left_out=(*take.left_out, *shapes), notes=tuple(notes))

    def _rank(self, order: Sequence[Id], take: Take) -> tuple[int, int]:
        """Return how many body roles a skeleton has, and how many of its joints move."""
        if len(order) < _LEAST_JOINTS or len(order) > self.limits.joints:
            return 0, 0
        names = unique([self.scene.models[key].name for key in order])
        offsets = np.array([self.scene.models[key].vector(MOVES[0]) for key in order])
        skeleton = Skeleton(tuple(names), self.scene.parent_rows(order), offsets)
        return len(rig_info(skeleton).roles.joints), len({key for key, _ in take.model_curves()}.intersection(order))

    def _take(self, name: str, joints: Set[Id]) -> Take:
        """Return the take of a name, or the first that moves a joint."""
        for take in self.scene.takes:
            moves = any(key in joints for key, _ in take.model_curves())
            if name == take.name if name else moves:
                if not moves:
                    raise self._error(f"its take {name!r:.80} moves no joint")
                return take
        names = ", ".join(repr(take.name)[:80] for take in self.scene.takes[:_MOST_NAMED])
        if name and names:
            raise self._error(f"no take {name!r:.80}, expected one of {names}")
        raise self._error("holds no take that moves a joint, expected an animated skeleton")

    def _times(self, take: Take, order: Sequence[Id]) -> tuple[FloatArray, float]:
        """Return times (T,) of the frames, s, and the frame rate: the file's, or that of keys that are denser or lie
        between its frames.
        """
        joints = {*order}
        curves = [curve for key, axes in take.model_curves() if key in joints for curve in axes if curve]
        densest = np.unique(max(curves, key=lambda curve: len(curve.times)).times)
        start, stop = take.span
        if stop <= start:
            start, stop = min(curve.times[0] for curve in curves), max(curve.times[-1] for curve in curves)
        fps = self.scene.fps if LEAST_FPS <= self.scene.fps <= MOST_FPS else USUAL_FPS
        steps = np.diff(densest)
        if len(steps) > 1 and LEAST_FPS <= 1.0 / steps.mean() <= MOST_FPS:
            rate, key_frames = frame_rate(densest), (densest - densest[0]) * fps
            if np.ptp(steps) * rate < DRIFT and (rate > fps or np.abs(key_frames - np.rint(key_frames)).max() > DRIFT):
                fps = rate
        n_steps = (stop - start) * fps
        size = n_steps * len(order) * JOINT_FRAME_BYTES
        self.limits.check_clip(n_steps, len(order), fps, size, self.n_bytes, self.file)
        return start + np.arange(int(np.floor(n_steps + DRIFT)) + 1) / fps, fps

    def _sample_animation(self, take: Take, order: Sequence[Id], times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Sample rotations (T, J, 4) and positions (T, J, 3) relative to the parent joint, those of the root in the
        world, in the file's axes and unit.
        """
        scene, rows = self.scene, {key: row for row, key in enumerate(order)}
        needed: set[Id] = set()
        for key in order:
            parent: Id | None = key
            while parent is not None and parent not in needed:
                needed.add(parent)
                parent = scene.parents.get(parent)
        quats, positions = np.empty((len(times), len(order), 4)), np.empty((len(times), len(order), 3))
        transforms: dict[Id, Transforms] = {}
        for key in (key for key in scene.order if key in needed):
            parent = scene.parents.get(key)
            local = scene.transforms(key, take, times, None if parent is None else transforms[parent])
            if parent is not None and parent not in rows:  # relative to the parent's parent
                parent_pose = transforms[parent]
                joint_positions = parent_pose.positions + rotation.rotate(parent_pose.quats, local.positions)
                local = replace(
                    local, quats=rotation.multiply(parent_pose.quats, local.quats), positions=joint_positions
                )
            transforms[key] = local
            if key in rows:
                quats[:, rows[key]], positions[:, rows[key]] = local.quats, local.positions
        return quats, positions

    def _build_clip(self, order: Sequence[Id], quats: FloatArray, positions: FloatArray, fps: float) -> Clip:
        """Build the clip from rotations and positions as ``_sample_animation`` returns them; changes both arrays."""
        parents, names = self.scene.parent_rows(order), tuple(unique([self.scene.models[key].name for key in order]))
        positions *= self.scene.metres
        positions[:] = positions @ self.scene.axes.T
        roots = positions[:, 0].copy()
        positions[:, 0] = 0.0
        bound = self._rest_rotations(order)
        self.scene.to_axes(quats)
        self.scene.to_axes(bound)
        parent_bound = np.where((parents >= 0)[:, None], bound[parents], rotation.IDENTITY)
        skeleton = Skeleton(names, parents, rotation.rotate(parent_bound, positions[0]))
        to_rest_axes(quats, positions, bound, parent_bound)
        stretches = np.ptp(positions, axis=0).max() > _CONSTANT * np.abs(skeleton.offsets).max()
        return Clip(skeleton, quats, roots, fps, stem(self.file), positions if stretches else None)

    def _rest_rotations(self, order: Sequence[Id]) -> FloatArray:
        """Return world rotations (J, 4) of the rest pose."""
        scene = self.scene
        is_bound = any(key in scene.bound for key in order)
        world_quats: dict[Id, FloatArray] = {}
        for key in scene.order:
            parent = scene.parents.get(key)
            parent_quat = rotation.IDENTITY if parent is None else world_quats[parent]
            world_quats[key] = scene.bound.get(
                key, rotation.multiply(parent_quat, scene.rest_rotation(key, zero=not is_bound))
            )
        return np.array([world_quats[key] for key in order])

    def _error(self, what: str) -> FormatError:
        return FormatError(what, file=self.file)
