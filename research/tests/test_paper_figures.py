"""Figures from results alone, the same bytes each time; and the commands without training."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from signsplice.errors import InputError, MissingExtraError
from signsplice_paper import baselines, clip_methods, figures, judging, kept_frames, pictures, published, results, style
from signsplice_paper.cli.commands import app
from signsplice_paper.clip_methods import ClipMethod
from signsplice_paper.curve import COLUMNS, Curve
from signsplice_paper.kept_frames import KeptFrames
from signsplice_paper.protocol import choose
from signsplice_paper.results import ResultRow, Results
from toys import Fake, corpus, of_rows, row, write_bundle

SYSTEMS = tuple(dict.fromkeys((*style.COMPARED, *style.ABLATIONS)))


def curve_of(row: ResultRow, last: float = 0.97, minutes: float | None = 1.0) -> Curve:
    points = [(64.0 * k, minutes and minutes * k, last - 0.3 / k + 0.015, 0.01, 0.9, 0.04 * k) for k in range(1, 21)]
    return Curve(
        row.system, "random", row.scale, row.optimiser, row.fr, row.seed,
        points, COLUMNS, row.bundle or "", row.corpus, 256,
    )  # fmt: skip


def measured() -> Results:
    rows = [row(system, bundle=system, scores={"accuracy_valid": 0.97}) for system in SYSTEMS]
    return of_rows(*rows).merge(curves=[curve_of(r) for r in rows])


def kept_pairs() -> list[KeptFrames]:
    chosen = kept_frames.choose(corpus(), choose(corpus(), "random"), 2)
    offsets = {kept_frames.make_label(s, "cpu", "adamw"): 0.1 * n for n, s in enumerate(style.SEEN)}
    out = []
    for pair in chosen:
        frames = {name: pair.truth + offset for name, offset in offsets.items()}
        frames[kept_frames.make_label("transformer", "cpu", "adamw")] = pair.truth[:-1] + 0.3
        out.append(replace(pair, made=frames))
    return out


def test_every_figure_is_drawn_with_the_same_bytes_each_time(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
    written, left_out = figures.write(measured(), kept_pairs(), one, "cpu")
    names = ("figure4c", "figure5a", "figure6", "figure7")
    assert sorted(path.name for path in written) == sorted(f"{n}{s}" for n in names for s in (".png", ".svg"))
    assert left_out == []
    assert all(path.stat().st_size > 5000 for path in written)
    drawn = Results().merge(measured().rows, [c for c in measured().curves if c.system in style.COMPARED])
    again, left_out = figures.write(drawn, kept_pairs()[:1], two, "cpu")
    assert {path.stem for path in again} == {"figure4c", "figure6"}
    assert left_out == ["figure5a", "figure7"], "one curve and no second pair are not enough"
    assert [path.name for path in again if path.read_bytes() != (one / path.name).read_bytes()] == []
    assert figures.write(Results(), [], one, "cpu") == ([], list(names))


def plots(results: Results) -> figures._Plots:
    return figures._Plots(results, "cpu", figures.import_pyplot())


def test_curves_are_drawn_over_core_minutes() -> None:
    pytest.importorskip("matplotlib")
    left, right = plots(measured()).draw_curves(style.COMPARED).axes
    assert {ax.get_xlabel() for ax in (left, right)} == {"core-minutes of training"}
    assert [line.get_label() for line in left.lines] == [
        published.get_display_name(system) for system in style.COMPARED
    ]
    assert all(np.isclose(line.get_ydata()[-1], 0.03) for line in left.lines), "errors 1 - Accuracy"
    assert [line.get_linestyle() for line in right.lines] == ["-", ":"] * len(style.COMPARED)
    assert {line.get_ydata()[-1] for line in right.lines[::2]} == {0.8}, "test pairs"
    assert {line.get_ydata()[-1] for line in right.lines[1::2]} == {0.9}, "pairs that taught"
    rows = [row(system, bundle=system) for system in style.COMPARED]
    no_clock = of_rows(*rows).merge(curves=[curve_of(r, minutes=None) for r in rows])
    assert plots(no_clock).draw_curves(style.COMPARED) is None


def test_curves_are_of_the_first_seed_of_adamw_at_the_scale_drawn() -> None:
    pytest.importorskip("matplotlib")
    others: list[dict[str, Any]] = [{"seed": 1}, {"optimiser": "sgd"}, {"scale": "smoke"}]
    curves = [curve_of(row("lstm", bundle="b", **more), 0.5) for more in others]
    drawn = plots(measured().merge(curves=curves)).curves
    assert set(drawn) == set(SYSTEMS)
    assert drawn["lstm"] == curve_of(row("lstm", bundle="lstm"))


def test_every_system_of_the_figures_has_a_colour_and_a_marker_of_its_own() -> None:
    for field in ("colour", "marker"):
        assert len({getattr(style.get_style(system), field) for system in SYSTEMS}) == len(SYSTEMS)
    assert set(style.SEEN) < set(style.COMPARED)


def test_a_curve_that_ends_elsewhere_than_its_row_is_left_out(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    rows = [row(s, bundle=s, scores={"accuracy_valid": 0.97}) for s in style.COMPARED]
    made = [curve_of(r, 0.95 if r.system == "lstm" else 0.9715) for r in rows]
    written, left_out = figures.write(of_rows(*rows).merge(curves=made), [], tmp_path, "cpu")
    assert "figure4c.png" in {path.name for path in written}
    assert [line for line in left_out if "lstm" in line] == [
        "the curve of lstm (ends at 0.95, its row's validation Accuracy is 0.9700)"
    ]
    lines = plots(of_rows(*rows).merge(curves=made)).draw_curves(style.COMPARED).axes[0].lines
    assert published.get_display_name("lstm") not in [line.get_label() for line in lines]
    assert len(lines) == len(style.COMPARED) - 1


def test_pictures_show_the_kept_systems_and_bones() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pair = kept_pairs()[0]
    rows = pictures._list_rows(pair, "cpu")
    assert [name for name, _ in rows] == ["truth", *(published.get_display_name(s) for s in style.SEEN)]
    assert np.array_equal(rows[1][1][0], pair.before[0]), "without positions of its own, the true ones"
    name = kept_frames.make_label("lstm", "cpu", "adamw")
    own = replace(pair, edges={name: np.stack([pair.truth[0], pair.truth[1]])})
    assert np.array_equal(pictures._list_rows(own, "cpu")[1][1][[0, -1]], own.edges[name])
    assert pictures.draw_pairs(pyplot, [replace(pair, made={})], "cpu") is None
    assert pictures.draw_pairs(pyplot, [], "cpu") is None
    frame = corpus().word(0)[20].astype(np.float64)
    assert sum(len(bones) for bones, _, _ in pictures._project_bones(pair.figure, frame, None)) == 43 + 24, (
        "a ring for a head"
    )
    assert sum(len(bones) for bones, _, _ in pictures._project_bones(pair.figure, frame, "right")) == 16
    for count in (2, 5, 10, 40):
        shown = pictures._select_frames(count, 10)
        assert (shown[0], shown[-1]) == (0, count - 1)
        assert len(shown) == min(count, 10)
        assert shown[:3] == list(range(min(count, 3))), "the first two frames of the transition are always shown"


def test_the_true_frame_of_the_same_number_lies_under_the_first_two() -> None:
    assert [pictures._match_true_frame(at, 12, 9) for at in (0, 1, 2, 11)] == [0, 1, 2, 8]
    under = [pictures._match_true_frame(at, 12, 9) for at in range(12)]
    assert under == sorted(under)
    assert [pictures._match_true_frame(at, 3, 9) for at in range(3)] == [0, 1, 8]
    assert [pictures._match_true_frame(at, 9, 3) for at in (0, 1, 2, 5, 8)] == [0, 1, 2, 2, 2]


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
    found = pictures.clip_segments(lines, low, high)
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
    assert "no row for tables" in run("tables", "--out", str(tmp_path))[1]


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
    for system, last in ((published.LPTRANSFORMER, 0.999), ("lstm", 0.99)):
        write_bundle(bundles / system, pairs, last, system=system, fr=None)

    def opener(folder: Path) -> Fake:
        return Fake(pairs, off=0.001 if folder.name == published.LPTRANSFORMER else 0.01)

    cutters = (("true-positions", "hermite", "positions and length"), ("learned-fluent", "learned", "nothing"))
    methods = [ClipMethod(*names) for names in (*cutters, ("ends", "slerp", "length"))]
    monkeypatch.setattr(clip_methods, "list_methods", lambda: methods)
    monkeypatch.setattr(judging, "Judge", partial(judging.Judge, opener=opener))
    monkeypatch.setattr(baselines, "Ridge", partial(baselines.Ridge, fr=1))  # fitted in no time
    call = ("evaluate", "--scale", "smoke", "--pairs", str(pairs.folder), "--bundles", str(bundles), "--out", str(out))
    code, output = run(*call)
    assert code == 0, output
    known = results.load(out / results.FILE)
    assert f"{len(known.rows)} rows judged, {len(known.rows)} in all" in output
    splits = {system: {r.split for r in known.find(system=system)} for system in ("truth", "ends+slerp", "lstm")}
    assert splits["truth"] == splits["ends+slerp"] == {"random", "unseen-words", "unseen-signer"}
    assert splits["lstm"] == {"random", "unseen-signer"}, "whose test pairs it never saw"
    assert {"tables.md", "table.csv", "figure6.png"} <= {path.name for path in out.iterdir()}
    assert "| LSTM | equal treatment |" in (out / "tables.md").read_text()
    assert "figure4c" in output, "left out: no curve has a clock"
    assert {c.system for c in known.curves} == {published.LPTRANSFORMER, "lstm"}
    monkeypatch.setattr(figures, "write", lambda *_: ([], []))
    code, output = run(*call)
    assert f"0 rows judged, {len(known.rows)} in all" in output
    code, output = run(*call, "--system", "lstm", "--again")
    assert f"5 rows judged, {len(known.rows)} in all" in output, "of the mean transition three, of the bundle two"
