"""Baselines of positions on a truth whose events the partner chooses."""

from __future__ import annotations

from pathlib import Path

import pytest

from signsplice.signer import notation
from signsplice_paper.position_baselines import BASELINES, RuleReader, WordCuts, make_partner_classes, score_positions
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.corpora.readable_pairs import JudgedCorpus, write_readable


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    folder: Path = tmp_path_factory.mktemp("readable") / "pairs"
    recipe = JudgedCorpus(tuple(list(notation.everyday().values())[:16]), n_known=5, n_unseen=2, n_signers=1, n_pairs=6)
    return Pairs(write_readable(recipe, folder, processes=1))


def test_who_knows_the_rules_reads_every_cut_of_every_split(pairs: Pairs) -> None:
    reader = RuleReader(pairs)
    for split in pairs.head["splits"]:
        numbers = pairs.split(split, "test")
        assert score_positions(pairs, numbers, reader) == {"pre": 1.0, "post": 1.0, "exact": 1.0, "within one": 1.0}


def test_a_partner_class_seen_in_training_gives_the_true_cut(pairs: Pairs) -> None:
    """The truth depends on the partner's class alone, so a cut that is commonest beside a class is the only one
    there."""
    class_of = make_partner_classes(pairs)
    cuts = WordCuts(pairs, "random", commonest=True, classes=class_of)
    taught = pairs.index[pairs.split("random", "train"), :2].tolist()
    before = {(pairs.gloss(p), class_of(q)) for p, q in taught}
    after = {(pairs.gloss(q), class_of(p)) for p, q in taught}
    checked = 0
    for number in range(len(pairs)):
        p, q, pre, post = pairs.index[number, :4].tolist()
        if pairs.signer(p) == 0 and (pairs.gloss(p), class_of(q)) in before:
            assert cuts(number)[0] == pre
            checked += 1
        if pairs.signer(p) == 0 and (pairs.gloss(q), class_of(p)) in after:
            assert cuts(number)[1] == post
    assert checked > 10


def test_who_was_taught_a_pair_knows_it(pairs: Pairs) -> None:
    numbers = pairs.split("random", "train")
    assert score_positions(pairs, numbers, BASELINES["nearest neighbour"](pairs, "random"))["exact"] == 1.0
    assert score_positions(pairs, numbers, BASELINES["Gaussian process"](pairs, "random"))["exact"] > 0.7


def test_a_position_that_is_not_found_is_neither_exact_nor_near(pairs: Pairs) -> None:
    scores = score_positions(pairs, [0, 1], lambda _: (None, None))
    assert scores == {"pre": 0.0, "post": 0.0, "exact": 0.0, "within one": 0.0}
