"""Bends of finger joints."""

from __future__ import annotations

import numpy as np

from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig.info import rig_info
from signsplice.rig.naming import SIDES
from signsplice.rig.roles import FINGERS, finger_roles


def flexions(clip: Clip) -> dict[str, FloatArray]:
    """Finger and joint number ("Index 2") -> its bend in every frame, degrees, left hand then right (2 T,).

    The bend is the angle between the bones on either side; joint 1 is the nearest to the wrist. Fingers whose joints a
    rig lacks are left out.
    """
    roles = rig_info(clip.skeleton).roles.joints
    rotations, positions = kinematics.forward(clip)
    tip_positions = np.swapaxes(kinematics.tip_positions(clip, rotations, positions), 0, 1)
    tips = dict(zip((site.joint for site in clip.skeleton.end_sites), tip_positions, strict=True))
    out: dict[str, list[FloatArray]] = {}
    for side in SIDES:
        for finger in FINGERS:
            chain = [f"{side}Hand", *(side + role for role in finger_roles(finger))]
            if not all(role in roles for role in chain):
                continue
            points = [positions[:, roles[role]] for role in chain]  # (T, 3) each
            last = roles[chain[-1]]
            children = clip.skeleton.children[last]
            if last in tips:
                points.append(tips[last])
            elif children:
                points.append(positions[:, children[0]])
            for n, (a, b, c) in enumerate(zip(points[:-2], points[1:-1], points[2:], strict=True), 1):
                u, v = b - a, c - b
                cosine = (u * v).sum(-1) / np.maximum(np.linalg.norm(u, axis=-1) * np.linalg.norm(v, axis=-1), 1e-12)
                out.setdefault(f"{finger} {n}", []).append(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))
    return {name: np.concatenate(rows) for name, rows in out.items()}
