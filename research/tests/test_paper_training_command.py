"""What `train` and `all` train: what is missing, in limited time, and only what is wanted."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from signsplice.errors import InputError
from signsplice_paper import plan
from signsplice_paper.cli import training
from signsplice_paper.cli.options import PaperCall, compute_deadline
from signsplice_paper.plan import Run
from toys import corpus


def fake_training(monkeypatch: pytest.MonkeyPatch, at_most: int = 1000) -> list[list[str]]:
    """Rounds of trainings, by name; each writes bundles of its first ``at_most`` runs."""
    rounds: list[list[str]] = []

    def train(todo: Sequence[Run], call: PaperCall) -> None:
        rounds.append([run.name for run in todo])
        for run in todo[:at_most]:
            (call.bundles / run.name).mkdir(parents=True)
            (call.bundles / run.name / "bundle.json").write_text(json.dumps({"corpus": corpus().head["hash"]}))

    monkeypatch.setattr(training, "_train", train)
    return rounds


def test_what_the_plan_has_and_the_folder_lacks_is_trained_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rounds = fake_training(monkeypatch, at_most=3)
    call = PaperCall("smoke", corpus().folder, tmp_path)
    planned = [run.name for run in plan.plan_runs("smoke")]
    assert [run.name for run in training.train_missing(call)] == planned[3:]
    assert f"trainings are missing: {len(planned) - 3} ({planned[3]}, " in capsys.readouterr().err
    rounds_later = fake_training(monkeypatch)
    assert training.train_missing(call) == []
    assert training.train_missing(call) == []
    assert (rounds, rounds_later) == ([planned], [planned[3:]]), "the third call finds nothing to train"


def test_on_a_corpus_to_teach_on_two_systems_are_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rounds = fake_training(monkeypatch)
    taught = tmp_path / "pairs"
    shutil.copytree(corpus().folder, taught)
    head = json.loads((taught / "corpus.json").read_text())
    head["splits"] = {plan.TAUGHT_SPLIT: {**head["splits"]["random"], "test": []}}
    (taught / "corpus.json").write_text(json.dumps(head))
    assert training.train_missing(PaperCall("cpu", taught, tmp_path / "bundles")) == []
    assert rounds == [[f"{system}-cpu-adamw-many" for system in plan.ON_MANY]]


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
    assert compute_deadline(None) is None
    found = compute_deadline(2.0)
    assert found is not None
    assert 100.0 < found - time.monotonic() <= 120.0
    for minutes in (-1.0, float("nan")):
        with pytest.raises(InputError, match=r"--minutes .*, expected at least 0"):
            compute_deadline(minutes)
