"""The commands `tables`, `figures` and `report`: pages from results.json, in seconds."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.terminal import warn
from signsplice.errors import InputError, MissingExtraError
from signsplice_paper.cli.options import OUT, SCALE, PaperCall, add_options, option

if TYPE_CHECKING:
    from signsplice_paper.results import Results


@click.command()
@add_options(SCALE, OUT)
def tables(**options: Any) -> None:
    """Write the table, its pages and all figures from results.json, without corpus or networks."""
    write_all(PaperCall(**options))


@click.command()
@add_options(SCALE, OUT)
def figures(**options: Any) -> None:
    """Write the figures alone."""
    call = PaperCall(**options)
    _write_figures(_load_results(call), call, required=True)


@click.command()
@add_options(SCALE, OUT)
@option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), metavar="PDF", help="[default: in --out]")
@option("--date", "day", type=click.DateTime(["%Y-%m-%d"]), metavar="DAY", help="That it bears.  [default: today]")
def report(output: Path | None, day: datetime | None, **options: Any) -> None:
    """Write the report of three pages as PDF (extra `report`)."""
    from signsplice_paper import report as paper_report

    call = PaperCall(**options)
    path = call.out / "report.pdf" if output is None else output
    paper_report.write(_load_results(call), call.out, call.scale, path, (day or datetime.now()).date())
    print(path)


def write_all(call: PaperCall) -> None:
    """Writes the table, its pages and all figures. Without matplotlib it warns instead of writing figures."""
    from signsplice_paper import pages

    results = _load_results(call)
    if not results.rows:
        raise InputError(f"{call.out}: no row for tables")
    for path in pages.write(results, call.out, call.scale):
        print(path)
    _write_figures(results, call, required=False)


def _load_results(call: PaperCall) -> Results:
    from signsplice_paper import results

    file = call.out / results.FILE
    if not file.is_file():
        raise InputError(f"{file}: not there; `signsplice-paper evaluate` or `all` makes it")
    return results.load(file)


def _write_figures(results: Results, call: PaperCall, required: bool) -> None:
    from signsplice_paper import figures, kept_frames

    folder = call.out
    frames = kept_frames.load(folder / kept_frames.FILE)
    try:
        paths, omitted = figures.write(results, frames, folder, call.scale)
    except MissingExtraError as error:
        if required:
            raise
        warn([str(error)])
        return
    for path in paths:
        print(path)
    if omitted:
        warn([f"left out, for want of measurements at scale {call.scale}: {', '.join(omitted)}"])


COMMANDS = (tables, figures, report)
