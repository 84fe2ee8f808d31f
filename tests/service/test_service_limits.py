"""The service's limits on time, host names and settings, and the processes that do its work."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from websockets.exceptions import ConnectionClosed

from serving import PATIENCE_S, http_client, raw_request, stream_client
from signsplice.cli import app
from signsplice.errors import InputError
from signsplice.service import work
from signsplice.service.metrics import Metrics
from signsplice.service.settings import Settings
from signsplice.service.streaming import StreamSession
from signsplice.service.worker_process import BusyError, WorkerLostError
from signsplice.service.workers import Worker


@pytest.fixture(scope="module")
def impatient(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service that closes slow connections soon. Others than these tests use patient services, since on a
    loaded machine an honest client can be slow too.
    """
    limits = ("head_seconds=2", "idle_seconds=2", "stream_idle_seconds=2")
    call = ("serve", "--workers=1", *(f"--limit={limit}" for limit in limits))
    with http_client(*call, cwd=tmp_path_factory.mktemp("impatient")) as client:
        yield client
        answer = client.post("/v1/sentence?file=bvh", json={"glosses": ["HELLO"]})
        assert answer.text.startswith("HIERARCHY"), "does not serve the next client"


# --- clients ---


def test_slow_requests_are_cut_off(impatient: httpx.Client) -> None:
    head = b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    unfinished_head = (b"GET / HT",)
    slow_head = tuple(bytes([letter]) for letter in head)
    unfinished_body = (head + b"Content-Length: 100\r\n\r\n{",)
    requests = (unfinished_head, slow_head, unfinished_body)
    with ThreadPoolExecutor() as pool:
        for answer in pool.map(lambda parts: raw_request(impatient, *parts, pause=0.1), requests):
            assert b" 408 " in answer.split(b"\r\n")[0]


def test_silent_streams_are_closed(impatient: httpx.Client) -> None:
    with ExitStack() as stack:
        unopened, idle = (stack.enter_context(stream_client(impatient)) for _ in range(2))
        idle.send('{"type": "open"}')
        for socket, error in ((unopened, "within 2 s"), (idle, "nothing came for 2 s")):
            message = json.loads(socket.recv(timeout=PATIENCE_S))
            assert message["type"] == "error"
            assert error in message["error"]
            with pytest.raises(ConnectionClosed):
                socket.recv(timeout=PATIENCE_S)


class FakeSocket:
    """A WebSocket whose client sends one word, then nothing."""

    def __init__(self) -> None:
        texts = ('{"type": "open", "paced": false}', '{"type": "word", "gloss": "HELLO"}')
        self.received = [{"type": "websocket.receive", "text": text} for text in texts]
        self.sent: list[dict[str, Any]] = []

    async def accept(self) -> None: ...

    async def close(self, code: int = 1000) -> None: ...

    async def receive(self) -> dict[str, str]:
        return self.received.pop(0) if self.received else await asyncio.sleep(PATIENCE_S, {})

    async def send_text(self, text: str) -> None:
        self.sent.append(json.loads(text))


class SlowProcess:
    """A worker process that needs longer for a word than a stream may be idle."""

    def __init__(self) -> None:
        self.ended = asyncio.Event()

    async def run(self, job: Callable[..., Any], *args: object) -> Any:
        if job is work.read_token:
            return ["HELLO"], []
        await asyncio.sleep(1.0)
        return [{"type": "skeleton"}]

    def post(self, job: Callable[..., Any], *args: object) -> None: ...


class SlowWorker:
    """The place of such a process."""

    async def begin(self, job: Callable[..., Any], *args: object) -> tuple[SlowProcess, None]:
        return SlowProcess(), None


def test_a_stream_is_not_idle_while_the_service_works() -> None:
    socket = FakeSocket()

    async def stream() -> None:
        metrics = Metrics(lambda: 0, lambda: 0)
        await StreamSession(socket, Settings(stream_idle_seconds=0.3), SlowWorker(), metrics).run()  # type: ignore[arg-type]

    asyncio.run(stream())
    assert [message["type"] for message in socket.sent] == ["skeleton", "error"]
    assert "nothing came for 0.3 s" in socket.sent[1]["error"]


@pytest.mark.parametrize(
    ("host", "allowed", "asked", "answers"),
    [
        ("127.0.0.1", (), "evil.example", False),
        ("127.0.0.1", (), "[::1]", True),
        ("127.0.0.1", ("signs.example",), "Signs.Example", True),
        ("0.0.0.0", (), "evil.example", False),
        ("0.0.0.0", (), "192.0.2.1", True),
        ("0.0.0.0", ("signs.example",), "signs.example", True),
        ("0.0.0.0", ("*",), "evil.example", True),
    ],
)
def test_only_allowed_host_names_are_answered(host: str, allowed: tuple[str, ...], asked: str, answers: bool) -> None:
    assert Settings(host=host, allowed_hosts=allowed).answers_to(asked) is answers


# --- worker processes ---


@pytest.fixture(scope="module")
def runner() -> Iterator[asyncio.Runner]:
    with asyncio.Runner() as runner:
        yield runner


@pytest.fixture(scope="module")
def worker(runner: asyncio.Runner) -> Iterator[Worker]:
    async def start() -> Worker:
        worker = Worker(Settings(), skin=False)
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


# --- the command line ---


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--limit", "max_body_bytes=0"], "positive"),
        (["--limit", "no_such=1"], "no limit"),
        (["--limit", "max_files=many"], "expected a whole number"),
        (["--port", "70000"], "0 to 65535"),
        (["--lexicon", "no/such/folder"], "no such folder"),
        (["--host", "203.0.113.7"], "cannot listen"),
    ],
)
def test_impossible_settings_are_refused(
    arguments: list[str], error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: pytest.fail("the service runs"))
    with pytest.raises(InputError, match=re.escape(error)):
        app(["serve", *arguments], standalone_mode=False)
