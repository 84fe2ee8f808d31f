"""research/runs/paper-scale.sh: trainings in pieces, killed in between, end as one that ran through."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")

from training_toys import corpus

ROOT = Path(__file__).resolve().parents[3]


def piece(out: Path, seconds: int, **more: str) -> subprocess.Popen[str]:
    """A call of the script at toy size, in a process group of its own."""
    settings = {
        **{"SCALE": "smoke", "OUT": str(out), "PAIRS": str(corpus().folder), "PIECE": str(seconds), "MARGIN": "0"},
        **{"SYSTEMS": "lptransformer-printed", "OPTIMISERS": "adamw sgd", "SPLITS": "random", "STEPS": "150"},
        **{"WORKERS": "1", "JUDGES": "1", "LIMIT": "2", "PYTHON": sys.executable, "OMP_NUM_THREADS": "1", **more},
    }
    return subprocess.Popen(
        [str(ROOT / "research" / "runs" / "paper-scale.sh")], env=os.environ | settings, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, start_new_session=True,
    )  # fmt: skip


def finished(out: Path, seconds: int, **more: str) -> bool:
    """Whether everything is trained and judged after a call that ends by itself."""
    text, _ = (process := piece(out, seconds, **more)).communicate(timeout=500)
    assert process.returncode == 0, text
    return text.splitlines()[-1].startswith("done")


def files(out: Path) -> dict[str, Any]:
    """The hashes of the graphs of each bundle."""
    found = (out / "bundles").glob("*/bundle.json")
    return {path.parent.name: json.loads(path.read_text())["files"] for path in found}


@pytest.mark.slow
def test_trainings_in_pieces_killed_in_between_end_as_one_that_ran_through(tmp_path: Path) -> None:
    whole, pieces, elsewhere = tmp_path / "whole", tmp_path / "pieces", tmp_path / "elsewhere"
    assert finished(whole, 500)

    killed = piece(pieces, 500)
    logs = pieces / "bundles" / "parts"
    while not any(path.stat().st_size for path in logs.glob("*/log.jsonl")):
        assert killed.poll() is None, killed.communicate()[0]
        time.sleep(0.05)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.communicate()
    assert not files(pieces)

    assert not finished(pieces, 0), "no time to train in"
    calls = 0
    while len(files(elsewhere)) < 2:
        finished(elsewhere, round(20 * 1.5**calls), FROM=str(pieces))
        calls += 1
        assert calls < 10, "a busy machine needs longer pieces, each half as long again"
    assert finished(elsewhere, 500, FROM=str(pieces))
    assert files(elsewhere) == files(whole)
    rows = [json.loads((out / "paper" / "results.json").read_text())["rows"] for out in (whole, elsewhere)]
    kept = [[(row["system"], row["optimiser"], row["steps"], row["scores"]["mse"]) for row in of] for of in rows]
    assert kept[0] == kept[1]
    assert {row[:3] for row in kept[0]} >= {("lptransformer-printed", method, 300) for method in ("adamw", "sgd")}
