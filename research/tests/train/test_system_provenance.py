"""What a bundle of a system of the paper says of its origin."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")

from signsplice.splicing.networks.bundle import read_config
from signsplice.train import provenance
from signsplice_paper.train import training
from training_toys import ALONE, corpus


def test_a_paper_bundle_names_its_command_and_its_arrays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "paper_graphs", lambda *_: {})
    pairs = corpus()
    config = training.Training("lpt-wa", "smoke", steps=0)
    training.make(config, pairs, tmp_path / "bundle", tmp_path / "parts", ALONE)
    stored = read_config(tmp_path / "bundle").stored
    assert stored["command"] == [
        *("signsplice-paper", "train-system", "--pairs", pairs.folder.name, "--system", "lpt-wa", "--scale", "smoke"),
        *("--optimiser", "adamw", "--split", "random", "--steps", "0", "--seed", "0"),
    ]
    assert set(stored["data"]) == {path.name for path in pairs.folder.iterdir()}
    assert stored["data"]["pairs.npy"] == provenance.sha256(pairs.folder / "pairs.npy")
