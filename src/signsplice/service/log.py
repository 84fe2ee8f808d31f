"""What the service says on standard error of clients that are gone: a line a minute, whatever they do."""

from __future__ import annotations

import logging
import time

from starlette.requests import ClientDisconnect

LOG = logging.getLogger("signsplice.service")
_QUIET_SECONDS = 60.0
_INCOMPLETE = "ASGI callable returned without"
"""How uvicorn begins when a client was gone before the answer, or the handshake of a stream, was complete."""


class RateLimit(logging.Filter):
    """Lets a line pass once a minute; the next that passes says how many were left out."""

    def __init__(self) -> None:
        super().__init__()
        self._passed: dict[str, float] = {}
        self._n_left_out: dict[str, int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the record passes."""
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
    """One line of ours in place of another library's traceback, where a client that is gone is its only reason."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the record passes as it is."""
        error = record.exc_info[1] if record.exc_info else None
        is_closed = isinstance(error, RuntimeError) and "the handler is closed" in str(error)
        if isinstance(error, ConnectionError | ClientDisconnect) or is_closed or _INCOMPLETE in record.getMessage():
            LOG.warning("a client hung up before it had its answer")
            return False
        return True


def quieten() -> None:
    """Put the filters in place; called when uvicorn has set up its loggers."""
    for name, kind in ((LOG.name, RateLimit), ("uvicorn.error", GoneClients), ("asyncio", GoneClients)):
        logger = logging.getLogger(name)
        if not any(isinstance(entry, kind) for entry in logger.filters):
            logger.addFilter(kind())
