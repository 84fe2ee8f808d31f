"""Wrists of a clip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import kinematics
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.info import rig_info

Float = NDArray[np.float64]


def wrist_joints(skeleton: Skeleton) -> list[int]:
    """Joints of the left and the right wrist; those whose role is not known are left out."""
    joints = rig_info(skeleton).roles.joints
    return [joints[role] for role in ("leftHand", "rightHand") if role in joints]


def wrist_positions(clip: Clip) -> Float:
    """Positions (T, W, 3) of the wrists in the order of ``wrist_joints``, m."""
    _, positions = kinematics.forward(clip, wrist_joints(clip.skeleton))
    return positions * rig_info(clip.skeleton).sizes.unit.metres


def right_wrist(clip: Clip) -> Float:
    """Positions (T, 3) of the right wrist, m, on a rig with both hands known."""
    return wrist_positions(clip)[:, 1]
