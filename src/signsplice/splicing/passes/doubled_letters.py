"""Doubled letters: two of one spelled word that look the same are told apart.

A slide to the strong side by about two inches, relaxing and forming the letter again, and a bounce of less than half an
inch are all in use in American Sign Language (Vicars, lifeprint.com). Open letters slide here. Those in which fingers
and thumb touch (A, E, M, N, O, S, T) are formed again, as is taught, and so is what is no letter of this alphabet. A
slide moves the arm of the second letter; the hand goes back on the way to the next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from signsplice.body.arm_ik import move_wrists
from signsplice.motion import Clip, rotation
from signsplice.rig.info import active_span, arms, rig_info
from signsplice.splicing.joins.held_letters import hand_joints
from signsplice.splicing.joins.join import REFORMED, SLID, PlannedSeam, SeamKind
from signsplice.splicing.passes.filling import Refill, led_around
from signsplice.splicing.passes.seam_pass import SeamPass
from signsplice.splicing.words.word import Edit, edit_of

_BOUNCE_M = 0.0127
_RELAXED = 0.65
"""How far the fingers go towards their pose at rest before they form a letter again."""


@dataclass(frozen=True)
class SlideLetters(SeamPass):
    """Doubled letters that slide to the side; the frames to them, and from them to what follows, are made anew."""

    refill: Refill
    kinds: ClassVar[frozenset[SeamKind]] = frozenset({SLID})
    follows_edits: ClassVar[bool] = True

    def change(self, seam: PlannedSeam) -> PlannedSeam:
        """The seam with the second letter slid, where it is one that slides."""
        if seam.kind == SLID:
            edit = slide(seam.after_clip, seam.retimed_cut.post, seam.after.slide_m)
            seam = replace(seam, entering=(*seam.entering, edit))
        return self.refill.fresh(seam)


@dataclass(frozen=True)
class ReformLetters(SeamPass):
    """Doubled letters that are formed again: the hand relaxes between them and bounces a little."""

    kinds: ClassVar[frozenset[SeamKind]] = frozenset({REFORMED})

    def change(self, seam: PlannedSeam) -> PlannedSeam:
        """The seam with other new frames, led around the body where they were before."""
        filled = replace(seam.made, clip=reform_letter(seam.made.clip, seam.before.clip), peak_m_s=None)
        return replace(seam, filled=filled if filled.depth is None else led_around(filled, seam.gap))


def slide(clip: Clip, post: int, metres: float) -> Edit:
    """The edit of a letter whose hand is ``metres`` farther to its side from frame ``post`` on, less where it rises and
    sinks.
    """
    own = arms(clip)
    side = int(np.argmax(own.lift[post]))
    outwards = own.shoulders[:, side] - own.shoulders[:, 1 - side]
    outwards = outwards / np.linalg.norm(outwards, axis=-1, keepdims=True)
    lift = own.lift[:, side]
    level = np.clip((lift - lift.min()) / (lift[post] - lift.min()), 0.0, 1.0)
    moves = np.zeros((len(clip), 2, 3))
    moves[post:, side] = (level[:, None] * outwards * (metres / own.metres))[post:]
    joints = rig_info(clip.skeleton).arm_joints[3 * side : 3 * side + 3]
    return edit_of(clip, move_wrists(clip, moves)[post:], post, [int(joint) for joint in joints])


def reform_letter(new: Clip, before: Clip) -> Clip:
    """The frames between two letters that look the same, with the fingers that spell led towards their pose at rest,
    the first frame of ``before``, and the hand a little back and up; both fade out at the ends.
    """
    spelling = arms(new)
    side = int(np.argmax(spelling.lift.mean(axis=0)))
    bump = np.sin(np.pi * np.arange(1, len(new) + 1) / (len(new) + 1)) ** 2  # (T,)
    left = spelling.shoulders[:, 0] - spelling.shoulders[:, 1]
    back = -np.cross(left, spelling.up)
    direction = spelling.up + back / np.linalg.norm(back, axis=-1, keepdims=True)
    moves = np.zeros((len(new), 2, 3))
    moves[:, side] = bump[:, None] * direction * (_BOUNCE_M / spelling.metres / np.sqrt(2.0))
    moved = move_wrists(new, moves)
    if active_span(arms(before))[0] == 0:  # no rest is known
        return moved
    joints = hand_joints(new, [side])[1:]
    local = np.array(moved.local_rotations)
    rest = np.broadcast_to(before.local_rotations[0, joints], local[:, joints].shape)
    local[:, joints] = rotation.slerp(local[:, joints], rest, _RELAXED * bump[:, None])
    return replace(moved, local_rotations=local)
