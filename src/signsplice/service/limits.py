"""Limits on callers: sizes and times of bodies, host names, origins of pages, and each client's share of scarce
resources.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Coroutine, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from ipaddress import IPv6Address, ip_address
from typing import Any, TypeVar
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from signsplice.service.settings import MIB, Settings
from signsplice.service.workers import BusyError

ResultT = TypeVar("ResultT")

_PIECE_BYTES = 64 * 1024
"""Largest part of an answer that is sent at once, bytes."""
_CHECK_SECONDS = 0.25
"""How often clients who wait are looked after, seconds."""


async def while_connected(connection: HTTPConnection, job: Coroutine[Any, Any, ResultT]) -> ResultT:
    """Return the result of a job. Cancels it, and raises ``ClientDisconnect``, once the client of a request whose body
    was read has hung up.
    """
    task = asyncio.create_task(job)
    try:
        while not (await asyncio.wait({task}, timeout=_CHECK_SECONDS))[0]:
            if isinstance(connection, Request) and await connection.is_disconnected():
                raise ClientDisconnect
        return task.result()
    finally:
        task.cancel()


def caller(connection: HTTPConnection) -> str:
    """Return the client of a connection, see ``client_of``."""
    return client_of(connection.client.host if connection.client else None)


def client_of(address: str | None) -> str:
    """Return the client of an address: an IPv4 address, or the /64 network of an IPv6 address, owned by one client."""
    try:
        parsed = ip_address((address or "").partition("%")[0])
    except ValueError:
        return address or ""
    if not isinstance(parsed, IPv6Address):
        return str(parsed)
    return str(parsed.ipv4_mapped or IPv6Address(int(parsed) >> 64 << 64))


class Shares:
    """Limits how many of a resource are held, in total and by each client.

    noun: name of the resource, for error messages.
    """

    def __init__(self, noun: str, limit: int, client_limit: int) -> None:
        self._noun, self._limit, self._client_limit = noun, limit, client_limit
        self._held: Counter[str] = Counter()

    @property
    def n_held(self) -> int:
        """Total number held."""
        return self._held.total()

    @contextmanager
    def hold(self, connection: HTTPConnection) -> Iterator[None]:
        """Hold one while the block runs. Raises ``BusyError`` if the limit is reached."""
        client = caller(connection)
        if self.n_held >= self._limit:
            raise BusyError(f"too many {self._noun}; try again in a moment")
        if self._held[client] >= self._client_limit:
            raise BusyError(
                f"too many {self._noun} from {client}, expected at most {self._client_limit}; try again in a moment"
            )
        self._held[client] += 1
        try:
            yield
        finally:
            self._held[client] -= 1
            if not self._held[client]:
                del self._held[client]


_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
_CLOSE = {"Connection": "close"}
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
}
"""Default headers of every answer."""

_PREFLIGHT = {
    "Access-Control-Allow-Methods": "GET, POST",
    "Access-Control-Allow-Headers": "*",
    "Access-Control-Max-Age": "600",
}


class Limits:
    """ASGI middleware that refuses requests beyond the settings' limits."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self.app, self.settings = app, settings
        self.uploads = Shares("uploads at one time", settings.max_uploads, settings.max_client_uploads)
        self.n_unread = Counter[str]()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        if (preflight := _preflight(scope)) is not None:
            await preflight(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            status, reason = refusal
            if scope["type"] == "websocket":
                await receive()
            await _failure(status, reason, _readable_by(scope))(scope, receive, send)
        elif scope["type"] == "websocket":
            await self.app(scope, receive, send)
        else:
            await self._answer(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        origin = _header(scope, b"origin")
        is_allowed = origin is not None and origin.lower() in self.settings.allowed_origins
        with ExitStack() as stack:
            limited_send = _LimitedSend(
                self, _client(scope), send, HEADERS | (_readable_by(scope) if is_allowed else {})
            )
            body = _LimitedReceive(self, HTTPConnection(scope), receive, stack)
            try:
                await self.app(scope, body, limited_send)
            except Exception:
                if limited_send.is_late:
                    raise ClientDisconnect from None
                raise
            except asyncio.CancelledError:  # the service stops, and the time for running requests is over
                if limited_send.has_begun:
                    raise
                await _failure(503, "the service stopped before this was done; send it again")(scope, receive, send)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Return status and reason of a refusal; None if the request's head is allowed."""
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        if sum(name == b"host" for name, _ in scope["headers"]) > 1:
            return 400, "two Host headers, expected one"
        host = headers.get(b"host", "")
        if not self.settings.answers_to(_without_port(host)):
            names = ", ".join(self.settings.hosts)
            return 421, f"called as {host!r}; this service answers to {names} (its allowed_hosts add a name)"
        origin = headers.get(b"origin")
        is_unsafe = scope["type"] == "websocket" or scope["method"] not in _SAFE_METHODS
        if origin is not None and is_unsafe and not self._is_allowed(origin, host):
            return 403, f"a page of {origin!r} may not call this service (`signsplice serve --allow-origin` allows one)"
        if headers.get(b"content-encoding", "identity") != "identity":
            return 415, "the body is compressed; send it uncompressed"
        if self.n_unread[_client(scope)] >= self.settings.max_client_waiting:
            return 503, "too many answers that this address has not read; read them, or try again in a moment"
        length = headers.get(b"content-length", "0")
        limit = self.max_bytes(scope)
        if length.isdecimal() and int(length) > limit:
            return 413, _too_long(limit)
        return None

    def max_bytes(self, scope: Scope) -> int:
        """Return the size limit of a request's body: only forms, which hold files, may exceed that of JSON."""
        content_type = dict(scope["headers"]).get(b"content-type", b"")
        settings = self.settings
        if content_type.startswith(b"multipart/form-data"):
            return settings.max_body_bytes
        return min(settings.max_body_bytes, settings.max_json_bytes)

    def _is_allowed(self, origin: str, host: str) -> bool:
        """Return whether a page of this origin may call."""
        try:
            return urlsplit(origin).netloc.lower() == host.lower() or origin.lower() in self.settings.allowed_origins
        except ValueError:
            return False


def _client(scope: Scope) -> str:
    return caller(HTTPConnection(scope))


def _too_long(limit: int) -> str:
    return f"the body is longer than {limit / MIB:g} MiB; send less, or in parts"


def _without_port(host: str) -> str:
    name, _, port = host.rpartition(":")
    return name if name and port.isdecimal() else host


def _failure(status: int, reason: str, headers: Mapping[str, str] = {}) -> JSONResponse:
    return JSONResponse({"error": reason, "unknown": {}}, status, headers={**HEADERS, **_CLOSE, **headers})


def _header(scope: Scope, name: bytes) -> str | None:
    value = dict(scope["headers"]).get(name)
    return None if value is None else value.decode("latin-1")


def _readable_by(scope: Scope) -> dict[str, str]:
    """Return headers by which a browser lets a page of another origin read an answer; none if no page calls."""
    origin = _header(scope, b"origin")
    return {} if origin is None else {"Access-Control-Allow-Origin": origin, "Vary": "Origin"}


def _preflight(scope: Scope) -> Response | None:
    """Return the answer to a browser's preflight request for a page of another origin; None for any other request.

    The answer always allows the call: the request itself is then refused by its Origin, with a reason that the page can
    read. A failed preflight gives the page, and its developer, no reason.
    """
    asks = scope["type"] == "http" and scope["method"] == "OPTIONS"
    if not asks or _header(scope, b"access-control-request-method") is None:
        return None
    return Response(status_code=204, headers={**HEADERS, **_PREFLIGHT, **_readable_by(scope)})


class _LimitedReceive:
    """Receives, counts and times the parts of a body. ``held``: resources that the request holds until its end."""

    def __init__(self, limits: Limits, connection: HTTPConnection, receive: Receive, held: ExitStack) -> None:
        self._limits, self._connection, self._receive, self._held = limits, connection, receive, held
        self._max_bytes = limits.max_bytes(connection.scope)
        self._n_bytes, self._start = 0, time.monotonic()
        self._is_complete = self._is_upload = False

    async def __call__(self) -> Message:
        if self._is_complete:
            return await self._receive()  # waits for the end of the connection
        settings = self._limits.settings
        remaining = self._start + settings.body_seconds - time.monotonic()
        try:
            async with asyncio.timeout(max(0.0, min(settings.idle_seconds, remaining))):
                message = await self._receive()
        except TimeoutError:
            raise HTTPException(408, "the body came too slowly; send it again", _CLOSE) from None
        if message["type"] != "http.request":
            return message
        self._is_complete = not message.get("more_body", False)
        self._n_bytes += len(message.get("body", b""))
        if self._n_bytes > self._max_bytes:
            raise HTTPException(413, _too_long(self._max_bytes), _CLOSE)
        if self._n_bytes > MIB and not self._is_upload:
            self._is_upload = True
            try:
                self._held.enter_context(self._limits.uploads.hold(self._connection))
            except BusyError as error:
                raise HTTPException(503, str(error), {**_CLOSE, "Retry-After": "2"}) from None
        return message


class _LimitedSend:
    """Sends and times the parts of an answer, in pieces, so that a client that does not read is noticed.

    has_begun: whether a part was sent.
    is_late: whether the client did not read a part in time.
    """

    def __init__(self, limits: Limits, client: str, send: Send, headers: Mapping[str, str]) -> None:
        self._limits, self._client, self._send, self._headers = limits, client, send, headers
        self._deadline = 0.0
        self.has_begun = self.is_late = False

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.has_begun = True
            headers = MutableHeaders(scope=message)
            for name, value in self._headers.items():
                headers.setdefault(name, value)
            self._deadline = time.monotonic() + self._limits.settings.body_seconds
        body = message.get("body", b"")
        if len(body) <= _PIECE_BYTES:
            await self._send_in_time(message)
            return
        self._limits.n_unread[self._client] += 1
        try:
            for start in range(0, len(body), _PIECE_BYTES):
                more = message.get("more_body", False) or start + _PIECE_BYTES < len(body)
                await self._send_in_time({**message, "body": body[start : start + _PIECE_BYTES], "more_body": more})
        finally:
            self._limits.n_unread -= Counter([self._client])  # keeps no zeros

    async def _send_in_time(self, message: Message) -> None:
        """Send a piece. Raises ``ClientDisconnect`` if the client does not read those before it in time."""
        seconds = min(self._limits.settings.idle_seconds, self._deadline - time.monotonic())
        try:
            async with asyncio.timeout(max(0.0, seconds)):
                await self._send(message)
        except TimeoutError:
            self.is_late = True
            raise ClientDisconnect from None
