"""Streams over WebSocket: words arrive one at a time, frames are sent as soon as they are final.

Frame k of a paced stream is due k / fps after the first frame. If words arrive too late, this clock waits for them, so
that the sentence resumes where it stopped. If the work is late, frames catch up.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, TypeVar
from uuid import uuid4

from pydantic import TypeAdapter, ValidationError
from starlette.requests import ClientDisconnect
from starlette.websockets import WebSocket, WebSocketDisconnect

from signsplice.errors import InputError, SignspliceError, UnknownGlossError
from signsplice.service import wire, work
from signsplice.service.avatars import UploadedAvatars
from signsplice.service.fair_queue import FairQueue
from signsplice.service.limits import caller, while_connected
from signsplice.service.monitoring import Metrics
from signsplice.service.scene import to_json
from signsplice.service.settings import Settings
from signsplice.service.workers import Worker, WorkerLostError, WorkerProcess

ResultT = TypeVar("ResultT")

_CLIENT_MESSAGE: TypeAdapter[wire.ClientMessage] = TypeAdapter(wire.ClientMessage)
_JOB_SECONDS = 0.02
"""Expected work of a stream's job, s: one word."""
_MAX_PREFETCHED = 16
"""Messages, each with the frames of at most one span, that are prepared ahead of the one being sent."""
GOING_AWAY = 1001
"""WebSocket close code: the client leaves."""
POLICY_VIOLATION = 1008
"""WebSocket close code: the client broke the protocol or a limit."""
TRY_AGAIN_LATER = 1013
"""WebSocket close code: the service is busy or failed."""


class _RefusedError(Exception):
    """The client broke the protocol or a limit, so the stream ends."""


def failure(error: BaseException) -> dict[str, Any]:
    """Return an error as ``wire.Failure``."""
    if isinstance(error, UnknownGlossError):
        return {"error": error.describe(), "unknown": {k: list(v) for k, v in error.unknown.items()}}
    return {"error": " ".join(str(error).split()), "unknown": {}}


def first_fault(error: ValidationError) -> str:
    """Return the first validation error in one line."""
    fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
    where = ".".join(str(part) for part in fault["loc"])
    return f"{where}: {fault['msg']}" if where else str(fault["msg"])


class StreamSession:
    """The stream of one client."""

    def __init__(
        self,
        socket: WebSocket,
        settings: Settings,
        queue: FairQueue,
        worker: Worker,
        metrics: Metrics,
        avatars: UploadedAvatars,
    ) -> None:
        self._socket, self._settings, self._metrics, self._avatars = socket, settings, metrics, avatars
        self._queue, self._worker = queue, worker
        self._key = uuid4().hex
        self._process: WorkerProcess
        self._words: asyncio.Queue[tuple[work.Typed, float] | None] = asyncio.Queue(settings.max_stream_words)
        self._out: asyncio.Queue[tuple[dict[str, Any] | bytes, float] | None] = asyncio.Queue(_MAX_PREFETCHED)
        self._last_activity = time.monotonic()
        self._is_working = False
        self._behind = 0.0  # delay of the client's reading against the motion, seconds

    async def run(self) -> None:
        """Serve the client until the stream is done or the client disconnects."""
        await self._socket.accept()
        try:
            await self._serve(await self._receive_opening())
            await self._socket.close()
        except* (WebSocketDisconnect, ClientDisconnect):
            pass
        except* (_RefusedError, SignspliceError, TimeoutError) as group:
            await self._fail(group)

    async def _serve(self, opening: wire.OpenMessage) -> None:
        job = work.open_stream, self._key, opening, self._avatars.content(opening.avatar)
        self._process, _ = await self._take_turn(lambda worker: worker.begin(*job))
        self._last_activity = time.monotonic()
        try:
            async with asyncio.TaskGroup() as tasks:
                side_tasks = [tasks.create_task(task) for task in (self._read(), self._make(), self._watch())]
                await self._send(opening.paced)
                for task in side_tasks:
                    task.cancel()
        finally:
            self._process.post(work.close_stream, self._key)  # does not wait: the process may be busy

    async def _watch(self) -> None:
        """Raise ``WorkerLostError`` when the process that holds this stream ends."""
        await self._process.ended.wait()
        raise WorkerLostError("the process that held this stream ended; open it again")

    async def _take_turn(self, job: Callable[[Worker], Coroutine[Any, Any, ResultT]]) -> ResultT:
        """Run a job at the stream's worker when it is the client's turn. Raises ``ClientDisconnect``."""
        turn = self._queue.run(caller(self._socket), [self._worker], _JOB_SECONDS, job)
        return await while_connected(self._socket, turn)

    async def _run_job(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        """Run one of the process's jobs on this stream; the client does not count as idle meanwhile."""
        self._is_working = True
        try:
            return await self._take_turn(lambda _: self._process.run(job, self._key, *args))
        finally:
            self._is_working = False
            self._last_activity = time.monotonic()

    async def _fail(self, group: BaseExceptionGroup[BaseException]) -> None:
        error: BaseException = group
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        is_slow = isinstance(error, TimeoutError)
        message = {"error": "the client is too slow", "unknown": {}} if is_slow else failure(error)
        with suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
            await self._deliver({"type": "error", **message})
            is_clients_fault = isinstance(error, _RefusedError | InputError)
            await self._socket.close(POLICY_VIOLATION if is_clients_fault else TRY_AGAIN_LATER)

    async def _receive(self, seconds: float) -> wire.ClientMessage:
        """Return the client's next message. Raises ``_RefusedError``, ``WebSocketDisconnect`` and ``TimeoutError``."""
        async with asyncio.timeout(seconds):  # not wait_for, which in Python 3.11 can swallow a cancellation
            event = await self._socket.receive()
        if event["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(event.get("code", GOING_AWAY))
        self._last_activity = time.monotonic()
        text = event.get("text")
        if text is None:
            raise _RefusedError("a binary message, expected JSON as text")
        if len(text) > self._settings.max_message_bytes:
            raise _RefusedError(
                f"a message of {len(text)} characters, expected at most {self._settings.max_message_bytes}"
            )
        try:
            return _CLIENT_MESSAGE.validate_json(text)
        except ValidationError as error:
            raise _RefusedError(f"no message of this protocol: {first_fault(error)}") from None

    async def _receive_opening(self) -> wire.OpenMessage:
        try:
            first = await self._receive(self._settings.head_seconds)
        except TimeoutError:
            raise _RefusedError(f"no message within {self._settings.head_seconds:g} s, expected open") from None
        if not isinstance(first, wire.OpenMessage):
            raise _RefusedError(f"the first message is {first.type}, expected open")
        return first

    async def _read(self) -> None:
        """Put the client's words into the queue; None at the end."""
        limit, has_ended = self._settings.stream_idle_seconds, False
        while True:
            remaining = self._last_activity + limit - time.monotonic()
            try:
                message = await self._receive(max(remaining, 0.0))
            except TimeoutError:
                if self._is_working:
                    self._last_activity = time.monotonic()
                if time.monotonic() - self._last_activity < limit:
                    continue  # the service was busy, or frames were sent
                raise _RefusedError(f"nothing came for {limit:g} s") from None
            if isinstance(message, wire.OpenMessage):
                raise _RefusedError("open came twice, expected word, text or end")
            if has_ended:
                raise _RefusedError(f"{message.type} came after the end")
            word = None if isinstance(message, wire.EndMessage) else (message, time.monotonic())
            has_ended = word is None
            await self._words.put(word)

    async def _make(self) -> None:
        """Turn words into messages, each with the arrival time of its words."""
        while True:
            word = await self._words.get()
            if word is None:
                for message in await self._run_job(work.end_stream):
                    await self._out.put((message, time.monotonic()))
                await self._out.put(None)
                return
            typed, arrival = word
            try:
                words, heads = await self._run_job(work.parse_message, typed)
                for head in heads:
                    await self._out.put((head, arrival))
                # One job per gloss, so that other streams are served between the letters of a long name.
                for line_gloss in words:
                    for message in await self._run_job(work.add_word, line_gloss):
                        await self._out.put((message, arrival))
                    self._metrics.words.inc()
            except InputError as error:
                await self._out.put(({"type": "error", **failure(error)}, arrival))

    async def _send(self, paced: bool) -> None:
        """Send messages until the stream is done; paced: one frame at a time, when it is due."""
        zero, fps = 0.0, 30.0
        while (item := await self._out.get()) is not None:
            message, arrival = item
            if isinstance(message, dict):
                fps = message.get("fps", fps)
                await self._deliver(message)
                continue
            _, first, n_frames, n_joints = wire.FRAMES_HEADER.unpack_from(message)
            if not paced:
                await self._deliver_motion(message, n_frames / fps)
                self._metrics.frames.inc(n_frames)
                continue
            if first == 0:
                zero = time.monotonic()
            zero += max(0.0, arrival - (zero + first / fps))  # the clock waits for words, not for work
            n_bytes = (len(message) - wire.FRAMES_HEADER.size) // n_frames
            for k in range(n_frames):
                due = zero + (first + k) / fps
                late = time.monotonic() - due
                if late < 0.0:
                    await asyncio.sleep(-late)
                self._metrics.late.observe(max(0.0, time.monotonic() - due))
                start = wire.FRAMES_HEADER.size + k * n_bytes
                header = wire.FRAMES_HEADER.pack(wire.FRAMES_MAGIC, first + k, 1, n_joints)
                await self._deliver_motion(header + message[start : start + n_bytes], 1 / fps)
                self._metrics.frames.inc()

    async def _deliver_motion(self, message: bytes, seconds: float) -> None:
        """Deliver frames that play for ``seconds``. Raises ``TimeoutError`` if the client reads persistently more
        slowly than they play, to free its place.
        """
        began = time.monotonic()
        await self._deliver(message)
        self._behind = max(0.0, self._behind + time.monotonic() - began - seconds)
        if self._behind > self._settings.idle_seconds:
            raise TimeoutError

    async def _deliver(self, message: dict[str, Any] | bytes) -> None:
        async with asyncio.timeout(self._settings.idle_seconds):
            if isinstance(message, bytes):
                await self._socket.send_bytes(message)
            else:
                await self._socket.send_text(to_json(message).decode())
        self._last_activity = time.monotonic()
