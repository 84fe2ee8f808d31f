"""The signer's version: words, signing and networks are of the motion that it makes today."""

from __future__ import annotations

import numpy as np
import pytest

from signing import sign
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import kinematics
from signsplice.signer import planner
from signsplice.signer.signer import STANDARD
from signsplice.splicing.bundle import WEIGHTS, read_config
from signsplice_workshop.corpora.motion_version import MOTION_VERSION, hash_motion


def test_the_signer_moves_as_its_version_says() -> None:
    assert hash_motion() == MOTION_VERSION, "set it anew, then run `make weights`, `make corpus` and `make words`"


@pytest.mark.parametrize("gloss", ["MOTHER", "BOOK", "HELLO", "NAME"])
def test_words_that_ship_are_signed_as_the_signer_signs_today(gloss: str) -> None:
    stored, signed = open_shipped_lexicon().clip(gloss), planner.synthesize_word(sign(gloss), STANDARD).clip
    assert len(stored) == len(signed)
    off = np.linalg.norm(np.subtract(*(kinematics.forward(clip)[1] for clip in (stored, signed))), axis=-1)
    assert off.max() < 0.2, "cm, as exactly as frames are stored"


def test_networks_that_ship_learned_from_the_signer_of_today() -> None:
    for facts in read_config(WEIGHTS).networks.values():
        names = (*facts.stored["signers"], *facts.stored["held_back"])
        assert all(name.endswith(f"-{MOTION_VERSION}") for name in names)
        assert facts.stored["command"]
        assert facts.stored["data"].keys() == {f"{name}.npz" for name in names}
