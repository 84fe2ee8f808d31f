"""`make weights` at toy size: the very script makes a bundle that splices, and a part made again has the same hash."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import signsplice as ss
from signsplice.lexicon import open_shipped_lexicon

pytest.importorskip("torch")
pytestmark = pytest.mark.slow
SCRIPT = Path(__file__).parents[2] / "runs" / "weights.py"


def call(folder: Path, *parts: str) -> str:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *parts, "--smoke", "-o", str(folder)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def made(folder: Path, part: str) -> dict[str, str]:
    return dict(json.loads((folder / "results" / f"{part}.json").read_text())["made"])


def test_networks_are_made_in_parts_and_made_again_alike(tmp_path: Path) -> None:
    call(tmp_path)
    first = made(tmp_path, "networks"), made(tmp_path, "ship")
    assert "is there already" in call(tmp_path, "networks", "ship"), "what is there is not made again"
    # Another checkout: the results of the parts before, and nothing else.
    again = tmp_path / "again"
    again.mkdir()
    shutil.copytree(tmp_path / "results", again / "results")
    for part in ("networks", "ship"):
        (again / "results" / f"{part}.json").unlink()
    call(again, "networks", "ship")
    assert (made(again, "networks"), made(again, "ship")) == first
    assert made(again, "signing") == made(tmp_path, "signing")
    clips = [open_shipped_lexicon().clip(gloss) for gloss in ("HELLO", "NAME")]
    result = ss.splice(clips, ss.SpliceOptions(bundle=again / "bundle"))
    assert (result.cutter, result.transition) == ("learned", "learned")


def test_signing_of_another_signer_is_refused(tmp_path: Path) -> None:
    call(tmp_path, "signing")
    record = tmp_path / "results" / "signing.json"
    stored = json.loads(record.read_text())
    record.write_text(json.dumps(stored | {"made": stored["made"] | {"motion": "000000000000"}}))
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "signing", "--smoke", "-o", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "the signer has changed; start anew" in done.stderr
