"""The paper's experiments: train what is missing, judge what is there, write its tables and figures."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING

import click

from signsplice.cli.terminal import progress, warn
from signsplice.errors import InputError, MissingExtraError, SignspliceError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from signsplice.paper.judging import Advance
    from signsplice.paper.plan import Run
    from signsplice.paper.results import Results

WHAT = ("all", "evaluate", "table1", "table3", "figures", "speed")
N_TIMED = 20


@click.command()
@click.argument("what", metavar="|".join(WHAT), type=click.Choice(WHAT))
@click.option("--scale", type=click.Choice(("smoke", "cpu", "paper")), default="cpu", show_default=True,
              help="How large and how long the systems are trained.")  # fmt: skip
@click.option("--pairs", metavar="DIR", default="out/pairs", show_default=True, help="Corpus of pairs.")
@click.option("--bundles", metavar="DIR", default="out/bundles", show_default=True, help="Where trained systems lie.")
@click.option("--out", metavar="DIR", default="docs/paper", show_default=True,
              help="Where results.json, tables and figures lie.")  # fmt: skip
@click.option("--system", "systems", multiple=True, metavar="NAME", help="Train and judge only these.")
@click.option("--steps", type=int, metavar="N", help="Training steps, in place of the scale's.")
@click.option("--workers", type=int, default=1, show_default=True, metavar="N",
              help="Train N systems at once; they share the processor's cores.")  # fmt: skip
@click.option(
    "--limit", type=int, metavar="N", help=f"Judge at most N pairs of a split; time N.  [default: all; {N_TIMED}]"
)
@click.option("--again", is_flag=True, help="Judge anew what results.json has already.")
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
    """Rebuild the paper. all: train what is missing, judge, tables, figures. evaluate: the same without training.
    table1, table3, figures: from results.json, in seconds, without corpus or networks. speed: time the systems at the
    scale's sizes side by side, with weights as drawn.
    """
    from signsplice.paper import plan
    from signsplice.paper.judging import RESULTS
    from signsplice.paper.results import load

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
    if not (folder / RESULTS).is_file():
        raise InputError(f"{folder / RESULTS}: not there; `signsplice paper evaluate` or `all` makes it")
    results = load(folder / RESULTS)
    if what != "figures":
        _tables(results, folder, scale, what)
    if what not in ("table1", "table3"):
        _figures(results, folder, scale, required=what == "figures")


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
    """Train every run by the command line's own `train paper`, one after another, or some at once."""
    if not todo:
        return
    if importlib.util.find_spec("torch") is None:
        raise MissingExtraError(
            f"{len(todo)} of the paper's systems are not trained yet, {todo[0].name} first, and training needs torch: "
            "pip install 'signsplice[train]'; `signsplice paper evaluate` judges what is there"
        )
    _make_folder(bundles)
    if workers > 1:
        _train_side_by_side(todo, pairs, bundles, steps, workers)
        return
    for n, run in enumerate(todo, 1):
        click.echo(f"training {n} of {len(todo)}: {run.name}", err=True)
        _train_here(run.arguments(pairs, bundles, steps))


def _train_here(arguments: list[str]) -> None:
    from signsplice.cli import app

    app.main(arguments, standalone_mode=False)


def _train_side_by_side(todo: Sequence[Run], pairs: Path, bundles: Path, steps: int | None, workers: int) -> None:
    """Each run in a process of its own, ``workers`` at once, with an even share of the cores. The first that fails ends
    the work: those that run are interrupted, and go on from their checkpoints when called again.
    """
    around = os.environ | {"OMP_NUM_THREADS": str(max(1, (os.cpu_count() or 1) // workers))}
    waiting = list(enumerate(todo, 1))
    running: dict[str, subprocess.Popen[bytes]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                n, run = waiting.pop(0)
                click.echo(f"training {n} of {len(todo)}: {run.name}", err=True)
                call = [sys.executable, "-m", "signsplice", *run.arguments(pairs, bundles, steps)]
                running[run.name] = subprocess.Popen(call, env=around)
            time.sleep(0.2)
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


def _evaluate(
    folder: Path, pairs: Path, bundles: Path, scale: str, systems: Sequence[str], limit: int | None, again: bool
) -> None:
    """Judge, and write results.json and the kept frames after every system, so that an interrupted call loses one."""
    from signsplice.paper import clip_methods, judging, kept_frames, results
    from signsplice.synth.corpus import Pairs

    corpus = Pairs(pairs)
    known = results.load(folder / judging.RESULTS)
    kept = kept_frames.load(folder / judging.SHOTS)
    folders = [
        f for f in judging.find_bundles(bundles, scale) if not systems or judging.facts(f).get("system") in systems
    ]
    if not folders:
        warn([f"{bundles}: no bundle of scale {scale} there; only methods on clips are judged"])
    advance: Advance = progress
    n_rows = 0
    methods = [*clip_methods.all_clip_methods(), *judging.corpus_trained_methods(bundles, lambda line: warn([line]))]
    for made in judging.everything(corpus, folders, known, kept, advance, limit=limit, again=again, methods=methods):
        n_rows += len(made.rows)
        if made.rows or made.curves:
            known = known.merged(made.rows, made.curves)
            results.save(known, folder / judging.RESULTS)
            kept_frames.save(made.shots, folder / judging.SHOTS)
    print(f"{folder / judging.RESULTS}: {n_rows} rows judged, {len(known.rows)} in all")


def _speed(folder: Path, pairs: Path, scale: str, n_pairs: int) -> None:
    """Export the systems as they are drawn, time them, and write speed.json and its table."""
    from signsplice.paper import protocol, speed
    from signsplice.paper.plan import Run
    from signsplice.synth.corpus import Pairs

    corpus = Pairs(pairs)
    judged = protocol.choose(corpus, "random", limit=n_pairs)
    with tempfile.TemporaryDirectory(prefix="signsplice-speed-") as temporary:
        for system in speed.SYSTEMS:
            call = Run(system, scale, "adamw", "random").arguments(pairs, Path(temporary), steps=0)
            call[call.index("--out") + 1] = str(Path(temporary) / system)
            with redirect_stdout(sys.stderr):
                _train_here(call)
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
    from signsplice.paper import figures, judging, kept_frames

    try:
        written, left_out = figures.write(results, kept_frames.load(folder / judging.SHOTS), folder, scale)
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
