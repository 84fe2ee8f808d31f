"""What the README shows runs as it stands, and fits on a few screens."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

import signsplice as ss
from signsplice import demo
from signsplice.cli.commands import app
from signsplice.render import film
from signsplice.service import page

README = (Path(__file__).resolve().parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_five_lines_of_python_write_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len([line for line in block.splitlines() if line.strip()]) <= 5
    exec(block, {})
    clip = ss.load("sentence.glb")
    words = ss.open_lexicon()
    clips = [words.clip("HELLO"), words.clip("DEAF")]
    assert 0 < clip.seconds < clips[0].seconds + clips[1].seconds
    (call,) = re.findall(r"`(ss\.splice\(.*\))`", README)
    assert eval(call, {"ss": ss, "clips": clips}).system["name"] == "lptransformer"


@pytest.mark.slow
def test_the_commands_run_after_the_demo_and_write_what_they_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(film, "GIF_SIZE", (96, 96))
    demo.run(Path("out/demo"))
    commands = re.findall(r"^    signsplice (.*)$", README, re.MULTILINE)
    assert len(commands) >= 4
    for command in commands:
        if command.startswith("view") and not page.BUILT.is_dir():
            continue  # `make viewer` builds it
        words = shlex.split(command, comments=True)
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, (command, done.output)
        assert Path(words[words.index("-o") + 1] if "-o" in words else words[2]).stat().st_size > 10_000


def test_the_readme_is_short_and_counts_what_ships() -> None:
    assert len(README.split()) <= 600
    letters = [entry for entry in ss.open_lexicon().entries() if entry.gloss.startswith("fs-")]
    assert f"{len(ss.open_lexicon()) - len(letters)} words that ship" in README
    assert f"{len(ss.__all__)} public names" in README
