"""Training the product's networks on a split of a corpus of pairs, and what is refused."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import torch
from click.testing import CliRunner

from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.rig.info import canonical_motion
from signsplice.signer import notation
from signsplice.splicing.bundle import read_config
from signsplice_workshop.corpora import training_data
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs
from signsplice_workshop.train import training
from signsplice_workshop.train.cut_data import CutDataset
from signsplice_workshop.train.gap_data import GapDataset
from signsplice_workshop.train.tasks import CuttingTask
from training_toys import ALONE, GLOSSES, empty_graphs, signing
from training_toys import corpus as slow_corpus


@pytest.fixture(scope="module")
def signing_folder() -> Path:
    """A folder with two signers, of three words and three seams each."""
    return signing(2, 3, 3, 8)


@pytest.fixture
def no_export(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bundles are written with empty graphs: exporting takes most of the time of a training of few steps."""
    monkeypatch.setattr(training, "export_product_graphs", empty_graphs)


@pytest.fixture(scope="module")
def paths() -> list[Path]:
    """The file of one signer with five words."""
    return sorted(signing(1, 5, 0, 6).glob("*.npz"))


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


def test_signing_holds_the_pairs_of_its_split_and_no_others(pairs: Pairs, corpus_signing: Path) -> None:
    train, valid = sorted(corpus_signing.glob("*.npz"))
    for path, name in ((train, "train"), (valid, "valid")):
        stored, numbers = np.load(path), pairs.split("random", name)
        assert (str(stored["corpus"]), str(stored["split"])) == (pairs.head["hash"], "random")
        words = sorted(set(pairs.index[numbers, :2].ravel().tolist()))
        assert stored["words"][:, 1].tolist() == [len(pairs.word_clip(word)) for word in words]
        cuts = stored["pairs"]
        found = {(words[p], words[q]): tuple(cuts[p, q]) for p, q in np.argwhere(cuts[..., 2] >= 0)}
        assert found == {(p, q): (pre, post, n) for p, q, pre, post, _, n in pairs.index[numbers].tolist()}
        assert stored["seams"][:, 0].tolist() == list(range(len(numbers)))
        for (first, _), (_, start, n), number in zip(stored["sentences"], stored["seams"], numbers, strict=True):
            whole, (pre, post, new) = canonical_motion(pairs.clip(number)), pairs.truth(number, "rotations")
            assert n == len(new)
            begin = max(0, pre + 1 - training_data.AROUND)
            stop = pre + 1 + n + min(training_data.AROUND, len(pairs.word_clip(pairs.index[number, 1])) - post)
            assert start == pre + 1 - begin
            quats = rotation.normalize(stored["turns"][first : first + stop - begin] / 32767.0)
            np.testing.assert_allclose(rotation.angle_between(quats, whole.quats[begin:stop]), 0.0, atol=1e-3)


def test_a_corpus_or_split_that_cannot_be_trained_on_is_refused(pairs: Pairs, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no split first train, expected one of random"):
        training_data.write_split(pairs, "first", tmp_path)
    with pytest.raises(InputError, match="12 frames a second, expected 30, the networks' rate"):
        training_data.write_split(slow_corpus(), "random", tmp_path)
    with pytest.raises(InputError, match="valid part of split unseen-words has fewer than two words"):
        training_data.write_split(pairs, "unseen-words", tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: cannot be made"):
        training_data.write_split(pairs, "random", tmp_path / "file")
    called = CliRunner().invoke(app, ["synth", "signing", str(pairs.folder), "-o", str(tmp_path / "made")])
    assert called.exit_code == 0, called.output
    assert len(called.output.splitlines()) == len(list((tmp_path / "made").iterdir())) == 2


def test_pairs_without_a_truth_do_not_count(corpus_signing: Path) -> None:
    dataset = CutDataset(sorted(corpus_signing.glob("*train.npz")), n_fixed=2)
    batch = dataset.batch([0, 1])
    known = batch.has_truth
    assert 0 < int((~known).sum()) < known.numel()
    task = training.build(training.ProductTraining("cutter", "smoke"), dataset).eval()
    assert isinstance(task, CuttingTask)
    with torch.no_grad():
        loss = task(batch)
        truth = {name: getattr(batch, name).clone() for name in ("pre", "post")}
        for values in truth.values():
            values[~known] = 1
        assert task(replace(batch, **truth)) == loss
        truth["pre"][known] = 0
        assert task(replace(batch, **truth)) != loss
        without_truth = replace(batch, has_truth=torch.zeros_like(known))
        assert 0.0 < float(task(without_truth)) < float(loss), "the phases alone"
        assert task.judge(without_truth) == {}


def test_clean_gaps_are_true_transitions_without_noise(corpus_signing: Path) -> None:
    paths = sorted(corpus_signing.glob("*train.npz"))
    one, other = (GapDataset(paths, seed, clean=True) for seed in (0, 1))
    assert all(one.draw_gap(number)["seam"] for number in range(5))
    targets = {gap["true"].tobytes() for dataset in (one, other) for gap in map(dataset.draw_gap, range(60))}
    assert len(targets) <= len(one), "the same transitions again and again"


def test_clean_words_are_those_of_validation(corpus_signing: Path) -> None:
    paths = sorted(corpus_signing.glob("*train.npz"))
    clean, fixed = (
        {tokens.tobytes() for number in range(9) for tokens, _ in dataset.draw(number).words}
        for dataset in (CutDataset(paths, clean=True), CutDataset(paths, n_fixed=9))
    )
    assert clean <= fixed


def test_every_folder_is_drawn_from_equally_often(corpus_signing: Path, paths: list[Path], tmp_path: Path) -> None:
    for number in range(3):
        shutil.copy(paths[0], tmp_path / f"signer-{number}.npz")
    dataset = CutDataset([*sorted(corpus_signing.glob("*train.npz")), *sorted(tmp_path.glob("*.npz"))], clean=True)
    assert [len(folder) for folder in dataset.signers] == [1, 3]
    lengths = {len(trajectory) for trajectory in dataset.signers[0][0].trajectories}
    draws = [dataset.draw(number) for number in range(60)]
    from_corpus = [{round(float(t[-1, -2]) * 30.0) + 1 for t, _ in draw.words} <= lengths for draw in draws]
    assert 18 <= sum(from_corpus) <= 42


def test_a_bundle_says_which_split_its_networks_saw(pairs: Pairs, bundles: Path) -> None:
    networks = read_config(bundles / "own").networks
    assert [network.trained_on for network in networks.values()] == [
        {"corpus": pairs.head["hash"], "split": "random"}
    ] * 2


@pytest.mark.usefixtures("no_export")
def test_training_further_keeps_the_earlier_corpus(bundles: Path, signing_folder: Path, tmp_path: Path) -> None:
    (earlier,) = (bundles / "parts").glob("cutter-*")
    config = training.ProductTraining("cutter", "smoke", steps=1)
    training.make(config, [signing_folder], tmp_path / "second", ALONE, start_from=earlier)
    assert (read_config(tmp_path / "second").networks["cutter"].trained_on or {})["split"] == "random"


def test_scales_that_continue_a_training_need_one(corpus_signing: Path, tmp_path: Path) -> None:
    for scale in ("more", "corpus"):
        with pytest.raises(InputError, match=f"scale {scale} continues an earlier training: name its folder"):
            training.make(training.ProductTraining("cutter", scale, steps=1), [corpus_signing], tmp_path / "b", ALONE)


def test_clean_gaps_of_words_alone_are_refused(paths: list[Path]) -> None:
    with pytest.raises(InputError, match="has no transition to train on; name folders with seams"):
        GapDataset(paths, clean=True)


def test_signing_of_two_splits_is_refused(pairs: Pairs, corpus_signing: Path, tmp_path: Path) -> None:
    other = tmp_path / "unseen"
    paths = training_data.write_split(pairs, "random", other)
    with np.load(paths[0]) as stored:
        changed = dict(stored) | {"split": np.array("unseen-words")}
    training_data.save(paths[0], changed)
    config = training.ProductTraining("cutter", "smoke", steps=1)
    with pytest.raises(InputError, match="signing of 2 splits of corpora of pairs, expected one"):
        training.make(config, [corpus_signing, other], tmp_path / "b", ALONE)
