"""Judges by independent programs whether a file was read as the motion that it holds.

Each oracle takes the bytes of a file and what the program read of them. It returns True if it has judged them, False if
it cannot: the file is so broken that no other program could say what it holds. It raises ``WrongMotionError`` if the
program read something else than the file holds, or read what no program may.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

import evaluators
import fuzz_gltf_rules
from fuzz_trees import unpack
from signsplice import formats, lexicon
from signsplice.body.capsules import Avatar
from signsplice.errors import InputError
from signsplice.formats import bvh
from signsplice.motion import Clip
from signsplice.rig.inspection import left_out_warnings

TOLERANCE = 1e-4
"""Greatest error of a joint's position, as a fraction of the rig's extent."""
_TURNED = 1e-3
"""Greatest error of a joint's axes, as components of unit vectors."""
_NEAR = 1e-3
"""Greatest error of a key's time, frames: files store times in 32 bits."""
_ROUNDED = 1e-8
"""Step of the numbers that are derived for a BVH file, whatever its unit."""
_JUDGED_FRAMES = 24
"""Largest number of frames of a clip that are compared: the evaluators are slow."""
_RATE, _NAMED_RATE = 0.0025, 0.0101
"""Greatest error of a frame rate that a rounded Frame Time may stand for, without and with a warning."""

_LEAST_RATE, _LARGEST_RATE = 10.0, 1000.0
"""Frame Times that are read as rates: no frame lasts so many seconds."""


class WrongMotionError(AssertionError):
    """A file was read as something else than it holds."""


def judge_bvh(content: bytes, clip: Clip) -> bool:
    """Judges the joints of a BVH file and its Frame Time by ``evaluators``."""
    try:
        with np.errstate(all="ignore"):
            names, world = evaluators.evaluate_bvh(content)
            frame_time = evaluators.read_frame_time(content)
    except Exception:  # a broken file may raise anything
        return False
    if len(names) != len(clip.skeleton) or len(world) != len(clip):
        raise WrongMotionError(f"{len(clip)} frames of {len(clip.skeleton)} joints are {len(world)} of {len(names)}")
    error = abs(clip.fps * frame_time - 1.0)
    if _LEAST_RATE <= frame_time <= _LARGEST_RATE:  # a rate in its place
        error = min(error, abs(clip.fps / frame_time - 1.0))
    if error > (_NAMED_RATE if left_out_warnings(clip) else _RATE):
        raise WrongMotionError(f"Frame Time {frame_time:g} is read as {clip.fps:g} fps")
    frames = _choose_frames(len(clip))
    return _compare(clip, frames, world[frames], "joint")


def judge_gltf(content: bytes, clip: Clip) -> bool:
    """Judges the joints of a glTF file by ``evaluators``, at the times of the clip's frames."""
    try:
        with np.errstate(all="ignore"):
            nodes = _find_nodes(content, clip.skeleton.names)
            fuzz_gltf_rules.check(content, nodes, bool(left_out_warnings(clip)))
            channels = evaluators.GltfFile(content).channels(0).items()
            keys = np.unique(np.concatenate([key_times for (node, path), (key_times, *_) in channels
                                             if node in nodes and path != "scale"]))  # fmt: skip
            times, frames = evaluators.compute_frame_times(keys, len(clip), clip.fps), _choose_frames(len(clip))
            _, world = evaluators.evaluate_gltf(content, times[frames], near_s=_NEAR / clip.fps)
    except evaluators.MustRefuseError as error:
        raise WrongMotionError(f"{error}: read, though no program may") from error
    except Exception:  # a broken file may raise anything
        return False
    last = keys[0] + (len(clip) - 1) / clip.fps
    if abs(last - keys[-1]) * clip.fps > 1.0 + _NEAR:
        raise WrongMotionError(f"keys from {keys[0]:g} to {keys[-1]:g} s are read as frames to {last:g} s")
    return _compare(clip, frames, world[:, nodes], "node")


def judge_npz(content: bytes, clip: Clip) -> bool:
    """Judges the joints of an archive by its arrays, and by the BVH file that the clip is written as."""
    try:
        with np.errstate(all="ignore"):
            stored = {name: np.load(io.BytesIO(member)) for name, member in unpack(content).items()}
            head = json.loads(str(stored["head.npy"]))
            local, parents = _to_matrices(stored["local_rotations.npy"]), stored["parents.npy"]
            translations = stored.get(
                "translations.npy", np.broadcast_to(stored["offsets.npy"], local.shape[:-1])
            ).copy()
            translations[:, 0] = stored["root_positions.npy"]
            world = _compute_world(local, translations, parents)
    except Exception:  # a broken file may raise anything
        return False
    if list(clip.skeleton.names) != head["names"] or clip.fps != head["fps"] or len(clip) != len(world):
        raise WrongMotionError("names, frame rate or number of frames are others than in the archive")
    frames = _choose_frames(len(clip))
    return _compare(clip, frames, world[frames], "joint") and judge_written(clip)


def judge_written(clip: Clip) -> bool:
    """Judges the joints of the BVH file that a clip is written as."""
    try:
        written = formats.encode(clip, "written.bvh")
    except InputError:  # names that BVH cannot hold
        return True
    names, world = evaluators.evaluate_bvh(written)
    expected = bvh.written_names(clip)
    if {*names} != {*expected}:
        raise WrongMotionError("joints have other names in the BVH that is written")
    order = [names.index(name) for name in expected]
    frames = _choose_frames(len(clip))
    return _compare(clip, frames, world[frames][:, order], "written joint", _ROUNDED)


def judge_lexicon(truth: Mapping[str, Sequence[Clip]], loaded: lexicon.Lexicon) -> bool:
    """Judges every word by the clips that the lexicon was made from: ``truth``, gloss or synonym -> clips."""
    clips: dict[str, Clip] = {}
    try:
        with lexicon.open(loaded.path) as opened:
            for name in truth:
                with suppress(InputError):
                    clips[name] = opened.clip(name)
    except InputError:
        return False
    for name, clip in clips.items():
        if not any(_is_same(clip, true_clip) for true_clip in truth[name]):
            raise WrongMotionError(f"word {name} has another motion")
    return bool(clips)


def _is_same(first: Clip, second: Clip) -> bool:
    arrays = ((clip.skeleton.offsets, clip.skeleton.parents, clip.local_rotations, clip.root_positions,
               np.zeros(0) if clip.translations is None else clip.translations)
              for clip in (first, second))  # fmt: skip
    return (first.fps, first.skeleton.names) == (second.fps, second.skeleton.names) and all(
        np.array_equal(first_array, second_array) for first_array, second_array in zip(*arrays, strict=True)
    )


def judge_avatar(content: bytes, avatar: Avatar) -> bool:
    """Judges the joints of an avatar at rest, relative to its root; an avatar of VRM 0.x, which faces -Z, is turned."""
    try:
        with np.errstate(all="ignore"):
            nodes = _find_nodes(content, avatar.names)
            fuzz_gltf_rules.check(content, nodes, has_animation=False)
            _, world = evaluators.evaluate_gltf(content, 0.0, animation=None)
    except evaluators.MustRefuseError as error:
        raise WrongMotionError(f"{error}: read, though no program may") from error
    except Exception:  # a broken file may raise anything
        return False
    positions = world[0, nodes, :3, 3] - world[0, nodes[0], :3, 3]
    extensions = evaluators.GltfFile(content).json.get("extensions") or {}
    if "VRM" in extensions and "VRMC_vrm" not in extensions:
        positions = positions * [-1.0, 1.0, -1.0]
    read_positions = np.zeros((len(avatar), 3))
    for joint in range(1, len(avatar)):
        read_positions[joint] = read_positions[avatar.parents[joint]] + avatar.offsets[joint]
    errors = np.linalg.norm(read_positions - positions, axis=1)
    if not np.isfinite(positions).all() or errors.max() > TOLERANCE * np.ptp(positions, axis=0).max():
        raise WrongMotionError(f"node {avatar.names[int(errors.argmax())]!r} at rest is {errors.max():.3g} off")
    return True


def _compare(clip: Clip, frames: np.ndarray, world: np.ndarray, kind: str, rounded: float = 0.0) -> bool:
    """Returns True if the joints of a clip have the matrices ``world`` (F, J, 4, 4) at ``frames`` (F,), except for a
    rotation of each joint that is the same in all frames: readers choose the rest pose. Raises ``WrongMotionError``
    otherwise. ``rounded``: error of a position that the file's rounding explains.
    """
    local = _to_matrices(clip.local_rotations[frames])
    translations = np.array(clip.translations[frames] if clip.translations is not None
                     else np.broadcast_to(clip.skeleton.offsets, local.shape[:-1]))  # fmt: skip
    translations[:, 0] = clip.root_positions[frames]
    read_world = _compute_world(local, translations, clip.skeleton.parents)
    with np.errstate(all="ignore"):
        extent = np.ptp(world[..., :3, 3], axis=1).max(axis=-1)  # (F,)
        max_error = np.maximum(TOLERANCE * extent, 1e-9 * np.abs(world[..., :3, 3]).max(axis=(1, 2))) + rounded
        errors = np.linalg.norm(world[..., :3, 3] - read_world[..., :3, 3], axis=-1)  # (F, J)
        axes = world[..., :3, :3] / np.linalg.norm(world[..., :3, :3], axis=-2, keepdims=True)
        rest_rotations = np.swapaxes(axes[:1], -1, -2) @ read_world[:1, :, :3, :3]  # (1, J, 3, 3)
        axis_errors = np.abs(axes @ rest_rotations - read_world[..., :3, :3]).max(axis=(-1, -2))  # (F, J)
        wrong = ~((errors <= max_error[:, None]) & (axis_errors <= _TURNED))  # NaN is wrong
    if wrong.any():
        frame, joint = np.argwhere(wrong)[0]
        raise WrongMotionError(
            f"{kind} {clip.skeleton.names[joint]!r} at frame {frames[frame]} is {errors[frame, joint]:.3g} off in a "
            f"rig of {extent[frame]:.3g}, its axes by {axis_errors[frame, joint]:.3g}"
        )
    return True


def _find_nodes(content: bytes, names: Sequence[str]) -> list[int]:
    """Returns the nodes of joints by name. Raises ``ValueError`` if two nodes have the name of a joint."""
    nodes_by_name: dict[str, list[int]] = {}
    for n, node in enumerate(evaluators.GltfFile(content).json["nodes"]):
        name = node.get("name")
        nodes_by_name.setdefault((name if isinstance(name, str) else "") or f"node {n}", []).append(n)
    return [node for name in names for (node,) in (nodes_by_name[name],)]


def _choose_frames(n_frames: int) -> np.ndarray:
    """Returns the frames that are compared, first and last among them."""
    return np.unique(np.linspace(0, n_frames - 1, min(n_frames, _JUDGED_FRAMES)).round().astype(np.int64))


def _compute_world(local: np.ndarray, translations: np.ndarray, parents: Sequence[int] | np.ndarray) -> np.ndarray:
    """Returns matrices (F, J, 4, 4) to the world of joints with rotations (F, J, 3, 3) and translations (F, J, 3)."""
    world = np.zeros((*local.shape[:2], 4, 4))
    world[..., :3, :3], world[..., :3, 3], world[..., 3, 3] = local, translations, 1.0
    for joint in range(1, len(parents)):
        world[:, joint] = world[:, parents[joint]] @ world[:, joint]
    return world


def _to_matrices(quats: np.ndarray) -> np.ndarray:
    """Returns matrices (..., 3, 3) of quaternions (..., 4), x y z w."""
    return evaluators.to_matrices(quats.reshape(-1, 4).astype(np.float64)).reshape(*quats.shape[:-1], 3, 3)
