"""Services for tests: processes that listen on a port that is free."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
from websockets.sync.client import ClientConnection, connect


@contextmanager
def serving(*arguments: str, cwd: Path | None = None) -> Iterator[str]:
    """The address of `signsplice ARGUMENTS`, which listens until the block ends; then it has to end well itself."""
    process = subprocess.Popen(
        [sys.executable, "-m", "signsplice", *arguments, "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", **({"TMPDIR": str(cwd)} if cwd else {})},
        cwd=cwd,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        line = process.stdout.readline()
        assert "http://" in line, process.stderr.read()
        yield line[line.index("http://") :].split()[0]
    finally:
        process.send_signal(signal.SIGINT)
        try:
            _, said = process.communicate(timeout=15)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    assert process.returncode == 0, said
    assert "Traceback" not in said, said


@contextmanager
def talking(client: httpx.Client, **options: Any) -> Iterator[ClientConnection]:
    address = str(client.base_url).replace("http", "ws", 1).rstrip("/") + "/v1/stream"
    with connect(address, max_size=None, compression=None, **options) as socket:
        yield socket
