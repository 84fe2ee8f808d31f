"""SPSN word by word: all pairs at once, one pair as SPSN reads it, and words that were never taught."""

from __future__ import annotations

from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from torch import Tensor  # noqa: E402

from signsplice_paper.train.networks.spsn import NONE, POST, PRE  # noqa: E402
from signsplice_paper.train.networks.word_spsn import (  # noqa: E402
    DEVIATION_FLOOR,
    FINE,
    NEAREST,
    WordSpsn,
    WordSpsnConfig,
)
from signsplice_paper.train.tasks import find_positions  # noqa: E402
from signsplice_paper.train.words_data import load_card_words, load_split_words  # noqa: E402
from signsplice_workshop.corpora.readable import Card  # noqa: E402
from system_toys import CONFIGS, SPACE, data, toy  # noqa: E402
from training_toys import corpus  # noqa: E402


@pytest.fixture
def network() -> WordSpsn:
    made = toy("spsn-words").network
    assert isinstance(made, WordSpsn)
    return made.eval()


def test_all_pairs_at_once_have_the_positions_of_each_pair_alone(network: WordSpsn) -> None:
    pairs = data().batch(range(8))
    words = load_split_words(corpus(), "random", "train")
    whole = words.batch(range(len(words)))
    with torch.no_grad():
        frames, emitted = find_positions(network(pairs.x, pairs.n_before, pairs.mask), pairs.mask)
        leave, enter = network.pair_scores(whole.x, whole.mask)
    assert emitted.all()
    row = {number: k for k, number in enumerate(words.numbers)}
    for k, number in enumerate(pairs.numbers.tolist()):
        p, q = (row[word] for word in corpus().index[number, :2].tolist())
        assert frames[k, 0] == leave[p, q].argmax()
        assert frames[k, 1] - pairs.n_before[k] == enter[p, q].argmax()


def test_positions_lie_in_their_word_and_padding_changes_nothing(network: WordSpsn) -> None:
    one = data().batch(range(3))
    with torch.no_grad():
        logits = network(one.x, one.n_before, one.mask)
        for k in range(3):
            n, length = int(one.n_before[k]), int(one.mask[k].sum())
            alone = network(one.x[k : k + 1, :length], one.n_before[k : k + 1])[0]
            torch.testing.assert_close(logits[k, :length], alone, atol=1e-4, rtol=1e-4)
            assert (alone[n:, PRE] < alone[n:, NONE]).all()
            assert (alone[:n, POST] < alone[:n, NONE]).all()


def joints_of(word: int, scale: float = 1.0) -> Tensor:
    """The joints (1, T, J, 3) of a word, of a body so many times as large."""
    numbers = torch.from_numpy(np.array(corpus().word(word)))
    joints: Tensor = scale * numbers.reshape(1, len(numbers), -1, 3)
    return joints


def test_measures_are_of_bent_fingers_and_arms_and_of_hands_to_body_and_each_other(network: WordSpsn) -> None:
    measures, names = network.measures, [name.rpartition(":")[2] for name in SPACE.joints]
    assert measures is not None
    chains = [[names[joint] for joint in chain] for chain in measures.chains]
    assert ["LeftHandIndex3", "LeftHandIndex2", "LeftHandIndex1", "LeftHand"] in chains
    assert ["RightHand", "RightForeArm", "RightArm", "RightShoulder"] in chains
    gaps = [{names[a], names[b]} for a, b in measures.gaps]
    for pair in ({"RightHandIndex3", "HeadTop_End"}, {"RightHand", "LeftHand"}, {"LeftHand", "RightForeArm"}):
        assert pair in gaps
    assert not any("Leg" in name or "Foot" in name for pair in gaps for name in pair)
    joints = joints_of(0)
    found, _ = measures(joints)
    assert found.shape == (1, joints.shape[1], measures.count)
    reach, rest = found[..., : len(chains)], found[..., len(chains) :]
    assert ((reach > 0.0) & (reach <= 1.0 + 1e-5)).all(), "as far as its bones are long at most"
    a, b = measures.gaps[0]
    gap = (joints[0, :, a] - joints[0, :, b]).norm(dim=-1)
    torch.testing.assert_close(rest[0, :, 0].exp(), gap + NEAREST)


def test_the_reach_of_a_chain_is_that_of_a_larger_body(network: WordSpsn) -> None:
    assert network.measures is not None
    n_chains = len(network.measures.chains)
    one, larger = (network.measures(joints_of(0, scale))[0] for scale in (1.0, 1.3))
    torch.testing.assert_close(one[..., :n_chains], larger[..., :n_chains])
    assert not torch.allclose(one[..., n_chains:], larger[..., n_chains:]), "gaps and speeds are larger"


def test_the_height_of_hands_is_among_what_is_read_finely(network: WordSpsn) -> None:
    assert network.measures is not None
    joints = joints_of(0)
    sideways, raised = torch.tensor([0.2, 0.0, 0.2]), torch.tensor([0.0, 0.005, 0.0])
    waves, moved, higher = (network.measures(joints + by)[1] for by in (torch.zeros(3), sideways, raised))
    assert waves.shape == (1, joints.shape[1], network.measures.n_fine)
    assert waves.abs().max() <= 1.0
    torch.testing.assert_close(moved, waves, atol=1e-2, rtol=0.0)
    changed = ((higher - waves).abs() > 0.02).any(1)[0]
    assert changed.float().mean() == 1 / len(FINE), "a centimetre changes the waves of both heights, and no other"


def test_measures_have_mean_0_and_deviation_1_over_the_words_that_are_taught(network: WordSpsn) -> None:
    words = load_split_words(corpus(), "random", "train").words
    assert network.measures is not None
    count, n_fine = network.measures.count, network.measures.n_fine
    seen = torch.cat([network.features(word[None])[0, :, -n_fine - count : -n_fine] for word in words])
    torch.testing.assert_close(seen.mean(0), torch.zeros(count), atol=1e-3, rtol=0.0)
    moving = network.deviation > DEVIATION_FLOOR
    torch.testing.assert_close(seen.std(0)[moving], torch.ones(int(moving.sum())), atol=1e-2, rtol=0.0)
    assert moving.float().mean() > 0.5
    stored = network.state_dict()
    assert {"mean", "deviation"} <= set(stored), "what they were fitted to goes with the weights"


def test_lengths_that_never_change_on_the_taught_body_are_not_amplified_on_another(network: WordSpsn) -> None:
    assert network.measures is not None
    constant = network.deviation <= DEVIATION_FLOOR
    assert constant.any()
    other = network.measures(joints_of(0, 1.05))[0]
    assert ((other - network.mean) / network.deviation)[..., constant].abs().max() < 2.0


def test_padding_gives_finite_numbers(network: WordSpsn) -> None:
    assert torch.isfinite(network.features(torch.zeros(2, 5, SPACE.n_numbers))).all()


def test_without_a_skeleton_nothing_is_measured() -> None:
    config = replace(cast(WordSpsnConfig, CONFIGS["spsn-words"][0]), parents=(), hands=())
    bare = WordSpsn(config, data().normaliser())
    bare.fit_measures(load_split_words(corpus(), "random", "train").words)
    assert (bare.measures, len(bare.mean)) == (None, 0)
    assert bare.features(torch.zeros(1, 4, SPACE.n_numbers)).shape[-1] == 2 * SPACE.n_numbers + len(SPACE.joints)


def test_a_score_depends_on_the_partner(network: WordSpsn) -> None:
    words = load_split_words(corpus(), "random", "train").batch(range(4))
    with torch.no_grad():
        leave, enter = network.pair_scores(words.x, words.mask)
    assert not torch.allclose(leave[0, 1], leave[0, 2])
    assert not torch.allclose(enter[1, 0], enter[2, 0])


def test_batches_are_of_one_signer_and_repeat_by_seed_and_step() -> None:
    words = load_split_words(corpus(), "random", "train")
    assert words.rows(3, 4, 0).tolist() == words.rows(3, 4, 0).tolist()
    assert words.rows(3, 4, 0).tolist() != words.rows(4, 4, 0).tolist()
    assert len({corpus().signer(words.numbers[row]) for row in words.rows(0, 100, 0)}) == 1


def with_cards() -> Any:
    """A corpus of two words of one signer, whose cuts follow from their cards, and of one pair of them."""
    card = asdict(Card(2, 3, 5, 7, 9, False, False, False, False, False, False, False))
    return SimpleNamespace(
        head={"words": [{"card": card}, {"card": card}]},
        word=corpus().word,
        signer=lambda _: 0,
        split=lambda *_: [0],
        index=np.array([[0, 1, 4, 4, 0, 6]]),
    )


def test_pairs_that_are_held_back_are_not_taught() -> None:
    words = load_card_words(with_cards(), [[0, 1]], frozenset({(0, 1)}))
    batch = words.batch([0, 1])
    assert batch.taught.tolist() == [[True, False], [True, True]]
    assert batch.cuts[1, 0].tolist() == [7, 5]


def test_in_a_corpus_to_teach_on_any_two_words_of_a_signer_are_taught() -> None:
    found = {split: load_split_words(with_cards(), split, "train").batch([0, 1]) for split in ("random", "many")}
    assert found["random"].taught.tolist() == [[False, True], [False, False]], "the pair of the split"
    assert found["random"].cuts[0, 1].tolist() == [4, 4]
    assert found["many"].taught.all()
    assert found["many"].cuts[0, 1].tolist() == [7, 5]
