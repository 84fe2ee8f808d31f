"""Former names of options and commands: those that still work, which the help does not show, and those that moved."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import click

from signsplice.cli.terminal import note
from signsplice.errors import InputError

_MEASURES = {name: name for name in ("clips", "seams", "pairs", "bodies", "tempo")} | {"joins": "seams"}
"""Former option of `evaluate` -> the command that measures the same."""
_FLAGS = ("--json", "--no-limits", "--help")


def former_names(names: Mapping[str, str]) -> dict[str, Any]:
    """Context settings of a command whose options have former names: former -> present, without dashes."""
    return {"token_normalize_func": lambda name: names.get(name, name)}


class FormerlyOptions(click.Group):
    """The group `evaluate`, whose commands were options: `evaluate [BUNDLE] --seams N`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """The rest of the call, by present words."""
        if args and args[0] not in self.commands and any(word.split("=")[0][2:] in _MEASURES for word in args):
            args = self._present_words(args)
            _say(["evaluate", *args])
        return super().parse_args(ctx, args)

    def _present_words(self, args: Sequence[str]) -> list[str]:
        measured, others = _former_parts(args)
        files = measured.pop("clips", []) if "bodies" in measured else []  # clips to bring to other bodies
        if len(measured) != 1:
            raise InputError(f"expected one of `signsplice evaluate {'|'.join(self.commands)}`")
        ((name, values),) = measured.items()
        known = {word for option in self.commands[name].params for word in option.opts}
        for option, _ in others:
            if option in _REFUSED_ELSEWHERE and option not in known:
                raise InputError(f"`evaluate {name}` has no {option}, see `signsplice evaluate {name} --help`")
        kept = [word for option, given in others if option in known or option == "--help" for word in (option, *given)]
        kept += [word for file in files for word in ("--clips", file)]
        return [name, *(() if files else values), *kept]


_REFUSED_ELSEWHERE = ("--rest", "--picture")
"""Former options that were refused where they had no meaning; the others were passed over, and are now."""


def _former_parts(args: Sequence[str]) -> tuple[dict[str, list[str]], list[tuple[str, list[str]]]]:
    """What a call of former words measures, with its values, and the other options with theirs."""
    measured: dict[str, list[str]] = {}
    others: list[tuple[str, list[str]]] = []
    words = [part for word in args for part in (word.split("=", 1) if word.startswith("--") else [word])]
    while words:
        option = words.pop(0)
        if not option.startswith("-"):
            others.append(("--bundle", [option]))
            continue
        alone = option in _FLAGS or (option == "--bodies" and words[:1] and words[0].startswith("-"))
        given = [] if alone else [words.pop(0) for _ in words[:1]]
        if option[2:] in _MEASURES:
            measured.setdefault(_MEASURES[option[2:]], []).extend(given)
        else:
            others.append((option, given))
    return measured, others


def formerly_a_flag(name: str, command: str) -> type[click.Group]:
    """A group one of whose commands was a flag of the whole: `bench --service` is `bench service`."""

    class Group(click.Group):
        def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
            if name in args:
                args = [command, *(word for word in args if word != name)]
                _say([str(ctx.info_name), *args])
            return super().parse_args(ctx, args)

    return Group


def moved(former: str, command: click.Command, present: str) -> click.Command:
    """A hidden command of former words that does what ``command`` does, and notes its present words."""

    @click.pass_context
    def call(ctx: click.Context, /, **given: Any) -> Any:
        note([f"`signsplice {former}` is now `signsplice {present}`"])
        return ctx.invoke(command, **given)

    return click.Command(former.split()[-1], callback=call, params=command.params, hidden=True, help=command.help)


def _say(words: Sequence[str]) -> None:
    note([f"this call is now: signsplice {shlex.join(words)}"])


_ANY_WORDS = {"ignore_unknown_options": True, "allow_interspersed_args": False, "help_option_names": []}


def moved_to_paper(former: str, *present: str, with_action: bool = False) -> click.Command:
    """A hidden command that names the one of `signsplice-paper` that does its work now.

    ``with_action``: the word that follows, if there is one, belongs to both commands' names.
    """

    @click.command(former.split()[-1], hidden=True, context_settings=_ANY_WORDS)
    @click.argument("words", nargs=-1, type=click.UNPROCESSED)
    def command(words: tuple[str, ...]) -> None:
        action = words[:1] if with_action and words and not words[0].startswith("-") else ()
        was, now = " ".join(("signsplice", former, *action)), " ".join(("signsplice-paper", *present, *action))
        raise InputError(f"`{was}` moved: install signsplice-paper (pip install ./research) and run `{now}`")

    return command


TRAIN_PAPER = moved_to_paper("train paper", "train-system")
COMMANDS = (
    moved_to_paper("paper", with_action=True),
    moved_to_paper("pairs", "pairs", with_action=True),
    moved_to_paper("publish", "publish"),
)
