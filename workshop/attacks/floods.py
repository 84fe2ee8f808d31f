"""Floods the service by one connection or many, or by work, and measures honest callers: `python attacks/floods.py
[NAME ...]`.

Before and during every flood four paced streams are open, /healthz is asked ten times a second, and another client
asks for HELLO and for streams. All run on this machine, the attacker in its own process, with equal priority. Prints a
row of a Markdown table for each.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from itertools import chain, cycle, islice
from pathlib import Path
from urllib.parse import urlsplit

import httpx
from websockets.exceptions import ConnectionClosed, InvalidMessage
from websockets.sync.client import connect

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
import service_callers as callers
from service_callers import WORDS, CallerRecord, encode_word, get_stream_address
from serving import http_client, wait_until_warm

_SECONDS = 10.0
"""Greatest length of a flood, s."""
_REST_S = 2.0
"""Time that callers are watched before and after a flood, s."""
_N_STREAMS = 4
_MB = 1_000_000
_OTHER = ("127.0.0.2", 0)
"""Another address than that of honest callers."""

Flood = Callable[[str, int, float], str]


_GET = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n"
_POST = b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
_CHUNKED = _POST + b"Transfer-Encoding: chunked\r\n\r\n"
_UPGRADE = (
    b"GET /v1/stream HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)


def _encode_frame(opcode: int, payload: bytes = b"", fin: int = 0x80) -> bytes:
    """Returns a frame of at most 125 bytes as a client sends it, masked with zeros."""
    return bytes([fin | opcode, 0x80 | len(payload)]) + bytes(4) + payload


def _send(
    head: bytes, block: bytes, host: str, port: int, deadline: float, *, pause: float = 0.0, first_frame: bytes = b"",
    limit: int = 60 * _MB,
) -> str:  # fmt: skip
    """Sends a head and blocks over one connection, one after each pause or many at once, of ``limit`` bytes at most;
    returns the amount sent and the end of the connection. ``first_frame``: sent before the blocks of a WebSocket.
    """
    sent, start = 0, time.monotonic()
    part = block if pause else block * max(1, 65536 // len(block))
    with socket.create_connection((host, port), timeout=max(1.0, deadline - time.monotonic())) as connection:
        try:
            connection.sendall(head)
            if head is _UPGRADE:  # a client may send frames when it has the answer
                connection.recv(4096)
                connection.sendall(first_frame)
            while sent < limit and time.monotonic() <= deadline:
                connection.sendall(part)
                sent += len(part)
                time.sleep(pause)
            ending = "sent all" if time.monotonic() < deadline else "not closed"
        except TimeoutError:
            ending = "blocked until the end"
        except OSError:
            seconds = time.monotonic() - start
            ending = f"closed after {seconds:.1f} s" if seconds >= 0.05 else "closed at once"
        answer = b""
        connection.settimeout(0.5)
        with suppress(OSError):
            answer = connection.recv(4096)
        line = answer.split(b"\r\n")[0].decode("latin-1").removeprefix("HTTP/1.1 ") if answer[:4] == b"HTTP" else ""
    if line and ending == "not closed":
        ending = "closed at the end"
    return f"{sent / _MB:.1f} MB, {ending}" + (f" ({line})" if line else "")


def _open_many_connections(host: str, port: int, deadline: float) -> str:
    """Opens 1,200 connections from another address, each with an unfinished head."""
    with ExitStack() as stack:
        connections: list[socket.socket] = []
        for _ in range(1200):
            with suppress(OSError):
                connection = socket.create_connection((host, port), timeout=2.0, source_address=_OTHER)
                connections.append(stack.enter_context(connection))
                connection.sendall(_GET)
        time.sleep(max(0.0, deadline - time.monotonic()))
        n_open = 0
        for connection in connections:
            connection.settimeout(0.0)
            with suppress(OSError):
                try:
                    connection.recv(4096)
                except BlockingIOError:
                    n_open += 1
        n_refused = len(connections) - n_open
        return f"{len(connections)} connections, {n_refused} refused, {n_open} open at the end"


def _flood_repeatedly(host: str, port: int, deadline: float) -> str:
    """Sends endless headers, on a new connection whenever one is closed."""
    n_connections = 0
    while time.monotonic() < deadline:
        with suppress(OSError):
            _send(_GET + b"X: ", b"a", host, port, min(deadline, time.monotonic() + 1.0), limit=2 * _MB)
        n_connections += 1
    return f"{n_connections} connections, one after another"


def _make_post(glosses: Sequence[str], file: str) -> bytes:
    body = json.dumps({"glosses": list(glosses)}).encode()
    head = f"POST /v1/sentence?file={file} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return head.encode() + b"Content-Length: %d\r\n\r\n" % len(body) + body


def _ask_at_once(request: bytes, host: str, port: int, deadline: float) -> str:
    """Asks for the same on 32 connections of one other address, again after each answer."""

    def ask(host: str, port: int, deadline: float) -> list[str]:
        outcomes: list[str] = []
        while (remaining := deadline - time.monotonic()) > 0.0:
            try:
                with socket.create_connection((host, port), remaining, _OTHER) as connection:
                    connection.sendall(request)
                    outcomes.append(connection.recv(12)[9:].decode() or "closed")
                    time.sleep(0.05)
            except OSError as error:
                outcomes.append("no answer" if isinstance(error, TimeoutError) else "closed")
        return outcomes

    with ThreadPoolExecutor(32) as pool:
        counts = Counter(chain(*pool.map(ask, [host] * 32, [port] * 32, [deadline] * 32)))
    forgotten = _time_until_forgotten(host, port)
    return ", ".join(f"{count} times {outcome}" for outcome, count in counts.items()) + f"; {forgotten}"


def _time_until_forgotten(host: str, port: int) -> str:
    """Returns how long requests remain that nobody waits for any more; HELLO of others is one at a time at most."""
    start = time.monotonic()
    while time.monotonic() - start < 60.0:
        if httpx.get(f"http://{host}:{port}/healthz", timeout=10.0).json()["waiting"] <= 1:
            return f"forgotten after {time.monotonic() - start:.1f} s"
        time.sleep(0.02)
    return "held after 60 s"


def _hang_up_at_once(addresses: Sequence[str], content: bytes, host: str, port: int, deadline: float) -> str:
    """Opens 16 connections that send requests and hang up, whenever the last ones are forgotten."""
    outcomes = []
    while time.monotonic() < deadline:
        with ExitStack() as stack:
            for k in range(16):
                source = (addresses[k % len(addresses)], 0)
                connection = socket.create_connection((host, port), timeout=10.0, source_address=source)
                stack.enter_context(connection).sendall(content)
            time.sleep(0.5)
        outcomes.append(_time_until_forgotten(host, port))
    return f"{len(outcomes)} times 16, {max(outcomes)}"


def _stream_at_once(words: Sequence[str], host: str, port: int, deadline: float) -> str:
    """Reads 50 unpaced streams of one other address, and opens the next one when one is done."""

    def read(uri: str, deadline: float) -> int:
        n_frames = 0
        while time.monotonic() < deadline:
            with (
                suppress(ConnectionClosed, InvalidMessage, OSError, TimeoutError),
                connect(uri, source_address=_OTHER, **callers.STREAM_OPTIONS) as stream,
            ):
                stream.send('{"type": "open", "paced": false}')
                for gloss in islice(cycle(words), 30):
                    stream.send(encode_word(gloss))
                stream.send('{"type": "end"}')
                while time.monotonic() < deadline:
                    message = stream.recv(timeout=10.0)
                    n_frames += int.from_bytes(message[8:12], "little") if isinstance(message, bytes) else 0
        return n_frames

    address = get_stream_address(f"http://{host}:{port}")
    with ThreadPoolExecutor(50) as pool:
        return f"{sum(pool.map(read, [address] * 50, [deadline] * 50))} frames"


_FILM, _SENTENCE = _make_post(WORDS * 7, "gif"), _make_post(WORDS * 4, "bvh")
_FORMS = ["1-GIVE-2", "2-GIVE-1", "1-GIVE-3", "3-GIVE-1", "1-ASK-2", "2-ASK-1", "1-ASK-3", "3-ASK-1"]
_ADDRESSES = [f"127.0.0.{k}" for k in range(2, 18)]

FLOODS: dict[str, Flood] = {
    "none": lambda host, port, deadline: "",
    "endless header value": partial(_send, _GET + b"X: ", b"a"),
    "endless URL": partial(_send, b"GET /", b"a"),
    "many headers": partial(_send, _GET, b"X-T: aaaaaaaaaa\r\n"),
    "endless chunk trailer": partial(_send, _CHUNKED + b"2\r\n{}\r\n0\r\n", b"X-T: aaaaaaaaaa\r\n"),
    "endless trailer behind an answer": partial(_send, _GET + b"Transfer-Encoding: chunked\r\n\r\n0\r\nX: ", b"a"),
    "endless chunk extension": partial(_send, _CHUNKED + b"2;", b"a"),
    "chunks of one byte": partial(_send, _CHUNKED, b"1\r\n \r\n"),
    "pipelined requests": partial(_send, b"", _GET + b"\r\n"),
    "WebSocket pings": partial(_send, _UPGRADE, _encode_frame(9)),
    "WebSocket pings of 125 bytes": partial(_send, _UPGRADE, _encode_frame(9, bytes(125))),
    "WebSocket pongs": partial(_send, _UPGRADE, _encode_frame(10)),
    "WebSocket fragments": partial(_send, _UPGRADE, _encode_frame(0, fin=0), first_frame=_encode_frame(1, b"{", fin=0)),
    "WebSocket messages": partial(_send, _UPGRADE, _encode_frame(1, b"{}")),
    "WebSocket words": partial(_send, _UPGRADE, _encode_frame(1, encode_word("-").encode()),
                              first_frame=_encode_frame(1, b'{"type": "open"}')),
    "slow head": partial(_send, _GET + b"X: ", b"a", pause=0.1),
    "slow body": partial(_send, _POST + b"Content-Length: 1000\r\n\r\n", b" ", pause=0.1),
    "slow trailer": partial(_send, _CHUNKED + b"0\r\n", b"X: a\r\n", pause=0.1),
    "many connections": _open_many_connections,
    "flood after flood": _flood_repeatedly,
    "32 films of 160 glosses": partial(_ask_at_once, _make_post((WORDS * 23)[:160], "gif")),
    "32 films of 49 glosses": partial(_ask_at_once, _FILM),
    "32 sheets of 49 glosses": partial(_ask_at_once, _make_post(WORDS * 7, "png")),
    "32 sentences of 28 glosses": partial(_ask_at_once, _SENTENCE),
    "32 sentences of forms": partial(_ask_at_once, _make_post(_FORMS, "bvh")),
    "films, clients hang up": partial(_hang_up_at_once, ["127.0.0.2"], _FILM),
    "films, clients of 16 addresses hang up": partial(_hang_up_at_once, _ADDRESSES, _FILM),
    "pipelined films, clients of 16 addresses hang up": partial(_hang_up_at_once, _ADDRESSES, 3 * _FILM),
    "sentences, clients of 16 addresses hang up": partial(_hang_up_at_once, _ADDRESSES, _SENTENCE),
    "50 unpaced streams": partial(_stream_at_once, WORDS),
    "50 unpaced streams of forms": partial(_stream_at_once, _FORMS),
}  # fmt: skip


def _attack(name: str, host: str, port: int, start: float, end: float) -> str:
    time.sleep(max(0.0, start - time.monotonic()))
    return FLOODS[name](host, port, end)


async def _measure_flood(address: str, name: str) -> tuple[str, str]:
    """Returns what honest callers saw before and during a flood, and what the attacker did."""
    url, record = urlsplit(address), CallerRecord()
    start = time.monotonic() + 5.0  # the attacker's process and the streams start
    end = start + _SECONDS
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        attacker = pool.apply_async(_attack, (name, url.hostname, url.port, start, end))
        honest = [callers.play_paced_stream(address, record, end + _REST_S, number) for number in range(_N_STREAMS)]
        honest += [call(address, record, end + _REST_S) for call in (callers.watch_health, callers.call_again)]
        await asyncio.gather(*honest)
        try:
            attacker_outcome = await asyncio.to_thread(attacker.get, 70.0)
        except multiprocessing.TimeoutError:
            attacker_outcome = "the attacker hangs"
    return record.row(start, end), attacker_outcome


def main(names: list[str]) -> None:
    """Prints a row for each flood, after a run that is not measured: the first one loads files into memory."""
    print(f"| flood beside four paced streams ({os.cpu_count()} cores) | seen |\n| --- | --- |")
    for number, name in enumerate(["none", *(names or FLOODS)]):
        with http_client("serve") as client:
            wait_until_warm(client)
            seen, attacker_outcome = asyncio.run(_measure_flood(str(client.base_url).rstrip("/"), name))
            if number:
                print(f"| {name} | {seen}; the attacker: {attacker_outcome or '-'} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
