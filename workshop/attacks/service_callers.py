"""A service on loopback for attacks, and what honest callers of it see meanwhile."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import httpx
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

SOURCE = Path(__file__).resolve().parents[2] / "src"
WORDS = ("HELLO", "DEAF", "FRIEND", "THANK-YOU", "SIGN", "MY", "NAME")
_N_PREFETCHED = 3
"""Words that a stream's caller has sent before they are needed."""
_FPS = 30.0


@contextmanager
def serving(*arguments: str, log: IO[str] | int = subprocess.DEVNULL) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of a service, and its process, whose standard error goes to ``log``."""
    process = subprocess.Popen(
        [sys.executable, "-m", "signsplice", "serve", "--port", "0", *arguments],
        stdout=subprocess.PIPE,
        stderr=log,
        text=True,
        env={
            **os.environ,
            "OMP_NUM_THREADS": "1",
            "PYTHONPATH": os.pathsep.join([str(SOURCE), os.environ.get("PYTHONPATH", "")]),
        },
    )
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        yield line[line.index("http://") :].split()[0].rstrip("/"), process
    finally:
        process.kill()
        process.wait()


@dataclass
class Seen:
    """What honest callers saw.

    health: seconds that each call of /healthz took; a call that failed counts as its time limit.
    late: seconds that each paced frame came late, after the clock that the stream's earliest frame sets.
    faults: what did not work.
    """

    health: list[float] = field(default_factory=list)
    late: list[float] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def row(self) -> str:
        """The worst and the 99th percentile, in words."""
        late = sorted(self.late)
        p99 = late[int(0.99 * len(late))] if late else float("nan")
        worst = late[-1] if late else float("nan")
        faults = "; " + ", ".join(sorted(set(self.faults))) if self.faults else ""
        return (
            f"/healthz at most {1e3 * max(self.health, default=float('nan')):.0f} ms of {len(self.health)} calls; "
            f"{len(late)} frames, late p99 {1e3 * p99:.0f} ms, worst {1e3 * worst:.0f} ms{faults}"
        )


def stream_address(address: str) -> str:
    """Where streams are opened."""
    return address.replace("http", "ws", 1) + "/v1/stream"


async def watch_health(address: str, seen: Seen, until: float, every: float = 0.1, patience: float = 60.0) -> None:
    """Ask /healthz, on a new connection each time, until a time of ``time.monotonic``."""
    limits = httpx.Limits(max_keepalive_connections=0)
    async with httpx.AsyncClient(base_url=address, timeout=patience, limits=limits) as client:
        while (await client.get("/healthz")).status_code == 503:  # its workers start
            await asyncio.sleep(every)
        while time.monotonic() < until:
            start = time.monotonic()
            try:
                answer = await client.get("/healthz")
                if answer.status_code != 200:
                    seen.faults.append(f"/healthz {answer.status_code}")
            except httpx.HTTPError as error:
                seen.faults.append(f"/healthz {type(error).__name__}")
            seen.health.append(time.monotonic() - start)
            await asyncio.sleep(every)


async def paced_stream(address: str, seen: Seen, until: float, offset: int = 0) -> None:
    """Read a paced stream, sending words ahead, until a time of ``time.monotonic``."""
    sent = offset

    async def send_word(socket: ClientConnection) -> None:
        nonlocal sent
        await socket.send(json.dumps({"type": "word", "gloss": WORDS[sent % len(WORDS)]}))
        sent += 1

    zeros: list[float] = []  # when each frame says that the stream began
    try:
        async with connect(stream_address(address), compression=None, max_size=None, ping_interval=None) as socket:
            await socket.send('{"type": "open", "paced": true}')
            for _ in range(_N_PREFETCHED):
                await send_word(socket)
            while time.monotonic() < until:
                message = await asyncio.wait_for(socket.recv(), 60.0)
                now = time.monotonic()
                if isinstance(message, bytes):
                    zeros.append(now - int.from_bytes(message[4:8], "little") / _FPS)
                    continue
                told = json.loads(message)
                if told["type"] == "error":
                    seen.faults.append(told["error"])
                if told.get("span", {}).get("kind") == "sign":
                    with suppress(ConnectionClosed):
                        await send_word(socket)
    except (ConnectionClosed, OSError, TimeoutError) as error:
        seen.faults.append(f"a stream ended: {type(error).__name__}")
    seen.late += [zero - min(zeros) for zero in zeros]
