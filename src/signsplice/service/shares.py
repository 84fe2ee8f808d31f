"""What clients hold of things that there are few of, so that one client cannot hold all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import IPv6Address, ip_address

from starlette.requests import HTTPConnection

from signsplice.service.workers import BusyError


def client_of(address: str | None) -> str:
    """Whose address this is: an IPv4 address, or the /64 network of an IPv6 address, which one client has whole."""
    try:
        parsed = ip_address((address or "").partition("%")[0])
    except ValueError:
        return address or ""
    if not isinstance(parsed, IPv6Address):
        return str(parsed)
    return str(parsed.ipv4_mapped or IPv6Address(int(parsed) >> 64 << 64))


class Shares:
    """How many of something are held: in all, and by each client.

    noun: what is held, for the message of the error.
    """

    def __init__(self, noun: str, limit: int, client_limit: int) -> None:
        self._noun, self._limit, self._client_limit = noun, limit, client_limit
        self._held: Counter[str] = Counter()

    @property
    def n_held(self) -> int:
        """How many are held in all."""
        return self._held.total()

    @contextmanager
    def hold(self, connection: HTTPConnection) -> Iterator[None]:
        """Hold one while the block runs. Raises ``BusyError`` where no more may be held."""
        client = client_of(connection.client.host if connection.client else None)
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
