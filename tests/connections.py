"""Requests as bytes, and connections of a server that has no socket."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import uvicorn
from uvicorn.server import ServerState

from serving import PATIENCE_S
from signsplice.service.limits import HEADERS
from signsplice.service.protocols import LimitedHttpProtocol, LimitedWebSocketProtocol, protocols
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


class FakeTransport(asyncio.Transport):
    """A connection from an address, without a socket."""

    def __init__(self, address: str = "192.0.2.1") -> None:
        super().__init__({"peername": (address, 1), "sockname": ("127.0.0.1", 8000)})
        self.written, self.is_closed, self.is_aborted, self.is_paused = b"", False, False, False
        self.n_unread = 0

    def get_write_buffer_size(self) -> int:
        return self.n_unread

    def write(self, data: Any) -> None:
        self.written += data

    def close(self) -> None:
        self.is_closed = True

    def abort(self) -> None:
        self.is_aborted = True

    def is_closing(self) -> bool:
        return self.is_closed

    def pause_reading(self) -> None:
        self.is_paused = True

    def resume_reading(self) -> None:
        self.is_paused = False

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None: ...


async def silent_app(scope: Any, receive: Any, send: Any) -> None:
    """An application that accepts all, and reads nothing more."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
    await asyncio.sleep(PATIENCE_S)


class Connections:
    """Connections of a server that has no socket."""

    def __init__(self, app: Any = silent_app, **settings: Any) -> None:
        self.http, self.websocket = protocols(Settings(**settings))
        self.config = uvicorn.Config(
            app, http=self.http, ws=self.websocket, ws_per_message_deflate=False, log_config=None
        )
        self.state = ServerState()

    def open(self, address: str = "192.0.2.1") -> tuple[LimitedHttpProtocol, FakeTransport]:
        protocol, transport = self.http(self.config, self.state, {}), FakeTransport(address)
        protocol.connection_made(transport)
        return protocol, transport

    def open_websocket(self) -> tuple[LimitedWebSocketProtocol, FakeTransport]:
        protocol, transport = self.websocket(self.config, self.state, {}), FakeTransport()
        protocol.connection_made(transport)
        protocol.data_received(UPGRADE + b"\r\n")
        return protocol, transport
