"""Every command of the product works without workshop, research and torch, and theirs name what to install."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import signsplice as ss
from alone import ABSENT, SERVE, environment
from signsplice.cli import plugins
from signsplice.service import page

RUN = """
import io, json, sys
from contextlib import redirect_stderr, redirect_stdout
import click
import signsplice.bench.parts as parts
from signsplice import demo
from signsplice.cli.commands import app, run
from signsplice.render import film

demo.SENTENCE, film.GIF_SIZE = ("HELLO", "SIGN"), (96, 96)
parts.N_LEXICON, parts.N_LONG_FRAMES, parts.N_STREAM = 134, 300, 20
for call in json.load(sys.stdin):
    out, sys.argv = io.StringIO(), ["signsplice", *call]
    with redirect_stdout(out):
        message, status = run(app)
    print(json.dumps([message, status, out.getvalue()]))
"""
COMMANDS = """
demo --out demo
splice HELLO.bvh DEAF.bvh -o splice.glb --report splice.json
sentence HELLO DEAF -o sentence.bvh
inbetween HELLO.bvh --gap 30:38 -o between.bvh
inspect HELLO.bvh
convert HELLO.bvh HELLO.npz
render HELLO.bvh HELLO.png
view HELLO.bvh -o HELLO.html
lexicon build words -o lexicon
lexicon list lexicon
lexicon check lexicon --page lexicon.html
synth sign mine.signs KNOCK -o KNOCK.bvh
synth preview mine.signs KNOCK -o KNOCK.png
synth lexicon -o signed --signs mine.signs
bulk recipes -o recipes.csv --count 2 --words 2:3
bulk sentences recipes.csv -o bulk --workers 1 --store recipes
bulk pairs -o pairs --count 2 --workers 1 --store recipes
bulk make bulk 1 -o one.bvh
methods
bench --repeats 3
"""
KNOCK = "KNOCK  hands=one\n  X  shape=S at=space palm=down fingers=fwd\n  M  shift=0,-5,0 times=2\n  H\n"


def called(calls: list[list[str]], folder: Path, absent: tuple[str, ...] = ABSENT) -> list[tuple[str, int, str]]:
    """Error line, exit status and output of calls, one after another in a process where only the product is."""
    process = subprocess.run(
        [sys.executable, "-c", RUN],
        input=json.dumps(calls),
        env=environment(absent),
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stderr
    return [tuple(json.loads(line)) for line in process.stdout.splitlines()]


def test_what_is_absent_cannot_be_imported() -> None:
    for name in ABSENT:
        run = subprocess.run(
            [sys.executable, "-c", f"import {name}"], env=environment(), capture_output=True, text=True
        )
        assert "ModuleNotFoundError" in run.stderr


def test_every_command_works_alone(tmp_path: Path) -> None:
    pytest.importorskip("PIL")
    pytest.importorskip("pyarrow")
    (tmp_path / "words").mkdir()
    (tmp_path / "mine.signs").write_text(KNOCK, encoding="utf-8")
    with ss.open_lexicon() as words:
        for gloss in ("HELLO", "DEAF"):
            for folder in (tmp_path, tmp_path / "words"):
                ss.save(words.clip(gloss), folder / f"{gloss}.bvh")
    calls = [line.split() for line in COMMANDS.strip().splitlines()]
    calls = [call for call in calls if call[0] != "view" or page.BUILT.is_dir()]
    for call, (message, status, _) in zip(calls, called(calls, tmp_path), strict=True):
        assert (message, status) == ("", 0), call


def test_a_page_is_written_without_the_packages_of_the_service(tmp_path: Path) -> None:
    with ss.open_lexicon() as words:
        ss.save(words.clip("HELLO"), tmp_path / "HELLO.bvh")
    calls = [["view", "HELLO.bvh", "-o", "HELLO.html"], ["view", "HELLO.bvh", "--no-browser"], ["serve"]]
    (message, status, _), *live = called(calls, tmp_path, (*ABSENT, *SERVE))
    for needs, code, _ in live:
        assert "pip install '.[serve]'" in needs
        assert code == 1
    if page.BUILT.is_dir():
        assert (message, status) == ("", 0)
        assert '"live": false' in (tmp_path / "HELLO.html").read_text(encoding="utf-8")
    else:
        assert "run `make viewer`" in message
        assert status == 1


def test_the_help_of_every_command_is_shown_alone(tmp_path: Path) -> None:
    groups = [[], ["lexicon"], ["synth"], ["bulk"], ["bench"]]
    shown = called([[*group, "--help"] for group in groups], tmp_path)
    names = [
        [line.split()[0] for line in out.partition("Commands:\n")[2].splitlines() if line[2] != " "]
        for _, _, out in shown
    ]
    assert {"splice", "serve", "bench"} <= set(names[0])
    assert not {"evaluate", "train", "export"} & set(names[0])
    assert names[2] == ["lexicon", "preview", "sign"]
    calls = [[*group, name, "--help"] for group, own in zip(groups, names, strict=True) for name in own]
    for call, (message, status, out) in zip(calls, called(calls, tmp_path), strict=True):
        assert (message, status) == ("", 0), call
        assert out.startswith("Usage: "), call


def test_a_word_of_another_distribution_gives_one_line(tmp_path: Path) -> None:
    calls = [words.replace(" --pseudo", " -o out --pseudo 1").split() for words in plugins.ELSEWHERE]
    for words, (message, status, out) in zip(plugins.ELSEWHERE, called(calls, tmp_path), strict=True):
        name = plugins.ELSEWHERE[words][0].split()[0]
        assert message.startswith(f"`signsplice {words}` is in {name}: install it (pip install ./")
        assert (status, out) == (2, "")
    assert list(tmp_path.iterdir()) == []
