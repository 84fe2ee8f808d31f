"""Options shared by several commands, and a decorator that adds a list of options."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from signsplice.errors import InputError

Command = TypeVar("Command", bound=Callable[..., Any])


def combine_options(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Return a decorator that adds options to a command, in this order."""

    def add(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def option(names: str, metavar: str | None, text: str, **kind: Any) -> Callable[[Command], Command]:
    """Return an option; ``names`` are separated by blanks, and the last one is the parameter's if it has no hyphens."""
    return click.option(*names.split(), metavar=metavar, help=text, **kind)


def flag(names: str, text: str, **kind: Any) -> Callable[[Command], Command]:
    """Return an option without a value; ``names`` as in ``option``."""
    return option(names, None, text, is_flag=True, **kind)


def preset(name: str, default: Any, metavar: str | None, text: str, **kind: Any) -> Callable[[Command], Command]:
    """Return an option with a default, shown in its help; it has the default's type unless ``kind`` gives one."""
    return option(name, metavar, text, default=default, show_default=True, **kind)


def two_numbers(text: str, between: str, expected: str) -> tuple[int, int]:
    """Parse the two numbers of an option's text around ``between``. Raises ``InputError(expected)`` otherwise."""
    first, _, second = text.partition(between)
    if not (first.isdecimal() and second.isdecimal()):
        raise InputError(expected)
    return int(first), int(second)


_GROUPS = {
    "Words": "lexicons fallback no_spell no_compounds drop_function_words language one_language",
    "Motion": "gaps transition_time sign_speed tempo no_pauses avoid_collisions onto",
    "Face and person": "faces face_offset face_rules mouthing free_hand person avatar skin",
    "Output": "output fps report view size",
    "How clips are read": "roles rest_frame take input_fps face_fps no_limits",
    "For researchers": "cutter transition bundle system fill_misses seed",
}
"""Title of a part of the help of commands that join words -> the parameters in it."""


class GroupedCommand(click.Command):
    """A command whose help shows its options in ``_GROUPS``."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write every option, under the title of its group."""
        options = [param for param in self.get_params(ctx) if isinstance(param, click.Option)]
        records = {option.name: option.get_help_record(ctx) for option in options}
        groups = {title: [records.pop(name, None) for name in names.split()] for title, names in _GROUPS.items()}
        for title, rows in {**groups, "Other options": [*records.values()]}.items():
            if shown := [row for row in rows if row]:
                with formatter.section(title):
                    formatter.write_dl(shown)


AS_JSON = flag("--json as_json", "Print one JSON document.")
BUNDLE = option("--bundle", "DIR", "Folder of trained networks.  [default: those that ship]")
LEXICON = option("--lexicon", "LEX", "Lexicon of the words.  [default: the one that ships]")
LEXICONS = option(
    "--lexicon lexicons",
    "LEX",
    "Lexicon of the words; given again, the first that has a word counts. None, or `default`: the words that ship.",
    multiple=True,
)
READING = combine_options(
    flag(
        "--drop-function-words",
        "Leave out a, an, the, am, is, are, was, were, be, and do before a pronoun: ASL has no signs for them.",
    ),
    preset(
        "--language", "en", "CODE", 'Of the words (en, de, fr; "" for none), of the signs (ase, gsg), or both (en-gsg).'
    ),
    flag("--one-language", "Refuse signs of several languages, or of another than --language names, with an error."),
)
SEEDS = click.IntRange(0, 2**63 - 1)
SEED = preset("--seed", 0, "N", "Seed of the draw.", type=SEEDS)
