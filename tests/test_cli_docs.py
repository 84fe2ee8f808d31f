"""docs/cli.md names every command, and no option that there is not; the help explains every option."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import signsplice
from signsplice.cli import plugins
from signsplice.cli.commands import app
from signsplice.cli.plugins import ELSEWHERE
from signsplice.splicing.options import all_methods

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "cli.md").read_text(encoding="utf-8")


def commands(group: click.Group = app, parent: click.Context | None = None) -> Iterator[tuple[str, click.Command]]:
    """Words of a command -> the command, those of the workshop among them."""
    context = click.Context(group, parent, group.name, **group.context_settings)
    words = " ".join(context.command_path.split()[1:])
    for name in group.list_commands(context):
        command, path = group.get_command(context, name), f"{words} {name}".strip()
        assert command is not None
        if command.hidden:
            continue
        if path in ELSEWHERE:
            command = plugins.load(path)
        yield path, command
        if isinstance(command, click.Group):
            yield from commands(command, context)


COMMANDS = dict(commands())


def test_the_help_of_all_commands_is_read() -> None:
    assert {"splice", "bulk pairs", "evaluate seams", "train cutter", "synth endless"} <= set(COMMANDS)


def is_of_the_product(path: str) -> bool:
    return not any(path == words or path.startswith(f"{words} ") for words in ELSEWHERE)


def is_on_the_page(path: str) -> bool:
    """Whether the page names a command in code, alone or with what follows it."""
    return re.search(rf"`{re.escape(path)}[` ]", PAGE) is not None


@pytest.mark.parametrize("path", [path for path in COMMANDS if is_of_the_product(path)])
def test_the_page_names_a_command_of_the_product(path: str) -> None:
    assert is_on_the_page(path)


def test_the_page_names_the_commands_of_the_workshop_and_leads_to_its_pages() -> None:
    """Those pages describe their subcommands."""
    others = [path for path in COMMANDS if path in ELSEWHERE]
    assert {"evaluate", "train", "synth pairs"} <= set(others)
    assert [path for path in others if not is_on_the_page(path)] == []
    assert "](../workshop/docs/" in PAGE


@pytest.mark.parametrize("path", COMMANDS)
def test_the_help_explains_a_command_and_its_options(path: str) -> None:
    command = COMMANDS[path]
    assert command.help
    options = [one for one in command.params if isinstance(one, click.Option) and not one.hidden]
    assert [one.opts for one in options if len((one.help or "").split()) < 2] == []


@pytest.mark.parametrize("path", ["splice", "sentence", "inbetween"])
def test_the_help_of_a_command_that_joins_words_has_groups(path: str) -> None:
    text = COMMANDS[path].get_help(click.Context(COMMANDS[path], info_name=path))
    titles = re.findall(r"^(\w.*):$", text, re.MULTILINE)
    assert titles[-5:] == ["Face and person", "Output", "How clips are read", "For researchers", "Other options"]
    others = re.findall(r"^ +(-.*?)  ", text.partition("Other options:")[2], re.MULTILINE)
    assert [line.split()[-1] for line in others] == ["--help"]


def test_the_help_lists_commands_in_the_order_of_a_users_day() -> None:
    names = app.list_commands(click.Context(app, info_name="signsplice"))
    assert names[:4] == ["demo", "sentence", "splice", "inbetween"]
    assert names.index("render") < names.index("lexicon") < names.index("bulk") < names.index("bench")


def test_the_page_names_no_option_that_there_is_not() -> None:
    known = {
        name
        for command in COMMANDS.values()
        for option in command.params
        for name in (*option.opts, *option.secondary_opts)
    }
    shown = set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", PAGE))
    assert shown <= known | {"--help"}


def test_errors_of_the_library_name_no_option() -> None:
    """The command line's options are its own; the library names arguments."""
    found = []
    for path in (Path(signsplice.__file__).parent).rglob("*.py"):
        if "cli" in path.parts:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise):
                texts = [one.value for one in ast.walk(node) if isinstance(one, ast.Constant)]
                found += [text for text in texts if isinstance(text, str) and re.search(r"(?<![\w-])--[a-z]", text)]
    assert [text for text in found if "`ray start --head`" not in text] == []


def test_the_page_names_every_method() -> None:
    first_cells = "\n".join(line.split("|")[1] for line in PAGE.splitlines() if line.startswith("| `"))
    assert {method.name for _, method, _ in all_methods()} <= set(re.findall(r"`([\w-]+)`", first_cells))
