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
    add_options,
    option,
)
from signsplice_paper.cli.pages import write_all
from signsplice_paper.cli.training import train_missing, write_curves
from signsplice_workshop.cli.train import check_extra

if TYPE_CHECKING:
    from signsplice_paper.plan import Run


N_TIMED = 20
_TIMED_LIMIT = option("--limit", type=int, metavar="N", default=N_TIMED, help="Time N pairs.")
_SOURCES = option("--from", "sources", multiple=True, metavar="DIR", help="Folder of results to add; may be repeated.")
_JUDGE_OPTIONS = (SCALE, PAIRS, BUNDLES, OUT, *CHOICE, LIMIT, AGAIN)


@click.command("all")
@add_options(*_JUDGE_OPTIONS, *TRAINING)
def run_all(**options: Any) -> None:
    """Train missing systems, judge them, write tables and figures."""
    call = PaperCall(**options)
    train_missing(call)
    if not call.time_is_up:
        write_curves(call, required=False)
    _judge(call)
    write_all(call)


@click.command()
@add_options(*_JUDGE_OPTIONS)
def judge(**options: Any) -> None:
    """Judge trained systems: rows of results.json."""
    _judge(PaperCall(**options))


@click.command()
@add_options(*_JUDGE_OPTIONS)
def evaluate(**options: Any) -> None:
    """Judge trained systems and write tables and figures."""
    call = PaperCall(**options)
    _judge(call)
    write_all(call)


@click.command()
@add_options(SCALE, PAIRS, OUT, _TIMED_LIMIT)
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
    chosen_pairs = protocol.choose(corpus, "random", limit=call.limit)
    with tempfile.TemporaryDirectory(prefix="signsplice-speed-") as temporary_folder:
        schedule.export_untrained(speed.SYSTEMS, call.scale, call.pairs, Path(temporary_folder), report_bundle)
        with progress("timing") as advance:
            timings = speed.measure(corpus, Path(temporary_folder), chosen_pairs, advance)
    for path in speed.write(timings, folder, call.scale, chosen_pairs):
        print(path)


@click.command()
@click.argument("bundle", metavar="BUNDLE", type=click.Path(path_type=Path))
@add_options(PAIRS, option("--split", type=SPLITS, default="random", help="Whose test part is predicted."))
@click.option("-o", "--output", required=True, metavar="DIR", type=click.Path(path_type=Path), help="Folder to make.")
def predict(bundle: Path, pairs: Path, split: str, output: Path) -> None:
    """Write a trained system's predictions for the test part, as the benchmark's scorer reads them."""
    from signsplice_paper import predictions, protocol
    from signsplice_paper.systems import open_bundle
    from signsplice_workshop.corpora.pairs import Pairs

    corpus, system = Pairs(pairs), open_bundle(bundle)
    chosen_pairs = protocol.choose(corpus, split)
    protocol.check_allowed(system.config.stored, corpus, chosen_pairs, bundle.name)
    with progress(f"{system.name}, {split}") as advance:
        predictions.write(protocol.make_answer(corpus, system), chosen_pairs, output, advance)
    print(f"{output}: {len(chosen_pairs.pair_numbers)} predictions of {system.name}")


@click.command()
@add_options(_SOURCES, SCALE, OUT)
def merge(sources: tuple[str, ...], **options: Any) -> None:
    """Add results that were judged elsewhere, and write tables and figures."""
    from signsplice_paper import merging

    call = PaperCall(**options)
    if not sources:
        raise InputError("merge adds results to those in --out: name folders of results with --from")
    output_folder = call.make_folder()
    n_rows, merged_results = merging.merge([Path(folder) for folder in sources], output_folder)
    print(f"{output_folder}: {n_rows} rows added, {len(merged_results.rows)} in all")
    write_all(call)


def _judge(call: PaperCall) -> None:
    from signsplice_paper import evaluation, judging, results
    from signsplice_workshop.corpora.pairs import Pairs

    folder, corpus = call.make_folder(), Pairs(call.pairs)
    file, choice = folder / results.FILE, call.choice
    paper_judge = judging.Judge(
        corpus, results.load(file), progress, limit=call.limit, rejudge=call.again, splits=choice.splits
    )
    n_rows, all_results = evaluation.evaluate(
        paper_judge, folder, call.bundles, call.scale, choice, lambda line: warn([line])
    )
    print(f"{file}: {n_rows} rows judged, {len(all_results.rows)} in all")


COMMANDS = (run_all, judge, evaluate, predict, speed, merge)
