"""A corpus of pairs as signing: what the networks that ship are taught of it, and which splits they are judged on."""

from __future__ import annotations

import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import torch
from click.testing import CliRunner

from signsplice.cli import app
from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.paper.bundles import read_all
from signsplice.paper.judging import Judge, corpus_trained_methods
from signsplice.paper.results import CORPUS_TRAINED, Results
from signsplice.rig.canonical import canonical_motion
from signsplice.splicing import features
from signsplice.splicing.bundle import read_config
from signsplice.splicing.methods import WEIGHTS
from signsplice.synth import corpus_training_data, notation, training_data
from signsplice.synth.corpus import Pairs, Recipe, write_pairs
from signsplice.train.product import training
from signsplice.train.product.cut_data import CutDataset, CuttingTask
from signsplice.train.product.gap_data import GapDataset
from training_toys import ALONE, GLOSSES
from training_toys import corpus as slow_corpus


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    signs = notation.everyday()
    recipe = Recipe(tuple(signs[gloss] for gloss in GLOSSES), n_other=3)
    return Pairs(write_pairs(recipe, tmp_path_factory.mktemp("taught") / "pairs", processes=1))


@pytest.fixture(scope="module")
def taught(pairs: Pairs, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("taught") / "random"
    assert [path.stem.rsplit("-", 1)[1] for path in corpus_training_data.write(pairs, "random", folder)] == [
        "train",
        "valid",
    ]
    return folder


def test_a_part_holds_the_pairs_of_its_split_and_no_others(pairs: Pairs, taught: Path) -> None:
    train, valid = sorted(taught.glob("*.npz"))
    for path, name in ((train, "train"), (valid, "valid")):
        part, numbers = np.load(path), pairs.split("random", name)
        assert (str(part["corpus"]), str(part["split"])) == (pairs.head["hash"], "random")
        words = sorted(set(pairs.index[numbers, :2].ravel().tolist()))
        assert part["words"][:, 1].tolist() == [len(pairs.word_clip(word)) for word in words]
        told = {(words[p], words[q]): tuple(part["pairs"][p, q]) for p, q in np.argwhere(part["pairs"][..., 2] >= 0)}
        assert told == {(p, q): (pre, post, n) for p, q, pre, post, _, n in pairs.index[numbers].tolist()}
        assert part["seams"][:, 0].tolist() == list(range(len(numbers)))
        for (first, _), (_, start, n), number in zip(part["sentences"], part["seams"], numbers, strict=True):
            whole, (pre, post, new) = canonical_motion(pairs.clip(number)), pairs.truth(number, "rotations")
            assert n == len(new)
            begin = max(0, pre + 1 - corpus_training_data.AROUND)
            stop = pre + 1 + n + min(corpus_training_data.AROUND, len(pairs.word_clip(pairs.index[number, 1])) - post)
            assert start == pre + 1 - begin
            turns = rotation.normalize(part["turns"][first : first + stop - begin] / 32767.0)
            apart = rotation.angle_between(turns, whole.quats[begin:stop])
            np.testing.assert_allclose(apart, 0.0, atol=1e-3)


def test_what_is_no_split_to_learn_from_is_refused(pairs: Pairs, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no split first train, expected one of random"):
        corpus_training_data.write(pairs, "first", tmp_path)
    with pytest.raises(InputError, match="12 frames a second, expected 30, the networks' rate"):
        corpus_training_data.write(slow_corpus(), "random", tmp_path)
    with pytest.raises(InputError, match="valid part of split unseen-words has fewer than two words"):
        corpus_training_data.write(pairs, "unseen-words", tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: cannot be made"):
        corpus_training_data.write(pairs, "random", tmp_path / "file")
    called = CliRunner().invoke(app, ["synth", "signing", str(pairs.folder), "-o", str(tmp_path / "made")])
    assert called.exit_code == 0, called.output
    assert len(called.output.splitlines()) == len(list((tmp_path / "made").iterdir())) == 2


def test_pairs_without_a_truth_teach_nothing(taught: Path) -> None:
    seen = CutDataset(sorted(taught.glob("*train.npz")), fixed=2)
    batch = seen.batch([0, 1])
    assert 0 < int((~batch.known).sum()) < batch.known.numel()
    task = training.build(training.ProductTraining("cutter", "smoke"), seen).eval()
    assert isinstance(task, CuttingTask)
    with torch.no_grad():
        loss = task(batch)
        truth = {name: getattr(batch, name).clone() for name in ("pre", "post", "seconds")}
        for values in truth.values():
            values[~batch.known] = 1
        assert task(replace(batch, **truth)) == loss
        truth["seconds"][batch.known] *= 2.0
        assert task(replace(batch, **truth)) != loss
        nothing = task(replace(batch, known=torch.zeros_like(batch.known)))
        assert task.judge(replace(batch, known=torch.zeros_like(batch.known))) == {}
    assert 0.0 < float(nothing) < float(loss), "phases alone"


def test_what_is_seen_as_it_was_made_is_true_transitions_without_noise(taught: Path) -> None:
    paths = sorted(taught.glob("*train.npz"))
    seen, other = (GapDataset(paths, seed, as_made=True) for seed in (0, 1))
    first = {gap["true"].tobytes() for gap in map(seen.gap, range(60))}
    second = {gap["true"].tobytes() for gap in map(other.gap, range(60))}
    assert all(seen.gap(k)["seam"] for k in range(5))
    assert len(first | second) <= len(seen), "the same transitions again and again"
    words = CutDataset(paths, as_made=True)
    clean = CutDataset(paths, fixed=9)
    known = {tokens.tobytes() for k in range(9) for tokens, _ in clean.draw(k)["words"]}
    assert {tokens.tobytes() for k in range(9) for tokens, _ in words.draw(k)["words"]} <= known


def test_folders_are_drawn_from_as_often(taught: Path, tmp_path: Path) -> None:
    training_data.write(training_data.TrainingDataPlan(3, 5, 0, seed=2), tmp_path, processes=1)
    both = CutDataset([*sorted(taught.glob("*train.npz")), *sorted(tmp_path.glob("*.npz"))], as_made=True)
    assert [len(folder) for folder in both.signers] == [1, 3]
    own_words = {len(course) for course in both.signers[0][0].trajectories}
    drawn = [{round(float(t[-1, -2]) * 30.0) + 1 for t, _ in both.draw(k)["words"]} <= own_words for k in range(60)]
    assert 18 <= sum(drawn) <= 42


def test_networks_that_were_taught_are_judged_where_nothing_of_it_was_seen(
    pairs: Pairs, taught: Path, tmp_path: Path
) -> None:
    bundle = tmp_path / "bundles" / "own"
    for network in ("cutter", "transition"):
        training.make(training.ProductTraining(network, "smoke", steps=1), [taught], bundle, ALONE)
        assert read_config(bundle).networks[network].trained_on == {"corpus": pairs.head["hash"], "split": "random"}
    warnings: list[str] = []
    methods = corpus_trained_methods(read_all(bundle.parent), warnings.append)
    assert (methods[0].name, methods[0].given) == ("learned-fluent+learned", "nothing")
    assert warnings == []
    (made,) = Judge(pairs, Results(), lambda _: nullcontext()).judgements(methods[:1], [], [])
    assert [(row.split, row.scale) for row in made.rows] == [
        ("random", CORPUS_TRAINED),
        ("unseen-signer", CORPUS_TRAINED),
    ]
    assert made.rows[0].score("pta") == 1.0


def test_bundles_that_cannot_be_judged_are_passed_over(pairs: Pairs, taught: Path, tmp_path: Path) -> None:
    bundles = tmp_path / "bundles"
    for name in ("cutter", "transition"):
        training.make(training.ProductTraining(name, "smoke", steps=1), [taught], bundles / "own", ALONE)
    shutil.copytree(bundles / "own", bundles / "twice")
    shutil.copytree(WEIGHTS, bundles / "untaught")
    shutil.copytree(bundles / "own", bundles / "old")
    head = bundles / "old" / "bundle.json"
    head.write_text(head.read_text().replace(f'"features": {features.VERSION}', '"features": 1'))
    training.make(training.ProductTraining("cutter", "smoke", steps=1), [taught], bundles / "half", ALONE)
    (bundles / "bare").mkdir()
    (bundles / "bare" / "bundle.json").write_text('{"system": "signsplice"}')
    warnings: list[str] = []
    methods = corpus_trained_methods(read_all(bundles), warnings.append)
    assert {Path(str(method.bundle)).name for method in methods} == {"own"}
    assert [line.split(": ")[1].rsplit("/", 1)[1] for line in warnings] == ["half", "old", "twice"]
    assert "trained on" in warnings[2]
    assert "move one away" in warnings[2]


def test_what_was_taught_is_told_of_those_that_go_on(taught: Path, tmp_path: Path) -> None:
    other = tmp_path / "signing"
    training_data.write(training_data.TrainingDataPlan(2, 3, 0, seed=2), other, processes=1)
    training.make(training.ProductTraining("cutter", "smoke", steps=2), [taught], tmp_path / "first", ALONE)
    (earlier,) = (tmp_path / "parts").iterdir()
    training.make(
        training.ProductTraining("cutter", "smoke", steps=1), [other], tmp_path / "second", ALONE, earlier=[earlier]
    )
    assert (read_config(tmp_path / "second").networks["cutter"].trained_on or {})["split"] == "random"
    for scale in ("more", "corpus"):
        with pytest.raises(InputError, match=f"scale {scale} goes on from an earlier training"):
            training.make(training.ProductTraining("cutter", scale, steps=1), [other], tmp_path / "third", ALONE)
    with pytest.raises(InputError, match="holds no transition; name folders with seams"):
        GapDataset(sorted(other.glob("*.npz")), as_made=True)


def test_signing_of_two_splits_is_refused(pairs: Pairs, taught: Path, tmp_path: Path) -> None:
    other = tmp_path / "unseen"
    paths = corpus_training_data.write(pairs, "random", other)
    with np.load(paths[0]) as stored:
        changed = dict(stored) | {"split": np.array("unseen-words")}
    training_data.save(paths[0], changed)
    with pytest.raises(InputError, match="signing of 2 parts of corpora of pairs, expected one"):
        training.make(training.ProductTraining("cutter", "smoke", steps=1), [taught, other], tmp_path / "b", ALONE)
