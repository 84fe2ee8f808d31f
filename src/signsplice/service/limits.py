"""Middleware that enforces the limits on callers: sizes and times of bodies, host names, and origins of pages."""

from __future__ import annotations

import asyncio
import time
from urllib.parse import urlsplit

from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from signsplice.service.settings import MIB, Settings

_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
_CLOSE = {"Connection": "close"}


class Limits:
    """ASGI middleware that refuses requests beyond the settings' limits."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self.app, self.settings = app, settings
        self.uploads = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            status, reason = refusal
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.close", "code": 1008, "reason": reason})
            else:
                await JSONResponse({"error": reason, "unknown": {}}, status, headers=_CLOSE)(scope, receive, send)
        elif scope["type"] == "websocket":
            await self.app(scope, receive, send)
        else:
            body = _LimitedReceive(self, receive, self.max_bytes(scope))
            try:
                await self.app(scope, body, _TimedSend(send, self.settings.idle_seconds))
            finally:
                body.close()

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Status and reason, None for a request whose head is allowed."""
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        host = headers.get(b"host", "")
        if not self.settings.answers_to(_without_port(host)):
            names = ", ".join(self.settings.hosts)
            return 421, f"called as {host!r}; this service answers to {names} (--allow-host adds a name)"
        origin = headers.get(b"origin")
        is_unsafe = scope["type"] == "websocket" or scope["method"] not in _SAFE_METHODS
        if origin is not None and is_unsafe and not self._is_allowed(origin, host):
            return 403, f"a page of {origin!r} may not call this service (--allow-origin allows it)"
        if headers.get(b"content-encoding", "identity") != "identity":
            return 415, "the body is compressed; send it uncompressed"
        length = headers.get(b"content-length", "0")
        limit = self.max_bytes(scope)
        if length.isdecimal() and int(length) > limit:
            return 413, _too_long(limit)
        return None

    def max_bytes(self, scope: Scope) -> int:
        """The limit of a request's body: only forms, which hold files, may exceed that of JSON."""
        content_type = dict(scope["headers"]).get(b"content-type", b"")
        settings = self.settings
        if content_type.startswith(b"multipart/form-data"):
            return settings.max_body_bytes
        return min(settings.max_body_bytes, settings.max_json_bytes)

    def _is_allowed(self, origin: str, host: str) -> bool:
        """Whether a page of this origin may call."""
        try:
            return urlsplit(origin).netloc.lower() == host.lower() or origin.lower() in self.settings.allowed_origins
        except ValueError:
            return False


def _too_long(limit: int) -> str:
    return f"the body is longer than {limit / MIB:g} MiB; send less, or in parts"


def _without_port(host: str) -> str:
    name, _, port = host.rpartition(":")
    return name if name and port.isdecimal() else host


class _LimitedReceive:
    """Receives the parts of a body, and counts and times them."""

    def __init__(self, limits: Limits, receive: Receive, max_bytes: int) -> None:
        self._limits, self._receive, self._max_bytes = limits, receive, max_bytes
        self._n_bytes, self._start = 0, time.monotonic()
        self._is_complete = self._is_upload = False

    async def __call__(self) -> Message:
        if self._is_complete:
            return await self._receive()  # waits for the end of the connection
        settings = self._limits.settings
        remaining = self._start + settings.body_seconds - time.monotonic()
        try:
            message = await asyncio.wait_for(self._receive(), max(0.0, min(settings.idle_seconds, remaining)))
        except TimeoutError:
            raise HTTPException(408, "the body came too slowly; send it again", _CLOSE) from None
        if message["type"] != "http.request":
            return message
        self._is_complete = not message.get("more_body", False)
        self._n_bytes += len(message.get("body", b""))
        if self._n_bytes > self._max_bytes:
            raise HTTPException(413, _too_long(self._max_bytes), _CLOSE)
        if self._n_bytes > MIB and not self._is_upload:
            if self._limits.uploads >= settings.max_uploads:
                raise HTTPException(
                    503, "too many uploads at one time; try again in a moment", {**_CLOSE, "Retry-After": "2"}
                )
            self._is_upload = True
            self._limits.uploads += 1
        return message

    def close(self) -> None:
        if self._is_upload:
            self._limits.uploads -= 1


class _TimedSend:
    """Sends the parts of an answer; a client that does not accept one in time loses the connection."""

    def __init__(self, send: Send, seconds: float) -> None:
        self._send, self._seconds = send, seconds

    async def __call__(self, message: Message) -> None:
        await asyncio.wait_for(self._send(message), self._seconds)
