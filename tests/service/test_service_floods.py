"""What a client may send outside of bodies and messages, and answers that it does not read."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from contextlib import suppress

import httpx
import pytest
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from serving import PATIENCE_S, raw_request, stream_client
from signsplice.service.limits import HEADERS, Limits
from signsplice.service.settings import Settings

LIMIT = Settings().max_head_bytes
GET = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n"
CHUNKED = (
    b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    b"Transfer-Encoding: chunked\r\n\r\n"
)
UPGRADE = (
    b"GET /v1/stream HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
)


def error_of(answer: bytes, status: int) -> str:
    """The message of an error that came over a bare socket, which has to be JSON."""
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(f"HTTP/1.1 {status} ".encode()), answer[:300]
    headers = dict(line.split(": ", 1) for line in head.decode().lower().split("\r\n")[1:])
    assert headers["content-type"] == "application/json"
    assert {name: headers[name.lower()] for name in HEADERS} == HEADERS
    failure = json.loads(body)
    assert set(failure) == {"error", "unknown"}
    return str(failure["error"])


def padded(head: bytes, unit: bytes, n_bytes: int) -> bytes:
    """A head and as many bytes of ``unit`` as make ``n_bytes``."""
    n_missing = n_bytes - len(head)
    return head + (unit * (n_missing // len(unit) + 1))[:n_missing]


# --- what is too long ---

TOO_LONG = {
    "a header value": padded(GET + b"X: ", b"a", LIMIT + 1),
    "a URL": padded(b"GET /", b"a", LIMIT + 1),
    "a trailer": CHUNKED + padded(b"2\r\n{}\r\n0\r\nX: ", b"a", LIMIT + 20),
    "a chunk extension": CHUNKED + padded(b"2;", b"a", LIMIT + 1),
}


@pytest.mark.parametrize("name", TOO_LONG)
def test_a_request_with_too_much_besides_its_body_is_refused(service: httpx.Client, name: str) -> None:
    assert raw_request(service, TOO_LONG[name]).startswith(b"HTTP/1.1 400 ")


def test_a_body_in_ordinary_chunks_is_read(service: httpx.Client) -> None:
    def parts() -> Iterator[bytes]:
        yield b'{"glosses": ["HELLO"], "formats": []}'
        for _ in range(400):
            yield b" " * 600

    answer = service.post("/v1/sentence", content=parts(), headers={"content-type": "application/json"})
    assert answer.status_code == 200


def test_what_is_no_http_is_refused(service: httpx.Client) -> None:
    twice = GET + b"Content-Length: 1\r\nContent-Length: 2\r\n\r\n"
    for request in (b"no HTTP\r\n\r\n", twice, GET + b"Host: localhost\r\n\r\n"):
        assert raw_request(service, request).startswith(b"HTTP/1.1 400 ")


def test_handshakes_that_cannot_be_accepted_are_refused(service: httpx.Client) -> None:
    without_key = UPGRADE[: UPGRADE.index(b"Sec-WebSocket-Key")]
    for handshake, status in (
        (without_key, 400),
        (UPGRADE.replace(b"Version: 13", b"Version: 12"), 400),
        (UPGRADE.replace(b"/v1/stream", b"/v1/other"), 403),
    ):
        assert raw_request(service, handshake + b"\r\n").startswith(b"HTTP/1.1 %d " % status)
    foreign = raw_request(service, UPGRADE.replace(b"localhost", b"evil.example") + b"\r\n")
    assert "'evil.example'" in error_of(foreign, 421)


def test_a_client_may_ping(service: httpx.Client) -> None:
    with stream_client(service) as stream:
        pongs = [stream.ping(str(k)) for k in range(20)]
        assert all(pong.wait(PATIENCE_S) for pong in pongs)


# --- answers that are not read ---


async def ask(settings: Settings, app: ASGIApp, seconds_a_piece: float, n: int = 1) -> list[list[Message]]:
    """Asks so often at once for an answer of ten pieces, each of which is read in that time; what was sent of each."""
    limits, scope = Limits(app, settings), {
        "type": "http", "method": "GET", "path": "/", "headers": [(b"host", b"localhost")], "client": ("192.0.2.1", 1)
    }  # fmt: skip

    async def call() -> list[Message]:
        sent: list[Message] = []

        async def send(message: Message) -> None:
            await asyncio.sleep(seconds_a_piece if message.get("body") else 0.0)
            sent.append(message)

        with suppress(ClientDisconnect):
            await limits(scope, receive_nothing, send)
        return sent

    calls = []
    for _ in range(n):
        calls.append(asyncio.create_task(call()))
        await asyncio.sleep(0.01)
    return await asyncio.gather(*calls)


async def receive_nothing() -> Message:
    return {"type": "http.request", "body": b"", "more_body": False}


async def answer_long(scope: Scope, receive: Receive, send: Send) -> None:
    await Response(bytes(range(256)) * 256 * 10)(scope, receive, send)


@pytest.mark.parametrize(("idle", "whole"), [(0.05, 9.0), (9.0, 0.3)], ids=["a piece", "the whole"])
def test_an_answer_that_is_read_too_slowly_is_given_up(idle: float, whole: float) -> None:
    settings = Settings(idle_seconds=idle, body_seconds=whole)
    (sent,) = asyncio.run(ask(settings, answer_long, 0.1))
    assert len(sent) < 11
    assert sent[-1].get("more_body", True)


def test_a_long_answer_is_sent_whole() -> None:
    (sent,) = asyncio.run(ask(Settings(), answer_long, 0.0))
    assert b"".join(message.get("body", b"") for message in sent) == bytes(range(256)) * 256 * 10
    assert not sent[-1]["more_body"]


def test_unread_answers_count_against_a_clients_share() -> None:
    statuses = [sent[0]["status"] for sent in asyncio.run(ask(Settings(max_client_waiting=2), answer_long, 0.05, 3))]
    assert statuses == [200, 200, 503]
