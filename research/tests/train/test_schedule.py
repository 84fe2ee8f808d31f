"""The schedule of trainings: one by one in this process, and side by side in processes."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pytest

pytest.importorskip("torch")

from signsplice.errors import InputError, SignspliceError
from signsplice_paper import plan
from signsplice_paper.plan import Choice, Run
from signsplice_paper.train import schedule, training
from signsplice_paper.train.schedule import Schedule
from signsplice_paper.train.stopping import DeadlineError
from signsplice_paper.train.training import Training
from training_toys import corpus


def test_runs_are_trained_one_by_one_until_one_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[Training, Path, Path]] = []

    def make(config: Training, pairs: Any, out: Path, shared: Path, *_: Any) -> None:
        calls.append((config, out, shared))
        if len(calls) == 2:
            raise InputError("out of luck")

    monkeypatch.setattr(training, "make", make)
    runs = plan.plan_runs("cpu", Choice(("lstm",)))
    started, finished = [], []
    with pytest.raises(InputError, match="out of luck"):
        schedule.train_one_by_one(
            Schedule(runs, corpus().folder, tmp_path, 7),
            lambda number, run: started.append((number, run)),
            lambda run, folder: finished.append((run, folder)),
        )
    assert started == [(1, runs[0]), (2, runs[1])]
    assert finished == [(runs[0], tmp_path / runs[0].name)]
    assert calls[0] == (
        Training("lstm", "cpu", "adamw", "random", steps=7),
        tmp_path / "lstm-cpu-adamw-random",
        tmp_path / "parts",
    )
    assert [call[0].seed for call in calls] == [0, 1]


def test_no_training_goes_on_after_the_deadline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = plan.plan_runs("cpu", Choice(("lstm",)))
    finished: list[Run] = []

    def make(config: Training, *_: Any) -> None:
        assert config.deadline == 50.0
        if config.seed == 1:
            raise DeadlineError("time is up")

    monkeypatch.setattr(training, "make", make)
    monkeypatch.setattr(time, "monotonic", lambda: 20.0)
    planned = Schedule(runs, corpus().folder, tmp_path, deadline=50.0)
    schedule.train_one_by_one(planned, lambda *_: None, lambda run, _: finished.append(run))
    assert finished == runs[:1]
    call = schedule.build_arguments(planned, runs[0])
    assert call[call.index("--minutes") + 1] == "0.5"
    monkeypatch.setattr(time, "monotonic", lambda: 60.0)
    started: list[Run] = []
    schedule.train_one_by_one(planned, lambda _, run: started.append(run), lambda *_: None)
    schedule.train_side_by_side(planned, 2, lambda _, run: started.append(run))
    assert started == []


def test_a_process_gets_the_options_of_its_run() -> None:
    run = Run("lptransformer", "cpu", "adamw", "random", fr=6, seed=2)
    call = schedule.build_arguments(Schedule([run], Path("p"), Path("b"), steps=5), run)
    assert call[0] == "train-system"
    assert dict(zip(call[1::2], call[2::2], strict=True)) == {
        **{"--pairs": "p", "--out": f"b/{run.name}", "--seed": "2", "--system": "lptransformer", "--scale": "cpu"},
        **{"--optimiser": "adamw", "--split": "random", "--fr": "6", "--steps": "5"},
    }


class FakeProcess:
    """A training that ends when it is polled for the third time.

    - running: all that have not ended
    - most: the largest number that ran at once
    - failing: an argument of the calls that fail
    """

    running: ClassVar[list[FakeProcess]] = []
    most: ClassVar[int] = 0
    failing: ClassVar[str] = ""

    def __init__(self, call: list[str], env: dict[str, str]) -> None:
        self.call, self.env, self.polls = call, env, 0
        self.signals: list[int] = []
        FakeProcess.running.append(self)
        FakeProcess.most = max(FakeProcess.most, len(FakeProcess.running))

    def poll(self) -> int | None:
        self.polls += 1
        if self.polls < 3:
            return None
        FakeProcess.running.remove(self)
        return 2 if FakeProcess.failing and FakeProcess.failing in self.call else 0

    def send_signal(self, number: int) -> None:
        self.signals.append(number)

    def wait(self) -> int:
        return 130


def test_processes_divide_the_cores_and_a_failure_stops_all(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made: list[FakeProcess] = []

    def popen(call: list[str], env: dict[str, str], preexec_fn: Callable[[], None] | None) -> FakeProcess:
        assert preexec_fn is not None or sys.platform != "linux", "it would outlive a killed parent"
        made.append(FakeProcess(call, env))
        return made[-1]

    monkeypatch.setattr("signsplice_paper.train.schedule.subprocess.Popen", popen)
    monkeypatch.setattr("signsplice_paper.train.schedule.time.sleep", lambda seconds: None)
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    planned = Schedule(
        plan.plan_runs("smoke", Choice(("lptransformer-printed", "lstm"))), tmp_path / "p", tmp_path / "b"
    )
    started: list[Run] = []
    schedule.train_side_by_side(planned, 3, lambda number, run: started.append(run))
    assert started == planned.runs
    assert [process.call[3:] for process in made] == [schedule.build_arguments(planned, run) for run in planned.runs]
    assert {process.env["OMP_NUM_THREADS"] for process in made} == {"2"}
    assert (FakeProcess.most, FakeProcess.running) == (3, [])
    made.clear()
    first = planned.runs[0].name
    FakeProcess.failing = str(planned.bundles / first)
    with pytest.raises(SignspliceError, match=f"training {first} failed \\(exit status 2"):
        schedule.train_side_by_side(planned, 2, lambda number, run: None)
    assert [process.signals for process in made] == [[], [signal.SIGINT]], "the other one is interrupted"
    FakeProcess.running.clear()
