"""Floods of one connection or many, and what honest callers see beside each: `python attacks/floods.py [NAME ...]`.

For every flood four paced streams are open and /healthz is asked ten times a second. All run on this machine, the
attacker in a process of its own, with equal priority. Prints a row of a Markdown table for each.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from urllib.parse import urlsplit

from service_callers import Seen, paced_stream, serving, watch_health

_SECONDS = 10.0
"""How long a flood runs at most."""
_REST_S = 2.0
"""How long callers are watched before and after it."""
_N_STREAMS = 4
_MB = 1_000_000
_LIMIT = 60 * _MB
"""Bytes that a flood sends at most."""

Flood = Callable[[str, int, float], str]


def _get(path: str = "/healthz") -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: localhost\r\n".encode()


_POST = b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
_CHUNKED = _POST + b"Transfer-Encoding: chunked\r\n\r\n"
_UPGRADE = (
    b"GET /v1/stream HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)


def _frame(opcode: int, payload: bytes = b"", fin: bool = True) -> bytes:
    """A frame as a client sends it, masked with zeros."""
    size = bytes([0x80 | len(payload)]) if len(payload) < 126 else struct.pack("!BH", 0x80 | 126, len(payload))
    return bytes([(0x80 if fin else 0) | opcode]) + size + bytes(4) + payload


def _repeated(block: bytes, n_bytes: int = _LIMIT) -> Iterator[bytes]:
    piece = block * max(1, 65536 // len(block))
    for _ in range(n_bytes // len(piece)):
        yield piece


def _send(
    host: str, port: int, until: float, head: bytes, parts: Iterator[bytes], pause: float = 0.0, first: bytes = b""
) -> str:
    """What one connection sends, and how it ended. ``first``: frame of a WebSocket before the parts."""
    sent, start = 0, time.monotonic()
    connection = socket.create_connection((host, port), timeout=max(1.0, until - time.monotonic()))
    with connection:
        try:
            connection.sendall(head)
            if head is _UPGRADE:  # a client may send frames when it has the answer
                connection.recv(4096)
                connection.sendall(first)
            for part in parts:
                if time.monotonic() > until:
                    break
                connection.sendall(part)
                sent += len(part)
                time.sleep(pause)
            how = "sent all" if time.monotonic() < until else "not closed"
        except TimeoutError:
            how = "blocked until the end"
        except OSError:
            seconds = time.monotonic() - start
            how = f"closed after {seconds:.1f} s" if seconds >= 0.05 else "closed at once"
        answer = b""
        connection.settimeout(0.5)
        with suppress(OSError):
            answer = connection.recv(4096)
        line = answer.split(b"\r\n")[0].decode("latin-1").removeprefix("HTTP/1.1 ") if answer[:4] == b"HTTP" else ""
    if line and how == "not closed":
        how = "closed at the end"
    return f"{sent / _MB:.1f} MB, {how}" + (f" ({line})" if line else "")


def _one(head: bytes, block: bytes) -> Flood:
    return lambda host, port, until: _send(host, port, until, head, _repeated(block))


def _frames(block: bytes, first: bytes = b"") -> Flood:
    return lambda host, port, until: _send(host, port, until, _UPGRADE, _repeated(block), first=first)


def _drip(head: bytes, block: bytes) -> Flood:
    return lambda host, port, until: _send(host, port, until, head, iter([block] * 200), pause=0.1)


def _many_connections(host: str, port: int, until: float) -> str:
    """1,200 connections from another address, each with an unfinished head."""
    held: list[socket.socket] = []
    try:
        for _ in range(1200):
            with suppress(OSError):
                held.append(socket.create_connection((host, port), timeout=2.0, source_address=("127.0.0.2", 0)))
                held[-1].sendall(_get())
        time.sleep(max(0.0, until - time.monotonic()))
        n_open = n_refused = 0
        for connection in held:
            connection.settimeout(0.0)
            try:
                n_refused += connection.recv(4096).startswith(b"HTTP/1.1 503")
            except BlockingIOError:
                n_open += 1
            except OSError:
                n_refused += 1
        return f"{len(held)} connections, {n_refused} refused, {n_open} open at the end"
    finally:
        for connection in held:
            connection.close()


def _many_flooders(host: str, port: int, until: float) -> str:
    """Endless headers, on a new connection whenever one is closed."""
    n = 0
    while time.monotonic() < until:
        with suppress(OSError):
            _send(host, port, min(until, time.monotonic() + 1.0), _get() + b"X: ", _repeated(b"a", 2 * _MB))
        n += 1
    return f"{n} connections, one after another"


FLOODS: dict[str, Flood] = {
    "none": lambda host, port, until: "",
    "endless header value": _one(_get() + b"X: ", b"a"),
    "endless URL": _one(b"GET /", b"a"),
    "many headers": _one(_get(), b"X-T: aaaaaaaaaa\r\n"),
    "endless chunk trailer": _one(_CHUNKED + b"2\r\n{}\r\n0\r\n", b"X-T: aaaaaaaaaa\r\n"),
    "endless trailer behind an answer": _one(_get() + b"Transfer-Encoding: chunked\r\n\r\n0\r\nX: ", b"a"),
    "endless chunk extension": _one(_CHUNKED + b"2;", b"a"),
    "chunks of one byte": _one(_CHUNKED, b"1\r\n \r\n"),
    "pipelined requests": _one(b"", _get() + b"\r\n"),
    "WebSocket pings": _frames(_frame(9)),
    "WebSocket pings of 125 bytes": _frames(_frame(9, bytes(125))),
    "WebSocket pongs": _frames(_frame(10)),
    "WebSocket fragments": _frames(_frame(0, fin=False), _frame(1, b"{", fin=False)),
    "WebSocket messages": _frames(_frame(1, b"{}")),
    "WebSocket words": _frames(_frame(1, b'{"type": "word", "gloss": "-"}'), _frame(1, b'{"type": "open"}')),
    "slow head": _drip(_get() + b"X: ", b"a"),
    "slow body": _drip(_POST + b"Content-Length: 1000\r\n\r\n", b" "),
    "slow trailer": _drip(_CHUNKED + b"0\r\n", b"X: a\r\n"),
    "many connections": _many_connections,
    "flood after flood": _many_flooders,
}


def _attack(name: str, host: str, port: int, until: float, answer: Connection) -> None:
    answer.send(FLOODS[name](host, port, until))


async def _beside(address: str, name: str) -> tuple[Seen, str]:
    """What honest callers see beside a flood, and what the attacker does."""
    url = urlsplit(address)
    near, far = multiprocessing.get_context("spawn").Pipe()
    start = time.monotonic() + 3.0  # the attacker's process and the streams start
    until = start + _SECONDS
    seen = Seen()
    arguments = (name, url.hostname, url.port, until, far)
    attacker = multiprocessing.get_context("spawn").Process(target=_start_at, args=(start, *arguments), daemon=True)
    attacker.start()
    callers = [paced_stream(address, seen, until + _REST_S, number) for number in range(_N_STREAMS)]
    await asyncio.gather(*callers, watch_health(address, seen, until + _REST_S))
    how = await asyncio.to_thread(near.recv) if await asyncio.to_thread(near.poll, 10.0) else "the attacker hangs"
    attacker.kill()
    return seen, how


def _start_at(start: float, *arguments: object) -> None:
    time.sleep(max(0.0, start - time.monotonic()))
    _attack(*arguments)  # type: ignore[arg-type]


def main(names: list[str]) -> None:
    """Print a row for each flood, after a run that is not measured: the first one reads what is not in memory yet."""
    with serving() as (address, _):
        asyncio.run(_beside(address, "none"))
    print(f"| flood beside four paced streams ({os.cpu_count()} cores) | seen |\n| --- | --- |")
    for name in names or FLOODS:
        with serving() as (address, _):
            warm_up = Seen()
            asyncio.run(paced_stream(address, warm_up, time.monotonic() + 6.0))  # workers start
            seen, how = asyncio.run(_beside(address, name))
            print(f"| {name} | {seen.row()}; the attacker: {how or '-'} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
