"""How a signer moves: speeds of the arm, postures of the strong arm, and when fingers form.

All of it is measured on clips alone, in the same way on synthetic and on captured motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from signsplice.evaluation.hands import flexions
from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS

MOVING = 0.1
"""Speed of the faster wrist, arm lengths a second, from which on a frame counts as moving."""
_REACH_SPEED = 0.5
_REACH_FRAMES = 4
_FORMING_DEG = 20.0


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """Motion of one signer in some clips. Frames in which no wrist moves (``MOVING``) do not count.

    angular_deg: angular speed of a joint of the strong side relative to its parent, degrees/s (N,), by role
        ("UpperArm", "Hand"); roles the rig lacks are left out.
    speed: speed of the strong wrist in space, arm lengths (shoulder to wrist) a second (N,).
    abduction_deg: angle between the strong upper arm and the line from the middle of the shoulders to the hips (N,).
    wrist_bend_deg: angle between the strong forearm and the line from its wrist to its middle knuckle (N,); empty where
        the rig has no fingers.
    forming: when a finger has made half of its change of bend on a reach, as a fraction of the reach's time (R,). A
        reach lies between two minima of the strong wrist's speed and is faster than half an arm length a second
        somewhere; fingers that change by less than 20 degrees are left out.
    """

    angular_deg: dict[str, FloatArray]
    speed: FloatArray
    abduction_deg: FloatArray
    wrist_bend_deg: FloatArray
    forming: FloatArray


def signer_motion(clips: Sequence[Clip], strong: str) -> MeasuredMotion:
    """Motion of the signer of some clips of one rig, whose strong side is ``strong``, "left" or "right"."""
    each = [_one(clip, strong) for clip in clips]

    def joined(name: str) -> FloatArray:
        return np.concatenate([np.empty(0), *(getattr(one, name) for one in each)])

    roles = dict.fromkeys(role for one in each for role in one.angular_deg)
    angular = {role: np.concatenate([one.angular_deg[role] for one in each]) for role in roles}
    return MeasuredMotion(angular, *(joined(field.name) for field in fields(MeasuredMotion)[1:]))


def _one(clip: Clip, strong: str) -> MeasuredMotion:
    info = rig_info(clip.skeleton)
    joints = info.roles.joints
    arm = info.sizes.arm_length
    _, positions = kinematics.forward(clip)
    own = {role: positions[:, joint] for role, joint in joints.items()}  # (T, 3) each
    steps = np.diff(np.stack([own[f"{strong}Hand"], own[f"{_other(strong)}Hand"]]), axis=1)
    speeds = np.linalg.norm(steps, axis=-1) * clip.fps / arm  # (2, T - 1)
    speed, moving = speeds[0], speeds.max(axis=0) > MOVING
    upper_arm = own[f"{strong}LowerArm"] - own[f"{strong}UpperArm"]
    forearm = own[f"{strong}Hand"] - own[f"{strong}LowerArm"]
    middle = 0.5 * (own["leftUpperArm"] + own["rightUpperArm"])
    knuckle = own.get(f"{strong}MiddleProximal")
    bend = np.empty(0) if knuckle is None else _angle_deg(forearm, knuckle - own[f"{strong}Hand"])[1:][moving]
    angular = {}
    for role in ("UpperArm", "Hand"):
        joint = joints.get(strong + role)
        if joint is not None:
            q = clip.local_rotations[:, joint]
            turns = np.linalg.norm(rotation.difference(q[:-1], q[1:]), axis=-1)
            angular[role] = np.rad2deg(turns * clip.fps)[moving]
    return MeasuredMotion(
        angular,
        speed[moving],
        _angle_deg(upper_arm, own["hips"] - middle)[1:][moving],
        bend,
        np.array(list(half_formed(clip, strong, reaches(speed)))),
    )


def _other(side: str) -> str:
    return "right" if side == "left" else "left"


def _angle_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (T,) between vectors (T, 3), degrees."""
    cosine = (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-12)
    return np.asarray(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def reaches(speed: FloatArray) -> list[tuple[int, int]]:
    """[begin, end] frames of the reaches in speeds (T - 1,) from frame to frame: between two minima, at least four
    steps long, and somewhere faster than half an arm length a second.
    """
    inner = np.flatnonzero((speed[1:-1] <= speed[:-2]) & (speed[1:-1] < speed[2:])) + 1
    return [(int(a), int(b)) for a, b in pairwise(inner) if b - a >= _REACH_FRAMES and speed[a:b].max() > _REACH_SPEED]


def half_formed(clip: Clip, strong: str, spans: Sequence[tuple[int, int]]) -> Iterator[float]:
    """When the fingers of the strong hand have made half of their change of bend, as fractions of the time of spans
    [begin, end] of frames (``half_changed_at``).
    """
    bends = flexions(clip)
    n = len(clip)
    half = slice(0, n) if strong == "left" else slice(n, 2 * n)
    fingers = [
        np.stack([bends[f"{finger} {k}"][half] for k in (1, 2, 3)], axis=-1)
        for finger in FINGERS
        if f"{finger} 3" in bends
    ]  # (T, 3) each
    for first, last in spans:
        for bend in fingers:
            fraction = half_changed_at(bend[first : last + 1])
            if fraction is not None:
                yield fraction


def half_changed_at(values: FloatArray) -> float | None:
    """When values (T, K), degrees, have first made half of their way from first to last, as a fraction of the time;
    None where they change by less than 20.
    """
    change = values[-1] - values[0]
    if np.linalg.norm(change) < _FORMING_DEG:
        return None
    progress = (values - values[0]) @ change / (change @ change)
    after = int(np.argmax(progress >= 0.5))
    before = progress[after - 1]
    return float((after - 1 + (0.5 - before) / (progress[after] - before)) / (len(values) - 1))
