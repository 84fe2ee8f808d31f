"""A ground truth that can be read from motion: each word has one frame for each event, and the partner chooses the
event.

The truth of ``truth`` moves a cut continuously with distances and angles and then rounds it to a frame; such a frame
cannot be read if the value lies near the middle between two (docs/corpus.md). Here nothing is rounded. A word's events
are the ends of its holds, at which the strong hand visibly comes to rest or sets out, and the frame at which it rises
to the chest. Which of them is the cut follows from visible properties of the partner: one hand or two, high or low,
open or folded fingers, on the skin or off it. The length of the transition follows from how far the hands have to go.
Each of these lies beyond a margin from its threshold, or the word, or the pair, is left out.

The signer makes citation forms carefully (``make_careful``): each word holds its first and its last posture. In the
code ``p`` is the word before and ``q`` the word after.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.signer import planner, pose
from signsplice.signer.phonology import Path, Segment, Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import HANGING, STATURE_CM, Manner, Signer, skeleton, stream
from signsplice_workshop.corpora.touches import find_touching_sides, measure_skin_clearances

CAREFUL = Manner(low_elbows=1.0, head_to_hand=1.0, body_motion=1.0, undershoot=1.0)
"""The manner of careful citation forms. The other traits blur when a hand stops: they smooth motion in time, move stops
between frames, and give fingers and hands times of their own."""
FIRST_HOLD_S, LAST_HOLD_S = (0.17, 0.30), (0.20, 0.40)
"""Durations of the first and the last hold, drawn for each word."""

STILL_CM_S = 7.0
"""Mean speed of the wrist and of each finger's last joint, on the standard body, below which the hand is in a hold."""
STILL_MARGIN = 1.15
"""Factor by which each speed in a hold is lower, and each speed beside it higher, in words that are read with a margin.
"""
LEAST_HOLD = 3
"""Smallest number of steps from frame to frame in a hold."""
PLANNED = 2
"""Largest difference, in frames, between the end of a hold as it is seen and as the signer planned it."""
HANGING_MOST = 0.06
"""Height of the wrist, in statures from the middle of the body, up to which an arm hangs."""
LEVEL, LEVEL_MARGIN = 0.27, 0.006
"""Height of the wrist, in statures from the middle of the body, from which a posture is high: that of the chest, 8 cm
below the shoulder. A hand that rises from a low posture to a high one passes it, and never descends."""
RAISED_MARGIN = 0.002
"""Smallest distance of the wrist from ``LEVEL``, in statures, in the frames before and after it passes."""
OPEN, OPEN_MARGIN = 0.78, 0.015
"""Reach of index to little finger from the wrist, over their length along the bones, from which a hand is open. Few
handshapes are near it: flat and spread hands reach .98, fists .60, a pointing hand .72."""
WEAK_RAISED, WEAK_MARGIN = 0.09, 0.02
"""Height of the weak wrist, in statures, from which both hands sign."""
TOUCH_CM, CLEAR_CM = 0.5, 2.5
"""Skin distances up to which a last posture is on the skin, and from which it is off."""

TRAVEL, TRAVEL_MARGIN = (0.12, 0.28), 0.004
"""Distances, in statures, at which the length of a transition changes: the longer travel of both wrists."""
LENGTHS = (6, 9, 12)
"""Frames of a transition, at 30 fps, whose hands travel less than the first distance, less than the second, and more.
The travel law at usual tempo, with the pace of running signing, gives 5, 9 and 12 frames for 10, 34 and 60 cm."""
FPS = planner.FPS
FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")


@dataclass(frozen=True)
class Card:
    """All that the truth depends on in one word: frames of its events, and visible properties of its postures.

    raised: first frame with the strong wrist above ``LEVEL``; ``posture`` if the first posture is low
    posture: first frame of the first hold, where the preparation ends
    stroke: last frame of the first hold, from which the stroke sets out
    stroke_end: first frame of the last hold
    hold_end: last frame of the last hold, from which the retraction sets out
    two_first, two_last: whether both hands sign in the first and in the last posture
    high_first, high_last: whether the strong wrist is above ``LEVEL`` there
    open_first, open_last: whether the strong hand is open there
    touches_last: whether the last posture is on the skin
    """

    raised: int
    posture: int
    stroke: int
    stroke_end: int
    hold_end: int
    two_first: bool
    two_last: bool
    high_first: bool
    high_last: bool
    open_first: bool
    open_last: bool
    touches_last: bool


def find_leave_frame(p: Card, q: Card) -> int:
    """Returns the last kept frame of the word before: the end of its last hold, if the next sign needs another number
    of hands, or at the same height an open hand instead of a folded one or the reverse, which form meanwhile; else the
    end of its stroke.
    """
    handshape_changes = p.high_last == q.high_first and p.open_last != q.open_first
    return p.hold_end if p.two_last != q.two_first or handshape_changes else p.stroke_end


def find_enter_frame(p: Card, q: Card) -> int:
    """Returns the first kept frame of the word after: the frame where its hand is raised, if it rises from a low
    posture to a high one as in the preparation; else the first posture, if the hand comes off the skin; else the start
    of the stroke.
    """
    if q.high_first and not p.high_last:
        return q.raised
    return q.posture if p.touches_last else q.stroke


def count_transition_frames(start: FloatArray, end: FloatArray, signer: Signer) -> int | None:
    """Returns the number of new frames between two states (65,); None if a distance lies within the margin."""
    change = (pose.hands(end) - pose.hands(start))[:, pose.WRIST]
    distance = float(np.linalg.norm(change, axis=-1).max()) / signer.stature_cm
    if np.abs(np.array(TRAVEL) - distance).min() < TRAVEL_MARGIN:
        return None
    return LENGTHS[int(np.searchsorted(TRAVEL, distance))]


def make_careful(signer: Signer) -> Signer:
    """Returns the signer with the manner of careful citation forms and hanging arms."""
    return replace(signer, manner=CAREFUL, rest=HANGING)


def with_holds(sign: Sign) -> Sign:
    """Returns the sign with its first and its last posture held."""
    rng = stream("held", sign.gloss)
    segments = list(sign.segments)
    first_s, last_s = (float(rng.uniform(*seconds)) for seconds in (FIRST_HOLD_S, LAST_HOLD_S))
    if segments[-1].kind == "M":
        segments.append(Segment("H", segments[-1].strong, segments[-1].weak))
    segments[0] = replace(segments[0], kind="H", seconds=first_s)
    segments[-1] = replace(segments[-1], kind="H", seconds=last_s, path=Path())
    return replace(sign, segments=tuple(segments))


def make_word(
    sign: Sign, signer: Signer, take: int = 0, margin: float = STILL_MARGIN
) -> tuple[IsolatedWord, Card] | None:
    """Returns a sign as a careful signer makes it alone, its postures held, and its card; None if it cannot be read, or
    if holds are seen elsewhere than the signer planned them.
    """
    word = planner.synthesize_word(with_holds(sign), make_careful(signer), take)
    events = word.events
    card = None if events.first is None else extract_card(word.clip, word.signer, sign.hands, margin)
    if card is None or events.first is None:
        return None
    planned = (events.start, events.first[0], events.passes[-1][1], events.end)
    seen = (card.posture, card.stroke, card.stroke_end, card.hold_end)
    return (word, card) if max(abs(a - b) for a, b in zip(seen, planned, strict=True)) <= PLANNED else None


def make_word_from_plan(sign: Sign, signer: Signer, slack: int) -> tuple[IsolatedWord, Card] | None:
    """Returns a sign as a signer makes it alone in a manner of their own, and its card, with events where they were
    planned: continuous motion shows none of them to the frame. They lie ``slack`` frames outside the stroke, so that a
    cut that is off by as much takes nothing from it. Returns None if the sign has no movement.
    """
    word = planner.synthesize_word(sign, signer)
    events = word.events
    if events.first is None or not events.passes:
        return None
    posture, stroke = (max(frame - slack, 0) for frame in (events.start, events.first[0]))
    stroke_end, hold_end = (min(frame + slack, len(word) - 1) for frame in (events.passes[-1][1], events.end))
    planned = (posture, stroke, stroke_end, hold_end)
    card = extract_card(word.clip, word.signer, sign.hands, holds=planned)
    return None if card is None else (word, card)


def extract_card(
    clip: Clip, signer: Signer, hands: str, margin: float = 1.0, holds: tuple[int, int, int, int] | None = None
) -> Card | None:
    """Returns the card of a word, read from its motion alone; None if an event or a property cannot be seen.

    hands: how the sign's hands work together, which decides whose touches count (``find_touching_sides``)
    margin: factor by which speeds at the ends of holds differ from ``STILL_CM_S``; other margins apply if it is over 1
    holds: first and last frames of the first and the last hold, if they are known
    """
    joints = kinematics.forward(clip)[1] / signer.stature_cm - np.array([0.0, 0.5, 0.0])  # (T, J, 3), statures
    strong, weak, fingers = find_hand_joints(signer)
    holds = holds or find_holds(joints[:, strong], margin)
    if holds is None:
        return None
    ends, heights = [holds[0], holds[3]], joints[:, strong[0], 1]
    raised = int(np.argmax(heights >= LEVEL))
    high = heights[ends] - LEVEL
    openness = measure_finger_reach(joints[ends][:, fingers]) - OPEN
    weak_heights = joints[ends, weak[0], 1] - WEAK_RAISED
    gap_cm = float(measure_skin_clearances(clip, ends[1:], find_touching_sides(hands, signer))[0])
    is_clear = (
        np.abs(high).min() >= LEVEL_MARGIN,
        np.abs(openness).min() >= OPEN_MARGIN,
        np.abs(weak_heights).min() >= WEAK_MARGIN,
        not TOUCH_CM < gap_cm < CLEAR_CM,
        high[0] < 0.0
        or (2 <= raised <= holds[0] and np.abs(heights[raised - 1 : raised + 1] - LEVEL).min() >= RAISED_MARGIN),
    )
    if margin > 1.0 and not all(is_clear):
        return None
    raised = raised if high[0] > 0.0 else holds[0]
    (two_first, two_last), (high_first, high_last), (open_first, open_last) = (
        (row > 0.0).tolist() for row in (weak_heights, high, openness)
    )
    return Card(raised, *holds, two_first, two_last, high_first, high_last, open_first, open_last, gap_cm <= TOUCH_CM)


def measure_finger_reach(fingers: FloatArray) -> FloatArray:
    """Returns the distance (T,) from the wrist to the last joints of fingers (T, F, 4, 3), over the length along the
    bones, as a mean over fingers; each finger's joints begin with the wrist.
    """
    bones = np.linalg.norm(np.diff(fingers, axis=2), axis=-1).sum(axis=2)
    return np.asarray((np.linalg.norm(fingers[:, :, 3] - fingers[:, :, 0], axis=-1) / bones).mean(axis=1))


def find_holds(hand: FloatArray, margin: float = 1.0) -> tuple[int, int, int, int] | None:
    """Returns the first and last frame of the first and of the last hold of a hand (T, P, 3), in statures, the wrist
    first; None if it has no two holds, or a speed lies within the margin.

    A hold is at least ``LEAST_HOLD`` steps from frame to frame in which the points move at less than ``STILL_CM_S`` in
    the mean, above the height of a hanging hand.
    """
    speeds = np.linalg.norm(np.diff(hand, axis=0), axis=-1).mean(axis=1) * FPS * STATURE_CM  # (T - 1,), cm/s
    still = np.concatenate([[False], (speeds < STILL_CM_S) & (hand[:-1, 0, 1] > HANGING_MOST), [False]])
    spans = np.flatnonzero(np.diff(still.astype(int))).reshape(-1, 2)
    spans = spans[spans[:, 1] - spans[:, 0] >= LEAST_HOLD]
    if len(spans) < 2 or spans[0, 0] == 0:
        return None
    (posture, stroke), (stroke_end, hold_end) = spans[[0, -1]].tolist()
    hold_speed = max(speeds[posture:stroke].max(), speeds[stroke_end:hold_end].max())
    outside_speed = speeds[[posture - 1, stroke, stroke_end - 1, min(hold_end, len(speeds) - 1)]].min()
    if hold_speed * margin > STILL_CM_S or outside_speed < STILL_CM_S * margin:
        return None
    return posture, stroke, stroke_end, hold_end


def find_hand_joints(signer: Signer) -> tuple[list[int], list[int], list[list[int]]]:
    """Returns the joints of the strong hand, and of the weak one: the wrist, and the last joint of each finger; and of
    the strong hand's index to little finger, the wrist first.
    """
    names = [name.rpartition(":")[2] for name in skeleton(signer).names]
    sides = ("Left", "Right") if signer.left_handed else ("Right", "Left")
    strong, weak = (
        [names.index(f"{side}Hand"), *(names.index(f"{side}Hand{finger}3") for finger in FINGERS)] for side in sides
    )
    joints = [[strong[0], *(names.index(f"{sides[0]}Hand{finger}{k}") for k in (1, 2, 3))] for finger in FINGERS[1:]]
    return strong, weak, joints
