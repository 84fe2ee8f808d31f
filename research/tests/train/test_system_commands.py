"""The commands that train and time systems: bundles run without torch, and no graph is wrong or names a machine."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from click.testing import CliRunner  # noqa: E402

from exported_bundles import cached_operators  # noqa: E402, F401
from signsplice.errors import InputError, SignspliceError  # noqa: E402
from signsplice_paper import speed  # noqa: E402
from signsplice_paper.cli.commands import app  # noqa: E402
from signsplice_paper.systems import open_bundle  # noqa: E402
from signsplice_paper.train import graphs  # noqa: E402
from signsplice_workshop.train import export  # noqa: E402
from system_toys import toy  # noqa: E402
from training_toys import corpus  # noqa: E402


def test_a_graph_holds_no_paths_of_this_machine() -> None:
    found = graphs.export_paper_graphs(toy("spsn").network, None)
    for text in (str(Path(export.__file__).parents[2]), "site-packages", "stack_trace", "/train/networks/"):
        assert text.encode() not in found["spsn.onnx"], text


def test_a_graph_that_differs_is_refused() -> None:
    network = toy("spsn").network.eval()
    graph = graphs.build_spsn_graph(network)  # type: ignore[arg-type]
    content = export.export_onnx("spsn", graph)
    with torch.no_grad():
        next(iter(network.parameters())).add_(0.5)
    with pytest.raises(SignspliceError, match="onnxruntime and torch differ in tokens"):
        export.compare("spsn", graph, content)
    with pytest.raises(SignspliceError, match="cannot export a Linear"):
        graphs.export_paper_graphs(torch.nn.Linear(1, 1), None)


def test_the_command_trains_and_writes_a_bundle_once(tmp_path: Path) -> None:
    out = tmp_path / "b" / "lptransformer-smoke"
    out.parent.mkdir()
    call = ["train-system", "--pairs", str(corpus().folder), "--system", "lptransformer", "--scale", "smoke"]
    call += ["--out", str(out), "--steps", "4", "--fr", "3", "--device", "cpu"]
    result = CliRunner().invoke(app, call, catch_exceptions=False)
    assert result.exit_code == 0
    assert f"{out}: lptransformer, scale smoke, adamw, random" in result.stdout
    config = open_bundle(out).config
    assert config.corpus == corpus().head["hash"]
    assert (config.fr, config.steps, config.optimiser, config.split) == (3, 8, "adamw", "random")
    assert config.precision == export.FLOAT16
    assert set(config.files) == {"spsn.onnx", "encoder.onnx", "decoder.onnx"}
    assert (out / "tfgn.jsonl").exists()
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    CliRunner().invoke(app, call, catch_exceptions=False)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before, "nothing is trained twice"
    code = (
        "import sys, numpy as np; from signsplice_paper.systems import open_bundle\n"
        f"system = open_bundle({str(out)!r}); x = np.zeros((20, 159)); system.predict(x, x)\n"
        "print(sorted({'torch', 'onnx', 'onnxscript', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_folder_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    call = ["train-system", "--pairs", str(corpus().folder), "--system", "lptransformer", "--scale", "smoke"]
    call += ["--out", str(tmp_path)]
    with pytest.raises(InputError, match="is there already and is no bundle"):
        CliRunner().invoke(app, call, catch_exceptions=False, standalone_mode=False)


def test_untrained_systems_are_exported_and_timed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "SYSTEMS", ("lptransformer", "lstm"))
    call = ["speed", "--scale", "smoke", "--limit", "2", "--pairs", str(corpus().folder)]
    result = CliRunner().invoke(app, [*call, "--out", str(tmp_path)], catch_exceptions=False)
    assert result.stdout.splitlines() == [str(tmp_path / "speed-smoke.json")]
    stored = json.loads((tmp_path / "speed-smoke.json").read_text())
    rows = {(row["system"], row["decoding"], row["writes"]): row for row in stored["rows"]}
    assert len(rows) == len(stored["rows"]) == len(list(speed.list_decoding_runs())) + 1, "and the product"
    assert rows[speed.BASE]["times_base"] == 1.0
    assert all(row["ms_median"] > 0.0 and row["n_parameters"] > 0 for row in stored["rows"])
    assert "pairs:2" in stored["protocol"]


def test_runs_of_all_systems_are_planned_with_their_number_of_frames() -> None:
    runs = list(speed.list_decoding_runs())
    assert len(runs) == len(set(runs)) == 12
    assert runs[0] == speed.DecodingRun(*speed.BASE)
    lengths = [
        speed.DecodingRun("lstm", "one-by-one", writes).count_frames(20, 30, (14, 5, 9)) for writes in speed.WRITES
    ]
    assert lengths == [9, 49]
