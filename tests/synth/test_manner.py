"""Traits of manner: each changes what its signer does, none does so at size 0, and the documentation lists them."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from signing import SIGNS, signer_of
from signsplice.signer import planner
from signsplice.signer.signer import PLAIN, TRAITS, USUAL, Manner, draw_signer, stream
from signsplice_workshop.corpora.training_data import keep_traits

WORDS = ("MOTHER", "MORE", "LEARN", "UNDERSTAND", "NAME", "HELLO")


@pytest.mark.parametrize("trait", TRAITS)
def test_each_trait_changes_some_word(trait: str) -> None:
    signer = signer_of(None, keep_traits(USUAL, (trait,)))

    def changes(take: int, gloss: str) -> bool:
        plain = planner.synthesize_word(SIGNS[gloss], replace(signer, manner=PLAIN), take).states
        states = planner.synthesize_word(SIGNS[gloss], signer, take).states
        return states.shape != plain.shape or bool(np.abs(states - plain).max() > 1e-3)

    assert any(changes(take, gloss) for take, gloss in product(range(5), WORDS))


def test_a_trait_of_size_zero_is_plain() -> None:
    assert keep_traits(USUAL, ()) == PLAIN == Manner(**dict.fromkeys(TRAITS, 0.0))


def test_a_new_trait_at_the_end_leaves_the_other_draws_alone() -> None:
    manner = draw_signer(3).manner
    assert manner == draw_signer(3).manner
    assert 0.0 <= manner.low_pass_frames <= 2.5
    assert all(0.5 <= getattr(manner, trait) <= 1.5 for trait in TRAITS[1:])
    shorter, longer = (stream("draws").uniform(0.5, 1.5, n) for n in (len(TRAITS) - 1, len(TRAITS)))
    assert np.array_equal(shorter, longer[:-1])


def test_the_documentation_lists_every_trait() -> None:
    text = (Path(__file__).parents[2] / "workshop" / "docs" / "corpus.md").read_text()
    assert [trait for trait in TRAITS if f"`{trait}`" not in text] == []
