"""The clock of answers that a client does not read, on a clock of the test's own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from signsplice.service.protocols import UnreadWatch
from signsplice.service.settings import Settings

IDLE, WHOLE = 2.0, 10.0


class Client:
    """A client that reads an answer as the test has it.

    n_unread: bytes of the answer that it has not read.
    aborted_at: when its connection was closed, seconds.
    """

    def __init__(self, n_unread: int) -> None:
        self.n_unread, self.now = n_unread, 0.0
        self.aborted_at: float | None = None
        self.due: list[tuple[float, Callable[[], None]]] = []
        self.of_clients: Counter[str] = Counter()
        loop: Any = SimpleNamespace(time=lambda: self.now, call_later=self.call_later)
        transport: Any = SimpleNamespace(
            get_write_buffer_size=lambda: self.n_unread, get_extra_info=lambda name: None, abort=self.abort
        )
        settings = Settings(idle_seconds=IDLE, body_seconds=WHOLE)
        protocol: Any = SimpleNamespace(
            transport=transport, loop=loop, settings=settings, client_name="it", n_unread=self.of_clients
        )
        self.watch = UnreadWatch(protocol)
        self.watch.start()

    def call_later(self, seconds: float, call: Callable[[], None]) -> Any:
        row = (self.now + seconds, call)
        self.due.append(row)
        return SimpleNamespace(cancel=lambda: self.due.remove(row) if row in self.due else None)

    def abort(self) -> None:
        self.aborted_at = self.now

    def wait(self, seconds: float, bytes_a_second: float) -> None:
        """Let time go by in steps of .1 s while bytes are read."""
        for _ in range(round(10 * seconds)):
            self.now += 0.1
            self.n_unread = max(0, self.n_unread - round(bytes_a_second / 10))
            for row in [row for row in self.due if row[0] <= self.now]:
                self.due.remove(row)
                row[1]()


@pytest.mark.parametrize(("bytes_a_second", "expected"), [(0, IDLE), (20, WHOLE)])
def test_an_answer_that_is_not_read_or_trickles_gives_its_connection_back(
    bytes_a_second: float, expected: float
) -> None:
    client = Client(1_000_000)
    client.wait(20.0, bytes_a_second)
    assert client.aborted_at == pytest.approx(expected, abs=1.0)
    assert not client.of_clients


def test_a_client_that_reads_in_time_keeps_its_connection() -> None:
    client = Client(1000)
    assert client.of_clients["it"] == 1
    client.wait(30.0, 150)
    assert client.aborted_at is None
    assert not client.of_clients
    assert not client.due


def test_a_second_answer_starts_no_second_clock() -> None:
    client = Client(1000)
    client.watch.start()
    assert client.of_clients["it"] == len(client.due) == 1
    client.watch.stop_if_read()
    assert client.due
    client.n_unread = 0
    client.watch.stop_if_read()
    assert not client.due
    assert not client.of_clients
