"""Counters of the service, for Prometheus."""

from __future__ import annotations

import time
from collections.abc import Callable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_SECONDS = (0.01, 0.025, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0)


class Metrics:
    """The counters of one service, in their own registry."""

    def __init__(self, waiting: Callable[[], int], lost: Callable[[], int]) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "signsplice_requests", "Requests answered.", ("route", "method", "status"), registry=self.registry
        )
        self.seconds = Histogram(
            "signsplice_request_seconds", "Time to an answer.", ("route",), buckets=_SECONDS, registry=self.registry
        )
        self.streams = Gauge("signsplice_streams", "Open streams.", registry=self.registry)
        self.words = Counter("signsplice_stream_words", "Words of streams that were signed.", registry=self.registry)
        self.frames = Counter("signsplice_stream_frames", "Frames that streams sent.", registry=self.registry)
        self.late = Histogram(
            "signsplice_stream_late_seconds",
            "Delay of a paced frame after the time when it was due.",
            buckets=(0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0),
            registry=self.registry,
        )
        Gauge("signsplice_jobs", "Jobs that run or wait.", registry=self.registry).set_function(waiting)
        Gauge("signsplice_workers_lost", "Worker processes replaced.", registry=self.registry).set_function(lost)

    def text(self) -> bytes:
        """All counters in Prometheus' text format."""
        return generate_latest(self.registry)


class CountRequests:
    """ASGI middleware that counts and times requests by route; those without a route count as route "none"."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app, self.metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        start = time.perf_counter()

        async def counting_send(message: Message) -> None:
            if message["type"] == "http.response.start":  # before the answer is out, so that the next request sees it
                route = getattr(scope.get("route"), "path", "none")
                self.metrics.requests.labels(route, scope["method"], str(message["status"])).inc()
                self.metrics.seconds.labels(route).observe(time.perf_counter() - start)
            await send(message)

        await self.app(scope, receive, counting_send)
