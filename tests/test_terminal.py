"""Texts from elsewhere on the terminal: names of joints, glosses and files show their control characters as escapes."""

from __future__ import annotations

import io
import json
import re
import sqlite3
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from signsplice import lexicon
from signsplice.cli import bulk, main, terminal
from signsplice.cli.terminal import note, one_line, visible, visible_output, warn
from signsplice.formats import save
from signsplice.motion import Clip
from signsplice.motion.face import Face

ESCAPE = "\x1b[2J\x1b]0;owned\x07\x9b31m\u202e"
"""Clears a terminal, names its window, turns it red, and writes from right to left."""
SHOWN = r"\x1b[2J\x1b]0;owned\x07\u009b31m\u202e"
Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def signsplice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Runs the command line in this process and in ``tmp_path``; returns status, output and errors, all visible."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["signsplice", *arguments])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capsys.readouterr()
        assert re.search("[^\n\t -~\xa0-\u2027\u2030-\u2065]", out + err) is None
        assert isinstance(stop.value.code, int)
        return stop.value.code, out, err

    return call


@pytest.fixture
def hostile(tmp_path: Path, words: dict[str, Clip]) -> Path:
    """A clip whose joints have such names, in a file of such a name."""
    save(words["HELLO"], tmp_path / "HELLO.bvh")
    text = (tmp_path / "HELLO.bvh").read_text(encoding="utf-8")
    file = tmp_path / f"{ESCAPE}.bvh"
    file.write_text(text.replace("mixamorig:", f"{ESCAPE}:"), encoding="utf-8")
    return file


def test_names_of_joints_and_files_are_shown_by_inspect(hostile: Path, signsplice: Call) -> None:
    status, out, _ = signsplice("inspect", hostile.name)
    assert status == 0
    assert re.search(rf"^file +{re.escape(SHOWN)}\.bvh$", out, re.M)
    assert re.search(rf"^ +rightHand +{re.escape(SHOWN)}:RightHand$", out, re.M)


def test_json_with_such_names_stays_json(hostile: Path, signsplice: Call) -> None:
    status, out, _ = signsplice("inspect", hostile.name, "--json")
    assert status == 0
    facts = json.loads(out)
    assert (facts["file"], facts["roles"]["rightHand"]) == (hostile.name, f"{ESCAPE}:RightHand")


def test_names_are_shown_in_errors_warnings_and_summaries(hostile: Path, signsplice: Call) -> None:
    status, _, err = signsplice("inspect", f"{ESCAPE}\n.bvh")
    assert status == 2
    assert err.startswith(f"error: {SHOWN}")
    assert err.count("\n") == 1
    status, out, err = signsplice("convert", hostile.name, f"{ESCAPE}.npz", "--rest-frame", "0")
    assert status == 0
    assert out.startswith(f"{SHOWN}.npz: ")
    assert err.startswith(f"warning: {SHOWN}: its zero pose")


@pytest.mark.parametrize(
    "arguments", [(ESCAPE,), (f"--{ESCAPE}",), ("inspect", f"--{ESCAPE}"), ("inspect", "a", ESCAPE)]
)
def test_a_wrong_call_shows_them_too(arguments: tuple[str, ...], signsplice: Call) -> None:
    status, _, err = signsplice(*arguments)
    assert status == 2
    assert err.startswith("error: ")
    assert r"\x1b[2J\x1b]0;owned\x07" in err


def test_texts_of_a_stranger_s_lexicon_are_shown(tmp_path: Path, words: dict[str, Clip], signsplice: Call) -> None:
    (tmp_path / "clips").mkdir()
    save(words["HELLO"], tmp_path / "clips" / "HELLO.bvh")
    lexicon.build(tmp_path / "clips", tmp_path / "lex")
    with closing(sqlite3.connect(tmp_path / "lex" / "index.sqlite")) as index, index:
        index.execute("UPDATE word SET signer = ?", (f"{ESCAPE}\nTWO  sign",))
    status, out, _ = signsplice("lexicon", "list", "lex")
    assert status == 0
    assert f"{SHOWN}\\x0aTWO" in out.splitlines()[0]
    status, out, _ = signsplice("lexicon", "list", "lex", "--json")
    assert json.loads(out)["words"][0]["signer"] == f"{ESCAPE}\nTWO  sign"
    with closing(sqlite3.connect(tmp_path / "lex" / "index.sqlite")) as index, index:
        index.execute("UPDATE word SET gloss = ?", (f"{ESCAPE}X",))
    status, out, err = signsplice("lexicon", "list", "lex")
    assert (status, out) == (2, "")
    assert r"\x1b[2J" in err


def test_blend_shapes_left_out_are_named_once(tmp_path: Path, words: dict[str, Clip], signsplice: Call) -> None:
    face = Face(("jawOpen", "tongueOut"), np.full((len(words["HELLO"]), 2), 0.5))
    save(replace(words["HELLO"], face=face), tmp_path / "face.glb")
    (tmp_path / "face.glb").write_bytes((tmp_path / "face.glb").read_bytes().replace(b"tongueOut", b"unknownly"))
    save(words["SIGN"], tmp_path / "SIGN.bvh")
    for onto in ([], ["--onto", "SIGN.bvh"]):
        status, _, err = signsplice("convert", "face.glb", "out.npz", *onto)
        assert status == 0
        assert err.count("morph target unknownly left out") == 1


def test_warnings_and_notes_are_one_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    warn(["a\nerror: b\x1b[m"])
    note(["a\r"])
    assert capsys.readouterr().err == "warning: a\\x0aerror: b\\x1b[m\nnote: a\\x0d\n"


def test_only_hidden_characters_are_changed() -> None:
    plain = "HELLO Ž שלום سلام می‌روم 手話 👋🏽 a\tb\nc"
    assert visible(plain) == plain
    assert one_line(plain) == plain.replace("\n", "\\x0a")
    hidden = "\0\x08\r\x1b\x7f\x85\x9b\u2028\u202a\u2069\udc9b"
    assert visible(hidden) == r"\x00\x08\x0d\x1b\u007f\u0085\u009b\u2028\u202a\u2069\udc9b"


class Terminal(io.StringIO):
    """Text that a terminal gets."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("bar", [terminal.progress, bulk._open_progress_bar])
def test_a_bar_keeps_its_control_sequences_and_lines_beside_it_show_theirs(
    bar: Callable[[str], AbstractContextManager[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    with visible_output():
        with bar("making"):
            warn(["\x1b[2J"])
        print("\x1b[3J", file=sys.stderr)
        print("step", end="\r", file=sys.stderr)
    assert sys.stderr is screen
    text = screen.getvalue()
    assert "\x1b[2K" in text
    assert re.search(r"\\x1b(?!\[[23]J)", text) is None
    assert "warning: \\x1b[2J" in text
    assert text.endswith("\\x1b[3J\nstep\r")
