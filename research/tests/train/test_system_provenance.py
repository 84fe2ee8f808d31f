"""What a bundle of a system of the paper says of its origin."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from signsplice.errors import InputError
from signsplice_paper.configs import read_config
from signsplice_paper.train import training
from signsplice_workshop.train import checkpoint, records
from training_toys import ALONE, corpus


def test_a_paper_bundle_names_its_command_and_its_arrays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "export_paper_graphs", lambda *_: {})
    pairs = corpus()
    config = training.Training("lptransformer-wa", "smoke", steps=0)
    training.make(config, pairs, tmp_path / "bundle", tmp_path / "parts", ALONE)
    stored = read_config(tmp_path / "bundle").stored
    assert stored["command"] == [
        *("signsplice-paper", "train-system", "--pairs", pairs.folder.name, "--system", "lptransformer-wa"),
        *("--scale", "smoke", "--optimiser", "adamw", "--split", "random", "--steps", "0", "--seed", "0"),
    ]
    assert set(stored["data"]) == {path.name for path in pairs.folder.iterdir()}
    assert stored["data"]["pairs.npy"] == records.hash_file(pairs.folder / "pairs.npy")


def test_a_corpus_of_equal_recipe_and_other_bytes_is_refused(tmp_path: Path) -> None:
    changed, part = tmp_path / "pairs", tmp_path / "part"
    part.mkdir()
    shutil.copytree(corpus().folder, changed)
    assert training.record_corpus_data(corpus().folder, part) == training.record_corpus_data(changed, part)
    positions = np.load(changed / "new_positions.npy")
    np.save(changed / "new_positions.npy", positions + np.float32(0.001))
    with pytest.raises(InputError, match=r"part: was trained on data in which new_positions.npy differed"):
        training.record_corpus_data(changed, part)


def test_data_of_an_older_training_are_unknown(tmp_path: Path) -> None:
    (tmp_path / checkpoint.NAME).write_bytes(b"")
    assert training.record_corpus_data(corpus().folder, tmp_path) is None
    assert not (tmp_path / training.DATA_FILE).exists()


def test_a_system_records_why_its_last_part_ended() -> None:
    ends = ["plateau", "steps"], ["time", "steps"], ["plateau"]
    assert [training.combine_reasons(of) for of in ends] == ["steps", "time", "plateau"]
