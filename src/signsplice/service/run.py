"""Runs the service on a socket."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import uvicorn
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from signsplice.errors import InputError
from signsplice.service.app import create
from signsplice.service.settings import Settings

_MAX_CONNECTIONS = 1000


def serve(
    settings: Settings, scenes: Sequence[Mapping[str, Any]] = (), on_open: Callable[[str], None] | None = None
) -> None:
    """Listen until interrupted. ``on_open`` is called with the page's address once the socket is open.

    Raises ``InputError`` where the address cannot be listened on, or the lexicon cannot be opened.
    """
    app = create(settings, scenes)
    config = uvicorn.Config(
        app,
        http=_protocol(settings.head_seconds),
        ws="websockets-sansio",
        ws_per_message_deflate=False,  # costs more than it saves on frames
        ws_max_size=settings.max_message_bytes,
        limit_concurrency=_MAX_CONNECTIONS,
        timeout_graceful_shutdown=3,
        log_level="warning",
        access_log=False,
        server_header=False,
    )
    with _listen(settings) as listener:
        if on_open is not None:
            host = settings.host if ":" not in settings.host else f"[{settings.host}]"
            on_open(f"http://{host}:{listener.getsockname()[1]}/")
        uvicorn.Server(config).run(sockets=[listener])


def _listen(settings: Settings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        return socket.create_server((settings.host, settings.port), family=family, backlog=512)
    except OSError as error:
        raise InputError(
            f"cannot listen on {settings.host}:{settings.port} ({error.strerror or error}); try another --port"
        ) from error


def _protocol(head_seconds: float) -> type[asyncio.Protocol]:
    """HTTP with a time limit for the head of a request, which uvicorn has not."""

    class HeadTimeoutProtocol(HttpToolsProtocol):
        _timer: asyncio.TimerHandle | None = None

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            self._start_timer()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop_timer()
            super().connection_lost(exc)

        def on_message_begin(self) -> None:
            super().on_message_begin()
            self._start_timer()

        def on_headers_complete(self) -> None:
            self._stop_timer()
            super().on_headers_complete()

        def _start_timer(self) -> None:
            self._stop_timer()
            self._timer = self.loop.call_later(head_seconds, self._refuse)

        def _stop_timer(self) -> None:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None

        def _refuse(self) -> None:
            if not self.transport.is_closing():
                body = b'{"error":"the head of the request came too slowly","unknown":{}}'
                self.transport.write(
                    b"HTTP/1.1 408 Request Timeout\r\nConnection: close\r\nContent-Type: application/json\r\n"
                    + b"Content-Length: %d\r\n\r\n" % len(body)
                    + body
                )
                self.transport.close()

    return HeadTimeoutProtocol
