"""The two arms of a clip over time: the input of cutters, durations and seam scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.cache import kept
from signsplice.motion.clip import Clip
from signsplice.rig.info import rig_info

_RAISED_FRACTION = 0.4
"""An arm has left its rest when it has risen this fraction of the height from rest to its highest; less than half, so
that a sign that begins low and ends high keeps its beginning.
"""
_NO_REST_LIFT = 0.1
"""A clip whose arms rise by less than this fraction of an arm's length has no rest to trim."""


@dataclass(frozen=True, eq=False)
class Arms:
    """Both arms over time, left then right, in world axes and clip units.

    shoulders, elbows, wrists: (T, 2, 3) positions.
    hand_rotations: (T, 2, 3, 3) global rotation matrices.
    hips: (T, 3) positions.
    up: (3,) the world's vertical, a unit vector.
    length: shoulder to wrist, clip units.
    shoulder_width: distance of the shoulder joints, clip units.
    metres: length of one clip unit.
    fps: frame rate.
    """

    shoulders: FloatArray
    elbows: FloatArray
    wrists: FloatArray
    hand_rotations: FloatArray
    hips: FloatArray
    up: FloatArray
    length: float
    shoulder_width: float
    metres: float
    fps: float

    @property
    def lift(self) -> FloatArray:
        """Height of each wrist (T, 2): 0 where the arm hangs straight down, 1 at shoulder height."""
        return np.asarray(1.0 + (self.wrists - self.shoulders) @ self.up / self.length)


@kept
def arms(clip: Clip) -> Arms:
    """The arms of a clip, kept as long as the clip lives: a word has two seams, and each asks for its cut and duration.

    Raises ``InputError`` where the rig's arms are not known by name.
    """
    info = rig_info(clip.skeleton)
    joints = info.arm_joints
    rotations, positions = kinematics.forward(clip, joints)
    shoulders, elbows, wrists = (positions[:, n : n + 4 : 3] for n in range(3))
    body = info.sizes
    trunk = shoulders.mean(axis=(0, 1)) - positions[:, 6].mean(axis=0)
    axis = int(np.argmax(np.abs(trunk)))
    up = np.zeros(3)
    up[axis] = np.sign(trunk[axis]) or 1.0
    return Arms(
        shoulders=shoulders,
        elbows=elbows,
        wrists=wrists,
        hand_rotations=rotations[:, 2:6:3],
        hips=positions[:, 6],
        up=up,
        length=body.arm_length,
        shoulder_width=body.shoulder_width,
        metres=body.unit.metres,
        fps=clip.fps,
    )


def seen_from_trunk(own: Arms) -> tuple[FloatArray, FloatArray]:
    """Positions (T, 2, 3) and rotation matrices (T, 2, 3, 3) of the hands, from between the shoulders and in axes that
    turn and lean with the trunk: a body that sways moves no hand.
    """
    neck = own.shoulders.mean(axis=1)
    left, trunk = own.shoulders[:, 0] - own.shoulders[:, 1], neck - own.hips
    front = np.cross(left, trunk)
    axes = np.stack([left, np.cross(front, left), front], axis=1)  # (T, 3, 3)
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    wrists = np.einsum("tab,thb->tha", axes, own.wrists - neck[:, None])
    return wrists, np.einsum("tab,thbc->thac", axes, own.hand_rotations)


def active_span(arms: Arms) -> tuple[int, int]:
    """Frames [start, stop) in which the arms are away from rest; the whole clip where there is no rest.

    A clip rests at an end where both wrists are below their elbows there. From it, the span begins with the first frame
    (ends with the last) at which the higher hand has risen 40 % of the height from rest to its highest.
    """
    return span_between_rests(arms.lift, (arms.elbows - arms.shoulders) @ arms.up / arms.length + 1.0)


def span_between_rests(wrists: FloatArray, elbows: FloatArray) -> tuple[int, int]:
    """``active_span`` by the heights (T, 2) of both wrists and both elbows, arm lengths."""
    reach = wrists.max(axis=1)
    peak = float(reach.max())
    below = np.all(wrists < elbows, axis=1)
    start, stop = 0, len(reach)
    if below[0] and peak - reach[0] > _NO_REST_LIFT:
        start = int(np.argmax(reach >= reach[0] + _RAISED_FRACTION * (peak - reach[0])))
    if below[-1] and peak - reach[-1] > _NO_REST_LIFT:
        stop -= int(np.argmax(reach[::-1] >= reach[-1] + _RAISED_FRACTION * (peak - reach[-1])))
    return start, stop
