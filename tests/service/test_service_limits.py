"""The service's limits on time, host names and settings, and the processes that do its work."""

from __future__ import annotations

import asyncio
import json
import logging
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from starlette.requests import HTTPConnection
from websockets.exceptions import ConnectionClosed

from serving import PATIENCE_S, FakeSocket, http_client, raw_request, stream_client
from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.service import monitoring
from signsplice.service.app import create, serve
from signsplice.service.limits import Shares, client_of
from signsplice.service.settings import Settings
from signsplice.service.workers import BusyError


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


def test_slow_bodies_are_cut_off(impatient: httpx.Client) -> None:
    head = b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    answer = raw_request(impatient, head + b"Content-Length: 100\r\n\r\n{", pause=0.1)
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


# --- one client among many ---


def caller(address: str) -> HTTPConnection:
    return HTTPConnection({"type": "http", "client": (address, 1)})


def test_a_client_holds_no_more_than_its_share() -> None:
    shares = Shares("streams", 5, 2)
    with ExitStack() as held:
        for _ in range(2):
            held.enter_context(shares.hold(caller("192.0.2.1")))
        with pytest.raises(BusyError, match=r"from 192\.0\.2\.1, expected at most 2"):
            held.enter_context(shares.hold(caller("192.0.2.1")))
        for last in (2, 2, 3):
            held.enter_context(shares.hold(caller(f"192.0.2.{last}")))
        with pytest.raises(BusyError, match="too many streams; try again"):
            held.enter_context(shares.hold(caller("192.0.2.4")))
    assert shares.n_held == 0


@pytest.mark.parametrize(
    ("address", "client"),
    [
        ("192.0.2.1", "192.0.2.1"),
        ("::ffff:192.0.2.1", "192.0.2.1"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::"),
        ("fe80::1%eth0", "fe80::"),
        (None, ""),
    ],
)
def test_a_client_is_an_address_or_a_network(address: str | None, client: str) -> None:
    assert client_of(address) == client


def test_streams_and_requests_beyond_a_clients_share_are_refused() -> None:
    app = create(Settings(max_client_streams=1, max_client_waiting=1))
    service = app.state.service

    async def call() -> tuple[list[Any], int]:
        client = FakeSocket()
        with service.streams.hold(client), service.requests.hold(client):
            await service.stream(client)
            answer = await httpx.AsyncClient(
                transport=httpx.ASGITransport(app, client=("192.0.2.1", 1)), base_url="http://localhost"
            ).post("/v1/sentence", json={"glosses": ["HELLO"]})
        return client.sent, answer.status_code

    sent, status = asyncio.run(call())
    assert "too many streams from 192.0.2.1" in sent[0]["error"]
    assert status == 503


def test_only_a_named_proxy_names_the_client(monkeypatch: pytest.MonkeyPatch) -> None:
    def client_named_by(peer: str, proxies: tuple[str, ...]) -> str:
        configs: list[uvicorn.Config] = []
        monkeypatch.setattr(uvicorn.Server, "run", lambda self, **_: configs.append(self.config))
        serve(Settings(port=0, proxies=proxies))
        config, seen = configs[0], []

        async def app(scope: Any, receive: Any, send: Any) -> None:
            seen.append(scope["client"][0])

        config.app = app
        config.load()
        scope = {"type": "http", "client": (peer, 1), "scheme": "http", "headers": [(b"x-forwarded-for", b"192.0.2.7")]}
        asyncio.run(config.loaded_app(scope, None, None))
        return str(seen[0])

    assert client_named_by("127.0.0.1", ()) == "127.0.0.1"
    assert client_named_by("127.0.0.1", ("192.0.2.9",)) == "127.0.0.1"
    assert client_named_by("192.0.2.9", ("192.0.2.9",)) == "192.0.2.7"


# --- what pages may do ---


def test_answers_say_what_pages_may_do_with_them(service: httpx.Client) -> None:
    for path in ("/healthz", "/no/such/route", "/openapi.json"):
        headers = service.get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["content-security-policy"] == "default-src 'none'; frame-ancestors 'none'"
    docs = service.get("/docs")
    if docs.status_code == 404:
        pytest.skip("the viewer is not built (make viewer)")
    policy = docs.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "'unsafe-inline'" not in policy.partition("script-src")[2].partition(";")[0]
    assert service.get("/").headers["content-security-policy"] == "frame-ancestors 'none'"


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


# --- the command line ---


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--limit", "max_body_bytes=0"], "positive"),
        (["--limit", "no_such=1"], "no limit"),
        (["--limit", "max_files=many"], "expected a whole number"),
        (["--port", "70000"], "0 to 65535"),
        (["--lexicon", "no/such/folder"], "no such folder"),
        (["--proxy", "proxy.example"], "expected an IP address"),
        (["--host", "203.0.113.7"], "cannot listen: host 203.0.113.7 is no address of this machine"),
        (["--host", "256.1.1.1"], "cannot listen: host 256.1.1.1 is no address of this machine"),
        (["--allow-origin", "foo"], "expected scheme://host"),
        (["--allow-origin", "https://signs.example/page"], "expected scheme://host"),
        (["--allow-embed", "signs.example"], "expected http(s)://host"),
        (["--allow-embed", "https://a.example; script-src *"], "expected http(s)://host"),
        (["--allow-embed", "https://a.example", "--allow-embed", "https://*.b.example"], "expected http(s)://host"),
        (["--limit", "worker_bytes=1"], "worker_bytes is 1, expected at least"),
    ],
)
def test_impossible_settings_are_refused(
    arguments: list[str], error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: pytest.fail("the service runs"))
    with pytest.raises(InputError, match=re.escape(error)):
        app(["serve", *arguments], standalone_mode=False)


@pytest.mark.parametrize(("host", "is_open"), [("127.0.0.1", False), ("0.0.0.0", True)])
def test_a_service_that_others_can_reach_warns(
    host: str, is_open: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: None)
    app(["serve", "--host", host, "--port", "0"], standalone_mode=False)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == is_open
    assert all("no accounts and no encryption" in line for line in lines)


def test_clients_that_are_gone_are_logged_in_one_line_a_minute(caplog: pytest.LogCaptureFixture) -> None:
    monitoring.quieten()
    monitoring.quieten()  # again, as a second service in this process does
    uvicorn_logger = logging.getLogger("uvicorn.error")
    try:
        for _ in range(10):
            for error in (ConnectionResetError(), RuntimeError("unable to perform; the handler is closed")):
                uvicorn_logger.error("Exception in ASGI application", exc_info=error)
            uvicorn_logger.error("ASGI callable returned without completing handshake.")
        uvicorn_logger.error("Exception in ASGI application", exc_info=ValueError("a fault of ours"))
        assert [record.getMessage() for record in caplog.records] == [
            "a client hung up before it had its answer",
            "Exception in ASGI application",
        ]
        (limit,) = logging.getLogger("signsplice.service").filters
        limit._passed.clear()  # type: ignore[union-attr]
        monitoring.LOG.warning("a client hung up before it had its answer")
        assert caplog.records[-1].getMessage().endswith("answer (29 more since this was last said)")
    finally:
        for name in ("signsplice.service", "uvicorn.error", "asyncio"):
            logging.getLogger(name).filters.clear()


def test_bad_requests_are_not_logged_but_faults_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: None)
    app(["serve", "--port", "0"], standalone_mode=False)
    try:
        logger = logging.getLogger("uvicorn.error")
        logger.warning("Invalid HTTP request received.")
        assert "Invalid" not in capsys.readouterr().err
        logger.error("Exception in ASGI application")
        assert "Exception in ASGI application" in capsys.readouterr().err
    finally:
        logging.getLogger("uvicorn").handlers.clear()
