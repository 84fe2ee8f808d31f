"""The ground truth of a splice: the frames where an utterance leaves one isolated word and enters the next, and the
transition that the signer makes between them.

The rules are those of running signing: a movement is inserted between two signs and holds are deleted (Liddell and
Johnson 1989), repetitions get fewer (their "single sequence", 1986), and the hands do not stop at the seam. A target
posture may be undershot (Mauk 2003; Tyrone and Mauk 2010), by a small part of the movement that leads to it, and less
the nearer it is to the skin. Event frames decide which rule applies; within a rule, the motion of the two clips changes
the cut continuously, so that a small error of reading rarely changes a frame. docs/corpus.md describes the rules.

In the code ``p`` is the word before and ``q`` the word after.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import FloatArray
from signsplice.motion.curves import minimum_jerk
from signsplice.signer import arms, pose, trajectory
from signsplice.signer import handshapes as thumbs
from signsplice.signer.collisions import clear_collisions, penetration
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import PLAIN, Signer
from signsplice_workshop.corpora.touches import measure_touches

KINDS = {
    "partner": "where a word is left and entered depends on the other word too",
    "word": "each word has one frame where it is left and one where it is entered, whoever its partner is",
    "events": "each word has frames of its own for its events, and the partner chooses the event (``readable``)",
}
"""Kinds of ground truth."""

UNDERSHOOT = 0.2
"""Fraction of a movement's time that may be left out before (or after) a posture at which it stops: a minimum-jerk
movement then has 5.8 % of its path left, and 41 % of its peak speed."""
TURNING = 0.65
"""The same at a turn without a stop, as a fraction of ``UNDERSHOOT``."""
UNDERSHOOT_PATH, UNDERSHOOT_CM = 0.03, 0.5
"""Largest part of a minimum-jerk movement's path that may be left out before a posture, as a fraction, and in cm on the
standard body. Movements smoothed in time can lose up to four times as much."""
ALONG_MORE = 0.3
"""Fraction by which undershoot is smaller opposed to the travel between the words than along it; across it, half of
that."""
TOUCHING_CM, FREE_CM = 1.0, 4.0
"""Skin distances up to which a posture is not undershot, and from which it is undershot in full."""

SHORT_HOLD_S, LONG_HOLD_S = 0.1, 0.35
"""Last holds up to the first duration stay, as after a short touch; from the second one on they are deleted. Between
them a part of the hold stays."""
KEEP_DOWN, DOWN_ALONG = 0.22, 0.12
"""Fraction of the retraction that stays if it leads across the travel, and its increase along and decrease opposed to
it."""
KEEP_UP, UP_ALONG = 0.24, 0.11
"""The same for the preparation."""
FAR_CM = 3.0
"""Travel at which half of that stays, since a hand that is there already has no path to share."""
KEEP_HOLD, KEEP_OTHER = 0.6, 0.17
"""Fraction of its only hold that a sign without movement keeps, and its increase before another handshape."""
OTHER_SHAPE = 0.6
"""Mean change of the finger angles (radians) from which two handshapes are entirely different."""

DIRECTION_CM = 4.0
"""Displacement at which a direction counts half: shorter ones have hardly any."""
SEEN_S = 0.133
"""Time on either side of an event over which the position of the hand is averaged."""

_PATH_POINTS = 8

TOO_DEEP_CM = 0.35
"""Largest depth of a hand in head, trunk or the other hand within a transition."""

MOST_ELBOW_CM_S = 220.0
"""Speed from the chest, on the standard body, from which an elbow is too fast: 99 % of a captured take are below 1.98
m/s, with arms of 0.88 of the standard length.
"""

PACE = 0.74
"""Duration of transitions in running signing, relative to the travel law."""
TURN_S = (0.08, 0.13)
"""Shortest duration of a hand's rotation, before the pace: seconds, and seconds per radian."""
WEAK_PACE = 0.72
"""The same for the weak hand, which need not be exact, relative to the strong hand's."""


@dataclass(frozen=True)
class Splice:
    """The ground truth for two words.

    pre: last kept frame of the word before
    post: first kept frame of the word after
    states: the transition's states, (n, 65)
    """

    pre: int
    post: int
    states: FloatArray


@dataclass(frozen=True)
class Relation:
    """The relation of two words, as far as the rules depend on it.

    Alignments compare a movement of the strong wrist with its travel between the words, from -1 (opposed) over 0
    (across, or hardly any direction) to 1 (along).

    travel_cm: from the end of the first word to the start of the second, on the standard body
    shape_change: mean change of the finger angles, radians
    leaving: alignment of the second half of the first word's last movement
    going_down: alignment of the first word's retraction, its first half
    coming_up: alignment of the second word's preparation, its second half
    entering: alignment of the first half of the second word's first movement
    """

    travel_cm: float
    shape_change: float
    leaving: float
    going_down: float
    coming_up: float
    entering: float


@dataclass(frozen=True)
class CutTime:
    """A cut as the rules give it, between two frames.

    posture: the frame of the event from which it is counted
    frames: number of frames after it, or before it if negative
    towards_posture: whether it is rounded towards the posture, instead of to the nearest frame
    """

    posture: int
    frames: float
    towards_posture: bool = False

    @property
    def frame(self) -> int:
        """Returns the frame to which it is rounded."""
        return self.posture + (math.trunc(self.frames) if self.towards_posture else round(self.frames))


ANY_PARTNER = Relation(18.0, 0.3, leaving=0.0, going_down=0.0, coming_up=0.0, entering=0.0)
"""Relation of a word to an unknown one: half a shoulder width away, across, with another handshape."""


def by_partner(kind: str) -> bool:
    """Returns whether the cuts of a kind of truth depend on both words. Raises ``InputError`` for an unknown kind."""
    if kind not in KINDS:
        raise InputError(f"no truth {kind!r}, expected one of {', '.join(KINDS)}")
    return kind != "word"


def splice(p: IsolatedWord, q: IsolatedWord, *, partner: bool = True) -> Splice:
    """Returns the ground truth for word ``p`` before word ``q``. Raises ``InputError`` for two signers or frame rates.

    partner: whether the cut depends on both words; without, each is left and entered as beside ``ANY_PARTNER``.
    """
    pre, post = find_cut(p, q, partner=partner)
    return Splice(pre, post, make_transition(p.states[pre - 2 : pre + 1], q.states[post : post + 3], p))


def find_cut(p: IsolatedWord, q: IsolatedWord, *, partner: bool = True) -> tuple[int, int]:
    """Returns the last kept frame of ``p`` and the first kept frame of ``q``; see ``splice``."""
    check_alike(p, q)
    relation = relate(p, q) if partner else ANY_PARTNER
    return find_leave_frame(p, relation), find_enter_frame(q, relation)


def check_alike(p: IsolatedWord, q: IsolatedWord) -> None:
    """Raises ``InputError`` for words of two signers or frame rates."""
    if p.signer != q.signer or p.clip.fps != q.clip.fps:
        raise InputError(f"{p.sign.gloss} and {q.sign.gloss} are of two signers or frame rates, expected one of each")


def relate(p: IsolatedWord, q: IsolatedWord) -> Relation:
    """Returns the relation of two words."""
    end, start = p.events.end, q.events.start
    travel = _average_wrist_position(q, start) - _average_wrist_position(p, end)
    handshapes = p.states[end, pose.FINGERS], q.states[start, pose.FINGERS]
    leaving_step = entering_step = np.zeros(3)
    if p.events.passes:
        begin, stop = find_last_kept_pass(p)
        leaving_step = _average_wrist_position(p, stop, begin, stop) - _average_wrist_position(
            p, (begin + stop) // 2, begin, stop
        )
    if q.events.first is not None:
        begin, stop = q.events.first
        entering_step = _average_wrist_position(q, (begin + stop + 1) // 2, begin, stop) - _average_wrist_position(
            q, begin, begin, stop
        )
    return Relation(
        travel_cm=float(np.linalg.norm(travel)),
        shape_change=float(np.abs(handshapes[1] - handshapes[0]).mean()),
        leaving=_compute_alignment(leaving_step, travel),
        going_down=_compute_alignment(
            _average_wrist_position(p, (end + p.events.down) // 2) - _average_wrist_position(p, end), travel
        ),
        coming_up=_compute_alignment(
            _average_wrist_position(q, start) - _average_wrist_position(q, (q.events.up + start) // 2), travel
        ),
        entering=_compute_alignment(entering_step, travel),
    )


def find_leave_frame(p: IsolatedWord, relation: Relation) -> int:
    """Returns the last kept frame of the word before."""
    return find_leave_time(p, relation).frame


def find_leave_time(p: IsolatedWord, relation: Relation) -> CutTime:
    """Returns the time at which the word before is left, not yet rounded to a frame."""
    events = measure_touches(p)
    if not events.passes:
        fraction = KEEP_HOLD + KEEP_OTHER * min(1.0, relation.shape_change / OTHER_SHAPE)
        return CutTime(events.start, max(1.0, (events.end - events.start) * fraction))
    begin, stop = find_last_kept_pass(p)
    n_left_out = _compute_pass_undershoot(p, begin, stop, relation.leaving, events.gap_last_cm) * (stop - begin)
    if stop < events.passes[-1][1]:  # a pass is dropped, and the hand turns
        return CutTime(stop, -TURNING * n_left_out, towards_posture=True)
    n_hold = events.end - stop
    deleted_fraction = (n_hold / p.clip.fps - SHORT_HOLD_S) / (LONG_HOLD_S - SHORT_HOLD_S)
    deleted_fraction = min(1.0, max(0.0, deleted_fraction))
    n_kept = (
        (KEEP_DOWN + DOWN_ALONG * relation.going_down) * _compute_travel_share(relation) * (events.down - events.end)
    )
    frames = (1.0 - deleted_fraction) * (n_hold + n_kept) - deleted_fraction * n_left_out
    return CutTime(stop, frames, towards_posture=frames < 0.0)


def find_enter_frame(q: IsolatedWord, relation: Relation) -> int:
    """Returns the first kept frame of the word after."""
    return find_enter_time(q, relation).frame


def find_enter_time(q: IsolatedWord, relation: Relation) -> CutTime:
    """Returns the time at which the word after is entered, not yet rounded to a frame."""
    events = measure_touches(q)
    if events.first is None:
        return CutTime(events.start, 0.0)
    begin, stop = events.first
    if begin > events.start:  # the first hold is deleted
        n_left_out = _compute_pass_undershoot(q, begin, stop, relation.entering, events.gap_first_cm) * (stop - begin)
        return CutTime(begin, n_left_out, towards_posture=True)
    kept_fraction = (KEEP_UP + UP_ALONG * relation.coming_up) * _compute_travel_share(relation)
    return CutTime(events.start, -kept_fraction * (events.start - events.up))


def find_last_kept_pass(p: IsolatedWord) -> tuple[int, int]:
    """Returns the last pass of the last movement that running signing keeps: a repeated movement loses one. Revolutions
    of a circle, which follow one another without a return, all stay: between two of them the hand is at full speed.
    """
    passes = p.events.passes
    returns = len(passes) > 1 and passes[-2][1] < passes[-1][0]
    return passes[-2] if returns else passes[-1]


def compute_undershoot(path_cm: float, chord_cm: float) -> float:
    """Returns the fraction of a movement's time that may be left out before a posture at which it stops, by the lengths
    of its path and chord on the standard body.

    At most ``UNDERSHOOT_PATH`` of the path and ``UNDERSHOOT_CM`` are left out: of a straight path by minimum jerk; of
    circles and zigzags, which keep their speed to the end, that fraction itself.
    """
    times = np.linspace(0.0, UNDERSHOOT, 201)
    path_fractions = minimum_jerk_by_powers(times)
    largest_fraction = min(UNDERSHOOT_PATH, UNDERSHOOT_CM / max(path_cm, UNDERSHOOT_CM))
    straightness = min(1.0, chord_cm / (path_cm + UNDERSHOOT_CM))
    return (
        straightness * float(np.interp(largest_fraction, path_fractions, times))
        + (1.0 - straightness) * largest_fraction
    )


def _compute_pass_undershoot(
    word: IsolatedWord, begin: int, stop: int, alignment: float, clearance_cm: float | None
) -> float:
    """Returns the fraction of the time of a movement that is left out at a posture with a skin distance."""
    if clearance_cm is None:
        raise ValueError("events without skin distances")
    # Few points, each the mean of three frames, so that reading errors hardly lengthen the path.
    frames = np.linspace(begin, stop, _PATH_POINTS).round().astype(int)[:, None] + [-1, 0, 1]
    path = word.states[np.clip(frames, begin, stop), pose.WRIST].mean(axis=1) / word.signer.scale
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=-1).sum())
    skin_factor = min(1.0, max(0.0, (clearance_cm - TOUCHING_CM) / (FREE_CM - TOUCHING_CM)))
    fraction = compute_undershoot(length, float(np.linalg.norm(path[-1] - path[0])))
    return fraction * skin_factor * (1.0 - 0.5 * ALONG_MORE * (1.0 - alignment))


def _compute_travel_share(relation: Relation) -> float:
    return relation.travel_cm / (relation.travel_cm + FAR_CM)


def _average_wrist_position(
    word: IsolatedWord, frame: int, first_frame: int = 0, last_frame: int | None = None
) -> FloatArray:
    """Returns the strong wrist's position (3,) around a frame, on the standard body; averaged so that errors of single
    frames hardly count.
    """
    n_around = round(SEEN_S * word.clip.fps)
    highest = len(word) - 1 if last_frame is None else last_frame
    frames = slice(max(first_frame, frame - n_around), min(highest, frame + n_around) + 1)
    return np.asarray(word.states[frames, pose.WRIST].mean(axis=0) / word.signer.scale)


def _compute_alignment(displacement: FloatArray, travel: FloatArray) -> float:
    """Returns the cosine between two displacements, reduced if one of them is short."""
    lengths = [float(np.linalg.norm(v)) + DIRECTION_CM for v in (displacement, travel)]
    return float(displacement @ travel) / (lengths[0] * lengths[1])


def make_transition(before: FloatArray, after: FloatArray, p: IsolatedWord, pause_s: float = 0.0) -> FloatArray:
    """Returns the states (n, 65) between two arrays of at least three states, in ``p``'s signer and rate.

    If this is so short that a hand would pass through the body, or an elbow be too fast, it takes up to ten frames
    longer. ``pause_s``: for how many seconds the signer hesitates half way.
    """
    n_frames = count_transition_frames(before[-1], after[0], p)
    for n_extra in range(0, 11, 2):
        times = compute_hesitating_times(n_frames + n_extra, round(p.clip.fps * pause_s)) if pause_s else None
        states, valid = synthesize_transition(n_frames + n_extra, before, after, p, times)
        if valid:
            break
    return states


def synthesize_transition(
    n_frames: int, before: FloatArray, after: FloatArray, p: IsolatedWord, times: FloatArray | None = None
) -> tuple[FloatArray, bool]:
    """Returns the states (n, 65) of a transition of ``n_frames`` between two arrays of at least three states, in
    ``p``'s signer and rate, and whether they are valid: no hand passes through the body, and no elbow is too fast.

    times: where the frames lie on the reach, 0 to 1; evenly if None
    """
    states = trajectory.reach(before, after, n_frames, p.signer, times)
    if p.signer.manner != PLAIN:
        states = thumbs.open_thumbs(states, ends=True)
    for _ in range(2):  # elbows follow the hands
        states = clear_collisions(join_elbows(states, before, after, p.signer), p.signer, ends=True)
    states = join_elbows(states, before, after, p.signer)
    too_fast = measure_largest_elbow_step(states, before, after, p.signer) * p.clip.fps > MOST_ELBOW_CM_S
    return states, bool(penetration(states, p.signer)[0].max() < TOO_DEEP_CM and not too_fast)


def count_transition_frames(start: FloatArray, end: FloatArray, p: IsolatedWord) -> int:
    """Returns the number of new frames between two states (65,), by the travel law for the hand that takes longer (the
    weak hand is faster), and at least as many as the hands take to turn and the handshape to form; the law includes the
    signer's tempo.
    """
    change = pose.hands(end) - pose.hands(start)
    travel, turn = (np.linalg.norm(change[:, part], axis=-1) for part in (pose.WRIST, pose.ROTVEC))
    strong, weak = (
        max(
            trajectory.travel_seconds(float(distance), p.signer),
            (TURN_S[0] + TURN_S[1] * float(angle)) / p.signer.tempo,
        )
        for distance, angle in zip(travel, turn, strict=True)
    )
    shape_change = float(np.abs(end[pose.FINGERS] - start[pose.FINGERS]).mean())
    seconds = max(PACE * strong, PACE * WEAK_PACE * weak, (0.09 + 0.10 * shape_change) / p.signer.tempo)
    return max(2, round(p.clip.fps * seconds) - 1)


def join_elbows(states: FloatArray, before: FloatArray, after: FloatArray, signer: Signer) -> FloatArray:
    """Returns the states (n, 65) of a transition with elbows that go from those of ``before`` (.., 65) to those of
    ``after`` (.., 65), at the speed of both ends; in plain motion the states themselves.
    """
    if not signer.manner.low_elbows:
        return states
    steps = len(states) + 1
    start, end = (arms.directions_of(end_states, signer).reshape(len(end_states), 6) for end_states in (before, after))
    directions = trajectory.joining(start, end, steps, np.arange(1, steps)[:, None] / steps)
    return arms.turn_elbows(states, directions.reshape(-1, 2, 3), signer)


def measure_largest_elbow_step(states: FloatArray, before: FloatArray, after: FloatArray, signer: Signer) -> float:
    """Returns the largest step of an elbow from frame to frame in a transition's states (n, 65) and from and to the
    states beside it, cm on the standard body, from the chest.
    """
    states = np.concatenate([before[-1:], states, after[:1]])
    return float(np.linalg.norm(np.diff(arms.elbow_positions(states, signer), axis=0), axis=-1).max())


_MOST_PAUSE = 0.9
"""Longest pause relative to the transition without it: hands still move at a tenth of their speed half way."""


def compute_hesitating_times(n_frames: int, pause_frames: int) -> FloatArray:
    """Returns where frames of a reach of ``n_frames`` lie on it, 0 to 1, if it pauses for ``pause_frames`` more: at its
    own speed at both ends, slowest half way (n_frames + pause, at most nearly twice as many).
    """
    steps = n_frames + 1
    pause = min(pause_frames, int(_MOST_PAUSE * steps))
    t = np.arange(1, n_frames + pause + 1, dtype=np.float64)
    u = t / (steps + pause)
    return np.asarray((t - minimum_jerk(u, pause)) / steps)


def minimum_jerk_by_powers(u: FloatArray) -> FloatArray:
    """Returns ``minimum_jerk`` as a sum of powers. Its last bit differs: true cuts of stored corpora are computed with
    it.
    """
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
