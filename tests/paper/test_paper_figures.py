"""Figures from results alone, the same bytes each time; and the command `paper` without training."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from toys import Fake, corpus, of_rows, row, write_bundle

from signsplice.cli import commands
from signsplice.cli import paper as command
from signsplice.errors import InputError, MissingExtraError
from signsplice.paper import clip_methods, figures, judging, kept_frames, pictures, published, results
from signsplice.paper.clip_methods import ClipMethod
from signsplice.paper.kept_frames import KeptFrames
from signsplice.paper.protocol import choose
from signsplice.paper.results import Curve, Results


def measured() -> Results:
    rows = [row(s, fr=8 if s == "lpt" else None) for s in (*published.TABLE_1, *published.TABLE_3)]
    rows += [row("lpt", fr=fr) for fr in (4, 6)]
    points = [(float(k), 0.9 + 0.001 * k) for k in range(20)]
    curves = [Curve(r.system, "random", "cpu", "adamw", r.fr, 0, points) for r in rows]
    return of_rows(*rows).merged(curves=curves)


def kept_pairs() -> list[KeptFrames]:
    chosen = kept_frames.choose(corpus(), choose(corpus(), "random"), 2)
    offsets = {kept_frames.label(s, "cpu", "adamw"): d for s, d in (("lstm", 0.01), ("transformer", 0.3), ("lpt", 0.0))}
    out = []
    for pair in chosen:
        frames = {name: pair.truth + offset for name, offset in offsets.items()}
        frames[kept_frames.label("transformer", "cpu", "adamw")] = pair.truth[:-1] + 0.3
        out.append(replace(pair, made=frames))
    return out


def test_every_figure_is_drawn_with_the_same_bytes_each_time(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
    written, left_out = figures.write(measured(), kept_pairs(), one, "cpu")
    names = ["figure4a", "figure4b", "figure4c", "figure4d", "figure5a", "figure5b", "figure6", "figure7"]
    assert sorted(path.name for path in written) == sorted(f"{n}{s}" for n in names for s in (".png", ".svg"))
    assert set(left_out) == {f"{name}-sgd" for name in names[:6]}
    assert all(path.stat().st_size > 5000 for path in written)
    few = of_rows(*(row(s) for s in published.TABLE_1))
    again = figures.write(few, kept_pairs()[:1], two, "cpu")[0]
    assert [path.name for path in again] == ["figure4d.png", "figure4d.svg", "figure6.png", "figure6.svg"]
    for name in ("figure6.png", "figure6.svg"):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name
    assert figures.write(Results(), [], one, "cpu")[0] == []


def test_pictures_show_the_kept_systems_and_bones() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pair = kept_pairs()[0]
    rows = [name for name, _ in pictures._rows(pair, "cpu")]
    assert rows == ["truth", "LSTM", "Transformer", "LpTransformer"]
    assert pictures.draw_pairs(pyplot, [replace(pair, made={})], "cpu") is None
    assert pictures.draw_pairs(pyplot, [], "cpu") is None
    frame = corpus().word(0)[20:21].astype(np.float64)
    assert sum(len(bones) for bones, _, _ in pictures._bones(frame, None)) == 43 + 24, "no legs; the head is a ring"
    assert sum(len(bones) for bones, _, _ in pictures._bones(frame, "Right")) == 16
    for count in (2, 5, 10, 40):
        shown = pictures._shown(count, 10)
        assert (shown[0], shown[-1]) == (0, count - 1)
        assert len(shown) == min(count, 10)


def test_lines_are_clipped_at_the_edge_of_their_picture() -> None:
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


def test_tables_need_only_results(tmp_path: Path) -> None:
    results.save(measured(), tmp_path / results.FILE)
    code = (
        "import sys, signsplice.cli.commands as c\n"
        f"c.app.main(['paper', 'table1', '--out', {str(tmp_path)!r}], standalone_mode=False)\n"
        "print(sorted({'torch', 'matplotlib', 'onnxruntime'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert (tmp_path / "table1.md").is_file()
    assert not (tmp_path / "table3.md").exists()
    assert run("table3", "--out", str(tmp_path))[0] == 0
    assert "no row of scale paper" in run("table3", "--out", str(tmp_path), "--scale", "paper")[1]


def test_the_command_refuses_bad_inputs(tmp_path: Path) -> None:
    out = ("--out", str(tmp_path / "out"))
    assert run("table1", *out)[1].endswith("`signsplice paper evaluate` or `all` makes it")
    assert (
        "has no corpus.json, expected a corpus of pairs" in run("evaluate", "--pairs", str(tmp_path / "none"), *out)[1]
    )
    assert "no system 'gpt'" in run("evaluate", "--system", "gpt", *out)[1]
    assert "--limit 0" in run("evaluate", "--limit", "0", *out)[1]
    assert commands.app.commands["paper"] is command.paper


def test_training_without_torch_names_the_missing_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "torch" else find(name, *a))
    code, message = run("all", "--out", str(tmp_path / "out"), "--bundles", str(tmp_path / "b"), "--system", "lstm")
    assert code == 1
    assert "3 of the paper's systems are not trained yet, lstm-cpu-adamw-random first" in message
    assert "pip install 'signsplice[train]'" in message


def test_evaluate_judges_once_and_writes_tables_and_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    pairs, bundles, out = corpus(), tmp_path / "bundles", tmp_path / "out"
    for system in ("lpt", "lstm"):
        write_bundle(bundles / system, pairs, system=system, fr=None)

    def opener(folder: Path, decoding: str) -> Fake:
        return Fake(pairs, off=0.001 if folder.name == "lpt" else 0.01)

    cutters = (("true-positions", "hermite", "positions and length"), ("learned-fluent", "learned", "nothing"))
    methods = [ClipMethod(*names) for names in (*cutters, ("ends", "slerp", "length"))]
    monkeypatch.setattr(clip_methods, "all_clip_methods", lambda: methods)
    monkeypatch.setattr(judging, "Judge", partial(judging.Judge, opener=opener))
    call = ("evaluate", "--scale", "smoke", "--pairs", str(pairs.folder), "--bundles", str(bundles), "--out", str(out))
    code, output = run(*call)
    assert code == 0, output
    assert "18 rows judged, 18 in all" in output, (
        "the mean and 3 methods on three splits; lpt, in one pass too, and lstm on two"
    )
    assert {"table1.md", "table1.tex", "classical.md", "figure6.png", "figure4c.svg"} <= {p.name for p in out.iterdir()}
    assert "| LSTM | AdamW, 20 steps |" in (out / "table1.md").read_text()
    assert len(json.loads((out / "results.json").read_text())["curves"]) == 2
    monkeypatch.setattr(figures, "write", lambda *_: ([], []))
    assert "0 rows judged, 18 in all" in run(*call)[1]
