"""Bundles of the paper's systems: torch and onnxruntime agree, they run without torch, and the command trains them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from click.testing import CliRunner  # noqa: E402

from signsplice.errors import InputError, SignspliceError  # noqa: E402
from signsplice.splicing.networks.bundle import write_bundle  # noqa: E402
from signsplice.train import export  # noqa: E402
from signsplice.train.task import Task  # noqa: E402
from signsplice_paper import speed  # noqa: E402
from signsplice_paper.cli.commands import app  # noqa: E402
from signsplice_paper.systems import DECODINGS, PaperSystem, TwoNetworkSystem, open_bundle  # noqa: E402
from signsplice_paper.train import graphs, scales, training  # noqa: E402
from signsplice_paper.train.networks.filling import Filler  # noqa: E402
from signsplice_paper.train.networks.generator import Generator, generate  # noqa: E402
from signsplice_paper.train.pairs_data import Batch  # noqa: E402
from signsplice_paper.train.scales import SystemPart  # noqa: E402
from signsplice_paper.train.tasks import MOST_FRAMES, TokenTask, positions  # noqa: E402
from system_toys import CONFIGS, data, toy  # noqa: E402
from training_toys import corpus  # noqa: E402

SYSTEMS = {name: parts for name, parts in scales.SYSTEMS.items() if name not in ("lpt-wa", "lpt-wac")}


@pytest.fixture(scope="module", autouse=True)
def cached_operators() -> Iterator[None]:
    """Parse the source of the exporter's 500 operators once, not in every export, which takes two seconds."""
    with pytest.MonkeyPatch.context() as patch:
        apis = pytest.importorskip("onnxscript._framework_apis.torch_2_5")
        patch.setattr(apis, "get_torchlib_ops", cache(apis.get_torchlib_ops))
        yield


@pytest.fixture(scope="module")
def exports() -> dict[str, dict[str, bytes]]:
    """ONNX graphs by part, exported once; exporting compares torch with onnxruntime."""
    return {}


@pytest.fixture
def bundle(
    request: pytest.FixtureRequest, tmp_path: Path, exports: dict[str, dict[str, bytes]]
) -> tuple[PaperSystem, list[Task]]:
    """A system of untrained toys as a bundle, and its tasks."""
    system: str = request.param
    tasks, chosen = [], []
    files: dict[str, bytes] = {}
    for name in SYSTEMS[system]:
        made = toy(name)
        _randomise_heads(made)
        if name not in exports:
            exports[name] = graphs.paper_graphs(made.network, CONFIGS[name][1])
        files |= exports[name]
        tasks.append(made.eval())
        chosen.append(SystemPart(name, CONFIGS[name][0], CONFIGS[name][1], 10, 8, 1e-2))
    config = training.Training(system, "smoke")
    write_bundle(tmp_path, training.facts(config, corpus(), tuple(chosen), tasks, [tmp_path] * len(chosen)), files)
    return open_bundle(tmp_path), tasks


def _randomise_heads(made: Task) -> None:
    """Set the weights of the heads, so that an untrained network emits tokens and different frames."""
    for name, parameter in made.named_parameters():
        if name.endswith(("token.bias", "out.bias")) and parameter.shape == (3,):
            torch.nn.init.zeros_(parameter)
        if name.endswith(("token.weight", "out.weight")):
            torch.nn.init.normal_(parameter, std=1.0)


def torch_frames(made: Task, batch: Batch, parallel: bool) -> np.ndarray:
    network = made.network
    with torch.no_grad():
        if isinstance(network, Filler):
            count = int(network.length(batch.x, batch.mask).argmax()) + 1
            return np.asarray(network.fill(batch.x, batch.mask, torch.ones(1, count, dtype=torch.bool))[0])
        assert isinstance(network, Generator)
        encoded = network.encode(batch.x, batch.mask, batch.n_before, batch.marks)
        return np.asarray(generate(network, encoded, 1, MOST_FRAMES, parallel)[0])


def torch_positions(made: Task, batch: Batch) -> tuple[int | None, int | None]:
    with torch.no_grad():
        if isinstance(made, TokenTask):
            logits = made.network(batch.x, batch.n_before, batch.mask)
        else:
            network = made.network
            assert isinstance(network, Generator)
            logits = network.encode(batch.x, batch.mask, batch.n_before).tokens
    at, emitted = positions(logits, batch.mask)
    pre, post = (int(k) if found else None for k, found in zip(at[0], emitted[0], strict=True))
    return pre, None if post is None else post - int(batch.n_before)


@pytest.mark.parametrize("bundle", SYSTEMS, indirect=True)
def test_a_bundle_predicts_what_torch_predicts(bundle: tuple[PaperSystem, list[Task]]) -> None:
    system, tasks = bundle
    pairs = corpus()
    concurrent = system.config.runs is not None and system.config.runs.concurrent
    for row in range(3):
        batch = data().batch([row])
        p, q = pairs.index[int(batch.numbers[0]), :2].tolist()
        before, after = pairs.word(p).astype(float), pairs.word(q).astype(float)
        found = system.predict(before, after)
        pre, post = torch_positions(tasks[0], batch)
        assert (found.pre, found.post) == (pre, post)
        for decoding in DECODINGS if concurrent else DECODINGS[:2]:
            now = open_bundle(system.graphs.folder, decoding)
            seen = batch
            if isinstance(now, TwoNetworkSystem):
                seen = data(fr=system.fr).batch([row])
                true_pre, true_post, _ = pairs.truth(int(batch.numbers[0]))
                frames = now.fill(before, after, true_pre, true_post)
            else:
                frames = now.predict(before, after).frames
            expected = torch_frames(tasks[-1], seen, decoding == "parallel")
            assert frames.shape == expected.shape
            np.testing.assert_allclose(frames, expected, atol=1e-4)
    assert system.n_parameters == sum(p.numel() for t in tasks for p in t.network.parameters())


def test_a_graph_holds_no_paths_of_this_machine(exports: dict[str, dict[str, bytes]]) -> None:
    found = exports.get("spsn") or graphs.paper_graphs(toy("spsn").network, None)
    for text in (str(Path(export.__file__).parents[2]), "site-packages", "stack_trace", "/train/paper/networks/"):
        assert text.encode() not in found["spsn.onnx"], text


def test_a_graph_that_differs_is_refused() -> None:
    network = toy("spsn").network.eval()
    graph = graphs.spsn_graph(network)  # type: ignore[arg-type]
    content = export.exported("spsn", graph)
    with torch.no_grad():
        next(iter(network.parameters())).add_(0.5)
    with pytest.raises(SignspliceError, match="onnxruntime and torch differ in tokens"):
        export.compare("spsn", graph, content)
    with pytest.raises(SignspliceError, match="cannot export a Linear"):
        graphs.paper_graphs(torch.nn.Linear(1, 1), None)


def test_the_command_trains_and_writes_a_bundle_once(tmp_path: Path) -> None:
    out = tmp_path / "b" / "lpt-smoke"
    out.parent.mkdir()
    call = ["train-system", "--pairs", str(corpus().folder), "--system", "lpt", "--scale", "smoke"]
    call += ["--out", str(out), "--steps", "4", "--fr", "3", "--device", "cpu"]
    result = CliRunner().invoke(app, call, catch_exceptions=False)
    assert result.exit_code == 0
    assert f"{out}: lpt, scale smoke, adamw, random" in result.stdout
    config = open_bundle(out).config
    assert config.corpus == corpus().head["hash"]
    assert (config.fr, config.steps, config.optimiser, config.split) == (3, 8, "adamw", "random")
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
    call = ["train-system", "--pairs", str(corpus().folder), "--system", "lpt", "--scale", "smoke"]
    call += ["--out", str(tmp_path)]
    with pytest.raises(InputError, match="is there already and is no bundle"):
        CliRunner().invoke(app, call, catch_exceptions=False, standalone_mode=False)


def test_untrained_systems_are_exported_and_timed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "SYSTEMS", ("lpt", "lstm"))
    call = ["speed", "--scale", "smoke", "--limit", "2", "--pairs", str(corpus().folder)]
    result = CliRunner().invoke(app, [*call, "--out", str(tmp_path)], catch_exceptions=False)
    assert result.stdout.splitlines() == [str(tmp_path / f"speed-smoke.{kind}") for kind in ("json", "md")]
    stored = json.loads((tmp_path / "speed-smoke.json").read_text())
    rows = {(row["system"], row["decoding"], row["writes"]): row for row in stored["rows"]}
    assert len(rows) == len(stored["rows"]) == len(list(speed.decoding_runs())) + 1, "and the product"
    assert rows[speed.BASE]["times_base"] == 1.0
    assert all(row["ms_median"] > 0.0 and row["n_parameters"] > 0 for row in stored["rows"])
    assert "pairs:2" in stored["protocol"]


def test_runs_of_all_systems_are_planned_with_their_number_of_frames() -> None:
    runs = list(speed.decoding_runs())
    assert len(runs) == len(set(runs)) == 12
    assert runs[0] == speed.DecodingRun(*speed.BASE)
    lengths = [speed.DecodingRun("lstm", "one-by-one", writes).n_frames(20, 30, (14, 5, 9)) for writes in speed.WRITES]
    assert lengths == [9, 49]
