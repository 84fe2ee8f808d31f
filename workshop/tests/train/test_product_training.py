"""Training the product's networks: from signing to a bundle that runs, continued from checkpoints and from bundles."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from click.testing import CliRunner  # noqa: E402

from signing import word  # noqa: E402
from signsplice.cli.commands import app  # noqa: E402
from signsplice.errors import FormatError, InputError  # noqa: E402
from signsplice.splicing.bundle import read_config  # noqa: E402
from signsplice.splicing.learned import (  # noqa: E402
    LearnedCutter,
    WordReader,
    open_sessions,
)
from signsplice_workshop.corpora import training_data  # noqa: E402
from signsplice_workshop.corpora.motion_version import MOTION_VERSION  # noqa: E402
from signsplice_workshop.train import checkpoint, records, training, warm_start  # noqa: E402  # noqa: E402
from signsplice_workshop.train.bundles import write_bundle  # noqa: E402
from signsplice_workshop.train.cut_data import CutDataset  # noqa: E402
from signsplice_workshop.train.training import ProductTraining  # noqa: E402
from training_toys import ALONE, empty_graphs, signing  # noqa: E402

TWO_STEPS = ProductTraining("cutter", "smoke", steps=2)
ONE_STEP = ProductTraining("cutter", "smoke", steps=1)
CUTTER_FILES = training.FILES["cutter"]


@pytest.fixture(scope="module")
def signing_folder() -> Path:
    """A folder with two signers, of three words and three seams each."""
    return signing(2, 3, 3, 8)


@pytest.fixture
def no_export(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bundles are written with empty graphs: exporting takes most of the time of a training of few steps."""
    monkeypatch.setattr(training, "export_product_graphs", empty_graphs)


@pytest.fixture(scope="module")
def first(signing_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle with a cutter that was trained for two steps."""
    bundle = tmp_path_factory.mktemp("first") / "bundle"
    training.make(TWO_STEPS, [signing_folder], bundle, ALONE)
    return bundle


@pytest.fixture(scope="module")
def first_part(first: Path) -> Path:
    """The folder of that training's checkpoint."""
    (part,) = (first.parent / "parts").iterdir()
    return part


def dataset(signing_folder: Path) -> CutDataset:
    return CutDataset(sorted(signing_folder.glob("*.npz")))


def test_both_networks_are_trained_into_one_bundle(signing_folder: Path, first: Path, tmp_path: Path) -> None:
    bundle = tmp_path / "bundle"
    shutil.copytree(first, bundle)
    assert sorted(read_config(bundle).files) == ["cut.onnx", "word.onnx"]
    arguments = ["--signing", str(signing_folder), "--out", str(bundle), "--scale", "smoke", "--steps", "2"]
    called = CliRunner().invoke(app, ["train", "transition", *arguments])
    assert called.exit_code == 0, called.output
    config = read_config(bundle)
    assert list(config.networks) == ["cutter", "transition"]
    assert sorted(config.files) == ["bridge.onnx", "cut.onnx", "word.onnx"]
    assert config.networks["cutter"] == read_config(first).networks["cutter"]
    facts = config.networks["transition"].stored
    assert facts["steps"] == 2
    assert facts["signers"]
    assert facts["held_back"]
    assert not set(facts["signers"]) & set(facts["held_back"])
    reader = WordReader(open_sessions(bundle))
    cut = LearnedCutter(reader).cut_all([word("MOTHER").clip, word("BOOK").clip])[0]
    assert 0 <= cut.pre < len(word("MOTHER").clip)


def test_a_bundle_names_command_seed_and_data(signing_folder: Path, first: Path) -> None:
    facts = read_config(first).networks["cutter"].stored
    assert facts["command"] == [
        *("signsplice", "train", "cutter", "--signing", "signing", "--scale", "smoke"),
        *("--steps", "2", "--seed", "0", "--device", "cpu"),
    ], "absolute paths are shortened"
    assert facts["seed"] == 0
    assert facts["data"] == {path.name: records.hash_file(path) for path in signing_folder.iterdir()}
    assert "started_from" not in facts
    assert re.fullmatch(r"[0-9a-f]{40}\+?", facts.get("commit", "0" * 40))
    assert all(name.endswith(MOTION_VERSION) for name in (*facts["signers"], *facts["held_back"]))
    assert str(first.parent) not in (first / "bundle.json").read_text()


def with_changed_file(signing_folder: Path, target: Path, number: int) -> Path:
    """A copy of a folder of signing in which one file has other content and the same name."""
    shutil.copytree(signing_folder, target)
    path = sorted(target.iterdir())[number]
    with np.load(path) as stored:
        arrays = dict(stored)
    training_data.save(path, arrays | {"places": arrays["places"] + np.float32(0.01)})
    assert [p.name for p in sorted(target.iterdir())] == [p.name for p in sorted(signing_folder.iterdir())]
    return target


@pytest.mark.usefixtures("no_export")
def test_a_training_is_found_by_the_content_of_its_data(signing_folder: Path, tmp_path: Path) -> None:
    parts = tmp_path / "parts"
    training.make(TWO_STEPS, [signing_folder], tmp_path / "first", ALONE)
    (part,) = parts.iterdir()
    lines = (part / records.LOG_FILE).read_text()
    renamed = tmp_path / "renamed"
    shutil.copytree(signing_folder, renamed)
    for path in sorted(renamed.iterdir()):
        path.rename(path.with_name(f"signer-renamed-{path.name}"))
    for folder in (signing_folder, renamed):
        training.make(TWO_STEPS, [folder], tmp_path / "again", ALONE)
        assert list(parts.iterdir()) == [part], "equal content is one training"
    assert (part / records.LOG_FILE).read_text() == lines, "which is not repeated"
    training.make(TWO_STEPS, [with_changed_file(signing_folder, tmp_path / "signing", 0)], tmp_path / "other", ALONE)
    (other,) = (folder for folder in parts.iterdir() if folder != part)
    one, two = (checkpoint.read(folder)["network"] for folder in (part, other))
    assert any(not torch.equal(one[name], two[name]) for name in one), "equal names are not"


@pytest.mark.usefixtures("no_export")
def test_changed_data_held_back_are_another_training(signing_folder: Path, first: Path, tmp_path: Path) -> None:
    training.make(TWO_STEPS, [with_changed_file(signing_folder, tmp_path / "signing", -1)], tmp_path / "bundle", ALONE)
    recipes = [read_config(bundle).networks["cutter"].recipe for bundle in (first, tmp_path / "bundle")]
    assert recipes[0] != recipes[1], "its scores are other scores"


@pytest.mark.usefixtures("no_export")
def test_training_continues_from_a_checkpoint(signing_folder: Path, first_part: Path, tmp_path: Path) -> None:
    second = tmp_path / "second"
    training.make(ONE_STEP, [signing_folder], second, ALONE, start_from=first_part)
    (later,) = (tmp_path / "parts").iterdir()
    before, after = checkpoint.read(first_part), checkpoint.read(later)
    assert (before["step"], after["step"]) == (2, 1)
    # A step of AdamW changes no weight by more than its rate, but for weight decay and rounding.
    changes = [float((before["network"][name] - after["network"][name]).abs().max()) for name in before["network"]]
    assert 0.0 < max(changes) < 1.1 * training.SCHEDULES["cutter", "smoke"].rate
    facts = read_config(second).networks["cutter"].stored
    assert facts["begins_with"] == before["recipe"]
    (start,) = facts["started_from"]
    assert (start["recipe"], start["step"]) == (before["recipe"], 2)
    assert start["command"][:3] == ["signsplice", "train", "cutter"]
    assert start["data"] == facts["data"]


@pytest.mark.usefixtures("no_export")
def test_training_continues_from_a_bundle(signing_folder: Path, first: Path, first_part: Path, tmp_path: Path) -> None:
    found = warm_start.find_warm_start(first, "cutter", CUTTER_FILES)
    recipe, _, graphs_hash = found.recipe.partition("@")
    weights = checkpoint.read(first_part)
    assert recipe == weights["recipe"]
    network = training.build(TWO_STEPS, dataset(signing_folder)).network
    warm_start.load_graphs(network, [(first / name).read_bytes() for name in CUTTER_FILES], first)
    for name, values in network.state_dict().items():
        assert values.equal(weights["network"][f"network.{name}"]), name
    second = tmp_path / "second"
    training.make(ONE_STEP, [signing_folder], second, ALONE, start_from=first)
    facts = read_config(second).networks["cutter"].stored
    assert facts["begins_with"] == found.recipe
    (start,) = facts["started_from"]
    assert start["files"] == read_config(first).files
    assert start["data"] == facts["data"]
    stored = read_config(first).stored
    write_bundle(tmp_path, stored, dict.fromkeys(stored["files"], b"other"))
    other = warm_start.find_warm_start(tmp_path, "cutter", CUTTER_FILES).recipe.partition("@")
    assert other[0] == recipe
    assert other[2] != graphs_hash, "tuned graphs are other weights"


def test_what_training_cannot_continue_from_is_refused(
    signing_folder: Path, first: Path, first_part: Path, tmp_path: Path
) -> None:
    transition = ProductTraining("transition", "smoke", steps=1)
    for config, earlier, message in (
        (transition, first_part, r"checkpoint.pt: cannot be read"),
        (transition, first, r"bundle.json: does not say how its transition was trained"),
        (ONE_STEP, tmp_path / "nowhere", r"nowhere/checkpoint.pt: cannot be read"),
    ):
        with pytest.raises(InputError, match=message):
            training.make(config, [signing_folder], tmp_path / "b", ALONE, start_from=earlier)
    wide = training.build(ProductTraining("cutter", "ship"), dataset(signing_folder)).network
    with pytest.raises(InputError, match=r"bundle: holds no weights .* of shape"):
        warm_start.load_graphs(wide, [(first / name).read_bytes() for name in CUTTER_FILES], first)


@pytest.mark.usefixtures("no_export")
def test_an_earlier_checkpoint_is_another_start(signing_folder: Path, first_part: Path, tmp_path: Path) -> None:
    early = tmp_path / "early"
    shutil.copytree(first_part, early)
    state = torch.load(early / checkpoint.NAME, weights_only=True)
    torch.save(state | {"step": 1}, early / checkpoint.NAME)
    for start in (first_part, early):
        training.make(ONE_STEP, [signing_folder], tmp_path / "bundle", ALONE, start_from=start)
    assert len(list((tmp_path / "parts").iterdir())) == 2


def test_what_cannot_be_trained_is_refused(signing_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="0 signers, expected at least 2; `signsplice synth endless` makes them"):
        training.make(ProductTraining("cutter", "smoke"), [tmp_path], tmp_path / "b", ALONE)
    arguments = ["train", "cutter", "--signing", str(signing_folder), "--out", str(tmp_path / "b"), "--steps", "0"]
    assert "--steps 0, expected at least 1" in str(CliRunner().invoke(app, arguments).exception)
    with pytest.raises(InputError, match="no network 'cutter' at scale 'huge', expected one of cutter, transition"):
        training.make(ProductTraining("cutter", "huge"), [signing_folder], tmp_path / "b", ALONE)


@pytest.mark.parametrize("network", ["cutter", "transition"])
@pytest.mark.parametrize("broken", ["no archive", "of something else"])
def test_broken_files_of_signing_are_named_in_one_line(network: str, broken: str, tmp_path: Path) -> None:
    for number in range(3):
        path = tmp_path / f"signer-{number:06}.npz"
        np.savez(path, a=np.zeros(3)) if broken == "of something else" else path.write_bytes(b"PK")
    with pytest.raises(FormatError, match=r"^\S+signer-\d+\.npz: is no valid file of signing to train on") as error:
        training.make(ProductTraining(network, "smoke"), [tmp_path], tmp_path / "b" / "c", ALONE)
    assert len(str(error.value).splitlines()) == 1


def test_a_broken_bundle_is_named_before_the_training(signing_folder: Path, tmp_path: Path) -> None:
    for content in (b"{\xff", b"{}", b'{"networks": 3}'):
        (tmp_path / "b").mkdir(exist_ok=True)
        (tmp_path / "b" / "bundle.json").write_bytes(content)
        with pytest.raises(FormatError, match=r"bundle\.json: is no (JSON|valid description of a trained system)"):
            training.make(ONE_STEP, [signing_folder], tmp_path / "b", ALONE)
        assert not [*tmp_path.rglob(checkpoint.NAME)]


@pytest.mark.usefixtures("no_export")
def test_several_folders_are_named_by_their_number(signing_folder: Path, first: Path, tmp_path: Path) -> None:
    training.make(ONE_STEP, [signing_folder, signing_folder], tmp_path / "bundle", ALONE)
    facts = json.loads((tmp_path / "bundle" / "bundle.json").read_text())["networks"]["cutter"]
    hashes = read_config(first).networks["cutter"].stored["data"]
    assert facts["data"] == {f"{number}/{name}": value for number in (1, 2) for name, value in hashes.items()}
