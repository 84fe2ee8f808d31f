"""What an elbow's place costs in one pose: how far forearm and wrist are from easy angles and beyond their limits, how
high the elbow is, and how deep the arm lies in the trunk.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.curves import minimum_jerk
from signsplice.signer.signer import COLLAR, FOREARM, SHOULDER, UPPER_ARM, Signer

if TYPE_CHECKING:
    from signsplice.signer.pose import Arm

WRIST_LIMITS = np.deg2rad([[-38.0, 28.0], [-72.0, 82.0]])
"""Least and greatest deviation (positive towards the thumb) and flexion (positive towards the palm) of the wrist,
radians; American Academy of Orthopaedic Surgeons 1965, widened by 5 degrees for passive range."""
FOREARM_LIMIT = np.deg2rad(95.0)
"""Greatest twist of the forearm in either direction from thumb-up, radians (80 to 90 in the same source)."""
_ANGLE_LIMITS = ((-FOREARM_LIMIT, FOREARM_LIMIT), *WRIST_LIMITS)

MARGIN = 0.15  # from here on angles approach their limits softly, radians

_X = np.array([1.0, 0.0, 0.0])
COMFORT = np.deg2rad([[-78.0, 78.0], [-25.0, 15.0], [-45.0, 45.0]])
"""Twist of the forearm, deviation and flexion of the wrist up to which they are comfortable."""
_STRAINED = np.deg2rad(20.0)  # how far beyond them costs 1 where hands go as they are written
_EASE = np.deg2rad([60.0, 22.0, 42.0, 32.0])  # forearm twist, wrist deviation, wrist flexion, swivel that cost 1
_HEIGHT_COST = 12.0  # of an elbow that is an upper arm's length higher, for low elbows
_BREACH = np.deg2rad(14.0)  # how far beyond a limit costs 1, for low elbows
_PRESSED_CM = 3.0  # how deep elbow or forearm lie in the trunk for a cost of 0.5, for low elbows
_TINY = 1e-300
_ONSET = np.deg2rad(6.0)  # before a limit is approached softly, where that cost begins


def swivel_costs(arm: Arm, rotvecs: FloatArray, signer: Signer, swivels: FloatArray) -> FloatArray:
    """What elbows at ``swivels`` (S,) cost, (..., S), in arms that carry hands with rotation vectors ``rotvecs``
    (..., 3).
    """
    return _costs(arm, angles_of(_turned(arm, rotvecs, swivels)), signer, swivels)


def led_costs(
    arm: Arm, rotvecs: FloatArray, signer: Signer, swivels: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """By how much (..., S), radians, forearm and wrist miss the rotations ``rotvecs`` (..., 3) with elbows at
    ``swivels`` (S,), since they keep to their limits; ``swivel_costs``; and what costs that they are not comfortable.
    """
    turned = _turned(arm, rotvecs, swivels)
    angles = angles_of(turned)
    kept = [soft_clip(x, low, high, MARGIN) for x, (low, high) in zip(angles, _ANGLE_LIMITS, strict=True)]
    swing = rotation.exp(np.stack([np.zeros_like(kept[1]), *kept[1:]], axis=-1))
    made = rotation.multiply(rotation.exp(kept[0][..., None] * _X), swing)
    # Of the rotation from one to the other: its angle from the cosine of its half.
    half = np.minimum(np.abs(np.einsum("...c,...c->...", made, turned)), 1.0)
    strain = sum(np.square(x - np.clip(x, *easy)) for x, easy in zip(kept, COMFORT, strict=True)) / _STRAINED**2
    return 2.0 * np.arccos(half), _costs(arm, angles, signer, swivels), np.asarray(strain)


def _turned(arm: Arm, rotvecs: FloatArray, swivels: FloatArray) -> FloatArray:
    """Rotations (..., S, 4) from forearm to hand with elbows at ``swivels`` (S,)."""
    axis = rotation.rotate(rotation.inverse(arm.fore), arm.direction)
    half = -0.5 * swivels[:, None]
    turns = np.empty((*axis.shape[:-1], len(swivels), 4))
    turns[..., :3], turns[..., 3] = np.sin(half) * axis[..., None, :], np.cos(half[:, 0])
    return rotation.multiply(turns, rotation.exp(rotvecs)[..., None, :])


def _costs(arm: Arm, angles: tuple[FloatArray, ...], signer: Signer, swivels: FloatArray) -> FloatArray:
    """``swivel_costs`` (..., S) of angles of twist, deviation and flexion, each (..., S)."""
    usual = -np.deg2rad(signer.elbow_deg)
    cost = sum(np.square(angle / ease) for angle, ease in zip((*angles, swivels - usual), _EASE, strict=True))
    if signer.manner.low_elbows:
        cost = cost + signer.manner.low_elbows * _raised_cost(arm, np.stack(angles, axis=-1), signer, swivels)
    return np.asarray(cost)


def _raised_cost(arm: Arm, angles: FloatArray, signer: Signer, swivels: FloatArray) -> FloatArray:
    """What each candidate swivel (..., S) costs that lifts the elbow, that puts elbow or forearm into the trunk, and
    that bends forearm and wrist beyond their limits: angles (..., S, 3) of twist, deviation and flexion.

    Casual signing moves distal joints rather than proximal ones (Napoli et al. 2014), so elbows hang as low as body
    and wrists allow.
    """
    bone = -rotation.to_matrix(arm.upper)[..., 0]  # unit vector from shoulder to elbow, (..., 3)
    along = np.sum(bone * arm.direction, axis=-1, keepdims=True) * arm.direction
    side = rotation.cross(arm.direction, bone)
    cos, sin = np.cos(swivels)[:, None], np.sin(swivels)[:, None]
    off = (bone - along)[..., None, :] * cos + side[..., None, :] * sin  # (..., S, 3)
    low, high = np.array(_ANGLE_LIMITS).T
    breach = np.maximum(0.0, np.maximum(angles - high, low - angles) + MARGIN + _ONSET)
    broad = np.array([-signer.shoulders, 1.0, 1.0])
    upper_arm, forearm = UPPER_ARM * signer.arms, FOREARM * signer.arms
    reach = np.sqrt(upper_arm**2 + forearm**2 + 2.0 * upper_arm * forearm * np.cos(arm.bend))[..., None]
    shoulder = COLLAR * broad + rotation.rotate(arm.collar, SHOULDER * broad)
    elbow = (shoulder + upper_arm * along)[..., None, :] + upper_arm * off
    wrist = (shoulder + reach * arm.direction)[..., None, :]
    depth = np.maximum(0.0, np.stack([_trunk_depth(elbow), _trunk_depth(0.55 * elbow + 0.45 * wrist)]))
    cost = _HEIGHT_COST * off[..., 1] + np.square(breach / _BREACH).sum(axis=-1)
    return np.asarray(cost + (np.square(depth) / (_PRESSED_CM * (_PRESSED_CM + depth))).sum(axis=0))


def _trunk_depth(points: FloatArray) -> FloatArray:
    """Depth (...) of an arm's axis at points (..., 3) in the trunk of the standard body, cm: an oval around a line from
    side to side, ending at the shoulders.
    """
    half_width, thick = 9.3, 13.5  # thick: half of the trunk's and half of the arm's
    beside = np.maximum(np.abs(points[..., 0]) - half_width, 0.0)
    depth = thick - np.sqrt(np.square(beside) + np.square(points[..., 2] - 0.7))
    return np.asarray(depth * smooth_step((10.0 - points[..., 1]) / 10.0))


def angles_of(quats: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Twist about X, then deviation and flexion, of rotations from forearm to hand (..., 4)."""
    quats = quats * np.where(quats[..., 3:] < 0.0, -1.0, 1.0)
    x, y, z, w = quats.transpose(quats.ndim - 1, *range(quats.ndim - 1))
    half = np.arctan2(x, w)
    sin, cos = np.sin(half), np.cos(half)
    y, z, w = cos * y + sin * z, cos * z - sin * y, cos * w + sin * x  # of the swing, which has no x
    off = np.sqrt(y * y + z * z)
    scale = 2.0 * np.arctan2(off, w) / np.maximum(off, _TINY)
    return 2.0 * half, scale * y, scale * z


def smooth_step(x: FloatArray) -> FloatArray:
    """0 up to 0, 1 from 1 on, between them the smooth step of degree 5."""
    return np.asarray(minimum_jerk(np.minimum(np.maximum(x, 0.0), 1.0)))


def soft_clip(x: ArrayLike, low: ArrayLike, high: ArrayLike, margin: float) -> FloatArray:
    """``x`` kept between limits: unchanged until ``margin`` from one, then approaching it (C1, by tanh)."""
    x = np.asarray(x, np.float64)
    over, under = x - (np.asarray(high) - margin), (np.asarray(low) + margin) - x
    if not np.any(np.maximum(over, under) > 0.0):
        return x
    x = np.where(over > 0.0, np.asarray(high) - margin + margin * np.tanh(np.maximum(over, 0.0) / margin), x)
    return np.where(under > 0.0, np.asarray(low) + margin - margin * np.tanh(np.maximum(under, 0.0) / margin), x)
