"""Corpora of version 1, and of version 2 with one frame a word, are judged like any other."""

from __future__ import annotations

import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import GOLDEN

from signing import sign
from signsplice_paper import protocol
from signsplice_paper.prediction import Prediction
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs

RECIPE = Recipe(tuple(map(sign, ("I", "MOTHER", "BOOK", "YES"))), fps=15.0, n_other=5, truth="word")


def true_answer(pairs: Pairs, number: int) -> Prediction:
    pre, post, frames = pairs.truth(number)
    return Prediction(pre, post, frames.astype(np.float64))


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    """Version 1, made at commit c5abc78a609a948fbc99a3267faac73027bdb4d9.

    `synth pairs --words 3 --other-signer 2 --fps 10`.
    """
    folder: Path = tmp_path_factory.mktemp("old") / "pairs"
    with zipfile.ZipFile(GOLDEN / "corpus_v1.zip") as archive:
        archive.extractall(folder)
    return Pairs(folder)


@pytest.fixture(scope="module")
def by_word(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    return Pairs(write_pairs(RECIPE, tmp_path_factory.mktemp("word") / "pairs", processes=1))


def test_the_truth_of_both_versions_has_perfect_positions(old: Pairs, by_word: Pairs) -> None:
    for made in (old, by_word):
        chosen = protocol.choose(made, "random", "train", limit=3)
        assert protocol.judge(partial(true_answer, made), made, chosen).scores["paa"] == 1.0
