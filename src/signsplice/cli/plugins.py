"""Commands of other distributions, and the error line that names the one to install.

A distribution adds a command by an entry point in the group ``signsplice.commands``, named by the command's words:
``evaluate``, ``synth pairs``. It is loaded when it is called.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import click

from signsplice.errors import InputError

GROUP = "signsplice.commands"
_WORKSHOP = "signsplice-workshop"
"""Distribution of the training and evaluation commands."""
_PAPER = "signsplice-paper"
"""Distribution of the paper's commands."""
_FOLDERS = {_WORKSHOP: "./workshop", _PAPER: "./research"}
PSEUDO = "synth lexicon --pseudo"
ELSEWHERE = {
    "evaluate": (_WORKSHOP, "Measure every method, and print tables of it."),
    "export": (_WORKSHOP, "Write the networks of a bundle with 16-bit weights."),
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
"""Words of a command -> its distribution, followed by the words to call if it is a separate program; and its line in
``--help``, empty if it is not listed.
"""


def load(words: str) -> Any:
    """Load the entry point for the words of a command. Raises ``InputError`` if its distribution is not installed."""
    from importlib.metadata import distribution  # this import takes as long as the whole --help

    call, _ = ELSEWHERE[words]
    name = call.split()[0]
    try:
        (entry,) = distribution(name).entry_points.select(group=GROUP, name=words)
        return entry.load()
    except (ModuleNotFoundError, ValueError):  # not installed, or without an entry point for these words
        run = f" and run `{call}`" if name == _PAPER else ""
        line = f"`signsplice {words}` is in {name}: install it (pip install {_FOLDERS[name]}){run}"
        raise InputError(line) from None


class OpenGroup(click.Group):
    """A group of commands to which other distributions add commands; ``--help`` lists the installed ones."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, in order."""
        group = _words(ctx)
        plugin_names = (words.removeprefix(group) for words in ELSEWHERE if words.startswith(group))
        return [*dict.fromkeys([*self.commands, *sorted(name for name in plugin_names if " " not in name)])]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command of this distribution or of another."""
        words = _words(ctx) + cmd_name
        command = super().get_command(ctx, cmd_name)
        return _Elsewhere(words) if command is None and words in ELSEWHERE else command


class _Elsewhere(click.Command):
    """A command of another distribution."""

    def __init__(self, words: str) -> None:
        call, summary = ELSEWHERE[words]
        package = call.split()[0].replace("-", "_")
        super().__init__(words, help=summary, hidden=not summary or find_spec(package) is None)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Make the context of the loaded command. Raises ``InputError`` if its distribution is not installed."""
        words = str(self.name)
        longer = " ".join((words, *args[:1]))
        if longer in ELSEWHERE:
            load(longer)
        command: click.Command = load(words)
        return command.make_context(info_name, args, parent, **extra)


def _words(ctx: click.Context) -> str:
    """Return the words of a group after the program's name, each followed by a space."""
    return "" if ctx.parent is None else f"{_words(ctx.parent)}{ctx.info_name} "
