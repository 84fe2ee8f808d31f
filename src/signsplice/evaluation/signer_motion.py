"""How a signer moves: speeds of head, trunk and arm, postures of the strong arm, likeness of the two hands, and when
fingers form. All of it is measured on clips alone, in the same way on synthetic and on captured motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from signsplice.evaluation.flexion import flexions
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS

Float = NDArray[np.float64]

MOVING = 0.1
"""Speed of the faster wrist, arm lengths a second, from which on a frame counts as moving."""
MIRRORED_SPEED, MIRRORED_COSINE, MIRRORED_FRAMES = 0.3, 0.5, 6
"""Hands mirror each other while both wrists are faster than this (arm lengths a second), one wrist's velocity and the
mirror image of the other's have at least this cosine, and both for at least so many frames.
"""
_LARGEST_LAG = 3
_REACH_SPEED = 0.5
_REACH_FRAMES = 4
_FORMING_DEG = 20.0


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """Motion of one signer in some clips. Frames in which no wrist moves (``MOVING``) do not count.

    angular_deg: angular speed of a joint relative to its parent, degrees/s (N,), by role ("head", "neck", "spine": the
        lowest joint of the spine; "UpperArm", "Hand": of the strong side); roles the rig lacks are left out.
    speed: speed of the strong wrist in space, arm lengths (shoulder to wrist) a second (N,).
    abduction_deg: angle between the strong upper arm and the line from the middle of the shoulders to the hips (N,).
    wrist_bend_deg: angle between the strong forearm and the line from its wrist to its middle knuckle (N,); empty where
        the rig has no fingers.
    mirror_cm: distance of the strong wrist from the mirror image of the weak one, while hands mirror each other
        (``MIRRORED_SPEED``) (M,). The mirror is the plane through the middle of the shoulders, across their line.
    mirror_lag: frames by which one of these hands is behind the other: the shift, up to three frames, at which the
        speeds of both correlate best (K,), one for each stretch.
    forming: when a finger has made half of its change of bend on a reach, as a fraction of the reach's time (R,). A
        reach lies between two minima of the strong wrist's speed and is faster than half an arm length a second
        somewhere; fingers that change by less than 20 degrees are left out.
    """

    angular_deg: dict[str, Float]
    speed: Float
    abduction_deg: Float
    wrist_bend_deg: Float
    mirror_cm: Float
    mirror_lag: Float
    forming: Float


def signer_motion(clips: Sequence[Clip], strong: str) -> MeasuredMotion:
    """Motion of the signer of some clips of one rig, whose strong side is ``strong``, "left" or "right"."""
    each = [_one(clip, strong) for clip in clips]

    def joined(name: str) -> Float:
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
    for role in ("head", "neck", "spine", "UpperArm", "Hand"):
        joint = joints.get(strong + role if role[0].isupper() else role)
        if joint is not None:
            q = clip.local_rotations[:, joint]
            turns = np.linalg.norm(rotation.difference(q[:-1], q[1:]), axis=-1)
            angular[role] = np.rad2deg(turns * clip.fps)[moving]
    cm = 100.0 * info.sizes.unit.metres
    distances, lags = _mirroring(own, strong, clip.fps, arm)
    return MeasuredMotion(
        angular,
        speed[moving],
        _angle_deg(upper_arm, own["hips"] - middle)[1:][moving],
        bend,
        distances * cm,
        lags,
        np.array(list(half_formed(clip, strong, reaches(speed)))),
    )


def _other(side: str) -> str:
    return "right" if side == "left" else "left"


def _angle_deg(a: Float, b: Float) -> Float:
    """Angles (T,) between vectors (T, 3), degrees."""
    cosine = (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-12)
    return np.asarray(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _mirroring(own: dict[str, Float], strong: str, fps: float, arm: float) -> tuple[Float, Float]:
    """``mirror_cm`` in clip units, and ``mirror_lag``, of joint positions by role."""
    middle = 0.5 * (own["leftUpperArm"] + own["rightUpperArm"])
    across = own["leftUpperArm"] - own["rightUpperArm"]
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    image = own[f"{_other(strong)}Hand"] - middle
    image = image - 2.0 * (image * across).sum(-1, keepdims=True) * across
    hands = np.stack([own[f"{strong}Hand"] - middle, image])  # (2, T, 3)
    velocity = np.diff(hands, axis=1) * fps / arm
    speed = np.linalg.norm(velocity, axis=-1)
    cosine = np.einsum("ti,ti->t", *velocity) / np.maximum(speed.prod(axis=0), 1e-12)
    alike = (speed.min(axis=0) > MIRRORED_SPEED) & (cosine > MIRRORED_COSINE)
    distances, lags = [np.empty(0)], []
    for first, stop in _runs(alike):
        if stop - first >= MIRRORED_FRAMES:
            distances.append(np.linalg.norm(hands[0] - hands[1], axis=-1)[first + 1 : stop + 1])
            lags.append(_lag(speed, first, stop))
    return np.concatenate(distances), np.array(lags)


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open ranges in which a mask is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _lag(speed: Float, first: int, stop: int) -> float:
    """By how many frames one of two speeds (2, T) is behind the other over [first, stop), with a fraction of a frame
    from a parabola through the best shift and its neighbours.
    """
    shifts = [s for s in range(-_LARGEST_LAG, _LARGEST_LAG + 1) if first + s >= 0 and stop + s <= speed.shape[1]]
    scores = np.array([_correlation(speed[0, first:stop], speed[1, first + s : stop + s]) for s in shifts])
    best = int(np.argmax(scores))
    if not 0 < best < len(shifts) - 1:
        return float(abs(shifts[best]))
    before, at, after = scores[best - 1 : best + 2]
    bow = before - 2.0 * at + after
    return float(abs(shifts[best] + (0.5 * (before - after) / bow if bow < 0.0 else 0.0)))


def _correlation(a: Float, b: Float) -> float:
    a, b = a - a.mean(), b - b.mean()
    return float((a * b).sum() / max(float(np.sqrt((a**2).sum() * (b**2).sum())), 1e-12))


def reaches(speed: Float) -> list[tuple[int, int]]:
    """[begin, end] frames of the reaches in speeds (T - 1,) from frame to frame: between two minima, at least four
    steps long, and somewhere faster than half an arm length a second.
    """
    inner = np.flatnonzero((speed[1:-1] <= speed[:-2]) & (speed[1:-1] < speed[2:])) + 1
    return [(int(a), int(b)) for a, b in pairwise(inner) if b - a >= _REACH_FRAMES and speed[a:b].max() > _REACH_SPEED]


def half_formed(clip: Clip, strong: str, spans: Sequence[tuple[int, int]]) -> Iterator[float]:
    """When the fingers of the strong hand have made half of their change of bend, as fractions of the time of spans
    [begin, end] of frames (``half_way``).
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
            fraction = half_way(bend[first : last + 1])
            if fraction is not None:
                yield fraction


def half_way(values: Float) -> float | None:
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
