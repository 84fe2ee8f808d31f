"""Scores of motion, each with a signature of its parameters: a number means nothing without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d

from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig.info import TRUNK, rig_info
from signsplice.rig.roles import ARM, FINGERS, SIDES

POSITION_ERROR = "position-error|joints:arms+fingers|frame:root|unit:arm/1000|mean"
GROUP_ERRORS = "group-errors|hands:wrists,root|fingers:wrist|trunk:trunk+neck+head,root|unit:arm/1000|mean"
VELOCITY_JUMP = "velocity-jump|joints:wrists|step:1-frame|unit:m/s|max"
JERK_RATIO = "jerk-ratio|joints:wrists|third-difference|rms|transition+-1/signs"


def arm_and_finger_joints(clip: Clip) -> list[int]:
    """Indices of the elbow, wrist and every finger joint of both arms."""
    joints = rig_info(clip.skeleton).roles.joints
    return [joint for role, joint in joints.items() if role.endswith(("LowerArm", "Hand")) or _is_finger(role)]


def fingertip_joints(clip: Clip) -> list[int]:
    """Indices of the last joint of every finger; the hands where there are no fingers."""
    joints = rig_info(clip.skeleton).roles.joints
    tips = [joint for role, joint in joints.items() if role.endswith("Distal")]
    return tips or [joint for role, joint in joints.items() if role.endswith("Hand")]


def relative_positions(clip: Clip, joints: Sequence[int]) -> FloatArray:
    """Positions (T, K, 3) of joints in the axes of the root."""
    rotations, positions = kinematics.forward(clip, [0, *joints])
    return _seen_from(0, rotations, positions, list(range(1, len(joints) + 1)))


def position_error(predicted: Clip, true: Clip) -> float:
    """Mean distance of elbow, wrist and finger joints, seen from the root, in thousandths of the arm's length."""
    joints = arm_and_finger_joints(true)
    difference = relative_positions(predicted, joints) - relative_positions(true, joints)
    return float(1000.0 * np.linalg.norm(difference, axis=-1).mean() / rig_info(true.skeleton).sizes.arm_length)


@dataclass(frozen=True)
class GroupErrors:
    """Mean distance of joints from the truth by group, thousandths of the arm's length; NaN where the rig has none.

    hands: both wrists, seen from the root.
    fingers: every finger joint, seen from its wrist and in its axes.
    trunk: trunk, neck and head, seen from the root.
    """

    hands: float
    fingers: float
    trunk: float


def group_errors(predicted: Clip, true: Clip) -> GroupErrors:
    """The errors of a clip by group of joints: what one group gains does not hide what another loses."""
    info = rig_info(true.skeleton)
    joints = info.roles.joints
    wrists = {side: joints[f"{side}Hand"] for side in SIDES if f"{side}Hand" in joints}
    groups: dict[str, list[tuple[int, list[int]]]] = {
        "hands": [(0, list(wrists.values()))],
        "fingers": [
            (wrist, [joint for role, joint in joints.items() if role.startswith(side) and _is_finger(role)])
            for side, wrist in wrists.items()
        ],
        "trunk": [(0, [joints[role] for role in TRUNK if role in joints])],
    }
    posed = [kinematics.forward(clip) for clip in (predicted, true)]

    def error(parts: list[tuple[int, list[int]]]) -> float:
        seen = [
            np.concatenate([_seen_from(origin, *clip, of) for origin, of in parts] or [np.empty((len(true), 0, 3))], 1)
            for clip in posed
        ]
        distances = np.linalg.norm(seen[0] - seen[1], axis=-1)
        return float(1000.0 * distances.mean() / info.sizes.arm_length) if distances.size else float("nan")

    return GroupErrors(**{name: error(parts) for name, parts in groups.items()})


def _is_finger(role: str) -> bool:
    return any(finger in role for finger in FINGERS)


def _seen_from(origin: int, rotations: FloatArray, positions: FloatArray, joints: list[int]) -> FloatArray:
    """Positions (T, K, 3) of joints in the axes of one joint, of global rotations and positions of all."""
    relative = positions[:, joints] - positions[:, origin, None]
    return np.asarray(np.einsum("tba,tkb->tka", rotations[:, origin], relative))


EVEN_FRACTION = 0.02
"""Change of a joint's rotation step from one frame to the next, as a fraction of the fastest joint's step, up to which
it rotates evenly.
"""
_MOVING_RAD = 0.005
"""Rotation of the fastest joint in a frame (0.3 degrees) from which on a body counts as moving."""


def even_rotation_frames(clip: Clip) -> FloatArray:
    """For every frame but the first and the last (T - 2,): 1 where every arm and finger joint repeats its last rotation
    step, 0 where one does not, NaN where none moves or is known.

    People never move so; a program that interpolates between keys does (slerp), and so does gap filling in a capture. A
    measurement on such frames shows how near a method is to that program.
    """
    q = clip.local_rotations[:, arm_and_finger_joints(clip)]
    steps = rotation.difference(q[:-1], q[1:])
    fastest = np.linalg.norm(steps, axis=-1).max(axis=1, initial=0.0)
    speed = np.maximum(fastest[:-1], fastest[1:])
    change = np.linalg.norm(np.diff(steps, axis=0), axis=-1).max(axis=1, initial=0.0)
    return np.where(speed > _MOVING_RAD, change < EVEN_FRACTION * speed, np.nan)


def keyed_fraction(clip: Clip) -> float:
    """Share of the moving frames in which every arm and finger joint repeats its last rotation step
    (``even_rotation_frames``): 0 of captured motion, and where nothing moves.
    """
    even = even_rotation_frames(clip)
    moving = even[~np.isnan(even)]
    return float(moving.mean()) if len(moving) else 0.0


KEYED_FRACTION = 0.15
"""Fraction of interpolated arm motion from which on a clip is keyed. Eight frames on either side of a gap in a captured
take or in the words that ship have 0.04 in 95 of 100 gaps, and none has more than 0.1; with keys every fourth frame
nearly all have more. Splines between keys every third frame are not seen: no five frames lie between two keys.
"""
_FPS = 30.0
_EVEN, _LEAST = 0.05, 0.003
"""Differences count as none up to this part of the joint's own, and of its speed."""
_LEAST_MOVING = 8


def interpolated_fraction(*clips: Clip) -> float:
    """Fraction of the moments at which an arm's joint moves, and its rotation lies on a line (second difference) or a
    cubic (fourth difference) through the two frames on either side, as it does between a spline's keys. 0 where hardly
    anything moves, or the arms are not known.

    Differences are measured against the same joint's own, which are large at keys, whatever speed and rate are. Each
    clip is seen at about 30 frames a second: those between may be interpolated.
    """
    smooth = moving = 0
    for clip in clips:
        joints = [joint for role, joint in rig_info(clip.skeleton).roles.joints.items() if role.endswith(ARM)]
        q = clip.local_rotations[:: max(1, round(clip.fps / _FPS)), joints]  # (T, K, 4)
        if len(q) < 5 or not joints:
            continue
        x = [rotation.difference(q[2:-2], q[2 + k : len(q) - 2 + k]) for k in (-2, -1, 0, 1, 2)]  # (T - 4, K, 3) each
        speed = 0.5 * np.linalg.norm(x[3] - x[1], axis=-1)
        least = _LEAST * _local_rms(speed)
        is_smooth = np.zeros(speed.shape, bool)
        for vectors in (x[1] + x[3] - 2.0 * x[2], x[0] - 4.0 * x[1] + 6.0 * x[2] - 4.0 * x[3] + x[4]):
            size = np.linalg.norm(vectors, axis=-1)
            is_smooth |= size < np.maximum(_EVEN * _local_rms(size), least)
        moves = speed > 0.5 * _MOVING_RAD
        smooth, moving = smooth + int((is_smooth & moves).sum()), moving + int(moves.sum())
    return smooth / moving if moving >= _LEAST_MOVING else 0.0


def _local_rms(values: FloatArray) -> FloatArray:
    """Root mean square of values (T, K) over five frames."""
    return np.sqrt(np.asarray(convolve1d(values**2, np.full(5, 0.2), axis=0, mode="nearest")))


def is_keyed(*clips: Clip) -> bool:
    """Whether clips were drawn between keys, with lines or splines (``interpolated_fraction``)."""
    return interpolated_fraction(*clips) > KEYED_FRACTION


def keyed_mark(clip: Clip) -> str:
    """How tables mark a clip that ``is_keyed``."""
    even, fraction = 100.0 * keyed_fraction(clip), 100.0 * interpolated_fraction(clip)
    return f"keyed: {even:.0f} % of its moving frames repeat the step before, {fraction:.0f} % lie between keys"


def motion_ratio(predicted: Clip, true: Clip) -> float:
    """Path length of the fingertips, seen from the root, predicted over true; 1 moves as much as the truth does."""
    joints = fingertip_joints(true)
    paths = [
        np.linalg.norm(np.diff(relative_positions(clip, joints), axis=0), axis=-1).sum() for clip in (predicted, true)
    ]
    return float(paths[0] / paths[1]) if paths[1] > 0.0 else float("nan")


def velocity_jump(positions: FloatArray, first: int, stop: int, fps: float) -> float:
    """Largest change of velocity from one frame step to the next at either end of frames [first, stop).

    positions: (T, K, 3) with at least two frames before ``first`` and after ``stop`` where the clip has them; the unit
    is that of positions a second. At each end, the steps on either side of the last frame outside and of the first
    inside are compared.
    """
    velocity = np.diff(positions, axis=0) * fps
    changes = np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max(
        axis=-1, initial=0.0
    )  # [i] is centred on frame i + 1
    ends = [frame - 1 for frame in (first - 1, first, stop - 1, stop) if 0 <= frame - 1 < len(changes)]
    return float(max((changes[i] for i in ends), default=0.0))


def peak_speed(positions: FloatArray, first: int, stop: int, fps: float) -> float:
    """Highest speed of any point (T, K, 3) between frame first - 1 and frame stop, in units a second."""
    path = positions[max(first - 1, 0) : stop + 1]
    if len(path) < 2:
        return 0.0
    return float(np.linalg.norm(np.diff(path, axis=0), axis=-1).max() * fps)


def jerk_ratio(positions: FloatArray, first: int, stop: int, least: float = 0.0) -> float:
    """Root mean square jerk of frames [first - 1, stop + 1) over that of the frames around them; 1 is as smooth as the
    signs.

    positions: (T, K, 3). Jerk is the third difference. least: jerk that the frames around are taken to have at least,
    in units of positions. NaN where there are none, or they are at rest and ``least`` is 0.
    """
    jerk = np.linalg.norm(np.diff(positions, n=3, axis=0), axis=-1)  # [i] spans frames i .. i + 3
    inside = np.zeros(len(jerk), bool)
    inside[max(first - 4, 0) : stop + 1] = True
    around = max(float(np.sqrt(np.mean(jerk[~inside] ** 2))), least) if (~inside).any() else 0.0
    if around < 1e-12 or not inside.any():
        return float("nan")
    return float(np.sqrt(np.mean(jerk[inside] ** 2)) / around)
