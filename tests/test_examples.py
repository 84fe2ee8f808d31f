"""The examples: each runs as a user runs it, with the product alone, is short, and leaves the files that it names."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import signsplice as ss
from alone import environment
from serving import PATIENCE_S, serving
from signsplice.splicing import report

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
WRITES = {
    "01_splice.py": ("splice.bvh", "splice.glb"),
    "02_sentence.py": ("sentence.bvh", "sentence.json", "sentence.png"),
    "03_stream.py": ("stream.bvh",),
    "04_avatar.py": ("avatar.glb", "retargeted.glb", "retargeted.vrma"),
    "05_own_method.py": ("own_method.bvh",),
    "06_service_client.py": ("service.bvh", "service_stream.npz"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("examples") / "out"


@pytest.fixture(scope="module")
def printed(folder: Path) -> dict[str, str]:
    """What each script has printed; all wrote into one folder."""
    return {}


@pytest.mark.parametrize("name", WRITES)
def test_an_example_runs_and_leaves_its_files(name: str, folder: Path, printed: dict[str, str]) -> None:
    command = [sys.executable, "-W", "error", str(EXAMPLES / name), str(folder)]
    with serving("serve", "--workers=1") if name == "06_service_client.py" else nullcontext() as address:
        done = subprocess.run(
            [*command, *filter(None, [address])],
            env=environment(),
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    printed[name] = done.stdout
    for file in WRITES[name]:
        assert (folder / file).stat().st_size > 1000
        assert re.search(rf"wrote .*{re.escape(file)}$", done.stdout, re.M) or file == "avatar.glb", done.stdout
        if (folder / file).suffix not in (".json", ".png"):
            check_clip(ss.load(folder / file), still=file == "avatar.glb")


def check_clip(clip: ss.Clip, still: bool) -> None:
    """A person of 53 joints, or as many as an avatar has, who moves for some seconds and keeps whole."""
    assert len(clip.skeleton) >= 50
    np.testing.assert_allclose(np.linalg.norm(clip.local_rotations, axis=-1), 1.0, atol=1e-6)
    if not still:
        assert 2.0 < clip.seconds < 12.0
        assert np.ptp(clip.local_rotations, axis=0).max() > 0.3


def test_the_scripts_are_these_and_short() -> None:
    assert sorted(path.name for path in EXAMPLES.glob("*.py")) == sorted(WRITES)
    for name in WRITES:
        text = (EXAMPLES / name).read_text()
        assert len(text.splitlines()) < 60, name
        assert f"Run: python examples/{name} [FOLDER" in text
        assert f"({name})" in (EXAMPLES / "README.md").read_text()


def test_what_the_examples_say_is_so(folder: Path, printed: dict[str, str]) -> None:
    """Figures that a script prints, and what its comments promise."""
    if len(printed) < len(WRITES):
        pytest.skip("not every example ran")
    one_by_one, spliced = map(float, re.findall(r"([\d.]+) s", printed["01_splice.py"].splitlines()[0]))
    assert spliced < 0.8 * one_by_one
    assert "Anna     fs-A fs-N fs-N fs-A" in printed["02_sentence.py"]
    assert report.read(folder / "sentence.json", len(ss.load(folder / "sentence.bvh")))["tempo"]["mode"] == "natural"
    assert (folder / "sentence.png").read_bytes().startswith(b"\x89PNG")
    assert "the same as those of ss.splice" in printed["03_stream.py"]
    assert re.search(r"right hand on head: .*: kept", printed["04_avatar.py"])
    assert "lost" not in printed["04_avatar.py"]
    assert "warning" not in printed["04_avatar.py"]
    assert ss.read_avatar(folder / "avatar.glb").body is not None
    assert "after-third and cosine" in printed["05_own_method.py"]
    sent = re.search(r"^(?:unit )*skeleton .* done: (\d+) frames", printed["06_service_client.py"], re.M)
    assert sent is not None
    assert int(sent[1]) == len(ss.load(folder / "service_stream.npz"))


def test_the_notebook_runs_and_makes_what_the_script_makes(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notebook = json.loads((EXAMPLES / "01_splice.ipynb").read_text())
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for cell in notebook["cells"]:
        assert cell["metadata"] == {}
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
            exec("".join(cell["source"]), names)
    if (folder / "splice.bvh").exists():
        for file in WRITES["01_splice.py"]:
            assert (tmp_path / "out/examples" / file).read_bytes() == (folder / file).read_bytes()
