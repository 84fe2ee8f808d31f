"""What a caller may do to the service, watched while it is done: bodies are counted as they come in, clients that stall
are let go, and pages of other origins are kept out.
"""

from __future__ import annotations

import asyncio
import time
from urllib.parse import urlsplit

from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from signsplice.service.settings import MIB, Settings

_SAFE = ("GET", "HEAD", "OPTIONS")
_CLOSE = {"Connection": "close"}


class Limits:
    """ASGI middleware that holds a service's settings."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self.app, self.settings = app, settings
        self.uploads = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        refused = self._refused(scope)
        if refused is not None:
            status, why = refused
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.close", "code": 1008, "reason": why})
            else:
                await JSONResponse({"error": why, "unknown": {}}, status, headers=_CLOSE)(scope, receive, send)
        elif scope["type"] == "websocket":
            await self.app(scope, receive, send)
        else:
            reading = _LimitedReceive(self, receive, self.most(scope))
            try:
                await self.app(scope, reading, _Sending(send, self.settings.idle_seconds))
            finally:
                reading.close()

    def _refused(self, scope: Scope) -> tuple[int, str] | None:
        """Status and reason, where a request is not let in."""
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        host = headers.get(b"host", "")
        if not self.settings.answers_to(_bare(host)):
            names = ", ".join(self.settings.hosts)
            return 421, f"called as {host!r}; this service answers to {names} (--allow-host)"
        origin = headers.get(b"origin")
        acts = scope["type"] == "websocket" or scope["method"] not in _SAFE
        if origin is not None and acts and not self._known(origin, host):
            return 403, f"a page of {origin!r} may not call this service (--allow-origin)"
        if headers.get(b"content-encoding", "identity") != "identity":
            return 415, "compressed bodies are not read; send it as it is"
        length = headers.get(b"content-length", "0")
        most = self.most(scope)
        if length.isdecimal() and int(length) > most:
            return 413, too_long(most)
        return None

    def most(self, scope: Scope) -> int:
        """How many bytes a request's body may have; only forms, which hold files, may be long."""
        kind = dict(scope["headers"]).get(b"content-type", b"")
        settings = self.settings
        if kind.startswith(b"multipart/form-data"):
            return settings.max_body_bytes
        return min(settings.max_body_bytes, settings.max_json_bytes)

    def _known(self, origin: str, host: str) -> bool:
        """Whether a page of this origin may call."""
        try:
            return urlsplit(origin).netloc.lower() == host.lower() or origin.lower() in self.settings.allowed_origins
        except ValueError:
            return False


def too_long(limit: int) -> str:
    """What is said of a body beyond its limit."""
    return f"the body is longer than {limit / MIB:g} MiB; send less, or in parts"


def _bare(host: str) -> str:
    """A host without its port."""
    name, _, port = host.rpartition(":")
    return name if name and port.isdecimal() else host


class _LimitedReceive:
    """The parts of a body, counted and timed as they come."""

    def __init__(self, limits: Limits, receive: Receive, most: int) -> None:
        self._limits, self._receive, self._most = limits, receive, most
        self._n_bytes, self._began = 0, time.monotonic()
        self._whole = self._slot = False

    async def __call__(self) -> Message:
        if self._whole:
            return await self._receive()  # waits for the end of the connection
        settings = self._limits.settings
        left = self._began + settings.body_seconds - time.monotonic()
        try:
            message = await asyncio.wait_for(self._receive(), max(0.0, min(settings.idle_seconds, left)))
        except TimeoutError:
            raise HTTPException(408, "the body came too slowly; send it again", _CLOSE) from None
        if message["type"] != "http.request":
            return message
        self._whole = not message.get("more_body", False)
        self._n_bytes += len(message.get("body", b""))
        if self._n_bytes > self._most:
            raise HTTPException(413, too_long(self._most), _CLOSE)
        if self._n_bytes > MIB and not self._slot:
            if self._limits.uploads >= settings.max_uploads:
                raise HTTPException(
                    503, "too many uploads at one time; try again in a moment", {**_CLOSE, "Retry-After": "2"}
                )
            self._slot = True
            self._limits.uploads += 1
        return message

    def close(self) -> None:
        if self._slot:
            self._limits.uploads -= 1


class _Sending:
    """An answer, whose client has to take it."""

    def __init__(self, send: Send, seconds: float) -> None:
        self._send, self._seconds = send, seconds

    async def __call__(self, message: Message) -> None:
        await asyncio.wait_for(self._send(message), self._seconds)
