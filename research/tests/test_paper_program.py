"""The program `signsplice-paper`: its exit statuses, its help, and what it imports before a command is called."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest
from click.testing import CliRunner

from signsplice_paper.cli.commands import app

RESEARCH = Path(__file__).resolve().parents[1]


def program(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    call = [sys.executable, "-m", "signsplice_paper", *arguments]
    return subprocess.run(call, cwd=cwd, capture_output=True, text=True, check=False, timeout=120)


def test_a_wrong_call_ends_in_one_line_with_status_2(tmp_path: Path) -> None:
    run = program("tables", "--out", "nowhere", cwd=tmp_path)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == "error: nowhere/results.json: not there; `signsplice-paper evaluate` or `all` makes it\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "call",
    [("tables", "--pairs", "x"), ("speed", "--system", "lpt-plus"), ("judge", "--steps", "3"), ("merge", "--again")],
)
def test_an_action_has_no_option_that_it_does_not_use(call: tuple[str, ...]) -> None:
    result = CliRunner().invoke(app, call)
    assert result.exit_code == 2
    assert re.search(f"No such option:? '?{call[1]}", result.output), result.output


def test_every_command_has_a_help_without_numpy_or_torch() -> None:
    for name in app.commands:
        shown = CliRunner().invoke(app, [name, "-h"])
        assert shown.exit_code == 0, name
        assert len(shown.output.splitlines()) > 5
    code = "import sys, signsplice_paper.cli.commands; print({'numpy', 'rich', 'torch'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_what_the_distribution_registers_is_there() -> None:
    project = tomllib.loads((RESEARCH / "pyproject.toml").read_text())["project"]
    places = [*project["scripts"].values(), *project["entry-points"]["signsplice.systems"].values()]
    for module, name in (place.split(":") for place in places):
        assert callable(getattr(import_module(module), name))
