"""Measures honest callers of a service that is attacked."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import cycle, islice
from statistics import median
from typing import Any

import httpx
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

WORDS = ("HELLO", "DEAF", "FRIEND", "THANK-YOU", "SIGN", "MY", "NAME")
_N_PREFETCHED = 3
"""Number of words that a stream's caller sends before they are needed."""
_FPS = 30.0


@dataclass
class CallerRecord:
    """Measurements of honest callers.

    health: seconds that each call of /healthz took; a failed call counts as its time limit.
    late: delay of each paced frame, seconds by the clock that the stream's earliest frame sets.
    posts, first_frames: start of each sentence and stream of another client, by ``time.monotonic``, and the seconds to
        its answer or first frame.
    faults: failures.
    """

    health: list[float] = field(default_factory=list)
    late: list[float] = field(default_factory=list)
    posts: list[tuple[float, float]] = field(default_factory=list)
    first_frames: list[tuple[float, float]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def note(self, call: str, answer: httpx.Response) -> None:
        """Counts an answer that is none as a failure."""
        if answer.status_code != 200:
            self.faults.append(f"{call} {answer.status_code}")

    def row(self, start: float, end: float) -> str:
        """Returns the worst and the 99th percentile, and medians before and within an attack, in words."""
        late = [1e3 * seconds for seconds in sorted(self.late)] or [float("nan")]
        faults = "; " + ", ".join(sorted(set(self.faults))) if self.faults else ""
        return (
            f"/healthz at most {1e3 * max(self.health, default=float('nan')):.0f} ms of {len(self.health)} calls; "
            f"{len(self.late)} frames, late p99 {late[int(0.99 * len(late))]:.0f} ms, worst {late[-1]:.0f} ms; "
            f"HELLO {_compare(self.posts, start, end)}; first frame {_compare(self.first_frames, start, end)}{faults}"
        )


def _compare(calls: list[tuple[float, float]], start: float, end: float) -> str:
    """Returns the median before an attack, and median and worst of calls within it."""
    quiet = [1e3 * seconds for begin, seconds in calls if begin + seconds < start]
    attacked = [1e3 * seconds for begin, seconds in calls if start + 0.5 < begin < end]
    if not (quiet and attacked):
        return f"{len(quiet)} quiet, {len(attacked)} attacked"
    return f"{median(quiet):.0f} ms quiet, {median(attacked):.0f} (at most {max(attacked):.0f}) of {len(attacked)}"


STREAM_OPTIONS: dict[str, Any] = {"compression": None, "max_size": None, "ping_interval": None}


def get_stream_address(address: str) -> str:
    """Returns the address of streams."""
    return address.replace("http", "ws", 1) + "/v1/stream"


def encode_word(gloss: str) -> str:
    """Returns the message that asks for a word."""
    return json.dumps({"type": "word", "gloss": gloss})


async def open_stream(address: str, paced: bool, glosses: Iterable[str]) -> ClientConnection:
    """Opens a stream and sends words."""
    socket = await connect(get_stream_address(address), **STREAM_OPTIONS)
    await socket.send(json.dumps({"type": "open", "paced": paced}))
    for gloss in glosses:
        await socket.send(encode_word(gloss))
    return socket


async def wait_for_frames(socket: ClientConnection) -> None:
    """Waits for the first frames of a stream."""
    while not isinstance(await asyncio.wait_for(socket.recv(), 60.0), bytes):
        pass


async def watch_health(address: str, record: CallerRecord, deadline: float) -> None:
    """Asks /healthz ten times a second, on a new connection each time, until a time of ``time.monotonic``."""
    limits = httpx.Limits(max_keepalive_connections=0)
    async with httpx.AsyncClient(base_url=address, timeout=60.0, limits=limits) as client:
        while time.monotonic() < deadline:
            start = time.monotonic()
            try:
                record.note("/healthz", await client.get("/healthz"))
            except httpx.HTTPError as error:
                record.faults.append(f"/healthz {type(error).__name__}")
            record.health.append(time.monotonic() - start)
            await asyncio.sleep(0.1)


async def play_paced_stream(address: str, record: CallerRecord, deadline: float, offset: int = 0) -> None:
    """Reads a paced stream, sending words ahead, until a time of ``time.monotonic``."""
    glosses = islice(cycle(WORDS), offset, None)
    starts: list[float] = []  # start of the stream by each frame
    try:
        async with await open_stream(address, True, islice(glosses, _N_PREFETCHED)) as socket:
            while time.monotonic() < deadline:
                message = await asyncio.wait_for(socket.recv(), 60.0)
                now = time.monotonic()
                if isinstance(message, bytes):
                    starts.append(now - int.from_bytes(message[4:8], "little") / _FPS)
                    continue
                reply = json.loads(message)
                if reply["type"] == "error":
                    record.faults.append(reply["error"])
                if reply.get("span", {}).get("kind") == "sign":
                    with suppress(ConnectionClosed):
                        await socket.send(encode_word(next(glosses)))
    except (ConnectionClosed, OSError, TimeoutError) as error:
        record.faults.append(f"a stream ended: {type(error).__name__}")
    record.late += [start - min(starts) for start in starts]


async def call_again(address: str, record: CallerRecord, deadline: float) -> None:
    """Asks for HELLO, then for a stream of two words, by turns until a time of ``time.monotonic``."""
    async with httpx.AsyncClient(base_url=address, timeout=60.0, limits=httpx.Limits(keepalive_expiry=1.0)) as client:
        while time.monotonic() < deadline:
            try:
                start = time.monotonic()
                answer = await client.post("/v1/sentence?file=bvh", json={"glosses": ["HELLO"]})
                record.posts.append((start, time.monotonic() - start))
                record.note("HELLO", answer)
                start = time.monotonic()
                async with await open_stream(address, True, WORDS[:2]) as socket:
                    await wait_for_frames(socket)
                record.first_frames.append((start, time.monotonic() - start))
            except (httpx.HTTPError, ConnectionClosed, OSError, TimeoutError) as error:
                record.faults.append(f"HELLO {type(error).__name__}")
            await asyncio.sleep(0.1)
