"""The ground truth of a splice: the frames where an utterance leaves one isolated word and enters the next, and the
transition that the signer makes between them.

The rules are those of running signing (Liddell and Johnson 1989): a movement is inserted between two signs, holds
between movements are deleted or shortened, repetitions get fewer, and the hands do not stop at the seam. Every rule
reads what the two clips show: when movements begin and end, whether a hand touches, how far and in which direction the
strong hand has to go, how much the handshape changes. docs/corpus.md describes the rules.

In the code ``p`` is the word before and ``q`` the word after.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.synth import pose, trajectory
from signsplice.synth.avoidance import clear_collisions, penetration
from signsplice.synth.planner import IsolatedWord
from signsplice.synth.timing import slowed

Float = NDArray[np.float64]

NEAR = 0.45
"""Travel (shoulder widths) up to which two positions of the hand are near one another."""
OTHER_SHAPE = 0.42
"""Mean change of the finger angles (radians) from which two handshapes are different."""
ALIGNED = 0.35
"""Cosine from which two directions agree (and below the negative of which they oppose)."""

# Three values each: for a movement opposed to the travel between the words, across it, along it.
LEAVE_HELD = (0.26, 0.35, 0.43)
"""Fraction of the last movement, before a hold, that is left out."""
LEAVE_FREE = (0.16, 0.24, 0.32)
"""Fraction of the last movement, before a retraction that leads away from the next word, that is left out."""
LEAVE_DOWN = (0.0, 0.22, 0.28)
"""Fraction of the retraction, after a touch or without a hold before it, that is kept."""
ENTER_HELD = (0.24, 0.32, 0.40)
"""Fraction of the first movement, after a hold, that is left out."""
ENTER_UP = (0.16, 0.25, 0.34)
"""Fraction of the preparation, with no hold after it, that is kept."""
KEEP_HOLD = 0.6
"""Fraction of its only hold that a sign without movement keeps; one sixth more before another handshape."""

TOO_DEEP_CM = 0.35
"""Depth that a hand may have at most in head, trunk or the other hand within a transition."""

PACE = 0.74
"""Duration of transitions in running signing, over what the travel law gives."""
WEAK_PACE = 0.72
"""The same for the weak hand, which need not be exact, over the strong hand's."""


@dataclass(frozen=True)
class Splice:
    """The ground truth for two words.

    pre: last frame kept of the word before
    post: first frame kept of the word after
    states: the transition's states, (n, 63)
    """

    pre: int
    post: int
    states: Float


@dataclass(frozen=True)
class Relation:
    """How two words relate, as far as the rules depend on it.

    Alignments compare a movement of the strong wrist with its travel between the words: 0 opposed, 1 across (or no
    direction), 2 along.

    near: whether the end of the first word and the start of the second are near
    other_shape: whether their handshapes differ
    leaving: alignment of the first word's last movement
    going_down: alignment of the first word's retraction
    coming_up: alignment of the second word's preparation
    entering: alignment of the second word's first movement
    """

    near: bool
    other_shape: bool
    leaving: int
    going_down: int
    coming_up: int
    entering: int


def splice(p: IsolatedWord, q: IsolatedWord) -> Splice:
    """The ground truth for word ``p`` before word ``q``. Raises ``InputError`` for two signers or frame rates."""
    check_alike(p, q)
    relation = relate(p, q)
    pre, post = leave(p, relation), enter(q, relation)
    return Splice(pre, post, transition(p.states[pre - 2 : pre + 1], q.states[post : post + 3], p))


def check_alike(p: IsolatedWord, q: IsolatedWord) -> None:
    """Raise ``InputError`` for words of two signers or frame rates."""
    if p.signer != q.signer or p.clip.fps != q.clip.fps:
        raise InputError(f"{p.sign.gloss} and {q.sign.gloss} are of two signers or frame rates, expected one of each")


def relate(p: IsolatedWord, q: IsolatedWord) -> Relation:
    """How two words relate."""
    start = q.events.start
    a, b = p.states[p.events.end], q.states[start]
    travel = b[pose.WRIST] - a[pose.WRIST]
    widths = float(np.linalg.norm(travel)) / (trajectory.SHOULDERS_CM * p.signer.scale)
    change = float(np.abs(b[pose.FINGERS] - a[pose.FINGERS]).mean())
    leaving = entering = 1
    if p.events.passes:
        begin, stop = _last_pass(p, widths < NEAR)
        leaving = _alignment(p.states[stop, pose.WRIST] - p.states[(begin + stop) // 2, pose.WRIST], travel)
    if q.events.first is not None:
        begin, stop = q.events.first
        entering = _alignment(q.states[(begin + stop + 1) // 2, pose.WRIST] - q.states[begin, pose.WRIST], travel)
    half_down, half_up = (p.events.end + p.events.down) // 2, (q.events.up + start) // 2
    going_down = _alignment(p.states[half_down, pose.WRIST] - p.states[p.events.end, pose.WRIST], travel)
    coming_up = _alignment(b[pose.WRIST] - q.states[half_up, pose.WRIST], travel)
    return Relation(widths < NEAR, change > OTHER_SHAPE, leaving, going_down, coming_up, entering)


def leave(p: IsolatedWord, relation: Relation) -> int:
    """The last frame kept of the word before."""
    events = p.events
    if not events.passes:
        hold = events.end - events.start
        return events.start + max(1, round(hold * (KEEP_HOLD + relation.other_shape / 6.0)))
    begin, stop = _last_pass(p, relation.near)
    held = events.end - events.passes[-1][1]
    if stop < events.passes[-1][1]:
        return stop + 1 if events.touches_last else stop - max(1, round(LEAVE_HELD[relation.leaving] * (stop - begin)))
    down = round(LEAVE_DOWN[relation.going_down] * (events.down - events.end))
    if events.touches_last:
        return events.end + down
    if held:
        return stop - max(1, round(LEAVE_HELD[relation.leaving] * (stop - begin)))
    if relation.going_down == 0:
        return stop - max(1, round(LEAVE_FREE[relation.leaving] * (stop - begin)))
    return stop + down


def enter(q: IsolatedWord, relation: Relation) -> int:
    """The first frame kept of the word after."""
    events = q.events
    if events.first is None:
        return events.start + (relation.near and not relation.other_shape)
    begin, stop = events.first
    held = begin - events.start
    if held == 0:
        up = events.start - events.up
        return events.start - round(ENTER_UP[relation.coming_up] * up) + relation.other_shape
    if events.touches_first:
        return begin - min(2 if relation.near else 1, held)
    return begin + max(1, round(ENTER_HELD[relation.entering] * (stop - begin)) - relation.other_shape)


def _last_pass(p: IsolatedWord, near: bool) -> tuple[int, int]:
    """The last pass of the last movement that running signing keeps: three or more lose one, and so do two where the
    next word is far.
    """
    passes = p.events.passes
    return passes[-2] if len(passes) >= 3 or (len(passes) == 2 and not near) else passes[-1]


def _alignment(displacement: Float, travel: Float) -> int:
    """0 opposed, 1 across or no direction, 2 along."""
    length = float(np.linalg.norm(displacement) * np.linalg.norm(travel))
    if np.linalg.norm(displacement) < 1.5 or length < 1e-6:
        return 1
    cosine = float(displacement @ travel) / length
    return 2 if cosine > ALIGNED else 0 if cosine < -ALIGNED else 1


def transition(before: Float, after: Float, p: IsolatedWord, pause_s: float = 0.0) -> Float:
    """The states (n, 63) between two stretches of at least three frames, in ``p``'s signer and rate.

    Where the path is so short that a hand would pass through the body, it takes two, four or six frames longer.
    ``pause_s``: for how many seconds the signer hesitates half way.
    """
    n_frames = transition_frames(before[-1], after[0], p)
    for more in range(0, 7, 2):
        at = slowed(n_frames + more, round(p.clip.fps * pause_s)) if pause_s else None
        states = clear_collisions(trajectory.reach(before, after, n_frames + more, p.signer, at), p.signer, ends=True)
        if penetration(states, p.signer)[0].max() < TOO_DEEP_CM:
            break
    return states


def transition_frames(start: Float, end: Float, p: IsolatedWord) -> int:
    """How many frames are new between two states (63,), by the travel law for the hand that takes longer (the weak hand
    is faster), and at least as many as the handshape takes to form; the law includes the signer's tempo.
    """
    travel = np.linalg.norm(pose.hands(end)[:, pose.WRIST] - pose.hands(start)[:, pose.WRIST], axis=-1)
    strong, weak = (trajectory.travel_seconds(float(distance), p.signer) for distance in travel)
    formed = float(np.abs(end[pose.FINGERS] - start[pose.FINGERS]).mean())
    seconds = max(PACE * strong, PACE * WEAK_PACE * weak, (0.09 + 0.10 * formed) / p.signer.tempo)
    return max(2, round(p.clip.fps * seconds) - 1)
