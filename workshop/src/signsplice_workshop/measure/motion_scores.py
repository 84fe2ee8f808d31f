"""Scores of a clip against the true one, signatures of these and of the scores of ``rig.metrics``, and the fraction of
a clip that rotates evenly, as between keys.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig.info import TRUNK, rig_info
from signsplice.rig.keyedness import judge_keyedness
from signsplice.rig.metrics import MOVING_RAD
from signsplice.rig.roles import FINGERS, SIDES

POSITION_ERROR = "position-error|joints:arms+fingers|frame:root|unit:arm/1000|mean"
GROUP_ERRORS = "group-errors|hands:wrists,root|fingers:wrist|trunk:trunk+neck+head,root|unit:arm/1000|mean"
VELOCITY_JUMP = "velocity-jump|joints:wrists|step:1-frame|unit:m/s|max"
JERK_RATIO = "jerk-ratio|joints:wrists|third-difference|rms|transition+-1/signs"


def arm_and_finger_joints(clip: Clip) -> list[int]:
    """Returns the indices of the elbow, wrist and every finger joint of both arms."""
    joints = rig_info(clip.skeleton).roles.joints
    return [joint for role, joint in joints.items() if role.endswith(("LowerArm", "Hand")) or _is_finger(role)]


def fingertip_joints(clip: Clip) -> list[int]:
    """Returns the indices of the last joint of every finger; the hands if there are no fingers."""
    joints = rig_info(clip.skeleton).roles.joints
    tips = [joint for role, joint in joints.items() if role.endswith("Distal")]
    return tips or [joint for role, joint in joints.items() if role.endswith("Hand")]


def relative_positions(clip: Clip, joints: Sequence[int]) -> FloatArray:
    """Returns the positions (T, K, 3) of joints from the root, in its axes, clip units."""
    rotations, positions = kinematics.forward(clip, [0, *joints])
    return _joint_local_positions(0, rotations, positions, list(range(1, len(joints) + 1)))


def position_error(predicted: Clip, true: Clip) -> float:
    """Returns the mean distance of elbow, wrist and finger joints, seen from the root, in thousandths of the arm's
    length.
    """
    joints = arm_and_finger_joints(true)
    difference = relative_positions(predicted, joints) - relative_positions(true, joints)
    return float(1000.0 * np.linalg.norm(difference, axis=-1).mean() / rig_info(true.skeleton).sizes.arm_length)


@dataclass(frozen=True)
class GroupErrors:
    """Mean distance of joints from the truth by group, thousandths of the arm's length; NaN if the rig has none.

    hands: both wrists, seen from the root.
    fingers: every finger joint, seen from its wrist and in its axes.
    trunk: trunk, neck and head, seen from the root.
    """

    hands: float
    fingers: float
    trunk: float


def group_errors(predicted: Clip, true: Clip) -> GroupErrors:
    """Returns the errors of a clip by group of joints: what one group gains does not hide what another loses."""
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
        clip_positions = [
            np.concatenate(
                [_joint_local_positions(origin, *clip, group_joints) for origin, group_joints in parts]
                or [np.empty((len(true), 0, 3))],
                1,
            )
            for clip in posed
        ]
        distances = np.linalg.norm(clip_positions[0] - clip_positions[1], axis=-1)
        return float(1000.0 * distances.mean() / info.sizes.arm_length) if distances.size else float("nan")

    return GroupErrors(**{name: error(parts) for name, parts in groups.items()})


def _is_finger(role: str) -> bool:
    return any(finger in role for finger in FINGERS)


def _joint_local_positions(origin: int, rotations: FloatArray, positions: FloatArray, joints: list[int]) -> FloatArray:
    """Returns positions (T, K, 3) of joints from joint ``origin``, in its axes, from global rotations and positions."""
    relative = positions[:, joints] - positions[:, origin, None]
    return np.asarray(np.einsum("tba,tkb->tka", rotations[:, origin], relative))


EVEN_FRACTION = 0.02
"""Change of a joint's rotation step from one frame to the next, as a fraction of the fastest joint's step, up to which
it rotates evenly.
"""


def even_rotation_frames(clip: Clip) -> FloatArray:
    """Returns for every frame but the first and the last (T - 2,): 1 if every arm and finger joint repeats its last
    rotation step, 0 if one does not, NaN if none moves or is known.

    People do not move so; a program that interpolates between keys does (slerp), and so does one that fills gaps of a
    capture. A measurement on such frames shows how near a method is to that program.
    """
    q = clip.local_rotations[:, arm_and_finger_joints(clip)]
    steps = rotation.difference(q[:-1], q[1:])
    fastest = np.linalg.norm(steps, axis=-1).max(axis=1, initial=0.0)
    speed = np.maximum(fastest[:-1], fastest[1:])
    change = np.linalg.norm(np.diff(steps, axis=0), axis=-1).max(axis=1, initial=0.0)
    return np.where(speed > MOVING_RAD, change < EVEN_FRACTION * speed, np.nan)


def even_rotation_fraction(clip: Clip) -> float:
    """Returns the fraction of the moving frames in which every arm and finger joint repeats its last rotation step
    (``even_rotation_frames``): near 0 of captured motion without filled gaps, 0 if nothing moves.
    """
    even = even_rotation_frames(clip)
    moving = even[~np.isnan(even)]
    return float(moving.mean()) if len(moving) else 0.0


def format_keyedness(clip: Clip) -> str:
    """Returns the text with which tables mark a keyed clip (``rig.keyedness``)."""
    even = 100.0 * even_rotation_fraction(clip)
    return f"{judge_keyedness(clip).reason}, {even:.0f} % of its moving frames repeat the step before"


def motion_ratio(predicted: Clip, true: Clip) -> float:
    """Returns the path length of the fingertips, seen from the root, predicted over true; 1 moves as much as the truth
    does. NaN if the truth does not move.
    """
    joints = fingertip_joints(true)
    paths = [
        np.linalg.norm(np.diff(relative_positions(clip, joints), axis=0), axis=-1).sum() for clip in (predicted, true)
    ]
    return float(paths[0] / paths[1]) if paths[1] > 0.0 else float("nan")
