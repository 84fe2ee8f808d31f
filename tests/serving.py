"""Services for tests: processes that listen on a free port."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx
import psutil
from starlette.requests import HTTPConnection
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

PATIENCE_S = 300.0
"""Time limit of everything that a test waits for: enough for a machine on which many other processes run."""


@contextmanager
def serving(*arguments: str, cwd: Path | None = None, **environment: str) -> Iterator[str]:
    """The address of `signsplice ARGUMENTS`, which listens until the block ends; it then has to exit without errors,
    or by a SIGTERM of a test. ``environment``: further variables of its environment.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "signsplice", *arguments, "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", **({"TMPDIR": str(cwd)} if cwd else {}), **environment},
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
            _, stderr = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    assert process.returncode in (0, -signal.SIGTERM), stderr
    assert "Traceback" not in stderr, stderr


@contextmanager
def http_client(*arguments: str, cwd: Path | None = None, **environment: str) -> Iterator[httpx.Client]:
    """A client of ``serving``. It closes idle connections itself, before the service does so during a request."""
    limits = httpx.Limits(keepalive_expiry=1.0)
    with (
        serving(*arguments, cwd=cwd, **environment) as address,
        httpx.Client(base_url=address, timeout=PATIENCE_S, limits=limits) as client,
    ):
        yield client


def wait_until_warm(client: httpx.Client) -> None:
    """Return once the service says that its worker processes are warm."""
    deadline = time.monotonic() + PATIENCE_S
    while client.get("/healthz").status_code == 503:
        assert time.monotonic() < deadline
        time.sleep(0.05)


@contextmanager
def stream_client(client: httpx.Client, **options: Any) -> Iterator[ClientConnection]:
    """A stream of the service that an HTTP client calls."""
    address = str(client.base_url).replace("http", "ws", 1).rstrip("/") + "/v1/stream"
    options = {"max_size": None, "compression": None, "open_timeout": PATIENCE_S, "ping_interval": None, **options}
    with connect(address, **options) as stream:
        yield stream


def messages_and_close_code(stream: ClientConnection) -> tuple[list[Any], int | None]:
    """The messages of a stream that are JSON, until the service closes it, and the code of that."""
    messages = []
    try:
        while True:
            message = stream.recv(timeout=PATIENCE_S)
            messages += [json.loads(message)] if isinstance(message, str) else []
    except ConnectionClosed as closed:
        return messages, closed.rcvd.code if closed.rcvd else None


class FakeSocket(HTTPConnection):
    """A WebSocket whose client sends one word, then nothing."""

    def __init__(self) -> None:
        super().__init__({"type": "websocket", "client": ("192.0.2.1", 1)})
        texts = ('{"type": "open", "paced": false}', '{"type": "word", "gloss": "HELLO"}')
        self.received = [{"type": "websocket.receive", "text": text} for text in texts]
        self.sent: list[dict[str, Any]] = []

    async def accept(self) -> None: ...

    async def close(self, code: int = 1000) -> None: ...

    async def receive(self) -> dict[str, str]:
        return self.received.pop(0) if self.received else await asyncio.sleep(PATIENCE_S, {})

    async def send_text(self, text: str) -> None:
        self.sent.append(json.loads(text))

    async def send_json(self, message: dict[str, Any]) -> None:
        self.sent.append(message)


def process_of(client: httpx.Client) -> psutil.Process:
    """The process that listens for an HTTP client."""
    for process in psutil.Process().children():
        with suppress(psutil.Error):
            if any(address.laddr.port == client.base_url.port for address in process.net_connections("tcp")):
                return process
    raise AssertionError("no process listens")


def workers_of(client: httpx.Client) -> list[psutil.Process]:
    """The worker processes of the service that an HTTP client calls."""
    found = []
    for process in process_of(client).children():
        with suppress(psutil.Error):  # it has just ended
            if any("spawn_main" in part for part in process.cmdline()):
                found.append(process)
    return found


def raw_request(client: httpx.Client, *parts: bytes, pause: float = 0.0) -> bytes:
    """The bytes that come back when parts are written to a bare socket, until the service closes it."""
    host, port = str(client.base_url.host), client.base_url.port
    with socket.create_connection((host, port), timeout=PATIENCE_S) as connection:
        for part in parts:
            try:
                connection.sendall(part)
            except OSError:
                break
            time.sleep(pause)
        answer = b""
        try:
            while chunk := connection.recv(65536):
                answer += chunk
        except ConnectionResetError:
            pass
        return answer
