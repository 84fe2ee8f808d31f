"""Letters of one spelled word: what is kept of each, how long the hand takes to the next, and what changes on the way.

Cutters and durations are made for signs, whose hands travel: between letters the fingers change and the hand stays.

**Tempo.** People spell 2 to 6 letters a second (Reed, Delhorne, Durlach and Fischer 1990); 4 is called fluent (Wolfe et
al. 2004), and viewers of avatars prefer slower than human (Al-khazraji et al. 2021). The times below give 3.0 on the
average of twenty words (1.9 to 3.8).

**Doubled letters** that look the same are told apart. A slide to the strong side by about two inches, relaxing and
forming the letter again, and a bounce of less than half an inch are all in use in American Sign Language (Vicars,
lifeprint.com). Open letters slide here. Those in which fingers and thumb touch (A, E, M, N, O, S, T) are formed again,
as is taught, and so is what is no letter of this alphabet. A slide moves the arm of the second letter; the hand goes
back on the way to the next.

**Free fingers.** The fingers that a letter does not select give way to its neighbours, those that it selects do not
(Keane 2014; forward and backward influences of letters on one another: Jerde, Soechting and Flanders 2003). So a finger
that is free in a letter leaves it while the letter is still held, and one that is free in the next arrives after that
is held already: by minimum jerk from its pose in the one to its pose in the other. Selected fingers, the thumb and the
hand keep the frames of the recordings. The thumb is never free: in the American alphabet it tells letters apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from signsplice.body.arm_ik import move_wrists
from signsplice.errors import InputError
from signsplice.lexicon.gloss import LETTER_MARK
from signsplice.motion import Clip, FloatArray, copy_unchecked, rotation
from signsplice.rig.info import Arms, active_span, arms, hands_in_trunk_axes, rig_info
from signsplice.rig.roles import FINGERS, finger_roles
from signsplice.splicing.contracts import Cut
from signsplice.splicing.passes import AvoidCollisions, Pass, Refill
from signsplice.splicing.seam import LETTERS, REFORMED, SLID, Seam, SeamKind
from signsplice.splicing.word import Edit, edit_of

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


def last_letter_hold_end(clip: Clip, entry: int, speed: float = 1.0) -> int:
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
    steps = np.linalg.norm(np.diff(hands_in_trunk_axes(own)[0][:, spelling], axis=0), axis=-1).max(axis=1) * own.metres
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


ROTATION_RAD_S = 11.0
"""Mean speed of the joint of hand or fingers that turns farthest, 630 degrees a second."""
TRAVEL_M_S = 0.6
"""Mean speed of the wrist from one letter to the next."""
LEAST_TRANSITION_S = 0.1
DOUBLED_S = 0.2
"""Time from a letter to the same letter again."""
_SAME_RAD, _SAME_M = 0.25, 0.03
"""Largest rotation of a joint, and travel of a wrist, between two letters that look the same."""
SLIDE_M = 0.045
"""How far a doubled letter slides to the side."""
SLID_LETTERS = frozenset("BCDFGHIKLPQRUVWXY123456789")
"""Letters and digits of the American manual alphabet that slide when they are doubled (``SlideLetters``)."""


@dataclass(frozen=True)
class LetterCut:
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


def cut_letters(before: Clip, after: Clip, entry: int, transition_s: float, speed: float = 1.0) -> LetterCut | None:
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
    first, second = still_frames(before, p, speed), still_frames(after, q, speed)
    if not (len(first) and len(second)):
        return None
    held = max(transition_s, LEAST_HOLD_S / speed) if transition_s else END_HOLD_S / speed
    pre = min(max(last_held_frame(first, entry, held, before.fps), entry), len(before) - 1)
    post = int(second[0])
    angle, travel = _rotation_and_travel(before, p, pre, after, q, post)
    is_doubled = angle < _SAME_RAD and travel < _SAME_M
    needed = DOUBLED_S if is_doubled else max(angle / ROTATION_RAD_S, travel / TRAVEL_M_S, LEAST_TRANSITION_S)
    can_hold = (last_held_frame(second, post, np.inf, after.fps) - post) / after.fps
    warnings: tuple[str, ...] = ()
    if can_hold < LEAST_TRANSITION_S / speed:
        warnings = (f"{after.name} is still for {can_hold:.2f} s only, less than the way to it takes",)
    slides = (
        is_doubled and letter(before) == letter(after) in SLID_LETTERS and spelling_side(p, pre, q, post) is not None
    )
    seconds = max(min(needed / speed, can_hold), LEAST_TRANSITION_S / speed)
    return LetterCut(Cut(pre, post), seconds, is_doubled, slides, warnings)


def _rotation_and_travel(before: Clip, p: Arms, pre: int, after: Clip, q: Arms, post: int) -> tuple[float, float]:
    """The largest rotation of a joint of spelling hands, radians, and the travel of a wrist, m, between two frames."""
    spelling = spelling_sides(np.array([p.lift[pre], q.lift[post]]))
    joints = hand_joints(before, spelling)
    angles = rotation.angle_between(before.local_rotations[pre, joints], after.local_rotations[post, joints])
    (start, start_axes), (end, end_axes) = (
        [seen[frame, spelling] for seen in hands_in_trunk_axes(own)] for own, frame in ((p, pre), (q, post))
    )
    cosine = np.einsum("hab,hab->h", start_axes, end_axes)
    hands = np.arccos(np.clip(0.5 * (cosine - 1.0), -1.0, 1.0))
    travel = np.linalg.norm(end - start, axis=-1) * p.metres
    return float(max(angles.max(initial=0.0), hands.max())), float(travel.max())


_BOUNCE_M = 0.0127
_RELAXED = 0.65
"""How far the fingers go towards their pose at rest before they form a letter again."""


@dataclass(frozen=True)
class SlideLetters(Pass):
    """Doubled letters that slide to the side; the frames to them, and from them to what follows, are made anew."""

    refill: Refill
    kinds: ClassVar[frozenset[SeamKind]] = frozenset({SLID})
    follows_edits: ClassVar[bool] = True

    def change(self, seam: Seam) -> Seam:
        """The seam with the second letter slid, where it is one that slides."""
        if seam.kind == SLID:
            edit = slide(seam.after_clip, seam.retimed_cut.post, seam.after.slide_m)
            seam = replace(seam, entering=(*seam.entering, edit))
        return self.refill.fresh(seam)


@dataclass(frozen=True)
class ReformLetters(Pass):
    """Doubled letters that are formed again: the hand relaxes between them and bounces a little."""

    kinds: ClassVar[frozenset[SeamKind]] = frozenset({REFORMED})

    def change(self, seam: Seam) -> Seam:
        """The seam with other new frames, led around the body where they were before."""
        new = reform_letter(seam.new_frames, seam.before.clip)
        seam = replace(seam, frames=new, peak_m_s=None)
        return seam if seam.depth is None else AvoidCollisions().change(seam)


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
class MoveFingers(Pass):
    """Free fingers of two letters have more time to move: from ``EARLY_S`` before the first letter is left, to as
    long after the second is entered.

    sign_speed: how many times as fast the letters play.
    """

    sign_speed: float = 1.0
    kinds: ClassVar[frozenset[SeamKind]] = frozenset({LETTERS})

    def change(self, seam: Seam) -> Seam:
        """The seam with its free fingers moved in the new frames and, by edits, in both letters; the seam itself where
        no free finger has to move, where a name is no letter of the American alphabet, or where both hands are
        raised.
        """
        cut, before, after = seam.retimed_cut, seam.before_clip, seam.after_clip
        side = spelling_side(arms(before), cut.pre, arms(after), cut.post)
        if side is None:
            return seam
        new = np.array(seam.new_frames.local_rotations)  # (n, J, 4)
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
        frames = copy_unchecked(seam.new_frames, local_rotations=new)
        moved = replace(seam, frames=frames, leaving=(*seam.leaving, *leaving), entering=(*seam.entering, *entering))
        return moved.with_gap(len(new))

    def _path(self, seam: Seam, finger: str, joints: list[int]) -> tuple[int, FloatArray]:
        """How many frames of the first letter a finger moves in, and its rotations (n, K, 4) there, in the new
        frames and in the second letter; none at all where it does not have to move, or is free in neither.
        """
        cut, before, after = seam.retimed_cut, seam.before_clip, seam.after_clip
        fps, n_new = before.fps / self.sign_speed, len(seam.new_frames)
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
