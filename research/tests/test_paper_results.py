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
    first = of_rows(row("lpt"), row("lstm"), row("lpt", optimiser="sgd"), row("lpt", fr=6))
    assert len(first.rows) == 4
    second = first.merged([row("lpt", bundle="new", commit="other", machine="elsewhere")])
    assert len(second.rows) == 4
    assert [r.bundle for r in second.find(system="lpt", fr=8, optimiser="adamw")] == ["new"]
    assert first.find(system="lpt", fr=8, optimiser="adamw")[0].bundle is None, "the first results are unchanged"


def test_results_survive_a_round_trip(tmp_path: Path) -> None:
    curves = [
        Curve("lpt", "random", "cpu", "adamw", 8, 0, [(64.0, 1.0, 0.5, 0.1), (128.0, 2.0, 0.9, 0.01)]),
        Curve("lstm", "random", "cpu", "adamw", None, 0, [(64.0, None, 0.5, 0.1)], COLUMNS, "abc", "c0ffee", 256),
    ]
    known = of_rows(row("lpt", scores={"paa": None}), row("lstm", fr=None)).merged(curves=curves)
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


def test_kept_frames_survive_a_round_trip_and_merge(tmp_path: Path) -> None:
    pairs = corpus()
    chosen = kept_frames.choose(pairs, choose(pairs, "random"))
    assert 1 <= len(chosen) <= kept_frames.COUNT
    name = "cpu/adamw/lpt/nothing"
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


def test_the_plan_trains_every_system_of_the_tables() -> None:
    assert [run.name for run in plan.runs("small")] == [f"{system}-small-adamw-random" for system in plan.TABLE_1]
    for scale in ("smoke", "cpu", "paper"):
        planned = plan.runs(scale, rival="lstm")
        assert len({run.name for run in planned}) == len(planned)
        by_adamw = [run for run in planned if run.optimiser == "adamw"]
        assert {*published.TABLE_1, *published.TABLE_3} <= {run.system for run in by_adamw if run.split == "random"}
        assert {*published.TABLE_1} <= {run.system for run in by_adamw if run.split == "unseen-words"}
        assert {"lpt-printed"} <= {run.system for run in planned if run.optimiser == "sgd"}
    planned = plan.runs("cpu", rival="lstm")
    lacking = {made for by in published.TREATED.values() for made in by.values()} - {*published.WITH_BIAS.values()}
    assert lacking <= {run.system for run in planned}, "both treatments of the paper's four systems"
    assert {r.fr for r in planned if r.system == "lpt-printed"} == {None, *plan.SWEEP} - {published.BEST_FR}
    assert {(r.system, r.seed) for r in planned if r.seed} == {
        (system, seed) for system in ("lpt-printed", "lpt", "lstm") for seed in (1, 2)
    }
    assert next(r for r in planned if r.fr == 6).name == "lpt-printed-fr6-cpu-adamw-random"


def test_the_plan_begins_with_the_rows_of_table_1_and_ends_with_sgd() -> None:
    planned = plan.runs("cpu", rival="transformer")
    assert [run.system for run in planned[:5]] == ["lpt-printed", "lpt", "transformer", "lstm", "conv-s2s"]
    order = [(run.split, run.seed, run.fr, run.optimiser) for run in planned]
    kinds = list(dict.fromkeys(order))
    assert kinds[:4] == [(split, 0, None, "adamw") for split in ("random", "unseen-words")] + [
        ("random", seed, None, "adamw") for seed in (1, 2)
    ]
    assert planned[-1].optimiser == "sgd"
    by_sgd = [run.system for run in plan.runs("paper") if run.optimiser == "sgd"]
    assert by_sgd == ["lpt-printed", "lpt", "transformer", "lstm", "conv-s2s"]


def test_only_what_is_wanted_is_planned() -> None:
    assert {r.system for r in plan.runs("smoke", Choice(("lstm",)))} == {"lstm"}
    asked = plan.runs("cpu", Choice(("lstm", "lpt-printed"), ("sgd",)))
    assert [(r.system, r.optimiser) for r in asked] == [("lstm", "sgd"), ("lpt-printed", "sgd")]
    assert any(r.seed for r in plan.runs("cpu", Choice(("lpt", "lstm")))), "no rival is to be found among one"
    (again,) = plan.runs("cpu", Choice(("transformer",), seeds=(1,), frs=(published.BEST_FR,)))
    assert (again.system, again.seed) == ("transformer", 1), "named, though nobody knows the best rival yet"
    of_fr = plan.runs("cpu", Choice(("lpt-printed",), seeds=(1,), frs=(6,)))
    assert [(r.fr, r.seed) for r in of_fr] == [(6, 1)]
    assert {r.seed for r in plan.runs("cpu", Choice(seeds=(0, 1), frs=(6,)))} == {0}, "only with systems named"
    (alone,) = plan.runs("cpu", Choice(("lpt-printed",), seeds=(1,)))
    assert alone.name == "lpt-printed-cpu-adamw-random-seed1", "no other value of fr, which nobody named"
    assert plan.runs("cpu", Choice(("lpt-printed",), seeds=(5,), frs=(6,))) == []
    wanted = plan.runs("paper", Choice(("lpt", "lstm"), ("adamw",), ("unseen-signer",), (0,)))
    assert {(r.system, r.optimiser, r.split, r.seed) for r in wanted} == {
        ("lpt", "adamw", "random", 0),
        ("lstm", "adamw", "random", 0),
    }, "an unseen signer is judged by what was trained on the random split"


def write_bundle_json(bundles: Path, run: Run, accuracy: float, corpus: str = "c0ffee") -> None:
    (bundles / run.name).mkdir()
    stored = {"corpus": corpus, "parts": {"frames": {"scores": {"accuracy": accuracy}}}}
    (bundles / run.name / "bundle.json").write_text(json.dumps(stored))


def test_the_best_rival_on_validation_gets_further_seeds_when_all_are_trained(tmp_path: Path) -> None:
    rivals = [Run(system, "cpu", "adamw", "random") for system in plan.RIVALS]
    for run, accuracy in zip(rivals, (0.8, 0.9, 0.7), strict=True):
        assert plan.best_rival(tmp_path, "cpu") is None
        assert not any(run.seed for run in plan.runs("cpu")), "the list ends where the rival has to be known"
        write_bundle_json(tmp_path, run, accuracy)
    assert plan.best_rival(tmp_path, "cpu") == rivals[1].system


def test_a_bundle_of_another_corpus_is_missing(tmp_path: Path) -> None:
    planned = plan.runs("cpu")
    assert plan.missing(planned, tmp_path, "c0ffee") == planned
    write_bundle_json(tmp_path, planned[0], 0.9)
    write_bundle_json(tmp_path, planned[1], 0.9, "other")
    assert plan.missing(planned, tmp_path, "c0ffee") == planned[1:]
    assert plan.missing(planned, tmp_path) == planned[2:]


def test_a_commit_is_marked_where_the_package_differs_from_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def git(*call: str) -> str:
        author = ["-c", "user.name=a", "-c", "user.email=a@b"]
        return subprocess.run(
            ["git", *author, *call], cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout.strip()

    monkeypatch.delenv("SIGNSPLICE_COMMIT", raising=False)
    package = tmp_path / "package"
    package.mkdir()
    (package / "code.py").write_text("1")
    (tmp_path / "results.json").write_text("1")
    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "first")
    head = git("rev-parse", "HEAD")[:12]
    assert environment.commit(package) == head
    (tmp_path / "results.json").write_text("2")
    (package / "scratch.txt").write_text("not tracked")
    assert environment.commit(package) == head, "results that are being written are no code"
    (package / "code.py").write_text("2")
    assert environment.commit(package) == f"{head}+"
    (tmp_path / "installed").mkdir()
    assert environment.commit(tmp_path / "installed") == "", "inside the repository of something else"
    monkeypatch.setenv("SIGNSPLICE_COMMIT", "abc")
    assert environment.commit(tmp_path / "installed") == "abc"


def test_results_judged_apart_become_one(tmp_path: Path) -> None:
    for name, rows in (("a", [row("lpt"), row("lstm", commit="old")]), ("b", [row("lstm", commit="new"), row("nat")])):
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
    assert list(known.signatures) == [results.signature_id()]
    assert set(kept_frames.load(out / kept_frames.FILE)[0].made) == {"a", "b"}
    with pytest.raises(InputError, match=r"c/results.json: not there"):
        merging.merge([tmp_path / "c"], out)
