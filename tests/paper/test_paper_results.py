"""results.json and frames.npz: merging by key, atomic writes and round trips; and the plan of trainings."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toys import corpus, motion, of_rows, row

from signsplice.errors import InputError
from signsplice.paper import environment, kept_frames, plan, published, results
from signsplice.paper.protocol import choose
from signsplice.paper.results import Curve, Results


def test_a_new_row_replaces_the_row_of_its_key() -> None:
    first = of_rows(row("lpt"), row("lstm"), row("lpt", optimiser="sgd"), row("lpt", fr=6))
    assert len(first.rows) == 4
    second = first.merged([row("lpt", bundle="new", commit="other", machine="elsewhere")])
    assert len(second.rows) == 4
    assert [r.bundle for r in second.find(system="lpt", fr=8, optimiser="adamw")] == ["new"]
    assert first.find(system="lpt", fr=8, optimiser="adamw")[0].bundle is None, "the first results are unchanged"


def test_results_survive_a_round_trip(tmp_path: Path) -> None:
    curve = Curve("lpt", "random", "cpu", "adamw", 8, 0, [(0.0, 0.5), (10.0, 0.9)])
    known = of_rows(row("lpt", scores={"paa": None}), row("lstm", fr=None)).merged(curves=[curve])
    path = tmp_path / "results.json"
    results.save(known, path)
    assert results.load(path) == known
    stored = json.loads(path.read_text())
    assert stored["version"] == 2
    assert {"given", "metrics_id", "truth", "token_bias"} <= stored["rows"][0].keys()
    assert np.isnan(known.find(system="lpt")[0].score("paa"))
    assert np.isnan(known.find(system="lpt")[0].score("no such score"))
    assert list(known.signatures) == [results.signature_id()]
    assert results.load(tmp_path / "none.json") == Results()


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    for text in ("{", "[]", '{"version": 2}', '{"version": 2, "rows": [{"x": 1}], "curves": [], "signatures": {}}'):
        path.write_text(text)
        with pytest.raises(InputError, match=r"results.json: is no results.json"):
            results.load(path)
    path.write_text('{"version": 1, "rows": [], "curves": [], "signatures": {}}')
    with pytest.raises(InputError, match=r"version 1, expected 2; version 1 is of signsplice 0\.3"):
        results.load(path)
    path.write_text('{"version": 9}')
    with pytest.raises(InputError, match="version 9, expected 2"):
        results.load(path)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


@pytest.mark.parametrize("field", ["metrics_id", "protocol", "corpus"])
def test_rows_that_differ_in_recipe_are_refused(field: str) -> None:
    results.check_comparable([row("lpt"), row("lstm", scale="paper", steps=7)])
    with pytest.raises(InputError, match=f"lpt and lstm cannot be compared in one table: {field}"):
        results.check_comparable([row("lpt"), row("lstm", **{field: "another"})])


def test_the_environment_states_versions_and_machine() -> None:
    found = environment.environment()
    assert {"python", "numpy", "signsplice"} <= found["versions"].keys()
    assert "cores" in found["machine"]
    assert environment.commit(Path("/")) == ""


def test_long_curves_are_thinned_but_keep_their_ends() -> None:
    points = [(float(k), 0.5) for k in range(5000)]
    thin = results.thinned(points)
    assert len(thin) == results.MOST_POINTS
    assert (thin[0], thin[-1]) == (points[0], points[-1])
    assert results.thinned(points[:3]) == points[:3]


def test_kept_frames_survive_a_round_trip_and_merge(tmp_path: Path) -> None:
    pairs = corpus()
    chosen = kept_frames.choose(pairs, choose(pairs, "random"))
    assert 1 <= len(chosen) <= kept_frames.COUNT
    name = "cpu/adamw/lpt/nothing"
    first = [replace(pair, made={name: motion(4)}) for pair in chosen]
    path = tmp_path / "frames.npz"
    kept_frames.save(first, path)
    loaded = kept_frames.load(path)
    assert [(pair.number, pair.name) for pair in loaded] == [(pair.number, pair.name) for pair in chosen]
    assert np.allclose(loaded[0].made[name], motion(4), atol=1e-6)
    merged = kept_frames.merge(loaded, [replace(pair, made={"new": motion(3)}) for pair in chosen])
    assert set(merged[0].made) == {name, "new"}
    other = [replace(pair, truth=pair.truth + 0.1) for pair in chosen]
    assert not kept_frames.merge(loaded, other)[0].made, "frames of another truth are dropped"
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
    assert run.name == "lpt-fr6-cpu-adamw-random"
    assert plan.missing(planned, tmp_path) == planned
    (tmp_path / run.name).mkdir()
    (tmp_path / run.name / "bundle.json").write_text("{}")
    assert run not in plan.missing(planned, tmp_path)
