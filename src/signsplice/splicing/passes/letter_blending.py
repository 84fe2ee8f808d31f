"""Letters that run into one another: fingers that play no part in a letter already move to the next, or are still on
their way from the one before.

In spelling, the fingers that a letter does not select give way to its neighbours, those that it selects do not (Keane
2014; forward and backward influences of letters on one another: Jerde, Soechting and Flanders 2003). So a finger that
is free in a letter leaves it while the letter is still held, and one that is free in the next arrives after that is
held already: by minimum jerk from its pose in the one to its pose in the other. Selected fingers, the thumb and the
hand keep the frames of the recordings. The thumb is never free: in the American alphabet it tells letters apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip, unchecked_copy
from signsplice.motion.curves import minimum_jerk_by_powers
from signsplice.rig.arms import arms
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, finger_roles
from signsplice.splicing.gap import gap_at
from signsplice.splicing.passes.fingerspelling import LEAST_HOLD_S, letter, spelling_side
from signsplice.splicing.passes.free_hand import ArmStretch, SeamFrames

FREE = {
    **dict.fromkeys("GLQTXZ", ("Middle", "Ring", "Little")),
    **dict.fromkeys("IJY", ("Index", "Middle", "Ring")),
    **dict.fromkeys("DHKNPRUV", ("Ring", "Little")),
    **dict.fromkeys("MW", ("Little",)),
    "F": ("Middle", "Ring", "Little"),
}
"""Fingers that letters of the American manual alphabet do not select (Keane 2014); A, B, C, E, O and S select all."""
EARLY_S = 0.07
"""How long a free finger moves while its letter is held, at most."""
_LEAST_RAD = 0.15
"""Turn of a joint from which a finger has a way to go."""


@dataclass(frozen=True, eq=False)
class MovingFinger:
    """A finger that is on its way while its letter is held.

    stretch: its joints, and frames of the word's clip.
    rotations: of those joints there, (n, K, 4).
    """

    stretch: ArmStretch
    rotations: FloatArray


@dataclass(frozen=True, eq=False)
class BlendedSeam:
    """A seam of two letters whose free fingers have more time.

    seam: the seam; its transition and its gap show the fingers so, its words' clips do not.
    before, after: fingers that move in the letters.
    """

    seam: SeamFrames
    before: tuple[MovingFinger, ...] = ()
    after: tuple[MovingFinger, ...] = ()


def with_fingers(clip: Clip, fingers: Sequence[MovingFinger]) -> Clip:
    """A word's clip with its fingers on their way; itself without any."""
    if not fingers:
        return clip
    local = np.array(clip.local_rotations)
    for finger in fingers:
        stretch = finger.stretch
        local[stretch.start : stretch.stop, list(stretch.joints)] = finger.rotations
    return unchecked_copy(clip, local_rotations=local)


def blend(seam: SeamFrames, speed: float = 1.0) -> BlendedSeam:
    """The seam of two letters of one word with their free fingers on the way for longer: from ``EARLY_S`` before the
    first is left, to as long after the second is entered. As it was where no free finger has a way to go, where a name
    is no letter of the American alphabet, or where both hands are raised.

    speed: how many times as fast the letters play.
    """
    cut, before, after = seam.cut, seam.before, seam.after
    which = spelling_side(arms(before), cut.pre, arms(after), cut.post)
    if which is None:
        return BlendedSeam(seam)
    n_new, fps = len(seam.filled.clip), before.fps / speed
    most = min(round(EARLY_S * fps), math.ceil(LEAST_HOLD_S * fps - 1e-6) // 2)
    early, late = min(most, (cut.pre - seam.entry) // 2), min(most, len(after) - 1 - cut.post)
    local = np.array(seam.filled.clip.local_rotations)
    leaving, entering = [], []
    for name in FINGERS[1:]:
        # First and last frame of the way, counted from the last one kept.
        first = -early if name in FREE.get(letter(before), ()) else 0
        last = n_new + 1 + (late if name in FREE.get(letter(after), ()) else 0)
        joints = _joints(before, ("left", "right")[which], name)
        start = before.local_rotations[cut.pre + first, joints]
        end = after.local_rotations[cut.post + last - n_new - 1, joints]
        if last - first == n_new + 1 or rotation.angle_between(start, end).max(initial=0.0) < _LEAST_RAD:
            continue
        u = np.arange(1, last - first) / (last - first)
        way = rotation.slerp(start[None], end[None], minimum_jerk_by_powers(u)[:, None])  # (n, K, 4)
        left, new, entered = np.split(way, [-first, n_new - first])
        local[:, joints] = new
        if len(left):
            leaving.append(_moving(joints, cut.pre + 1 - len(left), left))
        if len(entered):
            entering.append(_moving(joints, cut.post, entered))
    if not (leaving or entering):
        return BlendedSeam(seam)
    filled = replace(seam.filled, clip=unchecked_copy(seam.filled.clip, local_rotations=local))
    gap = gap_at(with_fingers(before, leaving), with_fingers(after, entering), cut, n_new, seam.entry)
    return BlendedSeam(replace(seam, filled=filled, gap=gap), tuple(leaving), tuple(entering))


def _moving(joints: list[int], start: int, rotations: FloatArray) -> MovingFinger:
    return MovingFinger(ArmStretch(tuple(joints), start, start + len(rotations)), rotations)


def _joints(clip: Clip, side: str, finger: str) -> list[int]:
    """The joints that a rig has of a finger."""
    known = rig_info(clip.skeleton).roles.joints
    return [known[side + role] for role in finger_roles(finger) if side + role in known]
