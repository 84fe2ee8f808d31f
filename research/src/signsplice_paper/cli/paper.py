"""The command `paper`: train the paper's systems, judge them, write tables and figures."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

from signsplice.cli.terminal import progress, warn
from signsplice.cli.train import check_extra, deadline_in
from signsplice.errors import InputError, MissingExtraError
from signsplice_paper.cli import paper_training
from signsplice_paper.cli.paper_training import TrainingOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from signsplice_paper.plan import Choice, Run
    from signsplice_paper.results import Results

WHAT = (
    *("all", "train", "judge", "evaluate", "tables", "table1", "table2", "table3", "claims", "figures"),
    *("curves", "speed", "search", "merge"),
)
ONE_TABLE = ("table1", "table2", "table3")
N_TIMED = 20


@click.command()
@click.argument("what", metavar="ACTION", type=click.Choice(WHAT))
@click.option("--scale", type=click.Choice(("smoke", "cpu", "paper")), default="cpu", show_default=True,
              help="How large the systems are and how long they are trained.")  # fmt: skip
@click.option("--pairs", metavar="DIR", default="out/pairs", show_default=True, help="Corpus of pairs.")
@click.option("--bundles", metavar="DIR", default="out/bundles", show_default=True, help="Folder of trained systems.")
@click.option("--out", metavar="DIR", default="docs/paper", show_default=True,
              help="Folder of results.json, tables and figures.")  # fmt: skip
@click.option(
    "--system",
    "systems",
    multiple=True,
    metavar="NAME",
    help="(all, train, judge, evaluate, curves, search) Only these systems.",
)
@click.option(
    "--optimiser",
    "optimisers",
    multiple=True,
    type=click.Choice(("adamw", "sgd")),
    help="(all, train, judge, evaluate) Only these.",
)
@click.option("--split", "splits", multiple=True, type=click.Choice(("random", "unseen-words", "unseen-signer")),
              help="(all, train, judge, evaluate) Only these.")  # fmt: skip
@click.option("--seed", "seeds", multiple=True, type=int, metavar="N", help="(all, train, judge, evaluate) Only these.")
@click.option(
    "--fr",
    "frs",
    multiple=True,
    type=int,
    metavar="N",
    help="(all, train, judge, evaluate) Only these; 8 is that of all tables but one.",
)
@click.option(
    "--minutes",
    type=float,
    metavar="M",
    help="(all, train, search) Stop training after M minutes; the same call continues.",
)
@click.option(
    "--from",
    "sources",
    multiple=True,
    metavar="DIR",
    help="(merge) Folder of results to add to --out; may be repeated.",
)
@click.option("--steps", type=int, metavar="N", help="(all, train, search) Training steps, in place of the scale's.")
@click.option("--workers", type=int, default=1, show_default=True, metavar="N",
              help="(all, train, search) Train N systems at once; they share the processor's cores.")  # fmt: skip
@click.option(
    "--limit",
    type=int,
    metavar="N",
    help=f"(all, judge, evaluate, speed) Judge at most N pairs of a split; time N.  [default: all; {N_TIMED}]",
)
@click.option("--again", is_flag=True, help="(all, train, judge, evaluate, curves) Judge again what is judged already.")
def paper(
    what: str,
    scale: str,
    pairs: str,
    bundles: str,
    out: str,
    systems: tuple[str, ...],
    optimisers: tuple[str, ...],
    splits: tuple[str, ...],
    seeds: tuple[int, ...],
    frs: tuple[int, ...],
    minutes: float | None,
    sources: tuple[str, ...],
    steps: int | None,
    workers: int,
    limit: int | None,
    again: bool,
) -> None:
    """Reproduce the paper by one ACTION. all: train missing systems, judge, write tables and figures. train, judge:
    only that. evaluate: all but training. tables: all tables, claims and figures from results.json, in seconds, without
    corpus or networks; table1, table2, table3, claims, figures: those alone. curves: judge systems after every part of
    their training, from the weights kept in it. speed: time untrained systems of the scale's sizes. search: try
    learning rates and widths. merge: add results that were judged elsewhere.
    """
    from signsplice_paper import plan, results

    folder = Path(out)
    _check(systems, limit, steps, workers)
    choice = plan.Choice(systems, optimisers, splits, seeds, frs)
    options = TrainingOptions(scale, Path(pairs), Path(bundles), steps, workers, deadline_in(minutes))
    if what == "speed":
        if systems or steps is not None or workers > 1 or again:
            raise InputError("speed takes --scale, --pairs, --out and --limit; it times all systems, untrained")
        _make_folder(folder)
        _speed(folder, Path(pairs), scale, limit or N_TIMED)
        return
    if what in ("search", "merge"):
        _make_folder(folder)
        if what == "search":
            paper_training.search(options, systems, folder)
            return
        paper_training.merge(sources, folder)
    if what in ("all", "train"):
        paper_training.train_missing(options, choice)
    if what == "curves" or (what in ("all", "train") and not options.time_is_up):
        paper_training.curves(options, systems, again, required=what == "curves")
    if what in ("all", "judge", "evaluate"):
        _make_folder(folder)
        _evaluate(folder, Path(pairs), Path(bundles), scale, choice, limit, again)
    if what in ("train", "curves", "judge"):
        return
    if not (folder / results.FILE).is_file():
        raise InputError(f"{folder / results.FILE}: not there; `signsplice paper evaluate` or `all` makes it")
    known = results.load(folder / results.FILE)
    if what != "figures":
        _tables(known, folder, scale, what)
    if what not in (*ONE_TABLE, "claims"):
        _figures(known, folder, scale, required=what == "figures")


def _check(systems: Sequence[str], limit: int | None, steps: int | None, workers: int) -> None:
    from signsplice_paper import published

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


def _evaluate(
    folder: Path, pairs: Path, bundles: Path, scale: str, choice: Choice, limit: int | None, again: bool
) -> None:
    from signsplice.synth.corpus import Pairs
    from signsplice_paper import judging, results

    corpus = Pairs(pairs)
    file = folder / results.FILE
    judge = judging.Judge(corpus, results.load(file), progress, limit=limit, again=again, splits=choice.splits)
    n_rows, known = judging.evaluate(judge, folder, bundles, scale, choice, lambda line: warn([line]))
    print(f"{file}: {n_rows} rows judged, {len(known.rows)} in all")


def _speed(folder: Path, pairs: Path, scale: str, n_pairs: int) -> None:
    """Export untrained systems, time them, and write speed.json and its table."""
    check_extra()
    from signsplice.synth.corpus import Pairs
    from signsplice_paper import protocol, speed
    from signsplice_paper.train import schedule

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
    from signsplice_paper import claims_page, tables

    pages = (what,) if what in ONE_TABLE else () if what == "claims" else tables.PAGES
    written = tables.write(results, folder, scale, pages)
    if what not in ONE_TABLE:
        written += claims_page.write(results, folder, scale)
    if not written:
        raise InputError(f"{folder}: no row of scale {scale} for {' or '.join(pages) or what}")
    for path in written:
        print(path)


def _figures(results: Results, folder: Path, scale: str, required: bool) -> None:
    from signsplice_paper import figures, kept_frames

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
        warn([f"left out, for want of measurements at scale {scale}: {', '.join(left_out)}"])


COMMANDS = (paper,)
