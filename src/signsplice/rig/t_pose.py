"""The T-pose of a rig, which does not depend on its rest pose, and its body sizes.

In the T-pose up is +Y, forward is +Z, the signer's left is +X, palms face down. The rest pose of a file (all rotations
identity) may lie on its back, hold its arms forward or bend its fingers. In the T-pose, bones of all rigs have the same
directions. Sizes are arm length, shoulder width, stature, and the length unit that they suggest.

"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from signsplice.motion import FloatArray, Skeleton, rotation
from signsplice.motion.kinematics import global_quats, rest_positions
from signsplice.rig.roles import Humanoid

# Where each bone points: role -> (role at the bone's other end, direction).
_T_POSE_BONES: dict[str, tuple[str, FloatArray]] = {}
for _side, _x in (("left", 1.0), ("right", -1.0)):
    _out = np.array([_x, 0.0, 0.0])
    _T_POSE_BONES[f"{_side}Shoulder"] = (f"{_side}UpperArm", _out)
    _T_POSE_BONES[f"{_side}UpperArm"] = (f"{_side}LowerArm", _out)
    _T_POSE_BONES[f"{_side}LowerArm"] = (f"{_side}Hand", _out)
    for _finger in ("Index", "Middle", "Ring", "Little"):
        _T_POSE_BONES[f"{_side}{_finger}Proximal"] = (f"{_side}{_finger}Intermediate", _out)
        _T_POSE_BONES[f"{_side}{_finger}Intermediate"] = (f"{_side}{_finger}Distal", _out)
    _slant = np.array([_x, -0.5, 1.0]) / 1.5
    _T_POSE_BONES[f"{_side}ThumbMetacarpal"] = (f"{_side}ThumbProximal", _slant)
    _T_POSE_BONES[f"{_side}ThumbProximal"] = (f"{_side}ThumbDistal", _slant)
    _T_POSE_BONES[f"{_side}UpperLeg"] = (f"{_side}LowerLeg", np.array([0.0, -1.0, 0.0]))
    _T_POSE_BONES[f"{_side}LowerLeg"] = (f"{_side}Foot", np.array([0.0, -1.0, 0.0]))
_UPRIGHT = (
    "hips",
    "spine",
    "chest",
    "upperChest",
    "neck",
    "head",
    "jaw",
    "leftEye",
    "rightEye",
    "leftFoot",
    "rightFoot",
)
_BENT_DEG = 20.0
"""Bend of last phalanges, degrees, above which they are straightened; tips of straight fingers may point anywhere."""


@dataclass(frozen=True, eq=False)
class TPose:
    """A skeleton in the T-pose; the arrays are read-only.

    rotations: (J, 4) global rotations that bring the rest skeleton into the T-pose.
    positions: (J, 3) joint positions there, the root at the origin, clip units.
    """

    rotations: FloatArray
    positions: FloatArray


def t_pose(skeleton: Skeleton, roles: Humanoid) -> TPose:
    """The T-pose of a skeleton with these roles.

    Trunk, head and feet are rotated as one, from the own up and left of the rest pose: the skeleton's ``rest_pose``, or
    all rotations at identity. Limbs and fingers are then swung until their bones point as in the T-pose, last phalanges
    only if they are clearly bent. A hand follows the direction to its middle knuckle and its line of knuckles.
    Joints without a role follow their parents.
    """
    rotations = _rotations(skeleton, roles.joints)
    positions = positions_from_rotations(skeleton, rotations)
    for array in (rotations, positions):
        array.flags.writeable = False
    return TPose(rotations, positions)


def positions_from_rotations(skeleton: Skeleton, rotations: FloatArray) -> FloatArray:
    """Joint positions (J, 3) under global rotations (J, 4), the root at the origin, clip units."""
    positions = np.zeros((len(skeleton), 3))
    for joint in range(1, len(skeleton)):
        parent = skeleton.parents[joint]
        positions[joint] = positions[parent] + rotation.rotate(rotations[parent], skeleton.offsets[joint])
    return positions


def _rotations(skeleton: Skeleton, joints: Mapping[str, int]) -> FloatArray:
    role_of = {joint: role for role, joint in joints.items()}
    rested = None if skeleton.rest_pose is None else global_quats(skeleton, skeleton.rest_pose)
    rest = rest_positions(skeleton) if rested is None else positions_from_rotations(skeleton, rested)
    upright = _upright(rest, joints)
    rotations = np.empty((len(skeleton), 4))
    for joint in range(len(skeleton)):
        role = role_of.get(joint, "")
        parent = skeleton.parents[joint]
        q = upright if parent < 0 or role in _UPRIGHT else rotations[parent]
        if role in _T_POSE_BONES:
            child, direction = _T_POSE_BONES[role]
            if child in joints:
                bone = rotation.rotate(q, rest[joints[child]] - rest[joint])
                q = rotation.multiply(rotation.between_vectors(bone, direction), q)
        elif role in ("leftHand", "rightHand"):
            q = _hand_to_t_pose(role.removesuffix("Hand"), rest, joints, q)
        elif role.endswith("Distal") and "Thumb" not in role:
            tip = _tip(skeleton, joint)
            bone = rotation.rotate(q, tip if rested is None else rotation.rotate(rested[joint], tip))
            outwards = np.array([1.0 if role.startswith("left") else -1.0, 0.0, 0.0])
            if bone @ outwards < np.cos(np.deg2rad(_BENT_DEG)) * np.linalg.norm(bone):
                q = rotation.multiply(rotation.between_vectors(bone, outwards), q)
        rotations[joint] = q
    return rotations if rested is None else rotation.multiply(rotations, rested)


def _tip(skeleton: Skeleton, joint: int) -> FloatArray:
    """Returns the offset (3,) of a finger's tip from its last joint, in its axes; zero if unknown."""
    ends = [skeleton.offsets[child] for child in skeleton.children[joint]]
    ends += [site.offset for site in skeleton.end_sites if site.joint == joint]
    return ends[0] if ends else np.zeros(3)


def _upright(rest: FloatArray, joints: Mapping[str, int]) -> FloatArray:
    """Rotation (4,) that brings the rest pose's up to +Y and its left to +X."""
    top = next((joints[r] for r in ("head", "neck", "upperChest", "chest", "spine") if r in joints), None)
    for part in ("UpperLeg", "Shoulder", "UpperArm"):  # hips and collar bones lie across in any rest pose; arms may not
        left_joint, right_joint = joints.get(f"left{part}"), joints.get(f"right{part}")
        if top is not None and left_joint is not None and right_joint is not None:
            to_left, up = rest[left_joint] - rest[right_joint], rest[top] - rest[joints.get("hips", 0)]
            if np.linalg.norm(np.cross(to_left, up)) > 1e-9 * np.linalg.norm(to_left) * np.linalg.norm(up):
                return _frame(to_left, up)
    return rotation.IDENTITY


def _hand_to_t_pose(side: str, rest: FloatArray, joints: Mapping[str, int], above: FloatArray) -> FloatArray:
    knuckles = [joints.get(f"{side}{finger}Proximal") for finger in ("Index", "Middle", "Little")]
    wrist = joints[f"{side}Hand"]
    sign = 1.0 if side == "left" else -1.0
    if knuckles[1] is None:
        return above
    if knuckles[0] is None or knuckles[2] is None:
        to_middle = rotation.rotate(above, rest[knuckles[1]] - rest[wrist])
        return rotation.multiply(rotation.between_vectors(to_middle, np.array([sign, 0.0, 0.0])), above)
    to_middle, knuckle_line = rest[knuckles[1]] - rest[wrist], rest[knuckles[0]] - rest[knuckles[2]]
    back = np.cross(knuckle_line, to_middle) * sign
    if not np.linalg.norm(back) > 1e-9 * np.linalg.norm(to_middle) * np.linalg.norm(knuckle_line):
        return above  # the knuckles lie in one line with the wrist, or at it: they span no palm
    # Fingers along +-X, the index side forward (+Z): palms down.
    return _frame(to_middle * sign, back)


def _frame(x: FloatArray, y: FloatArray) -> FloatArray:
    """Rotation (4,) that takes the direction ``y`` to +Y and the part of ``x`` at right angles to it to +X."""
    y = y / np.linalg.norm(y)
    x = x - (x @ y) * y
    x = x / np.linalg.norm(x)
    return rotation.from_matrix(np.stack([x, y, np.cross(x, y)]))


STATURE_M = 1.70
"""A grown person's height, against which a skeleton's numbers are read as metres, centimetres, ..."""

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048}
"""Length unit -> metres."""
_PERSON_M = (0.5, 2.8)
"""Range of a person's height, m: a unit of ``UNITS`` that gives a height outside it is not the body's."""

# Chains of joints -> length between joint centres as a fraction of stature (Drillis and Contini 1966, in Winter 2009,
# fig. 4.1).
_ARMS = (("leftUpperArm", "leftLowerArm", "leftHand"), ("rightUpperArm", "rightLowerArm", "rightHand"))
_LEGS = (("leftUpperLeg", "leftLowerLeg", "leftFoot"), ("rightUpperLeg", "rightLowerLeg", "rightFoot"))
_ARM_FRACTION = 0.186 + 0.146
"""Length of an arm without hand over stature."""
_LEG_FRACTION = 0.245 + 0.246
"""Length of a leg without foot over stature."""
_SHOULDER_FRACTION = 0.259
"""Shoulder width over stature."""


@dataclass(frozen=True)
class LengthUnit:
    """The length unit that a skeleton seems to be in.

    name: a key of ``UNITS``; "unknown" if none gives the height of a person.
    metres: length of one unit.
    stature_m: body height that follows, m; 0 for a skeleton without extent.
    """

    name: str
    metres: float
    stature_m: float


@dataclass(frozen=True)
class BodySizes:
    """What a body measures.

    stature: body height from arm and leg lengths, clip units; the rest pose's extent if no limb is known.
    arm_length: shoulder to wrist, clip units.
    shoulder_width: distance of the two shoulder joints, clip units.
    unit: the length unit.
    """

    stature: float
    arm_length: float
    shoulder_width: float
    unit: LengthUnit


def measure(skeleton: Skeleton, roles: Humanoid, t_pose_positions: Callable[[], FloatArray]) -> BodySizes:
    """Measures a body with these roles; ``t_pose_positions`` returns joint positions (J, 3) and is called only if both
    shoulders are known.

    The sizes of unknown arms or shoulders follow from stature.
    """
    height = stature(skeleton, roles)
    arms = [length for length in (chain_length(skeleton, roles, chain) for chain in _ARMS) if length > 0.0]
    shoulders = [roles.joints[role] for role in ("leftUpperArm", "rightUpperArm") if role in roles.joints]
    width = _SHOULDER_FRACTION * height
    if len(shoulders) == 2:
        left_shoulder, right_shoulder = t_pose_positions()[shoulders]
        width = float(np.linalg.norm(left_shoulder - right_shoulder))
    return BodySizes(height, float(np.mean(arms)) if arms else 0.332 * height, width, length_unit(height))


def chain_length(skeleton: Skeleton, roles: Humanoid, chain: tuple[str, ...]) -> float:
    """Returns the length of the path through the joints of a chain of roles, clip units; 0.0 if one is missing."""
    joints = [roles.joints[role] for role in chain if role in roles.joints]
    if len(joints) < len(chain):
        return 0.0
    positions = rest_positions(skeleton)[joints]
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=-1).sum())


def stature(skeleton: Skeleton, roles: Humanoid) -> float:
    """Returns the body height in clip units from the lengths of arms and legs; without them the rest pose's extent."""
    chains = [(chain, _ARM_FRACTION) for chain in _ARMS] + [(chain, _LEG_FRACTION) for chain in _LEGS]
    lengths = [(chain_length(skeleton, roles, chain), fraction) for chain, fraction in chains]
    heights = [length / fraction for length, fraction in lengths if length > 0.0]
    if heights:
        return float(np.median(heights))
    positions = rest_positions(skeleton)
    return float(np.max(np.ptp(positions, axis=0))) if len(positions) > 1 else 0.0


def length_unit(height: float) -> LengthUnit:
    """Returns the unit (m, cm, mm, inch or foot) in which a body of this height (clip units) is closest to an adult's;
    a unit that makes it an adult if none gives a person's height.

    A child of 1.1 m or a giant of 2.7 m is still read correctly; a body outside those limits may not be.
    """
    if height <= 0.0:
        return LengthUnit("m", 1.0, 0.0)
    name = min(UNITS, key=lambda unit: abs(np.log(height * UNITS[unit] / STATURE_M)))
    if not _PERSON_M[0] <= height * UNITS[name] <= _PERSON_M[1]:
        return LengthUnit("unknown", STATURE_M / height, STATURE_M)
    return LengthUnit(name, UNITS[name], height * UNITS[name])
