"""Validation curves of whole systems: batches predict as single pairs do, and a curve ends at its bundle's score."""

from __future__ import annotations

import json
import os
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from signsplice.errors import InputError
from signsplice_paper import bundles, curve, pair_samples, protocol
from signsplice_paper.configs import PaperConfig, read_config
from signsplice_paper.systems.splicers import OneNetworkSystem, PaperSystem, TwoNetworkSystem
from signsplice_paper.train import curves, scales
from signsplice_paper.train.batch_prediction import BatchPredictor
from signsplice_paper.train.scales import SYSTEMS, SystemPart
from signsplice_paper.train.stopping import PaperLoop
from signsplice_paper.train.tasks import MOST_FRAMES
from signsplice_workshop.train.loop import train
from system_toys import CONFIGS, part_toy, toy
from training_toys import ALONE, corpus

TAUGHT = "lptransformer"
"""A system whose curves are tested."""


class TorchGraphs:
    """The networks of a system in place of their exported graphs, for one pair at a time."""

    def __init__(self, tasks: list[Any]) -> None:
        self.networks = [task.network.eval() for task in tasks]

    @torch.no_grad()
    def run(self, name: str, inputs: dict[str, Any]) -> dict[str, Any]:
        given = {key: torch.from_numpy(np.asarray(value)) for key, value in inputs.items()}
        first, last = self.networks[0], self.networks[-1]
        if name == "spsn":
            return {"tokens": first(given["x"], given["n_before"]).numpy()}
        if name == "encoder":
            tokens, memory, state = last.encode(*(given[k] for k in ("x", "mask", "n_before")), given.get("marks"))
            named = {f"memory_{k}": part.numpy() for k, part in enumerate(memory)}
            named |= {f"state_{k}": part.numpy() for k, part in enumerate(state)}
            return named if tokens is None else {"tokens": tokens.numpy(), **named}
        parts = [[given[k] for k in sorted(given, key=_number) if k.startswith(kind)] for kind in ("memory", "state")]
        made, ends, state = last.decode(given["fed"], given["kinds"], given["start"], *parts)
        named = {f"next_state_{k}": part.numpy() for k, part in enumerate(state)}
        return {"made": made.numpy(), "last": ends.numpy(), **named}


def _number(name: str) -> int:
    return int(name.rpartition("_")[2]) if "_" in name and name[-1].isdigit() else -1


def one_at_a_time(config: PaperConfig, tasks: list[Any]) -> PaperSystem:
    """A system as the exported one runs."""
    assert config.runs is not None
    kind = OneNetworkSystem if len(tasks) == 1 else TwoNetworkSystem
    decoding = "parallel" if config.runs.concurrent else "one-by-one"
    return kind(config, config.runs, TorchGraphs(tasks), decoding)  # type: ignore[arg-type]


def bundle(folder: Path, system: str, tasks: list[Any], **more: Any) -> PaperConfig:
    """A bundle.json of a system, with no graphs."""
    stored = {
        "version": 1, "system": system, "scale": "smoke", "optimiser": "adamw", "split": "random", "seed": 0,
        "corpus": corpus().head["hash"], "steps": 10, "fr": CONFIGS[SYSTEMS[system][-1]][1], "files": {},
        "config": {name: asdict(CONFIGS[name][0]) for name in SYSTEMS[system]},
        "parts": {name: {"steps": 6, "batch": 4} for name in SYSTEMS[system]},
        "normaliser": {"mean": [0.0] * 159},
        "runs": {
            "positions": "encoder" if len(tasks) == 1 else "spsn", "frames": "generator", "n_fed": 159,
            "concurrent": tasks[-1].network.concurrent, "marked": tasks[-1].network.marked, "most_frames": MOST_FRAMES,
            "token_bias": 0.0 if system.endswith("-printed") else 0.5,
        },
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bundle.json").write_text(json.dumps(stored | more))
    return read_config(folder)


@pytest.mark.parametrize("system", [name for name, parts in SYSTEMS.items() if set(parts) <= set(CONFIGS)])
def test_batches_predict_as_single_pairs_do(system: str, tmp_path: Path) -> None:
    tasks = [toy(name, seed) for seed, name in enumerate(SYSTEMS[system])]
    config = bundle(tmp_path, system, tasks)
    assert config.runs is not None
    single = one_at_a_time(config, tasks)
    pairs = [(corpus().word(p), corpus().word(q)) for p, q in corpus().index[:6, :2].tolist()]
    many = BatchPredictor(single.graphs.networks, config.fr, config.runs.token_bias)  # type: ignore[attr-defined]
    found = many.predict(pairs)
    for (before, after), prediction in zip(pairs, found, strict=True):
        expected = single.predict(before.astype(np.float64), after.astype(np.float64))
        assert (prediction.pre, prediction.post) == (expected.pre, expected.post)
        assert prediction.frames.shape == expected.frames.shape
        assert np.allclose(prediction.frames, expected.frames, atol=1e-5)
    assert many.predict_positions(pairs) == [(prediction.pre, prediction.post) for prediction in found]


def trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, system: str = TAUGHT) -> tuple[PaperConfig, PaperSystem]:
    """A bundle and the system of toys that were trained for six steps, with a snapshot after every second."""
    tasks = []
    for name in SYSTEMS[system]:
        folder = tmp_path / "parts" / f"{name}-smoke-abc"
        task, taught, valid = part_toy(name)
        loop = PaperLoop(6, 4, 1e-2, 0, every=3 if name == "tfgn" else 2, n_judged=4, snapshots=True)
        folder.mkdir(parents=True)
        train(task, loop, taught, valid, folder, "r", ALONE)
        tasks.append(task)
    config = bundle(tmp_path / "bundles" / system, system, tasks)
    for name in SYSTEMS[system]:
        log = (tmp_path / "parts" / f"{name}-smoke-abc" / "log.jsonl").read_bytes()
        (config.path.parent / f"{name}.jsonl").write_bytes(log)
    toys = {name: SystemPart(name, CONFIGS[name][0], CONFIGS[name][1], 6, 4, 1e-2) for name in SYSTEMS[system]}
    monkeypatch.setattr(scales, "make_parts", lambda *_: tuple(toys.values()))
    made = one_at_a_time(config, tasks)
    monkeypatch.setattr(curves, "open_bundle", lambda _: made)
    return config, made


def judge(tmp_path: Path) -> curves.CurveJudge:
    return curves.CurveJudge(corpus(), tmp_path / "parts", torch.device("cpu"), lambda _: nullcontext(None))


@pytest.mark.parametrize("system", [TAUGHT, "lpt-plus"])
def test_a_curve_ends_at_the_score_of_the_exported_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, system: str
) -> None:
    config, exported = trained(tmp_path, monkeypatch, system)
    config.stored["config"]["tfgn"]["counter"] = False  # as earlier versions stored it
    lines: list[str] = []
    (path,) = judge(tmp_path).write([config], False, lines.append)
    assert not lines
    made = curve.load(path.parent, bundles.compute_short_hash(config))
    assert made is not None
    assert made.column("pairs") == [4.0 * (2 + 3), 4.0 * (6 + 6)], "SPSN's nearest snapshots beside TFGN's two"
    minutes = made.column("core_minutes")
    assert None not in minutes
    assert minutes == sorted(minutes, key=lambda m: m or 0.0)
    for score, part in (("paa_train", "train"), ("paa_test", "test")):
        sample = pair_samples.sample(corpus(), "random", part, made.n_pairs)
        positions = protocol.make_position_answer(corpus(), exported)
        exact = [positions(k) == tuple(corpus().index[k, 2:4].tolist()) for k in sample]
        assert made.column(score)[-1] == pytest.approx(np.mean(exact), abs=1e-6)
    assert curve.measure_difference(made, curves.score_bundle(config, corpus())) < curve.MOST_DIFFERENCE
    assert made.n_pairs == len(corpus().split("random", "valid"))
    stamp = os.stat(path).st_mtime_ns
    assert list(judge(tmp_path).write([config], False, lines.append)) == [], "it is there already"
    assert os.stat(path).st_mtime_ns == stamp


def test_a_curve_of_other_weights_than_the_bundle_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, _ = trained(tmp_path, monkeypatch)
    monkeypatch.setattr(curves, "score_bundle", lambda *_: 0.123456)
    lines: list[str] = []
    assert list(judge(tmp_path).write([config], False, lines.append)) == []
    assert "no curve is kept; it ends at an Accuracy of" in lines[0]
    assert "0.123456" in lines[0]
    assert not (config.path.parent / curve.FILE).exists()


def test_bundles_without_snapshots_are_named_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, _ = trained(tmp_path, monkeypatch)
    (config.path.parent / "tfgn.jsonl").write_text('{"step": 6, "loss": 1.0}\n')  # of another training
    other = bundle(tmp_path / "bundles" / "elsewhere", TAUGHT, [toy("spsn"), toy("tfgn")])
    unseen = bundle(tmp_path / "bundles" / "unseen", TAUGHT, [toy("spsn"), toy("tfgn")], split="unseen-words")
    lines: list[str] = []
    assert list(judge(tmp_path).write([config, other, unseen], False, lines.append)) == []
    assert len(lines) == 1
    assert f"no snapshots of {TAUGHT}, elsewhere, which get no curve" in lines[0], "and none is wanted of other splits"


def test_a_bundle_of_another_corpus_gets_no_curve_on_this_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, _ = trained(tmp_path, monkeypatch)
    stored = {**config.stored, "corpus": "another"}
    (config.path.parent / "bundle.json").write_text(json.dumps(stored))
    lines: list[str] = []
    assert list(judge(tmp_path).write([read_config(config.path.parent)], False, lines.append)) == []
    assert lines == []


def test_a_broken_snapshot_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, _ = trained(tmp_path, monkeypatch)
    broken = next((tmp_path / "parts").glob("tfgn-*/snapshots/*.pt"))
    broken.write_bytes(b"no weights")
    with pytest.raises(InputError, match=rf"{broken.name}: cannot be read as weights"):
        list(judge(tmp_path).write([config], False, print))
