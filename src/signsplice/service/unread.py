"""Answers that a client does not read: a clock for each connection, and how many each client has."""

from __future__ import annotations

import asyncio
import sys
from collections import Counter
from contextlib import suppress

from signsplice.service.monitoring import LOG
from signsplice.service.settings import Settings

try:
    import fcntl
    import termios
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_CHECK_SECONDS = 0.5
"""How often it is looked whether a client has read its answer."""


class UnreadWatch:
    """Closes a connection whose client reads nothing of an answer within ``idle_seconds``, or not all of it within
    ``body_seconds``.

    of_clients: how many connections of each client have an answer that it has not read.
    """

    def __init__(
        self,
        transport: asyncio.Transport,
        loop: asyncio.AbstractEventLoop,
        client: str,
        of_clients: Counter[str],
        settings: Settings,
    ) -> None:
        self._transport, self._loop, self._settings = transport, loop, settings
        self._client, self._of_clients = client, of_clients
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
        """Stop the clock where nothing waits to be read."""
        if not self._transport.get_write_buffer_size():
            self.stop()

    def _n_unread(self) -> int:
        """Bytes of answers that the client's machine has not confirmed. The system holds some MB of them, and takes
        more only when a good part is gone: without these a slow client would seem to read nothing for long.
        """
        held, end = bytearray(4), self._transport.get_extra_info("socket")
        if fcntl is not None and end is not None:
            with suppress(OSError):  # a system that does not tell
                fcntl.ioctl(end.fileno(), termios.TIOCOUTQ, held)
        return self._transport.get_write_buffer_size() + int.from_bytes(held, sys.byteorder)

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
