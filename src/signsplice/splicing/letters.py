"""Letters of one spelled word: the frames kept of each, the time to the next letter, and the movement in between.

Cutters and durations are made for signs, in which hands travel; between letters fingers change and the hand stays.

**Tempo.** People spell 2 to 6 letters a second (Reed, Delhorne, Durlach and Fischer 1990); 4 is called fluent (Wolfe et
al. 2004), and viewers of avatars prefer slower than human (Al-khazraji et al. 2021). The times below give 3.0 on
average over twenty words (1.9 to 3.8).

**Doubled letters** that look the same are distinguished. American Sign Language uses a slide to the strong side by
about two inches, relaxing and forming the letter again, and a bounce of less than half an inch (Vicars, lifeprint.com).
Here ``SLID_LETTERS`` slide, and all letters of the German and the Dutch alphabet. Closed letters (A, E, M, N, O, S, T)
are formed again, as is taught, and so are letters of other alphabets. A slide moves the arm of the second letter; the
hand returns on the way to the next.

**Free fingers.** Fingers that a letter does not select adapt to its neighbours, selected fingers do not (Keane 2014;
forward and backward influences of letters on one another: Jerde, Soechting and Flanders 2003). So a finger that is free
in a letter leaves its pose while the letter is still held, and one that is free in the next letter arrives after that
letter has begun: by minimum jerk from one pose to the other. Selected fingers, the thumb and the hand keep the recorded
frames. The thumb is never free: in the American alphabet it distinguishes letters.
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
from signsplice.lexicon.gloss import letter_of
from signsplice.motion import Clip, FloatArray, copy_unchecked, rotation
from signsplice.rig.info import Arms, active_span, arms, hands_in_trunk_axes, rig_info
from signsplice.rig.roles import FINGERS, finger_roles
from signsplice.splicing.contracts import Cut
from signsplice.splicing.passes import AvoidCollisions, Pass, Refill
from signsplice.splicing.seam import LETTERS, REFORMED, SLID, Seam, SeamKind
from signsplice.splicing.word import Edit, edit_of


@dataclass(frozen=True)
class LetterTempo:
    """Times of letters and of the movements between them, at the playback speed of the recording."""

    least_hold_s: float = 0.13
    """Shortest hold of a letter, s."""
    least_end_hold_s: float = 0.25
    """Shortest hold of the first and last letter, s: signers stress them (Lapiak, handspeak.com)."""
    least_transition_s: float = 0.1
    """Shortest time from one letter to the next, s."""
    doubled_transition_s: float = 0.2
    """Time from a letter to the same letter again, s."""
    joint_speed_rad_s: float = 11.0
    """Mean speed of the joint of hand or fingers that turns farthest, radians a second (630 degrees a second)."""
    wrist_speed_m_s: float = 0.6
    """Mean speed of the wrist from one letter to the next, m/s."""
    early_finger_s: float = 0.07
    """Longest time that a free finger moves while its letter is held, s."""


@dataclass(frozen=True)
class LetterMovements:
    """Movements of hands and fingers at letters, and the sizes from which on they count."""

    still_wrist_m_s: float = 0.15
    """Speed of a wrist below which a hand holds its letter, m/s."""
    still_fingers_rad_s: float = 1.5
    """Speed of finger joints below which a hand holds its letter, radians a second."""
    raised_lift: float = 0.4
    """Lift of the other hand (``Arms.lift``) from which on a letter is two-handed, of another alphabet."""
    same_pose_rotation: float = 0.25
    """Largest rotation of a joint between two letters that look the same, radians."""
    same_pose_travel_m: float = 0.03
    """Largest travel of a wrist between two letters that look the same, m."""
    slide_m: float = 0.045
    """Distance that a doubled letter slides to the side, m."""
    bounce_m: float = 0.0127
    """Length of the bounce, back and up, of a letter that is formed again, m."""
    relaxation: float = 0.65
    """Fraction of the way to their rest pose that fingers move before they form a letter again."""
    least_finger_rotation: float = 0.15
    """Smallest joint rotation for which a finger is moved, radians."""


_TEMPO = LetterTempo()
MOVEMENTS = LetterMovements()


def letter(clip: Clip) -> str:
    """Returns the letter in a clip's name, in upper case."""
    return letter_of(clip.name)


def spelling_side(before: Arms, pre: int, after: Arms, post: int) -> int | None:
    """Returns the side of the hand that spells in frame ``pre`` of one letter and ``post`` of the next, 0 left or 1
    right; None if the hands differ or both are raised.
    """
    lifts = np.array([before.lift[pre], after.lift[post]])
    sides = set(lifts.argmax(axis=1).tolist())
    return None if len(sides) > 1 or lifts.min(axis=1).max() > MOVEMENTS.raised_lift else sides.pop()


def last_letter_hold_end(clip: Clip, entry: int, speed: float = 1.0) -> int:
    """Returns the frame up to which the last letter of a word must be kept; ``entry`` if that is unknown."""
    try:
        still = still_frames(clip, arms(clip), speed)
    except InputError:
        return entry
    return last_held_frame(still, entry, _TEMPO.least_end_hold_s / speed, clip.fps) if len(still) else entry


def last_held_frame(still: NDArray[np.intp], entry: int, seconds: float, fps: float) -> int:
    """Returns the last frame of a letter that is held for ``seconds`` from ``entry`` on; its last still frame if it
    has a movement. ``still``: the letter's still frames, in order.
    """
    begin, end = max(entry, int(still[0])), int(still[-1])
    if len(still) <= end - int(still[0]):  # it moves in between
        return end
    return min(begin + int(np.ceil(min(seconds, end / fps) * fps - 1e-6)), end)


def still_frames(clip: Clip, clip_arms: Arms, speed: float) -> NDArray[np.intp]:
    """Returns the frames away from rest in which neither the wrist of a raised hand, seen from the trunk, nor its
    fingers move. The steps to both neighbours of such a frame are still; or one of them, if no frame has two and frames
    are so far apart that a hold may span only one step.
    """
    start, stop = active_span(clip_arms)
    spelling = spelling_sides(clip_arms.lift[start:stop])
    joints = hand_joints(clip, spelling)
    angles = rotation.angle_between(clip.local_rotations[1:, joints], clip.local_rotations[:-1, joints]).max(
        axis=1, initial=0.0
    )
    wrists = hands_in_trunk_axes(clip_arms)[0][:, spelling]
    steps = np.linalg.norm(np.diff(wrists, axis=0), axis=-1).max(axis=1) * clip_arms.metres
    rate = clip.fps / speed  # of frames in the time of the recording
    moves = (angles * rate > MOVEMENTS.still_fingers_rad_s) | (steps * rate > MOVEMENTS.still_wrist_m_s)  # (T - 1,)
    still = ~(np.append(moves, False) | np.append(False, moves))
    if not still[start:stop].any() and 2.0 / rate > _TEMPO.least_hold_s:
        still = ~(np.append(moves, True) & np.append(True, moves))
    return np.flatnonzero(still[start:stop]) + start


def spelling_sides(lifts: FloatArray) -> list[int]:
    """Returns the sides, 0 left or 1 right, of the spelling hands from lifts (T, 2): the raised ones, at least the
    higher one. The other hand hangs and follows the body.
    """
    highest = lifts.max(axis=0)
    return np.flatnonzero(highest >= min(MOVEMENTS.raised_lift, float(highest.max()))).tolist()


def hand_joints(clip: Clip, sides: Sequence[int]) -> list[int]:
    """Returns the rig's joints of hands, 0 left or 1 right, and their fingers, each hand before its fingers."""
    names = tuple(("left", "right")[side] + part for side in sides for part in ("Hand", *FINGERS))
    joints = rig_info(clip.skeleton).roles.joints
    return [joint for role, joint in joints.items() if role.startswith(names)]


SLID_LETTERS = frozenset("BCDFGHIKLPQRUVWXY123456789")
"""Letters and digits of the American manual alphabet that slide when they are doubled (``SlideLetters``)."""
_ALL_SLIDE = ("@DSE", "@GSG")
"""Ends of the names of letters of alphabets in which all slide (``signer/words/alphabet-dse.signs``)."""


@dataclass(frozen=True)
class LetterCut:
    """The seam of two letters of one word.

    cut: last kept frame of the first letter, first kept frame of the second.
    seconds: time from one to the other.
    is_doubled: whether both look the same, so that the hand would stand still between them.
    slides: whether a slide to the side distinguishes the second letter.
    warnings: what a user should know, one line each.
    """

    cut: Cut
    seconds: float
    is_doubled: bool
    slides: bool = False
    warnings: tuple[str, ...] = ()


def cut_letters(before: Clip, after: Clip, entry: int, transition_s: float, speed: float = 1.0) -> LetterCut | None:
    """Returns the seam of two aligned letters, the first of which was entered at frame ``entry`` after ``transition_s``
    seconds (0 if it begins the word); None if the arms are unknown or a hand is never still.

    A still letter is held as long as the transition to it, at least the shortest hold; one with a movement (J, Z) is
    kept whole. The transition takes as long as the fingers and the hand need, but no longer than the second letter can
    be held, at least ``least_transition_s``. ``speed``: playback speed of both letters, by which the times of
    ``LetterTempo`` are divided.
    """
    try:
        before_arms, after_arms = arms(before), arms(after)
    except InputError:
        return None
    first, second = still_frames(before, before_arms, speed), still_frames(after, after_arms, speed)
    if not (len(first) and len(second)):
        return None
    hold_s = max(transition_s, _TEMPO.least_hold_s / speed) if transition_s else _TEMPO.least_end_hold_s / speed
    pre = min(max(last_held_frame(first, entry, hold_s, before.fps), entry), len(before) - 1)
    post = int(second[0])
    angle, travel = _rotation_and_travel(before, before_arms, pre, after, after_arms, post)
    is_doubled = angle < MOVEMENTS.same_pose_rotation and travel < MOVEMENTS.same_pose_travel_m
    needed = _TEMPO.doubled_transition_s
    if not is_doubled:
        needed = max(angle / _TEMPO.joint_speed_rad_s, travel / _TEMPO.wrist_speed_m_s, _TEMPO.least_transition_s)
    can_hold = (last_held_frame(second, post, np.inf, after.fps) - post) / after.fps
    warnings: tuple[str, ...] = ()
    if can_hold < _TEMPO.least_transition_s / speed:
        warnings = (f"{after.name} is still for {can_hold:.2f} s only, less than the way to it takes",)
    slides = (
        is_doubled
        and letter(before) == letter(after)
        and (letter(after) in SLID_LETTERS or after.name.upper().endswith(_ALL_SLIDE))
        and spelling_side(before_arms, pre, after_arms, post) is not None
    )
    seconds = max(min(needed / speed, can_hold), _TEMPO.least_transition_s / speed)
    return LetterCut(Cut(pre, post), seconds, is_doubled, slides, warnings)


def _rotation_and_travel(
    before: Clip, before_arms: Arms, pre: int, after: Clip, after_arms: Arms, post: int
) -> tuple[float, float]:
    """Returns the largest joint rotation of spelling hands, radians, and travel of a wrist, m, between two frames."""
    spelling = spelling_sides(np.array([before_arms.lift[pre], after_arms.lift[post]]))
    joints = hand_joints(before, spelling)
    angles = rotation.angle_between(before.local_rotations[pre, joints], after.local_rotations[post, joints])
    (start, start_axes), (end, end_axes) = (
        [seen[frame, spelling] for seen in hands_in_trunk_axes(motion)]
        for motion, frame in ((before_arms, pre), (after_arms, post))
    )
    cosine = np.einsum("hab,hab->h", start_axes, end_axes)
    hands = np.arccos(np.clip(0.5 * (cosine - 1.0), -1.0, 1.0))
    travel = np.linalg.norm(end - start, axis=-1) * before_arms.metres
    return float(max(angles.max(initial=0.0), hands.max())), float(travel.max())


@dataclass(frozen=True)
class SlideLetters(Pass):
    """Slides doubled letters to the side and remakes the frames before and after them."""

    refill: Refill
    kinds: ClassVar[frozenset[SeamKind]] = frozenset({SLID})
    follows_edits: ClassVar[bool] = True

    def change(self, seam: Seam) -> Seam:
        """Returns the seam with its second letter slid, if it is one that slides."""
        if seam.kind == SLID:
            edit = slide(seam.after_clip, seam.retimed_cut.post, seam.after.slide_m)
            seam = replace(seam, entering=(*seam.entering, edit))
        return self.refill.fresh(seam)


@dataclass(frozen=True)
class ReformLetters(Pass):
    """Forms doubled letters again: the hand relaxes between them and bounces a little."""

    kinds: ClassVar[frozenset[SeamKind]] = frozenset({REFORMED})

    def change(self, seam: Seam) -> Seam:
        """Returns the seam with other new frames, led around the body if they were before."""
        new = reform_letter(seam.new_frames, seam.before.clip)
        seam = replace(seam, frames=new)
        return seam if seam.depth is None else AvoidCollisions().change(seam)


def slide(clip: Clip, post: int, metres: float) -> Edit:
    """Returns the edit that moves a letter's hand ``metres`` to its side from frame ``post`` on, less while it rises or
    sinks.
    """
    motion = arms(clip)
    side = int(np.argmax(motion.lift[post]))
    outwards = motion.shoulders[:, side] - motion.shoulders[:, 1 - side]
    outwards = outwards / np.linalg.norm(outwards, axis=-1, keepdims=True)
    lift = motion.lift[:, side]
    level = np.clip((lift - lift.min()) / (lift[post] - lift.min()), 0.0, 1.0)
    moves = np.zeros((len(clip), 2, 3))
    moves[post:, side] = (level[:, None] * outwards * (metres / motion.metres))[post:]
    joints = rig_info(clip.skeleton).arm_joints[3 * side : 3 * side + 3]
    return edit_of(clip, move_wrists(clip, moves)[post:], post, [int(joint) for joint in joints])


def reform_letter(new: Clip, before: Clip) -> Clip:
    """Returns the frames between two letters that look the same, with the spelling fingers moved towards their rest
    pose, the first frame of ``before``, and the hand a little back and up; both fade out at the ends.
    """
    spelling = arms(new)
    side = int(np.argmax(spelling.lift.mean(axis=0)))
    bump = np.sin(np.pi * np.arange(1, len(new) + 1) / (len(new) + 1)) ** 2  # (T,)
    leftward = spelling.shoulders[:, 0] - spelling.shoulders[:, 1]
    back = -np.cross(leftward, spelling.up)
    direction = spelling.up + back / np.linalg.norm(back, axis=-1, keepdims=True)
    moves = np.zeros((len(new), 2, 3))
    moves[:, side] = bump[:, None] * direction * (MOVEMENTS.bounce_m / spelling.metres / np.sqrt(2.0))
    moved = move_wrists(new, moves)
    if active_span(arms(before))[0] == 0:  # no rest is known
        return moved
    joints = hand_joints(new, [side])[1:]
    local = np.array(moved.local_rotations)
    rest = np.broadcast_to(before.local_rotations[0, joints], local[:, joints].shape)
    local[:, joints] = rotation.slerp(local[:, joints], rest, MOVEMENTS.relaxation * bump[:, None])
    return replace(moved, local_rotations=local)


FREE_FINGERS = {
    **dict.fromkeys("GLQTXZ", ("Middle", "Ring", "Little")),
    **dict.fromkeys("IJY", ("Index", "Middle", "Ring")),
    **dict.fromkeys("DHKNPRUV", ("Ring", "Little")),
    **dict.fromkeys("MW", ("Little",)),
    "F": ("Middle", "Ring", "Little"),
}
"""Fingers that letters of the American manual alphabet do not select (Keane 2014); A, B, C, E, O and S select all."""


@dataclass(frozen=True)
class MoveFingers(Pass):
    """Gives free fingers of two letters more time to move: from ``early_finger_s`` of ``LetterTempo`` before the first
    letter is left to the same time after the second is entered.

    sign_speed: playback speed of the letters.
    """

    sign_speed: float = 1.0
    kinds: ClassVar[frozenset[SeamKind]] = frozenset({LETTERS})

    def change(self, seam: Seam) -> Seam:
        """Returns the seam with its free fingers moved in the new frames and, by edits, in both letters; unchanged if
        no free finger has to move, a name is not a letter of the American alphabet, or both hands are raised.
        """
        cut, before, after = seam.retimed_cut, seam.before_clip, seam.after_clip
        recorded = seam.before.recorded or before, seam.after.recorded or after  # an idle arm may be planned
        side = spelling_side(arms(recorded[0]), cut.pre, arms(recorded[1]), cut.post)
        if side is None:
            return seam
        new = np.array(seam.new_frames.local_rotations)  # (n, J, 4)
        leaving, entering = list[Edit](), list[Edit]()
        for name in FINGERS[1:]:
            joints = _finger_joints(before, ("left", "right")[side], name)
            n_early, path = self._path(seam, name, joints)
            leaving_path, new_path, entering_path = np.split(path, [n_early, n_early + len(new)])
            if len(leaving_path) or len(entering_path):
                new[:, joints] = new_path
            if len(leaving_path):
                leaving.append(Edit(tuple(joints), cut.pre + 1 - len(leaving_path), leaving_path))
            if len(entering_path):
                entering.append(Edit(tuple(joints), cut.post, entering_path))
        if not (leaving or entering):
            return seam
        frames = copy_unchecked(seam.new_frames, local_rotations=new)
        moved = replace(seam, frames=frames, leaving=(*seam.leaving, *leaving), entering=(*seam.entering, *entering))
        return moved.with_gap(len(new))

    def _path(self, seam: Seam, finger: str, joints: list[int]) -> tuple[int, FloatArray]:
        """Returns how many frames of the first letter a finger moves in, and its rotations (n, K, 4) there, in the new
        frames and in the second letter; none if it does not have to move or is free in neither letter.
        """
        cut, before, after = seam.retimed_cut, seam.before_clip, seam.after_clip
        fps, n_new = before.fps / self.sign_speed, len(seam.new_frames)
        limit = min(round(_TEMPO.early_finger_s * fps), math.ceil(_TEMPO.least_hold_s * fps - 1e-6) // 2)
        n_early = n_late = 0
        if finger in FREE_FINGERS.get(letter(before), ()):
            n_early = min(limit, (cut.pre - seam.before.first_frame) // 2)
        if finger in FREE_FINGERS.get(letter(after), ()):
            n_late = min(limit, len(after) - 1 - cut.post)
        start = before.local_rotations[cut.pre - n_early, joints]
        end = after.local_rotations[cut.post + n_late, joints]
        is_still = rotation.angle_between(start, end).max(initial=0.0) < MOVEMENTS.least_finger_rotation
        if is_still or not (n_early or n_late):
            return 0, np.empty((0, len(joints), 4))
        n_steps = n_early + n_new + 1 + n_late
        u = np.arange(1, n_steps) / n_steps
        # ``curves.minimum_jerk`` with another order of products, kept so that results stay equal bit for bit.
        step = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        path = rotation.slerp(start[None], end[None], step[:, None])
        return n_early, path


def _finger_joints(clip: Clip, side: str, finger: str) -> list[int]:
    """Returns a rig's joints of a finger."""
    known = rig_info(clip.skeleton).roles.joints
    return [known[side + role] for role in finger_roles(finger) if side + role in known]
