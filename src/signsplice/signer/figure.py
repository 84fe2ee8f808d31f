"""A signer's body for repeated poses of the arms: everything that does not move with the arms is posed once.

Everything is in the chest's axes of a right-handed signer and from the chest's joint, cm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import BodyCapsules, body_capsules
from signsplice.body.collision import PosedCapsules
from signsplice.motion import Clip, FloatArray, Skeleton, kinematics, rotation
from signsplice.signer import hand, pose
from signsplice.signer.hand import hand_part
from signsplice.signer.phonology import ON_ARM, Posture, on_base
from signsplice.signer.signer import ARM_JOINTS, COLLAR, FOREARM, JOINTS, SHOULDER, UPPER_ARM, Signer, skeleton

ARMS = np.array([[JOINTS[side + n] for n in ARM_JOINTS] for side in ("Right", "Left")])
"""The joints (2, 4) of both arms, strong first, from the chest on."""
_SPINE = [JOINTS[name] for name in ("Spine", "Spine1", "Spine2")]
Frames = NDArray[np.intp] | slice


@dataclass(frozen=True, eq=False)
class PosedArms:
    """Both arms of a right-handed signer over F frames.

    figure, at: their figure, and their frames in it.
    rotations, positions: (F, 2, 4, 3, 3) and (F, 2, 4, 3) of ``ARMS``.
    """

    figure: Figure
    at: Frames
    rotations: FloatArray
    positions: FloatArray

    @cached_property
    def capsules(self) -> PosedCapsules:
        """The capsules of the whole body."""
        return self.figure.capsules(self)


class Figure:
    """The body of a signer in states (T, 65), with the fingers, head and trunk of these states.

    signer: the signer, as if right-handed.
    body: its capsules.
    rotations, positions: (T, J, 3, 3) and (T, J, 3) of the joints, with straight arms.
    """

    def __init__(self, states: FloatArray, signer: Signer) -> None:
        self.signer = replace(signer, left_handed=False)
        bones = skeleton(self.signer)
        self.body = body_capsules(bones)
        quats, roots = pose.without_arms(states, self.signer)
        lower, middle, chest = quats[:, _SPINE].transpose(1, 0, 2)
        quats[:, 0] = rotation.inverse(rotation.multiply(rotation.multiply(lower, middle), chest))
        self.rotations, positions = kinematics.forward(Clip(bones, quats, roots, 30.0))
        self.positions = positions - positions[:, _SPINE[2], None]
        joints, ends = self.body.joints, np.stack([self.body.starts, self.body.ends])  # (2, C, 3)
        self._ends = np.einsum("tcab,ncb->tnca", self.rotations[:, joints], ends) + self.positions[:, None, joints]
        self._carried = bones.derived[_capsules_by_arm_joint]
        # Straight arms have the chest's rotation, and so has everything that they carry.
        self._at_rest = [
            (self._ends[:, :, carried] - self.positions[:, joint, None, None]).reshape(len(states), -1, 3)
            for carried, joint in zip(self._carried, ARMS.ravel(), strict=True)
        ]

    def pose_arms(
        self, states: FloatArray, at: Frames = slice(None), arms: tuple[pose.Arm, pose.ArmAngles] | None = None
    ) -> PosedArms:
        """The arms of states (F, 65) at the frames ``at`` of the figure, or other ``arms`` as returned by
        ``pose.solve_arms_and_angles``.
        """
        turned = pose.arm_rotations(*arms or pose.solve_arms_and_angles(states, self.signer))
        rotations = rotation.to_matrix(np.stack(turned, axis=2))  # (F, 2, 4, 3, 3)
        scale, broad = self.signer.scale, np.array([-self.signer.shoulders, 1.0, 1.0])
        lengths = (UPPER_ARM * self.signer.arms * scale, FOREARM * self.signer.arms * scale)
        positions = np.empty((len(states), 2, 4, 3))
        positions[:, :, 0] = COLLAR * broad * scale
        positions[:, :, 1] = rotations[:, :, 0] @ (SHOULDER * broad * scale)
        for n, length in enumerate(lengths):  # bones along -X
            positions[:, :, n + 2] = -length * rotations[:, :, n + 1, :, 0]
        positions = np.cumsum(positions, axis=2) * pose.MIRRORS[:, None]
        rotations[:, 1] *= np.outer(pose.MIRROR, pose.MIRROR)
        return PosedArms(self, at, rotations, positions)

    def capsules(self, arms: PosedArms) -> PosedCapsules:
        """The capsules of the body with these arms."""
        ends = self._ends[arms.at].copy()
        for n, (carried, rest) in enumerate(zip(self._carried, self._at_rest, strict=True)):
            if len(carried):
                turn, place = (x[:, n // 4, n % 4] for x in (arms.rotations, arms.positions))
                moved = rest[arms.at] @ turn.transpose(0, 2, 1) + place[:, None]
                ends[:, :, carried] = moved.reshape(len(ends), 2, -1, 3)
        return PosedCapsules(self.body, ends[:, 0], ends[:, 1])


def _capsules_by_arm_joint(bones: Skeleton) -> list[NDArray[np.intp]]:
    """The capsules that each joint of the arms carries; the hand carries those of the fingers."""
    carriers: dict[int, int] = {}
    for joint in ARMS.ravel().tolist():
        below = kinematics.subtree(bones, joint) if joint in ARMS[:, 3] else [joint]
        carriers |= dict.fromkeys(below, joint)
    joints = np.array([carriers.get(int(joint), -1) for joint in body_capsules(bones).joints])
    return [np.flatnonzero(joints == joint) for joint in ARMS.ravel()]


@dataclass(frozen=True, eq=False)
class PosedSigner:
    """A right-handed signer in T states.

    states: (T, 65).
    rotations, positions: (T, J, 3, 3) and (T, J, 3) of the joints except fingers, in the chest's axes.
    arms: both arms.
    """

    signer: Signer
    states: FloatArray
    rotations: FloatArray
    positions: FloatArray
    arms: PosedArms

    def distance(self, posture: Posture, frame: int) -> tuple[float, FloatArray]:
        """Distance, cm, from the skin of a posture's part of the strong hand to the body's skin at its location, and
        the unit vector (3,) from the body to the part, in the chest's axes.
        """
        part, unit, wrist = hand_part(posture.part), self.signer.hands * self.signer.scale, ARMS[0, 3]
        centre = part.centre(hand.points(pose.hands(self.states[frame])[0, pose.FINGERS])) * unit
        capsules = self.arms.capsules
        rows = list(surface(posture.location, capsules.body, 0))
        point = self.positions[frame, wrist] + self.rotations[frame, wrist] @ centre
        starts, ends, radii = capsules.starts, capsules.ends, capsules.body.radii
        offsets, gaps = out_of_capsules(point, starts[frame, rows], ends[frame, rows], radii[rows])
        n = int(gaps.argmin())
        direction = offsets[n] / max(float(np.linalg.norm(offsets[n])), 1e-9)
        return float(gaps[n]) - part.skin * unit, direction @ self.rotations[frame, JOINTS["Spine2"]]


def out_of_capsules(
    points: FloatArray, starts: FloatArray, ends: FloatArray, radii: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Vectors (..., K, 3) from the axes of K capsules to points (..., 3), and distances (..., K) from their skin."""
    span, from_start = ends - starts, points[..., None, :] - starts
    fraction = np.clip((from_start * span).sum(axis=-1) / ((span * span).sum(axis=-1) + 1e-12), 0.0, 1.0)
    offset = from_start - fraction[..., None] * span
    return offset, np.linalg.norm(offset, axis=-1) - (radii[:, 0] + fraction * (radii[:, 1] - radii[:, 0]))


def pose_signer(states: FloatArray, signer: Signer) -> PosedSigner:
    """A signer, as if right-handed, in states (T, 65)."""
    return pose_figure(Figure(states, signer), states)


def pose_figure(
    figure: Figure, states: FloatArray, at: Frames = slice(None), arms: tuple[pose.Arm, pose.ArmAngles] | None = None
) -> PosedSigner:
    """A figure's signer in states (F, 65) at the frames ``at`` of the figure, with the ``arms`` of these states or
    others (``Figure.pose_arms``).
    """
    posed = figure.pose_arms(states, at, arms)
    rotations, positions = figure.rotations[at].copy(), figure.positions[at].copy()
    rotations[:, ARMS], positions[:, ARMS] = posed.rotations, posed.positions
    return PosedSigner(figure.signer, states, rotations, positions, posed)


def surface(location: str, body: BodyCapsules, which: int) -> Sequence[int]:
    """The capsules of the part of the body at the location of the strong (0) or the weak hand (1)."""
    groups = body.groups
    if location in ON_ARM:
        return groups.right_arm if which else groups.left_arm
    return (groups.right if which else groups.left) if on_base(location) else (*groups.head, *groups.trunk)
