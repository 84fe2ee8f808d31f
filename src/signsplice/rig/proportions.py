"""How a clip's signer stands: body sizes, the length unit they betray, the up axis, the place and the facing."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton, unchecked_copy
from signsplice.motion.kinematics import rest_positions
from signsplice.rig.roles import Humanoid, find_roles
from signsplice.rig.t_pose import t_pose_positions

Float = NDArray[np.float64]

STATURE_M = 1.70
"""A grown person's height, against which a skeleton's numbers are read as metres, centimetres, ..."""

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048}

# Lengths between joint centres as shares of stature (Drillis and Contini 1966, in Winter 2009, fig. 4.1).
_SHARES = {
    ("leftUpperArm", "leftLowerArm", "leftHand"): 0.186 + 0.146,
    ("rightUpperArm", "rightLowerArm", "rightHand"): 0.186 + 0.146,
    ("leftUpperLeg", "leftLowerLeg", "leftFoot"): 0.245 + 0.246,
    ("rightUpperLeg", "rightLowerLeg", "rightFoot"): 0.245 + 0.246,
}
_SAMPLES = 24
"""Frames looked at, evenly spread, to tell how a signer stands."""


@dataclass(frozen=True)
class LengthUnit:
    """The length unit that a skeleton seems to be in: its name, its metres, and the stature (m) that follows."""

    name: str
    metres: float
    stature_m: float


@dataclass(frozen=True, eq=False)
class Placement:
    """Where and how a signer stands, in world coordinates: a point on the ground between the feet (the root where there
    are no feet), the up axis and the facing, unit vectors (3,) at right angles.
    """

    position: Float
    up: Float
    forward: Float


def chain_length(skeleton: Skeleton, humanoid: Humanoid, roles: tuple[str, ...]) -> float:
    """Length of the path through the joints of ``roles`` in the rest pose, clip units; 0.0 where one is missing."""
    joints = [humanoid.joints[role] for role in roles if role in humanoid.joints]
    if len(joints) < len(roles):
        return 0.0
    places = rest_positions(skeleton)[joints]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=-1).sum())


def stature(skeleton: Skeleton, humanoid: Humanoid | None = None) -> float:
    """Body height in clip units, from the lengths of arms and legs; the rest pose's extent where no limb is known."""
    humanoid = humanoid or find_roles(skeleton)
    lengths = [(chain_length(skeleton, humanoid, roles), share) for roles, share in _SHARES.items()]
    heights = [length / share for length, share in lengths if length > 0.0]
    if heights:
        return float(np.median(heights))
    places = rest_positions(skeleton)
    return float(np.max(np.ptp(places, axis=0))) if len(places) > 1 else 0.0


def length_unit(skeleton: Skeleton) -> LengthUnit:
    """The unit in which this body comes nearest to a grown person's height (between m, cm, mm, inch and foot).

    A child of 1.1 m or a giant of 2.7 m is still read right; a body outside those may not be.
    """
    height = stature(skeleton)
    if height <= 0.0:
        return LengthUnit("m", 1.0, 0.0)
    name = min(UNITS, key=lambda unit: abs(np.log(height * UNITS[unit] / STATURE_M)))
    return LengthUnit(name, UNITS[name], height * UNITS[name])


@dataclass(frozen=True)
class BodySizes:
    """What a body measures: shoulder to wrist and shoulder to shoulder in clip units, and the unit."""

    arm_length: float
    shoulder_width: float
    unit: LengthUnit


_SIZES: WeakKeyDictionary[Skeleton, BodySizes] = WeakKeyDictionary()


def sizes(skeleton: Skeleton) -> BodySizes:
    """What a skeleton's body measures, remembered as long as the skeleton lives."""
    found = _SIZES.get(skeleton)
    if found is None:
        found = BodySizes(arm_length(skeleton), shoulder_width(skeleton), length_unit(skeleton))
        _SIZES[skeleton] = found
    return found


def arm_length(skeleton: Skeleton) -> float:
    """Shoulder to wrist in clip units, the mean of the arms that are known; from stature where none is."""
    humanoid = find_roles(skeleton)
    arms = [chain_length(skeleton, humanoid, roles) for roles in list(_SHARES)[:2]]
    known = [length for length in arms if length > 0.0]
    return float(np.mean(known)) if known else 0.332 * stature(skeleton, humanoid)


def shoulder_width(skeleton: Skeleton) -> float:
    """Distance of the two shoulder joints in clip units; from stature (Drillis and Contini: 0.259) where they are
    unknown.
    """
    humanoid = find_roles(skeleton)
    pair = [humanoid.joints[role] for role in ("leftUpperArm", "rightUpperArm") if role in humanoid.joints]
    if len(pair) < 2:
        return 0.259 * stature(skeleton, humanoid)
    left, right = t_pose_positions(skeleton)[pair]
    return float(np.linalg.norm(left - right))


_STANDS: WeakKeyDictionary[Clip, Placement] = WeakKeyDictionary()


def stand(clip: Clip) -> Placement:
    """How the clip's signer stands, over a few frames spread evenly: the median place, the mean facing; remembered as
    long as the clip lives.

    Up is the world axis nearest to the way from the hips to the head; forward is at right angles to it and to the line
    of hips and shoulders. Skeletons without those roles stand at their root, up +Y, facing +Z (BVH's usual axes).
    """
    found = _STANDS.get(clip)
    if found is None:
        found = _STANDS[clip] = _stand(clip)
    return found


def _stand(clip: Clip) -> Placement:
    joints = find_roles(clip.skeleton).joints
    wanted = [r for r in _BODY if r in joints]
    n = min(_SAMPLES, len(clip))
    frames = np.round(np.arange(n) * ((len(clip) - 1) / max(n - 1, 1))).astype(np.intp)
    sample = unchecked_copy(
        clip,
        local_rotations=clip.local_rotations[frames],
        root_positions=clip.root_positions[frames],
        translations=None if clip.translations is None else clip.translations[frames],
        channels=None,
    )
    _, positions = kinematics.forward(sample, [0, *(joints[r] for r in wanted)])
    at = {role: positions[:, n + 1] for n, role in enumerate(wanted)}
    root = positions[:, 0]
    up = _up_axis(at, root)
    forward = _forward(at, up)
    feet = [at[role] for role in ("leftFoot", "rightFoot") if role in at]
    place = _median(np.sum(feet, axis=0) / len(feet) if feet else root)
    return Placement(place, up, forward)


def _median(rows: Float) -> Float:
    """The median (3,) of rows (T, 3); at once, where numpy's own looks around first."""
    ordered, half = np.sort(rows, axis=0), len(rows) // 2
    return np.asarray(ordered[half] if len(rows) % 2 else 0.5 * (ordered[half - 1] + ordered[half]))


_BODY = (
    "hips",
    "head",
    "neck",
    "leftUpperArm",
    "rightUpperArm",
    "leftUpperLeg",
    "rightUpperLeg",
    "leftFoot",
    "rightFoot",
)


def _up_axis(at: dict[str, Float], root: Float) -> Float:
    top = at.get("head", at.get("neck"))
    up = np.array([0.0, 1.0, 0.0])
    if top is None:
        return up
    way = np.mean(top - at.get("hips", root), axis=0)
    axis = int(np.argmax(np.abs(way)))
    return np.sign(way[axis]) * np.eye(3)[axis] if way[axis] != 0.0 else up


def _forward(at: dict[str, Float], up: Float) -> Float:
    across = np.zeros(3)
    for pair in (("leftUpperArm", "rightUpperArm"), ("leftUpperLeg", "rightUpperLeg")):
        if pair[0] in at and pair[1] in at:
            line = at[pair[0]] - at[pair[1]]
            across += np.mean(line / np.maximum(np.linalg.norm(line, axis=-1, keepdims=True), 1e-12), axis=0)
    forward = rotation.cross(across, up)
    length = np.linalg.norm(forward)
    if length > 1e-6:
        return np.asarray(forward / length)
    return np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 0.5 else np.array([0.0, -1.0, 0.0])
