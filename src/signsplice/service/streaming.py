"""A stream: words come in one at a time over a WebSocket, frames go out as soon as they are final.

A frame is due at the first one's time plus its number over the rate. Where words come too late, the clock waits for
them, so that the sentence goes on where it stopped; where the work was late, frames catch up.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from typing import Any
from uuid import uuid4

from pydantic import TypeAdapter, ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from signsplice.errors import InputError, SignspliceError, UnknownGlossError
from signsplice.service import work
from signsplice.service.metrics import Metrics
from signsplice.service.scene import to_json
from signsplice.service.settings import Settings
from signsplice.service.wire import FRAMES, MAGIC, End, FromClient, Open, Say
from signsplice.service.workers import WorkerProcess

_MESSAGE: TypeAdapter[FromClient] = TypeAdapter(FromClient)
_OUT = 16
"""Messages, a span's frames each at most, that are made ahead of the one that is sent."""
POLICY, GONE, AGAIN = 1008, 1001, 1013


class _RefusedError(Exception):
    """The client did what it must not: the stream ends."""


def failure(error: Exception) -> dict[str, Any]:
    """What is told of an error."""
    if isinstance(error, UnknownGlossError):
        told = (
            f"{gloss!r}" + (f" (nearest: {', '.join(near)})" if near else "") for gloss, near in error.unknown.items()
        )
        return {"error": f"no gloss {'; '.join(told)}", "unknown": {k: list(v) for k, v in error.unknown.items()}}
    return {"error": " ".join(str(error).split()), "unknown": {}}


def message(told: ValidationError) -> str:
    """A fault in a message, in one line."""
    first = told.errors(include_url=False, include_context=False, include_input=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    return f"{where}: {first['msg']}" if where else str(first["msg"])


class StreamSession:
    """One client's stream."""

    def __init__(self, socket: WebSocket, settings: Settings, worker: WorkerProcess, metrics: Metrics) -> None:
        self._socket, self._settings, self._worker, self._metrics = socket, settings, worker, metrics
        self._key, self._generation = uuid4().hex, 0
        self._words: asyncio.Queue[tuple[str, float] | None] = asyncio.Queue(settings.max_stream_words)
        self._out: asyncio.Queue[tuple[dict[str, Any] | bytes, float] | None] = asyncio.Queue(_OUT)
        self._heard = time.monotonic()

    async def run(self) -> None:
        """Serve the client until it is done or gone."""
        await self._socket.accept()
        try:
            opened = await self._opened()
            await self._worker.run(work.open_stream, self._key, opened, opened.spell)
            self._generation = self._worker.generation
            async with asyncio.TaskGroup() as tasks:
                reading = tasks.create_task(self._read())
                making = tasks.create_task(self._make())
                await self._send(opened.paced)
                reading.cancel()
                making.cancel()
            await self._socket.close()
        except* WebSocketDisconnect:
            pass
        except* (_RefusedError, SignspliceError, TimeoutError, KeyError) as group:
            await self._fail(group)
        finally:
            with suppress(SignspliceError):
                await self._worker.run(work.close_stream, self._key)

    async def _fail(self, group: BaseExceptionGroup[BaseException]) -> None:
        error: BaseException = group
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        told = failure(error) if isinstance(error, SignspliceError | _RefusedError) else {
            "error": "the stream was lost; open it again" if isinstance(error, KeyError) else "the client is too slow",
            "unknown": {},
        }  # fmt: skip
        with suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
            await self._deliver({"type": "error", **told})
            await self._socket.close(POLICY if isinstance(error, _RefusedError | InputError) else AGAIN)

    async def _hear(self, seconds: float) -> FromClient:
        """The client's next message. Raises ``_RefusedError``, ``WebSocketDisconnect`` and ``TimeoutError``."""
        event = await asyncio.wait_for(self._socket.receive(), seconds)
        if event["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(event.get("code", GONE))
        self._heard = time.monotonic()
        text = event.get("text")
        if text is None:
            raise _RefusedError("binary messages are not read, expected JSON as text")
        if len(text) > self._settings.max_message_bytes:
            raise _RefusedError(
                f"a message of {len(text)} letters, expected at most {self._settings.max_message_bytes}"
            )
        try:
            return _MESSAGE.validate_json(text)
        except ValidationError as error:
            raise _RefusedError(f"no message of this protocol: {message(error)}") from None

    async def _opened(self) -> Open:
        try:
            first = await self._hear(self._settings.head_seconds)
        except TimeoutError:
            raise _RefusedError(f"no message within {self._settings.head_seconds:g} s, expected open") from None
        if not isinstance(first, Open):
            raise _RefusedError(f"the first message is {first.type}, expected open")
        return first

    async def _read(self) -> None:
        ended = False
        while True:
            wait = self._heard + self._settings.stream_idle_seconds - time.monotonic()
            try:
                heard = await self._hear(max(wait, 0.0))
            except TimeoutError:
                if time.monotonic() - self._heard < self._settings.stream_idle_seconds:
                    continue  # frames went out meanwhile
                raise _RefusedError(f"nothing came for {self._settings.stream_idle_seconds:g} s") from None
            if isinstance(heard, Open):
                raise _RefusedError("open came twice, expected word or end")
            if ended:
                raise _RefusedError(f"{heard.type} came after the end")
            ended = isinstance(heard, End)
            await self._words.put((heard.gloss, time.monotonic()) if isinstance(heard, Say) else None)

    async def _make(self) -> None:
        while True:
            word = await self._words.get()
            if self._worker.generation != self._generation:
                raise KeyError(self._key)
            if word is None:
                for made in await self._worker.run(work.end_stream, self._key):
                    await self._out.put((made, time.monotonic()))
                await self._out.put(None)
                return
            token, came = word
            try:
                glosses, warnings = await self._worker.run(work.read, self._key, token)
                for warning in warnings:
                    await self._out.put(({"type": "warning", "warning": warning}, came))
                for gloss in glosses:  # a job each: others have their turn between the letters of a long name
                    for made in await self._worker.run(work.feed, self._key, gloss):
                        await self._out.put((made, came))
                    self._metrics.words.inc()
            except InputError as error:
                await self._out.put(({"type": "error", **failure(error)}, came))

    async def _send(self, paced: bool) -> None:
        zero, fps = 0.0, 30.0
        while (item := await self._out.get()) is not None:
            made, freed = item
            if isinstance(made, dict):
                fps = made.get("fps", fps)
                await self._deliver(made)
                continue
            _, first, n_frames, n_joints = FRAMES.unpack_from(made)
            if not paced:
                await self._deliver(made)
                self._metrics.frames.inc(n_frames)
                continue
            if first == 0:
                zero = time.monotonic()
            zero += max(0.0, freed - (zero + first / fps))  # the clock waits for words, not for work
            width = (len(made) - FRAMES.size) // n_frames
            for k in range(n_frames):
                due = zero + (first + k) / fps
                late = time.monotonic() - due
                if late < 0.0:
                    await asyncio.sleep(-late)
                self._metrics.late.observe(max(0.0, time.monotonic() - due))
                start = FRAMES.size + k * width
                await self._deliver(FRAMES.pack(MAGIC, first + k, 1, n_joints) + made[start : start + width])
                self._metrics.frames.inc()

    async def _deliver(self, made: dict[str, Any] | bytes) -> None:
        sent = (
            self._socket.send_bytes(made) if isinstance(made, bytes) else self._socket.send_text(to_json(made).decode())
        )
        await asyncio.wait_for(sent, self._settings.idle_seconds)
        self._heard = time.monotonic()
