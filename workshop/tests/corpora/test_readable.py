"""The truth that can be read: each word's events are seen in its motion, and the partner chooses among them."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import kinematics
from signsplice.signer import notation
from signsplice.signer.signer import STANDARD, draw_signer
from signsplice_workshop.corpora import readable, truth
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.corpora.readable import Card
from signsplice_workshop.corpora.readable_pairs import (
    FIRST_SIGNER,
    FIRST_TAUGHT,
    SIGNERS_A_SEED,
    JudgedCorpus,
    OwnMannerCorpus,
    TaughtCorpus,
    hash_recipe,
    write_readable,
)
from signsplice_workshop.measure import corpus_page

SIGNS = notation.everyday()
LOW = Card(15, 15, 20, 30, 36, False, False, False, False, False, False, False)
HIGH = replace(LOW, raised=12, high_first=True, high_last=True)


@pytest.mark.parametrize(
    ("p", "q", "frame"),
    [
        (LOW, LOW, LOW.stroke_end),
        (LOW, HIGH, LOW.stroke_end),
        (LOW, replace(LOW, two_first=True), LOW.hold_end),
        (LOW, replace(LOW, open_first=True), LOW.hold_end),
        (LOW, replace(HIGH, open_first=True), LOW.stroke_end),
        (replace(LOW, two_last=True), replace(HIGH, two_first=True), LOW.stroke_end),
    ],
)
def test_a_hold_stays_for_other_hands_or_another_shape_at_the_same_height(p: Card, q: Card, frame: int) -> None:
    assert readable.find_leave_frame(p, q) == frame


@pytest.mark.parametrize(
    ("p", "q", "frame"),
    [
        (LOW, LOW, LOW.stroke),
        (replace(LOW, touches_last=True), LOW, LOW.posture),
        (LOW, HIGH, HIGH.raised),
        (replace(LOW, touches_last=True), HIGH, HIGH.raised),
        (HIGH, HIGH, HIGH.stroke),
        (HIGH, LOW, LOW.stroke),
    ],
)
def test_a_word_is_entered_where_the_hand_rises_or_comes_off_the_skin(p: Card, q: Card, frame: int) -> None:
    assert readable.find_enter_frame(p, q) == frame


@pytest.mark.parametrize("seed", [None, 505])
def test_holds_are_seen_where_the_signer_planned_them_and_an_error_of_a_tenth_mm_moves_none(seed: int | None) -> None:
    signer = STANDARD if seed is None else draw_signer(seed)
    signs = [SIGNS[gloss] for gloss in ("MOTHER", "HELP", "SCHOOL", "FATHER")]
    made = [both for sign in signs if (both := readable.make_word(sign, signer))]
    assert made
    rng = np.random.default_rng(0)
    for word, card in made:
        holds = (card.posture, card.stroke, card.stroke_end, card.hold_end)
        events = word.events
        assert events.first is not None
        planned = (events.start, events.first[0], events.passes[-1][1], events.end)
        assert np.abs(np.subtract(holds, planned)).max() <= readable.PLANNED
        positions = kinematics.forward(word.clip)[1][:, readable.find_hand_joints(word.signer)[0]]
        hand = positions / signer.stature_cm - np.array([0.0, 0.5, 0.0])
        assert readable.find_holds(hand, readable.STILL_MARGIN) == holds
        noisy = hand + rng.normal(0.0, 0.01 / signer.stature_cm, hand.shape)
        assert readable.find_holds(noisy) == holds


def test_a_word_that_circles_from_the_first_frame_on_cannot_be_read() -> None:
    still = np.zeros((40, 6, 3))
    still[:, :, 1] = 0.3
    assert readable.find_holds(still) is None, "one hold alone has no stroke between"
    moving = still.copy()
    moving[:, :, 0] = 0.01 * np.arange(40)[:, None]
    assert readable.find_holds(moving) is None


def test_a_transition_has_the_frames_of_its_class_or_none_near_a_border() -> None:
    states = np.zeros((2, 65))
    frames = []
    for distance in (0.05, readable.TRAVEL[0], 0.2, readable.TRAVEL[1] + 0.003, 0.4):
        states[1, 0] = distance * STANDARD.stature_cm
        frames.append(readable.count_transition_frames(states[0], states[1], STANDARD))
    assert frames == [6, None, 9, None, 12]


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    folder = tmp_path_factory.mktemp("readable") / "pairs"
    recipe = JudgedCorpus(tuple(list(SIGNS.values())[:16]), n_known=4, n_unseen=3, n_signers=2, n_pairs=8)
    return Pairs(write_readable(recipe, folder, processes=1))


def test_tests_are_of_other_pairs_words_and_signers_than_training(corpus: Pairs) -> None:
    def parts(split: str) -> tuple[set[str], set[int], set[tuple[int, int]]]:
        index = corpus.index[corpus.split(split, "test"), :2].tolist()
        pairs = {(p, q) for p, q in index}
        return {corpus.gloss(k) for pair in pairs for k in pair}, {corpus.signer(p) for p, _ in index}, pairs

    train = corpus.index[corpus.split("random", "train"), :2].tolist()
    taught = {corpus.gloss(k) for pair in train for k in pair}
    assert not parts("random")[2] & {(p, q) for p, q in train}
    assert parts("unseen-words")[1] == {0}
    assert not parts("unseen-words")[0] & taught
    assert parts("unseen-signer")[1] <= {1, 2}
    assert parts("unseen-signer")[0] <= taught
    assert not parts("unseen-both")[0] & taught
    assert 0 not in parts("unseen-both")[1]


def test_the_truth_of_a_corpus_follows_from_its_cards(corpus: Pairs) -> None:
    assert len(corpus) > 20
    for p, q, pre, post, _, count in corpus.index.tolist():
        cards = [Card(**corpus.head["words"][k]["card"]) for k in (p, q)]
        assert (pre, post) == (readable.find_leave_frame(*cards), readable.find_enter_frame(*cards))
        assert count in readable.LENGTHS


def test_utterances_go_on_without_a_jump(corpus: Pairs) -> None:
    for number in range(0, len(corpus), 5):
        steps = np.abs(np.diff(corpus.utterance(number), axis=0)).max(axis=1)
        assert steps.max() < 0.06, corpus.clip(number).name


def test_a_corpus_is_made_again_bit_for_bit_and_is_no_other(corpus: Pairs, tmp_path: Path) -> None:
    recipe = TaughtCorpus(n_signers=2, n_words=2, n_pairs=2)
    folders = [write_readable(recipe, tmp_path / name, processes=1) for name in ("one", "two")]
    assert all((folders[0] / path.name).read_bytes() == path.read_bytes() for path in folders[1].iterdir())
    taught = Pairs(folders[0])
    assert {taught.signer(p) for p in taught.index[taught.split("many", "valid"), 0].tolist()} == {1}
    assert taught.head["hash"] != corpus.head["hash"]


@pytest.mark.parametrize("slack", [0, 3])
def test_cuts_of_signers_in_their_own_manner_lie_outside_the_stroke(slack: int, tmp_path: Path) -> None:
    recipe = OwnMannerCorpus(n_signers=2, n_words=3, n_pairs=4, slack=slack)
    pairs = Pairs(write_readable(recipe, tmp_path / "pairs", processes=1))
    assert pairs.head["hash"] != hash_recipe(TaughtCorpus(n_signers=2, n_words=3, n_pairs=4))
    for row in pairs.head["words"]:
        card, events = row["card"], row["events"]
        assert card["stroke"] == max(events["first"][0] - slack, 0)
        assert card["stroke_end"] == events["passes"][-1][1] + slack
    assert len(pairs)
    for p, q, pre, post, _, _ in pairs.index.tolist():
        before, after = (pairs.head["words"][k]["events"] for k in (p, q))
        assert pre >= before["passes"][-1][1] + slack
        assert post <= after["first"][0] - slack


def test_too_few_readable_signs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"1 of 1 signs can be read, expected 5"):
        write_readable(JudgedCorpus((SIGNS["MOTHER"],), n_known=4, n_unseen=1), tmp_path / "pairs", processes=1)


def test_a_transition_whose_elbow_would_be_too_fast_is_not_valid() -> None:
    word, card = readable.make_word(SIGNS["MOTHER"], STANDARD) or (None, None)
    assert word is not None
    assert card is not None
    held = word.states[card.posture : card.posture + 3]
    assert truth.synthesize_transition(9, held, held, word)[1]
    assert not truth.synthesize_transition(1, word.states[:3], held, word)[1]


def test_such_a_corpus_is_not_measured_beside_real_signing(corpus: Pairs) -> None:
    with pytest.raises(InputError, match="its truth is of kind events"):
        corpus_page.measure_corpus(corpus, None, {}, lambda _: nullcontext())


def test_no_signer_that_is_judged_is_taught_by_another_seed() -> None:
    judged = {FIRST_SIGNER + SIGNERS_A_SEED * seed + k for seed in range(4) for k in range(JudgedCorpus.n_signers)}
    taught = {FIRST_TAUGHT + SIGNERS_A_SEED * seed + k for seed in range(4) for k in range(TaughtCorpus.n_signers)}
    assert not judged & taught
