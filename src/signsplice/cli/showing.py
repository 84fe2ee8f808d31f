"""Commands that show what the package does, and how fast: ``demo`` and ``bench``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from signsplice.cli.aliases import formerly_a_flag
from signsplice.cli.options import AS_JSON, preset
from signsplice.cli.terminal import progress


@click.command()
@preset("--out", "out/demo", "DIR", "Folder for the files.")
def demo(out: str) -> None:
    """Splice words of the lexicon that ships, and write files to look at."""
    from signsplice.demo import run

    with progress("demo") as advance:
        lines = run(Path(out), advance)
    for line in lines:
        print(line)


@click.group(cls=formerly_a_flag("--service", "service"), invoke_without_command=True)
@click.option(
    "--repeats", type=click.IntRange(3), default=15, show_default=True, help="Runs of each part; the median is shown."
)
@AS_JSON
@click.pass_context
def bench(ctx: click.Context, repeats: int, as_json: bool) -> None:
    """Measure the speed of every part and of its baselines, in one run; or what a command below names."""
    if ctx.invoked_subcommand is not None:
        return
    from signsplice.evaluation.speed_parts import measure, table

    with progress("bench") as advance:
        figures = measure(repeats, advance)
    print(json.dumps(figures, indent=2) if as_json else table(figures))


@bench.command()
@click.option("--streams", type=click.IntRange(1), default=50, show_default=True, help="Open streams.")
@click.option("--rate", type=float, default=20.0, show_default=True, help="Requests per second.")
@click.option("--seconds", type=float, default=60.0, show_default=True, help="Duration of either load.")
@click.option("--minutes", type=float, default=10.0, show_default=True, help="Duration of half of both loads.")
@AS_JSON
def service(streams: int, rate: float, seconds: float, minutes: float, as_json: bool) -> None:
    """Measure the service under load: many streams, then many requests, then half of both for longer."""
    from signsplice.evaluation import speed_service

    with progress("bench service") as advance:
        figures = speed_service.measure(streams, seconds, rate, minutes, advance)
    print(json.dumps(figures, indent=2) if as_json else speed_service.table(figures))


COMMANDS = (demo, bench)
