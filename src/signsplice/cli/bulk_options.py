"""Options that commands of ``bulk`` share: the dials of recipes, which may be ranges, and how a run is made."""

from __future__ import annotations

import click

from signsplice.cli.options import BUNDLE, LEXICON, added, preset
from signsplice.errors import InputError

_DIALS = {
    "--transition-time": "auto|RULE|SECONDS",
    "--sign-speed": "X",
    "--tempo": "citation|natural|SECONDS",
    "--fps": "N",
    "--cutter": "NAME",
    "--transition": "NAME",
    "--free-hand": "transition|natural",
}
_AS_THERE = "As of `sentence`."

dial_options = added(
    *(click.option(name, metavar=form, help=_AS_THERE) for name, form in _DIALS.items()),
    click.option("--avoid-collisions/--no-avoid-collisions", default=None, help=_AS_THERE),
    click.option("--no-spell", is_flag=True, help="Rows with words that the lexicon lacks fail; none is spelled."),
)


run_options = added(
    click.option("-o", "--output", required=True, metavar="OUT", help="Folder of shards; resumes one that ended."),
    LEXICON,
    BUNDLE,
    click.option("--workers", type=int, metavar="N", help="Processes, or actors of Ray.  [default: one per core]"),
    click.option("--ray", metavar="ADDRESS", help="Ray cluster to use instead: HOST:PORT, auto or local."),
    preset(
        "--store",
        "frames",
        "frames|recipes",
        "Clips and reports in tar files; or recipes and hashes alone, from which `bulk make` makes any row.",
    ),
    preset("--format", "npz", "npz|bvh|glb", "Of the clips."),
    click.option(
        "--poses/--no-poses",
        default=True,
        show_default=True,
        help="Positions of joints and annotations beside each clip, for sign-language-data-loading.",
    ),
    preset("--shard-size", 1000, "N", "Rows of a shard."),
    preset("--keep-words", 2048, "N", "Words that a process keeps in memory, with what the networks read of them."),
)


def span(name: str, text: str) -> tuple[float, float]:
    """Least and most of an option: "A:B", or one number for both. Raises ``InputError`` for anything else."""
    least, _, most = text.partition(":")
    low, high = number(name, least), number(name, most or least)
    if low > high:
        raise InputError(f"--{name.strip('-').replace('_', '-')} {text}, expected the least first")
    return low, high


def number(name: str, text: str) -> float:
    """The number of an option. Raises ``InputError`` for anything else."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--{name.strip('-').replace('_', '-')} {text!r:.40}, expected a number") from None
