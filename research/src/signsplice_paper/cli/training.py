"""The commands `train`, `curves`, `search`, `train-system` and `publish`: what needs torch."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.terminal import progress, warn
from signsplice.errors import InputError, MissingExtraError
from signsplice_paper.cli.options import (
    AGAIN,
    BUNDLES,
    CHOICE,
    OPTIMISERS,
    OUT,
    PAIRS,
    SCALE,
    SYSTEM,
    TRAINING,
    PaperCall,
    add_options,
    compute_deadline,
    option,
)
from signsplice_workshop.cli.train import check_extra, make_progress_printer

if TYPE_CHECKING:
    from signsplice_paper.plan import Run


@click.command()
@add_options(SCALE, PAIRS, BUNDLES, *CHOICE, *TRAINING, AGAIN)
def train(**options: Any) -> None:
    """Train the systems of the tables that are missing."""
    call = PaperCall(**options)
    train_missing(call)
    if not call.time_is_up:
        write_curves(call, required=False)


@click.command()
@add_options(SCALE, PAIRS, BUNDLES, SYSTEM, AGAIN)
def curves(**options: Any) -> None:
    """Judge systems after every part of their training, from the weights kept in it."""
    write_curves(PaperCall(**options), required=True)


@click.command()
@add_options(SCALE, PAIRS, BUNDLES, OUT, SYSTEM, *TRAINING)
def search(**options: Any) -> None:
    """Try learning rates and widths."""
    call = PaperCall(**options)
    output_folder = call.make_folder()
    check_extra()
    from signsplice_paper import plan
    from signsplice_paper.train import search as parameter_search

    search_plan = parameter_search.SearchPlan(call.pairs, call.bundles / "search", call.scale)
    parameter_search.run(
        search_plan,
        call.systems or plan.SEARCHED,
        output_folder,
        call.workers,
        lambda line: click.echo(line, err=True),
        call.deadline,
    )
    if (output_folder / parameter_search.FILE).is_file():
        print(output_folder / parameter_search.FILE)


@click.command("train-system")
@add_options(
    option("--pairs", required=True, metavar="DIR", help="Corpus of pairs, of `pairs build` or `synth pairs`."),
    option(
        "--system", required=True, metavar="NAME|all", help="lptransformer, lstm, ..., or all: a folder in --out each."
    ),
    SCALE,
    option("--optimiser", type=OPTIMISERS, default="adamw", help="sgd: as in the paper, rate 1e-3, no momentum."),
    option("--split", default="random", help="Which pairs are trained on; many, in a corpus to teach on."),
    option("--out", required=True, metavar="DIR", help="Folder for the bundle."),
    option("--parts", metavar="DIR", help="Checkpoints, shared by systems of the same parts.  [default: beside --out]"),
    option("--steps", type=int, metavar="N", help="Steps of every part, in place of the scale's."),
    option("--fr", type=int, metavar="N", help="Frames that Culling keeps on each side.  [default: 8]"),
    option("--seed", type=int, default=0, metavar="N", help="Of weights, batches and noise."),
    option("--device", default="auto", metavar="NAME", help="auto, cpu or cuda."),
    click.option("--bf16/--no-bf16", default=None, help="Half precision; by default on GPUs alone."),
    option("--minutes", type=float, metavar="M", help="Stop after M minutes; the same command continues."),
)
def train_system(
    pairs: str,
    system: str,
    scale: str,
    optimiser: str,
    split: str,
    out: str,
    parts: str | None,
    steps: int | None,
    fr: int | None,
    seed: int,
    device: str,
    bf16: bool | None,
    minutes: float | None,
) -> None:
    """Train one system and export it. The same command continues after an interruption.

    Several processes can divide the work: torchrun --nproc-per-node 2 -m signsplice_paper train-system ...
    """
    check_extra()
    from signsplice_paper.train import scales, training
    from signsplice_paper.train.stopping import DeadlineError
    from signsplice_workshop.corpora.pairs import Pairs
    from signsplice_workshop.train import processes

    systems = list(scales.SYSTEMS) if system == "all" else [system]
    with processes.join_process_group(device) as process:
        deadline = compute_deadline(minutes)
        corpus = Pairs(pairs)
        if system == "all" and fr is not None:
            raise InputError(f"--fr {fr} with --system all; name one system with a Culling layer")
        for name in systems:
            scales.make_parts(name, scale, fr, steps, optimiser, split)
        for name in systems:
            folder = Path(out) / name if system == "all" else Path(out)
            parts_folder = Path(parts) if parts is not None else Path(out).parent / "parts"
            config = training.Training(name, scale, optimiser, split, seed, fr, steps, bf16, deadline=deadline)
            try:
                training.make(
                    config, corpus, folder, parts_folder, process, make_progress_printer if process.first else None
                )
            except DeadlineError as error:
                if process.first:
                    warn([f"{folder}: {error}"])
                return
            if process.first:
                print(f"{folder}: {name}, scale {scale}, {optimiser}, {split}")


@click.command()
@click.argument("bundles", nargs=-1, required=True, metavar="BUNDLE ...", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, metavar="DIR", type=click.Path(path_type=Path), help="Folder for them.")
def publish(bundles: tuple[Path, ...], output: Path) -> None:
    """Copy trained systems without their logs, each into a folder of its name, and write a page that lists them."""
    from signsplice_paper import published_bundles

    for folder in published_bundles.publish(bundles, output):
        print(folder)


def train_missing(call: PaperCall) -> list[Run]:
    """Trains the planned runs that have no bundle, until time is up. Returns the runs that are still missing.
    Raises ``InputError`` if the choice fits no planned run.
    """
    from signsplice_paper import plan
    from signsplice_workshop.corpora.pairs import Pairs

    corpus = Pairs(call.pairs)

    def find_missing() -> list[Run]:
        planned_runs = plan.plan_runs(call.scale, call.choice, corpus.head["splits"])
        if not planned_runs:
            raise InputError(
                f"{call.choice}: nothing planned at scale {call.scale} fits; "
                "`signsplice-paper train-system` trains any system"
            )
        return plan.find_missing(planned_runs, call.bundles, str(corpus.head["hash"]))

    missing_runs = find_missing()
    if missing_runs and not call.time_is_up:
        _train(missing_runs, call)
        missing_runs = find_missing()
    if missing_runs:
        names = ", ".join(run.name for run in missing_runs[:3]) + (", ..." if len(missing_runs) > 3 else "")
        warn([f"time is up; trainings are missing: {len(missing_runs)} ({names}); the same call continues"])
    return missing_runs


def _train(runs: Sequence[Run], call: PaperCall) -> None:
    """Trains every run, one after another or side by side."""
    if importlib.util.find_spec("torch") is None:
        raise MissingExtraError(
            f"{len(runs)} of the paper's systems are not trained yet, {runs[0].name} first, and training needs torch: "
            "pip install './workshop[train]' in signsplice's folder; `signsplice-paper evaluate` judges what is there"
        )
    check_extra()
    from signsplice_paper.train import schedule

    def report_start(number: int, run: Run) -> None:
        click.echo(f"training {number} of {len(runs)}: {run.name}", err=True)

    def report_finish(run: Run, folder: Path) -> None:
        print(f"{folder}: {run.system}, scale {run.scale}, {run.optimiser}, {run.split}")

    call.bundles.mkdir(parents=True, exist_ok=True)
    training_schedule = schedule.Schedule(runs, call.pairs, call.bundles, call.steps, call.deadline)
    if call.workers > 1:
        schedule.train_side_by_side(training_schedule, call.workers, report_start)
    else:
        schedule.train_one_by_one(training_schedule, report_start, report_finish, make_progress_printer)


def write_curves(call: PaperCall, required: bool) -> None:
    """Writes the missing validation curves of bundles, of the named systems or of all. Writes none without torch,
    unless they are ``required``.
    """
    if not required and importlib.util.find_spec("torch") is None:
        return
    check_extra()
    from signsplice_paper.bundles import read_all
    from signsplice_paper.train.curves import CurveJudge
    from signsplice_paper.train.schedule import PARTS
    from signsplice_workshop.corpora.pairs import Pairs
    from signsplice_workshop.train.processes import pick_device

    bundle_configs = read_all(call.bundles)
    configs = [
        config
        for config in bundle_configs
        if config.scale == call.scale and (not call.systems or config.system in call.systems)
    ]
    if required and not configs:
        hint = "`signsplice-paper train-system` makes one"
        raise InputError(f"{call.bundles}: no bundle of scale {call.scale} there; {hint}")
    judge = CurveJudge(Pairs(call.pairs), call.bundles / PARTS, pick_device("auto"), progress)
    for path in judge.write(configs, call.again, lambda line: warn([line])):
        print(path)


COMMANDS = (train, curves, search, train_system, publish)
