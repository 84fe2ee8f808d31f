"""The truth of a splice: equation 17 to the bit, each rule by hand, and transitions that fit both of their words."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from signing import seen_from_chest, word
from signsplice.errors import InputError
from signsplice.evaluation.corpus_checks import over_limit
from signsplice.synth import pose, running, trajectory, truth
from signsplice.synth.avoidance import penetration
from signsplice.synth.planner import Events, IsolatedWord
from signsplice.synth.signer import STANDARD
from signsplice.synth.truth import Relation

Float = NDArray[np.float64]

GLOSSES = ("I", "MOTHER", "HELLO", "BOOK", "LEARN", "SIGN", "YES", "YOU", "fs-A")
PAIRS = [(a, b) for a, b in itertools.product(GLOSSES, repeat=2) if a != b]
PLAIN = Relation(near=False, other_shape=False, leaving=1, going_down=1, coming_up=1, entering=1)


# --- equation 17


@pytest.mark.parametrize(("a", "b"), [("I", "LEARN"), ("MOTHER", "BOOK"), ("fs-A", "SIGN"), ("BOOK", "YES")])
def test_outside_the_transition_are_the_isolated_frames_bit_for_bit(a: str, b: str) -> None:
    p, q = word(a), word(b)
    true = truth.splice(p, q)
    said = running.utter([p, q], changes=False)
    n = len(true.states)
    new_rotations, new_roots = pose.rotations(true.states, STANDARD)
    assert len(said.clip) == true.pre + 1 + n + len(q) - true.post
    for got, before, new, after in (
        (said.clip.local_rotations, p.clip.local_rotations, new_rotations, q.clip.local_rotations),
        (said.clip.root_positions, p.clip.root_positions, new_roots, q.clip.root_positions),
    ):
        assert np.array_equal(got[: true.pre + 1], before[: true.pre + 1])
        assert np.array_equal(got[true.pre + 1 : true.pre + 1 + n], new)
        assert np.array_equal(got[true.pre + 1 + n :], after[true.post :])
    (seam,) = said.seams
    assert (seam.pre, seam.post) == (true.pre, true.post)
    assert np.array_equal(seam.states, true.states)


def test_the_truth_is_the_same_each_time() -> None:
    one, two = (truth.splice(word("I"), word("LEARN")) for _ in range(2))
    assert (one.pre, one.post) == (two.pre, two.post)
    assert np.array_equal(one.states, two.states)


# --- where to leave and enter


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_positions_lie_in_lawful_ranges(a: str, b: str) -> None:
    p, q = word(a), word(b)
    true = truth.splice(p, q)
    e, f = p.events, q.events
    assert e.start < true.pre < e.down - 3, "after the sign has begun, well before the hand hangs again"
    assert f.up + 3 < true.post < f.end, "after the hand has left its rest, before the sign is over"
    assert true.pre >= 2
    assert true.post + 3 <= len(q)
    if e.passes:
        assert true.pre > e.passes[max(len(e.passes) - 2, 0)][0], "in the last movement or after it"
    if f.first is not None:
        assert true.post <= (f.first[0] + f.first[1]) // 2, "before half of the first movement is over"
    assert 2 <= len(true.states) <= 24


def test_both_positions_depend_on_both_words() -> None:
    left = {a: {truth.splice(word(a), word(b)).pre for b in GLOSSES if b != a} for a in GLOSSES}
    entered = {b: {truth.splice(word(a), word(b)).post for a in GLOSSES if a != b} for b in GLOSSES}
    assert sum(len(frames) > 1 for frames in left.values()) >= len(GLOSSES) // 2, left
    assert sum(len(frames) > 1 for frames in entered.values()) >= len(GLOSSES) // 2, entered


def with_events(events: Events) -> IsolatedWord:
    return replace(word("I"), events=events)


MOVED = Events(5, 20, 40, 60, (20, 30), ((20, 30),), touches_first=False, touches_last=False)
"""X M H: rest to 5, up to 20, moves to 30, held to 40, down to 60."""
BEFORE = [
    # a letter: 0.6 of its hold of 20 frames, 1/6 more before another shape
    ("a hold alone", {"passes": (), "first": None}, {}, 32),
    ("a hold alone, another shape", {"passes": (), "first": None}, {"other_shape": True}, 35),
    ("a short hold alone keeps a frame", {"passes": (), "first": None, "end": 21}, {}, 21),
    # held: 0.35 of the movement's ten frames are left out, 0.26 opposed, 0.43 along
    ("held", {}, {}, 26),
    ("held, opposed", {}, {"leaving": 0}, 27),
    ("held, along", {}, {"leaving": 2}, 26),
    ("held, a long movement, along", {"passes": ((20, 40),), "end": 50}, {"leaving": 2}, 31),
    ("held, a movement of two frames, loses one", {"passes": ((20, 22),)}, {}, 21),
    # touching: the whole word and a share of the way down (20 frames): none, 0.22, 0.28
    ("touching", {"touches_last": True}, {}, 44),
    ("touching, away from the next", {"touches_last": True}, {"going_down": 0}, 40),
    ("touching, towards the next", {"touches_last": True}, {"going_down": 2}, 46),
    # free: no hold
    ("free", {"end": 30, "down": 50}, {}, 34),
    ("free, towards the next", {"end": 30, "down": 50}, {"going_down": 2}, 36),
    ("free, away from the next", {"end": 30, "down": 50}, {"going_down": 0}, 28),
    ("free, away from the next, opposed", {"end": 30, "down": 50}, {"going_down": 0, "leaving": 0}, 28),
    ("free, away from the next, along", {"end": 30, "down": 50}, {"going_down": 0, "leaving": 2}, 27),
    # two passes keep both only where the next word is near
    ("twice, near", {"passes": ((20, 30), (36, 46)), "end": 52}, {"near": True}, 42),
    ("twice, far", {"passes": ((20, 30), (36, 46)), "end": 52}, {}, 26),
    ("twice, far, touching", {"passes": ((20, 30), (36, 46)), "end": 52, "touches_last": True}, {}, 31),
    ("twice, near, touching", {"passes": ((20, 30), (36, 46)), "end": 52, "touches_last": True}, {"near": True}, 54),
    # three passes always lose one
    ("thrice, near", {"passes": ((20, 24), (26, 30), (32, 36))}, {"near": True}, 29),
    ("thrice, far", {"passes": ((20, 24), (26, 30), (32, 36))}, {}, 29),
    ("thrice, touching", {"passes": ((20, 24), (26, 30), (32, 36)), "touches_last": True}, {"near": True}, 31),
]


@pytest.mark.parametrize(("name", "events", "seen", "frame"), BEFORE, ids=[row[0] for row in BEFORE])
def test_where_a_word_is_left(name: str, events: dict[str, object], seen: dict[str, object], frame: int) -> None:
    made = with_events(replace(MOVED, **events))  # type: ignore[arg-type]
    assert truth.leave(made, replace(PLAIN, **seen)) == frame, name  # type: ignore[arg-type]


AFTER = [
    # no hold first: 0.25 of the fifteen frames up are kept, 0.16 opposed, 0.34 along; another shape a frame later
    ("free", {}, {}, 16),
    ("free, opposed", {}, {"coming_up": 0}, 18),
    ("free, along", {}, {"coming_up": 2}, 15),
    ("free, another shape", {}, {"other_shape": True}, 17),
    # held first (frames 20 to 26), then a movement of ten frames: 0.32 of it left out, 0.24 opposed, 0.40 along
    ("held", {"first": (26, 36)}, {}, 29),
    ("held, opposed", {"first": (26, 36)}, {"entering": 0}, 28),
    ("held, along", {"first": (26, 36)}, {"entering": 2}, 30),
    ("held, another shape", {"first": (26, 36)}, {"other_shape": True}, 28),
    ("held, a movement of two frames", {"first": (26, 28)}, {}, 27),
    # held and touching: a frame of the touch is seen, two where it is near
    ("touching", {"first": (26, 36), "touches_first": True}, {}, 25),
    ("touching, near", {"first": (26, 36), "touches_first": True}, {"near": True}, 24),
    ("touching for one frame, near", {"first": (21, 36), "touches_first": True}, {"near": True}, 20),
    # no movement at all
    ("a hold alone", {"first": None, "passes": ()}, {}, 20),
    ("a hold alone, near", {"first": None, "passes": ()}, {"near": True}, 21),
    ("a hold alone, near, another shape", {"first": None, "passes": ()}, {"near": True, "other_shape": True}, 20),
]


@pytest.mark.parametrize(("name", "events", "seen", "frame"), AFTER, ids=[row[0] for row in AFTER])
def test_where_a_word_is_entered(name: str, events: dict[str, object], seen: dict[str, object], frame: int) -> None:
    made = with_events(replace(MOVED, **events))  # type: ignore[arg-type]
    assert truth.enter(made, replace(PLAIN, **seen)) == frame, name  # type: ignore[arg-type]


# --- what is seen of two words


def drawn(at: dict[int, tuple[float, float, float]], shape: float = 0.0, events: Events = MOVED) -> IsolatedWord:
    """A word whose strong wrist goes straight from frame to frame given, all finger angles at ``shape``."""
    states = np.zeros((66, pose.SIZE))
    frames = sorted(at)
    for axis in range(3):
        states[:, axis] = np.interp(np.arange(66), frames, [at[f][axis] for f in frames])
    states[:, pose.FINGERS] = shape
    return replace(word("I"), states=states, events=events)


HANG, HERE = (-26.0, -40.0, 4.0), (-10.0, 0.0, 25.0)


def straight(end: tuple[float, float, float], start: tuple[float, float, float], shape: float = 0.0) -> IsolatedWord:
    return drawn({5: HANG, 20: start, 30: end, 40: end, 60: HANG}, shape)


def test_near_is_within_45_percent_of_the_shoulder_width() -> None:
    p = straight(HERE, HERE)
    for away, near in ((0.44, True), (0.46, False)):
        there = (HERE[0] + 36.0 * away, *HERE[1:])
        assert truth.relate(p, straight(there, there)).near is near
    tall = replace(STANDARD, stature_cm=204.0)
    there = (HERE[0] + 36.0 * 0.5, *HERE[1:])
    assert truth.relate(replace(p, signer=tall), straight(there, there)).near, "of a broader signer"


def test_handshapes_differ_by_the_mean_of_their_angles() -> None:
    for shape, other in ((0.41, False), (0.43, True), (-0.43, True)):
        assert truth.relate(straight(HERE, HERE), straight(HERE, HERE, shape)).other_shape is other


@pytest.mark.parametrize(
    ("way", "seen"), [((8.0, 0.0, 0.0), 2), ((-8.0, 0.0, 0.0), 0), ((0.0, 8.0, 0.0), 1), ((0.5, 0.0, 0.0), 1)]
)
def test_directions_are_told_by_their_angle_with_the_travel(way: tuple[float, float, float], seen: int) -> None:
    """The travel goes along +x; movements of less than 1.5 cm have no direction."""
    there = (HERE[0] + 20.0, HERE[1], HERE[2])
    back = tuple(a - b for a, b in zip(HERE, way, strict=True))
    on = tuple(a + b for a, b in zip(there, way, strict=True))
    leaving = truth.relate(straight(HERE, (back[0], back[1], back[2])), straight(there, there))
    entering = truth.relate(straight(HERE, HERE), straight((on[0], on[1], on[2]), there))
    assert leaving.leaving == seen
    assert leaving.entering == 1
    assert entering.entering == seen
    assert entering.leaving == 1


def test_going_down_and_coming_up_are_seen_half_way() -> None:
    high, low = (HERE[0], 20.0, HERE[2]), (HERE[0], -18.0, HERE[2])
    falling = truth.relate(straight(high, high), straight(low, low))
    assert (falling.going_down, falling.coming_up) == (2, 0), "down is on the way to a low place; up from rest is not"
    rising = truth.relate(straight(low, low), straight(high, high))
    assert (rising.going_down, rising.coming_up) == (0, 2)


# --- the transition


@pytest.mark.parametrize(("a", "b"), PAIRS[::3])
def test_a_transition_goes_on_from_both_words(a: str, b: str) -> None:
    """Steps of the wrists change at the seams no more than within the two words, or than a hand's quick turn."""
    p, q = word(a), word(b)
    true = truth.splice(p, q)
    said = running.utter([p, q], changes=False)
    at = seen_from_chest(said.clip, "LeftHand", "RightHand")[1]
    velocity = np.diff(at, axis=0)
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max(axis=-1)  # [i] around frame i + 1
    own = max(
        np.linalg.norm(np.diff(seen_from_chest(w.clip, "LeftHand", "RightHand")[1], n=2, axis=0), axis=-1).max()
        for w in (p, q)
    )
    first, stop = true.pre, true.pre + len(true.states) + 1
    for seam in (first, stop):
        assert change[seam - 1] < max(1.2 * own, 1.5), "cm a frame, a frame"
    step = np.linalg.norm(velocity, axis=-1).max(axis=-1)
    assert step[[first, stop - 1]].max() < 1.1 * step.max()
    turned = np.abs(np.sum(said.clip.local_rotations[1:] * said.clip.local_rotations[:-1], axis=-1))
    assert np.rad2deg(2.0 * np.arccos(np.minimum(turned, 1.0))).max() < 75.0


def test_transitions_keep_out_of_the_body_and_within_limits() -> None:
    for a, b in PAIRS[::4]:
        true = truth.splice(word(a), word(b))
        assert penetration(true.states, STANDARD)[0].max() < 0.5, (a, b)
        assert over_limit(pose.rotations(true.states, STANDARD)[0]) == 0.0, (a, b)


def test_longer_ways_take_no_fewer_frames() -> None:
    p = word("I")
    start = p.states[p.events.end]
    counts = []
    for way in np.linspace(0.0, 40.0, 30):
        end = start.copy()
        end[1] += way
        counts.append(truth.transition_frames(start, end, p))
    assert counts == sorted(counts)
    assert counts[-1] > counts[0] + 3
    law = 0.74 * (0.051 + 0.149 * np.log2(1.0 + 40.0 / 36.0 / 0.15))
    assert counts[-1] == round(30.0 * law) - 1


def test_the_weak_hand_and_the_fingers_take_their_time_too() -> None:
    p = word("I")
    start = p.states[p.events.end]
    least = truth.transition_frames(start, start, p)
    assert least == 2
    weak, shaped = start.copy(), start.copy()
    weak[28] += 40.0
    shaped[pose.FINGERS] += 1.5
    strong = start.copy()
    strong[1] += 40.0
    assert least < truth.transition_frames(start, weak, p) < truth.transition_frames(start, strong, p)
    assert truth.transition_frames(start, shaped, p) == round(30.0 * (0.09 + 0.15)) - 1
    assert truth.transition_frames(start, shaped, replace(p, signer=replace(STANDARD, tempo=2.0))) < 6


def test_a_transition_is_a_reach_where_nothing_is_in_the_way() -> None:
    p, q = word("YOU"), word("fs-A")
    true = truth.splice(p, q)
    reach = trajectory.reach(
        p.states[true.pre - 2 : true.pre + 1], q.states[true.post : true.post + 3], len(true.states), STANDARD
    )
    assert np.array_equal(true.states, reach)


def test_what_clears_a_transition_moves_nothing_beside_its_words() -> None:
    """Both words press a little; the middle of the way comes out of the body, its ends go on from them."""
    who = replace(STANDARD, arch=0.0)
    p = replace(word("MY"), signer=who)
    a = p.states[p.events.end].copy()
    a[2] -= 0.3
    b = a.copy()
    b[1] -= 12.0
    assert penetration(a[None], who)[0].max() > 0.25
    before, after = np.repeat(a[None], 3, axis=0), np.repeat(b[None], 3, axis=0)
    made = truth.transition(before, after, p)
    moved = np.linalg.norm(made - trajectory.reach(before, after, len(made), who), axis=-1)
    assert len(made) >= 4
    assert moved.max() > 0.1
    assert moved[0] < 0.4 * moved.max()
    assert moved[-1] < 0.85 * moved.max()


def test_words_of_two_signers_or_rates_are_refused() -> None:
    for other in (word("I", 3), word("I", fps=60.0)):
        with pytest.raises(InputError, match="MOTHER and I are of two signers or frame rates"):
            truth.splice(word("MOTHER"), other)
        with pytest.raises(InputError, match="two signers or frame rates"):
            running.utter([word("MOTHER"), word("YOU"), other])
