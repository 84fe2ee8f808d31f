"""Gaze and an open mouth as rotations of bones: ARKit's eyeLook coefficients and jawOpen, there and back.

Axes: left +X, up +Y, forward +Z. An eye turns by its yaw about +Y, then by its pitch about +X, as VRM's look-at does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.face import Face

LOOKS = ("eyeLookIn", "eyeLookOut", "eyeLookDown", "eyeLookUp")
"""How the names of the coefficients of a gaze begin, in the order of ``LookAt``."""
SIDES = ("Left", "Right")
_USUAL = (30.0,) * 4
_JAW_DEG = 20.0
"""A jaw's rotation with jawOpen at 1, our own: no source gives one."""
_STILL = 1e-3
"""Bones that turn by less than this, rad, all the time say nothing."""


@dataclass(frozen=True)
class LookAt:
    """What a gaze at its limit, a coefficient of 1, is inward, outward, down and up, in degrees.

    gaze: as a player of VRM is given it, the largest input of the avatar's range maps.
    eyes: by how much eyes turn, the output of the range maps.

    Without an avatar's maps both are 30 degrees, our own: ARKit gives none.
    """

    gaze: tuple[float, ...] = _USUAL
    eyes: tuple[float, ...] = _USUAL


def has_gaze(face: Face | None) -> bool:
    """Whether a face has coefficients of a gaze."""
    return face is not None and any(name.startswith(LOOKS) for name in face.channels)


def eye_quats(face: Face, side: str, degrees: tuple[float, ...]) -> FloatArray:
    """The rotations (T, 4) of the eye of one of ``SIDES``."""
    return _quats(*_angles(face, side, degrees))


def gaze_quats(face: Face, look_at: LookAt) -> FloatArray:
    """The rotations (T, 4) of the gaze of both eyes, as VRM animations have it: the mean of their angles."""
    (yaw, pitch), (other_yaw, other_pitch) = (_angles(face, side, look_at.gaze) for side in SIDES)
    return _quats(0.5 * (yaw + other_yaw), 0.5 * (pitch + other_pitch))


def eye_coefficients(quats: FloatArray, side: str, degrees: tuple[float, ...]) -> dict[str, FloatArray]:
    """Coefficient -> values (T,) from 0 to 1, of the rotations (T, 4) of an eye or a gaze."""
    x, y, z = rotation.rotate(quats, [0.0, 0.0, 1.0]).T
    out, down = np.arctan2(x, z) * (1.0 if side == "Left" else -1.0), -np.arcsin(np.clip(y, -1.0, 1.0))
    shown = (
        np.clip(np.degrees(angle) / limit, 0.0, 1.0) if limit > 0.0 else np.zeros(len(quats))
        for angle, limit in zip((-out, out, down, -down), degrees, strict=True)
    )
    return {f"{name}{side}": values for name, values in zip(LOOKS, shown, strict=True)}


def bone_quats(face: Face, look_at: LookAt | None, opens_jaw: bool) -> dict[str, FloatArray]:
    """Role -> rotations (T, 4) of the eyes and the jaw that show a face; ``look_at``: None where eyes are no bones."""
    found = {}
    if look_at is not None and has_gaze(face):
        found = {f"{side.lower()}Eye": eye_quats(face, side, look_at.eyes) for side in SIDES}
    if opens_jaw and "jawOpen" in face.channels:
        found["jaw"] = rotation.exp(np.radians(_JAW_DEG) * face.of(["jawOpen"]) * [1.0, 0.0, 0.0])
    return found


def bone_coefficients(quats: Mapping[str, FloatArray], look_at: LookAt) -> dict[str, FloatArray]:
    """Coefficient -> values (T,) that the rotations (T, 4) of eyes and jaw show; none of bones that are still."""
    found: dict[str, FloatArray] = {}
    for role, rotations in quats.items():
        if float(rotation.angle_between(rotations, rotation.IDENTITY).max()) < _STILL:
            continue
        if role == "jaw":
            _, y, z = rotation.rotate(rotations, [0.0, 0.0, 1.0]).T
            found["jawOpen"] = np.clip(np.degrees(np.arctan2(-y, z)) / _JAW_DEG, 0.0, 1.0)
        else:
            found |= eye_coefficients(rotations, role.removesuffix("Eye").capitalize(), look_at.eyes)
    return found


def _angles(face: Face, side: str, degrees: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Yaw to the left and pitch downward (T,), rad."""
    inward, outward, down, up = (face.of([name + side for name in LOOKS]) * np.radians(degrees)).T
    return (outward - inward) * (1.0 if side == "Left" else -1.0), down - up


def _quats(yaw: FloatArray, pitch: FloatArray) -> FloatArray:
    return rotation.multiply(
        rotation.exp(yaw[:, None] * [0.0, 1.0, 0.0]), rotation.exp(pitch[:, None] * [1.0, 0.0, 0.0])
    )
