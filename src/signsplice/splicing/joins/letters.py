"""The join of two letters of one spelled word: what is kept of each, and how long the hand takes to the next.

Cutters and durations are made for signs, whose hands travel: between letters the fingers change and the hand stays.

**Tempo.** People spell 2 to 6 letters a second (Reed, Delhorne, Durlach and Fischer 1990); 4 is called fluent (Wolfe et
al. 2004), and viewers of avatars prefer slower than human (Al-khazraji et al. 2021). The times below give 3.0 on the
average of twenty words (1.9 to 3.8).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, rotation
from signsplice.rig.info import Arms, arms, seen_from_trunk
from signsplice.splicing.gap import Cut
from signsplice.splicing.joins.held_letters import (
    END_HOLD_S,
    LEAST_HOLD_S,
    hand_joints,
    last_held_frame,
    letter,
    spelling_side,
    spelling_sides,
    still_frames,
)
from signsplice.splicing.joins.join import LETTERS, REFORMED, SLID, Join, PlannedSeam, planned
from signsplice.splicing.joins.signs import SignJoin
from signsplice.splicing.words.word import SentenceWord

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
"""Letters and digits of the American manual alphabet that slide when they are doubled (``passes.doubled_letters``)."""


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


@dataclass(frozen=True)
class LetterJoin(Join):
    """Plans seams of letters of one spelled word.

    signs: what joins letters in which no hand is ever still.
    has_own_duration: whether the call names a duration, which then decides how long the hand takes.
    """

    signs: SignJoin
    has_own_duration: bool = False

    def plan(self, before: SentenceWord, after: SentenceWord, chosen: Cut) -> PlannedSeam:
        """The seam of two letters; as that of two signs, with a warning, where no hand is still."""
        speed = self.signs.sign_speed
        found = letter_seam(before.clip, after.clip, before.entry, before.arrival_s, speed)
        if found is None:
            line = f"no still hand is found in {before.clip.name} and {after.clip.name}: they are cut as signs are"
            return self.signs.plan(before, after, chosen, (line,))
        cut = Cut(max(found.cut.pre, before.entry), found.cut.post)
        if self.signs.transition_time is not None or self.has_own_duration:
            n_frames, warnings = self.signs.n_frames(before.clip, after.clip, cut)
        else:
            n_frames, warnings = max(1, round(found.seconds * before.clip.fps) - 1), found.warnings
        kind = SLID if found.slides else REFORMED if found.is_doubled else LETTERS
        slide_m = before.slide_m + SLIDE_M if found.slides and n_frames else 0.0
        arrival_s = (n_frames + 1) / after.clip.fps
        return planned(kind, before, after, cut, n_frames, warnings, arrival_s, slide_m)


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
    return LetterSeam(Cut(pre, post), seconds, is_doubled, slides, warnings)


def _rotation_and_travel(before: Clip, p: Arms, pre: int, after: Clip, q: Arms, post: int) -> tuple[float, float]:
    """The largest rotation of a joint of spelling hands, radians, and the travel of a wrist, m, between two frames."""
    spelling = spelling_sides(np.array([p.lift[pre], q.lift[post]]))
    joints = hand_joints(before, spelling)
    angles = rotation.angle_between(before.local_rotations[pre, joints], after.local_rotations[post, joints])
    (start, start_axes), (end, end_axes) = (
        [seen[frame, spelling] for seen in seen_from_trunk(own)] for own, frame in ((p, pre), (q, post))
    )
    cosine = np.einsum("hab,hab->h", start_axes, end_axes)
    hands = np.arccos(np.clip(0.5 * (cosine - 1.0), -1.0, 1.0))
    travel = np.linalg.norm(end - start, axis=-1) * p.metres
    return float(max(angles.max(initial=0.0), hands.max())), float(travel.max())
