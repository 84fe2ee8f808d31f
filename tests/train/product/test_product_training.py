"""The product's own networks: from signing to a bundle that runs, on signers that were held back, and gone on with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")

from click.testing import CliRunner

from signing import word
from signsplice.cli import app
from signsplice.errors import InputError
from signsplice.splicing.bundle import read_facts, write_bundle
from signsplice.splicing.learned import LearnedCutter, LearnedDuration, WordReader, open_sessions
from signsplice.synth import training_data
from signsplice.train import checkpoint, log
from signsplice.train.prefetch import prefetched
from signsplice.train.product import training, warm_start
from signsplice.train.product.cut_data import CutDataset
from training_toys import ALONE, data


@pytest.fixture(scope="module")
def signing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("own") / "signing"
    training_data.write(training_data.TrainingDataPlan(2, 3, 3, seed=8), folder, processes=1)
    return folder


def test_networks_learn_and_meet_in_a_bundle(signing: Path, tmp_path: Path) -> None:
    bundle = tmp_path / "bundle"
    training.make(training.ProductTraining("transition", "smoke", steps=2), [signing], bundle, ALONE)
    assert list(read_facts(bundle)["files"]) == ["bridge.onnx"]
    called = CliRunner().invoke(
        app, ["train", "cutter", "--signing", str(signing), "--out", str(bundle), "--scale", "smoke", "--steps", "2"]
    )
    assert called.exit_code == 0, called.output
    facts = read_facts(bundle)
    assert list(facts["networks"]) == ["cutter", "transition"]
    assert sorted(facts["files"]) == ["bridge.onnx", "cut.onnx", "duration.onnx", "word.onnx"]
    assert facts["networks"]["cutter"]["steps"] == 2
    learned, held = facts["networks"]["cutter"]["signers"], facts["networks"]["cutter"]["held_back"]
    assert learned
    assert held
    assert not set(learned) & set(held)
    reader = WordReader(open_sessions(bundle))
    cut = LearnedCutter(reader).cut(word("MOTHER").clip, word("BOOK").clip)
    assert LearnedDuration(reader).seconds(word("MOTHER").clip, word("BOOK").clip, cut) > 0.0
    folder = next((tmp_path / "parts").glob("cutter-*"))
    before = (folder / log.NAME).read_text()
    training.make(training.ProductTraining("cutter", "smoke", steps=2), [signing], bundle, ALONE)
    assert (folder / log.NAME).read_text() == before, "what has learned does not learn again"


def test_a_training_goes_on_from_the_weights_of_another(signing: Path, tmp_path: Path) -> None:
    training.make(training.ProductTraining("cutter", "smoke", steps=2), [signing], tmp_path / "first", ALONE)
    (begins,) = (tmp_path / "parts").iterdir()
    training.make(
        training.ProductTraining("cutter", "smoke", steps=1), [signing], tmp_path / "second", ALONE, earlier=[begins]
    )
    begun = checkpoint.read(begins)
    assert read_facts(tmp_path / "second")["networks"]["cutter"]["begins_with"] == begun["recipe"]
    (later,) = (folder for folder in (tmp_path / "parts").iterdir() if folder != begins)
    after = checkpoint.read(later)
    assert (begun["step"], after["step"]) == (2, 1)
    fresh = training.build(
        training.ProductTraining("cutter", "smoke"), CutDataset(sorted(signing.glob("*.npz")))
    ).state_dict()

    def way(one: dict[str, Any], other: dict[str, Any]) -> float:
        return sum(float((one[name] - other[name]).abs().sum()) for name in one)

    assert 0.0 < way(begun["network"], after["network"]) < 0.2 * way(begun["network"], fresh)
    with pytest.raises(InputError, match=r"checkpoint.pt: cannot be read"):
        training.make(
            training.ProductTraining("transition", "smoke", steps=1), [signing], tmp_path / "b", ALONE, earlier=[begins]
        )
    with pytest.raises(InputError, match=r"nowhere/checkpoint.pt: cannot be read"):
        training.make(
            training.ProductTraining("cutter", "smoke"),
            [signing],
            tmp_path / "b",
            ALONE,
            earlier=[tmp_path / "nowhere"],
        )


def test_a_training_goes_on_from_a_bundle(signing: Path, tmp_path: Path) -> None:
    first = tmp_path / "first"
    training.make(training.ProductTraining("cutter", "smoke", steps=2), [signing], first, ALONE)
    (part,) = (tmp_path / "parts").iterdir()
    network = training.build(
        training.ProductTraining("cutter", "smoke"), CutDataset(sorted(signing.glob("*.npz")))
    ).network
    found = warm_start.find_warm_start(first, "cutter", training.FILES["cutter"])
    name, _, kept = found.recipe.partition("@")
    assert name == checkpoint.read(part)["recipe"]
    facts = read_facts(first)
    write_bundle(tmp_path, facts, dict.fromkeys(facts["files"], b"other"))
    assert warm_start.find_warm_start(tmp_path, "cutter", training.FILES["cutter"]).recipe.partition("@")[::2] != (
        name,
        kept,
    )
    warm_start.load(network, [(first / name).read_bytes() for name in training.FILES["cutter"]], first)
    weights = checkpoint.read(part)["network"]
    for weight, values in network.state_dict().items():
        assert values.equal(weights[f"network.{weight}"]), weight
    training.make(
        training.ProductTraining("cutter", "smoke", steps=1), [signing], tmp_path / "second", ALONE, earlier=[first]
    )
    assert read_facts(tmp_path / "second")["networks"]["cutter"]["begins_with"] == found.recipe
    with pytest.raises(InputError, match=r"first/bundle.json: tells of no transition, so that it cannot be gone on"):
        training.make(
            training.ProductTraining("transition", "smoke", steps=1), [signing], tmp_path / "b", ALONE, earlier=[first]
        )
    wide = training.build(training.ProductTraining("cutter", "ship"), CutDataset(sorted(signing.glob("*.npz")))).network
    with pytest.raises(InputError, match=r"first: holds no weights named .* of such a size"):
        warm_start.load(wide, [(first / name).read_bytes() for name in training.FILES["cutter"]], first)


def test_of_several_trainings_the_mean_is_gone_on_with(signing: Path, tmp_path: Path) -> None:
    for seed in (0, 1):
        training.make(training.ProductTraining("cutter", "smoke", seed, steps=2), [signing], tmp_path / "b", ALONE)
    parts = sorted((tmp_path / "parts").iterdir())
    one, other = (checkpoint.read(part)["network"] for part in parts)
    task = training.build(training.ProductTraining("cutter", "smoke"), CutDataset(sorted(signing.glob("*.npz"))))
    warm_start.begin(task, [warm_start.find_warm_start(part, "cutter", training.FILES["cutter"]) for part in parts])
    for name, values in task.state_dict().items():
        assert values.allclose(0.5 * (one[name] + other[name]), atol=1e-6), name
    given = [argument for part in parts for argument in ("--from", str(part))]
    arguments = ["train", "cutter", "--signing", str(signing), "--out", str(tmp_path / "mean"), "--scale", "smoke"]
    called = CliRunner().invoke(app, [*arguments, *given, "--steps", "0"])
    assert called.exit_code == 0, called.output
    told = read_facts(tmp_path / "mean")["networks"]["cutter"]
    assert told["begins_with"] == "+".join(checkpoint.read(part)["recipe"] for part in parts)
    assert (told["steps"], set(told["scores"]) >= {"both", "within_2"}) == (0, True)
    warm_start.load(
        task.network, [(tmp_path / "mean" / name).read_bytes() for name in training.FILES["cutter"]], tmp_path
    )
    for name, values in task.state_dict().items():
        assert values.allclose(0.5 * (one[name] + other[name]), atol=1e-6), "no step is the mean itself"
    refused = CliRunner().invoke(app, [*arguments, "--steps", "0"])
    assert "--steps 0, expected at least 1" in str(refused.exception)


def test_what_cannot_be_trained_is_refused(signing: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="0 signers, expected at least 2; `signsplice synth endless` makes them"):
        training.make(training.ProductTraining("cutter", "smoke"), [tmp_path], tmp_path / "b", ALONE)
    with pytest.raises(InputError, match="no network 'cutter' at scale 'huge', expected one of cutter, transition"):
        training.make(training.ProductTraining("cutter", "huge"), [signing], tmp_path / "b", ALONE)


def test_batches_made_ahead_are_the_same() -> None:
    plain = data()
    with prefetched(plain) as made:
        assert len(made) == len(plain)
        for step in (0, 1, 2, 5):
            rows = made.rows(step, 4, 0)
            one, other = made.batch(rows, step), plain.batch(plain.rows(step, 4, 0), step)
            assert one.step == other.step == step
            assert (one.x == other.x).all()
            assert one.numbers.tolist() == other.numbers.tolist()
