"""The ground truth of a splice: equation 17 exactly, each rule in numbers, and transitions that fit both words."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from signing import seen_from_chest, word, wrists
from signsplice.errors import InputError
from signsplice.signer import pose, trajectory
from signsplice.signer.collisions import penetration
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import STANDARD
from signsplice_workshop.corpora import sentences, truth
from signsplice_workshop.corpora.touches import SeenEvents
from signsplice_workshop.measure.corpus_checks import over_limit

GLOSSES = ("I", "MOTHER", "HELLO", "BOOK", "LEARN", "SIGN", "YES", "YOU", "fs-A")
PAIRS = [(a, b) for a, b in itertools.product(GLOSSES, repeat=2) if a != b]
FAR = replace(truth.ANY_PARTNER, travel_cm=1e6)
"""A partner so far away, and across, that only alignments matter."""


@cache
def splice(a: str, b: str) -> truth.Splice:
    return truth.splice(word(a), word(b))


# --- equation 17


@pytest.mark.parametrize(("a", "b"), [("I", "LEARN"), ("MOTHER", "BOOK"), ("fs-A", "SIGN"), ("BOOK", "YES")])
def test_outside_the_transition_all_frames_are_isolated_frames(a: str, b: str) -> None:
    p, q = word(a), word(b)
    true = truth.splice(p, q)
    sentence = sentences.utter([p, q], changes=False)
    n = len(true.states)
    new_rotations, new_roots = pose.rotations(true.states, p.signer)
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
        assert 2 <= len(true.states) <= 24, (a, b)


def strong_path(one: IsolatedWord, first: int, last: int) -> float:
    """Path of the strong wrist between two frames, cm on the standard body."""
    steps = np.diff(one.states[min(first, last) : max(first, last) + 1, pose.WRIST], axis=0)
    return float(np.linalg.norm(steps, axis=-1).sum()) / one.signer.scale


@pytest.mark.parametrize("seed", [None, 3])
def test_no_target_posture_is_cut_into_beyond_the_undershoot(seed: int | None) -> None:
    """Where partners ask for most, a first or last movement loses a frame at most, and so about 0.5 cm of its path."""
    most = replace(FAR, leaving=1.0, entering=1.0, going_down=-1.0, coming_up=-1.0)
    n_cut = 0
    for gloss in ("FRIEND", "TOMORROW", "RAIN", "BIG", "GRANDMOTHER", "FOR", "IDEA", "HOME", "LEARN", "SIGN", "MY"):
        one = word(gloss, seed)
        pre, post = truth.find_leave_frame(one, most), truth.find_enter_frame(one, most)
        if one.events.passes:
            _, stop = truth.find_last_kept_pass(one)
            left = strong_path(one, min(pre, stop), stop)
            assert stop - pre <= 1, gloss
            assert left <= 0.7, gloss
            n_cut += pre < stop
        if one.events.first is not None:
            begin, _ = one.events.first
            gone = strong_path(one, begin, max(post, begin))
            assert post - begin <= 1, gloss
            assert gone <= 0.7, gloss
    assert n_cut >= 1, "some are undershot"


def test_undershoot_leaves_out_three_percent_of_the_path_and_half_a_centimetre() -> None:
    def left(share: float) -> float:
        return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)

    for path in (2.0, 8.0, 15.0, 30.0, 80.0):
        assert left(truth.compute_undershoot(path, path)) * path <= min(0.5, 0.03 * path) + 1e-3
        assert truth.compute_undershoot(path, 0.0) * path <= min(0.5, 0.03 * path) + 1e-3, "a circle keeps its speed"
        assert truth.compute_undershoot(path, 0.0) < truth.compute_undershoot(path, path)
    assert truth.compute_undershoot(15.0, 15.0) > 0.14


def test_both_cut_frames_depend_on_both_words() -> None:
    left = {a: {splice(a, b).pre for b in GLOSSES if b != a} for a in GLOSSES}
    entered = {b: {splice(a, b).post for a in GLOSSES if a != b} for b in GLOSSES}
    assert sum(len(frames) > 1 for frames in left.values()) >= 3, left
    assert sum(len(frames) > 1 for frames in entered.values()) >= len(GLOSSES) // 2, entered


def test_by_word_each_word_has_frames_of_its_own() -> None:
    left = {a: {truth.find_cut(word(a), word(b), partner=False)[0] for b in GLOSSES} for a in GLOSSES}
    entered = {b: {truth.find_cut(word(a), word(b), partner=False)[1] for a in GLOSSES} for b in GLOSSES}
    assert all(len(frames) == 1 for frames in (*left.values(), *entered.values()))
    true = truth.splice(word("I"), word("BOOK"), partner=False)
    assert ({true.pre}, {true.post}) == (left["I"], entered["BOOK"])
    made = sentences.utter([word("I"), word("BOOK")], changes=False, partner=False)
    assert np.array_equal(made.seams[0].states, true.states)
    assert np.array_equal(made.clip.local_rotations[: true.pre + 1], word("I").clip.local_rotations[: true.pre + 1])


def test_kinds_of_truth_are_checked() -> None:
    assert truth.by_partner("partner")
    assert not truth.by_partner("word")
    with pytest.raises(InputError, match="no truth 'both', expected one of partner, word"):
        truth.by_partner("both")


MOVED = SeenEvents(5, 20, 42, 62, (20, 30), ((20, 30),), False, False, gap_first_cm=20.0, gap_last_cm=20.0)
"""X M H: rest to 5, up to 20, moves to 30, held to 42, down to 62."""
LONGER = {"passes": ((20, 35),), "end": 50}
TURNED = {"passes": ((20, 30), (36, 46)), "end": 52}
BEFORE = [
    # a letter: 0.6 of its hold of 22 frames, 0.17 more before another shape
    ("a hold alone", {"passes": (), "first": None}, {"shape_change": 0.0}, 33),
    ("a hold alone, another shape", {"passes": (), "first": None}, {"shape_change": 0.9}, 37),
    ("a short hold alone keeps a frame", {"passes": (), "first": None, "end": 21}, {}, 21),
    # a long hold is deleted: 0.15 of the movement's frames, less across and opposed, none near the skin
    ("held, along", {}, {"leaving": 1.0}, 29),
    ("held, a longer movement, along", LONGER, {"leaving": 1.0}, 33),
    ("held, a longer movement", LONGER, {}, 34),
    ("held, a longer movement, opposed", LONGER, {"leaving": -1.0}, 34),
    ("held at the skin, along", {"gap_last_cm": 0.4}, {"leaving": 1.0}, 30),
    ("held near the skin, along", {"gap_last_cm": 2.5}, {"leaving": 1.0}, 30),
    ("held at 3 cm, along", {"gap_last_cm": 3.0}, {"leaving": 1.0}, 29),
    # a hold of 0.2 s stays to three fifths
    # without a hold 0.22 of the retraction's twenty frames, 0.12 more along and less opposed
    ("a short hold", {"end": 36, "down": 56}, {}, 36),
    ("free", {"end": 30, "down": 50}, {}, 34),
    ("free, towards the next", {"end": 30, "down": 50}, {"going_down": 1.0}, 37),
    ("free, away from the next", {"end": 30, "down": 50}, {"going_down": -1.0}, 32),
    ("free, the next near", {"end": 30, "down": 50}, {"travel_cm": 3.0}, 32),
    # a repeated movement loses a pass; it turns there
    ("twice", TURNED, {}, 30),
    ("twice, at the skin", TURNED | {"gap_last_cm": 0.0}, {}, 30),
    ("thrice", {"passes": ((20, 24), (26, 30), (32, 36))}, {}, 30),
    ("circles all stay", {"passes": ((20, 30), (30, 40))}, {"leaving": 1.0}, 46),
]


def at_one_speed(events: SeenEvents) -> IsolatedWord:
    """A word that moves straight by 12 cm from frame 20 to 30, with given events."""
    return straight((2.0, 0.0, 25.0), HERE, events=events)


@pytest.mark.parametrize(("name", "events", "relation", "frame"), BEFORE, ids=[row[0] for row in BEFORE])
def test_where_a_word_is_left(name: str, events: dict[str, object], relation: dict[str, object], frame: int) -> None:
    made = at_one_speed(replace(MOVED, **events))  # type: ignore[arg-type]
    assert truth.find_leave_frame(made, replace(FAR, **relation)) == frame, name  # type: ignore[arg-type]


AFTER = [
    # no hold first: 0.24 of the fifteen frames up are kept, 0.11 more along and less opposed
    ("free", {}, {}, 16),
    ("free, opposed", {}, {"coming_up": -1.0}, 18),
    ("free, along", {}, {"coming_up": 1.0}, 15),
    ("free, near", {}, {"travel_cm": 3.0}, 18),
    # held first (frames 15 to 20), then a movement of ten frames: at most 0.2 of it left out, none near the skin
    ("held", {"start": 15}, {}, 21),
    ("held, a longer movement, along", {"start": 15, "first": (20, 35)}, {"entering": 1.0}, 22),
    ("held, a longer movement, opposed", {"start": 15, "first": (20, 35)}, {"entering": -1.0}, 21),
    ("held at the skin", {"start": 15, "gap_first_cm": 0.0}, {"entering": 1.0}, 20),
    # no movement at all
    ("a hold alone", {"first": None, "passes": ()}, {}, 20),
]


@pytest.mark.parametrize(("name", "events", "relation", "frame"), AFTER, ids=[row[0] for row in AFTER])
def test_where_a_word_is_entered(name: str, events: dict[str, object], relation: dict[str, object], frame: int) -> None:
    made = at_one_speed(replace(MOVED, **events))  # type: ignore[arg-type]
    assert truth.find_enter_frame(made, replace(FAR, **relation)) == frame, name  # type: ignore[arg-type]


def test_events_without_skin_distances_have_no_truth() -> None:
    with pytest.raises(ValueError, match="without skin distances"):
        truth.find_leave_frame(at_one_speed(replace(MOVED, gap_last_cm=None)), FAR)


# --- how two words relate


Position = tuple[float, float, float]


def moving(wrist: dict[int, Position], shape: float = 0.0, events: SeenEvents = MOVED) -> IsolatedWord:
    """A word whose strong wrist moves straight between positions at given frames, all finger angles at ``shape``."""
    states = np.zeros((66, pose.SIZE))
    frames = sorted(wrist)
    for axis in range(3):
        states[:, axis] = np.interp(np.arange(66), frames, [wrist[f][axis] for f in frames])
    states[:, pose.FINGERS] = shape
    return replace(word("I"), states=states, events=events)


HANG, HERE = (-26.0, -40.0, 4.0), (-10.0, 0.0, 25.0)


def straight(end: Position, start: Position, shape: float = 0.0, events: SeenEvents = MOVED) -> IsolatedWord:
    return moving({5: HANG, 15: start, 20: start, 30: end, 45: end, 60: HANG}, shape, events)


def test_travel_is_measured_on_the_standard_body() -> None:
    p, away = straight(HERE, HERE), (HERE[0] + 18.0, *HERE[1:])
    near = truth.relate(p, straight(away, away)).travel_cm
    assert near == pytest.approx(18.0, rel=0.1)
    tall = replace(STANDARD, stature_cm=1.2 * STANDARD.stature_cm)
    assert truth.relate(replace(p, signer=tall), straight(away, away)).travel_cm < near


def test_the_change_of_shape_is_the_mean_of_the_angles() -> None:
    for shape in (0.0, 0.41, -0.43):
        change = truth.relate(straight(HERE, HERE), straight(HERE, HERE, shape)).shape_change
        assert change == pytest.approx(abs(shape))


@pytest.mark.parametrize(
    ("movement", "low", "high"),
    [
        ((8.0, 0.0, 0.0), 0.25, 1.0),
        ((-8.0, 0.0, 0.0), -1.0, -0.25),
        ((0.0, 8.0, 0.0), -0.1, 0.1),
        ((0.5, 0.0, 0.0), 0.0, 0.1),
    ],
)
def test_alignment_is_by_the_angle_to_the_travel(movement: Position, low: float, high: float) -> None:
    """The travel is along +x; short movements have hardly a direction."""
    away = (HERE[0] + 20.0, HERE[1], HERE[2])
    x, y, z = movement
    start, end = (HERE[0] - x, HERE[1] - y, HERE[2] - z), (away[0] + x, away[1] + y, away[2] + z)
    leaving = truth.relate(straight(HERE, start), straight(away, away))
    entering = truth.relate(straight(HERE, HERE), straight(end, away))
    assert low <= leaving.leaving <= high
    assert leaving.entering == pytest.approx(0.0, abs=1e-9)
    assert low <= entering.entering <= high
    assert entering.leaving == pytest.approx(0.0, abs=1e-9)


def test_retraction_and_preparation_are_compared_halfway() -> None:
    high, low = (HERE[0], 20.0, HERE[2]), (HERE[0], -18.0, HERE[2])
    falling = truth.relate(straight(high, high), straight(low, low))
    assert falling.going_down > 0.4, "down is towards a low position"
    assert falling.coming_up < -0.2, "up from rest is not"
    rising = truth.relate(straight(low, low), straight(high, high))
    assert rising.going_down < -0.2
    assert rising.coming_up > 0.4


def test_what_is_seen_changes_the_relation_continuously() -> None:
    """Over a circle of partners no number of a relation jumps, wherever one lies."""
    p = straight(HERE, (HERE[0] - 10.0, HERE[1], HERE[2]))
    rows = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 181):
        at = (HERE[0] + 15.0 * float(np.cos(angle)), HERE[1] + 15.0 * float(np.sin(angle)), HERE[2])
        relation = truth.relate(p, straight(at, at, 0.1 * float(angle)))
        rows.append((relation.leaving, relation.going_down, relation.coming_up, relation.shape_change))
    assert np.abs(np.diff(rows, axis=0)).max() < 0.04
    assert np.ptp(rows, axis=0)[:2].min() > 0.5


def test_a_small_error_of_reading_moves_a_cut_by_a_frame_at_most() -> None:
    rng = np.random.default_rng(0)
    moved, n_moved = [], 0
    for a, b in PAIRS:
        p, q = word(a), word(b)
        seen = []
        for one in (p, q):
            states = one.states.copy()
            states[:, pose.WRIST] += rng.normal(0.0, 0.2, states[:, pose.WRIST].shape)
            seen.append(replace(one, states=states))
        distance = np.abs(np.subtract(truth.find_cut(seen[0], seen[1]), truth.find_cut(p, q)))
        moved.append(int(distance.max()))
        n_moved += bool(distance.any())
    assert max(moved) <= 1
    assert n_moved <= 0.1 * len(PAIRS)


# --- the transition


@pytest.mark.parametrize(("a", "b"), PAIRS[::3])
def test_a_transition_continues_both_words_smoothly(a: str, b: str) -> None:
    """The wrists' velocity changes at the seams no more than within the two words, or than in a fast reversal."""
    p, q = word(a), word(b)
    sentence = sentences.utter([p, q], changes=False)
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
        assert penetration(true.states, word(a).signer)[0].max() < 0.5, (a, b)
        assert over_limit(pose.rotations(true.states, word(a).signer)[0]) == 0.0, (a, b)


def test_longer_travel_takes_no_fewer_frames() -> None:
    p = word("I")
    start = p.states[p.events.end]
    counts = []
    for travel in np.linspace(0.0, 40.0, 30):
        end = start.copy()
        end[1] += travel
        counts.append(truth.count_transition_frames(start, end, p))
    assert counts == sorted(counts)
    assert counts[-1] > counts[0] + 3
    law = 0.74 * (0.051 + 0.149 * np.log2(1.0 + 40.0 / 36.0 / 0.15))
    assert counts[-1] == round(30.0 * law) - 1


def test_weak_hand_and_fingers_can_need_more_frames() -> None:
    p = word("I")
    start = p.states[p.events.end]
    least = truth.count_transition_frames(start, start, p)
    assert least == 2
    weak, shaped = start.copy(), start.copy()
    weak[28] += 40.0
    shaped[pose.FINGERS] += 1.5
    strong = start.copy()
    strong[1] += 40.0
    assert least < truth.count_transition_frames(start, weak, p) < truth.count_transition_frames(start, strong, p)
    assert truth.count_transition_frames(start, shaped, p) == round(30.0 * (0.09 + 0.15)) - 1
    assert truth.count_transition_frames(start, shaped, replace(p, signer=replace(STANDARD, tempo=2.0))) < 6


def test_a_transition_without_collisions_is_a_reach() -> None:
    p, q = word("YOU"), word("fs-A")
    true = truth.splice(p, q)
    reach = trajectory.reach(
        p.states[true.pre - 2 : true.pre + 1], q.states[true.post : true.post + 3], len(true.states), p.signer
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
    made = truth.make_transition(before, after, p)
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
            sentences.utter([word("MOTHER"), word("YOU"), other])
