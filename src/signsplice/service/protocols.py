"""uvicorn's HTTP and WebSocket protocols with limits on data outside of bodies and messages.

``limits`` limits bodies on reception, uvicorn limits messages. This module limits what a parser reads before it calls
the application: heads, trailers, the framing of chunks, pings, fragments; and answers that a client does not read.
"""

from __future__ import annotations

import asyncio
import json
import select
import sys
from collections import Counter
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame
from websockets.http11 import Response
from websockets.protocol import State
from websockets.server import ServerProtocol

from signsplice.service.limits import HEADERS, client_of
from signsplice.service.monitoring import LOG
from signsplice.service.settings import Settings

try:
    import fcntl
    import termios
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_CHECK_SECONDS = 0.5
"""Interval of checks whether a client reads its answer, seconds."""


class UnreadWatch:
    """Closes a connection whose client reads nothing of an answer within ``idle_seconds``, or not all of it within
    ``body_seconds``. The protocol's ``n_unread`` counts connections with unread answers.
    """

    def __init__(self, protocol: LimitedHttpProtocol) -> None:
        self._transport, self._loop, self._settings = protocol.transport, protocol.loop, protocol.settings
        self._client, self._of_clients = protocol.client_name, protocol.n_unread
        self._check: asyncio.TimerHandle | None = None
        self._n_bytes, self._since, self._last_read = 0, 0.0, 0.0

    def start(self) -> None:
        """Start the clock, unless it runs or nothing waits to be read."""
        if self._check is None and self._transport.get_write_buffer_size():
            self._n_bytes, self._since = self._n_unread(), self._loop.time()
            self._last_read = self._since
            self._of_clients[self._client] += 1
            self._check = self._loop.call_later(_CHECK_SECONDS, self._look)

    def stop(self) -> None:
        """Stop the clock."""
        if self._check is not None:
            self._check.cancel()
            self._check = None
            self._of_clients[self._client] -= 1
            if not self._of_clients[self._client]:
                del self._of_clients[self._client]

    def stop_if_read(self) -> None:
        """Stop the clock if nothing waits to be read."""
        if not self._transport.get_write_buffer_size():
            self.stop()

    def _n_unread(self) -> int:
        """Return the number of bytes that the client's machine has not confirmed. The system buffers some MB and
        accepts more only after sending a good part: without these bytes a slow client would long seem to read nothing.
        """
        queued, end = bytearray(4), self._transport.get_extra_info("socket")
        if fcntl is not None and end is not None:
            with suppress(OSError):  # the system does not support this
                fcntl.ioctl(end.fileno(), termios.TIOCOUTQ, queued)
        return self._transport.get_write_buffer_size() + int.from_bytes(queued, sys.byteorder)

    def _look(self) -> None:
        n_bytes, now = self._n_unread(), self._loop.time()
        if n_bytes < self._n_bytes:
            self._last_read = now
        self._n_bytes = n_bytes
        is_idle = now - self._last_read > self._settings.idle_seconds
        if not self._transport.get_write_buffer_size():
            self.stop()
        elif is_idle or now - self._since > self._settings.body_seconds:
            LOG.warning("a client did not read its answer in time; its connection was closed")
            self.stop()
            self._transport.abort()
        else:
            self._check = self._loop.call_later(_CHECK_SECONDS, self._look)


_MAX_HEADERS = 100
"""Maximum number of fields of a head, and of a trailer. The WebSocket library reads no more than 128."""
_MAX_PIPELINED = 16
"""Maximum number of requests on a connection that wait for an earlier answer."""
_FRAMING = 16
"""Bytes of a body per free byte of framing, so that chunks of 100 bytes and more do not count as a flood."""
_PIECE_BYTES = 16 * 1024
"""Maximum data of a request that is parsed in one step, bytes."""
_LEAST_PIECE_BYTES = 1024
"""Minimum data that is parsed in one step after a head, i.e. in a body, bytes."""
_STEP_BYTES = 4096
"""Data of a WebSocket that is parsed in one step, bytes: some milliseconds if it consists of empty frames."""
_IDLE_FRAMES_SECONDS = 10.0
"""Time in which a stream's client may send ``max_idle_frames``, seconds."""
_POLICY_VIOLATION = 1008
"""WebSocket close code: the client exceeded a limit."""


def _failure(text: str) -> bytes:
    """Return ``wire.Failure`` with this message, as JSON."""
    return json.dumps({"error": text, "unknown": {}}).encode()


def _has_hung_up(transport: asyncio.Transport) -> bool:
    """Return whether a connection is closed; on Linux also if the client's end comes after data that is not read yet,
    as of pipelined requests, or words of a stream.
    """
    end, hung_up = transport.get_extra_info("socket"), getattr(select, "POLLRDHUP", None)
    if end is not None and hung_up is not None and not transport.is_closing():
        poll = select.poll()
        poll.register(end.fileno(), hung_up)
        if poll.poll(0):
            transport.abort()
    return transport.is_closing()


class _ProtocolError(Exception):
    """Ends the parsing of a request."""


class LimitedHttpProtocol(HttpToolsProtocol):
    """HTTP/1.1 with a size limit on everything but bodies, and a time limit on everything.

    The head of a request must arrive within ``head_seconds``, then its body and trailer within ``body_seconds``,
    whether or not the application reads them. The client must read some of an answer within ``idle_seconds``, and all
    of it within ``body_seconds``.

    n_unread: number of connections of each client with an unread answer.
    """

    settings: Settings
    n_unread: Counter[str]
    unread: UnreadWatch
    client_name = ""
    _timer: asyncio.TimerHandle | None = None
    _n_bytes = 0
    """Bytes of the request received so far, without the body."""
    _n_fields, _has_head = 0, False
    _refusal = HTTPStatus.BAD_REQUEST, "the request is not valid HTTP/1.1"

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the clock, or refuse the connection if there are too many."""
        super().connection_made(transport)
        self.app_state = {**self.app_state, "has_hung_up": partial(_has_hung_up, transport)}
        self.client_name = client_of(self.client[0] if self.client else None)
        self.unread = UnreadWatch(self)
        self._start_clock(self.settings.head_seconds)
        if len(self.connections) > self.settings.max_connections:
            for connection in list(self.connections):
                if connection.transport.is_closing():  # its client does not read the rest of an answer
                    connection.transport.abort()
            self._answer(HTTPStatus.SERVICE_UNAVAILABLE, "too many connections; try again in a moment")
        elif self._n_of_client() > self.settings.max_client_connections:
            self._answer(HTTPStatus.SERVICE_UNAVAILABLE, "too many connections from this address")

    def _n_of_client(self) -> int:
        """Return the number of connections of this client; 0 for a trusted proxy, which has many clients."""
        if self._is_proxy():
            return 0
        return sum(self.client_name == getattr(connection, "client_name", None) for connection in self.connections)

    def _is_proxy(self) -> bool:
        return bool(self.client and self.client[0] in self.settings.proxies)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the clocks."""
        self._stop_clock()
        self.unread.stop()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse data, and count the bytes outside the body.

        Parses in pieces, so that the limit also holds for data that arrives in one read: a head exceeds it by at most
        one byte, a trailer by 1 KiB, and a head after another request in the same read by 16 KiB.
        """
        limit, start = self.settings.max_head_bytes, 0
        while start < len(data) and not self.transport.is_closing() and self in self.connections:  # else handed over
            if self._timer is None:  # also for bytes that do not begin a request
                self._start_clock(self.settings.head_seconds)
            self._n_bytes = max(self._n_bytes, 0)
            least = _LEAST_PIECE_BYTES if self._has_head else 1
            piece = data[start : start + min(_PIECE_BYTES, max(least, limit + 1 - self._n_bytes))]
            start += len(piece)
            self._n_bytes += len(piece)
            super().data_received(piece)
            if self._n_bytes > limit:
                what = "the head or the trailer of the request, or the framing of its chunks,"
                self._answer(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, f"{what} is longer than {limit} bytes")

    # callbacks of the parser

    def on_message_begin(self) -> None:
        """Refuse requests that arrive faster than answers are sent or read."""
        self.unread.stop_if_read()
        if self.n_unread[self.client_name] >= self.settings.max_client_waiting and not self._is_proxy():
            reason = "too many answers that this address has not read; read them, or try again in a moment"
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, reason)
        if len(self.pipeline) >= _MAX_PIPELINED:
            self._refuse(HTTPStatus.TOO_MANY_REQUESTS, "too many requests on one connection before the first answer")
        super().on_message_begin()
        self._has_head, self._n_fields = False, 0
        self._start_clock(self.settings.head_seconds)

    def on_header(self, name: bytes, value: bytes) -> None:
        """Keep a field of the head; drop fields of a trailer, which come after the checks of the head."""
        self._n_fields += 1
        if self._n_fields > _MAX_HEADERS:
            reason = f"more than {_MAX_HEADERS} header fields"
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, reason)
        if not self._has_head:
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Start the clock of the body."""
        self._has_head, self._n_fields = True, 0
        self._start_clock(self.settings.body_seconds)
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Count a part of the body as body."""
        self._n_bytes -= len(body) + len(body) // _FRAMING
        super().on_body(body)

    def on_message_complete(self) -> None:
        """Stop the clock."""
        self._stop_clock()
        self._n_bytes = 0
        super().on_message_complete()

    def _refuse(self, status: HTTPStatus, reason: str) -> None:
        self._refusal = status, reason
        raise _ProtocolError(reason)  # stops the parser; ``send_400_response`` follows

    # clocks and answers

    def _start_clock(self, seconds: float) -> None:
        self._stop_clock()
        self._timer = self.loop.call_later(seconds, self._run_out)

    def _stop_clock(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _run_out(self) -> None:
        self._timer = None
        if not self._is_answering() or self.cycle.more_body:
            self._answer(HTTPStatus.REQUEST_TIMEOUT, "the request came too slowly; send it again")

    def _is_answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    def on_response_complete(self) -> None:
        """Watch whether the client reads the answer."""
        self.unread.start()
        super().on_response_complete()

    def pause_writing(self) -> None:
        """Watch a client that reads an answer more slowly than it is written."""
        super().pause_writing()
        self.unread.start()

    def handle_websocket_upgrade(self) -> None:
        """Hand the connection over; this protocol receives no more of its data."""
        self._stop_clock()
        super().handle_websocket_upgrade()

    def send_400_response(self, msg: str) -> None:
        """Refuse a request that the parser could not read or a limit stopped."""
        self._answer(*self._refusal)

    def _answer(self, status: HTTPStatus, reason: str) -> None:
        """Close the connection, with a reason unless an answer has begun."""
        if self.transport.is_closing():
            return
        if not (self._is_answering() and self.cycle.response_started):
            body = _failure(reason)
            headers = {"Connection": "close", "Content-Type": "application/json", "Content-Length": len(body)} | HEADERS
            lines = [f"HTTP/1.1 {status.value} {status.phrase}", *(f"{name}: {headers[name]}" for name in headers)]
            self.transport.write("\r\n".join([*lines, "", ""]).encode() + body)
            self.unread.start()
        self._stop_clock()
        self.transport.close()


class _JsonServerProtocol(ServerProtocol):
    """The handshake of a WebSocket, refused with JSON."""

    def reject(self, status: int, text: str) -> Response:
        """Return the answer that refuses a handshake."""
        response = super().reject(status, _failure(text.strip() or "no stream here").decode())
        del response.headers["Content-Type"]
        response.headers.update({"Content-Type": "application/json", **HEADERS})
        return response


class LimitedWebSocketProtocol(WebSocketsSansIOProtocol):
    """WebSocket that is parsed in small steps, interleaved with other connections, with a rate limit on frames that
    bring no message (pings, pongs, fragments, all frames after a close).
    """

    settings: Settings
    client_name = ""

    def __init__(self, *args: Any, **keywords: Any) -> None:
        super().__init__(*args, **keywords)
        self.conn = _JsonServerProtocol(max_size=self.config.ws_max_size, logger=self.logger)
        self._unparsed = bytearray()
        self._step: asyncio.Handle | None = None
        self._is_held = False
        self._n_idle_frames, self._window_start = 0, 0.0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a connection over from HTTP."""
        super().connection_made(transport)
        self.client_name = client_of(self.client[0] if self.client else None)

    def data_received(self, data: bytes) -> None:
        """Parse data: one step now, the others in later turns of the event loop."""
        self._unparsed += data
        if self._step is None:
            self._parse_some()

    def _parse_some(self) -> None:
        self._step = None
        if self.transport.is_closing():
            self._unparsed.clear()
        elif not self.read_paused:
            piece = bytes(self._unparsed[:_STEP_BYTES])
            del self._unparsed[:_STEP_BYTES]
            super().data_received(piece)
            if self.conn.handshake_exc is not None and not self.handshake_initiated:
                self.transport.write(b"".join(self.conn.data_to_send()))
                self.transport.close()
            self._go_on()

    def _go_on(self) -> None:
        """Parse waiting data, unless the application has messages to read first; read no more meanwhile."""
        if self.transport.is_closing() or self.read_paused:
            return
        if self._unparsed:
            self._is_held = True
            self.transport.pause_reading()  # uvicorn may have resumed it
            if self._step is None:
                self._step = self.loop.call_soon(self._parse_some)
        elif self._is_held:
            self._is_held = False
            self.transport.resume_reading()

    async def receive(self) -> Any:
        """Return the next message; parsing resumes when none is left."""
        event = await super().receive()
        self._go_on()
        return event

    async def send(self, message: Any) -> None:
        """Send a message; after a close, parsing continues until the client's close."""
        await super().send(message)
        self._go_on()

    def handle_ping(self) -> None:
        """Answer a ping."""
        self._count_idle_frame()
        super().handle_ping()

    def handle_pong(self, event: Frame) -> None:
        """Note a pong."""
        self._count_idle_frame()
        super().handle_pong(event)

    def handle_cont(self, event: Frame) -> None:
        """Take a fragment."""
        self._count_idle_frame()
        super().handle_cont(event)

    def send_receive_event_to_app(self) -> None:
        """Pass a message to the application; drop it after a close."""
        if self.close_sent:
            self._count_idle_frame()
        super().send_receive_event_to_app()

    def _count_idle_frame(self) -> None:
        now = self.loop.time()
        if now - self._window_start > _IDLE_FRAMES_SECONDS:
            self._n_idle_frames, self._window_start = 0, now
        self._n_idle_frames += 1
        if self._n_idle_frames > self.settings.max_idle_frames and not self.transport.is_closing():
            if self.conn.state is State.OPEN:
                self._send_error("too many pings, pongs and fragments")
                self.conn.fail(_POLICY_VIOLATION, "too many pings, pongs and fragments")
                self.handle_parser_exception()
            else:
                self.transport.close()

    def _send_error(self, reason: str) -> None:
        self.conn.send_text(json.dumps({"type": "error", "error": reason, "unknown": {}}).encode())

    def shutdown(self) -> None:
        """Tell the client that the service stops, and close."""
        if self.conn.state is State.CLOSING:
            self.transport.close()
            return
        if self.conn.state is State.OPEN:
            self._send_error("the service stops; open the stream again later")
        super().shutdown()


def protocols(settings: Settings) -> tuple[type[LimitedHttpProtocol], type[LimitedWebSocketProtocol]]:
    """Return the two protocol classes with the limits of a service; uvicorn creates their objects."""
    http = type("ServiceHttpProtocol", (LimitedHttpProtocol,), {"settings": settings, "n_unread": Counter()})
    websocket = type("ServiceWebSocketProtocol", (LimitedWebSocketProtocol,), {"settings": settings})
    return http, websocket
