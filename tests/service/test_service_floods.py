"""What a client may send outside of bodies and messages: heads, trailers, framing, control frames, connections."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest
from websockets.frames import Frame, Opcode
from websockets.sync.client import ClientConnection

from connections import CHUNKED, GET, LIMIT, UPGRADE, Connections, FakeTransport, error_of, padded
from serving import PATIENCE_S, messages_and_close_code, raw_request, stream_client

# --- what is too long ---

# Each is one byte longer than allowed, so that the service has read all of it when it answers.
TOO_LONG = {
    "a header value": padded(GET + b"X: ", b"a", LIMIT + 1),
    "a URL": padded(b"GET /", b"a", LIMIT + 1),
    "a trailer": padded(CHUNKED + b"2\r\n{}\r\n0\r\nX: ", b"a", LIMIT + 3),
    "a chunk extension": padded(CHUNKED + b"2;", b"a", LIMIT + 1),
    "chunks of one byte": CHUNKED + b"1\r\n \r\n" * ((LIMIT - len(CHUNKED)) // 5 + 1),
}


@pytest.mark.parametrize("name", TOO_LONG)
def test_a_request_with_too_much_besides_its_body_is_refused(service: httpx.Client, name: str) -> None:
    assert f"longer than {LIMIT} bytes" in error_of(raw_request(service, TOO_LONG[name]), 431)


@pytest.mark.parametrize("start", [GET, CHUNKED + b"0\r\n"], ids=["head", "trailer"])
def test_a_request_with_too_many_fields_is_refused(service: httpx.Client, start: bytes) -> None:
    assert "100 header fields" in error_of(raw_request(service, start + b"X: a\r\n" * 102), 431)


def test_a_body_in_ordinary_chunks_is_read(service: httpx.Client) -> None:
    def parts() -> Iterator[bytes]:
        yield b'{"glosses": ["HELLO"], "formats": []}'
        for _ in range(400):
            yield b" " * 600

    answer = service.post("/v1/sentence", content=parts(), headers={"content-type": "application/json"})
    assert answer.status_code == 200


def test_requests_without_end_on_one_connection_are_refused(service: httpx.Client) -> None:
    assert "before the first answer" in error_of(raw_request(service, (GET + b"\r\n") * 18), 429)


def test_what_is_no_http_is_refused_with_json(service: httpx.Client) -> None:
    twice = GET + b"Content-Length: 1\r\nContent-Length: 2\r\n\r\n"
    for request in (b"no HTTP\r\n\r\n", twice):
        assert "HTTP/1.1" in error_of(raw_request(service, request), 400)


def test_two_host_headers_are_refused(service: httpx.Client) -> None:
    assert "two Host headers" in error_of(raw_request(service, GET + b"Host: localhost\r\n\r\n"), 400)


def test_handshakes_that_cannot_be_accepted_are_refused_with_json(service: httpx.Client) -> None:
    without_key = UPGRADE[: UPGRADE.index(b"Sec-WebSocket-Key")]
    error_of(raw_request(service, without_key + b"\r\n"), 400)
    error_of(raw_request(service, UPGRADE.replace(b"Version: 13", b"Version: 12") + b"\r\n"), 400)
    error_of(raw_request(service, UPGRADE + b"X: " + b"a" * 10_000 + b"\r\n\r\n"), 431)
    error_of(raw_request(service, UPGRADE.replace(b"/v1/stream", b"/v1/other") + b"\r\n"), 403)
    assert "'evil.example'" in error_of(
        raw_request(service, UPGRADE.replace(b"localhost", b"evil.example") + b"\r\n"), 421
    )


# --- control frames ---


def send_pings(stream: ClientConnection) -> None:
    with stream.send_context():
        for k in range(101):
            stream.protocol.send_ping(str(k).encode())


def send_fragments(stream: ClientConnection) -> None:
    with stream.send_context():
        stream.protocol.send_frame(Frame(Opcode.TEXT, b"", fin=False))
        for _ in range(101):
            stream.protocol.send_frame(Frame(Opcode.CONT, b"", fin=False))


@pytest.mark.parametrize("flood", [send_pings, send_fragments])
def test_too_many_frames_without_a_message_close_the_stream(
    service: httpx.Client, flood: Callable[[ClientConnection], None]
) -> None:
    with stream_client(service) as stream:
        flood(stream)
        messages, code = messages_and_close_code(stream)
    assert "too many pings" in messages[-1]["error"]
    assert code == 1008


def test_a_client_may_ping(service: httpx.Client) -> None:
    with stream_client(service) as stream:
        pongs = [stream.ping(str(k)) for k in range(20)]
        assert all(pong.wait(PATIENCE_S) for pong in pongs)


# --- the protocols by themselves ---


def test_a_trailer_does_not_change_the_head_that_was_checked() -> None:
    heads = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        while (await receive())["more_body"]:
            pass
        heads.append(dict(scope["headers"]))

    async def send() -> None:
        protocol, _ = Connections(app).open()
        protocol.data_received(CHUNKED + b"2\r\n{}\r\n0\r\n")
        await asyncio.sleep(0)
        protocol.data_received(b"Origin: http://localhost\r\n\r\n")
        for _ in range(5):
            await asyncio.sleep(0)

    asyncio.run(send())
    assert set(heads[0]) == {b"host", b"content-type", b"transfer-encoding"}


@pytest.mark.parametrize(
    "parts",
    [(GET,), (GET + b"\r\n", b"\r\n"), (CHUNKED, b"0\r\n"), (GET + b"Transfer-Encoding: chunked\r\n\r\n", b"0\r\nX")],
    ids=["head", "behind a request", "trailer", "trailer behind a request"],
)
def test_a_clock_runs_until_a_request_is_complete(parts: tuple[bytes, ...]) -> None:
    """Also where the application has answered, or does not read."""

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"0")]})
        await send({"type": "http.response.body"})

    async def send() -> FakeTransport:
        protocol, transport = Connections(app, head_seconds=0.05, body_seconds=0.05).open()
        for part in parts:
            protocol.data_received(part)
            await asyncio.sleep(0.01)
        while not transport.is_closed:
            await asyncio.sleep(0.01)
        return transport

    assert asyncio.run(asyncio.wait_for(send(), 3.0)).written.startswith(b"HTTP/1.1 ")


def test_other_connections_have_their_turn_while_messages_are_parsed() -> None:
    """And no more is read meanwhile, also where the application reads its messages."""

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        for _ in range(2000):
            await receive()
        await asyncio.sleep(PATIENCE_S)

    async def send() -> tuple[int, list[bool]]:
        protocol, transport = Connections(app).open_websocket()
        await asyncio.sleep(0)
        message = Frame(Opcode.TEXT, b"{}").serialize(mask=True)
        protocol.data_received(message * 30_000)
        n_parsed, paused = protocol.queue.qsize(), []
        for _ in range(100):
            paused.append(transport.is_paused)
            await asyncio.sleep(0)
        return n_parsed, paused

    n_parsed, paused = asyncio.run(send())
    assert 0 < n_parsed < 600
    assert all(paused)


def test_messages_parsed_in_steps_are_whole() -> None:
    received: list[str] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        while len(received) < 300:
            received.append((await receive())["text"])

    texts = [str(k) * (k % 90) for k in range(300)]

    async def send() -> None:
        protocol, _ = Connections(app).open_websocket()
        await asyncio.sleep(0)
        protocol.data_received(b"".join(Frame(Opcode.TEXT, text.encode()).serialize(mask=True) for text in texts))
        while len(received) < 300:
            await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(send(), PATIENCE_S))
    assert received == texts


def test_one_address_cannot_hold_all_connections() -> None:
    async def connect() -> list[bool]:
        connections = Connections(max_connections=5, max_client_connections=2, proxies=("192.0.2.9",))
        addresses = ["192.0.2.1"] * 3 + ["192.0.2.9"] * 3
        return [connections.open(address)[1].is_closed for address in addresses]

    assert asyncio.run(connect()) == [False, False, True, False, False, True]


async def answer_at_once(scope: Any, receive: Any, send: Any) -> None:
    """An application that answers without a body."""
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"0")]})
    await send({"type": "http.response.body"})


async def answered(connections: Connections, n_unread: int) -> tuple[Any, FakeTransport]:
    """A connection with an answer, of which so much is not read."""
    protocol, transport = connections.open()
    transport.n_unread = n_unread
    protocol.data_received(GET + b"\r\n")
    while not transport.written:
        await asyncio.sleep(0)
    return protocol, transport


def test_unread_answers_count_against_a_clients_share() -> None:
    async def ask() -> list[bytes]:
        connections = Connections(answer_at_once, max_client_waiting=2, proxies=("192.0.2.9",))
        for _ in range(2):
            await answered(connections, 1000)
        _, refused = await answered(connections, 0)
        others = []
        for address in ("192.0.2.7", "192.0.2.9"):
            protocol, transport = connections.open(address)
            protocol.data_received(GET + b"\r\n")
            await asyncio.sleep(0.01)
            others.append(transport.written)
        return [refused.written, *others]

    refused, other, proxy = asyncio.run(ask())
    assert "has not read" in error_of(refused, 503)
    assert other.startswith(b"HTTP/1.1 200")
    assert proxy.startswith(b"HTTP/1.1 200")


def test_a_closed_connection_whose_client_does_not_read_holds_no_place() -> None:
    async def connect() -> bool:
        connections = Connections(max_connections=1)
        _, lingering = connections.open()
        lingering.close()
        connections.open()
        return lingering.is_aborted

    assert asyncio.run(connect())
