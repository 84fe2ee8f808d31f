"""Positions of joints and annotations of a sentence, named and laid out as sign-language-data-loading reads them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.clip import Clip
from signsplice.motion.kinematics import forward, tip_positions
from signsplice.rig.info import rig_info
from signsplice.rig.naming import SIDES
from signsplice.rig.roles import FINGERS, finger_roles
from signsplice.splicing.result import Span

Float32 = NDArray[np.float32]

UPPER_POSE = ("head", "neck", *(side + part for side in SIDES for part in ("UpperArm", "LowerArm", "Hand")))
"""Joints of ``upper_pose``, in order: the arms' are shoulder, elbow and wrist."""


def poses(clip: Clip) -> dict[str, Float32]:
    """Positions of joints in metres, ``upper_pose`` (T, 8, 3), ``left_hand`` and ``right_hand`` (T, 21, 3): the wrist,
    and of thumb to little finger three joints and the tip, which is the order of MediaPipe. Axes are those of the clip.

    A joint that the rig lacks lies where the one lies from which it would hang. Empty where the rig's arms are not
    known by name.
    """
    info = rig_info(clip.skeleton)
    if not info.has_arms:
        return {}
    rotations, positions = forward(clip)
    tips = tip_positions(clip, rotations, positions)
    tip_of = {site.joint: tips[:, k] for k, site in enumerate(clip.skeleton.end_sites)}
    joints, metres = info.roles.joints, info.sizes.unit.metres

    def place(*roles: str) -> NDArray[np.float64]:
        return positions[:, next((joints[role] for role in roles if role in joints), 0)]

    found = {"upper_pose": [place(role, "head", "neck") for role in UPPER_POSE]}
    for side in SIDES:
        points = [place(f"{side}Hand")]
        for finger in FINGERS:
            line = [f"{side}Hand"]
            for role in finger_roles(finger):
                line.insert(0, side + role)
                points.append(place(*line))
            last = next(joints[role] for role in line if role in joints)
            points.append(tip_of.get(last, points[-1]))
        found[f"{side}_hand"] = points
    return {name: (metres * np.stack(points, 1)).astype(np.float32) for name, points in found.items()}


def signs(spans: Sequence[Span], fps: float) -> list[dict[str, Any]]:
    """The signs of a sentence: first and last frame, both included, their times in ms, and ``lemma``, the gloss."""
    found = [(span.name, span.output) for span in spans if span.kind == "sign" and span.output[1] > span.output[0]]
    return [
        {
            "start_frame": start,
            "end_frame": stop - 1,
            "start_ms": round(1e3 * start / fps),
            "end_ms": round(1e3 * (stop - 1) / fps),
            "lemma": name,
        }
        for name, (start, stop) in found
    ]
