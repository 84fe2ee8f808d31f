"""The command ``bench``: speed of every part, the service under load, and sentences in bulk."""

from __future__ import annotations

import json
from pathlib import Path

import click

from signsplice.cli.options import AS_JSON, LEXICON, SEED, option, preset
from signsplice.cli.terminal import note, progress, require
from signsplice.errors import InputError
from signsplice.formats import atomic


@click.group(invoke_without_command=True)
@preset("--repeats", 15, None, "Base number of runs of a part; most figures are medians.", type=click.IntRange(3))
@AS_JSON
@click.pass_context
def bench(ctx: click.Context, repeats: int, as_json: bool) -> None:
    """Measure the speed of every part and of its baselines, in one run; or what a command below names."""
    if ctx.invoked_subcommand is not None:
        return
    from signsplice.bench import parts

    with progress("bench") as advance:
        figures = parts.measure(repeats, advance)
    print(json.dumps(figures, indent=2) if as_json else parts.table(figures))


@bench.command()
@preset("--streams", 50, None, "Open streams.", type=click.IntRange(1))
@preset("--rate", 20.0, None, "Requests per second.")
@preset("--seconds", 60.0, None, "Duration of either load.")
@preset("--minutes", 10.0, None, "Minutes at half of both loads at once.")
@AS_JSON
def service(streams: int, rate: float, seconds: float, minutes: float, as_json: bool) -> None:
    """Measure the service under load: many streams, then many requests, then half of both for longer."""
    require("this needs", "dev", "httpx", "psutil", "websockets")
    from signsplice.bench import service as loads

    with progress("bench service") as advance:
        figures = loads.measure(streams, seconds, rate, minutes, advance)
    print(json.dumps(figures, indent=2) if as_json else loads.table(figures))


@bench.command()
@LEXICON
@preset("--count", 200, "N", "Sentences of each timing.")
@preset("--memory", 10_000, "N", "Sentences made to measure memory.")
@SEED
@option("-o --output", "R.json", "File of the figures; tables of them go to R.md beside it.")
@AS_JSON
def bulk(lexicon: str | None, count: int, memory: int, seed: int, output: str | None, as_json: bool) -> None:
    """Measure sentences in bulk: time per core, growth with workers, memory, bytes; and core-hours of a million."""
    if count < 40 or memory < 10 or (output is not None and not output.endswith(".json")):
        raise InputError("--count 40 or more, --memory 10 or more and -o R.json expected")
    for path in () if output is None else (Path(output), Path(output).with_suffix(".md")):
        atomic.check_writable(path)
    require("recipes and shards need", "bulk", "pyarrow")
    from signsplice.bench import bulk as bulk_bench
    from signsplice.lexicon.lexicon import SHIPPED

    measured = bulk_bench.measure(
        lexicon or str(SHIPPED), count, memory, lambda what: note([f"measuring {what}"]), seed
    )
    figures, page = json.dumps(measured, indent=2) + "\n", bulk_bench.page(measured)
    for path, text in () if output is None else ((Path(output), figures), (Path(output).with_suffix(".md"), page)):
        atomic.write(path, text)
    print(figures if as_json else page, end="")


COMMANDS = (bench,)
