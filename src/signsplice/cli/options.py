"""Options that several commands share, each defined once, and a decorator that adds a list of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from signsplice.errors import InputError

Command = TypeVar("Command", bound=Callable[..., Any])


def added(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """A decorator that adds options to a command, in this order."""

    def add(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def preset(name: str, default: Any, metavar: str | None, text: str, **kind: Any) -> Callable[[Command], Command]:
    """An option with a default, which its help shows; of the default's type where ``kind`` names none."""
    return click.option(name, default=default, show_default=True, metavar=metavar, help=text, **kind)


def two_numbers(text: str, between: str, expected: str) -> tuple[int, int]:
    """The numbers of an option's text before and after ``between``; an ``InputError`` says what is expected instead."""
    first, _, second = text.partition(between)
    if not (first.isdecimal() and second.isdecimal()):
        raise InputError(expected)
    return int(first), int(second)


AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
BUNDLE = click.option("--bundle", metavar="DIR", help="Folder of trained networks.  [default: those that ship]")
LEXICON = click.option("--lexicon", metavar="LEX", help="Lexicon of the words.  [default: the one that ships]")
LEXICONS = click.option(
    "--lexicon",
    "lexicons",
    multiple=True,
    metavar="LEX",
    help="Lexicon of the words; given again, the first that has a word counts; default: the words that ship.",
)
DROP_FUNCTION_WORDS = click.option(
    "--drop-function-words",
    is_flag=True,
    help="Leave out a, an, the, am, is, are, was, were, be, and do before a pronoun: ASL has no signs for them.",
)
ROLES = click.option("--roles", metavar="FILE", help="JSON of role -> joint name, for rigs not known by name.")
SEED = preset("--seed", 0, "N", "Seed of the draw.", type=click.IntRange(0, 2**63 - 1))
