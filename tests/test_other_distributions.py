"""What other distributions bring: systems by entry points; and the commands that moved to one."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.splicing import systems as whole_system
from test_cli import run_program

BUNDLE = '{"version": 1, "system": "somebody-else", "files": {}}'
OPENER = """
from signsplice.errors import InputError

def opens(folder):
    if "ours" not in str(folder):
        raise InputError(f"{folder}: is none of ours")
    return f"opened {folder}"
"""


def install(folder: Path, name: str) -> None:
    """A distribution with a module of its name, which opens some folders as systems."""
    (folder / f"{name}.py").write_text(OPENER.replace("ours", name))
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[{whole_system.GROUP}]\n{name} = {name}:opens\n")


def test_the_distribution_that_knows_a_system_opens_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("firstsystems", "secondsystems"):
        install(tmp_path, name)
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("firstsystems", "secondsystems"):
        assert str(whole_system.open_system(f"in/{name}")) == f"opened in/{name}"
    with pytest.raises(InputError, match="in/x"):
        whole_system.open_system("in/x")


def test_a_system_that_nothing_opens_names_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_system, "entry_points", lambda **_: ())
    (tmp_path / "bundle.json").write_text(BUNDLE)
    call = ["sentence", "HELLO I", "-o", str(tmp_path / "out.bvh"), "--system", str(tmp_path)]
    result = CliRunner().invoke(app, call)
    assert isinstance(result.exception, InputError), result.output
    line = f"{tmp_path}: a system that signsplice-paper opens: install it (pip install ./research)"
    assert str(result.exception) == line


@pytest.mark.parametrize(
    ("words", "command"),
    [
        ("paper tables --out x", "signsplice-paper tables"),
        ("paper all --scale cpu extra", "signsplice-paper all"),
        ("paper", "signsplice-paper"),
        ("paper --help", "signsplice-paper"),
        ("train paper --pairs out/pairs --system lpt --out b", "signsplice-paper train-system"),
        ("publish a b -o c", "signsplice-paper publish"),
        ("pairs build clips -o out", "signsplice-paper pairs build"),
        ("pairs export out -o clips", "signsplice-paper pairs export"),
        ("pairs -h", "signsplice-paper pairs"),
    ],
)
def test_a_command_that_moved_names_the_new_one(words: str, command: str) -> None:
    result = CliRunner().invoke(app, words.split())
    assert isinstance(result.exception, InputError), result.output
    assert str(result.exception).endswith(f"(pip install ./research) and run `{command}`")


def test_a_command_that_moved_ends_in_one_line_with_status_2(tmp_path: Path) -> None:
    run = run_program("-m", "signsplice", "train", "paper", "--pairs", "x", cwd=tmp_path)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == (
        "error: `signsplice train paper` moved: install signsplice-paper (pip install ./research) and run "
        "`signsplice-paper train-system`\n"
    )


def test_commands_that_moved_are_not_in_the_help() -> None:
    for call, moved in ((["-h"], "paper|pairs|publish"), (["train", "-h"], "paper")):
        shown = CliRunner().invoke(app, call).output
        assert not re.search(rf"^  ({moved}) ", shown, re.M), shown
