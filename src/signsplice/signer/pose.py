"""A signer's pose as a state of 65 numbers, and the joint rotations that follow from it.

States can be added and interpolated number by number: they hold positions in cm, and rotation vectors that are mostly
well below 180 degrees (``nearest_turn`` continues one beyond). For each hand, strong first, both written as right hands
(the weak one is mirrored at the end):

    wrist    3   position from the chest joint, in the chest's axes, cm
    rotvec   3   rotation of the hand relative to the forearm of an arm with a hanging elbow, rotation vector
    fingers 21   hand.ANGLES

then rotation vectors of trunk (3) and head (3), the root's displacement (3) from its rest position, cm, and the turn of
each elbow (2) from its easy place, radians (``arms``). The 27 numbers of one hand are called a hand state.

Arms are solved in closed form: two bones, with the elbow at the easy point of its circle, at which forearm and wrist
are nearest to their neutral angles. Forearm and wrist angles approach their limits softly: no state bends them beyond.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signsplice.motion import Clip, FloatArray, rotation
from signsplice.motion.cache import CACHE
from signsplice.motion.curves import minimum_jerk
from signsplice.signer import hand
from signsplice.signer.signer import (
    ARM_JOINTS,
    COLLAR,
    FOREARM,
    JOINTS,
    SHOULDER,
    STANDARD,
    UPPER_ARM,
    HangingElbowSigner,
    Signer,
    skeleton,
)


@dataclass(frozen=True)
class ArmCosts:
    """Costs of an arm's posture, by which elbows find their easy places."""

    unit_angles: tuple[float, ...] = tuple(np.deg2rad([60.0, 22.0, 42.0, 32.0]))
    """Forearm twist, wrist deviation, wrist flexion, and swivel of the elbow that cost 1 each, radians."""
    strain: float = np.deg2rad(20.0)
    """Excess of an angle over its comfortable range that costs 1 in written signs, radians."""
    elbow_height: float = 12.0
    """Cost of raising an elbow by an upper arm's length, for low elbows."""
    limit_excess: float = np.deg2rad(14.0)
    """Angle past the onset of this cost (``limit_onset``) that costs 1, for low elbows, radians."""
    limit_onset: float = np.deg2rad(6.0)
    """How far before the soft approach to a limit (``LIMIT_MARGIN``) that cost begins, radians."""
    pressed_cm: float = 3.0
    """Depth of elbow or forearm in the trunk that costs 0.5, for low elbows, cm."""
    sharpness: float = 2.5
    """Sharpness of the mean over candidate swivels that is the easy place: weights are exp(-sharpness * cost)."""
    low_elbow_blunting: float = 4.0
    """Factor on the trait of low elbows that lowers the sharpness: their cost can have two minima, and an elbow would
    jump between them."""


@dataclass(frozen=True)
class JointMotion:
    """How trunk, head, collar bones and legs move: shares, largest angles (radians), the leg's length (cm)."""

    lowest_spine: float = 0.7
    """Share of the spine's lowest joint in the trunk's rotation if trunk and head move much."""
    neck: float = 0.4
    """Share of the neck in the head's rotation."""
    head: float = 0.6
    """Share of the head's own joint in the head's rotation."""
    collar_rise: float = np.deg2rad(15.0)
    """Largest rise of a collar bone, radians."""
    collar_swing: float = np.deg2rad(14.0)
    """Largest forward swing of a collar bone, radians."""
    leg_cm: float = 81.0
    """Distance from hip to ankle of the standard body, about which legs lean, cm."""


_COSTS = ArmCosts()
_JOINT_MOTION = JointMotion()

WRIST_LIMITS = np.deg2rad([[-38.0, 28.0], [-72.0, 82.0]])
"""Least and greatest deviation (positive towards the thumb) and flexion (positive towards the palm) of the wrist,
radians; American Academy of Orthopaedic Surgeons 1965, widened by 5 degrees for passive range."""
FOREARM_LIMIT = np.deg2rad(95.0)
"""Greatest twist of the forearm in either direction from thumb-up, radians (80 to 90 in the same source)."""
_ANGLE_LIMITS = ((-FOREARM_LIMIT, FOREARM_LIMIT), *WRIST_LIMITS)

LIMIT_MARGIN = 0.15
"""Distance from a limit at which angles begin to approach it softly, radians."""

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Mirrors a vector of one hand to the other side."""
MIRRORS = np.array([np.ones(3), MIRROR])
"""Mirror factors of the strong hand, which stays, and of the weak one."""
MIRROR_QUAT = np.array([1.0, -1.0, -1.0, 1.0])
"""Mirrors a rotation of one hand, a quaternion, to the other side."""
_COMFORTABLE_ANGLES = np.deg2rad([[-78.0, 78.0], [-25.0, 15.0], [-45.0, 45.0]])
"""Comfortable ranges of the forearm's twist and the wrist's deviation and flexion, radians."""


def swivel_costs(
    arm: Arm, rotvecs: FloatArray, signer: Signer, swivels: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Three arrays (..., S), for elbows at ``swivels`` (S,): the angle, radians, by which limits keep the hand from
    ``rotvecs`` (..., 3); the cost of the elbow; the cost of uncomfortable forearm and wrist angles.
    """
    turned = _hand_quats_at_swivels(arm, rotvecs, swivels)
    angles = angles_of(turned)
    limited = [soft_clip(x, low, high, LIMIT_MARGIN) for x, (low, high) in zip(angles, _ANGLE_LIMITS, strict=True)]
    reached = _hand_quats(np.stack(limited, axis=-1))
    # The angle between both rotations, from the cosine of its half.
    half = np.minimum(np.abs(np.einsum("...c,...c->...", reached, turned)), 1.0)
    strain = sum(
        np.square(x - np.clip(x, *comfortable)) for x, comfortable in zip(limited, _COMFORTABLE_ANGLES, strict=True)
    )
    strain = strain / _COSTS.strain**2
    return 2.0 * np.arccos(half), _costs(arm, angles, signer, swivels), np.asarray(strain)


def _hand_quats_at_swivels(arm: Arm, rotvecs: FloatArray, swivels: FloatArray) -> FloatArray:
    """Rotations (..., S, 4) from forearm to hand with elbows at ``swivels`` (S,)."""
    axis = rotation.rotate(rotation.inverse(arm.fore), arm.direction)
    half = -0.5 * swivels[:, None]
    swivel_quats = np.empty((*axis.shape[:-1], len(swivels), 4))
    swivel_quats[..., :3], swivel_quats[..., 3] = np.sin(half) * axis[..., None, :], np.cos(half[:, 0])
    return rotation.multiply(swivel_quats, rotation.exp(rotvecs)[..., None, :])


def _costs(arm: Arm, angles: tuple[FloatArray, ...], signer: Signer, swivels: FloatArray) -> FloatArray:
    """Costs (..., S) of elbows at ``swivels`` (S,) with twist, deviation and flexion ``angles``, each (..., S)."""
    usual = -np.deg2rad(signer.elbow_deg)
    offsets = (*angles, swivels - usual)
    cost = sum(np.square(offset / unit) for offset, unit in zip(offsets, _COSTS.unit_angles, strict=True))
    if signer.manner.low_elbows:
        cost = cost + signer.manner.low_elbows * _low_elbow_cost(arm, np.stack(angles, axis=-1), signer, swivels)
    return np.asarray(cost)


def _low_elbow_cost(arm: Arm, angles: FloatArray, signer: Signer, swivels: FloatArray) -> FloatArray:
    """Costs (..., S) of candidate swivels that lift the elbow, put elbow or forearm into the trunk, or bend forearm and
    wrist close to their limits or beyond; angles (..., S, 3): twist, deviation and flexion.

    Casual signing moves distal joints rather than proximal ones (Napoli et al. 2014), so elbows hang as low as body
    and wrists allow.
    """
    bone = -rotation.to_matrix(arm.upper)[..., 0]  # unit vector from shoulder to elbow, (..., 3)
    projection = np.sum(bone * arm.direction, axis=-1, keepdims=True) * arm.direction
    side = rotation.cross(arm.direction, bone)
    cos, sin = np.cos(swivels)[:, None], np.sin(swivels)[:, None]
    off = (bone - projection)[..., None, :] * cos + side[..., None, :] * sin  # (..., S, 3)
    low, high = np.array(_ANGLE_LIMITS).T
    breach = np.maximum(0.0, np.maximum(angles - high, low - angles) + LIMIT_MARGIN + _COSTS.limit_onset)
    broad = np.array([-signer.shoulders, 1.0, 1.0])
    upper_arm, forearm = UPPER_ARM * signer.arms, FOREARM * signer.arms
    reach = np.sqrt(upper_arm**2 + forearm**2 + 2.0 * upper_arm * forearm * np.cos(arm.bend))[..., None]
    shoulder = COLLAR * broad + rotation.rotate(arm.collar, SHOULDER * broad)
    elbow = (shoulder + upper_arm * projection)[..., None, :] + upper_arm * off
    wrist = (shoulder + reach * arm.direction)[..., None, :]
    depth = np.maximum(0.0, np.stack([_trunk_depth(elbow), _trunk_depth(0.55 * elbow + 0.45 * wrist)]))
    cost = _COSTS.elbow_height * off[..., 1] + np.square(breach / _COSTS.limit_excess).sum(axis=-1)
    return np.asarray(cost + (np.square(depth) / (_COSTS.pressed_cm * (_COSTS.pressed_cm + depth))).sum(axis=0))


def _trunk_depth(points: FloatArray) -> FloatArray:
    """Depth (...) of an arm's axis at points (..., 3) in the trunk of the standard body, cm: an oval around a line from
    side to side; in full up to the chest joint, fading out to the collar joints; negative outside.
    """
    half_width, reach = 9.3, 13.5  # cm; reach: half of the trunk's thickness and half of the arm's
    sideways = np.maximum(np.abs(points[..., 0]) - half_width, 0.0)
    depth = reach - np.sqrt(np.square(sideways) + np.square(points[..., 2] - 0.7))
    return np.asarray(depth * smooth_step((10.0 - points[..., 1]) / 10.0))


def angles_of(quats: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Twist about X, then deviation and flexion, radians, of rotations (..., 4) from forearm to hand."""
    quats = quats * np.where(quats[..., 3:] < 0.0, -1.0, 1.0)
    x, y, z, w = quats.transpose(quats.ndim - 1, *range(quats.ndim - 1))
    half = np.arctan2(x, w)
    sin, cos = np.sin(half), np.cos(half)
    y, z, w = cos * y + sin * z, cos * z - sin * y, cos * w + sin * x  # of the swing, which has no x
    off = np.sqrt(y * y + z * z)
    scale = 2.0 * np.arctan2(off, w) / np.maximum(off, 1e-300)
    return 2.0 * half, scale * y, scale * z


def smooth_step(x: FloatArray) -> FloatArray:
    """The smooth step of degree 5 from 0 at ``x`` <= 0 to 1 at ``x`` >= 1."""
    return np.asarray(minimum_jerk(np.minimum(np.maximum(x, 0.0), 1.0)))


def soft_clip(x: ArrayLike, low: ArrayLike, high: ArrayLike, margin: float) -> FloatArray:
    """Limits ``x`` smoothly (C1): unchanged up to ``margin`` from a limit, then approaching it by tanh."""
    x = np.asarray(x, np.float64)
    over, under = x - (np.asarray(high) - margin), (np.asarray(low) + margin) - x
    if not np.any(np.maximum(over, under) > 0.0):
        return x
    x = np.where(over > 0.0, np.asarray(high) - margin + margin * np.tanh(np.maximum(over, 0.0) / margin), x)
    return np.where(under > 0.0, np.asarray(low) + margin - margin * np.tanh(np.maximum(under, 0.0) / margin), x)


SIZE = 65
WRIST = slice(0, 3)
"""The wrist's position in a hand state."""
ROTVEC = slice(3, 6)
"""The hand's rotation vector in a hand state."""
FINGERS = slice(6, 27)
"""The finger angles in a hand state."""
TRUNK = slice(54, 57)
"""The trunk's rotation vector in a state."""
HEAD = slice(57, 60)
"""The head's rotation vector in a state."""
ROOT = slice(60, 63)
"""The root's displacement in a state."""
TURNS = slice(63, 65)
"""The turns of both elbows in a state."""

ELBOW_LIMIT = np.deg2rad(148.0)
"""Greatest flexion of the elbow, radians."""

_HANGING_DIRECTION = np.array([-0.55, -1.0, -0.35])
"""Direction to which a right elbow hangs: down, out and a little back."""
_CANDIDATE_SWIVELS = np.deg2rad(np.linspace(-75.0, 45.0, 13))
"""Candidates for an elbow's easy place, radians; negative ones lift it outwards."""
_N_CACHED = 6
"""Number of solved arms, and of easy places, in the cache."""
_TRUNK_AND_HEAD = [JOINTS[name] for name in ("Spine", "Spine1", "Spine2", "Neck", "Head")]
"""Joints of trunk and head, in the order of the skeleton."""
_LEGS = [JOINTS[name] for name in ("LeftUpLeg", "RightUpLeg", "LeftFoot", "RightFoot")]


def hands(states: FloatArray) -> FloatArray:
    """A view of the hand states (..., 2, 27) in states (..., 65), strong then weak."""
    return states[..., :54].reshape(*states.shape[:-1], 2, 27)


def of_hands(strong: FloatArray, weak: FloatArray) -> FloatArray:
    """The upright state (..., 65) with these hand states (..., 27) and easy elbows."""
    return np.concatenate([strong, weak, np.zeros((*strong.shape[:-1], SIZE - 54))], axis=-1)


@dataclass(frozen=True, eq=False)
class Arm:
    """Right arms with a hanging elbow, in the chest's axes. Do not change the arrays.

    collar: rotation of the collar bone, (..., 4)
    upper: rotation of the upper arm, (..., 4)
    fore: rotation of the forearm, (..., 4)
    direction: unit vector from shoulder to wrist, (..., 3)
    bend: flexion of the elbow, radians, (...)
    """

    collar: FloatArray
    upper: FloatArray
    fore: FloatArray
    direction: FloatArray
    bend: FloatArray


def solve_arm(wrists: ArrayLike, signer: Signer) -> Arm:
    """The right arm, with a hanging elbow, whose wrist is at ``wrists`` (..., 3), cm from the chest joint.

    The collar bone rises and comes forward with the hand, as in the scapulohumeral rhythm (Inman, Saunders and Abbott
    1944; here by at most about 15 degrees about each axis). A wrist position out of reach is moved softly along the
    line to the shoulder.
    """
    wrists = np.asarray(wrists, np.float64)
    # The same states are posed several times in a row.
    return CACHE.recent(
        _solve_arm, wrists.tobytes(), wrists.shape, signer.scale, signer.shoulders, signer.arms, most=_N_CACHED
    )


def _solve_arm(data: bytes, shape: tuple[int, ...], scale: float, shoulders: float, arms: float) -> Arm:
    """``solve_arm`` for wrists given as bytes."""
    wrists = np.frombuffer(data).reshape(shape) / scale
    broad = np.array([-shoulders, 1.0, 1.0])
    collar_position, shoulder_offset = COLLAR * broad, SHOULDER * broad
    upper_arm, forearm = UPPER_ARM * arms, FOREARM * arms
    offset = (wrists - collar_position - shoulder_offset) / (upper_arm + forearm)  # (..., 3) over the arm's length
    x, y, z = offset[..., 0], offset[..., 1], offset[..., 2]
    reached = np.empty((2, *x.shape))  # how far the hand is up and forward; the collar bone moves from 0 to 1
    reached[0], reached[1] = (y + 0.35) / 1.2, (z + 0.5 * x - 0.25) / 0.9
    half_angles = smooth_step(reached)
    half_angles *= 0.5 * np.reshape((_JOINT_MOTION.collar_rise, _JOINT_MOTION.collar_swing), (2, *(1,) * x.ndim))
    (sin_rise, sin_swing), (cos_rise, cos_swing) = np.sin(half_angles), np.cos(half_angles)
    collar = np.empty((*x.shape, 4))  # Y after -Z
    collar[..., 0], collar[..., 1], collar[..., 2], collar[..., 3] = (
        -sin_swing * sin_rise, sin_swing * cos_rise, -cos_swing * sin_rise, cos_swing * cos_rise)  # fmt: skip
    direction = wrists - collar_position - rotation.rotate(collar, shoulder_offset)
    distance = _length(direction)
    direction = direction / distance
    least = np.sqrt(upper_arm**2 + forearm**2 + 2.0 * upper_arm * forearm * np.cos(ELBOW_LIMIT))
    distance = soft_clip(distance, least, 0.992 * (upper_arm + forearm), 0.04 * (upper_arm + forearm))
    # The elbow: ``projected`` on the line from shoulder to wrist, ``off`` that line towards the hint.
    projected = (upper_arm**2 - forearm**2 + distance**2) / (2.0 * distance)
    off = np.sqrt(np.maximum(upper_arm**2 - projected**2, 0.0))
    hint = _HANGING_DIRECTION - (direction @ _HANGING_DIRECTION)[..., None] * direction
    elbow = projected * direction + off * hint / _length(hint)
    bones = np.empty((2, *elbow.shape))  # unit vectors along upper arm and forearm
    bones[0], bones[1] = elbow / upper_arm, (distance * direction - elbow) / forearm
    hinge = rotation.cross(bones[0], bones[1])
    length = _length(hinge)
    bend = np.arctan2(length[..., 0], np.einsum("...c,...c->...", bones[0], bones[1]))
    upper, fore = _bone_rotations(bones, hinge / length)
    return Arm(collar, upper, fore, direction, bend)


def _length(vectors: FloatArray) -> FloatArray:
    """Lengths (..., 1) of vectors (..., 3)."""
    return np.asarray(np.sqrt(np.einsum("...c,...c->...", vectors, vectors))[..., None])


def _bone_rotations(bones: FloatArray, hinge: FloatArray) -> FloatArray:
    """Rotations (..., 4) that turn the right arm's rest bone -X to ``bones`` and the elbow's axis +Y to ``hinge``."""
    axes = np.empty((*bones.shape, 3))
    axes[..., 0], axes[..., 1], axes[..., 2] = -bones, hinge, rotation.cross(hinge, bones)
    return rotation.from_matrix(axes)


def hand_rotvecs(wrists: ArrayLike, hand_quats: ArrayLike, signer: Signer) -> FloatArray:
    """Rotation vectors (..., 3) for hand states of right hands with wrists at ``wrists`` (..., 3) and rotations
    ``hand_quats`` (..., 4), both in the chest's axes.
    """
    return rotation.log(rotation.multiply(rotation.inverse(solve_arm(wrists, signer).fore), hand_quats))


def nearest_turn(rotvec: FloatArray, near: FloatArray) -> FloatArray:
    """Adds full turns to a rotation vector (3,) to bring it nearest to another (3,), so that a hand does not spin when
    its rotation passes half a turn.
    """
    angle = float(np.linalg.norm(rotvec))
    n_turns = np.round((float(near @ rotvec) / angle - angle) / (2.0 * np.pi)) if angle > 1e-6 else 0.0
    return np.asarray(rotvec * (1.0 + 2.0 * np.pi * n_turns / angle)) if n_turns else rotvec


def hand_rotations(states: FloatArray, signer: Signer) -> FloatArray:
    """Rotations (..., 2, 4) of both hands in the chest's axes, as right hands, before joint limits."""
    both = hands(states)
    return rotation.multiply(solve_arm(both[..., WRIST], signer).fore, rotation.exp(both[..., ROTVEC]))


@dataclass(frozen=True)
class ArmAngles:
    """Angles (...) of elbow, forearm and wrist, radians, before limits.

    swivel: rotation of the elbow about the line from shoulder to wrist; negative lifts it outwards
    twist: rotation of the forearm about itself, 0 with the thumb up
    deviation: of the wrist, positive towards the thumb
    flexion: of the wrist, positive towards the palm
    """

    swivel: FloatArray
    twist: FloatArray
    deviation: FloatArray
    flexion: FloatArray

    @property
    def stacked(self) -> FloatArray:
        """Twist, deviation and flexion (..., 3)."""
        return np.stack([self.twist, self.deviation, self.flexion], axis=-1)


def elbow_axes(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (..., 3) perpendicular to the line from shoulder to wrist: to a hanging elbow, and to an elbow a
    quarter turn further.
    """
    bone = rotation.rotate(arm.upper, [-1.0, 0.0, 0.0])
    to_elbow = bone - np.einsum("...c,...c->...", bone, arm.direction)[..., None] * arm.direction
    to_elbow = to_elbow / np.maximum(_length(to_elbow), 1e-9)
    return to_elbow, rotation.cross(arm.direction, to_elbow)


def easy_swivels(arm: Arm, rotvecs: FloatArray, signer: Signer) -> FloatArray:
    """Swivels (...), radians, of easy elbows in arms whose hands have rotation vectors ``rotvecs`` (..., 3): angles of
    forearm and wrist are smallest there, and elbows hang low if the signer's manner says so.

    The swivel is a mean over candidates, weighted by exp(-sharpness * cost); the cost is the sum of squared angles,
    each over the angle that costs 1 (``ArmCosts``). The mean varies smoothly with the pose; the best candidate alone
    would jump. It is 0 for a ``HangingElbowSigner``.
    """
    if isinstance(signer, HangingElbowSigner):
        return np.zeros(arm.bend.shape)
    return CACHE.recent(_easy_swivels, arm, rotvecs.tobytes(), rotvecs.shape, signer, most=_N_CACHED)


def _easy_swivels(arm: Arm, data: bytes, shape: tuple[int, ...], signer: Signer) -> FloatArray:
    """``easy_swivels`` for rotation vectors given as bytes."""
    swivels = _CANDIDATE_SWIVELS
    cost = _costs(
        arm, angles_of(_hand_quats_at_swivels(arm, np.frombuffer(data).reshape(shape), swivels)), signer, swivels
    )
    sharpness = _COSTS.sharpness / (1.0 + _COSTS.low_elbow_blunting * signer.manner.low_elbows)
    weight = np.exp(-sharpness * (cost - cost.min(axis=-1, keepdims=True)))
    return np.asarray((weight @ swivels) / weight.sum(axis=-1))


def arm_angles(arm: Arm, rotvecs: FloatArray, signer: Signer, offsets: FloatArray | float = 0.0) -> ArmAngles:
    """The angles of arms whose hands have rotation vectors ``rotvecs`` (..., 3), with the swivels of elbows ``offsets``
    (...), radians, from their easy places.
    """
    return arm_angles_at(arm, rotation.exp(rotvecs), easy_swivels(arm, rotvecs, signer) + offsets)


def arm_angles_at(arm: Arm, quats: FloatArray, swivels: FloatArray) -> ArmAngles:
    """``arm_angles`` for rotations (..., 4) from the forearms of hanging elbows, with elbows at ``swivels`` (...)."""
    axis = rotation.rotate(rotation.inverse(arm.fore), arm.direction)
    return ArmAngles(swivels, *angles_of(rotation.multiply(rotation.exp(-swivels[..., None] * axis), quats)))


def hand_quats_at(arm: Arm, angles: FloatArray, swivels: FloatArray) -> FloatArray:
    """Inverse of ``arm_angles_at``: the rotations (..., 4), from the forearms of hanging elbows, with twist, deviation
    and flexion ``angles`` (..., 3).
    """
    axis = rotation.rotate(rotation.inverse(arm.fore), arm.direction)
    return rotation.multiply(rotation.exp(swivels[..., None] * axis), _hand_quats(angles))


def _hand_quats(angles: FloatArray) -> FloatArray:
    """Rotations (..., 4) from forearm to hand by twist, deviation and flexion (..., 3), deviation and flexion first."""
    twist, swing = np.zeros_like(angles), angles.copy()
    twist[..., 0], swing[..., 0] = angles[..., 0], 0.0
    return rotation.multiply(rotation.exp(twist), rotation.exp(swing))


def is_well_within_limits(hand_states: FloatArray) -> NDArray[np.bool_]:
    """Whether hand states (..., 27) of the standard signer use at most 85 % of each wrist and forearm limit, and the
    elbow stays bent by 20 degrees or more.
    """
    arm = solve_arm(hand_states[..., WRIST], STANDARD)
    angles = arm_angles(arm, hand_states[..., ROTVEC], STANDARD)
    low, high = 0.85 * WRIST_LIMITS.T
    wrist = np.stack([angles.deviation, angles.flexion], axis=-1)
    is_within = np.all((wrist > low) & (wrist < high), axis=-1)
    return np.asarray(is_within & (np.abs(angles.twist) < 0.85 * FOREARM_LIMIT) & (arm.bend > 0.35))


def clip(states: FloatArray, signer: Signer, fps: float, name: str = "") -> Clip:
    """The motion of states (T, 65) as a clip on the signer's skeleton."""
    return Clip(skeleton(signer), *rotations(states, signer), fps, name)


def rotations(states: FloatArray, signer: Signer) -> tuple[FloatArray, FloatArray]:
    """Local rotations (T, 53, 4) and root positions (T, 3), cm, of states (T, 65)."""
    local_quats, roots = without_arms(states, signer)
    arm_quats = arm_rotations(*solve_arms_and_angles(states, signer))
    chain = [arm_quats[0], *(rotation.multiply(rotation.inverse(a), b) for a, b in itertools.pairwise(arm_quats))]
    for n, side in enumerate(_sides(signer)):
        mirror = MIRROR_QUAT if side == "Left" else 1.0
        for name, q in zip(ARM_JOINTS, chain, strict=True):
            local_quats[:, JOINTS[side + name]] = q[:, n] * mirror
    return local_quats, roots


def _sides(signer: Signer) -> tuple[str, str]:
    return ("Left", "Right") if signer.left_handed else ("Right", "Left")


def without_arms(states: FloatArray, signer: Signer) -> tuple[FloatArray, FloatArray]:
    """``rotations`` of states (T, 65) with straight arms, as at rest."""
    n_frames = len(states)
    local_quats = np.zeros((n_frames, len(JOINTS), 4))
    local_quats[..., 3] = 1.0
    # Legs lean against the root's displacement, so that the feet stay in place.
    displacement = states[:, ROOT] * (MIRROR if signer.left_handed else 1.0)
    lean = np.stack([-displacement[:, 2], np.zeros(n_frames), displacement[:, 0]], axis=-1) / _JOINT_MOTION.leg_cm
    parts = [states[:, TRUNK] / divisor for divisor in _trunk_divisors(signer)]
    parts += [_JOINT_MOTION.neck * states[:, HEAD], _JOINT_MOTION.head * states[:, HEAD]]
    local_quats[:, _TRUNK_AND_HEAD + _LEGS] = rotation.exp(np.stack([*parts, -lean, -lean, lean, lean], axis=1))
    fingers = hand.rotations(hands(states)[..., FINGERS])
    for n, side in enumerate(_sides(signer)):
        first = JOINTS[f"{side}HandThumb1"]
        mirror = MIRROR_QUAT if side == "Left" else 1.0
        local_quats[:, first : first + 15] = fingers[:, n] * mirror
    roots = displacement * signer.scale + skeleton(signer).offsets[0]
    if signer.left_handed:  # trunk and head are written for a right-handed signer, too
        local_quats[:, _TRUNK_AND_HEAD] *= MIRROR_QUAT
    return local_quats, roots


def solve_arms_and_angles(states: FloatArray, signer: Signer) -> tuple[Arm, ArmAngles]:
    """Both arms, as right arms, of states (..., 65), strong first, and their angles."""
    both = hands(states)
    arm = solve_arm(both[..., WRIST], signer)
    return arm, arm_angles(arm, both[..., ROTVEC], signer, states[..., TURNS])


def arm_rotations(arm: Arm, angles: ArmAngles) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rotations (..., 4), in the chest's axes, of collar bone, upper arm, forearm and hand of right arms, with angles
    within their limits.
    """
    swivel = rotation.exp(angles.swivel[..., None] * arm.direction)
    upper, fore = rotation.multiply(swivel, np.stack([arm.upper, arm.fore]))
    # Half of the twist at the elbow, half at the wrist.
    half = 0.5 * soft_clip(angles.twist, -FOREARM_LIMIT, FOREARM_LIMIT, LIMIT_MARGIN)
    half_twist = rotation.exp(half[..., None] * [1.0, 0.0, 0.0])
    low, high = WRIST_LIMITS.T
    bent = soft_clip(np.stack([angles.deviation, angles.flexion], axis=-1), low, high, LIMIT_MARGIN)
    swing = rotation.exp(np.concatenate([np.zeros((*bent.shape[:-1], 1)), bent], axis=-1))
    fore = rotation.multiply(fore, half_twist)
    return arm.collar, upper, fore, rotation.multiply(fore, rotation.multiply(half_twist, swing))


def _trunk_divisors(signer: Signer) -> tuple[float, float, float]:
    """Divisors of the trunk's rotation for each joint of the spine: 3 each in plain motion; in captured signing the
    lowest joint turns several times as fast as the others.
    """
    lowest = 1.0 / 3.0 + (_JOINT_MOTION.lowest_spine - 1.0 / 3.0) * min(signer.manner.body_motion, 1.0)
    return (1.0 / lowest, 2.0 / (1.0 - lowest), 2.0 / (1.0 - lowest)) if signer.manner.body_motion else (3.0, 3.0, 3.0)
