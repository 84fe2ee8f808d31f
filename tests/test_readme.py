"""What the README shows runs as it stands, and fits on a few screens."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import signsplice as ss

README = (Path(__file__).resolve().parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_five_lines_of_python_write_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len([line for line in block.splitlines() if line.strip()]) <= 5
    exec(block, {})
    clip = ss.load("sentence.glb")
    words = ss.open_lexicon()
    assert 0 < clip.seconds < words.clip("HELLO").seconds + words.clip("DEAF").seconds


def test_the_readme_is_short_and_counts_what_ships() -> None:
    assert len(README.split()) <= 700
    letters = [entry for entry in ss.open_lexicon().entries() if entry.gloss.startswith("fs-")]
    assert f"{len(ss.open_lexicon()) - len(letters)} words that ship" in README
    numbers = {18: "eighteen", 19: "nineteen"}
    assert f"{numbers[len(ss.__all__)]} public names" in README
