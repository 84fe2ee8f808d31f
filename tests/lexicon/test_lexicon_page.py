"""The page about a lexicon: its figures, and which words are doubtful."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from signsplice import lexicon
from signsplice.cli.lexicon import lexicon as commands
from signsplice.lexicon import page as lexicon_page
from signsplice.motion import rotation

pytest.importorskip("PIL")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    with lexicon.open_shipped_lexicon() as words, lexicon.building(folder / "lex") as builder:
        good = words.clip("HELLO")
        builder.add(good, "<HELLO>")
        still = np.broadcast_to(good.local_rotations[:1], good.local_rotations.shape)
        builder.add(replace(good, local_rotations=still, channels=None), "STILL")
        jump = np.array(good.local_rotations)
        jump[40:, 3] = rotation.multiply(jump[40:, 3], rotation.exp([0.0, 2.5, 0.0]))
        builder.add(replace(good, local_rotations=jump, channels=None), "JUMP")
        builder.add(good[30:36], "SHORT")
    return folder / "lex"


def test_words_with_faults_are_doubtful_and_drawn(path: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    with lexicon.open(path) as words:
        found = {one.gloss: one for one in lexicon_page.write(words, page)}
    assert {gloss for gloss, one in found.items() if not one.doubts} == {"<HELLO>"}
    assert any("degrees/s" in line for line in found["JUMP"].doubts)
    assert found["SHORT"].seconds == pytest.approx(0.2)
    assert found["JUMP"].fastest_deg_s == pytest.approx(np.rad2deg(2.5) * 30.0, rel=0.05)
    text = page.read_text()
    assert "&lt;HELLO&gt;" in text
    assert "<HELLO>" not in text
    assert "data:image/png;base64," in text


def test_the_command_says_how_many_words_are_doubtful(path: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    done = CliRunner().invoke(commands, ["check", str(path), "--page", str(page)])
    assert f"{page}: 3 of 4 words are doubtful" in done.stdout
    refused = CliRunner().invoke(commands, ["check", str(tmp_path), "--page", str(page)])
    assert "is no lexicon, expected one for --page" in str(refused.exception)
