"""Figures from results alone, the same bytes each time; and the commands without training."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from signsplice.errors import InputError, MissingExtraError
from signsplice_paper import clip_methods, figures, judging, kept_frames, pages, pictures, published, results, style
from signsplice_paper.cli.commands import app
from signsplice_paper.clip_methods import ClipMethod
from signsplice_paper.curve import COLUMNS, Curve
from signsplice_paper.kept_frames import KeptFrames
from signsplice_paper.protocol import choose
from signsplice_paper.results import ResultRow, Results
from toys import Fake, corpus, of_rows, row, write_bundle

SYSTEMS = (*style.COMPARED, *style.ABLATIONS["LpTransformer"][:-1], *style.ABLATIONS["LPT+"][:-1])


def curve_of(row: ResultRow, last: float = 0.97, minutes: float | None = 1.0) -> Curve:
    points = [(64.0 * k, minutes and minutes * k, last - 0.3 / k + 0.015, 0.01) for k in range(1, 21)]
    return Curve(
        row.system, "random", row.scale, row.optimiser, row.fr, row.seed,
        points, COLUMNS, row.bundle or "", row.corpus, 256,
    )  # fmt: skip


def measured(**more: float) -> Results:
    scores = {"accuracy_valid": 0.97, "first_frames_error": 1.0, **{f"frame_error-{n}": 1.0 * n for n in range(1, 9)}}
    rows = [
        row(s, fr=8 if s.startswith("lpt") else None, bundle=s, scores=scores | more | {"mse": 0.001 + 0.0002 * n})
        for n, s in enumerate(SYSTEMS)
    ]
    rows += [row("lpt", fr=fr, bundle=f"fr{fr}") for fr in (4, 6)]
    rows += [row("learned-fluent+learned", scale=s, optimiser="", fr=None, seed=None) for s in ("own", "taught")]
    return of_rows(*rows).merged(curves=[curve_of(r) for r in rows if r.bundle])


def kept_pairs() -> list[KeptFrames]:
    chosen = kept_frames.choose(corpus(), choose(corpus(), "random"), 2)
    offsets = {kept_frames.label(s, "cpu", "adamw"): 0.1 * n for n, s in enumerate(style.SEEN)}
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
    names += ["treatments", "frame-errors"]
    files = [*(f"{n}{s}" for n in names for s in (".png", ".svg"))]
    assert sorted(path.name for path in written) == sorted(files)
    pages.write(measured(), tmp_path, "cpu")
    errors = (tmp_path / "frame-errors.csv").read_text()
    assert f'{published.name("lstm")},"AdamW, 100 steps",1.0,1.0,2.0,' in errors, "frames 1 to 2, 1, 2, ..."
    assert set(left_out) == {f"{name}-sgd" for name in (*names[:6], names[-1])}
    assert all(path.stat().st_size > 5000 for path in written if path.suffix in (".png", ".svg"))
    few = [r for r in measured().rows if r.system in style.COMPARED and r.fr in (None, 8)]
    drawn = Results().merged(few, [c for c in measured().curves if c.system in style.COMPARED and c.fr in (None, 8)])
    again = figures.write(drawn, kept_pairs()[:1], two, "cpu")[0]
    assert {path.stem for path in again} == {"figure4c", "figure4d", "figure6", "frame-errors", "treatments"}
    assert [p.name for p in again if p.stem != "figure4d" and p.read_bytes() != (one / p.name).read_bytes()] == []
    assert figures.write(Results(), [], one, "cpu")[0] == []


def plots(results: Results) -> figures._Plots:
    return figures._Plots(results, "cpu", "adamw", figures.plotting())


def test_curves_are_drawn_over_pairs_and_over_core_minutes() -> None:
    pytest.importorskip("matplotlib")
    axes = plots(measured()).accuracy({"": style.COMPARED}).axes
    assert [ax.get_xlabel() for ax in axes] == ["thousands of pairs seen in training", "core-minutes of training"]
    assert [line.get_label() for line in axes[0].lines] == [published.name(s) for s in style.COMPARED]
    assert all(np.isclose(line.get_ydata()[-1], 0.03) for ax in axes for line in ax.lines), "errors 1 - Accuracy"
    assert len(plots(measured()).accuracy(style.ABLATIONS).axes) == 4, "a row for each family"
    sweep = plots(measured()).accuracy_by_fr().axes[0]
    assert [line.get_label() for line in sweep.lines] == ["fr = 4", "fr = 6", "fr = 8"]
    rows = [row(s, bundle=s) for s in style.COMPARED]
    no_clock = of_rows(*rows).merged(curves=[curve_of(r, minutes=None) for r in rows])
    assert [ax.get_xlabel() for ax in plots(no_clock).accuracy({"": style.COMPARED}).axes] == [
        "thousands of pairs seen in training"
    ]


def test_a_curve_that_ends_elsewhere_than_its_row_is_left_out(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    rows = [row(s, bundle=s, scores={"accuracy_valid": 0.97}) for s in style.COMPARED]
    made = [curve_of(r, 0.95 if r.system == "lstm" else 0.9715) for r in rows]
    written, left_out = figures.write(of_rows(*rows).merged(curves=made), [], tmp_path, "cpu")
    assert "figure4c.png" in {path.name for path in written}
    assert [line for line in left_out if "lstm" in line] == [
        "the curve of lstm (ends at 0.95, its row's validation Accuracy is 0.9700)"
    ]
    lines = plots(of_rows(*rows).merged(curves=made)).accuracy({"": style.COMPARED}).axes[0].lines
    assert published.name("lstm") not in [line.get_label() for line in lines]
    assert len(lines) == len(style.COMPARED) - 1


def test_points_are_means_over_seeds_as_in_the_tables() -> None:
    pytest.importorskip("matplotlib")
    rows = [row(s, bundle=s, scores={"mse": 0.001, "ms_mean": 4.0}) for s in style.COMPARED]
    rows += [row("lstm", seed=1, scores={"mse": 0.003, "ms_mean": 8.0})]
    rows += [row("lpt-printed", seed=1, scores={"mse": 0.002, "ms_mean": 6.0})]
    rows += [row("lpt-printed", fr=6, scores={"mse": 0.004})]
    axes = plots(of_rows(*rows)).comparison().axes[0]
    drawn = axes.lines[: len(style.COMPARED)]
    at = {s: tuple(float(v[0]) for v in line.get_data()) for s, line in zip(style.COMPARED, drawn, strict=True)}
    assert at == dict.fromkeys(at, (4.0, 0.001)) | {"lstm": (8.0, 0.002), "lpt-printed": (6.0, 0.0015)}
    bars, curve = plots(of_rows(*rows)).time_and_error_by_fr().axes
    assert list(curve.lines[0].get_ydata()) == [0.004, 0.001], "seed 1 is not there for fr = 6"
    assert [patch.get_height() for patch in bars.patches] == [10.0, 4.0]


def test_curves_are_of_the_last_seed_and_of_one_seed_where_networks_are_shared() -> None:
    pytest.importorskip("matplotlib")
    ends = {("lpt-printed", 0): 0.91, ("lpt-printed", 1): 0.92, ("lpt-printed", 2): 0.93, ("lpt-printed-wa", 0): 0.94}
    ends |= {("lpt-printed-wa", 1): 0.95, ("lstm", 0): 0.96}
    rows = [row(s, seed=seed, bundle=f"{s}{seed}", scores={"accuracy_valid": end}) for (s, seed), end in ends.items()]
    curves = [replace(curve_of(r, r.score("accuracy_valid")), seed=r.seed) for r in rows]
    drawn = plots(of_rows(*rows).merged(curves=curves))

    def last(figure: Any) -> dict[str, float]:
        return {line.get_label(): round(1.0 - line.get_ydata()[-1], 3) for line in figure.axes[0].lines}

    assert last(drawn.accuracy({"": ["lpt-printed", "lstm"]})) == {"LpTransformer": 0.93, "LSTM": 0.96}
    shared = drawn.accuracy({"": ["lpt-printed", "lpt-printed-wa"]}, alike=True)
    assert last(shared) == {"LpTransformer": 0.92, "LPT-WA": 0.95}


def test_every_point_has_a_label_of_its_own(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    same = {"mse": 0.001, "ms_mean": 10.0}
    rows = [row(s, bundle=s, scores=same) for s in style.COMPARED]
    rows += [row("learned-fluent+learned", scale=s, optimiser="", seed=None, scores=same) for s in ("own", "taught")]
    figure = plots(of_rows(*rows)).comparison()
    for dpi in (100, 130, 200):
        figure.set_dpi(dpi)
        figure.draw_without_rendering()
        texts = figure.axes[0].texts
        boxes = [text.get_window_extent() for text in texts]
        assert not [
            (a.get_text(), b.get_text())
            for (a, p), (b, q) in combinations(zip(texts, boxes, strict=True), 2)
            if p.overlaps(q)
        ]
        point = figure.axes[0].transData.transform((10.0, 0.001))
        assert not any(box.contains(*point) for box in boxes)
    names = [text.get_text() for text in texts]
    assert len(set(names)) == len(names) == 8
    assert {"signsplice, as it ships", "signsplice, trained on the split"} <= set(names)


def test_pictures_show_the_kept_systems_and_bones() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pair = kept_pairs()[0]
    rows = pictures._rows(pair, "cpu")
    assert [name for name, _ in rows] == ["truth", *(published.name(s) for s in style.SEEN)]
    assert np.array_equal(rows[1][1][0], pair.before[0]), "without positions of its own, the true ones"
    name = kept_frames.label("lstm", "cpu", "adamw")
    own = replace(pair, edges={name: np.stack([pair.truth[0], pair.truth[1]])})
    assert np.array_equal(pictures._rows(own, "cpu")[1][1][[0, -1]], own.edges[name])
    assert pictures.draw_pairs(pyplot, [replace(pair, made={})], "cpu") is None
    assert pictures.draw_pairs(pyplot, [], "cpu") is None
    frame = corpus().word(0)[20].astype(np.float64)
    assert sum(len(bones) for bones, _, _ in pictures._bones(pair.figure, frame, None)) == 43 + 24, "a ring for a head"
    assert sum(len(bones) for bones, _, _ in pictures._bones(pair.figure, frame, "right")) == 16
    for count in (2, 5, 10, 40):
        shown = pictures._shown(count, 10)
        assert (shown[0], shown[-1]) == (0, count - 1)
        assert len(shown) == min(count, 10)
        assert shown[:3] == list(range(min(count, 3))), "the first two frames of the transition are always shown"


def test_the_true_frame_of_the_same_number_lies_under_the_first_two() -> None:
    assert [pictures._true_frame(at, 12, 9) for at in (0, 1, 2, 11)] == [0, 1, 2, 8]
    under = [pictures._true_frame(at, 12, 9) for at in range(12)]
    assert under == sorted(under)
    assert [pictures._true_frame(at, 3, 9) for at in range(3)] == [0, 1, 8]
    assert [pictures._true_frame(at, 9, 3) for at in (0, 1, 2, 5, 8)] == [0, 1, 2, 2, 2]


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
    done = CliRunner().invoke(app, arguments)
    if isinstance(done.exception, (InputError, MissingExtraError)):
        return 2 if isinstance(done.exception, InputError) else 1, str(done.exception)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def test_tables_need_only_results(tmp_path: Path) -> None:
    results.save(measured(), tmp_path / results.FILE)
    code = (
        "import sys, signsplice_paper.cli.commands as c\n"
        f"c.app.main(['tables', '--out', {str(tmp_path)!r}], standalone_mode=False)\n"
        "print(sorted({'torch', 'onnxruntime'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert (tmp_path / "tables.md").is_file()
    results.save(Results(), tmp_path / results.FILE)
    assert "no row of scale cpu" in run("tables", "--out", str(tmp_path))[1]


def test_the_command_refuses_bad_inputs(tmp_path: Path) -> None:
    out = ("--out", str(tmp_path / "out"))
    assert run("tables", *out)[1].endswith("`signsplice-paper evaluate` or `all` makes it")
    assert (
        "has no corpus.json, expected a corpus of pairs" in run("evaluate", "--pairs", str(tmp_path / "none"), *out)[1]
    )
    assert "no system 'gpt'" in run("evaluate", "--system", "gpt", *out)[1]
    assert "--limit 0" in run("evaluate", "--limit", "0", *out)[1]


def test_training_without_torch_names_the_missing_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "torch" else find(name, *a))
    folders = ("--out", str(tmp_path / "out"), "--bundles", str(tmp_path / "b"), "--pairs", str(corpus().folder))
    code, message = run("all", *folders, "--system", "lstm")
    assert code == 1
    assert "of the paper's systems are not trained yet, lstm-cpu-adamw-random first" in message
    assert "pip install './workshop[train]'" in message


def test_evaluate_judges_once_and_writes_tables_and_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    pairs, bundles, out = corpus(), tmp_path / "bundles", tmp_path / "out"
    for system, last in ((published.PRINTED, 0.999), ("lstm", 0.99)):
        write_bundle(bundles / system, pairs, last, system=system, fr=None)

    def opener(folder: Path, decoding: str) -> Fake:
        return Fake(pairs, off=0.001 if folder.name == published.PRINTED else 0.01)

    cutters = (("true-positions", "hermite", "positions and length"), ("learned-fluent", "learned", "nothing"))
    methods = [ClipMethod(*names) for names in (*cutters, ("ends", "slerp", "length"))]
    monkeypatch.setattr(clip_methods, "all_clip_methods", lambda: methods)
    monkeypatch.setattr(judging, "Judge", partial(judging.Judge, opener=opener))
    call = ("evaluate", "--scale", "smoke", "--pairs", str(pairs.folder), "--bundles", str(bundles), "--out", str(out))
    code, output = run(*call)
    assert code == 0, output
    assert "35 rows judged, 35 in all" in output, (
        "mean, truth, 4 baselines, 3 methods on three splits; lpt-printed, in one pass, with a bias, and lstm on two"
    )
    assert {"tables.md", "table1.csv", "figure6.png", "figure4d.svg"} <= {p.name for p in out.iterdir()}
    assert "| LSTM | AdamW, 20 steps |" in (out / "tables.md").read_text()
    assert len(json.loads((out / "results.json").read_text())["curves"]) == 2
    monkeypatch.setattr(figures, "write", lambda *_: ([], []))
    assert "0 rows judged, 35 in all" in run(*call)[1]
