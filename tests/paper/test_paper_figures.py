"""Figures come out of results alone, the same bytes each time, and the command that makes them keeps its promises."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import ClassVar

import click
import numpy as np
import pytest
from click.testing import CliRunner
from toys import Fake, corpus, of_rows, row, write_bundle

from signsplice import cli
from signsplice.cli import paper as command
from signsplice.errors import InputError, MissingExtraError, SignspliceError
from signsplice.paper import figures, judging, kept_frames, pictures, plan, published, results
from signsplice.paper.kept_frames import KeptFrames
from signsplice.paper.protocol import choose
from signsplice.paper.results import Curve, Results


def measured() -> Results:
    rows = [row(s, fr=8 if s == "lpt" else None) for s in (*published.TABLE_1, *published.TABLE_3)]
    rows += [row("lpt", fr=fr) for fr in (4, 6)]
    points = [(float(k), 0.9 + 0.001 * k) for k in range(20)]
    curves = [Curve(r.system, "random", "cpu", "adamw", r.fr, 0, points) for r in rows]
    return of_rows(*rows).merged(curves=curves)


def pictured() -> list[KeptFrames]:
    chosen = kept_frames.choose(corpus(), choose(corpus(), "random"), 2)
    made = {kept_frames.label(s, "cpu", "adamw"): d for s, d in (("lstm", 0.01), ("transformer", 0.3), ("lpt", 0.0))}
    out = []
    for shot in chosen:
        frames = {name: shot.truth + by for name, by in made.items()}
        frames[kept_frames.label("transformer", "cpu", "adamw")] = shot.truth[:-1] + 0.3
        out.append(replace(shot, made=frames))
    return out


def test_every_figure_is_drawn_the_same_each_time(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
    written, left_out = figures.write(measured(), pictured(), one, "cpu")
    names = ["figure4a", "figure4b", "figure4c", "figure4d", "figure5a", "figure5b", "figure6", "figure7"]
    assert sorted(path.name for path in written) == sorted(f"{n}{s}" for n in names for s in (".png", ".svg"))
    assert set(left_out) == {f"{name}-sgd" for name in names[:6]}
    assert all(path.stat().st_size > 5000 for path in written)
    few = of_rows(*(row(s) for s in published.TABLE_1))
    again = figures.write(few, pictured()[:1], two, "cpu")[0]
    assert [path.name for path in again] == ["figure4d.png", "figure4d.svg", "figure6.png", "figure6.svg"]
    for name in ("figure6.png", "figure6.svg"):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name
    assert figures.write(Results(), [], one, "cpu")[0] == []


def test_pictures_show_what_is_there() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    (shot, *_) = pictured()
    rows = [name for name, _ in pictures._rows(shot, "cpu")]
    assert rows == ["truth", "LSTM", "Transformer", "LpTransformer"]
    assert pictures.draw_shots(pyplot, [replace(shot, made={})], "cpu") is None
    assert pictures.draw_shots(pyplot, [], "cpu") is None
    frame = corpus().word(0)[20:21].astype(np.float64)
    assert sum(len(bones) for bones, _, _ in pictures._bones(frame, None)) == 43 + 24, "no legs; the head is a ring"
    assert sum(len(bones) for bones, _, _ in pictures._bones(frame, "Right")) == 16
    for count in (2, 5, 10, 40):
        shown = pictures._shown(count, 10)
        assert (shown[0], shown[-1]) == (0, count - 1)
        assert len(shown) == min(count, 10)


def test_lines_end_at_the_edge_of_their_picture() -> None:
    low, high = np.zeros(2), np.ones(2)
    lines = np.array(
        [
            [[-1, 0.5], [2, 0.5]],
            [[0.2, 0.2], [0.4, 0.4]],
            [[-1, -1], [-2, 3]],
            [[0.5, -1], [0.5, 0.5]],
            [[2, 2], [2, 3]],
        ],
        float,
    )
    found = pictures.clipped(lines, low, high)
    assert np.allclose(found, [[[0, 0.5], [1, 0.5]], [[0.2, 0.2], [0.4, 0.4]], [[0.5, 0], [0.5, 0.5]]])


def run(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(command.paper, arguments)
    if isinstance(done.exception, (InputError, MissingExtraError)):
        return 2 if isinstance(done.exception, InputError) else 1, str(done.exception)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def test_tables_and_figures_need_nothing_but_results(tmp_path: Path) -> None:
    results.save(measured(), tmp_path / judging.RESULTS)
    code = (
        "import sys, signsplice.cli as c\n"
        f"c.app.main(['paper', 'table1', '--out', {str(tmp_path)!r}], standalone_mode=False)\n"
        "print(sorted({'torch', 'matplotlib', 'onnxruntime'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert (tmp_path / "table1.md").is_file()
    assert not (tmp_path / "table3.md").exists()
    assert run("table3", "--out", str(tmp_path))[0] == 0
    assert "no row of scale paper" in run("table3", "--out", str(tmp_path), "--scale", "paper")[1]


def test_errors_of_the_command_are_one_line(tmp_path: Path) -> None:
    out = ("--out", str(tmp_path / "out"))
    assert run("table1", *out)[1].endswith("`signsplice paper evaluate` or `all` makes it")
    assert "is no corpus of pairs" in run("evaluate", "--pairs", str(tmp_path / "none"), *out)[1]
    assert "no system 'gpt'" in run("evaluate", "--system", "gpt", *out)[1]
    assert "--limit 0" in run("evaluate", "--limit", "0", *out)[1]
    assert cli.app.commands["paper"] is command.paper


def test_without_torch_all_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "torch" else find(name, *a))
    code, said = run("all", "--out", str(tmp_path / "out"), "--bundles", str(tmp_path / "b"), "--system", "lstm")
    assert code == 1
    assert "3 of the paper's systems are not trained yet, lstm-cpu-adamw-random first" in said
    assert "pip install 'signsplice[train]'" in said


def test_what_is_missing_is_trained_by_the_train_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[list[str]] = []

    @click.command(context_settings={"ignore_unknown_options": True})
    @click.argument("arguments", nargs=-1)
    def train(arguments: tuple[str, ...]) -> None:
        calls.append(list(arguments))
        if len(calls) == 2:
            raise InputError("out of luck")

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: True if name == "torch" else find(name, *a))
    monkeypatch.setitem(cli.app.commands, "train", train)
    call = ("--out", str(tmp_path / "out"), "--bundles", str(tmp_path / "b"), "--system", "lstm", "--steps", "7")
    assert run("all", *call) == (2, "out of luck"), "the second one's error ends the work"
    assert calls[0] == plan.runs("cpu", ["lstm"])[0].arguments(Path("out/pairs"), tmp_path / "b", 7)[1:]
    assert calls[1][calls[1].index("--optimiser") + 1] == "sgd"


class Call:
    """A training that is done when polled for the third time; a second that has failed by then."""

    running: ClassVar[list[Call]] = []
    most: ClassVar[int] = 0
    failing: ClassVar[str] = ""

    def __init__(self, call: list[str], env: dict[str, str]) -> None:
        self.call, self.env, self.polls = call, env, 0
        self.signals: list[int] = []
        Call.running.append(self)
        Call.most = max(Call.most, len(Call.running))

    def poll(self) -> int | None:
        self.polls += 1
        if self.polls < 3:
            return None
        Call.running.remove(self)
        return 2 if Call.failing and Call.failing in self.call else 0

    def send_signal(self, number: int) -> None:
        self.signals.append(number)

    def wait(self) -> int:
        return 130


def test_trainings_side_by_side_share_the_cores(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made: list[Call] = []

    def begin(call: list[str], env: dict[str, str]) -> Call:
        made.append(Call(call, env))
        return made[-1]

    monkeypatch.setattr("signsplice.cli.paper.subprocess.Popen", begin)
    monkeypatch.setattr("signsplice.cli.paper.time.sleep", lambda seconds: None)
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    todo = plan.runs("smoke", ["lstm", "nat"])
    command._train_side_by_side(todo, tmp_path / "p", tmp_path / "b", None, 3)
    assert [call.call[3:] for call in made] == [run.arguments(tmp_path / "p", tmp_path / "b") for run in todo]
    assert {call.env["OMP_NUM_THREADS"] for call in made} == {"2"}
    assert (Call.most, Call.running) == (3, [])
    made.clear()
    Call.failing = str(tmp_path / "b" / todo[0].name)
    with pytest.raises(SignspliceError, match=f"training {todo[0].name} failed \\(exit status 2"):
        command._train_side_by_side(todo, tmp_path / "p", tmp_path / "b", None, 2)
    assert [call.signals for call in made] == [[], [signal.SIGINT]], "the other one is interrupted"
    Call.running.clear()


def test_bundles_are_judged_tabled_and_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    pairs, bundles, out = corpus(), tmp_path / "bundles", tmp_path / "out"
    for system in ("lpt", "lstm"):
        write_bundle(bundles / system, pairs, system=system, config={})

    def opener(folder: Path, decoding: str) -> Fake:
        return Fake(pairs, off=0.001 if folder.name == "lpt" else 0.01)

    monkeypatch.setattr(judging, "everything", partial(judging.everything, opener=opener))
    call = ("evaluate", "--scale", "smoke", "--pairs", str(pairs.folder), "--bundles", str(bundles), "--out", str(out))
    code, said = run(*call)
    assert code == 0, said
    assert "78 rows judged, 78 in all" in said, "24 on clips and two bundles, on three splits"
    assert {"table1.md", "table1.tex", "classical.md", "figure6.png", "figure4c.svg"} <= {p.name for p in out.iterdir()}
    assert "| LSTM | AdamW, 20 steps |" in (out / "table1.md").read_text()
    assert len(json.loads((out / "results.json").read_text())["curves"]) == 2
    assert "0 rows judged, 78 in all" in run(*call)[1]
