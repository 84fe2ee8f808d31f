"""What a letter's clip shows: the frames in which its hand is still, which hand spells, and until when it is held."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.lexicon.entry import LETTER_MARK
from signsplice.motion import Clip, FloatArray, rotation
from signsplice.rig.info import Arms, active_span, arms, rig_info, seen_from_trunk
from signsplice.rig.roles import FINGERS

LEAST_HOLD_S, END_HOLD_S = 0.13, 0.25
"""Least time for which a letter is held, and for which the first and the last are: signers stress them (Lapiak,
handspeak.com)."""
_STILL_M_S, _STILL_RAD_S = 0.15, 1.5
"""Speeds of wrists and of finger joints below which a hand holds its letter."""
_RAISED = 0.4
"""Lift of the other hand (``Arms.lift``) from which a letter is two-handed, of another alphabet."""


def letter(clip: Clip) -> str:
    """The letter that a clip is by its name, in upper case."""
    return clip.name[len(LETTER_MARK) :].upper()


def spelling_side(p: Arms, pre: int, q: Arms, post: int) -> int | None:
    """The side of the one hand that spells in a frame of each of two letters, 0 left or 1 right; None where it is not
    one hand, or both are raised.
    """
    lifts = np.array([p.lift[pre], q.lift[post]])
    sides = set(lifts.argmax(axis=1).tolist())
    return None if len(sides) > 1 or lifts.min(axis=1).max() > _RAISED else sides.pop()


def held_until(clip: Clip, entry: int, speed: float = 1.0) -> int:
    """The frame up to which the last letter of a word is kept at least; ``entry`` where that is not known."""
    try:
        still = still_frames(clip, arms(clip), speed)
    except InputError:
        return entry
    return last_held_frame(still, entry, END_HOLD_S / speed, clip.fps) if len(still) else entry


def last_held_frame(still: NDArray[np.intp], entry: int, seconds: float, fps: float) -> int:
    """The last frame of a letter that is held for ``seconds`` from ``entry`` on, or to the end of a movement."""
    begin, end = max(entry, int(still[0])), int(still[-1])
    if len(still) <= end - int(still[0]):  # it moves in between
        return end
    return min(begin + int(np.ceil(min(seconds, end / fps) * fps - 1e-6)), end)


def still_frames(clip: Clip, own: Arms, speed: float) -> NDArray[np.intp]:
    """The frames away from rest in which neither the wrist of a raised hand, seen from the trunk, nor its fingers
    move: in both steps beside them. Where steps are so long that a hold may have but one, and none has two, in either.
    """
    start, stop = active_span(own)
    spelling = spelling_sides(own.lift[start:stop])
    joints = hand_joints(clip, spelling)
    angles = rotation.angle_between(clip.local_rotations[1:, joints], clip.local_rotations[:-1, joints]).max(
        axis=1, initial=0.0
    )
    steps = np.linalg.norm(np.diff(seen_from_trunk(own)[0][:, spelling], axis=0), axis=-1).max(axis=1) * own.metres
    rate = clip.fps / speed  # of frames in the time of the recording
    moves = (angles * rate > _STILL_RAD_S) | (steps * rate > _STILL_M_S)  # (T - 1,)
    still = ~(np.append(moves, False) | np.append(False, moves))
    if not still[start:stop].any() and 2.0 / rate > LEAST_HOLD_S:
        still = ~(np.append(moves, True) & np.append(True, moves))
    return np.flatnonzero(still[start:stop]) + start


def spelling_sides(lifts: FloatArray) -> list[int]:
    """The sides, 0 left or 1 right, of the hands with lifts (T, 2) that spell: those that are raised, at least the
    higher one. The other hangs, and goes with the body.
    """
    highest = lifts.max(axis=0)
    return np.flatnonzero(highest >= min(_RAISED, float(highest.max()))).tolist()


def hand_joints(clip: Clip, sides: Sequence[int]) -> list[int]:
    """The joints of hands, 0 left or 1 right, and fingers that the rig has, each hand before its fingers."""
    names = tuple(("left", "right")[side] + part for side in sides for part in ("Hand", *FINGERS))
    joints = rig_info(clip.skeleton).roles.joints
    return [joint for role, joint in joints.items() if role.startswith(names)]
