"""Commands of other distributions, and the line that names the one to install.

A distribution brings a command by an entry point of the group ``signsplice.commands`` that is named by the command's
words: ``evaluate``, ``synth pairs``. It is loaded when it is called.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import click

from signsplice.errors import InputError

GROUP = "signsplice.commands"
_WORKSHOP, _PAPER = "signsplice-workshop", "signsplice-paper"
_FOLDERS = {_WORKSHOP: "./workshop", _PAPER: "./research"}
PSEUDO = "synth lexicon --pseudo"
ELSEWHERE = {
    "evaluate": (_WORKSHOP, "Measure every method, and print tables of it."),
    "export": (_WORKSHOP, "Write the networks of a bundle with 8-bit weights."),
    "train": (_WORKSHOP, "Train networks."),
    "synth pairs": (_WORKSHOP, "Write all ordered pairs of words with true cut frames, transitions and splits."),
    "synth endless": (_WORKSHOP, "Write signing to train networks on."),
    "synth sentences": (_WORKSHOP, "Write random sentences, and the ground truth of every seam."),
    "synth signing": (_WORKSHOP, "Write parts of a corpus of pairs as signing to train networks on."),
    PSEUDO: (_WORKSHOP, ""),
    "paper": (_PAPER, ""),
    "pairs": (f"{_PAPER} pairs", ""),
    "publish": (f"{_PAPER} publish", ""),
    "train paper": (f"{_PAPER} train-system", ""),
}
"""Words of a command -> the distribution that has it, with the words to call where it is a program of its own; and what
``--help`` says of it, empty where it is not listed.
"""


def load(words: str) -> Any:
    """What a distribution brings for the words of a command. Raises ``InputError`` where it is not installed."""
    from importlib.metadata import distribution  # takes as long as all of --help

    call, _ = ELSEWHERE[words]
    name = call.split()[0]
    try:
        (entry,) = distribution(name).entry_points.select(group=GROUP, name=words)
        return entry.load()
    except (ModuleNotFoundError, ValueError):  # not installed, or it brings nothing by these words
        run = f" and run `{call}`" if name == _PAPER else ""
        line = f"`signsplice {words}` is in {name}: install it (pip install {_FOLDERS[name]}){run}"
        raise InputError(line) from None


class OpenGroup(click.Group):
    """A group of commands to which other distributions add some; ``--help`` lists those that are installed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names of all commands, in order."""
        group = _words(ctx)
        others = (words.removeprefix(group) for words in ELSEWHERE if words.startswith(group))
        return sorted({*super().list_commands(ctx), *(name for name in others if " " not in name)})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command of this distribution or of another."""
        words = _words(ctx) + cmd_name
        here = super().get_command(ctx, cmd_name)
        return _Elsewhere(words) if here is None and words in ELSEWHERE else here


class _Elsewhere(click.Command):
    """A command of another distribution."""

    def __init__(self, words: str) -> None:
        call, summary = ELSEWHERE[words]
        package = call.split()[0].replace("-", "_")
        super().__init__(words, help=summary, hidden=not summary or find_spec(package) is None)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """The context of the command itself. Raises ``InputError`` where its distribution is not installed."""
        words = str(self.name)
        longer = " ".join((words, *args[:1]))
        if longer in ELSEWHERE:
            load(longer)
        command: click.Command = load(words)
        return command.make_context(info_name, args, parent, **extra)


def _words(ctx: click.Context) -> str:
    """The words of a group after the program's name, each with a space after it."""
    return "" if ctx.parent is None else f"{_words(ctx.parent)}{ctx.info_name} "
