"""The commands ``bulk``: write recipes, and make their sentences in shards, here or on a Ray cluster."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.clips import check_apart, check_output, check_outputs
from signsplice.cli.lexicon import open_words
from signsplice.cli.options import BUNDLE, LEXICONS, READING, SEEDS, combine_options, option, preset
from signsplice.cli.terminal import open_console, require, size, warn
from signsplice.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

    from signsplice.bulk.run import RunProgress
    from signsplice.lexicon.lexicon import Lexicon


_DIALS = {
    "--transition-time": "auto|RULE|SECONDS",
    "--sign-speed": "X",
    "--tempo": "citation|natural|SECONDS",
    "--fps": "N",
    "--cutter": "NAME",
    "--transition": "NAME",
    "--free-hand": "natural|transition",
    "--person": "X",
    "--system": "NAME",
}
_AS_THERE = "As of `sentence`."
_STORE = "Clips and reports in tar files; or recipes and hashes alone, from which `bulk make` makes any row."
_FORMAT = "Of the clips; npz32: rounded by up to 0.002 degrees and 0.06 mm, a third of the size."
_SEED = preset("--seed", 0, "N", "Seed of the draw, and that of `sentence` in each recipe.", type=SEEDS)
_POSES = "Positions of joints and annotations beside each clip, for sign-language-data-loading."


def _off(dial: str, text: str) -> Callable[[Any], Any]:
    """Return a flag that sets a dial to False; None if it is not given."""
    return click.option(f"--no-{dial}", dial, flag_value=False, type=bool, default=None, help=text)


dial_options = combine_options(
    *(click.option(name, metavar=form, help=_AS_THERE) for name, form in _DIALS.items()),
    option("--avoid-collisions/--no-avoid-collisions", None, _AS_THERE, default=None),
    _off("spell", "Rows with words that the lexicon lacks fail; none is spelled or left out."),
    _off("pauses", "Hold no sign at punctuation."),
    option("--face-rules/--no-face-rules", None, f"{_AS_THERE}  [default: no]", default=None),
)


run_options = combine_options(
    option("-o --output", "OUT", "Folder of shards; resumes one that ended.", required=True),
    LEXICONS,
    BUNDLE,
    option("--workers", "N", "Processes, or actors of Ray.  [default: one per core]", type=int),
    option("--ray", "ADDRESS", "Ray cluster to use instead: HOST:PORT, auto or local."),
    preset("--store", "frames", "frames|recipes", _STORE),
    preset("--format", "npz", "npz|npz32|bvh|glb", _FORMAT),
    preset("--poses/--no-poses", True, None, _POSES),
    preset("--shard-size", 1000, "N", "Rows of a shard."),
    preset("--keep-words", 2048, "N", "Words that a process keeps in memory, with what the networks read of them."),
)


def span(name: str, text: str) -> tuple[float, float]:
    """Parse the minimum and maximum of an option: "A:B", or one number for both. Raises ``InputError`` otherwise."""
    least_text, _, most_text = text.partition(":")
    low, high = number(name, least_text), number(name, most_text or least_text)
    if low > high:
        raise InputError(f"--{name.strip('-').replace('_', '-')} {text}, expected the least first")
    return low, high


def number(name: str, text: str) -> float:
    """Parse the number of an option. Raises ``InputError`` for anything else."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--{name.strip('-').replace('_', '-')} {text!r:.40}, expected a number") from None


_RANGED = ("transition_time", "sign_speed", "tempo", "fps", "person")
"""Dials that may be ranges when recipes are drawn."""


@click.group()
def bulk() -> None:
    """Make sentences by the million: recipes in, shards out."""


def _check_signers(words: Lexicon, signers: Iterable[str]) -> None:
    """Raise ``InputError`` for a signer that the lexicon lacks."""
    known = {entry.signer for entry in words.entries()} if signers else set()
    for signer in signers:
        if signer not in known:
            raise InputError(
                f"--signer {signer[:40]!r}, expected one of the lexicon's: {', '.join(sorted(known))[:200]}"
            )


@bulk.command()
@click.argument("lines", metavar="[LINES.txt]", required=False)
@option("-o --output", "RECIPES", "File to write: .parquet or .csv.", required=True)
@LEXICONS
@option("--count", "N", "How many recipes to draw.  [default: 1000]", type=int)
@option("--words", "A:B", "Words of a sentence, least and most.  [default: 3:10]")
@option("--signer signers", "NAME", "Who signs; given again, each recipe draws one.", multiple=True)
@_SEED
@READING
@dial_options
def recipes(
    lines: str | None,
    output: str,
    lexicons: tuple[str, ...],
    count: int | None,
    words: str | None,
    signers: tuple[str, ...],
    seed: int,
    drop_function_words: bool,
    language: str,
    one_language: bool,
    **dials: Any,
) -> None:
    """Write recipes: drawn from the signs of a lexicon, or one for each line of glosses in LINES.txt.

    Drawn dials may be ranges: --sign-speed 0.8:1.2.
    """
    _require_extra()
    from signsplice.bulk import drawing
    from signsplice.bulk.recipes import check_suffix, write

    check_suffix(output)
    check_output(output, [lines])
    ranges, fixed = _ranges(dials)
    with open_words(*lexicons, language=language) as opened:
        check_apart(output, [source.path for source in opened.sources])
        _check_signers(opened, signers)
        if lines is not None:
            if count is not None or words is not None or ranges or len(signers) > 1:
                raise InputError(
                    f"{lines}: lines are taken as they are, expected no --count, --words, range or second --signer"
                )
            chosen = fixed | {"seed": seed} | ({"signer": signers[0]} if signers else {})
            batches, warnings = drawing.lines(lines, opened, chosen, drop_function_words, language, one_language)
            warn(warnings)
            recipe_batches: Iterable[pa.RecordBatch] = batches
        else:
            count, n_words = 1000 if count is None else count, span("--words", words or "3:10")
            if count < 1 or not (1 <= n_words[0] <= n_words[1] <= 1000 and all(n == int(n) for n in n_words)):
                raise InputError("--count 1 or more and --words A:B, whole numbers from 1 to 1000, expected")
            glosses = drawing.signs(opened)
            min_words, max_words = map(int, n_words)
            recipe_batches = drawing.random_recipes(
                glosses, count, (min_words, max_words), seed, signers or ("",), ranges, fixed
            )
        n_rows = write(output, recipe_batches)
    print(f"{output}: {n_rows:,} recipe{'s' * (n_rows != 1)}")


@bulk.command()
@click.argument("recipes", metavar="RECIPES")
@run_options
def sentences(recipes: str, **options: Any) -> None:
    """Make the sentence of every recipe of a file, .parquet or .csv.

    Called again after an interruption or a kill, it continues.
    """
    _require_extra()
    from signsplice.bulk.recipes import check_suffix, read

    check_suffix(recipes)
    check_apart(options["output"], [recipes])
    _run(lambda _: read(recipes), **options)


@bulk.command()
@option("--count", "N", "How many, drawn by seed without repeats.  [default: all]", type=int)
@_SEED
@run_options
@dial_options
def pairs(count: int | None, seed: int, **options: Any) -> None:
    """Make the ordered pairs of a lexicon's signs.

    Called again after an interruption or a kill, it continues.
    """
    _require_extra()
    from signsplice.bulk import drawing

    names = [name.removeprefix("--").replace("-", "_") for name in _DIALS]
    dials = {name: options.pop(name) for name in (*names, "avoid_collisions", "spell", "pauses", "face_rules")}
    ranges, fixed = _ranges(dials)
    if ranges:
        raise InputError(f"--{next(iter(ranges)).replace('_', '-')}: a range, expected one value for all pairs")
    _run(lambda glosses: drawing.pairs(glosses(), count, seed, fixed), **options)


@bulk.command()
@click.argument("folder", metavar="OUT")
@click.argument("row", type=int, metavar="ROW")
@option("-o --output", "FILE", "File to write, by suffix: .bvh, .npz, .glb, .vrma.", required=True)
@option("--report", "R.json", "Write the report too.")
def make(folder: str, row: int, output: str, report: str | None) -> None:
    """Make one row of a folder of shards anew, and check that it is the same, bit for bit."""
    _require_extra()
    from signsplice import formats
    from signsplice.bulk.run import call_in_process
    from signsplice.bulk.shards import remake

    formats.check_suffix(output)
    check_outputs(output, report, [folder])
    print(call_in_process(remake, folder, row, output, report))


def _run(
    batches: Callable[[Callable[[], list[str]]], Iterator[pa.RecordBatch]],
    output: str,
    lexicons: tuple[str, ...],
    bundle: str | None,
    workers: int | None,
    ray: str | None,
    keep_words: int,
    **options: Any,
) -> None:
    """Make the sentences of the recipes that ``batches`` makes of the lexicon's signs, and print a summary."""
    from signsplice.bulk import drawing
    from signsplice.bulk.job import BulkOptions
    from signsplice.bulk.run import run
    from signsplice.lexicon.lexicon import DEFAULT, lexicon_folder

    if keep_words < 2:
        raise InputError(f"--keep-words {keep_words}, expected 2 or more")
    folder, words = Path(output), lexicons or (DEFAULT,)
    check_apart(output, [*map(lexicon_folder, words), bundle])
    with open_words(*words) as opened, _open_progress_bar(f"making {folder.name}") as advance:
        job_options = BulkOptions(words, bundle, **options)
        summary = run(
            folder, job_options, lambda: batches(lambda: drawing.signs(opened)), workers, ray, keep_words, advance
        )
    warn(f"{n:,} rows failed: {reason}" for reason, n in summary.reasons.items())
    if summary.n_failed > sum(summary.reasons.values()):
        warn(["further reasons are in the index, column error"])
    failed = f", {summary.n_failed:,} failed" if summary.n_failed else ""
    n_made, n_shards = summary.n_recipes - summary.n_failed, summary.n_shards
    print(
        f"{folder}: {n_made:,} sentence{'s' * (n_made != 1)}{failed}, {n_shards:,} shard{'s' * (n_shards != 1)}, "
        f"{summary.seconds / 3600:.2f} h of motion, {size(summary.n_bytes)}"
    )


def _ranges(dials: Mapping[str, Any]) -> tuple[dict[str, tuple[float, float]], dict[str, Any]]:
    """Return the dials of a call that are ranges, and the others as fields of a recipe; omits dials not given."""
    from signsplice.bulk.drawing import dial
    from signsplice.bulk.recipes import SentenceRecipe

    chosen = {name: value for name, value in dials.items() if value is not None}
    ranges = {name: span(name, chosen[name]) for name in _RANGED if ":" in chosen.get(name, "")}
    fixed = {name: value for name, value in chosen.items() if name not in ranges}
    for name in ("sign_speed", "fps", "person"):
        if name in fixed:
            fixed[name] = number(name, fixed[name])
    for ends in zip(*([(name, value) for value in ends] for name, ends in ranges.items()), strict=True):
        SentenceRecipe(("",), **fixed, **{name: dial(name, value) for name, value in ends}).options(None)
    SentenceRecipe(("",), **fixed).options(None).choose_methods()  # raises for values out of range or unknown
    return ranges, fixed


@contextmanager
def _open_progress_bar(what: str) -> Iterator[Callable[[RunProgress], None] | None]:
    """Show a bar with rate, remaining time and failures on standard error, if that is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    import rich.progress as bars

    columns = (
        bars.TextColumn("{task.description}"),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TextColumn("{task.fields[rate]}"),
        bars.TimeRemainingColumn(elapsed_when_finished=True),
        bars.TextColumn("{task.fields[failed]}"),
    )
    with bars.Progress(*columns, console=open_console(), transient=True, speed_estimate_period=600) as bar:
        task = bar.add_task(what, start=False, total=None, rate="", failed="")

        def advance(state: RunProgress) -> None:
            bar.start_task(task)
            elapsed = bar.tasks[0].elapsed or 0.0
            n_made = state.n_done - state.n_before
            rate = f"{n_made / elapsed:.1f}/s" if n_made and elapsed else ""
            failed = f"{state.n_failed:,} failed" if state.n_failed else ""
            bar.update(task, completed=state.n_done, total=state.n_rows, rate=rate, failed=failed)

        yield advance


def _require_extra() -> None:
    require("recipes and shards need", "bulk", "pyarrow")


COMMANDS = (bulk,)
