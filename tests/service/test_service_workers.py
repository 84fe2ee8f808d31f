"""Worker processes, the streams that they hold, and the end of the service."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest

from serving import (
    PATIENCE_S,
    FakeSocket,
    http_client,
    messages_and_close_code,
    process_of,
    stream_client,
    wait_until_warm,
    workers_of,
)
from signsplice.lexicon import building
from signsplice.lexicon.lexicon import SHIPPED
from signsplice.motion import Clip
from signsplice.service import work
from signsplice.service.avatars import UploadedAvatars
from signsplice.service.fair_queue import FairQueue
from signsplice.service.monitoring import Metrics
from signsplice.service.settings import Settings
from signsplice.service.streaming import StreamSession
from signsplice.service.wire import FRAMES_HEADER, FRAMES_MAGIC
from signsplice.service.workers import BusyError, Worker, WorkerLostError


class SlowProcess:
    """A worker process that needs longer for a word than a stream may be idle."""

    def __init__(self) -> None:
        self.ended = asyncio.Event()

    async def run(self, job: Callable[..., Any], *args: object) -> Any:
        if job is work.parse_message:
            return [("HELLO", True)], []
        await asyncio.sleep(1.0)
        return [{"type": "skeleton"}]

    def post(self, job: Callable[..., Any], *args: object) -> None: ...


@pytest.mark.parametrize("is_quick", [False, True])
def test_a_worker_is_warmed_by_whatever_words_its_lexicon_has(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: dict[str, Clip], is_quick: bool
) -> None:
    with building(tmp_path / "two") as builder:
        for gloss in ("SIGN", "DEAF"):
            builder.add(words[gloss], gloss)
    state = work._WorkerState(Settings(lexicons=(str(tmp_path / "two"),)))
    monkeypatch.setattr(work, "_worker", state, raising=False)
    work.warm_up(is_quick)
    assert state.clip.cache_info().currsize == 2
    assert not state.streams


class FakeWorker:
    """The place of a process."""

    spent, is_ready = 0.0, True

    def __init__(self, process: object) -> None:
        self.process = process

    async def recover(self) -> None: ...

    def abandon(self) -> None: ...

    async def begin(self, job: Callable[..., Any], *args: object) -> tuple[object, None]:
        return self.process, None


def session(socket: FakeSocket, process: object, **limits: float) -> StreamSession:
    """The session of a fake client with a fake process."""
    metrics = Metrics(lambda: 0, lambda: 0)
    settings = Settings(**limits)  # type: ignore[arg-type]
    avatars = UploadedAvatars(settings)
    return StreamSession(socket, settings, FairQueue(), FakeWorker(process), metrics, avatars)  # type: ignore[arg-type]


def test_a_stream_is_not_idle_while_the_service_works() -> None:
    socket = FakeSocket()

    async def stream() -> None:
        await session(socket, SlowProcess(), stream_idle_seconds=0.3).run()

    asyncio.run(stream())
    assert [message["type"] for message in socket.sent] == ["skeleton", "error"]
    assert "nothing came for 0.3 s" in socket.sent[1]["error"]


class LongWordProcess(SlowProcess):
    """A worker process that makes a long word at once."""

    async def run(self, job: Callable[..., Any], *args: object) -> Any:
        if job is work.parse_message:
            return [("HELLO", True)], []
        return [FRAMES_HEADER.pack(FRAMES_MAGIC, k, 1, 0) + bytes(12) for k in range(200)]


@pytest.mark.parametrize(("pause", "is_slow"), [(0.1, True), (0.02, False)])
def test_a_stream_that_is_read_more_slowly_than_it_plays_is_closed(pause: float, is_slow: bool) -> None:
    """Though every single frame is read in time; at 30 frames a second."""
    socket = FakeSocket()

    async def stream() -> None:
        async def send_bytes(message: bytes) -> None:
            await asyncio.sleep(pause)

        socket.send_bytes = send_bytes  # type: ignore[attr-defined]
        await session(socket, LongWordProcess(), idle_seconds=1.0, stream_idle_seconds=0.3).run()

    asyncio.run(stream())
    assert ("too slow" in socket.sent[-1]["error"]) == is_slow


def test_the_service_is_well_once_its_workers_are_warm() -> None:
    with http_client("serve", "--workers", "1") as client:
        first = client.get("/healthz")
        assert (first.status_code, first.json()["status"]) == (503, "starting")
        wait_until_warm(client)
        last = client.get("/healthz")
        assert (last.status_code, last.json()["status"]) == (200, "ok")


def test_a_service_does_not_start_with_a_damaged_word(tmp_path: Path) -> None:
    shutil.copytree(SHIPPED, tmp_path / "words")
    with (tmp_path / "words" / "frames.bin").open("r+b") as file:
        file.seek(1_000_000)
        byte = file.read(1)
        file.seek(1_000_000)
        file.write(bytes([byte[0] ^ 1]))
    call = [sys.executable, "-m", "signsplice", "serve", "--port", "0", "--lexicon", str(tmp_path / "words")]
    run = subprocess.run(call, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert run.returncode == 2
    assert run.stdout == ""
    assert re.fullmatch(r"error: .*words: word '[^']+': its SHA-256 is another than .* again\n", run.stderr)


class EndlessProcess(SlowProcess):
    """A worker process that ends as soon as frames go out."""

    async def run(self, job: Callable[..., Any], *args: object) -> Any:
        if job is work.parse_message:
            return [("HELLO", True)], []
        return [FRAMES_HEADER.pack(FRAMES_MAGIC, k, 1, 0) + bytes(12) for k in range(1000)]


@pytest.mark.parametrize("at_once", [True, False])
def test_a_stream_whose_process_ends_while_a_frame_goes_out_is_closed(at_once: bool) -> None:
    """The end of a task and the sending of a frame may fall into one turn of the event loop."""

    async def stream() -> list[Any]:
        process, socket = EndlessProcess(), FakeSocket()

        async def send_bytes(message: bytes) -> None:
            process.ended.set()
            for _ in range(0 if at_once else 2):
                await asyncio.sleep(0)

        socket.send_bytes = send_bytes  # type: ignore[attr-defined]
        serving = asyncio.create_task(session(socket, process).run())
        await asyncio.wait({serving}, timeout=PATIENCE_S / 10)
        return socket.sent if serving.done() else []

    sent = asyncio.run(stream())
    assert sent, "the stream goes on without its process"
    assert "the process that held this stream ended" in sent[-1]["error"]


def kill_next(client: httpx.Client, known: list[psutil.Process]) -> None:
    """Kill the process that replaces one, as soon as it is there."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        for process in workers_of(client):
            if process not in known:
                return process.kill()
        time.sleep(0.02)
    raise AssertionError("no process replaces one that was killed")


@pytest.mark.skipif(sys.platform != "linux", reason="finds processes as Linux lists them")
@pytest.mark.parametrize(
    ("kill", "rounds"),
    [
        ("once", 1),
        pytest.param("once", 7, marks=pytest.mark.slow),
        pytest.param("twice in a row", 7, marks=pytest.mark.slow),
        pytest.param("while a client waits for the next", 7, marks=pytest.mark.slow),
    ],
)
def test_streams_whose_process_is_killed_are_told_and_closed(service: httpx.Client, kill: str, rounds: int) -> None:
    for _ in range(rounds):
        with ExitStack() as stack:
            idle, paced, used, waiting = (stack.enter_context(stream_client(service)) for _ in range(4))
            for stream in (idle, paced, used):
                stream.send(json.dumps({"type": "open", "paced": stream is paced}))
            for stream in (paced, used):
                for _ in range(8 if stream is paced else 3):
                    stream.send('{"type": "word", "gloss": "HELLO"}')
                while not isinstance(stream.recv(timeout=PATIENCE_S), bytes):
                    pass
            known = workers_of(service)
            for process in known:
                process.kill()
            if kill == "twice in a row":
                kill_next(service, known)
            for _ in range(1 if kill.startswith("while") else 0):
                waiting.send('{"type": "open", "paced": false}')
                kill_next(service, known)
            for stream in (idle, paced, used):
                messages, code = messages_and_close_code(stream)
                assert "the process that held this stream ended" in messages[-1]["error"]
                assert code == 1013
            if not kill.startswith("while"):
                waiting.send('{"type": "open", "paced": false}')
            for _ in range(3):
                waiting.send('{"type": "word", "gloss": "HELLO"}')
            while not isinstance(waiting.recv(timeout=PATIENCE_S), bytes):
                pass
        for process in workers_of(service):
            process.kill()
        assert service.post("/v1/sentence?file=bvh", json={"glosses": ["HELLO"]}).status_code == 200
        deadline = time.monotonic() + PATIENCE_S
        while service.get("/healthz").json()["streams"]:
            assert time.monotonic() < deadline, "a place is lost"
            time.sleep(0.02)


# --- the end of the service ---


SENTENCE = b'{"glosses": ["HELLO"], "formats": []}'


def begun_request(client: httpx.Client) -> socket.socket:
    """A request of which the service waits for the body."""
    connection = socket.create_connection((client.base_url.host, client.base_url.port or 0), PATIENCE_S)
    connection.sendall(
        b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        b"Expect: 100-continue\r\nContent-Length: %d\r\n\r\n" % len(SENTENCE)
    )
    assert b" 100 " in connection.recv(65536)
    return connection


def stop(client: httpx.Client, how: signal.Signals) -> psutil.Process:
    """The service of a client, told to stop and listening no more."""
    process = process_of(client)
    process.send_signal(how)
    while True:
        try:
            socket.create_connection((client.base_url.host, client.base_url.port or 0), PATIENCE_S).close()
        except ConnectionRefusedError:
            return process
        time.sleep(0.02)


def wait_for_end(process: psutil.Process) -> None:
    while process.status() != psutil.STATUS_ZOMBIE:
        time.sleep(0.02)


def test_a_stop_tells_streams_and_lets_requests_end() -> None:
    patience = f"--limit=drain_seconds={PATIENCE_S}"
    with (
        http_client("serve", "--workers=1", patience, f"--limit=idle_seconds={PATIENCE_S}") as client,
        begun_request(client) as request,
        stream_client(client) as stream,
    ):
        service = stop(client, signal.SIGINT)
        _, code = messages_and_close_code(stream)
        assert code == 1012
        request.sendall(SENTENCE)
        assert request.makefile("rb").read().startswith(b"HTTP/1.1 200 ")
        wait_for_end(service)


def test_a_request_that_outlasts_the_stop_is_answered_with_json() -> None:
    with http_client("serve", "--workers=1", "--limit=drain_seconds=1") as client, begun_request(client) as request:
        service = stop(client, signal.SIGTERM)
        answer = request.makefile("rb").read()
        assert answer.startswith(b"HTTP/1.1 503 ")
        assert "send it again" in json.loads(answer.partition(b"\r\n\r\n")[2])["error"]
        wait_for_end(service)


# --- worker processes ---


@pytest.fixture(scope="module")
def runner() -> Iterator[asyncio.Runner]:
    with asyncio.Runner() as runner:
        yield runner


@pytest.fixture(scope="module")
def worker(runner: asyncio.Runner) -> Iterator[Worker]:
    async def start() -> Worker:
        worker = Worker(Settings(), is_quick=True)
        await worker.run(os.getpid)
        return worker

    worker = runner.run(start())
    yield worker
    worker.close()


def limited(worker: Worker, **limits: float) -> None:
    """Change the limits of a worker's process; the next process has the default ones."""
    worker._process._settings = Settings(**limits)  # type: ignore[arg-type]


@pytest.mark.skipif(sys.platform != "linux", reason="the time of a process is known on Linux only")
def test_time_in_which_a_job_does_not_work_is_free(runner: asyncio.Runner, worker: Worker) -> None:
    """As on a loaded machine, where a job waits for the processor."""
    limited(worker, work_seconds=0.3)
    pid = runner.run(worker.run(os.getpid))
    runner.run(worker.run(time.sleep, 1.0))
    assert runner.run(worker.run(os.getpid)) == pid


def test_a_worker_that_ends_while_idle_is_replaced_before_the_next_job(runner: asyncio.Runner, worker: Worker) -> None:
    process, n_lost = worker._process, worker.n_lost
    os.kill(process.pid, signal.SIGKILL)
    runner.run(asyncio.wait_for(process.ended.wait(), PATIENCE_S))
    assert worker.n_lost == n_lost + 1
    assert worker._process is not process
    assert runner.run(worker.run(os.getpid)) == worker._process.pid != process.pid


def test_a_job_waits_for_the_next_process_where_one_is_killed_while_it_starts(
    runner: asyncio.Runner, worker: Worker
) -> None:
    async def kill_two() -> int:
        worker._process.kill()
        job = asyncio.create_task(worker.run(os.getpid))
        await asyncio.sleep(0.1)
        starting = worker._process
        assert not starting.is_ready
        os.kill(starting.pid, signal.SIGKILL)
        return await job

    assert runner.run(asyncio.wait_for(kill_two(), PATIENCE_S)) == worker._process.pid


def test_a_job_whose_process_is_killed_fails_at_once(runner: asyncio.Runner, worker: Worker) -> None:
    async def kill() -> None:
        job = asyncio.create_task(worker.run(time.sleep, PATIENCE_S))
        while worker._process._answer is None or worker._process._answer.done():
            await asyncio.sleep(0.01)
        os.kill(worker._process.pid, signal.SIGKILL)
        with pytest.raises(WorkerLostError, match="replaced"):
            await job

    runner.run(worker.run(os.getpid))
    runner.run(asyncio.wait_for(kill(), PATIENCE_S / 2))


def test_a_blocked_job_is_ended(runner: asyncio.Runner, worker: Worker) -> None:
    runner.run(worker.run(os.getpid))  # its start takes longer than the limit below
    limited(worker, work_wall_seconds=0.5)
    n_lost = worker.n_lost
    with pytest.raises(BusyError, match=r"not done after 0\.5 s"):
        runner.run(worker.run(time.sleep, PATIENCE_S))
    assert worker.n_lost == n_lost + 1


PARENT = """
import asyncio, os, time
from signsplice.service.settings import Settings
from signsplice.service.workers import Worker

async def work():
    working, idle = (Worker(Settings(), is_quick=True) for _ in range(2))
    print(await working.run(os.getpid), await idle.run(os.getpid), flush=True)
    await working.run(time.sleep, 300.0)

if __name__ == "__main__":
    asyncio.run(work())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="kills a process with a signal")
def test_a_working_and_an_idle_process_end_with_their_killed_parent(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    with subprocess.Popen([sys.executable, str(tmp_path / "parent.py")], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        workers = [psutil.Process(int(pid)) for pid in parent.stdout.readline().split()]
        parent.kill()
    deadline = time.monotonic() + PATIENCE_S
    for worker in workers:
        while worker.is_running() and worker.status() != psutil.STATUS_ZOMBIE:
            assert time.monotonic() < deadline, "works on without its parent"
            time.sleep(0.02)
