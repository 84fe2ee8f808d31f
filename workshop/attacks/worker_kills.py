"""Kills stream workers, and stops the service, with clients connected: `python attacks/worker_kills.py [N]`.

Each of N rounds (20) opens three streams, idle, paced and unpaced, and kills their worker with SIGKILL: once, or once
more while the next one starts, or while clients wait for that start. Measures when each client is told, whether the
slots are given back, and whether a new stream works. Linux only. Prints rows of a Markdown table.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress

import httpx
import psutil
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from service_callers import get_stream_address, start_service

_PATIENCE_S = 30.0
_MODES = ("once", "twice in a row", "while clients wait for the next one")


def _list_workers(pid: int) -> list[psutil.Process]:
    """Returns the worker processes of a service, oldest first."""
    workers = []
    for child in psutil.Process(pid).children():
        with suppress(psutil.Error):  # the process has just ended
            if any("spawn_main" in part for part in child.cmdline()):
                workers.append((child.create_time(), child))
    return [child for _, child in sorted(workers, key=lambda entry: entry[0])]


async def _open_stream(address: str, paced: bool, n_words: int) -> ClientConnection:
    socket = await connect(get_stream_address(address), compression=None, max_size=None, ping_interval=None)
    await socket.send(json.dumps({"type": "open", "paced": paced}))
    for _ in range(n_words):
        await socket.send('{"type": "word", "gloss": "THANK-YOU"}')
    return socket


async def _wait_for_frames(socket: ClientConnection) -> None:
    while not isinstance(await asyncio.wait_for(socket.recv(), 60.0), bytes):
        pass


async def _wait_for_error(socket: ClientConnection, start: float) -> tuple[float, str]:
    """Returns the seconds until a client has an error and the stream is closed, and the error."""
    error = "no word"
    try:
        while True:
            message = await asyncio.wait_for(socket.recv(), _PATIENCE_S)
            if isinstance(message, str) and json.loads(message)["type"] == "error":
                error = json.loads(message)["error"]
    except ConnectionClosed as closed:
        code = closed.rcvd.code if closed.rcvd else "none"
        return time.monotonic() - start, f"{error} (close {code})"
    except TimeoutError:
        return _PATIENCE_S, "nothing"


async def _count_streams(client: httpx.AsyncClient) -> int:
    return int((await client.get("/healthz")).json()["streams"])


async def _kill_next(pid: int, known_pids: set[int]) -> None:
    """Kills the worker that replaces one, as soon as it is there."""
    deadline = time.monotonic() + _PATIENCE_S
    while time.monotonic() < deadline:
        for worker in _list_workers(pid):
            if worker.pid not in known_pids:
                worker.kill()
                known_pids.add(worker.pid)
                return
        await asyncio.sleep(0.02)


async def _run_round(address: str, pid: int, long_pid: int, mode: str, client: httpx.AsyncClient) -> list[float]:
    """Returns the seconds until each client was told. Raises ``AssertionError`` if a new stream does not work."""
    sockets = [
        await _open_stream(address, False, 0),
        await _open_stream(address, True, 8),
        await _open_stream(address, False, 3),
    ]
    for socket in sockets[1:]:
        await _wait_for_frames(socket)
    known_pids = {worker.pid for worker in _list_workers(pid)}
    start = time.monotonic()
    for stream_pid in known_pids - {long_pid}:
        os.kill(stream_pid, signal.SIGKILL)
    if mode != _MODES[0]:
        kill_task = asyncio.create_task(_kill_next(pid, known_pids))
        if mode == _MODES[2]:  # a client whose stream waits for the killed process
            sockets.append(await _open_stream(address, False, 3))
        await kill_task
    errors = await asyncio.gather(*(_wait_for_error(socket, start) for socket in sockets[:3]))
    for seconds, error in errors:
        print(f"  {mode}: told after {seconds:.2f} s: {error}", file=sys.stderr)
    new_socket = sockets[3] if len(sockets) > 3 else await _open_stream(address, False, 3)
    await _wait_for_frames(new_socket)
    await new_socket.close()
    return [seconds for seconds, _ in errors]


async def _kill_busy(address: str, process: subprocess.Popen[str], n: int) -> str:
    seconds: list[float] = []
    async with httpx.AsyncClient(base_url=address, timeout=60.0) as client:
        await client.get("/healthz")  # answered once workers start
        _, long_worker = _list_workers(process.pid)
        for k in range(n):
            seconds += await _run_round(address, process.pid, long_worker.pid, _MODES[k % len(_MODES)], client)
        deadline = time.monotonic() + 5.0
        while (n_lost := await _count_streams(client)) and time.monotonic() < deadline:
            await asyncio.sleep(0.1)
        n_late = sum(value > 2.0 for value in seconds)
        return (
            f"{n_lost} slots lost; {len(seconds)} clients told after {max(seconds):.2f} s at most, "
            f"{n_late} of them later than 2 s; a new stream worked after each"
        )


async def _kill_idle(address: str, process: subprocess.Popen[str], n: int) -> str:
    answers: Counter[int] = Counter()
    async with httpx.AsyncClient(base_url=address, timeout=60.0) as client:
        for _ in range(n):
            for worker in _list_workers(process.pid):
                worker.kill()
            answer = await client.post("/v1/sentence?file=bvh", json={"glosses": ["HELLO"]})
            answers[answer.status_code] += 1
            if answer.status_code != 200:
                print(f"  {answer.text}", file=sys.stderr)
    return f"answers to the next request: {dict(answers)}"


async def _stop_service(address: str, process: subprocess.Popen[str]) -> str:
    """Returns what clients get when the service is stopped while it works for them."""
    sockets = [await _open_stream(address, False, 0), await _open_stream(address, True, 8)]
    await _wait_for_frames(sockets[1])
    async with httpx.AsyncClient(base_url=address, timeout=60.0) as client:
        body = {"glosses": ["THANK-YOU"] * 60, "formats": ["bvh"], "sign_speed": 0.5}
        requests = [asyncio.create_task(client.post("/v1/sentence", json=body)) for _ in range(6)]
        await asyncio.sleep(1.0)
        start = time.monotonic()
        process.send_signal(signal.SIGTERM)
        stream_errors = await asyncio.gather(*(_wait_for_error(socket, start) for socket in sockets))
        try:
            await httpx.AsyncClient(base_url=address).get("/healthz")
            new_connection = "was answered"
        except httpx.ConnectError:
            new_connection = "was refused"
        answers: Counter[str] = Counter()
        for answer in await asyncio.gather(*requests, return_exceptions=True):
            if isinstance(answer, BaseException):
                answers[type(answer).__name__] += 1
            else:
                kind = answer.headers.get("content-type", "").partition(";")[0]
                error = f" {answer.json()['error']!r}" if answer.status_code != 200 and "json" in kind else ""
                answers[f"{answer.status_code} {kind}{error}"] += 1
        answered_s = time.monotonic() - start
        await asyncio.to_thread(process.wait, 60.0)
        ended_s = time.monotonic() - start
    request_outcomes = ", ".join(f"{n} times {outcome}" for outcome, n in answers.items())
    stream_outcomes = ", ".join(f"{outcome} after {seconds:.2f} s" for seconds, outcome in stream_errors)
    return (
        f"requests: {request_outcomes}, after {answered_s:.1f} s at most; streams: {stream_outcomes}; a new "
        f"connection {new_connection}; the service ended after {ended_s:.1f} s"
    )


def _count_orphans(address: str, process: subprocess.Popen[str]) -> str:
    """Returns whether workers, one of them at work, end with a service that is killed."""

    async def start_work() -> None:
        socket = await _open_stream(address, False, 3)
        await _wait_for_frames(socket)
        body = {"glosses": ["THANK-YOU"] * 100, "formats": ["glb"]}
        with suppress(httpx.ReadTimeout):
            await httpx.AsyncClient(base_url=address, timeout=0.5).post("/v1/sentence", json=body)

    asyncio.run(start_work())
    workers = _list_workers(process.pid)
    start = time.monotonic()
    process.kill()
    while (n_left := _count_alive(workers)) and time.monotonic() - start < 10.0:
        time.sleep(0.02)
    return f"{len(workers)} workers, {n_left} of them left after {time.monotonic() - start:.2f} s"


def _count_alive(processes: list[psutil.Process]) -> int:
    n = 0
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            n += process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    return n


def main(n: int) -> None:
    """Prints a row for each attack."""
    print("| attack | seen |\n| --- | --- |")
    with start_service("--workers", "1") as (address, process):
        print(f"| {n} rounds of kills of a worker with open streams | {asyncio.run(_kill_busy(address, process, n))} |")
        print(f"| {n // 2} kills of idle workers | {asyncio.run(_kill_idle(address, process, n // 2))} |")
    with start_service("--workers", "1") as (address, process):
        print(f"| kill -9 of the service while it works | {_count_orphans(address, process)} |")
    for limit in ("60", "2"):
        with start_service("--workers", "1", "--limit", f"drain_seconds={limit}") as (address, process):
            print(f"| SIGTERM, drain_seconds={limit} | {asyncio.run(_stop_service(address, process))} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
