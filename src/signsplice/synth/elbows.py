"""Where elbows go over time: their easy places smoothed, and turned out of the trunk and of the other arm.

The easy place of an elbow depends on one pose (``pose.wrist_angles``) and can change suddenly with it. What is smoothed
is the direction from the line between shoulder and wrist to the elbow, in the chest's axes: an angle about that line
has no reference that is steady everywhere.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from signsplice.body import capsules, swivel
from signsplice.motion import kinematics, rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig.naming import SIDES
from signsplice.synth import pose, trajectory
from signsplice.synth.signer import COLLAR, JOINTS, SHOULDER, UPPER_ARM, Signer, skeleton

_WIDTH_S = 0.10
"""Standard deviation of the Gaussian that smooths these directions in time, seconds."""
_LED_S = 0.08
"""The same for those on the path of least cost."""
_CLEARING_S = 0.06
"""The same for what keeps forearms free, which is smoothed as much once already."""
_PRESSED_M = 0.003
"""Depth up to which a forearm may press into the trunk or the other arm, m: both give."""
_SIDES = ("Right", "Left")
"""The strong and the weak arm of a right-handed signer."""


def steadied(states: FloatArray, signer: Signer, fps: float, led: bool = False) -> FloatArray:
    """States (T, 65) of a whole word with elbows that move smoothly and keep forearms out of the trunk and of the other
    arm; in plain motion the states themselves. ``exact``: elbows go where wrists can turn hands as they are written.
    """
    if not signer.manner.low_elbows:
        return states
    directions, width_s = (_led(states, signer, fps), _LED_S) if led else (_directions(states, signer), _WIDTH_S)
    states = _directed(states, gaussian_filter1d(directions, width_s * fps, axis=0, mode="nearest"), signer)
    for which in (0, 1):
        turns = gaussian_filter1d(_clearing(states, which, signer, fps), _CLEARING_S * fps, mode="nearest")
        states = states.copy()
        states[:, pose.TURNS.start + which] += turns
    return states


_GRID = np.deg2rad(np.linspace(-105.0, 65.0, 26))
"""Turns from where elbows hang that are tried where hands go as they are written; negative ones lift them outwards."""
_MISSED = np.deg2rad(7.5)
"""Angle by which a hand misses its direction that costs 0.7; twice as much costs 8 times as much."""
_EFFORT = 0.35
"""What an elbow costs that is not where it is easy, over ``pose.swivel_costs``."""
_BEFORE, _ACROSS = 0.35, 0.08
"""How far before the shoulder an elbow crosses the trunk freely, and how far, inwards by how far behind that, costs 1,
over the upper arm's length."""
_RAISED = 0.1
"""How high over both shoulder and wrist an elbow costs 1, over the upper arm's length."""
_STEP = 0.075
"""Step of an elbow in a thirtieth of a second that costs 1, over the upper arm's length."""


def _led(states: FloatArray, signer: Signer, fps: float) -> FloatArray:
    """Directions (T, 2, 3) to elbows on the path of least cost over a whole word (Viterbi 1967): hands miss their
    directions little, arms are easy, and elbows go no farther from frame to frame than they must.
    """
    both = pose.hands(states)
    arm = pose.solve_arm(both[..., pose.WRIST], signer)
    swivels = np.broadcast_to(_GRID, (*arm.bend.shape, len(_GRID)))
    missed = np.square(pose.missed_angle(arm, both[..., pose.ROTVEC], swivels) / _MISSED)
    costs = np.square(missed) / (1.0 + 0.45 * missed)  # small misses cost little
    costs = costs + _EFFORT * pose.swivel_costs(arm, both[..., pose.ROTVEC], signer, _GRID)  # (T, 2, K)
    out, across = (x[..., None, :] for x in _frame(arm))
    directions = np.cos(_GRID)[:, None] * out + np.sin(_GRID)[:, None] * across  # (T, 2, K, 3)
    bone = rotation.rotate(arm.upper, [-1.0, 0.0, 0.0])[..., None, :]
    along = np.sum(bone * arm.direction[..., None, :], axis=-1, keepdims=True) * arm.direction[..., None, :]
    elbow = along + np.linalg.norm(bone - along, axis=-1, keepdims=True) * directions
    across_trunk = np.maximum(0.0, elbow[..., 0]) * np.maximum(0.0, _BEFORE - elbow[..., 2])
    wrist = (both[..., 1] / signer.scale - (COLLAR + SHOULDER)[1]) / (UPPER_ARM * signer.arms)
    raised = np.maximum(0.0, elbow[..., 1] - np.maximum(0.0, wrist)[..., None])
    costs = costs + np.square(across_trunk / _ACROSS) + np.square(raised / _RAISED)
    rows = np.arange(len(states))
    led = np.empty((len(states), 2, 3))
    for which in (0, 1):
        step = elbow[1:, which, None] - elbow[:-1, which, :, None]
        changes = np.square(step / _STEP).sum(axis=-1) * (fps / 30.0) ** 2
        led[:, which] = directions[rows, which, swivel.smoothest(costs[:, which], changes)]
    return led


def kept(states: FloatArray, before: FloatArray, signer: Signer) -> FloatArray:
    """States (T, 65) with elbows in the directions of those ``before`` (T, 65) hands were moved a little: an easy place
    can be far from the one beside it.
    """
    return _directed(states, _directions(before, signer), signer)


def joined(states: FloatArray, before: FloatArray, after: FloatArray, signer: Signer) -> FloatArray:
    """States (n, 65) of a transition whose elbows go from those of ``before`` (.., 65) to those of ``after`` (.., 65),
    at the speed of both ends; in plain motion the states themselves.
    """
    if not signer.manner.low_elbows:
        return states
    steps = len(states) + 1
    start, end = (_directions(part, signer).reshape(len(part), 6) for part in (before, after))
    between = trajectory.joining(start, end, steps, np.arange(1, steps)[:, None] / steps)
    return _directed(states, between.reshape(-1, 2, 3), signer)


def largest_step(states: FloatArray, before: FloatArray, after: FloatArray, signer: Signer) -> float:
    """The largest step of an elbow from frame to frame in a transition's states (n, 65) and from and to the states
    beside it, cm on the standard body, from the chest.
    """
    states = np.concatenate([before[-1:], states, after[:1]])
    return float(np.linalg.norm(np.diff(_positions(states, signer), axis=0), axis=-1).max())


_FASTEST_CM_S = 280.0
"""Speed of an elbow about its shoulder from which on its direction is smoothed once more."""
_SLOWED_S, _SLOWED_ROUNDS = 0.2, 6
"""How far around that it is, seconds, and how often at most."""


def slowed(states: FloatArray, signer: Signer, fps: float) -> FloatArray:
    """States (T, 65) in which elbows that swing faster than people's go in more time; the states themselves without."""
    for _ in range(_SLOWED_ROUNDS):
        speed = np.linalg.norm(np.diff(_positions(states, signer), axis=0), axis=-1) * fps
        fast = np.concatenate([np.zeros((1, 2)), speed > _FASTEST_CM_S])
        if not fast.any():
            break
        near = maximum_filter1d(fast, 2 * round(_SLOWED_S * fps) + 1, axis=0)
        near = gaussian_filter1d(near, 0.4 * _SLOWED_S * fps, axis=0)[..., None]
        directions = _directions(states, signer)
        smooth = gaussian_filter1d(directions, _WIDTH_S * fps, axis=0, mode="nearest")
        states = _directed(states, directions + near * (smooth - directions), signer)
    return states


def _positions(states: FloatArray, signer: Signer) -> FloatArray:
    """Elbows (T, 2, 3) of states (T, 65) from their shoulders, cm on the standard body, in the chest's axes."""
    arm, swivels = _solved(states, signer)
    turned = rotation.multiply(rotation.exp(swivels[..., None] * arm.direction), arm.upper)
    return np.asarray(rotation.rotate(turned, [-UPPER_ARM * signer.arms, 0.0, 0.0]))


def _solved(states: FloatArray, signer: Signer) -> tuple[pose.Arm, FloatArray]:
    """Both arms of states (T, 65) with hanging elbows, and their swivels (T, 2)."""
    both = pose.hands(states)
    arm = pose.solve_arm(both[..., pose.WRIST], signer)
    return arm, pose.wrist_angles(arm, both[..., pose.ROTVEC], signer, states[..., pose.TURNS]).swivel


def _frame(arm: pose.Arm) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (T, 2, 3) at right angles to the line from shoulder to wrist: to a hanging elbow, and to one that is
    turned by a quarter.
    """
    bone = rotation.rotate(arm.upper, [-1.0, 0.0, 0.0])
    out = bone - np.sum(bone * arm.direction, axis=-1, keepdims=True) * arm.direction
    out = out / np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-9)
    return out, np.cross(arm.direction, out)


def _directions(states: FloatArray, signer: Signer) -> FloatArray:
    """Unit vectors (T, 2, 3) from the lines between shoulders and wrists to the elbows of states (T, 65)."""
    arm, swivels = _solved(states, signer)
    out, across = _frame(arm)
    return np.asarray(np.cos(swivels)[..., None] * out + np.sin(swivels)[..., None] * across)


def _directed(states: FloatArray, directions: FloatArray, signer: Signer) -> FloatArray:
    """States (T, 65) with elbows turned to these directions (T, 2, 3), as nearly as the wrists allow."""
    arm, swivels = _solved(states, signer)
    out, across = _frame(arm)
    wanted = np.arctan2(np.sum(directions * across, axis=-1), np.sum(directions * out, axis=-1))
    directed = states.copy()
    directed[:, pose.TURNS] += np.angle(np.exp(1j * (wanted - swivels)))
    return directed


def _clearing(states: FloatArray, which: int, signer: Signer, fps: float) -> FloatArray:
    """By how much (T,) the swivels of the strong (0) or the weak arm (1) change for its forearm to be free."""
    bones = skeleton(replace(signer, left_handed=False))
    body = capsules.body_capsules(bones)
    clip = Clip(bones, *pose.rotations(states, replace(signer, left_handed=False)), fps)
    rotations, positions = kinematics.forward(clip)
    starts, ends = (0.01 * x for x in capsules.capsule_ends(body, rotations, positions))
    side = SIDES[1 - which]
    solid = [*body.groups.below_arms, *(body.groups.right_arm if which else body.groups.left_arm)]
    radii = 0.01 * body.radii
    s, e, w = (0.01 * positions[:, JOINTS[_SIDES[which] + name]] for name in ("Arm", "ForeArm", "Hand"))
    turns = swivel.choose(
        swivel.BentArm(s, e, w, radii[body.keys.index(f"{side}LowerArm")]),
        swivel.Solid(starts[:, solid], ends[:, solid], radii[solid]),
        np.full((len(states), len(solid)), _PRESSED_M),
        fps,
    )
    return turns if which == 0 else -turns
