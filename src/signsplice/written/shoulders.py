"""Shoulders that a written sign lifts, hunches or shrugs: turned in the clip, arms bent anew so that hands stay.

The planner's shoulders follow the hands; what is written comes on top, in the time of the hands.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from signsplice.body import collision
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.signer.body_motion import gesture_level
from signsplice.signer.signer import JOINTS
from signsplice.written import faces
from signsplice.written.tree import WrittenSign

_CHAIN = ("Shoulder", "Arm", "ForeArm", "Hand")
_PARTS, _DEEP_CM = (1.0, 0.5, 0.25), 0.4
"""How much of what is written is tried, until no hand is deeper than this in what moves."""
_REACH = 0.995
"""How long an arm is at most, over its bones: a hand that hangs comes along with what is beyond."""


def with_shoulders(clip: Clip, sign: WrittenSign, hands: tuple[int, int]) -> Clip:
    """A clip of the synthetic signer with the shoulders of its sign, whose hands sign in the half-open frames
    ``hands``, as far as these are not in their way; itself where the sign has none.
    """
    tracks = list(faces.shoulder_tracks(sign))
    if not tracks:
        return clip
    least = max(_DEEP_CM, float(collision.hand_depths(clip).max()))
    for part in _PARTS:
        quats = clip.local_rotations.copy()
        for side, degrees, cycles, begin, end in tracks:
            level = part * gesture_level(len(clip), clip.fps, hands, begin, end, cycles)
            for name in ("Left", "Right") if side == "both" else (side,):
                _turn(quats, name, np.deg2rad(degrees) * level[:, None], clip)
        moved = replace(clip, local_rotations=quats)
        if collision.hand_depths(moved).max() <= least:
            return moved
    return replace(clip, notes=(*clip.notes, "the shoulders stay: the hands are in their way"))


def _turn(quats: FloatArray, side: str, angles: FloatArray, clip: Clip) -> None:
    """Turn a collar bone up and forward by angles (T, 2) in local rotations (T, J, 4), in place."""
    joints = [JOINTS[side + name] for name in _CHAIN]
    arm, fore, hand = (clip.skeleton.offsets[joint] for joint in joints[1:])
    collar, *below = (quats[:, joint] for joint in joints)
    upper_quats = rotation.multiply(collar, below[0])
    fore_quats = rotation.multiply(upper_quats, below[1])
    hand_quats = rotation.multiply(fore_quats, below[2])
    upper, lower = rotation.rotate(upper_quats, fore), rotation.rotate(fore_quats, hand)
    before, sign = rotation.rotate(collar, arm), 1.0 if side == "Left" else -1.0
    turn = rotation.exp(np.stack([0.0 * angles[:, 0], -sign * angles[:, 1], sign * angles[:, 0]], axis=-1))
    collar = rotation.multiply(turn, collar)
    line = before + upper + lower - rotation.rotate(collar, arm)  # from the shoulder to the wrist, as that stays
    a, b = np.linalg.norm(fore), np.linalg.norm(hand)
    distance = np.linalg.norm(line, axis=-1, keepdims=True)
    along = line / distance
    distance = np.minimum(distance, _REACH * (a + b))
    out = upper - np.sum(upper * along, axis=-1, keepdims=True) * along
    out = out / np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-9)
    part = (a**2 - b**2 + distance**2) / (2.0 * distance)
    elbow = part * along + np.sqrt(np.maximum(a**2 - part**2, 0.0)) * out
    upper_quats = rotation.multiply(rotation.between_vectors(upper, elbow), upper_quats)
    fore_quats = rotation.multiply(rotation.between_vectors(lower, distance * along - elbow), fore_quats)
    chain = [collar, upper_quats, fore_quats, hand_quats]
    quats[:, joints[0]] = collar
    for joint, parent, own in zip(joints[1:], chain, chain[1:], strict=False):
        quats[:, joint] = rotation.multiply(rotation.inverse(parent), own)
