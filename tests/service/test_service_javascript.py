"""The documentation's examples in JavaScript run as they stand, but for the port."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import httpx
import pytest

from serving import PATIENCE_S

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "http.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```js\n(.*?)```", PAGE, re.DOTALL)


def ran(script: str, service: httpx.Client) -> list[str]:
    """The lines that an example prints."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    version = int(subprocess.check_output([node, "--version"], text=True).strip("v\n").split(".")[0])
    if version < 20:
        pytest.skip("needs node 20")
    switch = ["--experimental-websocket"] if version < 22 else []
    assert script.count("127.0.0.1:8000") == 1
    script = script.replace("127.0.0.1:8000", f"127.0.0.1:{service.base_url.port}")
    call = [node, *switch, "--input-type=module", "--eval", script]
    done = subprocess.run(call, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    return done.stdout.splitlines()


def test_a_sentence_by_fetch(service: httpx.Client) -> None:
    (line,) = ran(EXAMPLES[0], service)
    frames = service.post("/v1/sentence", json={"text": "Hello, my name is Anna."}).json()["report"]["frames"]
    assert line.startswith(f"{frames} frames, ")
    assert line.endswith(" bytes; spelled: is, Anna")


def test_a_stream_by_websocket(service: httpx.Client) -> None:
    lines = ran(EXAMPLES[1], service)
    assert [line for line in lines if "is s" in line] == [
        "how is spelled", "are is spelled", "you is signed", "FRIEND is signed",
    ]  # fmt: skip
    assert [line.split()[0] for line in lines if "from frame" in line][-2:] == ["YOU", "FRIEND"]
    shown = [line for line in lines if line.startswith("frame ")]
    assert len(shown) > 3
    assert all(line.endswith(" true") for line in shown)
    assert re.fullmatch(r"\d+ frames", lines[-1])
    assert len(EXAMPLES) == 2
