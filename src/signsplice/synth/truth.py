"""The truth of a splice: where an utterance leaves one isolated word and joins the next, and what the signer does
between.

The rules are those of running signing (Liddell and Johnson 1989): a movement is inserted between two signs, holds
between movements are deleted or shortened, repetitions get fewer, and the hands do not stop at the seam. Every rule
looks at what can be seen in the two clips: when movements begin and end, whether a hand touches, how far and in which
direction the strong hand has to go, how much the handshape changes. docs/corpus.md tells them in words.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.synth import pose, trajectory
from signsplice.synth.avoidance import clear, intrusion
from signsplice.synth.planner import IsolatedWord

Float = NDArray[np.float64]

NEAR = 0.45
"""Travel (shoulder widths) up to which two places are near one another."""
OTHER_SHAPE = 0.42
"""Mean change of the finger angles (radians) from which two handshapes are different."""
ALIGNED = 0.35
"""Cosine from which two directions agree (and below the negative of which they oppose)."""

# By how a movement lies to the travel between the words: opposed, across, along.
LEAVE_HELD = (0.26, 0.35, 0.43)
"""Share of the last movement, before a hold, that is left out."""
LEAVE_FREE = (0.16, 0.24, 0.32)
"""Share of the last movement, before a retraction that leads away from the next word, that is left out."""
LEAVE_DOWN = (0.0, 0.22, 0.28)
"""Share of the retraction, after a touch or without a hold before it, that is kept."""
ENTER_HELD = (0.24, 0.32, 0.40)
"""Share of the first movement, after a hold, that is left out."""
ENTER_UP = (0.16, 0.25, 0.34)
"""Share of the preparation, with no hold after it, that is kept."""
KEEP_HOLD = 0.6
"""Share of its only hold that a sign without movement keeps, or one sixth more before another handshape."""

TOO_DEEP_CM = 0.35
"""How deep a hand may at most lie in head, trunk or the other hand within a transition."""

PACE = 0.74
"""Transitions of running signing over the travel law at the ends of the two clips."""
WEAK_PACE = 0.72
"""The weak hand, which need not be exact, over the strong one."""


@dataclass(frozen=True)
class Splice:
    """The truth for two words: last frame kept of the first (pre), first kept of the second (post), and the states
    (n, 63) of the transition between.
    """

    pre: int
    post: int
    states: Float


@dataclass(frozen=True)
class Relation:
    """What can be seen of two words side by side: whether their places are near and their handshapes differ, and how
    the first one's last movement and retraction, and the second one's preparation and first movement, lie to the travel
    between (0 opposed, 1 across, 2 along; 1 where there is no direction).
    """

    near: bool
    other_shape: bool
    leaving: int
    going_down: int
    coming_up: int
    entering: int


def splice(p: IsolatedWord, q: IsolatedWord) -> Splice:
    """The truth for one word after another of the same signer and rate. Raises ``InputError`` for others."""
    check_alike(p, q)
    seen = relation(p, q)
    pre, post = leave(p, seen), enter(q, seen)
    return Splice(pre, post, between(p.states[pre - 2 : pre + 1], q.states[post : post + 3], p))


def check_alike(p: IsolatedWord, q: IsolatedWord) -> None:
    """Raise ``InputError`` for words of two signers or frame rates."""
    if p.who != q.who or p.clip.fps != q.clip.fps:
        raise InputError(f"{p.sign.gloss} and {q.sign.gloss} are of two signers or frame rates, expected one of each")


def relation(p: IsolatedWord, q: IsolatedWord) -> Relation:
    """What the rules look at in two words."""
    start = q.events.start
    a, b = p.states[p.events.end], q.states[start]
    travel = b[pose.WRIST] - a[pose.WRIST]
    widths = float(np.linalg.norm(travel)) / (trajectory.SHOULDERS_CM * p.who.scale)
    change = float(np.abs(b[pose.FINGERS] - a[pose.FINGERS]).mean())
    leaving = entering = 1
    if p.events.passes:
        begin, stop = _last_pass(p, widths < NEAR)
        leaving = _along(p.states[stop, pose.WRIST] - p.states[(begin + stop) // 2, pose.WRIST], travel)
    if q.events.first is not None:
        begin, stop = q.events.first
        entering = _along(q.states[(begin + stop + 1) // 2, pose.WRIST] - q.states[begin, pose.WRIST], travel)
    half_down, half_up = (p.events.end + p.events.down) // 2, (q.events.up + start) // 2
    going_down = _along(p.states[half_down, pose.WRIST] - p.states[p.events.end, pose.WRIST], travel)
    coming_up = _along(b[pose.WRIST] - q.states[half_up, pose.WRIST], travel)
    return Relation(widths < NEAR, change > OTHER_SHAPE, leaving, going_down, coming_up, entering)


def leave(p: IsolatedWord, seen: Relation) -> int:
    """The last frame kept of the word before."""
    events = p.events
    if not events.passes:
        hold = events.end - events.start
        return events.start + max(1, round(hold * (KEEP_HOLD + seen.other_shape / 6.0)))
    begin, stop = _last_pass(p, seen.near)
    held = events.end - events.passes[-1][1]
    if stop < events.passes[-1][1]:
        return stop + 1 if events.touches_last else stop - max(1, round(LEAVE_HELD[seen.leaving] * (stop - begin)))
    down = round(LEAVE_DOWN[seen.going_down] * (events.down - events.end))
    if events.touches_last:
        return events.end + down
    if held:
        return stop - max(1, round(LEAVE_HELD[seen.leaving] * (stop - begin)))
    if seen.going_down == 0:
        return stop - max(1, round(LEAVE_FREE[seen.leaving] * (stop - begin)))
    return stop + down


def enter(q: IsolatedWord, seen: Relation) -> int:
    """The first frame kept of the word after."""
    events = q.events
    if events.first is None:
        return events.start + (seen.near and not seen.other_shape)
    begin, stop = events.first
    held = begin - events.start
    if held == 0:
        return events.start - round(ENTER_UP[seen.coming_up] * (events.start - events.up)) + seen.other_shape
    if events.touches_first:
        return begin - min(2 if seen.near else 1, held)
    return begin + max(1, round(ENTER_HELD[seen.entering] * (stop - begin)) - seen.other_shape)


def _last_pass(p: IsolatedWord, near: bool) -> tuple[int, int]:
    """The last pass of the last movement that running signing keeps: three or more lose one, and so do two where the
    next word is far.
    """
    passes = p.events.passes
    return passes[-2] if len(passes) >= 3 or (len(passes) == 2 and not near) else passes[-1]


def _along(way: Float, travel: Float) -> int:
    length = float(np.linalg.norm(way) * np.linalg.norm(travel))
    if np.linalg.norm(way) < 1.5 or length < 1e-6:
        return 1
    cosine = float(way @ travel) / length
    return 2 if cosine > ALIGNED else 0 if cosine < -ALIGNED else 1


def between(before: Float, after: Float, p: IsolatedWord) -> Float:
    """The transition's states (n, 63) between two stretches of at least three frames, in ``p``'s signer and rate.

    Where the way is so short that a hand would pass through the body, it takes two, four or six frames longer.
    """
    n_frames = transition_frames(before[-1], after[0], p)
    for more in range(0, 7, 2):
        states = clear(trajectory.reach(before, after, n_frames + more, p.who), p.who, ends=True)
        if intrusion(states, p.who)[0].max() < TOO_DEEP_CM:
            break
    return states


def transition_frames(start: Float, end: Float, p: IsolatedWord) -> int:
    """How many frames are new: by the travel law for the hand that has longer to go, the weak one in less time, and
    long enough to form the handshape; the signer's tempo is in the law.
    """
    ways = np.linalg.norm(pose.hands(end)[:, pose.WRIST] - pose.hands(start)[:, pose.WRIST], axis=-1)
    strong, weak = (trajectory.travel_seconds(float(way), p.who) for way in ways)
    formed = float(np.abs(end[pose.FINGERS] - start[pose.FINGERS]).mean())
    seconds = max(PACE * strong, PACE * WEAK_PACE * weak, (0.09 + 0.10 * formed) / p.who.tempo)
    return max(2, round(p.clip.fps * seconds) - 1)
