"""Every part of every system of the paper at a size that is trained in seconds."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import torch

from signsplice_paper.train import training
from signsplice_paper.train.networks.convs2s import ConvS2SConfig
from signsplice_paper.train.networks.lstm import LstmConfig
from signsplice_paper.train.networks.spsn import SpsnConfig
from signsplice_paper.train.networks.tfgn import TransformerConfig
from signsplice_paper.train.networks.word_spsn import WordSpsn, WordSpsnConfig
from signsplice_paper.train.pairs_data import PairsData
from signsplice_paper.train.scales import AS_PRINTED, Config, SystemPart, make_task
from signsplice_paper.train.words_data import load_split_words
from signsplice_workshop.train.prefetch import Dataset
from signsplice_workshop.train.tasks import Task
from training_toys import corpus

FR = 3
SPACE = corpus().spaces[0]
_T = TransformerConfig(32, 2, 1, 1, 48, 0.0)


def _of_corpus(config: WordSpsnConfig) -> Config:
    """The sizes with what is measured of the corpus's skeleton."""
    return training.fit_to_skeleton(SystemPart("spsn-words", config, None, 10, 8, 1e-2), corpus()).config


CONFIGS: dict[str, tuple[Config, int | None]] = {
    "spsn": (SpsnConfig(32, dropout=0.0), None),
    "spsn-wa": (SpsnConfig(32, attention=False, dropout=0.0), None),
    "spsn-words": (_of_corpus(WordSpsnConfig(24, 16, 0.0)), None),
    "tfgn": (_T, FR),
    "tfgn-wc": (replace(_T, marks=True), None),
    "transformer": (replace(_T, tokens=True, steps=True), None),
    "conv-s2s": (ConvS2SConfig(24, 3, 2, 0.0), None),
    "lstm": (LstmConfig(32), None),
}
CONFIGS |= {f"{name}{AS_PRINTED}": CONFIGS[name] for name in ("spsn", "conv-s2s", "lstm", "transformer")}
GENERATORS = ("tfgn", "tfgn-wc", "transformer", "conv-s2s", "lstm")


@cache
def data(part: str = "train", fr: int | None = None, split: str = "random") -> PairsData:
    """A part of the corpus."""
    return PairsData(corpus(), split, part, fr)


def toy(name: str, seed: int = 0) -> Task:
    """A part's task with fresh weights."""
    torch.manual_seed(seed)
    config, fr = CONFIGS[name]
    part = SystemPart(name, config, fr, 10, 8, 1e-2, name.endswith(AS_PRINTED))
    made = make_task(part, data().normaliser(), seed)
    if isinstance(made.network, WordSpsn):
        made.network.fit_measures(load_split_words(corpus(), "random", "train").words)
    return made


def part_toy(name: str) -> tuple[Task, Dataset, Dataset]:
    """A part's task with fresh weights, what it learns from, and what it is validated on."""
    config, fr = CONFIGS[name]
    if isinstance(config, WordSpsnConfig):
        return toy(name), load_split_words(corpus(), "random", "train"), load_split_words(corpus(), "random", "valid")
    return toy(name), data("train", fr), data("valid", fr)
