"""What other distributions bring by entry points: systems and commands."""

from __future__ import annotations

import re
from importlib import metadata
from pathlib import Path

import pytest
from click.testing import CliRunner

from signsplice.cli import plugins
from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.splicing import lptransformer
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
    """A distribution with a module of its name, which opens some folders as systems, and such a folder."""
    (folder / "in" / name).mkdir(parents=True)
    (folder / "in" / name / "bundle.json").write_text(BUNDLE)
    (folder / f"{name}.py").write_text(OPENER.replace("ours", name))
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[{lptransformer.GROUP}]\n{name} = {name}:opens\n")


def test_the_distribution_that_knows_a_system_opens_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("firstsystems", "secondsystems"):
        install(tmp_path, name)
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("firstsystems", "secondsystems"):
        folder = tmp_path / "in" / name
        assert str(lptransformer.open_system(folder)) == f"opened {folder}"
    (tmp_path / "bundle.json").write_text(BUNDLE)
    with pytest.raises(InputError, match="has no 'runs'"):
        lptransformer.open_system(tmp_path)


def test_a_system_that_nothing_opens_names_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lptransformer, "entry_points", lambda **_: ())
    (tmp_path / "bundle.json").write_text(BUNDLE)
    call = ["sentence", "HELLO I", "-o", str(tmp_path / "out.bvh"), "--system", str(tmp_path)]
    result = CliRunner().invoke(app, call)
    assert isinstance(result.exception, InputError), result.output
    line = f"{tmp_path}: a system that signsplice-paper opens: install it (pip install ./research)"
    assert str(result.exception) == line


@pytest.mark.parametrize("words", plugins.ELSEWHERE)
def test_a_command_that_is_not_installed_names_its_distribution(words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", nothing)
    call, _ = plugins.ELSEWHERE[words]
    name = call.split()[0]
    typed = "synth lexicon -o out --pseudo 1" if words == plugins.PSEUDO else f"{words} --some option"
    result = CliRunner().invoke(app, typed.split())
    assert isinstance(result.exception, InputError), result.output
    folder = {"signsplice-workshop": "./workshop", "signsplice-paper": "./research"}[name]
    line = f"`signsplice {words}` is in {name}: install it (pip install {folder})"
    assert str(result.exception) == line + (f" and run `{call}`" if name == "signsplice-paper" else "")


def test_a_word_of_the_paper_ends_in_one_line_with_status_2(tmp_path: Path) -> None:
    run = run_program("-m", "signsplice", "train", "paper", "--pairs", "x", cwd=tmp_path)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == (
        "error: `signsplice train paper` is in signsplice-paper: install it (pip install ./research) and run "
        "`signsplice-paper train-system`\n"
    )


def test_the_help_lists_the_commands_that_are_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    listed = {(): r"^  (evaluate|export|train) ", ("synth",): r"^  (pairs|endless|sentences|signing) "}
    for group, pattern in listed.items():
        assert re.search(pattern, CliRunner().invoke(app, [*group, "-h"]).output, re.M)
    monkeypatch.setattr(plugins, "find_spec", lambda _: None)
    for group, pattern in listed.items():
        assert not re.search(pattern, CliRunner().invoke(app, [*group, "-h"]).output, re.M)


def test_words_of_the_paper_are_not_in_the_help() -> None:
    shown = CliRunner().invoke(app, ["-h"]).output
    assert not re.search(r"^  (paper|pairs|publish) ", shown, re.M), shown
