"""SPSN word by word: all pairs at once, one pair as SPSN reads it, and words that were never taught."""

from __future__ import annotations

from dataclasses import asdict
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from signsplice_paper.train.networks.spsn import NONE, POST, PRE  # noqa: E402
from signsplice_paper.train.networks.word_spsn import WordSpsn, joint_pairs  # noqa: E402
from signsplice_paper.train.tasks import positions  # noqa: E402
from signsplice_paper.train.words_data import words_of_split, words_with_cards  # noqa: E402
from signsplice_workshop.corpora.readable import Card  # noqa: E402
from system_toys import data, toy  # noqa: E402
from training_toys import corpus  # noqa: E402


@pytest.fixture
def network() -> WordSpsn:
    made = toy("spsn-words").network
    assert isinstance(made, WordSpsn)
    return made.eval()


def test_all_pairs_at_once_have_the_positions_of_each_pair_alone(network: WordSpsn) -> None:
    pairs = data().batch(range(8))
    words = words_of_split(corpus(), "random", "train")
    whole = words.batch(range(len(words)))
    with torch.no_grad():
        frames, emitted = positions(network(pairs.x, pairs.n_before, pairs.mask), pairs.mask)
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


def test_distances_show_how_far_fingers_are_bent_and_hands_are_from_the_head(network: WordSpsn) -> None:
    names = [name.rpartition(":")[2] for name in corpus().skeletons[0].names]
    pairs = [{names[a], names[b]} for a, b in joint_pairs(corpus().spaces[0].parents)]
    assert {"LeftHandIndex3", "LeftHand"} in pairs
    assert {"RightHandIndex3", "HeadTop_End"} in pairs
    assert {"RightHand", "LeftHand"} in pairs
    x = torch.from_numpy(np.array(corpus().word(0)[None, :2]))
    joints = x.reshape(1, 2, -1, 3)
    a, b = network.pairs[0]
    distance = (joints[0, :, a] - joints[0, :, b]).norm(dim=-1)
    first = network.features(x)[0, :, -len(network.pairs)]
    torch.testing.assert_close(first, 2.0 * ((distance + 5e-3).log() + 2.0))


def test_a_score_depends_on_the_partner(network: WordSpsn) -> None:
    words = words_of_split(corpus(), "random", "train").batch(range(4))
    with torch.no_grad():
        leave, enter = network.pair_scores(words.x, words.mask)
    assert not torch.allclose(leave[0, 1], leave[0, 2])
    assert not torch.allclose(enter[1, 0], enter[2, 0])


def test_batches_are_of_one_signer_and_repeat_by_seed_and_step() -> None:
    words = words_of_split(corpus(), "random", "train")
    assert words.rows(3, 4, 0).tolist() == words.rows(3, 4, 0).tolist()
    assert words.rows(3, 4, 0).tolist() != words.rows(4, 4, 0).tolist()
    assert len({corpus().signer(words.numbers[row]) for row in words.rows(0, 100, 0)}) == 1


def test_pairs_that_are_held_back_are_not_taught() -> None:
    card = asdict(Card(2, 3, 5, 7, 9, False, False, False, False, False, False, False))
    pairs = SimpleNamespace(head={"words": [{"card": card}, {"card": card}]}, word=corpus().word)
    words = words_with_cards(cast(Any, pairs), [[0, 1]], frozenset({(0, 1)}))
    batch = words.batch([0, 1])
    assert batch.taught.tolist() == [[True, False], [True, True]]
    assert batch.cuts[1, 0].tolist() == [7, 5]
