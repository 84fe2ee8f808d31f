"""What independent programs say of a file that was read: that the same motion is in it, or that nothing can be said.

Each oracle takes the bytes of a file and what the program read of them. True where it has judged them, False where it
cannot: the file is so broken that no other program could say what it holds. Raises ``WrongMotionError`` where the
program read something else than is there, or read what no program may.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import evaluators
import fuzz_gltf_rules
from fuzz_clips import unpacked
from signsplice import formats, lexicon
from signsplice.body.capsules import Avatar
from signsplice.errors import InputError
from signsplice.motion import Clip
from signsplice.rig.inspection import left_out_warnings

TOLERANCE = 1e-4
"""Greatest distance between where a joint is read and where it is, as a fraction of the rig's extent."""
_TURNED = 1e-3
"""Greatest difference of a joint's axes, as components of unit vectors."""
_NEAR = 1e-3
"""Fraction of a frame by which a key's time may be off: files hold times in 32 bits."""
_JUDGED_FRAMES = 24
"""Most frames of a clip that are compared: the evaluators are slow."""
_RATE, _NAMED_RATE = 0.0025, 0.0101
"""Greatest error of a frame rate that a rounded Frame Time may stand for, without and with a warning."""


class WrongMotionError(AssertionError):
    """A file was read, but not as what it is."""


def of_bvh(content: bytes, read: Clip) -> bool:
    """The joints of a BVH file and its Frame Time by ``evaluators``."""
    try:
        with np.errstate(all="ignore"):
            names, world = evaluators.bvh_worlds(content)
            frame_time = evaluators.bvh_frame_time(content)
    except Exception:  # of a broken file
        return False
    if len(names) != len(read.skeleton) or len(world) != len(read):
        raise WrongMotionError(f"{len(read)} frames of {len(read.skeleton)} joints are {len(world)} of {len(names)}")
    if abs(read.fps * frame_time - 1.0) > (_NAMED_RATE if left_out_warnings(read) else _RATE):
        raise WrongMotionError(f"Frame Time {frame_time:g} is read as {read.fps:g} fps")
    frames = _chosen(len(read))
    return _compare(read, frames, world[frames], "joint")


def of_gltf(content: bytes, read: Clip) -> bool:
    """The joints of a glTF file by ``evaluators``, at the times that the clip's frames have."""
    try:
        with np.errstate(all="ignore"):
            nodes = _nodes(content, read.skeleton.names)
            fuzz_gltf_rules.check(content, nodes, bool(left_out_warnings(read)))
            channels = evaluators._File(content).channels(0).items()
            keys = np.unique(np.concatenate([of for (node, path), (of, *_) in channels
                                             if node in nodes and path != "scale"]))  # fmt: skip
            times, frames = evaluators.frame_times(keys, len(read), read.fps), _chosen(len(read))
            _, world = evaluators.gltf_worlds(content, times[frames], near_s=_NEAR / read.fps)
    except evaluators.MustRefuseError as error:
        raise WrongMotionError(f"{error}: read, though no program may") from error
    except Exception:  # of a broken file
        return False
    last = keys[0] + (len(read) - 1) / read.fps
    if abs(last - keys[-1]) * read.fps > 1.0 + _NEAR:
        raise WrongMotionError(f"keys from {keys[0]:g} to {keys[-1]:g} s are read as frames to {last:g} s")
    return _compare(read, frames, world[:, nodes], "node")


def of_npz(content: bytes, read: Clip) -> bool:
    """The joints of an archive by its arrays, and those of the BVH that the clip is written as."""
    try:
        with np.errstate(all="ignore"):
            stored = {name: np.load(io.BytesIO(member)) for name, member in unpacked(content).items()}
            head = json.loads(str(stored["head.npy"]))
            local, parents = _matrices(stored["local_rotations.npy"]), stored["parents.npy"]
            moved = stored.get("translations.npy", np.broadcast_to(stored["offsets.npy"], local.shape[:-1])).copy()
            moved[:, 0] = stored["root_positions.npy"]
            world = _forward(local, moved, parents)
    except Exception:  # of a broken file
        return False
    if list(read.skeleton.names) != head["names"] or read.fps != head["fps"] or len(read) != len(world):
        raise WrongMotionError("names, frame rate or number of frames are others than in the archive")
    frames = _chosen(len(read))
    return _compare(read, frames, world[frames], "joint") and of_written(read)


def of_written(read: Clip) -> bool:
    """The joints of the BVH file that a clip is written as."""
    try:
        written = formats.encode(read, "written.bvh")
    except InputError:  # names that BVH cannot hold
        return True
    names, world = evaluators.bvh_worlds(written)
    if {*names} != {*read.skeleton.names}:
        raise WrongMotionError("joints have other names in the BVH that is written")
    order = [names.index(name) for name in read.skeleton.names]
    frames = _chosen(len(read))
    return _compare(read, frames, world[frames][:, order], "written joint")


def of_lexicon(truth: Mapping[str, Sequence[Clip]], read: lexicon.Lexicon) -> bool:
    """Every word that is read, beside those that the lexicon was made from: ``truth``, gloss or synonym -> clips."""
    try:
        with lexicon.open(read.path) as words:
            found = {name: _word(words, name) for name in truth}
    except InputError:
        return False
    for name, clip in found.items():
        if clip is not None and not any(_is_same(clip, true) for true in truth[name]):
            raise WrongMotionError(f"word {name} has another motion")
    return any(clip is not None for clip in found.values())


def _word(words: lexicon.Lexicon, name: str) -> Clip | None:
    try:
        return words.clip(name)
    except InputError:
        return None


def _is_same(one: Clip, other: Clip) -> bool:
    arrays = ((clip.skeleton.offsets, clip.skeleton.parents, clip.local_rotations, clip.root_positions,
               np.zeros(0) if clip.translations is None else clip.translations) for clip in (one, other))  # fmt: skip
    return (one.fps, one.skeleton.names) == (other.fps, other.skeleton.names) and all(
        np.array_equal(mine, true) for mine, true in zip(*arrays, strict=True)
    )


def of_avatar(content: bytes, read: Avatar) -> bool:
    """The joints of an avatar at rest, relative to its root; an avatar of VRM 0.x, which faces -Z, is turned."""
    try:
        with np.errstate(all="ignore"):
            nodes = _nodes(content, read.names)
            fuzz_gltf_rules.check(content, nodes, animation=False)
            _, world = evaluators.gltf_worlds(content, 0.0, animation=None)
    except evaluators.MustRefuseError as error:
        raise WrongMotionError(f"{error}: read, though no program may") from error
    except Exception:  # of a broken file
        return False
    at = world[0, nodes, :3, 3] - world[0, nodes[0], :3, 3]
    extensions = _json(content).get("extensions") or {}
    if "VRM" in extensions and "VRMC_vrm" not in extensions:
        at = at * [-1.0, 1.0, -1.0]
    found = np.zeros((len(read), 3))
    for joint in range(1, len(read)):
        found[joint] = found[read.parents[joint]] + read.offsets[joint]
    off = np.linalg.norm(found - at, axis=1)
    if not np.isfinite(at).all() or off.max() > TOLERANCE * np.ptp(at, axis=0).max():
        raise WrongMotionError(f"node {read.names[int(off.argmax())]!r} at rest is {off.max():.3g} off")
    return True


def _compare(read: Clip, frames: np.ndarray, world: np.ndarray, what: str) -> bool:
    """True where the joints of a clip have the matrices ``world`` (F, J, 4, 4) at ``frames`` (F,), but for a rotation
    of each joint that is the same in all frames: readers choose the pose of rest. Raises ``WrongMotionError`` where
    they have not.
    """
    local = _matrices(read.local_rotations[frames])
    moved = np.array(read.translations[frames] if read.translations is not None
                     else np.broadcast_to(read.skeleton.offsets, local.shape[:-1]))  # fmt: skip
    moved[:, 0] = read.root_positions[frames]
    found = _forward(local, moved, read.skeleton.parents)
    with np.errstate(all="ignore"):
        extent = np.ptp(world[..., :3, 3], axis=1).max(axis=-1)  # (F,)
        most = np.maximum(TOLERANCE * extent, 1e-12 * np.abs(world[..., :3, 3]).max(axis=(1, 2)))
        off = np.linalg.norm(world[..., :3, 3] - found[..., :3, 3], axis=-1)  # (F, J)
        axes = world[..., :3, :3] / np.linalg.norm(world[..., :3, :3], axis=-2, keepdims=True)
        rest = np.swapaxes(axes[:1], -1, -2) @ found[:1, :, :3, :3]  # (1, J, 3, 3)
        turned = np.abs(axes @ rest - found[..., :3, :3]).max(axis=(-1, -2))  # (F, J)
        wrong = ~((off <= most[:, None]) & (turned <= _TURNED))  # NaN is wrong
    if wrong.any():
        frame, joint = np.argwhere(wrong)[0]
        raise WrongMotionError(
            f"{what} {read.skeleton.names[joint]!r} at frame {frames[frame]} is {off[frame, joint]:.3g} off in a rig "
            f"of {extent[frame]:.3g}, its axes by {turned[frame, joint]:.3g}"
        )
    return True


def _json(content: bytes) -> dict[str, Any]:
    """The document of a glTF file."""
    return evaluators._File(content).json


def _nodes(content: bytes, names: Sequence[str]) -> list[int]:
    """The nodes of joints by name. Raises ``ValueError`` where two nodes have the name of one."""
    found: dict[str, list[int]] = {}
    for n, node in enumerate(_json(content)["nodes"]):
        name = node.get("name")
        found.setdefault((name if isinstance(name, str) else "") or f"node {n}", []).append(n)
    return [node for name in names for (node,) in (found[name],)]


def _chosen(n_frames: int) -> np.ndarray:
    """Frames that are compared, first and last among them."""
    return np.unique(np.linspace(0, n_frames - 1, min(n_frames, _JUDGED_FRAMES)).round().astype(np.int64))


def _forward(local: np.ndarray, moved: np.ndarray, parents: Sequence[int] | np.ndarray) -> np.ndarray:
    """Matrices (F, J, 4, 4) to the world of joints with rotations (F, J, 3, 3) and translations (F, J, 3)."""
    out = np.zeros((*local.shape[:2], 4, 4))
    out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = local, moved, 1.0
    for joint in range(1, len(parents)):
        out[:, joint] = out[:, parents[joint]] @ out[:, joint]
    return out


def _matrices(quats: np.ndarray) -> np.ndarray:
    """Matrices (..., 3, 3) of quaternions (..., 4), x y z w."""
    return evaluators.matrices(quats.reshape(-1, 4).astype(np.float64)).reshape(*quats.shape[:-1], 3, 3)
