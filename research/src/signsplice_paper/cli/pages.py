"""The commands `tables`, `table1` to `table3`, `claims` and `figures`: pages from results.json, in seconds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.terminal import warn
from signsplice.errors import InputError, MissingExtraError
from signsplice_paper.cli.options import OUT, SCALE, PaperCall, takes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from signsplice_paper.results import Results

_PAGE_OPTIONS = takes(SCALE, OUT)


@click.command()
@_PAGE_OPTIONS
def tables(**options: Any) -> None:
    """Write all tables, claims and figures from results.json, without corpus or networks."""
    write_all(PaperCall(**options))


@click.command()
@_PAGE_OPTIONS
def claims(**options: Any) -> None:
    """Write the page of claims alone."""
    call = PaperCall(**options)
    _write_pages(_results(call), call, pages=(), claimed=True)


@click.command()
@_PAGE_OPTIONS
def figures(**options: Any) -> None:
    """Write the figures alone."""
    call = PaperCall(**options)
    _write_figures(_results(call), call, required=True)


def one_table(name: str) -> click.Command:
    """The command that writes one table."""

    @click.command(name, help=f"Write {name[:-1]} {name[-1]} alone.")
    @_PAGE_OPTIONS
    def command(**options: Any) -> None:
        call = PaperCall(**options)
        _write_pages(_results(call), call, pages=(name,), claimed=False)

    return command


def write_all(call: PaperCall) -> None:
    """Write all tables, claims and figures; without matplotlib a warning takes the figures' place."""
    from signsplice_paper.tables import PAGES

    known = _results(call)
    _write_pages(known, call, PAGES, claimed=True)
    _write_figures(known, call, required=False)


def _results(call: PaperCall) -> Results:
    from signsplice_paper import results

    file = call.out / results.FILE
    if not file.is_file():
        raise InputError(f"{file}: not there; `signsplice-paper evaluate` or `all` makes it")
    return results.load(file)


def _write_pages(results: Results, call: PaperCall, pages: Sequence[str], claimed: bool) -> None:
    from signsplice_paper import claims_page, tables

    folder = call.out
    written = tables.write(results, folder, call.scale, pages)
    if claimed:
        written += claims_page.write(results, folder, call.scale)
    if not written:
        raise InputError(f"{folder}: no row of scale {call.scale} for {' or '.join(pages) or 'claims'}")
    for path in written:
        print(path)


def _write_figures(results: Results, call: PaperCall, required: bool) -> None:
    from signsplice_paper import figures, kept_frames

    folder = call.out
    kept = kept_frames.load(folder / kept_frames.FILE)
    try:
        written, left_out = figures.write(results, kept, folder, call.scale)
    except MissingExtraError as error:
        if required:
            raise
        warn([str(error)])
        return
    for path in written:
        print(path)
    if left_out:
        warn([f"left out, for want of measurements at scale {call.scale}: {', '.join(left_out)}"])


COMMANDS = (tables, *(one_table(f"table{number}") for number in (1, 2, 3)), claims, figures)
