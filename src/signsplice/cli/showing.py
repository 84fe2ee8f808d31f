"""Commands that show the package at work: the demo, and how quick it is."""

from __future__ import annotations

import json
from pathlib import Path

import click

from signsplice.cli.terminal import progress


@click.command()
@click.option("--out", default="out/demo", show_default=True, metavar="DIR", help="Folder to leave the files in.")
def demo(out: str) -> None:
    """Splice the words that ship with the package, and leave files to look at."""
    from signsplice.demo import run

    with progress("demo") as advance:
        lines = run(Path(out), advance)
    for line in lines:
        print(line)


@click.command()
@click.option(
    "--repeats", type=click.IntRange(3), default=15, show_default=True, help="Runs of each part; medians are shown."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def bench(repeats: int, as_json: bool) -> None:
    """Measure the speed of every part beside its baselines, in one run."""
    from signsplice.bench.parts import measure, table

    with progress("bench") as advance:
        figures = measure(repeats, advance)
    print(json.dumps(figures, indent=2) if as_json else table(figures))


COMMANDS = (demo, bench)
