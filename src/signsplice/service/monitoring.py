"""Monitoring of the service: counters for Prometheus, and log lines about disconnected clients, one a minute."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOG = logging.getLogger("signsplice.service")
_QUIET_SECONDS = 60.0
_INCOMPLETE = "ASGI callable returned without"
"""Start of uvicorn's message if a client left before the answer, or the handshake of a stream, was complete."""


class RateLimit(logging.Filter):
    """Passes each line once a minute; the next one that passes reports how many were dropped."""

    def __init__(self) -> None:
        super().__init__()
        self._passed: dict[str, float] = {}
        self._n_left_out: dict[str, int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the record passes."""
        line, now = record.getMessage(), time.monotonic()
        if now - self._passed.get(line, -_QUIET_SECONDS) < _QUIET_SECONDS:
            self._n_left_out[line] = self._n_left_out.get(line, 0) + 1
            return False
        self._passed[line] = now
        n = self._n_left_out.pop(line, 0)
        if n:
            record.msg, record.args = f"{line} ({n} more since this was last said)", None
        return True


class GoneClients(logging.Filter):
    """Replaces another library's traceback by one line if a disconnected client is its only cause."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the record passes unchanged."""
        error = record.exc_info[1] if record.exc_info else None
        is_closed = isinstance(error, RuntimeError) and "the handler is closed" in str(error)
        if isinstance(error, ConnectionError | ClientDisconnect) or is_closed or _INCOMPLETE in record.getMessage():
            LOG.warning("a client hung up before it had its answer")
            return False
        return True


def quieten() -> None:
    """Install the filters; called after uvicorn has set up its loggers."""
    for name, kind in ((LOG.name, RateLimit), ("uvicorn.error", GoneClients), ("asyncio", GoneClients)):
        logger = logging.getLogger(name)
        if not any(isinstance(entry, kind) for entry in logger.filters):
            logger.addFilter(kind())


_SECONDS = (0.01, 0.025, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0)
_LATE_SECONDS = (0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)


class Metrics:
    """Counters of one service, in their own registry."""

    def __init__(
        self, waiting: Callable[[], int], lost: Callable[[], int], wait_seconds: Callable[[], float] = float
    ) -> None:
        registry = self.registry = CollectorRegistry()
        labels = ("route", "method", "status")
        self.requests = Counter("signsplice_requests", "Requests answered.", labels, registry=registry)
        self.seconds = Histogram(
            "signsplice_request_seconds", "Time to an answer.", labels[:1], buckets=_SECONDS, registry=registry
        )
        self.streams = Gauge("signsplice_streams", "Open streams.", registry=registry)
        self.words = Counter("signsplice_stream_words", "Words of streams that were signed.", registry=registry)
        self.frames = Counter("signsplice_stream_frames", "Frames that streams sent.", registry=registry)
        late = "Delay of a paced frame after the time when it was due."
        self.late = Histogram("signsplice_stream_late_seconds", late, buckets=_LATE_SECONDS, registry=registry)
        Gauge("signsplice_jobs", "Requests that run or wait.", registry=registry).set_function(waiting)
        longest = "How long the job that has waited longest has waited for its turn."
        Gauge("signsplice_wait_seconds", longest, registry=registry).set_function(wait_seconds)
        Gauge("signsplice_workers_lost", "Worker processes replaced.", registry=registry).set_function(lost)

    def text(self) -> bytes:
        """Return all counters in Prometheus' text format."""
        return generate_latest(self.registry)


class CountRequests:
    """ASGI middleware that counts and times requests by route; "none" for requests without a route."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app, self.metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        start = time.perf_counter()

        async def counting_send(message: Message) -> None:
            if message["type"] == "http.response.start":  # before the answer is sent, so that the next request sees it
                route = getattr(scope.get("route"), "path", "none")
                self.metrics.requests.labels(route, scope["method"], str(message["status"])).inc()
                self.metrics.seconds.labels(route).observe(time.perf_counter() - start)
            await send(message)

        await self.app(scope, receive, counting_send)
