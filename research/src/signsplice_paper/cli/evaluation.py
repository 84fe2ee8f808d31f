"""The commands `all`, `judge`, `evaluate`, `predict`, `speed` and `merge`: rows of results.json, and pages of them."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.terminal import progress, warn
from signsplice.errors import InputError
from signsplice_paper.cli.options import (
    AGAIN,
    BUNDLES,
    CHOICE,
    LIMIT,
    OUT,
    PAIRS,
    SCALE,
    SPLITS,
    TRAINING,
    PaperCall,
    option,
    takes,
)
from signsplice_paper.cli.pages import write_all
from signsplice_paper.cli.training import train_missing, write_curves
from signsplice_workshop.cli.train import check_extra

if TYPE_CHECKING:
    from signsplice_paper.plan import Run


N_TIMED = 20
_TIMED = option("--limit", type=int, metavar="N", default=N_TIMED, help="Time N pairs.")
_SOURCES = option("--from", "sources", multiple=True, metavar="DIR", help="Folder of results to add; may be repeated.")
_JUDGED = (SCALE, PAIRS, BUNDLES, OUT, *CHOICE, LIMIT, AGAIN)


@click.command("all")
@takes(*_JUDGED, *TRAINING)
def everything(**options: Any) -> None:
    """Train missing systems, judge them, write tables and figures."""
    call = PaperCall(**options)
    train_missing(call)
    if not call.time_is_up:
        write_curves(call, required=False)
    _judge(call)
    write_all(call)


@click.command()
@takes(*_JUDGED)
def judge(**options: Any) -> None:
    """Judge trained systems: rows of results.json."""
    _judge(PaperCall(**options))


@click.command()
@takes(*_JUDGED)
def evaluate(**options: Any) -> None:
    """Judge trained systems and write tables and figures."""
    call = PaperCall(**options)
    _judge(call)
    write_all(call)


@click.command()
@takes(SCALE, PAIRS, OUT, _TIMED)
def speed(**options: Any) -> None:
    """Time untrained systems of the scale's sizes."""
    call = PaperCall(**options)
    check_extra()
    from signsplice_paper import protocol, speed
    from signsplice_paper.train import schedule
    from signsplice_workshop.corpora.pairs import Pairs

    def report_bundle(run: Run, bundle: Path) -> None:
        click.echo(f"{bundle}: {run.system}, scale {run.scale}, {run.optimiser}, {run.split}", err=True)

    folder, corpus = call.make_folder(), Pairs(call.pairs)
    judged = protocol.choose(corpus, "random", limit=call.limit)
    with tempfile.TemporaryDirectory(prefix="signsplice-speed-") as temporary:
        schedule.export_untrained(speed.SYSTEMS, call.scale, call.pairs, Path(temporary), report_bundle)
        with progress("timing") as advance:
            timed = speed.measure(corpus, Path(temporary), judged, advance)
    for path in speed.write(timed, folder, call.scale, judged):
        print(path)


@click.command()
@click.argument("bundle", metavar="BUNDLE", type=click.Path(path_type=Path))
@takes(PAIRS, option("--split", type=SPLITS, default="random", help="Whose test part is predicted."))
@click.option("-o", "--output", required=True, metavar="DIR", type=click.Path(path_type=Path), help="Folder to make.")
def predict(bundle: Path, pairs: Path, split: str, output: Path) -> None:
    """Write a trained system's predictions for the test part, as the benchmark's scorer reads them."""
    from signsplice_paper import predictions, protocol
    from signsplice_paper.systems import open_bundle
    from signsplice_workshop.corpora.pairs import Pairs

    corpus, system = Pairs(pairs), open_bundle(bundle)
    chosen = protocol.choose(corpus, split)
    protocol.check_allowed(system.config.stored, corpus, chosen, bundle.name)
    with progress(f"{system.name}, {split}") as advance:
        predictions.write(protocol.answers(corpus, system), chosen, output, advance)
    print(f"{output}: {len(chosen.numbers)} predictions of {system.name}")


@click.command()
@takes(_SOURCES, SCALE, OUT)
def merge(sources: tuple[str, ...], **options: Any) -> None:
    """Add results that were judged elsewhere, and write tables and figures."""
    from signsplice_paper import merging

    call = PaperCall(**options)
    if not sources:
        raise InputError("merge adds results to those in --out: name folders of results with --from")
    out = call.make_folder()
    n_rows, known = merging.merge([Path(folder) for folder in sources], out)
    print(f"{out}: {n_rows} rows added, {len(known.rows)} in all")
    write_all(call)


def _judge(call: PaperCall) -> None:
    from signsplice_paper import evaluation, judging, results
    from signsplice_workshop.corpora.pairs import Pairs

    folder, corpus = call.make_folder(), Pairs(call.pairs)
    file, choice = folder / results.FILE, call.choice
    judged = judging.Judge(
        corpus, results.load(file), progress, limit=call.limit, again=call.again, splits=choice.splits
    )
    n_rows, known = evaluation.evaluate(judged, folder, call.bundles, call.scale, choice, lambda line: warn([line]))
    print(f"{file}: {n_rows} rows judged, {len(known.rows)} in all")


COMMANDS = (everything, judge, evaluate, predict, speed, merge)
