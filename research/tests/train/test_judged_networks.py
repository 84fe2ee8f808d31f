"""The product's networks, trained on a split of a corpus of pairs, are judged on what they never saw of it."""

from __future__ import annotations

import json
import shutil
from contextlib import nullcontext
from pathlib import Path

import pytest

from signsplice.signer import notation
from signsplice.splicing import features
from signsplice.splicing.options import WEIGHTS
from signsplice_paper.bundles import read_all
from signsplice_paper.evaluation import corpus_trained_methods
from signsplice_paper.judging import Judge
from signsplice_paper.results import CORPUS_TRAINED, Results
from signsplice_workshop.corpora import training_data
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs
from signsplice_workshop.train import training
from training_toys import ALONE, GLOSSES

pytest.importorskip("torch")


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    signs = notation.everyday()
    recipe = Recipe(tuple(signs[gloss] for gloss in GLOSSES), n_other=3)
    return Pairs(write_pairs(recipe, tmp_path_factory.mktemp("corpus") / "pairs", processes=1))


@pytest.fixture(scope="module")
def corpus_signing(pairs: Pairs, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The corpus's split `random` as signing to train on."""
    folder = tmp_path_factory.mktemp("corpus") / "random"
    paths = training_data.write_split(pairs, "random", folder)
    assert [path.stem.rsplit("-", 1)[1] for path in paths] == ["train", "valid"]
    return folder


@pytest.fixture(scope="module")
def bundles(corpus_signing: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one bundle, whose two networks were trained on the split for one step."""
    folder = tmp_path_factory.mktemp("trained") / "bundles"
    for network in training.NETWORKS:
        config = training.ProductTraining(network, "smoke", steps=1)
        training.make(config, [corpus_signing], folder / "own", ALONE)
    return folder


def test_networks_are_judged_on_pairs_they_never_saw(pairs: Pairs, bundles: Path) -> None:
    warnings: list[str] = []
    methods = corpus_trained_methods(read_all(bundles), warnings.append)
    assert (methods[0].name, methods[0].given) == ("learned-fluent+learned", "nothing")
    assert warnings == []
    *_, judged = Judge(pairs, Results(), lambda _: nullcontext()).judgements(
        methods[:1], [], []
    )  # mean transition and baselines first
    assert [(row.split, row.scale) for row in judged.rows] == [
        ("random", CORPUS_TRAINED),
        ("unseen-signer", CORPUS_TRAINED),
    ]
    assert judged.rows[0].score("pta") == 1.0


def test_bundles_that_cannot_be_judged_are_skipped(bundles: Path, tmp_path: Path) -> None:
    for name in ("own", "twice", "old", "half"):
        shutil.copytree(bundles / "own", tmp_path / name)
    shutil.copytree(WEIGHTS, tmp_path / "never-trained-on-it")
    head = tmp_path / "old" / "bundle.json"
    head.write_text(head.read_text().replace(f'"features": {features.VERSION}', '"features": 1'))
    head = tmp_path / "half" / "bundle.json"
    half = json.loads(head.read_text())
    del half["networks"]["transition"], half["files"]["bridge.onnx"]
    head.write_text(json.dumps(half))
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "bundle.json").write_text('{"system": "signsplice"}')
    warnings: list[str] = []
    methods = corpus_trained_methods(read_all(tmp_path), warnings.append)
    assert {Path(str(method.bundle)).name for method in methods} == {"own"}
    assert [line.split(": ")[1].rsplit("/", 1)[1] for line in warnings] == ["half", "old", "twice"]
    assert "trained on" in warnings[2]
    assert "move one away" in warnings[2]
