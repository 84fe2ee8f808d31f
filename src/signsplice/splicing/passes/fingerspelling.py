"""Letters of one spelled word: what is kept of each, how long the way to the next takes, what tells doubled ones apart.

Cutters and durations are made for signs, whose hands travel: between letters the fingers change and the hand stays.

**Tempo.** People spell 2 to 6 letters a second (Reed, Delhorne, Durlach and Fischer 1990); 4 is called fluent (Wolfe et
al. 2004), and viewers of avatars prefer slower than human (Al-khazraji et al. 2021). The times below give 3.0 on the
average of twenty words (1.9 to 3.8).

**Doubled letters.** A slide to the strong side by about two inches, relaxing and forming the letter again, and a bounce
of less than half an inch are all in use in American Sign Language (Vicars, lifeprint.com). Open letters slide here.
Those in which fingers and thumb touch (A, E, M, N, O, S, T) are formed anew, as is taught, and so is what is no letter
of this alphabet. A slide moves the arm of the second letter; the hand goes back on the way to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body.arm_ik import move_wrists
from signsplice.errors import InputError
from signsplice.lexicon.entry import LETTER_MARK, is_letter
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig.arms import Arms, active_span, arms, seen_from_trunk
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS
from signsplice.splicing.methods.cut import Cut
from signsplice.splicing.passes.free_hand import ArmStretch

TURN_RAD_S = 11.0
"""Mean speed of the joint of hand or fingers that turns farthest, 630 degrees a second."""
TRAVEL_M_S = 0.6
"""Mean speed of the wrist on its way to the next letter."""
LEAST_WAY_S = 0.1
DOUBLED_S = 0.2
"""Time from a letter to the same letter again."""
LEAST_HOLD_S, END_HOLD_S = 0.13, 0.25
"""Least time for which a letter is held, and for which the first and the last are: signers stress them (Lapiak,
handspeak.com)."""
_STILL_M_S, _STILL_RAD_S = 0.15, 1.5
"""Speeds of wrists and of finger joints below which a hand holds its letter."""
_SAME_RAD, _SAME_M = 0.25, 0.03
"""Largest turn of a joint, and travel of a wrist, between two letters that look the same."""
_BOUNCE_M = 0.0127
_RELAXED = 0.65
"""How far the fingers go towards their pose at rest before they form a letter anew."""
SLIDE_M = 0.045
"""How far a doubled letter slides to the side."""
SLID = frozenset("BCDFGHIKLPQRUVWXY123456789")
"""Letters and digits of the American manual alphabet that slide when they are doubled."""
_RAISED = 0.4
"""Lift of the other hand (``Arms.lift``) from which a letter is two-handed, of another alphabet."""


@dataclass(frozen=True)
class LetterSeam:
    """The seam of two letters of one word.

    cut: last frame kept of the first, first frame kept of the second.
    seconds: from the one to the other.
    is_doubled: whether the hand would stand still between them.
    slides: whether the second one is told apart by a slide to the side.
    warnings: what a user should know, one line each.
    """

    cut: Cut
    seconds: float
    is_doubled: bool
    slides: bool = False
    warnings: tuple[str, ...] = ()


def are_letters(before: Clip, after: Clip) -> bool:
    """Whether two clips are letters by their names (fs-A), in any case."""
    return is_letter(before.name) and is_letter(after.name)


def letter_seam(before: Clip, after: Clip, entry: int, transition_s: float, speed: float = 1.0) -> LetterSeam | None:
    """The seam of two aligned letters, the first of which was entered at frame ``entry`` after ``transition_s`` seconds
    (0 where it begins the word); None where the arms are not known or a hand is never still.

    A letter that is still is kept as long as the way to it took, at least ``LEAST_HOLD_S``; one with a movement (J, Z)
    is kept whole. The way takes as long as the fingers and the hand need for it, but no longer than both letters can be
    held. ``speed``: how many times as fast both play; all times are shorter by it.
    """
    try:
        p, q = arms(before), arms(after)
    except InputError:
        return None
    first, second = _still_frames(before, p, speed), _still_frames(after, q, speed)
    if not (len(first) and len(second)):
        return None
    held = max(transition_s, LEAST_HOLD_S / speed) if transition_s else END_HOLD_S / speed
    pre = min(max(_held_until(first, entry, held, before.fps), entry), len(before) - 1)
    post = int(second[0])
    turn, travel = _turn_and_travel(before, p, pre, after, q, post)
    is_doubled = turn < _SAME_RAD and travel < _SAME_M
    needed = DOUBLED_S if is_doubled else max(turn / TURN_RAD_S, travel / TRAVEL_M_S, LEAST_WAY_S)
    can_hold = (_held_until(second, post, np.inf, after.fps) - post) / after.fps
    warnings: tuple[str, ...] = ()
    if can_hold < LEAST_WAY_S / speed:
        warnings = (f"{after.name} is still for {can_hold:.2f} s only, less than the way to it takes",)
    slides = is_doubled and letter(before) == letter(after) in SLID and spelling_side(p, pre, q, post) is not None
    seconds = max(min(needed / speed, can_hold), LEAST_WAY_S / speed)
    return LetterSeam(Cut(pre, post), seconds, is_doubled, slides, warnings)


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


def slid(clip: Clip, post: int, metres: float) -> tuple[Clip, ArmStretch]:
    """A letter whose hand is ``metres`` further to its side from frame ``post`` on, less where it rises and sinks, and
    the joints and frames that are changed so.
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
    return move_wrists(clip, moves), ArmStretch(tuple(int(joint) for joint in joints), post, len(clip))


def held_until(clip: Clip, entry: int, speed: float = 1.0) -> int:
    """The frame up to which the last letter of a word is kept at least; ``entry`` where that is not known."""
    try:
        still = _still_frames(clip, arms(clip), speed)
    except InputError:
        return entry
    return _held_until(still, entry, END_HOLD_S / speed, clip.fps) if len(still) else entry


def _held_until(still: NDArray[np.intp], entry: int, seconds: float, fps: float) -> int:
    """The last frame of a letter that is held for ``seconds`` from ``entry`` on, or to the end of a movement."""
    begin, end = max(entry, int(still[0])), int(still[-1])
    if len(still) <= end - int(still[0]):  # it moves in between
        return end
    return min(begin + int(np.ceil(min(seconds, end / fps) * fps - 1e-6)), end)


def formed_anew(new: Clip, before: Clip) -> Clip:
    """The frames between two letters that look the same, with the fingers that spell led towards their pose at rest,
    the first frame of ``before``, and the hand a little back and up; both fade out at the ends.
    """
    spelling = arms(new)
    side = int(np.argmax(spelling.lift.mean(axis=0)))
    bump = np.sin(np.pi * np.arange(1, len(new) + 1) / (len(new) + 1)) ** 2  # (T,)
    left = spelling.shoulders[:, 0] - spelling.shoulders[:, 1]
    back = -np.cross(left, spelling.up)
    way = spelling.up + back / np.linalg.norm(back, axis=-1, keepdims=True)
    moves = np.zeros((len(new), 2, 3))
    moves[:, side] = bump[:, None] * way * (_BOUNCE_M / spelling.metres / np.sqrt(2.0))
    moved = move_wrists(new, moves)
    if active_span(arms(before))[0] == 0:  # no rest is known
        return moved
    joints = _hand_joints(new, [side])[1:]
    local = np.array(moved.local_rotations)
    rest = np.broadcast_to(before.local_rotations[0, joints], local[:, joints].shape)
    local[:, joints] = rotation.slerp(local[:, joints], rest, _RELAXED * bump[:, None])
    return replace(moved, local_rotations=local)


def _still_frames(clip: Clip, own: Arms, speed: float) -> NDArray[np.intp]:
    """The frames away from rest in which neither the wrist of a raised hand, seen from the trunk, nor its fingers
    move: in both steps beside them. Where steps are so long that a hold may have but one, and none has two, in either.
    """
    start, stop = active_span(own)
    spelling = _spelling(own.lift[start:stop])
    joints = _hand_joints(clip, spelling)
    turns = rotation.angle_between(clip.local_rotations[1:, joints], clip.local_rotations[:-1, joints]).max(
        axis=1, initial=0.0
    )
    steps = np.linalg.norm(np.diff(seen_from_trunk(own)[0][:, spelling], axis=0), axis=-1).max(axis=1) * own.metres
    rate = clip.fps / speed  # of frames in the time of the recording
    moves = (turns * rate > _STILL_RAD_S) | (steps * rate > _STILL_M_S)  # (T - 1,)
    still = ~(np.append(moves, False) | np.append(False, moves))
    if not still[start:stop].any() and 2.0 / rate > LEAST_HOLD_S:
        still = ~(np.append(moves, True) & np.append(True, moves))
    return np.flatnonzero(still[start:stop]) + start


def _spelling(lifts: FloatArray) -> list[int]:
    """The sides, 0 left or 1 right, of the hands with lifts (T, 2) that spell: those that are raised, at least the
    higher one. The other hangs, and goes with the body.
    """
    highest = lifts.max(axis=0)
    return np.flatnonzero(highest >= min(_RAISED, float(highest.max()))).tolist()


def _turn_and_travel(before: Clip, p: Arms, pre: int, after: Clip, q: Arms, post: int) -> tuple[float, float]:
    """The farthest turn of a joint of spelling hands and their fingers, radians, and travel of a wrist, m, between two
    frames.
    """
    spelling = _spelling(np.array([p.lift[pre], q.lift[post]]))
    joints = _hand_joints(before, spelling)
    turns = rotation.angle_between(before.local_rotations[pre, joints], after.local_rotations[post, joints])
    (start, start_axes), (end, end_axes) = (
        [seen[frame, spelling] for seen in seen_from_trunk(own)] for own, frame in ((p, pre), (q, post))
    )
    cosine = np.einsum("hab,hab->h", start_axes, end_axes)
    hands = np.arccos(np.clip(0.5 * (cosine - 1.0), -1.0, 1.0))
    travel = np.linalg.norm(end - start, axis=-1) * p.metres
    return float(max(turns.max(initial=0.0), hands.max())), float(travel.max())


def _hand_joints(clip: Clip, sides: Sequence[int]) -> list[int]:
    """The joints of hands, 0 left or 1 right, and fingers that the rig has, each hand before its fingers."""
    names = tuple(("left", "right")[side] + part for side in sides for part in ("Hand", *FINGERS))
    joints = rig_info(clip.skeleton).roles.joints
    return [joint for role, joint in joints.items() if role.startswith(names)]
