"""The service under load, on this machine: many streams at one time, many requests a second, memory over minutes.

The callers share the machine with the service, as they do not in real life.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from signsplice.errors import MissingExtraError
from signsplice.lexicon import shipped

Progress = Callable[[int, int], None] | None

_AHEAD = 3
"""Words that a stream's caller is ahead of the one that is signed."""
_SETTLE_S = 8.0


@contextmanager
def _serving() -> Iterator[tuple[str, int]]:
    """Address and process of a service with default settings."""
    process = subprocess.Popen(
        [sys.executable, "-m", "signsplice", "serve", "--port", "0"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert process.stdout
    try:
        line = process.stdout.readline()
        yield line[line.index("http://") :].split()[0].rstrip("/"), process.pid
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)


def measure(
    n_streams: int = 50, seconds: float = 60.0, rate: float = 20.0, minutes: float = 10.0, progress: Progress = None
) -> dict[str, Any]:
    """Figures of a service: streams and requests for so many seconds each, then both at half the load for minutes.

    late_ms: of every frame, how long after its time it came, counted from its stream's first frame. request_ms: from
    the moment a request was due, whether or not it could be sent then. memory_mb: all processes, every ten seconds.
    Raises ``MissingExtraError``.
    """
    try:
        import httpx
        import psutil
        import websockets
    except ImportError as error:
        raise MissingExtraError(f"this needs {error.name}; install it by: pip install 'signsplice[dev]'") from error
    del httpx, psutil, websockets
    with _serving() as (address, pid):
        return asyncio.run(_measure(address, pid, n_streams, seconds, rate, minutes, progress))


async def _measure(
    address: str, pid: int, n_streams: int, seconds: float, rate: float, minutes: float, progress: Progress
) -> dict[str, Any]:
    with shipped() as lexicon:
        words = [entry.gloss for entry in lexicon.entries() if entry.kind == "sign"]
    await _requests(address, words, 5.0, _SETTLE_S, 0)  # processes are up, networks are read
    late = await _streams(address, words, n_streams, seconds)
    if progress is not None:
        progress(1, 3)
    took, failed = await _requests(address, words, rate, seconds, 1)
    if progress is not None:
        progress(2, 3)
    memory = await _soak(address, pid, words, n_streams // 2, rate / 2, 60.0 * minutes) if minutes else []
    if progress is not None:
        progress(3, 3)
    half = {"minutes": minutes, "streams": n_streams // 2, "a_second": rate / 2}
    return {
        "cores": os.cpu_count(),
        "streams": {
            "n": n_streams,
            "fps": 30,
            "seconds": seconds,
            "frames": int(sum(map(len, late))),
            "late_ms": _percentiles(np.concatenate(late)),
            "worst_stream_p99_ms": round(max(float(np.percentile(one, 99)) for one in late), 1),
        },
        "requests": {
            "a_second": rate,
            "seconds": seconds,
            "words": "3 to 5, drawn",
            "answer": "bvh",
            "n": len(took),
            "failed": failed,
            "request_ms": _percentiles(took),
        },
        "memory": half | {"mb": [round(mb, 1) for mb in memory]},
    }


def _percentiles(values: Sequence[float] | np.ndarray[Any, Any]) -> dict[str, float]:
    told = {f"p{share}": float(np.percentile(values, share)) for share in (50, 95, 99)}
    return {key: round(value, 1) for key, value in {**told, "max": float(np.max(values))}.items()}


async def _streams(address: str, words: Sequence[str], n: int, seconds: float) -> list[np.ndarray[Any, Any]]:
    """For each stream, how late every frame came, ms."""
    return list(await asyncio.gather(*(_stream(address, words, seed, seconds) for seed in range(n))))


async def _stream(address: str, words: Sequence[str], seed: int, seconds: float) -> np.ndarray[Any, Any]:
    from websockets.asyncio.client import connect

    rng = random.Random(seed)
    await asyncio.sleep(2.0 * rng.random())  # callers do not all come in one moment
    late: list[float] = []
    async with connect(address.replace("http", "ws", 1) + "/v1/stream", compression=None, max_size=None) as socket:

        async def say() -> None:
            await socket.send(json.dumps({"type": "word", "gloss": rng.choice(words)}))

        await socket.send(json.dumps({"type": "open", "paced": True}))
        for _ in range(_AHEAD):
            await say()
        zero, ended = 0.0, False
        async for said in socket:
            now = time.perf_counter()
            if isinstance(said, bytes):
                frame = int.from_bytes(said[4:8], "little")
                zero = now if frame == 0 else zero
                late.append(1e3 * (now - zero - frame / 30.0))
                if not ended and now - zero > seconds:
                    ended = True
                    await socket.send('{"type": "end"}')
            elif not ended and json.loads(said).get("span", {}).get("kind") == "sign":
                await say()
    return np.array(late)


async def _requests(
    address: str, words: Sequence[str], rate: float, seconds: float, seed: int
) -> tuple[list[float], int]:
    """How long each request took from the moment it was due, ms; and how many failed."""
    import httpx

    rng = random.Random(seed)
    took: list[float] = []
    failed = 0

    async def one(client: httpx.AsyncClient, due: float) -> None:
        nonlocal failed
        line = rng.sample(list(words), rng.randint(3, 5))
        try:
            answer = await client.post("/v1/sentence?file=bvh", json={"glosses": line})
            failed += answer.status_code != 200
        except httpx.HTTPError:
            failed += 1
        took.append(1e3 * (time.perf_counter() - due))

    limits = httpx.Limits(max_connections=200, max_keepalive_connections=50)
    async with httpx.AsyncClient(base_url=address, timeout=60.0, limits=limits) as client:
        begun, tasks = time.perf_counter(), []
        for k in range(int(rate * seconds)):
            due = begun + k / rate
            await asyncio.sleep(max(0.0, due - time.perf_counter()))
            tasks.append(asyncio.create_task(one(client, due)))
        await asyncio.gather(*tasks)
    return took, failed


async def _soak(address: str, pid: int, words: Sequence[str], n: int, rate: float, seconds: float) -> list[float]:
    """Memory of the service's processes every ten seconds, MB, while it works."""
    import psutil

    service = psutil.Process(pid)
    memory: list[float] = []

    async def watch() -> None:
        while True:
            everyone = [service, *service.children(recursive=True)]
            memory.append(sum(one.memory_info().rss for one in everyone) / 1e6)
            await asyncio.sleep(10.0)

    watching = asyncio.create_task(watch())
    await asyncio.gather(_streams(address, words, n, seconds), _requests(address, words, rate, seconds, 2))
    watching.cancel()
    return memory


def table(figures: dict[str, Any]) -> str:
    """The figures as lines of text."""
    streams, requests, memory = figures["streams"], figures["requests"], figures["memory"]
    lines = [
        f"streams   {streams['n']} at {streams['fps']} fps for {streams['seconds']:g} s; frames late, ms: "
        + _row(streams["late_ms"]),
        f"requests  {requests['a_second']:g} a second for {requests['seconds']:g} s, {requests['failed']} failed; ms: "
        + _row(requests["request_ms"]),
    ]
    if memory["mb"]:
        shown = ", ".join(f"{mb:.0f}" for mb in memory["mb"][:: max(1, len(memory["mb"]) // 10)])
        lines.append(f"memory    over {memory['minutes']:g} minutes, MB: {shown}")
    return "\n".join(lines)


def _row(shares: dict[str, float]) -> str:
    return ", ".join(f"{share} {value:g}" for share, value in shares.items())
