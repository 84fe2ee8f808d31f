"""Turns of clients at workers: who is next, what work counts, and what becomes of the jobs of clients who are gone."""

from __future__ import annotations

import asyncio
import json
import re
import socket
import time
from collections.abc import Coroutine, Sequence
from typing import Any

import httpx
import pytest
from starlette.requests import ClientDisconnect, Request

from broken_bvh import VALID
from serving import PATIENCE_S
from signsplice.errors import InputError
from signsplice.service import work
from signsplice.service.app import create
from signsplice.service.fair_queue import FairQueue
from signsplice.service.limits import while_connected
from signsplice.service.settings import Settings
from signsplice.service.wire import SentenceRequest


class FakePlace:
    """A place that works when the test tells it to.

    log: client and name of each job, in the order in which they began.
    """

    def __init__(self, log: list[str]) -> None:
        self.log, self.spent, self.is_ready, self.n_abandoned = log, 0.0, True, 0
        self.running: asyncio.Future[float] | None = None
        self.recovered = asyncio.Event()
        self.recovered.set()

    async def job(self, name: str) -> str:
        self.log.append(name)
        self.running = asyncio.get_running_loop().create_future()
        self.spent += await self.running
        return name

    async def work(self, seconds: float) -> None:
        """Let the running job end after so much work."""
        await pause()
        assert self.running is not None
        self.running.set_result(seconds)
        await pause()

    def abandon(self) -> None:
        self.n_abandoned += 1

    async def recover(self) -> None:
        await self.recovered.wait()


async def pause() -> None:
    for _ in range(6):
        await asyncio.sleep(0)


class Scene:
    """A queue for some places, and clients who send jobs."""

    def __init__(self, n_places: int = 1, is_shared: bool = False) -> None:
        self.log: list[str] = []
        self.places = [FakePlace(self.log) for _ in range(n_places)]
        self.queue: Any = FairQueue(self.places if is_shared else ())  # type: ignore[arg-type]

    def send(
        self, client: str, name: str = "", seconds: float = 1.0, places: Sequence[FakePlace] = ()
    ) -> asyncio.Task[str]:
        name = f"{client}{name}"
        return asyncio.create_task(
            self.queue.run(client, places or self.places, seconds, lambda place: place.job(name))
        )


def run(test: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(test, PATIENCE_S))


def test_the_client_that_has_had_the_least_work_is_next() -> None:
    async def test() -> None:
        scene = Scene()
        (place,) = scene.places
        jobs = [scene.send("a", str(k)) for k in range(4)]
        await pause()
        jobs += [scene.send("b", str(k)) for k in range(3)]
        for seconds in (10.0, 1.0, 1.0, 10.0, 5.0, 5.0, 5.0):
            await place.work(seconds)
        assert scene.log == ["a0", "b0", "b1", "b2", "a1", "a2", "a3"]
        assert await asyncio.gather(*jobs) == ["a0", "a1", "a2", "a3", "b0", "b1", "b2"]

    run(test())


def test_work_counts_as_done_not_as_expected() -> None:
    async def test() -> None:
        scene = Scene()
        (place,) = scene.places
        for client, seconds in (("a", 100.0), ("a", 100.0), ("b", 0.1), ("b", 0.1)):
            scene.send(client, seconds=seconds)
        for seconds in (1.0, 50.0, 1.0, 1.0):
            await place.work(seconds)
        assert scene.log == ["a", "b", "a", "b"]

    run(test())


def test_what_a_client_runs_counts_while_it_runs() -> None:
    async def test() -> None:
        scene = Scene(2)
        for client in ("a", "a", "b"):
            scene.send(client, seconds=9.0)
        await pause()
        assert scene.log == ["a", "a"]  # there was nobody else yet
        await scene.places[0].work(1.0)
        assert scene.log == ["a", "a", "b"]

        scene = Scene(2)
        scene.send("c")
        await pause()
        await scene.places[0].work(0.0)
        waiting = [scene.send(client, seconds=9.0) for client in ("a", "b", "a")]
        await pause()
        assert scene.log == ["c", "a", "b"]
        assert [job.done() for job in waiting] == [False] * 3

    run(test())


def test_idle_time_earns_no_credit() -> None:
    """Nor is a client whose work is forgotten put behind."""

    async def test() -> None:
        scene = Scene()
        (place,) = scene.places
        scene.send("b", "0")
        await pause()
        for k in range(3):
            scene.send("a", str(k))
        for _ in range(2):
            await place.work(10.0)
        # b had 10 s less than a, but was away: it starts level with a, and one job later it is a's turn
        for k in (1, 2):
            scene.send("b", str(k))
        for seconds in (10.0, 11.0, 10.0, 1.0):
            await place.work(seconds)
        assert scene.log == ["b0", "a0", "a1", "b1", "a2", "b2"]

    run(test())


def test_all_clients_start_anew_when_there_is_nothing_to_do() -> None:
    async def test() -> None:
        scene = Scene()
        (place,) = scene.places
        scene.send("a")
        await place.work(100.0)
        scene.send("c")  # holds the place
        await pause()
        scene.send("a")
        await pause()
        scene.send("b")
        for _ in range(3):
            await place.work(1.0)
        assert scene.log == ["a", "c", "a", "b"]

    run(test())


def test_a_busy_client_is_not_starved_by_one_that_sends_without_end() -> None:
    async def test() -> None:
        scene = Scene()
        (place,) = scene.places
        scene.send("a", "0")
        await pause()
        scene.send("a", "1")
        for k in range(12):
            scene.send("b", str(k))
        await place.work(5.0)
        for _ in range(7):
            await place.work(1.0)
        assert scene.log.index("a1") <= 7

    run(test())


def test_a_job_waits_for_its_own_place_and_lets_others_pass() -> None:
    async def test() -> None:
        scene = Scene(2)
        first, second = scene.places
        scene.send("a", "0", places=[first])
        await pause()
        scene.send("a", "1", places=[first])
        scene.send("b", "0", places=[second])
        await pause()
        assert scene.log == ["a0", "b0"]
        await first.work(1.0)
        assert scene.log == ["a0", "b0", "a1"]

    run(test())


def test_a_ready_place_is_taken_before_one_that_starts() -> None:
    async def test() -> None:
        scene = Scene(2)
        scene.places[0].is_ready = False
        scene.send("a")
        await pause()
        assert scene.places[1].running is not None
        assert scene.places[0].running is None

    run(test())


def test_one_client_does_not_have_all_shared_places() -> None:
    async def test() -> None:
        scene = Scene(3, is_shared=True)
        for k in range(5):
            scene.send("a", str(k))
        await pause()
        assert scene.log == ["a0", "a1"]
        scene.send("b")
        await pause()
        assert scene.log == ["a0", "a1", "b"]
        await scene.places[0].work(1.0)
        assert scene.log[3:] == ["a2"]

    run(test())


def test_a_single_shared_place_is_used() -> None:
    async def test() -> None:
        scene = Scene(1, is_shared=True)
        scene.send("a")
        await pause()
        assert scene.log == ["a"]

    run(test())


def test_waiting_jobs_of_clients_who_are_gone_are_removed() -> None:
    async def test() -> None:
        scene = Scene()
        (place,) = scene.places
        scene.send("a")
        await pause()
        gone = scene.send("b")
        await pause()
        assert scene.queue.wait_seconds > 0.0
        gone.cancel()
        await pause()
        assert scene.queue.wait_seconds == 0.0
        scene.send("c")
        await place.work(1.0)
        assert scene.log == ["a", "c"]

    run(test())


def test_a_job_that_is_granted_and_cancelled_at_once_gives_its_place_back() -> None:
    async def test() -> None:
        scene = Scene()
        (place,) = scene.places
        running = scene.send("a")
        gone = scene.send("b")
        await pause()
        assert place.running is not None
        place.running.set_result(1.0)
        while not running.done():
            await asyncio.sleep(0)
        for n_passes in range(4):  # whenever the grant comes
            scene.send("c", str(n_passes))
            gone.cancel()
            await asyncio.sleep(0)
        await place.work(1.0)
        assert "c0" in scene.log

    run(test())


def test_a_running_job_of_a_gone_client_is_abandoned_and_its_restart_charged() -> None:
    async def test() -> None:
        scene = Scene()
        (place,) = scene.places
        gone = scene.send("a", "0")
        await pause()
        waiting = [scene.send(client, name) for client, name in (("a", "1"), ("b", "0"), ("b", "1"), ("b", "2"))]
        await pause()
        gone.cancel()
        place.recovered.clear()
        await pause()
        assert place.n_abandoned == 1
        await place.work(1.0)  # its process is killed
        assert scene.log == ["a0"]  # and the next one starts
        place.spent += 2.5
        place.recovered.set()
        for seconds in (1.0, 1.0, 1.0, 1.0):
            await place.work(seconds)
        assert scene.log == ["a0", "b0", "b1", "b2", "a1"]
        await asyncio.gather(*waiting)

    run(test())


def test_a_failed_job_raises_and_frees_its_place() -> None:
    async def fail(place: FakePlace) -> None:
        raise ValueError("broken")

    async def test() -> None:
        scene = Scene()
        with pytest.raises(ValueError, match="broken"):
            await scene.queue.run("a", scene.places, 1.0, fail)
        scene.send("b")
        await pause()
        assert scene.log == ["b"]

    run(test())


# --- gone clients ---


def test_a_job_is_cancelled_once_its_client_has_hung_up() -> None:
    has_hung_up, cancelled = asyncio.Event(), []

    async def receive() -> dict[str, Any]:
        await has_hung_up.wait()
        return {"type": "http.disconnect"}

    connection = Request({"type": "http"}, receive)

    async def job() -> None:
        try:
            await asyncio.sleep(PATIENCE_S)
        except asyncio.CancelledError:
            cancelled.append(True)
            raise

    async def test() -> None:
        asyncio.get_running_loop().call_later(0.05, has_hung_up.set)
        with pytest.raises(ClientDisconnect):
            await while_connected(connection, job())
        await asyncio.sleep(0)
        assert cancelled == [True]

    run(test())


def test_a_request_of_a_gone_client_leaves_nothing_in_the_queue() -> None:
    app = create(Settings())
    service = app.state.service
    log: list[str] = []

    async def test() -> None:
        service.quick_workers.append(place := FakePlace(log))
        other = asyncio.create_task(service.queue.run("192.0.2.9", [place], 1.0, lambda place: place.job("other")))
        await pause()
        transport = httpx.ASGITransport(GoneApp(app), client=("192.0.2.1", 1))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            answer = await client.post("/v1/sentence", json={"glosses": ["HELLO"]})
        await pause()
        assert answer.status_code == 499
        assert service.requests.n_held == 0
        assert service.queue.wait_seconds == 0.0
        await place.work(1.0)
        await other

    run(test())
    assert log == ["other"]


class GoneApp:
    """An application whose client has hung up."""

    def __init__(self, app: Any) -> None:
        self._app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        has_body = False

        async def receive_body() -> Any:
            nonlocal has_body
            if has_body:
                return {"type": "http.disconnect"}
            message = await receive()
            has_body = not message.get("more_body", False)
            return message

        await self._app(scope, receive_body, send)


def post(glosses: Sequence[str], file: str) -> bytes:
    body = json.dumps({"glosses": list(glosses)}).encode()
    head = f"POST /v1/sentence?file={file} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return head.encode() + b"Content-Length: %d\r\n\r\n" % len(body) + body


def metric(client: httpx.Client, name: str) -> float:
    match = re.search(rf"^{name} (\S+)", client.get("/metrics").text, re.MULTILINE)
    assert match is not None
    return float(match[1])


def test_films_keep_nobody_waiting_and_end_with_their_connection(service: httpx.Client) -> None:
    sheet = service.post("/v1/sentence?file=png", json={"glosses": ["HELLO"]})  # the worker for films is ready
    assert sheet.status_code == 200
    n_lost = metric(service, "signsplice_workers_lost")
    address = (service.base_url.host, service.base_url.port or 0)
    with socket.create_connection(address, PATIENCE_S) as film:
        film.sendall(post(["HELLO", "DEAF"] * 80, "gif"))
        while service.get("/healthz").json()["waiting"] == 0:
            time.sleep(0.02)
        for _ in range(2):  # the film's first job, which tells how long it takes, is before the second
            assert service.post("/v1/sentence?file=bvh", json={"glosses": ["HELLO"]}).status_code == 200
        assert service.get("/healthz").json()["waiting"] == 1
    deadline = time.monotonic() + PATIENCE_S
    while service.get("/healthz").json()["waiting"] or metric(service, "signsplice_workers_lost") == n_lost:
        assert time.monotonic() < deadline, "works on for a client who is gone"
        time.sleep(0.02)
    assert metric(service, "signsplice_workers_lost") == n_lost + 1
    assert metric(service, "signsplice_wait_seconds") == 0.0


# --- what fits ---


@pytest.fixture(scope="module")
def state() -> work._WorkerState:
    return work._WorkerState(Settings(work_seconds=6.0))


def answered(
    state: work._WorkerState, monkeypatch: pytest.MonkeyPatch, glosses: list[str], file: Any = "bvh", **dials: Any
) -> work.Answer | float:
    monkeypatch.setattr(work, "_worker", state, raising=False)
    return work.splice_if_quick(SentenceRequest(glosses=glosses, **dials), file)


@pytest.mark.parametrize("file", ["bvh", None])
def test_a_short_sentence_is_answered_by_a_quick_worker(
    state: work._WorkerState, monkeypatch: pytest.MonkeyPatch, file: str | None
) -> None:
    assert isinstance(answered(state, monkeypatch, ["HELLO", "DEAF"], file), work.Answer)


@pytest.mark.parametrize(
    ("glosses", "file", "dials"),
    [
        (["HELLO"], "gif", {}),
        (["HELLO"], "png", {}),
        (["HELLO", "DEAF"], "png", {}),
        (["HELLO"] * 100, "bvh", {}),
        (["1-GIVE-2"], "bvh", {}),
        (["HELLO"] * 8, "bvh", {"system": "lpt-plus"}),
        (["HELLO"] * 3, "bvh", {"avatar": "Ann"}),
    ],
)
def test_what_takes_long_is_for_a_long_worker(
    state: work._WorkerState, monkeypatch: pytest.MonkeyPatch, glosses: list[str], file: str, dials: dict[str, Any]
) -> None:
    expected = answered(state, monkeypatch, glosses, file, **dials)
    assert isinstance(expected, float)
    assert 0.0 < expected < 6.0


@pytest.mark.parametrize(
    ("glosses", "file", "speed"),
    [(["HELLO"] * 100, "gif", 1.0), (["DEAF"] * 60, "png", 1.0), (["fs-A"] * 60, "gif", 0.3)],
)
def test_what_cannot_fit_its_time_is_refused_with_the_size_that_fits(
    state: work._WorkerState, monkeypatch: pytest.MonkeyPatch, glosses: list[str], file: str, speed: float
) -> None:
    with pytest.raises(InputError, match=f"{len(glosses)} words as {file} take about .* at most 6 s") as caught:
        answered(state, monkeypatch, glosses, file, sign_speed=speed)
    match = re.search(r"about (\d+) words at a time", str(caught.value))
    assert match is not None
    n_fitting = int(match[1])
    assert isinstance(answered(state, monkeypatch, glosses[:n_fitting], file, sign_speed=speed), float)
    with pytest.raises(InputError, match="words at a time"):
        answered(state, monkeypatch, glosses[: n_fitting + 2], file, sign_speed=speed)


# --- names of files ---


def test_a_name_that_is_not_ascii_is_sent_whole_beside_one_that_is(service: httpx.Client) -> None:
    answer = service.post("/v1/splice?file=bvh", files={"files": ("größe ü.bvh", VALID)})
    assert answer.status_code == 200
    disposition = answer.headers["content-disposition"]
    assert disposition == "attachment; filename=\"gr__e-_.bvh\"; filename*=UTF-8''gr%C3%B6%C3%9Fe-%C3%BC.bvh"
