"""What `train` and `all` train: in rounds, in limited time, and only what is wanted."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from signsplice.errors import InputError
from signsplice_paper.cli import training
from signsplice_paper.cli.options import PaperCall, deadline_in
from signsplice_paper.plan import RIVALS, Run
from toys import corpus


def fake_training(monkeypatch: pytest.MonkeyPatch, at_most: int = 1000) -> list[list[str]]:
    """Rounds of trainings, by name; each writes bundles for its first ``at_most`` runs."""
    rounds: list[list[str]] = []

    def train(todo: Sequence[Run], call: PaperCall) -> None:
        rounds.append([run.name for run in todo])
        for number, run in enumerate(todo[:at_most]):
            (call.bundles / run.name).mkdir(parents=True)
            parts = {"frames": {"scores": {"accuracy": 0.9 - 0.01 * number}}}
            stored = {"corpus": corpus().head["hash"], "parts": parts}
            (call.bundles / run.name / "bundle.json").write_text(json.dumps(stored))

    monkeypatch.setattr(training, "_train", train)
    return rounds


def test_the_best_rival_is_trained_again_once_it_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rounds = fake_training(monkeypatch)
    call = PaperCall("cpu", corpus().folder, tmp_path)
    assert training.train_missing(call) == []
    assert len(rounds) == 2
    assert not any("seed1" in name for name in rounds[0])
    rivals = tuple(f"{system}-cpu" for system in RIVALS)
    assert [name for name in rounds[1] if name.startswith(rivals)] == [
        f"{RIVALS[0]}-cpu-adamw-random-seed{seed}" for seed in (1, 2)
    ]
    rounds.clear()
    assert training.train_missing(call) == []
    assert rounds == []


def test_what_time_left_untrained_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rounds = fake_training(monkeypatch)
    call = PaperCall("cpu", corpus().folder, tmp_path, systems=("lstm",), splits=("random",), seeds=(0,), minutes=0.0)
    left = training.train_missing(call)
    assert ([run.name for run in left], rounds) == (["lstm-cpu-adamw-random"], [])
    assert "time is up; trainings are missing: 1 (lstm-cpu-adamw-random); the same call continues" in (
        capsys.readouterr().err
    )


def test_a_choice_that_fits_nothing_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rounds = fake_training(monkeypatch)
    call = PaperCall("cpu", corpus().folder, tmp_path, systems=("lstm",), seeds=(5,))
    with pytest.raises(InputError, match="--system lstm --seed 5: nothing planned at scale cpu fits"):
        training.train_missing(call)
    assert rounds == []


def test_minutes_become_a_deadline() -> None:
    assert deadline_in(None) is None
    found = deadline_in(2.0)
    assert found is not None
    assert 100.0 < found - time.monotonic() <= 120.0
    for minutes in (-1.0, float("nan")):
        with pytest.raises(InputError, match=r"--minutes .*, expected at least 0"):
            deadline_in(minutes)
