"""One motion in other clothes: rigs of other axes, units, names and rest poses, and the mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from signing import MIRRORED
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, EndSite, Skeleton

Float = rotation.Float


def in_other_clothes(clip: Clip, turn: Float, scale: float, rename: dict[str, str] | None = None) -> Clip:
    """The same motion by a rig whose whole world, rest pose included, is turned, in another unit, with other names."""
    local = rotation.multiply(rotation.multiply(turn, clip.local_rotations), rotation.inverse(turn))
    skeleton = Skeleton(
        names=tuple((rename or {}).get(name, name) for name in clip.skeleton.names),
        parents=clip.skeleton.parents,
        offsets=rotation.rotate(turn, clip.skeleton.offsets) * scale,
        end_sites=tuple(EndSite(s.joint, rotation.rotate(turn, s.offset) * scale) for s in clip.skeleton.end_sites),
    )
    return Clip(skeleton, local, rotation.rotate(turn, clip.root_positions) * scale, clip.fps, clip.name + "'")


def with_rest_pose(clip: Clip, pose: dict[str, tuple[float, float, float]]) -> Clip:
    """The same motion by a rig that rests in another pose: rotation vectors of some joints, by name."""
    skeleton = clip.skeleton
    turns: list[Float] = []
    for joint, name in enumerate(skeleton.names):
        parent = int(skeleton.parents[joint])
        above = turns[parent] if parent >= 0 else rotation.IDENTITY
        turns.append(rotation.multiply(above, rotation.exp(pose.get(name, (0.0, 0.0, 0.0)))))
    rest = np.stack(turns)
    parents = np.maximum(skeleton.parents, 0)
    offsets = np.where(
        (skeleton.parents >= 0)[:, None], rotation.rotate(rest[parents], skeleton.offsets), skeleton.offsets
    )
    above = np.where((skeleton.parents >= 0)[:, None], rest[parents], rotation.IDENTITY)
    local = rotation.multiply(rotation.multiply(above, clip.local_rotations), rotation.inverse(rest))
    other = Skeleton(tuple(f"{name}" for name in skeleton.names), skeleton.parents, offsets)
    return Clip(other, local, clip.root_positions, clip.fps, "other rest")


def mirror(clip: Clip) -> Clip:
    """A clip of the procedural signer, whose rest pose is its own mirror image."""
    names = clip.skeleton.names
    swapped = [n.replace("Left", "?").replace("Right", "Left").replace("?", "Right") for n in names]
    order = [names.index(name) for name in swapped]
    return replace(
        clip,
        local_rotations=clip.local_rotations[:, order] * MIRRORED,
        root_positions=clip.root_positions * [-1.0, 1.0, 1.0],
    )


def without(clip: Clip, *parts: str) -> Clip:
    """The clip by a rig that lacks the joints whose names contain one of ``parts``; what hangs below them hangs from
    the joint above, and they themselves are taken not to have turned.
    """
    skeleton = clip.skeleton
    gone = [any(part in name for part in parts) for name in skeleton.names]
    kept = [joint for joint, dropped in enumerate(gone) if not dropped]
    offsets, parents = [], []
    for joint in kept:
        over, offset = int(skeleton.parents[joint]), np.array(skeleton.offsets[joint])
        while over >= 0 and gone[over]:
            offset = offset + skeleton.offsets[over]
            over = int(skeleton.parents[over])
        offsets.append(offset)
        parents.append(kept.index(over) if over >= 0 else -1)
    names = tuple(skeleton.names[joint] for joint in kept)
    return Clip(
        Skeleton(names, np.array(parents), np.array(offsets)),
        clip.local_rotations[:, kept],
        clip.root_positions,
        clip.fps,
        clip.name,
    )
