"""Uses signsplice with the oldest versions that pyproject.toml declares, for every extra that users ask for.

    python workshop/runs/lowest_versions.py [FOLDER]

uv resolves what is declared to its lowest versions, hatchling for the build among it, and installs them with the wheel
in an environment in FOLDER, by default a temporary one. Prints the versions and a line for each use; the exit status is
1 at the first that fails. Needs uv and an index of packages.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
EXTRAS = ("bulk", "compressed", "serve", "video", "words")
"""Extras of users; ``dev`` and ``fuzz`` are locked."""
PYTHON = "3.11"
"""The oldest Python; later ones have no wheels of the oldest packages."""
_WAIT_S = 300
"""Longest time of one use, seconds."""
_LOOPBACK = urllib.request.build_opener(urllib.request.ProxyHandler({}))
"""Opens addresses of this machine, whatever proxy the environment names."""


def main() -> None:
    """Install the lowest versions and use them."""
    if sys.argv[1:]:
        _check(Path(sys.argv[1]).resolve())
    else:
        with tempfile.TemporaryDirectory() as folder:
            _check(Path(folder).resolve())


def _check(folder: Path) -> None:
    work = folder / "work"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    step = "installation"
    try:
        program = _install(folder)
        for use in (_demo, _files, _errors, _bulk, _serve):
            step = use.__name__[1:]
            use(program, work)
            print(f"{step}: works", flush=True)
    except (AssertionError, OSError, subprocess.SubprocessError) as error:
        sys.exit(f"{step}: failed: {error}")


def _install(folder: Path) -> str:
    """Build and install the wheel with the lowest versions; return the path of the program."""
    uv = shutil.which("uv", path=f"{Path(sys.executable).parent}:{os.environ.get('PATH', '')}")
    if uv is None:
        sys.exit("no uv, expected it beside this Python or in PATH: pip install uv")
    pins, build_pins, place = folder / "lowest.txt", folder / "build.txt", folder / "environment"
    pip, resolve = [uv, "pip"], ["compile", "--quiet", "--resolution", "lowest-direct", "--python-version", PYTHON]
    resolve += ["--no-annotate", "--no-header", "--output-file"]
    extras = [word for name in EXTRAS for word in ("--extra", name)]
    _call(*pip, *resolve, pins, *extras, ROOT / "pyproject.toml")
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    _call(*pip, *resolve, build_pins, "-", text="\n".join(asked))
    build: list[str | Path] = ["build", "--quiet", "--wheel", "--build-constraint", build_pins, "--python", PYTHON]
    _call(uv, *build, "--out-dir", folder / "dist", ROOT)
    (wheel,) = (folder / "dist").glob("*.whl")
    _call(uv, "venv", "--quiet", "--clear", "--python", PYTHON, place)
    _call(*pip, "install", "--quiet", "--python", place, "--no-deps", "--requirement", pins, wheel)
    print(" ".join((build_pins.read_text() + pins.read_text()).split()), flush=True)
    return str(place / "bin" / "signsplice")


def _call(*words: str | Path, text: str = "") -> None:
    subprocess.run([str(word) for word in words], input=text, text=True, check=True)


def _run(work: Path, *call: str, status: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(call, cwd=work, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_WAIT_S)
    if done.returncode != status:
        raise AssertionError(
            f"{' '.join(call[1:])}: status {done.returncode}, expected {status}\n{done.stderr[-3000:]}"
        )
    return done


def _demo(program: str, work: Path) -> None:
    done = _run(work, program, "demo", "--out", "demo")
    assert "warning" not in done.stderr, done.stderr


def _files(program: str, work: Path) -> None:
    """A splice with the networks, pictures, a film, an avatar's clip and a lexicon."""
    words = [f"demo/words/{word}.bvh" for word in ("HELLO", "DEAF")]
    _run(work, program, "splice", *words, "-o", "ab.glb", "--report", "ab.json")
    report = json.loads((work / "ab.json").read_text())
    assert (bool(report["bundle"]), report["warnings"]) == (True, []), "spliced without the networks"
    _run(work, program, "render", "ab.glb", "ab.png", "--report", "ab.json")
    _run(work, program, "render", "ab.glb", "ab.gif")
    _run(work, program, "sentence", "HELLO MY NAME fs-ANNA", "-o", "anna.vrma")
    _run(work, program, "view", "anna.vrma", "-o", "anna.html")
    _run(work, program, "lexicon", "build", "demo/words", "-o", "words")
    for name, head in {"ab.png": b"\x89PNG", "ab.gif": b"GIF8", "anna.html": b"<!doctype html>"}.items():
        assert (work / name).read_bytes().startswith(head), f"{name}: starts with other bytes than {head!r}"


def _errors(program: str, work: Path) -> None:
    """Each wrong call is one line and status 2."""
    for call in (("inspect", "none.bvh"), ("inspect",), ("splice", "--none"), ("none",), ("render", "ab.glb", "a.x")):
        done = _run(work, program, *call, status=2)
        assert re.fullmatch("error: .+\n", done.stderr), f"{' '.join(call)}: {done.stderr}"
    assert "Usage" in _run(work, program, status=2).stderr


def _bulk(program: str, work: Path) -> None:
    _run(work, program, "bulk", "recipes", "--count", "6", "--words", "2:3", "-o", "recipes.parquet")
    _run(work, program, "bulk", "sentences", "recipes.parquet", "-o", "shards", "--workers", "1")
    done = _run(work, program, "bulk", "make", "shards", "3", "-o", "row.bvh")
    assert (work / "row.bvh").stat().st_size, done.stdout


def _serve(program: str, work: Path) -> None:
    """The service gets ready and makes a sentence."""
    call = [program, "serve", "--port", "0", "--workers", "1"]
    with subprocess.Popen(call, cwd=work, stdout=subprocess.PIPE, text=True) as service:
        try:
            assert service.stdout is not None
            address = next((word for word in service.stdout.readline().split() if word.startswith("http")), "")
            assert address, "it has ended before it named its address"
            health = _answer(f"{address}healthz")
            assert health["status"] == "ok", health
            asked = json.dumps({"glosses": ["HELLO", "DEAF"], "formats": ["bvh"]}).encode()
            assert _answer(f"{address}v1/sentence", asked)["files"]["bvh"]
        finally:
            service.terminate()


def _answer(url: str, body: bytes | None = None) -> dict[str, Any]:
    """Return the answer of the service; it is awaited while the service says 503: its processes start."""
    request = urllib.request.Request(url, body, {"Content-Type": "application/json"} if body else {})
    for attempt in range(_WAIT_S):
        try:
            with _LOOPBACK.open(request, timeout=_WAIT_S) as answer:
                found: dict[str, Any] = json.load(answer)
                return found
        except urllib.error.HTTPError as error:
            if error.code != 503 or attempt == _WAIT_S - 1:
                raise
            time.sleep(1.0)
    raise AssertionError(url)


if __name__ == "__main__":
    main()
