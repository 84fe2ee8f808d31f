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
@click.option("--service", is_flag=True, help="The service under load, in place of the parts.")
@click.option("--streams", type=click.IntRange(1), default=50, show_default=True, help="Of the service, at one time.")
@click.option("--rate", type=float, default=20.0, show_default=True, help="Requests to the service, a second.")
@click.option("--seconds", type=float, default=60.0, show_default=True, help="Of streams, and of requests.")
@click.option("--minutes", type=float, default=10.0, show_default=True, help="At half the load, to watch the memory.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def bench(
    repeats: int, service: bool, streams: int, rate: float, seconds: float, minutes: float, as_json: bool
) -> None:
    """Measure the speed of every part beside its baselines, in one run; or the service under load."""
    if service:
        from signsplice.evaluation import speed_service

        with progress("bench --service") as advance:
            loaded = speed_service.measure(streams, seconds, rate, minutes, advance)
        print(json.dumps(loaded, indent=2) if as_json else speed_service.table(loaded))
        return
    from signsplice.evaluation.speed_parts import measure, table

    with progress("bench") as advance:
        figures = measure(repeats, advance)
    print(json.dumps(figures, indent=2) if as_json else table(figures))


COMMANDS = (demo, bench)
