"""The ground truth of a splice: equation 17 exactly, each rule in numbers, and transitions that fit both words."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from signing import seen_from_chest, word, wrists
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


@cache
def splice(a: str, b: str) -> truth.Splice:
    return truth.splice(word(a), word(b))


# --- equation 17


@pytest.mark.parametrize(("a", "b"), [("I", "LEARN"), ("MOTHER", "BOOK"), ("fs-A", "SIGN"), ("BOOK", "YES")])
def test_outside_the_transition_all_frames_are_isolated_frames(a: str, b: str) -> None:
    p, q = word(a), word(b)
    true = truth.splice(p, q)
    sentence = running.utter([p, q], changes=False)
    n = len(true.states)
    new_rotations, new_roots = pose.rotations(true.states, STANDARD)
    assert len(sentence.clip) == true.pre + 1 + n + len(q) - true.post
    for got, before, new, after in (
        (sentence.clip.local_rotations, p.clip.local_rotations, new_rotations, q.clip.local_rotations),
        (sentence.clip.root_positions, p.clip.root_positions, new_roots, q.clip.root_positions),
    ):
        assert np.array_equal(got[: true.pre + 1], before[: true.pre + 1])
        assert np.array_equal(got[true.pre + 1 : true.pre + 1 + n], new)
        assert np.array_equal(got[true.pre + 1 + n :], after[true.post :])
    (seam,) = sentence.seams
    assert (seam.pre, seam.post) == (true.pre, true.post)
    assert np.array_equal(seam.states, true.states)


def test_the_ground_truth_is_the_same_each_time() -> None:
    one, two = (truth.splice(word("I"), word("LEARN")) for _ in range(2))
    assert (one.pre, one.post) == (two.pre, two.post)
    assert np.array_equal(one.states, two.states)


# --- where to leave and enter


def test_cut_frames_lie_in_plausible_ranges() -> None:
    for a, b in PAIRS:
        p, q, true = word(a), word(b), splice(a, b)
        e, f = p.events, q.events
        assert e.start < true.pre < e.down - 3, f"{a} {b}: after the sign has begun, well before the hand hangs again"
        assert f.up + 3 < true.post < f.end, f"{a} {b}: after the hand has left its rest, before the sign is over"
        assert true.pre >= 2
        assert true.post + 3 <= len(q)
        if e.passes:
            assert true.pre > e.passes[max(len(e.passes) - 2, 0)][0], f"{a} {b}: in the last movement or after it"
        if f.first is not None:
            assert true.post <= sum(f.first) // 2, f"{a} {b}: before half of the first movement is over"
        assert 2 <= len(true.states) <= 24, (a, b)


def test_both_cut_frames_depend_on_both_words() -> None:
    left = {a: {splice(a, b).pre for b in GLOSSES if b != a} for a in GLOSSES}
    entered = {b: {splice(a, b).post for a in GLOSSES if a != b} for b in GLOSSES}
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
    # touching: the whole word and a fraction of the retraction (20 frames): none, 0.22, 0.28
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


@pytest.mark.parametrize(("name", "events", "relation", "frame"), BEFORE, ids=[row[0] for row in BEFORE])
def test_where_a_word_is_left(name: str, events: dict[str, object], relation: dict[str, object], frame: int) -> None:
    made = with_events(replace(MOVED, **events))  # type: ignore[arg-type]
    assert truth.leave(made, replace(PLAIN, **relation)) == frame, name  # type: ignore[arg-type]


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
    # held and touching: a frame of the touch is kept, two where it is near
    ("touching", {"first": (26, 36), "touches_first": True}, {}, 25),
    ("touching, near", {"first": (26, 36), "touches_first": True}, {"near": True}, 24),
    ("touching for one frame, near", {"first": (21, 36), "touches_first": True}, {"near": True}, 20),
    # no movement at all
    ("a hold alone", {"first": None, "passes": ()}, {}, 20),
    ("a hold alone, near", {"first": None, "passes": ()}, {"near": True}, 21),
    ("a hold alone, near, another shape", {"first": None, "passes": ()}, {"near": True, "other_shape": True}, 20),
]


@pytest.mark.parametrize(("name", "events", "relation", "frame"), AFTER, ids=[row[0] for row in AFTER])
def test_where_a_word_is_entered(name: str, events: dict[str, object], relation: dict[str, object], frame: int) -> None:
    made = with_events(replace(MOVED, **events))  # type: ignore[arg-type]
    assert truth.enter(made, replace(PLAIN, **relation)) == frame, name  # type: ignore[arg-type]


# --- how two words relate


Position = tuple[float, float, float]


def moving(wrist: dict[int, Position], shape: float = 0.0, events: Events = MOVED) -> IsolatedWord:
    """A word whose strong wrist moves straight between positions at given frames, all finger angles at ``shape``."""
    states = np.zeros((66, pose.SIZE))
    frames = sorted(wrist)
    for axis in range(3):
        states[:, axis] = np.interp(np.arange(66), frames, [wrist[f][axis] for f in frames])
    states[:, pose.FINGERS] = shape
    return replace(word("I"), states=states, events=events)


HANG, HERE = (-26.0, -40.0, 4.0), (-10.0, 0.0, 25.0)


def straight(end: Position, start: Position, shape: float = 0.0) -> IsolatedWord:
    return moving({5: HANG, 20: start, 30: end, 40: end, 60: HANG}, shape)


def test_near_is_within_45_percent_of_the_shoulder_width() -> None:
    p = straight(HERE, HERE)
    for widths, near in ((0.44, True), (0.46, False)):
        away = (HERE[0] + 36.0 * widths, *HERE[1:])
        assert truth.relate(p, straight(away, away)).near is near
    tall = replace(STANDARD, stature_cm=204.0)
    away = (HERE[0] + 36.0 * 0.5, *HERE[1:])
    assert truth.relate(replace(p, signer=tall), straight(away, away)).near, "of a broader signer"


def test_handshapes_differ_by_the_mean_of_their_angles() -> None:
    for shape, other in ((0.41, False), (0.43, True), (-0.43, True)):
        assert truth.relate(straight(HERE, HERE), straight(HERE, HERE, shape)).other_shape is other


@pytest.mark.parametrize(
    ("movement", "alignment"),
    [((8.0, 0.0, 0.0), 2), ((-8.0, 0.0, 0.0), 0), ((0.0, 8.0, 0.0), 1), ((0.5, 0.0, 0.0), 1)],
)
def test_alignment_is_by_the_angle_to_the_travel(movement: Position, alignment: int) -> None:
    """The travel is along +x; movements of less than 1.5 cm have no direction."""
    away = (HERE[0] + 20.0, HERE[1], HERE[2])
    x, y, z = movement
    start, end = (HERE[0] - x, HERE[1] - y, HERE[2] - z), (away[0] + x, away[1] + y, away[2] + z)
    leaving = truth.relate(straight(HERE, start), straight(away, away))
    entering = truth.relate(straight(HERE, HERE), straight(end, away))
    assert (leaving.leaving, leaving.entering) == (alignment, 1)
    assert (entering.leaving, entering.entering) == (1, alignment)


def test_retraction_and_preparation_are_compared_halfway() -> None:
    high, low = (HERE[0], 20.0, HERE[2]), (HERE[0], -18.0, HERE[2])
    falling = truth.relate(straight(high, high), straight(low, low))
    assert (falling.going_down, falling.coming_up) == (2, 0), "down is towards a low position; up from rest is not"
    rising = truth.relate(straight(low, low), straight(high, high))
    assert (rising.going_down, rising.coming_up) == (0, 2)


# --- the transition


@pytest.mark.parametrize(("a", "b"), PAIRS[::3])
def test_a_transition_continues_both_words_smoothly(a: str, b: str) -> None:
    """The wrists' velocity changes at the seams no more than within the two words, or than in a fast reversal."""
    p, q = word(a), word(b)
    sentence = running.utter([p, q], changes=False)
    (true,) = sentence.seams
    velocity = np.diff(seen_from_chest(sentence.clip, "LeftHand", "RightHand")[1], axis=0)
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max(axis=-1)  # [i] around frame i + 1
    isolated = max(np.linalg.norm(np.diff(wrists(w), n=2, axis=0), axis=-1).max() for w in (p, q))
    first, stop = true.pre, true.pre + len(true.states) + 1
    for seam in (first, stop):
        assert change[seam - 1] < max(1.2 * isolated, 1.5), "cm per frame per frame"
    step = np.linalg.norm(velocity, axis=-1).max(axis=-1)
    assert step[[first, stop - 1]].max() < 1.1 * step.max()
    local_quats = sentence.clip.local_rotations
    cosine = np.abs(np.sum(local_quats[1:] * local_quats[:-1], axis=-1))
    assert np.rad2deg(2.0 * np.arccos(np.minimum(cosine, 1.0))).max() < 75.0, "degrees per frame"


def test_transitions_stay_out_of_the_body_and_within_limits() -> None:
    for a, b in PAIRS[::4]:
        true = splice(a, b)
        assert penetration(true.states, STANDARD)[0].max() < 0.5, (a, b)
        assert over_limit(pose.rotations(true.states, STANDARD)[0]) == 0.0, (a, b)


def test_longer_travel_takes_no_fewer_frames() -> None:
    p = word("I")
    start = p.states[p.events.end]
    counts = []
    for travel in np.linspace(0.0, 40.0, 30):
        end = start.copy()
        end[1] += travel
        counts.append(truth.transition_frames(start, end, p))
    assert counts == sorted(counts)
    assert counts[-1] > counts[0] + 3
    law = 0.74 * (0.051 + 0.149 * np.log2(1.0 + 40.0 / 36.0 / 0.15))
    assert counts[-1] == round(30.0 * law) - 1


def test_weak_hand_and_fingers_can_need_more_frames() -> None:
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


def test_a_transition_without_collisions_is_a_reach() -> None:
    p, q = word("YOU"), word("fs-A")
    true = truth.splice(p, q)
    reach = trajectory.reach(
        p.states[true.pre - 2 : true.pre + 1], q.states[true.post : true.post + 3], len(true.states), STANDARD
    )
    assert np.array_equal(true.states, reach)


def test_clearing_a_transition_leaves_its_ends_near_the_words() -> None:
    """Both words press a little; the middle of the path comes out of the body, its ends continue from them."""
    signer = replace(STANDARD, arch=0.0)
    p = replace(word("MY"), signer=signer)
    a = p.states[p.events.end].copy()
    a[2] -= 0.3
    b = a.copy()
    b[1] -= 12.0
    assert penetration(a[None], signer)[0].max() > 0.25
    before, after = np.repeat(a[None], 3, axis=0), np.repeat(b[None], 3, axis=0)
    made = truth.transition(before, after, p)
    moved = np.linalg.norm(made - trajectory.reach(before, after, len(made), signer), axis=-1)
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
