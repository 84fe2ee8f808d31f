"""Body proportions: arm length, shoulder width, stature, and the length unit that they suggest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Skeleton
from signsplice.motion.kinematics import rest_positions
from signsplice.rig.roles import Humanoid

STATURE_M = 1.70
"""A grown person's height, against which a skeleton's numbers are read as metres, centimetres, ..."""

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048}
"""Length unit -> metres."""
_PERSON_M = (0.5, 2.8)
"""Heights outside of which a body is no person's, and the unit in which it has them is none of ``UNITS``."""

# Chains of joints -> length between joint centres as a fraction of stature (Drillis and Contini 1966, in Winter 2009,
# fig. 4.1).
_ARMS = (("leftUpperArm", "leftLowerArm", "leftHand"), ("rightUpperArm", "rightLowerArm", "rightHand"))
_LEGS = (("leftUpperLeg", "leftLowerLeg", "leftFoot"), ("rightUpperLeg", "rightLowerLeg", "rightFoot"))
_ARM_FRACTION, _LEG_FRACTION = 0.186 + 0.146, 0.245 + 0.246
_SHOULDER_FRACTION = 0.259


@dataclass(frozen=True)
class LengthUnit:
    """The length unit that a skeleton seems to be in.

    name: a key of ``UNITS``; "unknown" where no person has the body's height in any of them.
    metres: length of one unit.
    stature_m: body height that follows, m; 0 for a skeleton without extent.
    """

    name: str
    metres: float
    stature_m: float


@dataclass(frozen=True)
class BodySizes:
    """What a body measures.

    stature: body height from arm and leg lengths, clip units; the rest pose's extent where no limb is known.
    arm_length: shoulder to wrist, clip units.
    shoulder_width: distance of the two shoulder joints, clip units.
    unit: the length unit.
    """

    stature: float
    arm_length: float
    shoulder_width: float
    unit: LengthUnit


def measure(skeleton: Skeleton, roles: Humanoid, t_pose_positions: Callable[[], FloatArray]) -> BodySizes:
    """The sizes of a body with these roles; ``t_pose_positions`` gives joint positions (J, 3), asked
    only where both shoulders are known.

    Where arms or shoulders are not known, their size follows from stature.
    """
    height = stature(skeleton, roles)
    arms = [length for length in (chain_length(skeleton, roles, chain) for chain in _ARMS) if length > 0.0]
    shoulders = [roles.joints[role] for role in ("leftUpperArm", "rightUpperArm") if role in roles.joints]
    width = _SHOULDER_FRACTION * height
    if len(shoulders) == 2:
        left, right = t_pose_positions()[shoulders]
        width = float(np.linalg.norm(left - right))
    return BodySizes(height, float(np.mean(arms)) if arms else 0.332 * height, width, length_unit(height))


def chain_length(skeleton: Skeleton, roles: Humanoid, chain: tuple[str, ...]) -> float:
    """Length of the path through the joints of a chain of roles, clip units; 0.0 where one is missing."""
    joints = [roles.joints[role] for role in chain if role in roles.joints]
    if len(joints) < len(chain):
        return 0.0
    positions = rest_positions(skeleton)[joints]
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=-1).sum())


def stature(skeleton: Skeleton, roles: Humanoid) -> float:
    """Body height in clip units, from the lengths of arms and legs; the rest pose's extent where no limb is known."""
    chains = [(chain, _ARM_FRACTION) for chain in _ARMS] + [(chain, _LEG_FRACTION) for chain in _LEGS]
    lengths = [(chain_length(skeleton, roles, chain), fraction) for chain, fraction in chains]
    heights = [length / fraction for length, fraction in lengths if length > 0.0]
    if heights:
        return float(np.median(heights))
    positions = rest_positions(skeleton)
    return float(np.max(np.ptp(positions, axis=0))) if len(positions) > 1 else 0.0


def length_unit(height: float) -> LengthUnit:
    """The unit in which a body of this height (clip units) comes nearest to a grown person (m, cm, mm, inch or foot);
    one in which it is a grown person where it is no person in any of these.

    A child of 1.1 m or a giant of 2.7 m is still read right; a body outside those limits may not be.
    """
    if height <= 0.0:
        return LengthUnit("m", 1.0, 0.0)
    name = min(UNITS, key=lambda unit: abs(np.log(height * UNITS[unit] / STATURE_M)))
    if not _PERSON_M[0] <= height * UNITS[name] <= _PERSON_M[1]:
        return LengthUnit("unknown", STATURE_M / height, STATURE_M)
    return LengthUnit(name, UNITS[name], height * UNITS[name])
