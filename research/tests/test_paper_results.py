"""results.json and frames.npz: merging by key, atomic writes and round trips; and the plan of trainings."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice_paper import environment, kept_frames, merging, plan, published, results
from signsplice_paper.curve import COLUMNS, Curve
from signsplice_paper.plan import Choice, Run
from signsplice_paper.protocol import choose
from signsplice_paper.results import Results
from toys import corpus, motion, of_rows, row


def test_a_new_row_replaces_the_row_of_its_key() -> None:
    first = of_rows(row("lpt-plus"), row("lstm"), row("lpt-plus", optimiser="sgd"), row("lpt-plus", fr=6))
    assert len(first.rows) == 4
    second = first.merge([row("lpt-plus", bundle="new", commit="other", machine="elsewhere")])
    assert len(second.rows) == 4
    assert [r.bundle for r in second.find(system="lpt-plus", fr=8, optimiser="adamw")] == ["new"]
    assert first.find(system="lpt-plus", fr=8, optimiser="adamw")[0].bundle is None, "the first results are unchanged"


def test_results_survive_a_round_trip(tmp_path: Path) -> None:
    curves = [
        Curve(
            "lpt-plus",
            "random",
            "cpu",
            "adamw",
            8,
            0,
            [(64.0, 1.0, 0.5, 0.1, 0.2, 0.1), (128.0, 2.0, 0.9, 0.01, 0.6, 0.5)],
        ),
        Curve(
            "lstm", "random", "cpu", "adamw", None, 0, [(64.0, None, 0.5, 0.1, 0.2, 0.1)], COLUMNS, "abc", "c0ffee", 256
        ),
    ]
    known = of_rows(row("lpt-plus", scores={"paa": None}), row("lstm", fr=None)).merge(curves=curves)
    path = tmp_path / "results.json"
    results.save(known, path)
    assert results.load(path) == known
    stored = json.loads(path.read_text())
    assert stored["version"] == 3
    assert {"given", "taught", "condition", "metrics_id", "truth", "token_bias"} <= stored["rows"][0].keys()
    assert np.isnan(known.find(system="lpt-plus")[0].score("paa"))
    assert np.isnan(known.find(system="lpt-plus")[0].score("no such score"))
    assert list(known.signatures) == [results.hash_signatures()]
    assert results.load(tmp_path / "none.json") == Results()


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    four = {"columns": COLUMNS[:4], "points": [[1.0, 1.0, 0.5, 0.1]]}
    of_four = json.dumps({"version": 3, "rows": [], "curves": [four], "signatures": {}})
    for text in (
        "{",
        "[]",
        '{"version": 3}',
        '{"version": 3, "rows": [{"x": 1}], "curves": [], "signatures": {}}',
        of_four,
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=r"results.json: is no results.json"):
            results.load(path)
    for version in (1, 2, 9):
        path.write_text(json.dumps({"version": version, "rows": [], "curves": [], "signatures": {}}))
        with pytest.raises(InputError, match=f"version {version}, expected 3; earlier ones are of corpora that are no"):
            results.load(path)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "results.json"
    results.save(of_rows(row("lpt-plus")), path)
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
    results.check_comparable([row("lpt-plus"), row("lstm", scale="paper", steps=7)])
    with pytest.raises(InputError, match=f"lpt-plus and lstm cannot be compared in one table: {field}"):
        results.check_comparable([row("lpt-plus"), row("lstm", **{field: "another"})])


def test_the_environment_states_versions_and_machine() -> None:
    found = environment.read_environment()
    assert {"python", "numpy", "signsplice"} <= found["versions"].keys()
    assert "cores" in found["machine"]
    assert environment.read_commit(Path("/")) == ""


def test_kept_frames_survive_a_round_trip_and_merge(tmp_path: Path) -> None:
    pairs = corpus()
    chosen = kept_frames.choose(pairs, choose(pairs, "random"))
    assert 1 <= len(chosen) <= kept_frames.COUNT
    name = "cpu/adamw/lpt-plus/nothing"
    first = [replace(pair, made={name: motion(4)}, edges={name: motion(2)}) for pair in chosen]
    path = tmp_path / "frames.npz"
    kept_frames.save(first, path)
    loaded = kept_frames.load(path)
    assert [(pair.number, pair.name) for pair in loaded] == [(pair.number, pair.name) for pair in chosen]
    assert np.allclose(loaded[0].made[name], motion(4), atol=1e-6)
    assert np.allclose(loaded[0].edges[name], motion(2), atol=1e-6)
    assert loaded[0].figure == chosen[0].figure
    merged = kept_frames.merge(loaded, [replace(pair, made={"new": motion(3)}) for pair in chosen])
    assert (set(merged[0].made), set(merged[0].edges)) == ({name, "new"}, {name})
    other = [replace(pair, truth=pair.truth + 0.1) for pair in chosen]
    assert not kept_frames.merge(loaded, other)[0].made, "frames of another truth are dropped"
    path.write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"frames.npz: holds no frames"):
        kept_frames.load(path)
    assert kept_frames.load(tmp_path / "none.npz") == []


def test_rows_of_one_system_with_different_training_corpora_are_kept_apart() -> None:
    here, elsewhere = row("lpt-plus"), row("lpt-plus", taught="71aa22f6cf89")
    assert of_rows(here, elsewhere).rows == (here, elsewhere)


def test_the_plan_trains_every_system_of_the_tables() -> None:
    assert [run.name for run in plan.plan_runs("small")] == [f"{system}-small-adamw-random" for system in plan.TABLE_1]
    for scale in ("smoke", "cpu", "paper"):
        planned = plan.plan_runs(scale)
        assert len({run.name for run in planned}) == len(planned)
        assert [run.system for run in planned[:5]] == list(plan.TABLE_1), "the most important first"
        by_adamw = {run.system for run in planned if run.optimiser == "adamw"}
        assert {*published.TABLE_1, *published.TABLE_3, published.LPT_PLUS} <= by_adamw
        assert {made for by in published.CONDITIONS.values() for made in by.values()} <= by_adamw, "both conditions"
        assert {run.system for run in planned if run.optimiser == "sgd"} == {published.PRINTED}, "as in the paper"
        assert {run.split for run in planned} == {"random"}, "whose training part all splits have"
    seeds = {(run.system, run.seed) for run in plan.plan_runs("cpu") if run.seed}
    assert seeds == {(system, seed) for system in plan.SEEDED for seed in (1, 2)}
    assert not {system for system, _ in seeds} & set(published.ABLATIONS)


def test_a_corpus_to_teach_on_is_planned_for_two_systems() -> None:
    planned = plan.plan_runs("cpu", splits=[plan.TAUGHT_SPLIT])
    assert [run.name for run in planned] == [f"{system}-cpu-adamw-many" for system in plan.ON_MANY]
    assert plan.plan_runs("cpu", splits=("random", "unseen-words")) == plan.plan_runs("cpu")


def test_only_what_is_wanted_is_planned() -> None:
    assert {run.system for run in plan.plan_runs("smoke", Choice(("lstm",)))} == {"lstm"}
    asked = plan.plan_runs("cpu", Choice(("lstm", "lptransformer-printed"), ("sgd",)))
    assert [(run.system, run.optimiser) for run in asked] == [("lstm", "sgd"), ("lptransformer-printed", "sgd")]
    (again,) = plan.plan_runs("cpu", Choice(("transformer",), seeds=(1,)))
    assert again.name == "transformer-cpu-adamw-random-seed1"
    assert plan.plan_runs("cpu", Choice(("lptransformer-printed",), seeds=(5,))) == []
    wanted = plan.plan_runs("paper", Choice(("lpt-plus", "lstm"), ("adamw",), ("unseen-signer",), (0,)))
    assert [(run.system, run.split) for run in wanted] == [("lpt-plus", "random"), ("lstm", "random")], (
        "an unseen signer is judged by what was trained on the random split"
    )
    assert [run.system for run in plan.plan_runs("cpu", Choice(("lstm", "lpt-plus")), ("many",))] == ["lpt-plus"]


def test_a_bundle_s_folder_names_what_differs_from_the_usual() -> None:
    run = Run("lptransformer", "cpu", "adamw", "random")
    assert run.name == "lptransformer-cpu-adamw-random"
    assert replace(run, fr=6, seed=2).name == "lptransformer-fr6-cpu-adamw-random-seed2"


def write_bundle_json(bundles: Path, run: Run, corpus: str) -> None:
    (bundles / run.name).mkdir()
    (bundles / run.name / "bundle.json").write_text(json.dumps({"corpus": corpus}))


def test_a_bundle_of_another_corpus_is_missing(tmp_path: Path) -> None:
    planned = plan.plan_runs("cpu")
    assert plan.find_missing(planned, tmp_path, "c0ffee") == planned
    write_bundle_json(tmp_path, planned[0], "c0ffee")
    write_bundle_json(tmp_path, planned[1], "other")
    assert plan.find_missing(planned, tmp_path, "c0ffee") == planned[1:]
    assert plan.find_missing(planned, tmp_path) == planned[2:]
    (tmp_path / planned[0].name / "bundle.json").write_text("{")
    assert plan.find_missing(planned, tmp_path)[0] == planned[0], "a broken one is trained again"


@pytest.mark.parametrize("changed", ["package/code.py", "src/code.py", "workshop/src/code.py"])
def test_a_commit_is_marked_where_the_sources_differ_from_it(
    changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def git(*call: str) -> str:
        author = ["-c", "user.name=a", "-c", "user.email=a@b"]
        return subprocess.run(
            ["git", *author, *call], cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout.strip()

    monkeypatch.delenv("SIGNSPLICE_COMMIT", raising=False)
    package = tmp_path / "package"
    for folder in (package, tmp_path / "src", tmp_path / "workshop" / "src"):
        folder.mkdir(parents=True)
        (folder / "code.py").write_text("1")
    (tmp_path / "results.json").write_text("1")
    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "first")
    head = git("rev-parse", "HEAD")[:12]
    assert environment.read_commit(package) == head
    (tmp_path / "results.json").write_text("2")
    (package / "scratch.txt").write_text("not tracked")
    assert environment.read_commit(package) == head, "results that are being written are no code"
    (tmp_path / changed).write_text("2")
    assert environment.read_commit(package) == f"{head}+"
    (tmp_path / "installed").mkdir()
    assert environment.read_commit(tmp_path / "installed") == "", "inside the repository of something else"
    monkeypatch.setenv("SIGNSPLICE_COMMIT", "abc")
    assert environment.read_commit(tmp_path / "installed") == "abc"


def test_results_judged_apart_become_one(tmp_path: Path) -> None:
    for name, rows in (
        ("a", [row("lpt-plus"), row("lstm", commit="old")]),
        ("b", [row("lstm", commit="new"), row("transformer")]),
    ):
        (tmp_path / name).mkdir()
        results.save(of_rows(*rows), tmp_path / name / results.FILE)
    chosen = kept_frames.choose(corpus(), choose(corpus(), "random"))
    for name in "ab":
        kept_frames.save([replace(pair, made={name: motion(4)}) for pair in chosen], tmp_path / name / kept_frames.FILE)
    out = tmp_path / "out"
    out.mkdir()
    n_rows, known = merging.merge([tmp_path / "a", tmp_path / "b"], out)
    assert (n_rows, len(known.rows)) == (4, 3)
    assert results.load(out / results.FILE) == known
    assert [r.commit for r in known.find(system="lstm")] == ["new"]
    assert list(known.signatures) == [results.hash_signatures()]
    assert set(kept_frames.load(out / kept_frames.FILE)[0].made) == {"a", "b"}
    with pytest.raises(InputError, match=r"c/results.json: not there"):
        merging.merge([tmp_path / "c"], out)
