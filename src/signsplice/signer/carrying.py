"""Hands that keep their places on a body whose head and trunk move.

Hands are given from the chest, and places on the body for a head and trunk that are upright. A hand that is at a part
of the body is carried with it, rigidly where it touches, less with distance, not at all in free space. Hanging hands
stay beside the hips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from signsplice.body.collision import PosedCapsules
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.motion.curves import between, sparse
from signsplice.motion.kinematics import forward, rest_positions
from signsplice.signer import pose
from signsplice.signer.figure import Figure
from signsplice.signer.signer import JOINTS, Signer, skeleton

_CARRIERS = ("Head", "Neck", "Spine2", "Hips")
"""Joints that carry parts of the body, and so hands. What hangs on others is carried with the chest."""
_HEAD, _CHEST, _HIPS = 0, 2, 3
FREE_CM, _HELD_CM = 14.0, 0.5
"""Distances from the skin at which a hand is free, and from which on it is carried wholly."""
_WEIGHT_CM = 1.0
"""How much farther a part of the body is that carries less by the factor e."""
TOGETHER_CM = 8.0
"""Distance of two hands up to which they are carried alike."""
_HANGING_CM = (24.0, 38.0)
"""How far below the chest a hand begins to hang, and hangs."""
_TOUCH_CM = 2.0
"""Distance from the skin up to which it is kept, where the wrist's limits would change it."""
_ROUNDS, _SMOOTHED_FRAMES = 3, 1.0
"""How often that distance is corrected, and how far a correction is spread in time."""
_MIRRORED = np.array([-1.0, 1.0, 1.0])
_MIRRORED_QUAT = np.array([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Nearness:
    """Where the hands (strong, weak) of an upright right-handed signer are.

    weights: (T, 2, 4) how far head, neck, chest and hips carry each hand; the rest is free
    clearances: (T, 2, 4) distance of each hand's skin from that of each of these, cm, negative inside
    apart: (T,) distance of the hands from one another or a forearm, cm, up to ``TOGETHER_CM`` by the signer's scale
    head_side: (T, 2) where at the head each hand is, from -1 (strong side) over 0 (front) to 1 (weak side)
    """

    weights: FloatArray
    clearances: FloatArray
    apart: FloatArray
    head_side: FloatArray

    @property
    def head(self) -> FloatArray:
        """Distance (T, 2) of each hand's skin from the head's, cm."""
        return self.clearances[..., _HEAD]


def nearness(states: FloatArray, signer: Signer, most: float = np.inf) -> Nearness:
    """Where the hands of states (T, 65) are, were head and trunk upright. With ``most``, cm, at least ``FREE_CM`` by
    the signer's scale, a hand that hangs, or that is farther than that from the skin, counts as so far.
    """
    upright = states.copy()
    upright[:, 54:] = 0.0
    capsules = Figure(upright, signer).posed(upright).capsules
    begins, hangs = _HANGING_CM
    height = pose.hands(states)[..., 1] / signer.scale
    hanging = pose.smooth_step((-height - begins) / (hangs - begins))[..., None]
    clearances, out = _clearances(capsules, most, hanging[..., 0] < 1.0 if np.isfinite(most) else None)
    apart = _apart(capsules, TOGETHER_CM * signer.scale)
    weights = _weights(clearances / signer.scale, apart / signer.scale)
    weights = hanging * np.eye(len(_CARRIERS))[_HIPS] + (1.0 - hanging) * weights
    return Nearness(weights, clearances, apart, out[..., _HEAD, 0])


def roughly(states: FloatArray, signer: Signer, fps: float) -> Nearness:
    """``nearness`` about 8 times a second, linear between them, and no farther than hands are carried."""
    some = sparse(len(states), fps / 7.5)
    near = nearness(states[some], signer, FREE_CM * signer.scale)
    return Nearness(*(between(x, some) for x in vars(near).values()))


def _clearances(
    capsules: PosedCapsules, most: float = np.inf, where: NDArray[np.bool_] | None = None
) -> tuple[FloatArray, FloatArray]:
    """Distances (T, 2, 4) of both hands' skin from that of the carriers, cm, and the directions (T, 2, 4, 3) away from
    it in the chest's axes; ``most`` and 0 where all are farther, and but ``where`` (T, 2).
    """
    body, names = capsules.body, list(JOINTS)
    solid = (*body.groups.head, *body.groups.trunk)
    carriers = [n if (n := names[body.joints[k]]) in _CARRIERS else "Spine2" for k in solid]
    parts = [[k for k, n in zip(solid, carriers, strict=True) if n == name] for name in _CARRIERS]
    size = (len(capsules.starts), 2, len(_CARRIERS))
    clearances, out = np.full(size, most), np.zeros((*size, 3))
    for n, hand in enumerate((body.groups.right, body.groups.left)):
        at = slice(None) if where is None else where[:, n]
        clearances[at, n], out[at, n] = capsules[at].nearest(hand, parts, most)
    return clearances, out


def _apart(capsules: PosedCapsules, most: float) -> FloatArray:
    """Distances (T,) of the hands from one another or a forearm, cm, or ``most`` where they are greater."""
    body = capsules.body
    hands = body.groups.right, body.groups.left
    arms = [
        [n for n, part in enumerate(body.parts) if part == "cuff" and body.sides[n] == side]
        for side in ("right", "left")
    ]
    depths = [capsules.nearest(hands[n], ((*hands[1 - n], *arms[1 - n]),), most)[0][:, 0] for n in (0, 1)]
    return np.minimum(*depths)


def _weights(clearances: FloatArray, apart: FloatArray) -> FloatArray:
    """Shares (T, 2, 4) from the distances of hands to the parts of the body (T, 2, 4) and to one another (T,), cm."""
    nearest = clearances.min(axis=-1, keepdims=True)
    weights = np.exp((nearest - clearances) / _WEIGHT_CM)
    weights /= weights.sum(axis=-1, keepdims=True)
    weights = weights * pose.smooth_step((FREE_CM - nearest) / (FREE_CM - _HELD_CM))
    alike = 0.5 * pose.smooth_step((TOGETHER_CM - apart) / (TOGETHER_CM - _HELD_CM))[:, None, None]
    return np.asarray((1.0 - alike) * weights + alike * weights[:, ::-1])


def carried(states: FloatArray, near: Nearness, signer: Signer) -> FloatArray:
    """States (T, 65) of a right-handed signer with hands carried by head and trunk, as these are in ``states``."""
    turns, places = _carriers(states, signer)
    rest = rest_positions(skeleton(signer))[[JOINTS[name] for name in _CARRIERS]]
    rest = rest - rest[_CHEST]
    moved = states.copy()
    quats = pose.hand_rotations(states, signer)
    for n, (mirror, mirror_quat) in enumerate(((np.ones(3), np.ones(4)), (_MIRRORED, _MIRRORED_QUAT))):
        wrist = pose.hands(states)[:, n, pose.WRIST] * mirror
        moves = rotation.rotate(turns, wrist[:, None] - rest) + places - wrist[:, None]  # (T, 4, 3)
        wrist = (wrist + np.einsum("tk,tkc->tc", near.weights[:, n], moves)) * mirror
        turn = rotation.exp(np.einsum("tk,tkc->tc", near.weights[:, n], rotation.log(turns)))
        quat = rotation.multiply(turn, quats[:, n] * mirror_quat) * mirror_quat
        hand = pose.hands(moved)[:, n]
        hand[:, pose.WRIST], hand[:, pose.ROTVEC] = wrist, pose.hand_rotvecs(wrist, quat, signer)
    return moved


def _carriers(states: FloatArray, signer: Signer) -> tuple[FloatArray, FloatArray]:
    """Rotations (T, 4, 4) and positions (T, 4, 3), cm, of the carriers in the chest's axes and from the chest."""
    joints = [JOINTS[name] for name in _CARRIERS]
    upright = Clip(skeleton(signer), *pose.without_arms(states, signer), 30.0)
    rotations, positions = forward(upright, joints)
    chest = rotations[:, _CHEST]
    turns = rotation.from_matrix(np.einsum("tba,tkbc->tkac", chest, rotations))
    return turns, np.einsum("tba,tkb->tka", chest, positions - positions[:, _CHEST, None])


def kept_away(states: FloatArray, near: Nearness, signer: Signer) -> FloatArray:
    """States (T, 65) with hands as far from the skin as they were, where that was near to nothing: a wrist at its
    limits does not follow wholly.
    """
    states = states.copy()
    nearest = near.clearances.argmin(axis=-1)[..., None]  # (T, 2, 1)
    wanted = np.take_along_axis(near.clearances, nearest, axis=-1)
    weight = pose.smooth_step((_TOUCH_CM - wanted / signer.scale) / (_TOUCH_CM - _HELD_CM))
    frames = weight.any(axis=(1, 2))
    pushes = np.zeros((len(states), 2, 3))
    nearest, wanted, weight = nearest[frames], wanted[frames], weight[frames]
    if not frames.any():
        return states
    figure = Figure(states[frames], signer)
    for _ in range(_ROUNDS):
        clearances, out = _clearances(figure.posed(states[frames]).capsules)
        missing = weight * (wanted - np.take_along_axis(clearances, nearest, axis=-1))  # (F, 2, 1)
        pushes[frames] = missing * np.take_along_axis(out, nearest[..., None], axis=2)[:, :, 0]
        push = gaussian_filter1d(pushes, _SMOOTHED_FRAMES, axis=0, mode="nearest")
        pose.hands(states)[..., pose.WRIST] += push * [np.ones(3), _MIRRORED]
    return states
