"""The service under load, on this machine: open streams, requests per second, memory over minutes.

The callers run on the same machine and take some of its time, unlike remote callers.
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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from signsplice.children import parent_death_hook
from signsplice.lexicon import open_shipped_lexicon
from signsplice.progress import Progress

_N_PREFETCHED = 3
"""Number of words that a stream's caller sends in advance."""
_SETTLE_S = 8.0
"""Duration of the first requests, seconds; not measured, since processes start and read the networks."""


@contextmanager
def _serving() -> Iterator[tuple[str, int]]:
    """Yield address and process number of a service with default settings."""
    process = subprocess.Popen(
        [sys.executable, "-m", "signsplice", "serve", "--port", "0"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        preexec_fn=parent_death_hook(),
    )
    assert process.stdout
    try:
        line = process.stdout.readline()
        yield line[line.index("http://") :].split()[0].rstrip("/"), process.pid
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)


def measure(
    n_streams: int, seconds: float, rate: float, minutes: float, progress: Progress | None = None
) -> dict[str, Any]:
    """Measure a service: streams, then requests, for ``seconds`` each, then half of both for ``minutes``.

    late_ms: delay of a frame after its due time, counted from its stream's first frame.
    request_ms: time from a request's due time, whether or not it could be sent then, to its answer.
    memory.mb: of all processes, every ten seconds.
    """
    with _serving() as (address, pid):
        return asyncio.run(_measure(address, pid, n_streams, seconds, rate, minutes, progress))


async def _measure(
    address: str, pid: int, n_streams: int, seconds: float, rate: float, minutes: float, progress: Progress | None
) -> dict[str, Any]:
    with open_shipped_lexicon() as lexicon:
        words = [entry.gloss for entry in lexicon.entries() if entry.kind == "sign"]
    report = progress or (lambda *_: None)
    await _requests(address, words, 5.0, _SETTLE_S, 0)
    late = await _streams(address, words, n_streams, seconds)
    report(1, 3)
    request_ms, n_failed = await _requests(address, words, rate, seconds, 1)
    report(2, 3)
    memory = await _soak(address, pid, words, n_streams // 2, rate / 2, 60.0 * minutes) if minutes else []
    report(3, 3)
    half = {"minutes": minutes, "streams": n_streams // 2, "a_second": rate / 2}
    return {
        "cores": os.cpu_count(),
        "streams": {
            "n": n_streams,
            "fps": 30,
            "seconds": seconds,
            "frames": int(sum(map(len, late))),
            "late_ms": _percentiles(np.concatenate(late)),
            "worst_stream_p99_ms": round(max(float(np.percentile(frames, 99)) for frames in late), 1),
        },
        "requests": {
            "a_second": rate,
            "seconds": seconds,
            "words": "3 to 5, drawn",
            "answer": "bvh",
            "n": len(request_ms),
            "failed": n_failed,
            "request_ms": _percentiles(request_ms),
        },
        "memory": half | {"mb": [round(mb, 1) for mb in memory]},
    }


def _percentiles(values: Sequence[float] | np.ndarray[Any, Any]) -> dict[str, float]:
    percentiles = {f"p{percent}": float(np.percentile(values, percent)) for percent in (50, 95, 99)}
    return {key: round(value, 1) for key, value in {**percentiles, "max": float(np.max(values))}.items()}


async def _streams(address: str, words: Sequence[str], n: int, seconds: float) -> list[np.ndarray[Any, Any]]:
    """Measure the delay of every frame of each stream, ms."""
    return list(await asyncio.gather(*(_stream(address, words, seed, seconds) for seed in range(n))))


async def _stream(address: str, words: Sequence[str], seed: int, seconds: float) -> np.ndarray[Any, Any]:
    from websockets.asyncio.client import connect

    rng = random.Random(seed)
    await asyncio.sleep(2.0 * rng.random())  # so that callers do not all start at once
    late: list[float] = []
    async with connect(address.replace("http", "ws", 1) + "/v1/stream", compression=None, max_size=None) as socket:

        async def send_word() -> None:
            await socket.send(json.dumps({"type": "word", "gloss": rng.choice(words)}))

        await socket.send(json.dumps({"type": "open", "paced": True}))
        for _ in range(_N_PREFETCHED):
            await send_word()
        zero, has_ended = 0.0, False
        async for message in socket:
            now = time.perf_counter()
            if isinstance(message, bytes):
                frame = int.from_bytes(message[4:8], "little")
                zero = now if frame == 0 else zero
                late.append(1e3 * (now - zero - frame / 30.0))
                if not has_ended and now - zero > seconds:
                    has_ended = True
                    await socket.send('{"type": "end"}')
            elif not has_ended and json.loads(message).get("span", {}).get("kind") == "sign":
                await send_word()
    return np.array(late)


async def _requests(
    address: str, words: Sequence[str], rate: float, seconds: float, seed: int
) -> tuple[list[float], int]:
    """Measure the time from each request's due time to its answer, ms; and count failures."""
    import httpx

    rng = random.Random(seed)
    request_ms: list[float] = []
    n_failed = 0

    async def request(client: httpx.AsyncClient, due: float) -> None:
        nonlocal n_failed
        glosses = rng.sample(list(words), rng.randint(3, 5))
        try:
            answer = await client.post("/v1/sentence?file=bvh", json={"glosses": glosses})
            n_failed += answer.status_code != 200
        except httpx.HTTPError:
            n_failed += 1
        request_ms.append(1e3 * (time.perf_counter() - due))

    limits = httpx.Limits(max_connections=200, max_keepalive_connections=50)
    async with httpx.AsyncClient(base_url=address, timeout=60.0, limits=limits) as client:
        start, tasks = time.perf_counter(), []
        for k in range(int(rate * seconds)):
            due = start + k / rate
            await asyncio.sleep(max(0.0, due - time.perf_counter()))
            tasks.append(asyncio.create_task(request(client, due)))
        await asyncio.gather(*tasks)
    return request_ms, n_failed


async def _soak(address: str, pid: int, words: Sequence[str], n: int, rate: float, seconds: float) -> list[float]:
    """Measure memory of all processes of the service under both loads, every ten seconds, MB."""
    import psutil

    service = psutil.Process(pid)
    memory: list[float] = []

    async def measure_memory() -> None:
        while True:
            processes = [service, *service.children(recursive=True)]
            memory.append(sum(process.memory_info().rss for process in processes) / 1e6)
            await asyncio.sleep(10.0)

    measuring = asyncio.create_task(measure_memory())
    await asyncio.gather(_streams(address, words, n, seconds), _requests(address, words, rate, seconds, 2))
    measuring.cancel()
    return memory


def table(figures: dict[str, Any]) -> str:
    """Format the figures as lines of text."""
    streams, requests, memory = figures["streams"], figures["requests"], figures["memory"]
    lines = [
        f"streams   {streams['n']} at {streams['fps']} fps for {streams['seconds']:g} s; delay of frames, ms: "
        + _row(streams["late_ms"]),
        f"requests  {requests['a_second']:g} a second for {requests['seconds']:g} s, {requests['failed']} failed; ms: "
        + _row(requests["request_ms"]),
    ]
    if memory["mb"]:
        shown = ", ".join(f"{mb:.0f}" for mb in memory["mb"][:: max(1, len(memory["mb"]) // 10)])
        lines.append(f"memory    over {memory['minutes']:g} minutes, MB: {shown}")
    return "\n".join(lines)


def _row(percentiles: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in percentiles.items())
