"""Wrists led elsewhere: arms of any rig bent so that each wrist moves by so much, bones as long as before.

An arm is two bones from shoulder to elbow to wrist. With the wrist's new place t the elbow turns about the normal of
the arm's plane until the shoulder's distance to the wrist is |t - s| (law of cosines), and the upper arm turns by the
least rotation that points the wrist at t. The hand keeps its turn in the world, so that palm and fingers face as they
did. A straight arm has no plane: it bends as elbows do, about the hinge that the common pose (``common_pose``) has
there, which brings the forearm ahead of a T-pose.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip
from signsplice.rig.arms import arm_joints
from signsplice.rig.t_pose import t_pose_rotations

Float = NDArray[np.float64]

_REACH = 0.999
"""Share of an arm's length that a wrist may be from its shoulder; a straight elbow has no plane to bend in."""
_STRAIGHT = 0.05
"""Sine of the bend (3 degrees) up to which an arm is straight."""
_HINGES = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
"""Axes, in the common pose, about which the left and the right elbow bend."""
_TINY = 1e-9


def move_wrists(clip: Clip, moves: Float) -> Clip:
    """The clip with left and right wrist moved by ``moves`` (T, 2, 3), world axes and clip units; what lies beyond an
    arm's reach is approached as far as it goes.

    Raises ``InputError`` where the rig's arms are not known by name.
    """
    known = arm_joints(clip.skeleton)
    local = np.array(clip.local_rotations)
    parents = [int(clip.skeleton.parents[joint]) for joint in known[:6]]
    globals_, places = kinematics.forward(clip, [*known[:6], *parents])
    for side in (0, 1):
        rows = np.flatnonzero(np.abs(moves[:, side]).max(axis=1) > 0.0)
        if not len(rows):
            continue
        at = slice(3 * side, 3 * side + 3)
        above = rotation.from_matrix(globals_[rows, 6 + 3 * side : 9 + 3 * side])
        s, e, w = np.moveaxis(places[rows, at], 1, 0)
        rest = rotation.rotate(rotation.inverse(t_pose_rotations(clip.skeleton)[known[at.start]]), _HINGES[side])
        bend, aim = _solve_arm(s, e, w, w + moves[rows, side], globals_[rows, at.start] @ rest)
        both = rotation.multiply(aim, bend)
        for joint, over, turn in zip(
            known[at], np.moveaxis(above, 1, 0), (aim, bend, rotation.inverse(both)), strict=True
        ):
            # A turn R of the world about the joint, all above it being turned already, is A^-1 R A before its own.
            own = rotation.multiply(rotation.multiply(rotation.inverse(over), turn), over)
            local[rows, joint] = rotation.multiply(own, local[rows, joint])
    return replace(clip, local_rotations=local)


def _solve_arm(s: Float, e: Float, w: Float, target: Float, hinge: Float) -> tuple[Float, Float]:
    """Turns (T, 4) of the world: of all below the elbow about the elbow, then of the whole arm about the shoulder.
    ``hinge`` (T, 3): where a straight elbow bends about.
    """
    upper, lower = e - s, w - e
    a, b = _length(upper), _length(lower)
    now = _length(w - s)
    wanted = np.clip(_length(target - s), np.abs(a - b) / _REACH + _TINY, _REACH * (a + b))
    normal = rotation.cross(upper, lower)
    straight = _length(normal) < _STRAIGHT * a * b
    along = upper / a[:, None]
    across = hinge - (hinge * along).sum(-1, keepdims=True) * along
    normal = np.where(straight[:, None], across, normal)
    normal = normal / (_length(normal)[:, None] + _TINY)
    turn = _flexion(a, b, wanted) - _flexion(a, b, now)
    bend = rotation.exp(normal * turn[:, None])
    bent = e + rotation.rotate(bend, lower) - s
    return bend, rotation.between_vectors(bent, target - s)


def _flexion(a: Float, b: Float, distance: Float) -> Float:
    """Radians by which an elbow is bent, 0 when straight."""
    cosine = (a * a + b * b - distance * distance) / (2.0 * a * b)
    return np.asarray(np.pi - np.arccos(np.clip(cosine, -1.0, 1.0)))


def _length(v: Float) -> Float:
    return np.asarray(np.linalg.norm(v, axis=-1))
