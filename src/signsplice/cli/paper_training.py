"""What `paper` does with trainings: those of the plan, the search of rates and widths, and merging results."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from signsplice.cli.terminal import warn
from signsplice.cli.train import check_extra, progress_printer
from signsplice.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from signsplice.paper.plan import Choice, Run


@dataclass(frozen=True)
class TrainingOptions:
    """How `paper` trains.

    - scale: smoke, cpu or paper
    - pairs: folder of the corpus
    - bundles: folder of the trained systems
    - steps: of every part, None for those of the scale
    - workers: trainings at once
    - deadline: value of ``time.monotonic`` after which no training goes on, None for never
    """

    scale: str
    pairs: Path
    bundles: Path
    steps: int | None = None
    workers: int = 1
    deadline: float | None = None

    @property
    def time_is_up(self) -> bool:
        """Whether the deadline has passed."""
        return self.deadline is not None and time.monotonic() >= self.deadline


def train_missing(options: TrainingOptions, choice: Choice) -> list[Run]:
    """Train what the plan has and the bundles lack, until time is up; returns what is still missing.

    The plan is asked again after every round, because the best rival is known only when all are trained.
    """
    from signsplice.paper import plan
    from signsplice.synth.corpus import Pairs

    there = (options.pairs / "corpus.json").is_file()  # without it the training says what is wrong
    corpus = str(Pairs(options.pairs).head["hash"]) if there else None

    def missing() -> list[Run]:
        rival = plan.best_rival(options.bundles, options.scale)
        return plan.missing(plan.runs(options.scale, choice, rival), options.bundles, corpus)

    todo = missing()
    while todo and not options.time_is_up:
        _train(todo, options)
        todo = missing()
    if todo:
        names = ", ".join(run.name for run in todo[:3]) + (", ..." if len(todo) > 3 else "")
        warn([f"time is up; trainings are missing: {len(todo)} ({names}); the same call continues"])
    return todo


def _train(todo: Sequence[Run], options: TrainingOptions) -> None:
    """Train every run, one after another or side by side."""
    if importlib.util.find_spec("torch") is None:
        raise MissingExtraError(
            f"{len(todo)} of the paper's systems are not trained yet, {todo[0].name} first, and training needs torch: "
            "pip install 'signsplice[train]'; `signsplice paper evaluate` judges what is there"
        )
    check_extra()
    from signsplice.train.paper import schedule

    def started(number: int, run: Run) -> None:
        click.echo(f"training {number} of {len(todo)}: {run.name}", err=True)

    def finished(run: Run, folder: Path) -> None:
        print(f"{folder}: {run.system}, scale {run.scale}, {run.optimiser}, {run.split}")

    options.bundles.mkdir(parents=True, exist_ok=True)
    planned = schedule.Schedule(todo, options.pairs, options.bundles, options.steps, options.deadline)
    if options.workers > 1:
        schedule.train_side_by_side(planned, options.workers, started)
    else:
        schedule.train_one_by_one(planned, started, finished, progress_printer)


def search(options: TrainingOptions, systems: Sequence[str], out: Path) -> None:
    """Search rates and widths, and print the files written."""
    check_extra()
    from signsplice.paper import plan
    from signsplice.train.paper import search as searching

    made = searching.SearchPlan(
        options.pairs, options.bundles / "search", options.scale, options.steps or searching.STEPS
    )
    searching.run(
        made, systems or plan.PAPER, out, options.workers, lambda line: click.echo(line, err=True), options.deadline
    )
    for name in (searching.FILE, searching.PAGE):
        if (out / name).is_file():
            print(out / name)


def merge(folders: Sequence[str], out: Path) -> None:
    """Merge folders of results into one."""
    from signsplice.paper import merging

    if not folders:
        raise InputError("merge adds results to those in --out: name folders of results with --from")
    n_rows, known = merging.merge([Path(folder) for folder in folders], out)
    print(f"{out}: {n_rows} rows added, {len(known.rows)} in all")
