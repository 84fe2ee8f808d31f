"""Commands that moved to the distribution ``signsplice-paper``: they are hidden, and name the new command."""

from __future__ import annotations

import click

from signsplice.errors import InputError

_ANY_WORDS = {"ignore_unknown_options": True, "allow_interspersed_args": False, "help_option_names": []}


def moved(former: str, *present: str, with_action: bool = False) -> click.Command:
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


TRAIN_PAPER = moved("train paper", "train-system")
COMMANDS = (moved("paper", with_action=True), moved("pairs", "pairs", with_action=True), moved("publish", "publish"))
