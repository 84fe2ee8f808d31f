"""Hands and fingers differ in place and time, a base hand comes when it comes, haste falls short; touches stay."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from signing import sign, signer_of
from signsplice.motion import FloatArray
from signsplice.signer import notation, planner, pose, trajectory, two_hands
from signsplice.signer.collisions import TOUCH_CM, hand_clearances, penetration
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import PLAIN, STANDARD, USUAL, Signer
from signsplice.signer.timing import SignTake
from signsplice_workshop.corpora import truth
from signsplice_workshop.corpora.training_data import keep_traits

MINE = ("hand_difference", "finger_stagger", "undershoot", "base_lag")


@cache
def made(gloss: str, *traits: str, take: int = 0, seed: int | None = None) -> IsolatedWord:
    """A word by a signer with some usual traits alone."""
    return planner.synthesize_word(sign(gloss), replace(signer_of(seed), manner=keep_traits(USUAL, traits)), take)


def written(*lines: str, hands: str = "one", signer: Signer = STANDARD) -> IsolatedWord:
    text = f"WORD hands={hands}\n" + "".join(f"  {line}\n" for line in lines)
    return planner.synthesize_word(notation.parse(text)["WORD"], signer)


def apart(one: IsolatedWord) -> FloatArray:
    """How far the weak wrist is from the mirror image of the strong one, cm, (n, 3), from first to last posture."""
    strong, weak = np.moveaxis(pose.hands(one.states)[one.events.start : one.events.end + 1, :, pose.WRIST], 1, 0)
    return np.asarray(weak - strong)


def half_times(fingers: FloatArray) -> FloatArray:
    """Frames (k,) at which each of the numbers (n, k) that change by over 0.4 is half way."""
    change = fingers[-1] - fingers[0]
    moving = np.abs(change) > 0.4
    progress = ((fingers - fingers[0]) / np.where(moving, change, 1.0))[:, moving]
    after = (progress >= 0.5).argmax(axis=0)
    k = np.arange(progress.shape[1])
    low, high = progress[after - 1, k], progress[after, k]
    return np.asarray(after - 1 + (0.5 - low) / (high - low))


# --- plain


@pytest.mark.parametrize("gloss", ["MORE", "LEARN", "UNDERSTAND"])
def test_a_plain_manner_changes_nothing(gloss: str) -> None:
    one = made(gloss)
    take = SignTake(one.sign, one.signer, 0, 30.0)
    assert two_hands.with_separate_timing(one.states, take, one.events) is one.states
    assert planner.short_cm(1.0, one.signer) == 0.0


@pytest.mark.parametrize(
    ("gloss", "trait"), [("MOTHER", "hand_difference"), ("MOTHER", "base_lag"), ("MORE", "base_lag")]
)
def test_a_trait_leaves_other_kinds_of_signs_alone(gloss: str, trait: str) -> None:
    assert np.array_equal(made(gloss).states, made(gloss, trait).states)


# --- two hands


def test_hands_of_a_symmetric_sign_are_a_few_centimetres_apart() -> None:
    plain, real = (
        [
            np.median(np.linalg.norm(apart(made(gloss, *traits, take=take)), axis=-1))
            for gloss in FREE
            for take in (0, 1)
        ]
        for traits in ((), ("hand_difference",))
    )
    assert max(plain) < 0.5
    assert 1.0 < np.median(real) < 3.0
    assert max(real) < 5.0


FREE = ("HOUSE", "BIG", "GAME", "WHAT")


def test_one_hand_lags_by_a_frame_or_two() -> None:
    lags = []
    for take in range(4):
        one = made("BIG", "hand_difference", take=take)
        e = one.events
        strong, weak = np.moveaxis(pose.hands(one.states)[e.up : e.down, :, pose.WRIST], 1, 0)
        best = []
        for lag in np.arange(-3.0, 3.01, 0.25):
            frames = np.arange(4, len(strong) - 4)
            later = np.stack([np.interp(frames - lag, np.arange(len(strong)), x) for x in strong.T], axis=1)
            best.append((float(np.var(weak[4:-4] - later, axis=0).sum()), lag))
        lags.append(min(best)[1])
    assert 0.5 <= np.median(np.abs(lags)) <= 2.0
    assert len(set(lags)) > 1, "each take has its own"


def test_the_difference_varies_slowly() -> None:
    for gloss in ("HOUSE", "BIG"):
        plain, real = apart(made(gloss)), apart(made(gloss, "hand_difference"))
        jerk = np.abs(np.diff(real - plain, n=3, axis=0)).max()
        assert jerk < 1.5, "cm a frame cubed"


@pytest.mark.parametrize("gloss", ["MORE", "MEET", "BOOK"])
@pytest.mark.parametrize("take", [0, 1])
def test_mirrored_hands_touch_as_before(gloss: str, take: int) -> None:
    plain, real = made(gloss, take=take), made(gloss, *MINE, take=take)
    inside = slice(plain.events.start, plain.events.end + 1)
    before, after = (hand_clearances(one.states[inside], one.signer)[:, [0, 1, 3]] for one in (plain, real))
    touching = before < 0.2
    assert touching.any()
    assert after[touching].max() < TOUCH_CM
    assert penetration(real.states, real.signer)[0].max() < 0.25


def test_rest_stays_as_it_was() -> None:
    for gloss in ("BIG", "LEARN", "MEET"):
        plain, real = made(gloss), made(gloss, "hand_difference", "base_lag")
        for frames in (slice(0, plain.events.up + 1), slice(plain.events.down, None)):
            assert np.allclose(plain.states[frames], real.states[frames], atol=1e-9)


# --- fingers

OPENS = ("X shape=S at=space-high palm=fwd fingers=up", "M shape=5 shift=0,4,0", "M shape=S shift=0,-4,0", "H")


def test_fingers_of_a_changing_handshape_move_each_in_its_own_time() -> None:
    spreads = []
    for name in ("a", "b", "c", "d"):
        halves = []
        for manner in (PLAIN, keep_traits(USUAL, ("finger_stagger",))):
            one = written(*OPENS, signer=replace(STANDARD, name=name, manner=manner))
            begin, stop = one.events.start, one.events.end
            middle = begin + int(np.argmin(one.states[begin:stop, 6 + 5]))
            halves.append(half_times(one.states[begin : middle + 1, pose.FINGERS][:, :16]))
        assert np.ptp(halves[0]) < 0.5
        spreads.append(np.ptp(halves[1]))
    assert 0.6 < np.mean(spreads) < 2.5


def test_letters_are_formed_at_their_hold() -> None:
    for letter in "ABFRWY8":
        one = made(f"fs-{letter}", *MINE)
        formed = one.states[one.events.start + 2 : one.events.end - 1, pose.FINGERS]
        assert np.allclose(formed, HANDSHAPES[letter].angles, atol=1e-9)


def seams() -> list[tuple[FloatArray, FloatArray]]:
    glosses = ("MOTHER", "YES", "BOOK", "fs-A", "UNDERSTAND", "NO", "fs-W", "HELLO")
    words = [made(gloss) for gloss in glosses]
    return [
        (p.states[p.events.end - 2 : p.events.end + 1], q.states[q.events.start : q.events.start + 3])
        for p, q in zip(words, (*words[1:], words[0]), strict=True)
    ]


def staggered(
    before: FloatArray, after: FloatArray, n: int = 39, name: str = "standard", amount: float = 1.0
) -> FloatArray:
    signer = replace(STANDARD, name=name, manner=replace(PLAIN, finger_stagger=amount))
    return trajectory.reach(before, after, n, signer)


def test_fingers_of_transitions_form_at_different_times() -> None:
    fractions, spreads = [], []
    for before, after in seams():
        made_ = np.concatenate([before[-1:], staggered(before, after), after[:1]])
        halves = half_times(made_[:, pose.FINGERS]) / 40.0
        fractions += halves.tolist()
        spreads.append(np.ptp(halves) if len(halves) else 0.0)
    low, high = np.percentile(fractions, (5, 95))
    assert low < 0.40
    assert high > 0.52
    assert np.median(spreads) > 0.05


@pytest.mark.parametrize("amount", [1.0, 1.5])
def test_staggered_fingers_of_a_reach_never_reverse(amount: float) -> None:
    for before, after in seams():
        held, reached = (np.repeat(x[None], 3, axis=0) for x in (before[-1], after[0]))
        made_ = np.concatenate([before[-1:], staggered(held, reached, amount=amount), after[:1]])[:, pose.FINGERS]
        steps = np.diff(made_, axis=0) * np.sign(made_[-1] - made_[0])
        assert steps.min() > -1e-9


def test_a_reach_depends_smoothly_on_its_sides_and_on_the_signer() -> None:
    before, after = seams()[1]
    first = staggered(before, after)
    assert np.array_equal(first, staggered(before, after))
    assert np.abs(staggered(before + 1e-7, after) - first).max() < 1e-5, "machines round differently"
    assert np.abs(staggered(before, after, name="other") - first).max() > 0.01


def test_a_staggered_reach_continues_both_motions() -> None:
    rng = np.random.default_rng(1)
    before, after = seams()[2]
    rush = np.outer(np.arange(3), 0.02 * rng.standard_normal(pose.SIZE))
    before, after = before + rush, after - rush[::-1]
    n = 400
    plain, own = (
        np.concatenate([before[-1:], made_, after[:1]])
        for made_ in (trajectory.reach(before, after, n, replace(STANDARD, manner=PLAIN)), staggered(before, after, n))
    )
    at_ends = np.abs(plain - own)[[1, 2, -3, -2]].max()
    assert at_ends < 1e-4 * np.abs(plain - own).max() + 1e-4


def test_transitions_with_all_traits_are_clear_of_the_body() -> None:
    words = [made(gloss, *MINE, seed=3) for gloss in ("MORE", "LEARN", "HELLO", "BOOK")]
    for p, q in zip(words, (*words[1:], words[0]), strict=True):
        assert penetration(truth.splice(p, q).states, p.signer)[0].max() < truth.TOO_DEEP_CM


# --- haste


@pytest.mark.parametrize(("tempo", "least", "most"), [(0.8, 0.2, 0.5), (1.0, 0.3, 0.8), (1.6, 1.5, 2.0)])
def test_haste_leaves_movements_millimetres_to_centimetres_short(tempo: float, least: float, most: float) -> None:
    signer = replace(STANDARD, manner=keep_traits(USUAL, ("undershoot",)))
    assert least <= planner.short_cm(tempo, signer) <= most


def test_signs_at_the_forehead_are_lower_in_haste_and_movements_shorter() -> None:
    lines = ("X shape=B at=forehead off=4 palm=fwd fingers=up-in", "M at=space-out off=0", "H")
    heights, lengths = [], []
    for tempo in (0.8, 1.5):
        states = []
        for manner in (PLAIN, keep_traits(USUAL, ("undershoot",))):
            one = written(*lines, signer=replace(STANDARD, tempo=tempo, manner=manner))
            states.append(one.states[[one.events.start, one.events.end], :3])
        plain, real = states
        heights.append(plain[0, 1] - real[0, 1])
        lengths.append(np.linalg.norm(plain[1] - real[1]))
    assert 0.2 < heights[0] < 1.0 < heights[1] < 2.2
    assert 0.2 < lengths[0] < 0.8 < lengths[1] < 2.1


@pytest.mark.parametrize("gloss", ["MOTHER", "KNOW", "FATHER", "MEET", "LEARN"])
def test_haste_does_not_undo_a_touch(gloss: str) -> None:
    signer = replace(STANDARD, tempo=1.5, manner=PLAIN)
    plain, real = (
        planner.synthesize_word(sign(gloss), one)
        for one in (signer, replace(signer, manner=keep_traits(USUAL, ("undershoot",))))
    )
    for one, other in ((plain.events.start, real.events.start), (plain.events.end, real.events.end)):
        before, after = (hand_clearances(x.states[[k]], x.signer)[0] for x, k in ((plain, one), (real, other)))
        assert (after[before < TOUCH_CM] < TOUCH_CM).all()


# --- a base hand


def test_a_base_hand_comes_in_its_own_time() -> None:
    def arrival(one: IsolatedWord) -> float:
        weak = one.states[:, 27:30]
        away = np.linalg.norm(weak - weak[one.events.start + 1], axis=-1)[: one.events.start + 1]
        return float(one.events.start - np.flatnonzero(away > 3.0)[-1])

    shifts = [
        arrival(made(gloss, take=take)) - arrival(made(gloss, "base_lag", take=take))
        for gloss, take in (("LEARN", 0), ("WRITE", 0), ("STOP", 0), ("STAND", 0), ("NICE", 0), ("HELP", 0))
    ]
    assert max(np.abs(shifts)) <= 0.15 * 30.0 + 1.0
    assert np.mean(np.abs(shifts)) > 0.6
    assert len(set(shifts)) > 2


@pytest.mark.parametrize("gloss", ["LEARN", "WRITE", "STOP", "NICE", "STAND", "HELP"])
def test_a_base_hand_is_there_when_it_is_touched(gloss: str) -> None:
    plain, real = made(gloss), made(gloss, *MINE)
    inside = slice(plain.events.start, plain.events.end + 1)
    before, after = (hand_clearances(one.states[inside], one.signer)[:, 3] for one in (plain, real))
    assert after[before < 0.3].max() < TOUCH_CM
    assert penetration(real.states, real.signer)[0].max() < 0.25


def test_a_base_hand_gives_way_by_millimetres_where_it_is_struck() -> None:
    plain, real = made("STOP"), made("STOP", "base_lag")
    given = np.linalg.norm((real.states - plain.states)[:, 27:30], axis=-1)[plain.events.start : plain.events.end + 1]
    assert 0.1 < given.max() < 0.6
    assert given[0] < 0.3 * given.max(), "before the touch it keeps its place"


# --- past the shoulder


def test_a_hand_that_comes_back_past_its_shoulder_is_not_thrown_forward() -> None:
    before, after = (np.zeros((3, pose.SIZE)) for _ in range(2))
    before[:, 27:30] = [(-11.2, 3.2, 24.1), (-11.1, 5.5, 24.8), (-11.1, 8.3, 21.7)]
    after[:, 27:30] = (-25.4, -39.9, 4.2)
    thrown, kept = (
        trajectory.reach(before, after, 9, replace(STANDARD, manner=manner))[:, 29].max() - 24.8
        for manner in (PLAIN, USUAL)
    )
    assert thrown > 25.0
    assert kept < 20.0
