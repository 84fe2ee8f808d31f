"""What `paper` does with trainings: those of the plan, the search of rates and widths, and merging results."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from signsplice.cli.terminal import progress, warn
from signsplice.cli.train import check_extra, progress_printer
from signsplice.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from signsplice_paper.plan import Choice, Run


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

    The plan is asked again after every round, because the best rival is known only when all are trained. Raises
    ``InputError`` for a choice that fits nothing in it.
    """
    from signsplice.synth.corpus import Pairs
    from signsplice_paper import plan

    corpus = Pairs(options.pairs)

    def missing() -> list[Run]:
        planned = plan.runs(options.scale, choice, plan.best_rival(options.bundles, options.scale))
        if not planned:
            raise InputError(
                f"{choice}: nothing planned at scale {options.scale} fits; `signsplice train paper` trains any system"
            )
        todo = plan.missing(planned, options.bundles, str(corpus.head["hash"]))
        return [run for run in todo if corpus.split(run.split, "train")]  # few words: a split may be empty

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
    from signsplice_paper.train import schedule

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


def curves(options: TrainingOptions, systems: Sequence[str], again: bool, required: bool) -> None:
    """Write the validation curves that bundles lack, of ``systems`` if any are named; none where torch is missing,
    unless they are ``required``.
    """
    if not required and importlib.util.find_spec("torch") is None:
        return
    check_extra()
    from signsplice.synth.corpus import Pairs
    from signsplice.train.processes import pick_device
    from signsplice_paper.bundles import read_all
    from signsplice_paper.train.curves import CurveJudge
    from signsplice_paper.train.schedule import PARTS

    every = read_all(options.bundles)
    configs = [c for c in every if c.scale == options.scale and (not systems or c.system in systems)]
    if required and not configs:
        hint = "`signsplice train paper` makes one"
        raise InputError(f"{options.bundles}: no bundle of scale {options.scale} there; {hint}")
    judge = CurveJudge(Pairs(options.pairs), options.bundles / PARTS, pick_device("auto"), progress)
    for path in judge.write(configs, again, lambda line: warn([line])):
        print(path)


def search(options: TrainingOptions, systems: Sequence[str], out: Path) -> None:
    """Search rates and widths, and print the files written."""
    check_extra()
    from signsplice_paper import plan
    from signsplice_paper.train import search as searching

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
    from signsplice_paper import merging

    if not folders:
        raise InputError("merge adds results to those in --out: name folders of results with --from")
    n_rows, known = merging.merge([Path(folder) for folder in folders], out)
    print(f"{out}: {n_rows} rows added, {len(known.rows)} in all")
