"""Options that several commands share, each defined once, and a decorator that adds a list of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])


def added(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """A decorator that adds options to a command, in this order."""

    def add(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add


AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
BUNDLE = click.option("--bundle", metavar="DIR", help="Folder of trained networks.  [default: those that ship]")
LEXICON = click.option("--lexicon", metavar="LEX", help="Lexicon of the words.  [default: the one that ships]")
ROLES = click.option("--roles", metavar="FILE", help="JSON of role -> joint name, for rigs not known by name.")
SEED = click.option(
    "--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True, metavar="N", help="Seed of the draw."
)
PROCESSES = click.option(
    "--processes", type=int, default=2, show_default=True, metavar="N", help="Number of processes."
)
