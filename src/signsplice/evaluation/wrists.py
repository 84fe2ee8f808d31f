"""Wrists of a clip."""

from __future__ import annotations

import numpy as np

from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.info import rig_info
from signsplice.synth.corpus import Pairs


def wrist_joints(skeleton: Skeleton) -> list[int]:
    """Joints of the left and the right wrist; those whose role is not known are left out."""
    joints = rig_info(skeleton).roles.joints
    return [joints[role] for role in ("leftHand", "rightHand") if role in joints]


def wrist_positions(clip: Clip) -> FloatArray:
    """Positions (T, W, 3) of the wrists in the order of ``wrist_joints``, m."""
    _, positions = kinematics.forward(clip, wrist_joints(clip.skeleton))
    return positions * rig_info(clip.skeleton).sizes.unit.metres


def strong_wrist(clip: Clip, strong: str) -> FloatArray:
    """Positions (T, 3) of the wrist of the strong side ("left" or "right"), m, on a rig with both hands known."""
    return wrist_positions(clip)[:, 0 if strong == "left" else 1]


def strong_side(pairs: Pairs, word: int = 0) -> str:
    """The strong side, "left" or "right", of the signer of a corpus's word, by default of the first signer."""
    return "left" if pairs.signers[word >= len(pairs.head["words"]) // 2].left_handed else "right"


def busier_side(clip: Clip) -> str:
    """The side, "left" or "right", whose wrist moves farther, which is taken for a real signer's strong side."""
    left, right = np.linalg.norm(np.diff(wrist_positions(clip), axis=0), axis=-1).sum(axis=0)
    return "left" if left > right else "right"
