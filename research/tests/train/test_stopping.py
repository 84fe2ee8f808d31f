"""Trainings that end before their last step: on a plateau, when their time is spent, at a deadline."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from torch import Tensor  # noqa: E402

from signsplice.errors import InputError  # noqa: E402
from signsplice_paper.train import stopping  # noqa: E402
from signsplice_paper.train.stopping import DeadlineError, PaperLoop  # noqa: E402
from signsplice_workshop.train import (  # noqa: E402
    checkpoint,
    loop,
    records,
)
from signsplice_workshop.train.loop import train  # noqa: E402
from training_toys import ALONE, product_toy  # noqa: E402


def losses(folder: Path) -> dict[int, float]:
    """The losses in a training's log by step."""
    return {line["step"]: line["loss"] for line in records.read_lines(folder / records.LOG_FILE) if "loss" in line}


def clocks(**changed: Callable[[], float]) -> SimpleNamespace:
    """The clocks of the module ``time``, some of them changed for the loop alone."""
    names = ("monotonic", "perf_counter", "process_time")
    return SimpleNamespace(**{name: getattr(time, name) for name in names} | changed)


def stopping_training(folder: Path, **limits: Any) -> tuple[int, dict[str, Tensor]]:
    """Steps and weights after one call of a training of at most sixty steps."""
    folder.mkdir(exist_ok=True)
    task, data, valid = product_toy()
    config = PaperLoop(60, 4, 1e-2, 1, every=2, n_judged=4, method="sgd", **limits)
    return train(task, config, data, valid, folder, "toy", ALONE), task.state_dict()


def deadline_call(folder: Path, deadline: float) -> dict[str, Tensor]:
    """Weights after one call of a training of six steps."""
    folder.mkdir(exist_ok=True)
    task, data, valid = product_toy()
    config = PaperLoop(6, 4, 1e-2, seed=1, every=4, deadline=deadline)
    train(task, config, data, valid, folder, "toy", ALONE)
    return task.state_dict()


def test_a_deadline_interrupts_and_the_next_call_ends_in_the_same_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = itertools.count()
    monkeypatch.setattr(stopping, "time", clocks(monotonic=lambda: next(clock)))
    with pytest.raises(DeadlineError, match="time is up after step 0 of 6"):
        deadline_call(tmp_path / "a", 0)
    assert not (tmp_path / "a" / checkpoint.NAME).exists()
    clock = itertools.count()
    with pytest.raises(DeadlineError, match="time is up after step 3 of 6"):
        deadline_call(tmp_path / "a", 3)
    whole = deadline_call(tmp_path / "b", math.inf)
    parts = deadline_call(tmp_path / "a", math.inf)
    assert all(torch.equal(value, parts[key]) for key, value in whole.items())
    assert losses(tmp_path / "a") == losses(tmp_path / "b")


def test_a_training_ends_on_a_plateau_and_stays_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    falling = iter([5.0, 4.0, 3.999, 4.2, 3.9, 3.8999, 3.8998, 2.0])
    monkeypatch.setattr(loop, "judge", lambda *_: {stopping.VALIDATION_LOSS: next(falling), "both": 0.5})
    steps, weights = stopping_training(tmp_path / "a", patience=2)
    assert steps == 8, "3.999 and 4.2 are no improvement on 4.0"
    assert stopping.find_reason(tmp_path / "a", 60, 2) == (8, stopping.PLATEAU)
    again = stopping_training(tmp_path / "a", patience=2)
    assert again[0] == 8
    assert all(torch.equal(value, again[1][key]) for key, value in weights.items())


def test_a_training_ends_when_its_processor_time_is_spent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.count(100)
    monkeypatch.setattr(loop, "time", clocks(process_time=lambda: float(next(clock))))
    steps, _ = stopping_training(tmp_path / "a", most_cpu_s=7.0)
    assert steps < 60
    assert stopping.find_reason(tmp_path / "a", 60, 4) == (steps, stopping.TIME)
    assert checkpoint.read(tmp_path / "a")["step"] == steps, "validated and kept"
    assert any(
        "both" in line for line in records.read_lines(tmp_path / "a" / records.LOG_FILE) if line["step"] == steps
    )
    assert stopping_training(tmp_path / "a", most_cpu_s=7.0)[0] == steps
    assert stopping_training(tmp_path / "a")[0] == 60
    assert stopping.find_reason(tmp_path / "a", 60, 4) == (60, stopping.STEPS)


def test_the_validation_loss_is_judged_where_it_decides(tmp_path: Path) -> None:
    stopping_training(tmp_path / "a", patience=30)
    found = [
        line[stopping.VALIDATION_LOSS]
        for line in records.read_lines(tmp_path / "a" / records.LOG_FILE)
        if stopping.VALIDATION_LOSS in line
    ]
    assert len(found) == 30
    assert all(math.isfinite(loss) and loss > 0.0 for loss in found)
    assert stopping.read_losses(tmp_path / "a", 20) == found[:10]


def test_a_plateau_needs_more_than_its_patience() -> None:
    assert not stopping.on_plateau([1.0, 1.0], 2)
    assert stopping.on_plateau([1.0, 1.0, 1.0], 2)
    assert not stopping.on_plateau([1.0, 1.0, 0.99], 2)
    assert stopping.on_plateau([-1.0, -1.0005, -1.0], 2), "a likelihood's loss may be negative"
    assert not stopping.on_plateau([-1.0, -1.01, -1.0], 2)


def test_snapshots_are_the_weights_at_every_validation(tmp_path: Path) -> None:
    for until in (3, None):
        task, data, valid = product_toy()
        config = PaperLoop(6, 4, 1e-3, seed=1, every=2, until=until, snapshots=True)
        train(task, config, data, valid, tmp_path, "toy", ALONE)
    files = sorted((tmp_path / stopping.SNAPSHOTS).iterdir())
    assert files == [stopping.snapshot_path(tmp_path, step) for step in (2, 3, 4, 6)]
    last = torch.load(files[-1], weights_only=True)
    assert all(torch.equal(value, last[name]) for name, value in task.state_dict().items())


def test_sgd_resumes_exactly_and_has_the_papers_rate(tmp_path: Path) -> None:
    weights = []
    for folder, untils in (("a", (None,)), ("b", (2, 3, None))):
        (tmp_path / folder).mkdir()
        for until in untils:
            task, data, valid = product_toy("transition")
            config = PaperLoop(6, 4, 2e-3, seed=1, every=4, until=until, method="sgd")
            train(task, config, data, valid, tmp_path / folder, "toy", ALONE)
        weights.append(task.state_dict())
    assert all(torch.equal(value, weights[1][name]) for name, value in weights[0].items())
    assert {config.rate_at(step) for step in range(100)} == {1e-3}, "the paper's, to the plateau"
    assert {group["momentum"] for group in config.optimiser(list(task.parameters())).param_groups} == {0}
    assert stopping.highest_rate("sgd", 0.5) == 1e-3
    assert stopping.highest_rate("adamw", 0.5) == 0.5
    for method in ("lion", "sgd-momentum"):
        with pytest.raises(InputError, match=f"optimiser '{method}', expected one of adamw, sgd$"):
            PaperLoop(1, 1, 1.0, 0, method=method)
