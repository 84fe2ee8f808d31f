"""The limit of a request's head, its trailer and the framing of its chunks, where one read brings all of it."""

from __future__ import annotations

import asyncio
from collections import Counter

import pytest

from connections import CHUNKED, GET, LIMIT, UPGRADE, Connections, error_of, padded
from signsplice.service.protocols import LimitedHttpProtocol
from signsplice.service.settings import Settings

# Each is complete, and comes in one read.
COMPLETE = {
    "two bytes too many": padded(GET + b"X: ", b"a", LIMIT - 2) + b"\r\n\r\n",
    "a header of 70,000 bytes": GET + b"X: " + b"a" * 70_000 + b"\r\n\r\n",
    "a header of 120,000 bytes": GET + b"X: " + b"a" * 120_000 + b"\r\n\r\n",
    "a URL of 66,000 bytes": GET.replace(b"/healthz", b"/" + b"a" * 66_000) + b"\r\n",
    "a trailer of 70,000 bytes": CHUNKED + b"2\r\n{}\r\n0\r\nX: " + b"a" * 70_000 + b"\r\n\r\n",
    "a chunk extension of 70,000 bytes": CHUNKED + b"2;" + b"a" * 70_000 + b"\r\n{}\r\n0\r\n\r\n",
    "a handshake of 70,000 bytes": UPGRADE + b"X: " + b"a" * 70_000 + b"\r\n\r\n",
    "a header of 90,000 bytes behind a request": GET + b"\r\n" + GET + b"X: " + b"a" * 90_000 + b"\r\n\r\n",
}


def written_at_once(data: bytes, connections: Connections | None = None) -> bytes:
    """What a service without an application writes when data comes in one read."""

    async def send() -> bytes:
        protocol, transport = (connections or Connections()).open()
        protocol.data_received(data)
        return transport.written

    return asyncio.run(send())


@pytest.mark.parametrize("name", COMPLETE)
def test_the_limit_holds_for_a_request_that_comes_in_one_read(name: str) -> None:
    assert f"longer than {LIMIT} bytes" in error_of(written_at_once(COMPLETE[name]), 431)


def test_what_is_as_long_as_the_limit_is_read() -> None:
    body = b" " * 200_000
    post = GET.replace(b"GET", b"POST") + f"Content-Length: {len(body)}\r\nX: ".encode()
    longest = padded(post, b"a", LIMIT - 4) + b"\r\n\r\n"
    assert len(longest) == LIMIT
    assert written_at_once(longest + body) == b""
    assert written_at_once((post + b"\r\n\r\n" + body) * 3 + longest + body) == b""


def test_a_body_behind_the_longest_head_is_parsed_in_large_pieces() -> None:
    n_pieces = 0

    class Counting(LimitedHttpProtocol):
        settings, n_unread = Settings(), Counter()

        def on_body(self, body: bytes) -> None:
            nonlocal n_pieces
            n_pieces += 1
            super().on_body(body)

    connections = Connections()
    connections.http = Counting
    post = GET.replace(b"GET", b"POST") + b"Content-Length: 200000\r\nX: "
    written_at_once(padded(post, b"a", LIMIT - 4) + b"\r\n\r\n" + b" " * 200_000, connections)
    assert 0 < n_pieces < 100
