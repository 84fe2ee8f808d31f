"""results.json and the frames beside it: merged by key, written whole, read back as they were."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toys import corpus, moved, of_rows, row

from signsplice.errors import InputError
from signsplice.paper import kept_frames, plan, published, results
from signsplice.paper.protocol import choose
from signsplice.paper.results import Curve, Results


def test_rows_of_one_key_replace_one_another() -> None:
    first = of_rows(row("lpt"), row("lstm"), row("lpt", optimiser="sgd"), row("lpt", fr=6))
    assert len(first.rows) == 4
    second = first.merged([row("lpt", bundle="new", commit="other", machine="elsewhere")])
    assert len(second.rows) == 4
    assert [r.bundle for r in second.find(system="lpt", fr=8, optimiser="adamw")] == ["new"]
    assert first.find(system="lpt", fr=8, optimiser="adamw")[0].bundle is None, "the first is as it was"


def test_results_come_back_as_they_were(tmp_path: Path) -> None:
    curve = Curve("lpt", "random", "cpu", "adamw", 8, 0, [(0.0, 0.5), (10.0, 0.9)])
    known = of_rows(row("lpt", scores={"paa": None}), row("lstm", fr=None)).merged(curves=[curve])
    path = tmp_path / "results.json"
    results.save(known, path)
    assert results.load(path) == known
    assert json.loads(path.read_text())["version"] == 1
    assert np.isnan(known.find(system="lpt")[0].score("paa"))
    assert np.isnan(known.find(system="lpt")[0].score("no such score"))
    assert list(known.signatures) == [results.signature_id()]
    assert results.load(tmp_path / "none.json") == Results()


def test_what_is_no_results_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    for text in ("{", "[]", '{"version": 1}', '{"version": 1, "rows": [{"x": 1}], "curves": [], "signatures": {}}'):
        path.write_text(text)
        with pytest.raises(InputError, match=r"results.json: is no results.json"):
            results.load(path)
    path.write_text('{"version": 9}')
    with pytest.raises(InputError, match="version 9, expected 1"):
        results.load(path)


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "results.json"
    results.save(of_rows(row("lpt")), path)
    before = path.read_bytes()

    def stop(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", stop)
    with pytest.raises(InputError, match="No space left"):
        results.save(of_rows(row("lstm")), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["results.json"]


@pytest.mark.parametrize("what", ["measures", "protocol", "corpus"])
def test_rows_measured_differently_are_told_apart(what: str) -> None:
    results.check_alike([row("lpt"), row("lstm", scale="paper", steps=7)])
    with pytest.raises(InputError, match=f"lpt and lstm cannot stand in one table: {what}"):
        results.check_alike([row("lpt"), row("lstm", **{what: "another"})])


def test_surroundings_say_what_ran() -> None:
    around = results.surroundings()
    assert {"python", "numpy", "signsplice"} <= around["versions"].keys()
    assert "cores" in around["machine"]
    assert results.commit(Path("/")) == ""


def test_long_curves_are_thinned_to_their_ends() -> None:
    points = [(float(k), 0.5) for k in range(5000)]
    thin = results.thinned(points)
    assert len(thin) == results.MOST_POINTS
    assert (thin[0], thin[-1]) == (points[0], points[-1])
    assert results.thinned(points[:3]) == points[:3]


def test_shots_come_back_and_keep_what_others_made(tmp_path: Path) -> None:
    pairs = corpus()
    chosen = kept_frames.choose(pairs, choose(pairs, "random"))
    assert 1 <= len(chosen) <= kept_frames.COUNT
    one = [replace(shot, made={"cpu/adamw/lpt/nothing": moved(4)}) for shot in chosen]
    path = tmp_path / "frames.npz"
    kept_frames.save(one, path)
    back = kept_frames.load(path)
    assert [(s.number, s.name) for s in back] == [(s.number, s.name) for s in chosen]
    assert np.allclose(back[0].made["cpu/adamw/lpt/nothing"], moved(4), atol=1e-6)
    merged = kept_frames.merge(back, [replace(shot, made={"new": moved(3)}) for shot in chosen])
    assert set(merged[0].made) == {"cpu/adamw/lpt/nothing", "new"}
    other = [replace(shot, truth=shot.truth + 0.1) for shot in chosen]
    assert not kept_frames.merge(back, other)[0].made, "another truth, another pair"
    path.write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"frames.npz: holds no frames"):
        kept_frames.load(path)
    assert kept_frames.load(tmp_path / "none.npz") == []


def test_the_plan_trains_every_system_of_the_tables(tmp_path: Path) -> None:
    planned = plan.runs("cpu")
    assert len({run.name for run in planned}) == len(planned)
    tables = {*published.TABLE_1, *published.TABLE_3}
    for optimiser in ("adamw", "sgd"):
        assert tables <= {r.system for r in planned if r.optimiser == optimiser and r.split == "random"}
    assert tables <= {r.system for r in planned if r.split == "unseen-words"}
    assert {r.fr for r in planned if r.system == "lpt"} == {None, *plan.SWEEP} - {published.BEST_FR}
    assert {r.system for r in plan.runs("smoke", ["lstm"])} == {"lstm"}
    run = next(r for r in planned if r.fr == 6)
    call = run.arguments(Path("p"), Path("b"), steps=5)
    assert call[:2] == ["train", "paper"]
    told = dict(zip(call[2::2], call[3::2], strict=True))
    assert told == {
        **{"--pairs": "p", "--out": "b/lpt-fr6-cpu-adamw-random", "--seed": "0", "--system": "lpt", "--scale": "cpu"},
        **{"--optimiser": "adamw", "--split": "random", "--fr": "6", "--steps": "5"},
    }
    assert plan.missing(planned, tmp_path) == planned
    (tmp_path / run.name).mkdir()
    (tmp_path / run.name / "bundle.json").write_text("{}")
    assert run not in plan.missing(planned, tmp_path)
