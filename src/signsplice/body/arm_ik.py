"""Inverse kinematics of arms: moves wrists by given vectors on any rig and keeps bone lengths.

An arm is two bones from shoulder s to elbow to wrist. With the wrist's new position t the elbow turns about the normal
of the arm's plane until the shoulder's distance to the wrist is |t - s| (law of cosines), and the upper arm turns by
the smallest rotation that points the wrist at t. The hand keeps its global rotation, so that palm and fingers face as
before. A straight arm has no plane: it bends about the hinge that the elbow has in the T-pose, which brings the forearm
forward from there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig.info import rig_info

_REACH = 0.999
"""Largest distance of a wrist from its shoulder, as a fraction of the arm's length: a straight elbow has no plane."""
_STRAIGHT = 0.05
"""Sine of the bend (3 degrees) up to which an arm is straight."""
_HINGES = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
"""Axes, in the T-pose, about which the left and the right elbow bend."""
_TINY = 1e-9


def move_wrists(clip: Clip, moves: FloatArray, swivels: FloatArray | None = None) -> Clip:
    """Returns the clip with left and right wrist moved by ``moves`` (T, 2, 3), world axes and clip units; an arm
    approaches a target beyond its reach as far as possible.

    swivels: (T, 2) radians by which each elbow then turns about the line from shoulder to wrist.

    Raises ``InputError`` if the names of the rig do not identify its arms.
    """
    info = rig_info(clip.skeleton)
    joints = info.arm_joints
    local = np.array(clip.local_rotations)
    parents = [int(clip.skeleton.parents[joint]) for joint in joints[:6]]
    global_rotations, positions = kinematics.forward(clip, [*joints[:6], *parents])
    for side in (0, 1):
        changes = np.abs(moves[:, side]).max(axis=1) > 0.0
        if swivels is not None:
            changes |= swivels[:, side] != 0.0
        rows = np.flatnonzero(changes)
        if not len(rows):
            continue
        arm = slice(3 * side, 3 * side + 3)
        above = rotation.from_matrix(global_rotations[rows, 6 + 3 * side : 9 + 3 * side])
        s, e, w = np.moveaxis(positions[rows, arm], 1, 0)
        target = w + moves[rows, side]
        bend, arm_turn = _solve_arm(s, e, w, target, global_rotations[rows, arm.start] @ _hinge(clip, side))
        if swivels is not None:
            axis = (target - s) / (_length(target - s)[:, None] + _TINY)
            arm_turn = rotation.multiply(rotation.exp(swivels[rows, side, None] * axis), arm_turn)
        both = rotation.multiply(arm_turn, bend)
        steps = zip(joints[arm], np.moveaxis(above, 1, 0), (arm_turn, bend, rotation.inverse(both)), strict=True)
        for joint, parent, turn in steps:
            # With all joints above rotated already, a global rotation R about the joint is A^-1 R A before its own.
            local_turn = rotation.multiply(rotation.multiply(rotation.inverse(parent), turn), parent)
            local[rows, joint] = rotation.multiply(local_turn, local[rows, joint])
    return replace(clip, local_rotations=local)


def solve_arm_positions(clip: Clip, moves: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns shoulders, elbows and wrists (T, 2, 3) of ``move_wrists(clip, moves)``, world axes and clip units."""
    joints = rig_info(clip.skeleton).arm_joints
    global_rotations, positions = kinematics.forward(clip, joints[:6])
    moved = positions[:, :6].reshape(len(clip), 2, 3, 3).copy()
    for side in (0, 1):
        s, e, w = np.moveaxis(positions[:, 3 * side : 3 * side + 3], 1, 0)
        hinge = global_rotations[:, 3 * side] @ _hinge(clip, side)
        bend, arm_turn = _solve_arm(s, e, w, w + moves[:, side], hinge)
        elbow = rotation.rotate(arm_turn, e - s)
        moved[:, side, 1] = s + elbow
        moved[:, side, 2] = s + elbow + rotation.rotate(rotation.multiply(arm_turn, bend), w - e)
    return moved[:, :, 0], moved[:, :, 1], moved[:, :, 2]


def swivel_elbows(shoulders: FloatArray, elbows: FloatArray, wrists: FloatArray, swivels: FloatArray) -> FloatArray:
    """Returns the elbows (..., 3), turned by ``swivels`` (...) about the lines from shoulders to wrists."""
    axis = (wrists - shoulders) / (_length(wrists - shoulders)[..., None] + _TINY)
    return shoulders + rotation.rotate(rotation.exp(swivels[..., None] * axis), elbows - shoulders)


def _hinge(clip: Clip, side: int) -> FloatArray:
    """Returns the axis (3,) about which a straight elbow bends, in the axes of the upper arm."""
    info = rig_info(clip.skeleton)
    return np.asarray(
        rotation.rotate(rotation.inverse(info.t_pose.rotations[info.arm_joints[3 * side]]), _HINGES[side])
    )


def _solve_arm(
    s: FloatArray, e: FloatArray, w: FloatArray, target: FloatArray, hinge: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns global rotations (T, 4): of forearm and hand about the elbow, then of the whole arm about the shoulder.

    s, e, w: (T, 3) shoulder, elbow and wrist. target: (T, 3) of the wrist. hinge: (T, 3) axis of a straight elbow.
    """
    upper, lower = e - s, w - e
    a, b = _length(upper), _length(lower)
    distance = _length(w - s)
    reach = np.clip(_length(target - s), np.abs(a - b) / _REACH + _TINY, _REACH * (a + b))
    normal = rotation.cross(upper, lower)
    straight = _length(normal) < _STRAIGHT * a * b
    upper_axis = upper / a[:, None]
    hinge_normal = hinge - (hinge * upper_axis).sum(-1, keepdims=True) * upper_axis
    normal = np.where(straight[:, None], hinge_normal, normal)
    normal = normal / (_length(normal)[:, None] + _TINY)
    turn = _flexion(a, b, reach) - _flexion(a, b, distance)
    bend = rotation.exp(normal * turn[:, None])
    bent = e + rotation.rotate(bend, lower) - s
    return bend, rotation.between_vectors(bent, target - s)


def _flexion(a: FloatArray, b: FloatArray, distance: FloatArray) -> FloatArray:
    """Returns the bend of an elbow, radians, 0 when straight."""
    cosine = (a * a + b * b - distance * distance) / (2.0 * a * b)
    return np.asarray(np.pi - np.arccos(np.clip(cosine, -1.0, 1.0)))


def _length(v: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(v, axis=-1))
