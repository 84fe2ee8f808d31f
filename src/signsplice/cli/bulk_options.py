"""Options that commands of ``bulk`` share: the dials of recipes, which may be ranges, and how a run is made."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import click

from signsplice.errors import InputError

Command = TypeVar("Command", bound=Callable[..., Any])

LEXICON = click.option("--lexicon", metavar="LEX", help="Lexicon of the words.  [default: the one that ships]")
OUT = click.option(
    "-o", "--output", required=True, metavar="OUT", help="Folder of shards; a run that ended is resumed."
)


def added(options: Iterable[Callable[[Command], Command]]) -> Callable[[Command], Command]:
    """A decorator that adds options to a command, in this order."""

    def add(command: Command) -> Command:
        for option in reversed(tuple(options)):
            command = option(command)
        return command

    return add


dial_options = added(
    (
        click.option("--transition-time", metavar="auto|RULE|SECONDS", help="As of `sentence`."),
        click.option("--sign-speed", metavar="X", help="As of `sentence`."),
        click.option("--tempo", metavar="citation|natural|SECONDS", help="As of `sentence`."),
        click.option("--fps", metavar="N", help="As of `sentence`."),
        click.option("--cutter", metavar="NAME", help="As of `sentence`."),
        click.option("--transition", metavar="NAME", help="As of `sentence`."),
        click.option("--free-hand", metavar="transition|natural", help="As of `sentence`."),
        click.option("--avoid-collisions/--no-avoid-collisions", default=None, help="As of `sentence`."),
        click.option("--no-spell", is_flag=True, help="Rows with words that the lexicon lacks fail; none is spelled."),
    )
)


run_options = added(
    (
        OUT,
        LEXICON,
        click.option("--bundle", metavar="DIR", help="Folder of trained networks.  [default: those that ship]"),
        click.option("--workers", type=int, metavar="N", help="Processes, or actors of Ray.  [default: one per core]"),
        click.option("--ray", metavar="ADDRESS", help="Ray cluster to use instead: HOST:PORT, auto or local."),
        click.option(
            "--store",
            default="frames",
            show_default=True,
            metavar="frames|recipes",
            help="Clips and reports in tar files; or recipes and hashes alone, from which `bulk make` makes any row.",
        ),
        click.option("--format", default="npz", show_default=True, metavar="npz|bvh|glb", help="Of the clips."),
        click.option(
            "--poses/--no-poses",
            default=True,
            show_default=True,
            help="Positions of joints and annotations beside each clip, for sign-language-data-loading.",
        ),
        click.option("--shard-size", type=int, default=1000, show_default=True, metavar="N", help="Rows of a shard."),
        click.option(
            "--keep-words",
            type=int,
            default=2048,
            show_default=True,
            metavar="N",
            help="Words that a process keeps in memory, with what the networks read of them.",
        ),
    )
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
