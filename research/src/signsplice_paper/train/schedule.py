"""Training many systems of the paper: one after another, or side by side in processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from signsplice.children import parent_death_hook
from signsplice.errors import SignspliceError
from signsplice_paper.plan import Run
from signsplice_paper.train import training
from signsplice_paper.train.stopping import DeadlineError
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.train import processes
from signsplice_workshop.train.loop import ProgressCallback

StartCallback = Callable[[int, Run], None]
"""Called with a run's number, from 1, and the run, before it is trained."""
PARTS = "parts"
"""Folder of the checkpoints, next to the bundles."""
_POLL_S = 0.2


@dataclass(frozen=True)
class Schedule:
    """The trainings to run, and their data.

    - runs: the trainings, in order
    - pairs: folder of the corpus
    - bundles: folder that holds a folder for each bundle
    - steps: steps of every part, None for those of the scale
    - deadline: value of ``time.monotonic`` at which training stops, None for never
    """

    runs: Sequence[Run]
    pairs: Path
    bundles: Path
    steps: int | None = None
    deadline: float | None = None

    @property
    def minutes_left(self) -> float | None:
        """Minutes to the deadline, not below 0; None if there is none."""
        return None if self.deadline is None else max(0.0, (self.deadline - time.monotonic()) / 60.0)


def train_one_by_one(
    schedule: Schedule,
    on_start: StartCallback,
    on_finish: Callable[[Run, Path], None],
    progress: Callable[[str], ProgressCallback] | None = None,
) -> None:
    """Trains every run in this process, one after another, and writes its bundle, until the deadline.

    on_start: called before each run. on_finish: called with each run and its bundle's folder. progress: the name of a
    part -> the callback for its training.
    """
    pairs = Pairs(schedule.pairs)
    with processes.join_process_group() as process, suppress(DeadlineError):
        for number, run in enumerate(schedule.runs, 1):
            if schedule.minutes_left == 0.0:
                return
            on_start(number, run)
            folder = schedule.bundles / run.name
            config = training.Training(
                run.system, run.scale, run.optimiser, run.split, run.seed, run.fr, schedule.steps,
                deadline=schedule.deadline,
            )  # fmt: skip
            training.make(config, pairs, folder, schedule.bundles / PARTS, process, progress)
            on_finish(run, folder)


def train_side_by_side(schedule: Schedule, workers: int, on_start: StartCallback) -> None:
    """Trains every run by `signsplice-paper train-system` in a process of its own, ``workers`` at once, with equal
    numbers of cores.

    The processes end when this one is killed, and at the deadline. The first failure interrupts the others and raises
    ``SignspliceError``; the next call continues from the checkpoints.
    """
    environment = os.environ | {"OMP_NUM_THREADS": str(max(1, (os.cpu_count() or 1) // workers))}
    death_hook = parent_death_hook()
    waiting = list(enumerate(schedule.runs, 1))
    running: dict[str, subprocess.Popen[bytes]] = {}
    try:
        while waiting or running:
            if schedule.minutes_left == 0.0:
                waiting.clear()
            while waiting and len(running) < workers:
                number, run = waiting.pop(0)
                on_start(number, run)
                command = [sys.executable, "-m", "signsplice_paper", *build_arguments(schedule, run)]
                running[run.name] = subprocess.Popen(command, env=environment, preexec_fn=death_hook)
            time.sleep(_POLL_S)
            for name, process in list(running.items()):
                status = process.poll()
                if status is not None:
                    del running[name]
                if status:
                    raise SignspliceError(f"training {name} failed (exit status {status}; its own error is above)")
    finally:
        for process in running.values():
            process.send_signal(signal.SIGINT)
        for process in running.values():
            process.wait()


def build_arguments(schedule: Schedule, run: Run) -> list[str]:
    """Returns the arguments of `signsplice-paper` that train a run."""
    command_line = ["train-system", "--pairs", str(schedule.pairs), "--out", str(schedule.bundles / run.name)]
    options = {
        "seed": run.seed,
        "system": run.system,
        "scale": run.scale,
        "optimiser": run.optimiser,
        "split": run.split,
        "fr": run.fr,
        "steps": schedule.steps,
        "minutes": schedule.minutes_left,
    }
    for option, value in options.items():
        if value is not None:
            command_line += [f"--{option}", str(value)]
    return command_line


def export_untrained(
    systems: Sequence[str], scale: str, pairs: Path, folder: Path, on_finish: Callable[[Run, Path], None]
) -> None:
    """Writes bundles of untrained systems, a folder for each system, to time them at the sizes of a scale."""
    corpus = Pairs(pairs)
    with processes.join_process_group() as process:
        for system in systems:
            config = training.Training(system, scale, steps=0)
            training.make(config, corpus, folder / system, folder / PARTS, process)
            on_finish(Run(system, scale, config.optimiser, config.split), folder / system)
