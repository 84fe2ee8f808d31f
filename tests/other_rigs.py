"""One motion on other rigs: other axes, units, joint names and rest poses, mirrored, or with joints missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from signsplice.motion import Clip, EndSite, FloatArray, Skeleton, rotation


def on_other_rig(clip: Clip, turn: FloatArray, scale: float, rename: dict[str, str] | None = None) -> Clip:
    """The same motion on a rig whose world axes, rest pose included, are rotated by ``turn``, in a unit ``scale`` times
    as long, with joints renamed.
    """
    local = rotation.multiply(rotation.multiply(turn, clip.local_rotations), rotation.inverse(turn))
    skeleton = Skeleton(
        names=tuple((rename or {}).get(name, name) for name in clip.skeleton.names),
        parents=clip.skeleton.parents,
        offsets=rotation.rotate(turn, clip.skeleton.offsets) * scale,
        end_sites=tuple(EndSite(s.joint, rotation.rotate(turn, s.offset) * scale) for s in clip.skeleton.end_sites),
    )
    return Clip(skeleton, local, rotation.rotate(turn, clip.root_positions) * scale, clip.fps, clip.name + "'")


def with_rest_pose(clip: Clip, pose: dict[str, tuple[float, float, float]]) -> Clip:
    """The same motion on a rig with another rest pose: joint name -> rotation vector from the present rest pose."""
    skeleton = clip.skeleton
    global_quats: list[FloatArray] = []
    for joint, name in enumerate(skeleton.names):
        parent = int(skeleton.parents[joint])
        parent_quat = global_quats[parent] if parent >= 0 else rotation.IDENTITY
        global_quats.append(rotation.multiply(parent_quat, rotation.exp(pose.get(name, (0.0, 0.0, 0.0)))))
    rest = np.stack(global_quats)
    has_parent = (skeleton.parents >= 0)[:, None]
    parent_rest = np.where(has_parent, rest[np.maximum(skeleton.parents, 0)], rotation.IDENTITY)
    offsets = np.where(has_parent, rotation.rotate(parent_rest, skeleton.offsets), skeleton.offsets)
    local = rotation.multiply(rotation.multiply(parent_rest, clip.local_rotations), rotation.inverse(rest))
    other = Skeleton(skeleton.names, skeleton.parents, offsets)
    return Clip(other, local, clip.root_positions, clip.fps, "other rest")


def mirror(clip: Clip) -> Clip:
    """The mirror image of a clip of the synthetic signer, whose rest pose is symmetric."""
    names = clip.skeleton.names
    swapped = [n.replace("Left", "?").replace("Right", "Left").replace("?", "Right") for n in names]
    order = [names.index(name) for name in swapped]
    return replace(
        clip,
        local_rotations=clip.local_rotations[:, order] * [1.0, -1.0, -1.0, 1.0],
        root_positions=clip.root_positions * [-1.0, 1.0, 1.0],
    )


def without(clip: Clip, *parts: str) -> Clip:
    """The clip on a rig without the joints whose names contain one of ``parts``; their children become children of
    the next joint above. The removed joints' rotations are dropped.
    """
    skeleton = clip.skeleton
    removed = [any(part in name for part in parts) for name in skeleton.names]
    kept = [joint for joint in range(len(skeleton)) if not removed[joint]]
    offsets, parents = [], []
    for joint in kept:
        parent, offset = int(skeleton.parents[joint]), np.array(skeleton.offsets[joint])
        while parent >= 0 and removed[parent]:
            offset = offset + skeleton.offsets[parent]
            parent = int(skeleton.parents[parent])
        offsets.append(offset)
        parents.append(kept.index(parent) if parent >= 0 else -1)
    names = tuple(skeleton.names[joint] for joint in kept)
    return Clip(
        Skeleton(names, np.array(parents), np.array(offsets)),
        clip.local_rotations[:, kept],
        clip.root_positions,
        clip.fps,
        clip.name,
    )
