"""Clips of the synthetic signer with reference poses put before or after them, as exporters leave them there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from signsplice.motion import Clip, FloatArray, Skeleton, rotation
from signsplice.rig.info import rig_info


def arms_out(skeleton: Skeleton, lowered_deg: float = 0.0) -> FloatArray:
    """Local rotations (J, 4) of the T-pose, or of an A-pose whose arms are lowered."""
    info = rig_info(skeleton)
    turned = np.array(info.t_pose.rotations)
    for side, sign in (("left", -1.0), ("right", 1.0)):
        below = [info.roles.joints[f"{side}UpperArm"]]
        for joint in below:
            turned[joint] = rotation.multiply(rotation.exp([0.0, 0.0, sign * np.deg2rad(lowered_deg)]), turned[joint])
            below += skeleton.children[joint]
    out = np.array(turned)
    for joint, parent in enumerate(skeleton.parents[1:], start=1):
        out[joint] = rotation.multiply(rotation.inverse(turned[parent]), turned[joint])
    return out


def with_pose(clip: Clip, pose: FloatArray, n_frames: int, n_blend: int = 0, at_end: bool = False) -> Clip:
    """The clip with ``n_frames`` of a pose (J, 4) before or after it, and ``n_blend`` frames of slerp between them."""
    edge = -1 if at_end else 0
    blend = rotation.slerp(pose, clip.local_rotations[edge], np.arange(1, n_blend + 1)[:, None] / (n_blend + 1.0))
    added = np.concatenate([np.repeat(pose[None], n_frames, axis=0), blend])
    root = np.repeat(clip.root_positions[edge][None], len(added), axis=0)
    parts = [(added, root), (clip.local_rotations, clip.root_positions)]
    if at_end:
        parts = [parts[1], (added[::-1], root)]
    rotations, positions = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    return replace(clip, local_rotations=rotations, root_positions=positions, channels=None)
