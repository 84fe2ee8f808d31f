"""The command `paper`: train the paper's systems, judge them, write tables and figures."""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

from signsplice.cli.terminal import progress, warn
from signsplice.cli.train import check_extra, progress_printer
from signsplice.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from signsplice.paper.plan import Run
    from signsplice.paper.results import Results

WHAT = ("all", "evaluate", "table1", "table3", "figures", "speed")
N_TIMED = 20


@click.command()
@click.argument("what", metavar="|".join(WHAT), type=click.Choice(WHAT))
@click.option("--scale", type=click.Choice(("smoke", "cpu", "paper")), default="cpu", show_default=True,
              help="How large the systems are and how long they are trained.")  # fmt: skip
@click.option("--pairs", metavar="DIR", default="out/pairs", show_default=True, help="Corpus of pairs.")
@click.option("--bundles", metavar="DIR", default="out/bundles", show_default=True, help="Folder of trained systems.")
@click.option("--out", metavar="DIR", default="docs/paper", show_default=True,
              help="Folder of results.json, tables and figures.")  # fmt: skip
@click.option("--system", "systems", multiple=True, metavar="NAME", help="Train and judge only these.")
@click.option("--steps", type=int, metavar="N", help="Training steps, in place of the scale's.")
@click.option("--workers", type=int, default=1, show_default=True, metavar="N",
              help="Train N systems at once; they share the processor's cores.")  # fmt: skip
@click.option(
    "--limit", type=int, metavar="N", help=f"Judge at most N pairs of a split; time N.  [default: all; {N_TIMED}]"
)
@click.option("--again", is_flag=True, help="Judge again what results.json already holds.")
def paper(
    what: str,
    scale: str,
    pairs: str,
    bundles: str,
    out: str,
    systems: tuple[str, ...],
    steps: int | None,
    workers: int,
    limit: int | None,
    again: bool,
) -> None:
    """Reproduce the paper. all: train missing systems, judge, write tables and figures. evaluate: the same without
    training. table1, table3, figures: from results.json, in seconds, without corpus or networks. speed: time untrained
    systems of the scale's sizes.
    """
    from signsplice.paper import plan, results

    folder = Path(out)
    _check(systems, limit, steps, workers)
    if what == "speed":
        if systems or steps is not None or workers > 1 or again:
            raise InputError("speed takes --scale, --pairs, --out and --limit; it times all systems, untrained")
        _make_folder(folder)
        _speed(folder, Path(pairs), scale, limit or N_TIMED)
        return
    if what in ("all", "evaluate"):
        _make_folder(folder)
        if what == "all":
            todo = plan.missing(plan.runs(scale, systems), Path(bundles))
            _train(todo, Path(pairs), Path(bundles), steps, workers)
        _evaluate(folder, Path(pairs), Path(bundles), scale, systems, limit, again)
    if not (folder / results.FILE).is_file():
        raise InputError(f"{folder / results.FILE}: not there; `signsplice paper evaluate` or `all` makes it")
    known = results.load(folder / results.FILE)
    if what != "figures":
        _tables(known, folder, scale, what)
    if what not in ("table1", "table3"):
        _figures(known, folder, scale, required=what == "figures")


def _check(systems: Sequence[str], limit: int | None, steps: int | None, workers: int) -> None:
    from signsplice.paper import published

    unknown = [system for system in systems if system not in published.NAMES]
    if unknown:
        raise InputError(f"no system {unknown[0]!r}, expected one of {', '.join(published.NAMES)}")
    for option, value in (("--limit", limit), ("--steps", steps), ("--workers", workers)):
        if value is not None and value < 1:
            raise InputError(f"{option} {value}, expected at least 1")


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from error


def _train(todo: Sequence[Run], pairs: Path, bundles: Path, steps: int | None, workers: int) -> None:
    """Train every run, one after another or side by side."""
    if not todo:
        return
    if importlib.util.find_spec("torch") is None:
        raise MissingExtraError(
            f"{len(todo)} of the paper's systems are not trained yet, {todo[0].name} first, and training needs torch: "
            "pip install 'signsplice[train]'; `signsplice paper evaluate` judges what is there"
        )
    check_extra()
    from signsplice.synth.corpus import Pairs
    from signsplice.train.paper import schedule

    corpus = Pairs(pairs)
    todo = [run for run in todo if corpus.split(run.split, "train")]  # few words: a split may be empty

    def started(number: int, run: Run) -> None:
        click.echo(f"training {number} of {len(todo)}: {run.name}", err=True)

    def finished(run: Run, folder: Path) -> None:
        print(f"{folder}: {run.system}, scale {run.scale}, {run.optimiser}, {run.split}")

    _make_folder(bundles)
    planned = schedule.Schedule(todo, pairs, bundles, steps)
    if workers > 1:
        schedule.train_side_by_side(planned, workers, started)
    else:
        schedule.train_one_by_one(planned, started, finished, progress_printer)


def _evaluate(
    folder: Path, pairs: Path, bundles: Path, scale: str, systems: Sequence[str], limit: int | None, again: bool
) -> None:
    from signsplice.paper import judging, results
    from signsplice.synth.corpus import Pairs

    corpus = Pairs(pairs)
    file = folder / results.FILE
    judge = judging.Judge(corpus, results.load(file), progress, limit=limit, again=again)
    n_rows, known = judging.evaluate(judge, folder, bundles, scale, systems, lambda line: warn([line]))
    print(f"{file}: {n_rows} rows judged, {len(known.rows)} in all")


def _speed(folder: Path, pairs: Path, scale: str, n_pairs: int) -> None:
    """Export untrained systems, time them, and write speed.json and its table."""
    check_extra()
    from signsplice.paper import protocol, speed
    from signsplice.synth.corpus import Pairs
    from signsplice.train.paper import schedule

    def finished(run: Run, bundle: Path) -> None:
        click.echo(f"{bundle}: {run.system}, scale {run.scale}, {run.optimiser}, {run.split}", err=True)

    corpus = Pairs(pairs)
    judged = protocol.choose(corpus, "random", limit=n_pairs)
    with tempfile.TemporaryDirectory(prefix="signsplice-speed-") as temporary:
        schedule.export_untrained(speed.SYSTEMS, scale, pairs, Path(temporary), finished)
        with progress("timing") as advance:
            timed = speed.measure(corpus, Path(temporary), judged, advance)
    for path in speed.write(timed, folder, scale, judged):
        print(path)


def _tables(results: Results, folder: Path, scale: str, what: str) -> None:
    from signsplice.paper import tables

    pages = (what,) if what in ("table1", "table3") else tables.PAGES
    written = tables.write(results, folder, scale, pages)
    if not written:
        raise InputError(f"{folder}: no row of scale {scale} for {' or '.join(pages)}")
    for path in written:
        print(path)


def _figures(results: Results, folder: Path, scale: str, required: bool) -> None:
    from signsplice.paper import figures, kept_frames

    kept = kept_frames.load(folder / kept_frames.FILE)
    try:
        written, left_out = figures.write(results, kept, folder, scale)
    except MissingExtraError as error:
        if required:
            raise
        warn([str(error)])
        return
    for path in written:
        print(path)
    if left_out:
        warn([f"nothing was measured for {', '.join(left_out)} at scale {scale}"])


COMMANDS = (paper,)
