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
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from signsplice.motion import Clip, FloatArray, rotation, unchecked_copy
from signsplice.rig.info import arms, rig_info
from signsplice.rig.roles import FINGERS, finger_roles
from signsplice.splicing.joins.held_letters import LEAST_HOLD_S, letter, spelling_side
from signsplice.splicing.joins.join import LETTERS, PlannedSeam, SeamKind
from signsplice.splicing.passes.seam_pass import SeamPass
from signsplice.splicing.words.word import Edit

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
"""Rotation of a joint from which a finger has to move."""


@dataclass(frozen=True)
class MoveFingers(SeamPass):
    """Free fingers of two letters have more time to move: from ``EARLY_S`` before the first letter is left, to as
    long after the second is entered.

    sign_speed: how many times as fast the letters play.
    """

    sign_speed: float = 1.0
    kinds: ClassVar[frozenset[SeamKind]] = frozenset({LETTERS})

    def change(self, seam: PlannedSeam) -> PlannedSeam:
        """The seam with its free fingers moved in the new frames and, by edits, in both letters; the seam itself where
        no free finger has to move, where a name is no letter of the American alphabet, or where both hands are
        raised.
        """
        cut, before, after = seam.retimed_cut, seam.before_clip, seam.after_clip
        side = spelling_side(arms(before), cut.pre, arms(after), cut.post)
        if side is None:
            return seam
        new = np.array(seam.made.clip.local_rotations)  # (n, J, 4)
        leaving, entering = list[Edit](), list[Edit]()
        for name in FINGERS[1:]:
            joints = _joints(before, ("left", "right")[side], name)
            early, path = self._path(seam, name, joints)
            left, between, entered = np.split(path, [early, early + len(new)])
            if len(left) or len(entered):
                new[:, joints] = between
            if len(left):
                leaving.append(Edit(tuple(joints), cut.pre + 1 - len(left), left))
            if len(entered):
                entering.append(Edit(tuple(joints), cut.post, entered))
        if not (leaving or entering):
            return seam
        filled = replace(seam.made, clip=unchecked_copy(seam.made.clip, local_rotations=new))
        moved = replace(seam, filled=filled, leaving=(*seam.leaving, *leaving), entering=(*seam.entering, *entering))
        return moved.with_gap(len(new))

    def _path(self, seam: PlannedSeam, finger: str, joints: list[int]) -> tuple[int, FloatArray]:
        """How many frames of the first letter a finger moves in, and its rotations (n, K, 4) there, in the new
        frames and in the second letter; none at all where it does not have to move, or is free in neither.
        """
        cut, before, after = seam.retimed_cut, seam.before_clip, seam.after_clip
        fps, n_new = before.fps / self.sign_speed, len(seam.made.clip)
        most = min(round(EARLY_S * fps), math.ceil(LEAST_HOLD_S * fps - 1e-6) // 2)
        early = late = 0
        if finger in FREE.get(letter(before), ()):
            early = min(most, (cut.pre - seam.before.first_frame) // 2)
        if finger in FREE.get(letter(after), ()):
            late = min(most, len(after) - 1 - cut.post)
        start = before.local_rotations[cut.pre - early, joints]
        end = after.local_rotations[cut.post + late, joints]
        if not (early or late) or rotation.angle_between(start, end).max(initial=0.0) < _LEAST_RAD:
            return 0, np.empty((0, len(joints), 4))
        n_steps = early + n_new + 1 + late
        u = np.arange(1, n_steps) / n_steps
        # As ``curves.minimum_jerk``, in the order of products that gave every letter so far its last bit.
        step = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        path = rotation.slerp(start[None], end[None], step[:, None])
        return early, path


def _joints(clip: Clip, side: str, finger: str) -> list[int]:
    """The joints that a rig has of a finger."""
    known = rig_info(clip.skeleton).roles.joints
    return [known[side + role] for role in finger_roles(finger) if side + role in known]
