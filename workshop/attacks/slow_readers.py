"""Attacks by clients that do not read, read slowly, hang up, or call at once: ``python attacks/slow_readers.py``.

Each row has its own service with short limits. Prints a Markdown table; exit status 1 if a row is not as it must be.
Takes a minute.
"""

from __future__ import annotations

import json
import socket
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from service_callers import WORDS, start_service

_LIMITS = ("idle_seconds=4", "body_seconds=9", "max_client_waiting=4", "max_connections=100")
_OPTIONS = [f"--limit={limit}" for limit in _LIMITS]
_BODY = json.dumps({"glosses": list(WORDS) * 6, "formats": ["bvh", "glb"]}).encode()
_REQUEST = b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
_REQUEST += b"Content-Length: %d\r\n\r\n" % len(_BODY) + _BODY
_PATIENCE_S = 30.0


def _connect(address: str, source: str = "127.0.0.1") -> socket.socket:
    """Opens a connection whose end here buffers little."""
    url, client = urlsplit(address), socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.bind((source, 0))
    client.connect((url.hostname, url.port))
    client.settimeout(_PATIENCE_S)
    return client


def _ask(address: str, source: str = "127.0.0.1") -> socket.socket:
    """Opens a connection that asks for an answer of some MB."""
    client = _connect(address, source)
    client.sendall(_REQUEST)
    return client


def _wait_until(is_done: Callable[[], bool], read: Callable[[], object], pause: float) -> float:
    """Returns the seconds until something is done; calls ``read`` at every pause."""
    start = time.monotonic()
    while time.monotonic() - start < _PATIENCE_S and not is_done():
        with suppress(OSError, ConnectionClosed, TimeoutError):
            read()
        time.sleep(pause)
    return time.monotonic() - start


def _wait_until_closed(
    service: psutil.Process, client: socket.socket, read: Callable[[], object], pause: float
) -> float:
    """Returns the seconds until the service closes a connection; calls ``read`` at every pause."""
    port = client.getsockname()[1]

    def is_closed() -> bool:
        return not any(
            connection.raddr and connection.raddr.port == port for connection in service.net_connections("tcp")
        )

    return _wait_until(is_closed, read, pause)


def leave_unread(address: str, service: psutil.Process, log: Path) -> tuple[str, bool]:
    """Reads one byte of an answer."""
    with _ask(address) as client:
        client.recv(1)
        seconds = _wait_until_closed(service, client, lambda: None, 0.1)
    return f"closed after {seconds:.1f} s", seconds < 10.0


def read_slowly(address: str, service: psutil.Process, log: Path) -> tuple[str, bool]:
    """Reads 4 kB of an answer a second."""
    with _ask(address) as client:
        client.recv(1)
        seconds = _wait_until_closed(service, client, lambda: client.recv(2000), 0.5)
    return f"closed after {seconds:.1f} s", seconds < 15.0


def leave_share_unread(address: str, service: psutil.Process, log: Path) -> tuple[str, bool]:
    """Leaves twelve answers unread, in turn, on connections of one address."""
    clients, answers = [], list[bytes]()
    for _ in range(12):
        clients.append(_ask(address))
        answers.append(clients[-1].recv(12))
    with _ask(address, "127.0.0.2") as other_client:
        is_served = b" 200" in other_client.recv(12)
    n = sum(b" 200" in answer for answer in answers)
    for client in clients:
        client.close()
    return f"{n} of 12 answered; another address {'served' if is_served else 'refused'}", n <= 5 and is_served


def read_stream_slowly(address: str, service: psutil.Process, log: Path) -> tuple[str, bool]:
    """Reads a message, some 0.2 s of motion, of a stream of long words every second."""
    uri, client = address.replace("http", "ws", 1) + "/v1/stream", _connect(address)
    with suppress(ConnectionClosed), connect(uri, sock=client, max_queue=1, compression=None) as stream:
        stream.send(json.dumps({"type": "open", "paced": False}))
        for _ in range(50):
            stream.send(json.dumps({"type": "word", "gloss": "fs-ABCDEFGHIJKLMNOP"}))
        seconds = _wait_until(
            lambda: httpx.get(f"{address}/healthz").json()["streams"] == 0, lambda: stream.recv(timeout=1.0), 1.0
        )
        client.close()
    return f"its place is free after {seconds:.1f} s", seconds < _PATIENCE_S


def hang_up(address: str, service: psutil.Process, log: Path) -> tuple[str, bool]:
    """Hangs up sixty clients: before or in an answer, in a body or a form, in a stream's handshake or words."""
    url = urlsplit(address)
    upgrade = b"GET /v1/stream HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    upgrade += b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    form = b"POST /v1/splice HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; boundary=x\r\n"
    form += b"Content-Length: 9000\r\n\r\n--x\r\nContent-Disposition: form-data; name=files; filename=a.bvh\r\n\r\nHIER"
    for k in range(60):
        with socket.create_connection((url.hostname, url.port), timeout=_PATIENCE_S) as client:
            client.sendall((_REQUEST, _REQUEST, _REQUEST[:-20], upgrade, upgrade, form)[k % 6])
            if k % 6 in (1, 4):
                client.recv(1)
            if k % 6 == 4:
                for message in (b'{"type":"open","paced":false}', *[b'{"type":"word","gloss":"HELLO"}'] * 3):
                    client.sendall(bytes([0x81, 0x80 | len(message)]) + bytes(4) + message)
                client.recv(1000)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset, not an end
    time.sleep(5.0)
    lines = log.read_text(encoding="utf-8").splitlines()
    n_traces = sum("Traceback" in line for line in lines)
    return f"{len(lines)} lines in the log, {n_traces} tracebacks", n_traces == 0 and len(lines) <= 5


def time_first_call(address: str, service: psutil.Process, log: Path) -> tuple[str, bool]:
    """Compares the first sentence after the service has said that it is well with the second."""
    with httpx.Client(base_url=address, timeout=60.0, trust_env=False) as client:
        while client.get("/healthz").status_code != 200:
            time.sleep(0.05)
        seconds = []
        for _ in range(2):
            start = time.monotonic()
            client.post("/v1/sentence", content=_BODY, headers={"content-type": "application/json"})
            seconds.append(time.monotonic() - start)
    ratio = seconds[0] / seconds[1]
    return f"{ratio:.1f} times the second", ratio < 3.0


ATTACKS: dict[str, Callable[[str, psutil.Process, Path], tuple[str, bool]]] = {
    "an answer is never read": leave_unread,
    "an answer is read at 4 kB a second": read_slowly,
    "answers of one address are not read": leave_share_unread,
    "a stream is read more slowly than it plays": read_stream_slowly,
    "clients hang up": hang_up,
    "the first sentence after /healthz says well": time_first_call,
}


def main() -> None:
    """Prints a row for each attack; exit status 1 if one was not met."""
    print("| attack | seen | |\n| --- | --- | --- |")
    n_bad = 0
    for name in sys.argv[1:] or ATTACKS:
        with tempfile.NamedTemporaryFile("w+") as log:
            options = [] if ATTACKS[name] is time_first_call else _OPTIONS
            with start_service(*options, "--workers=1", log=log) as (address, process):
                if ATTACKS[name] is not time_first_call:
                    with httpx.Client(base_url=address, timeout=60.0, trust_env=False) as client:
                        client.post("/v1/sentence", json={"glosses": list(WORDS[:2])})
                result, is_met = ATTACKS[name](address, psutil.Process(process.pid), Path(log.name))
        print(f"| {name} | {result} | {'' if is_met else 'NOT MET'} |", flush=True)
        n_bad += not is_met
    sys.exit(n_bad > 0)


if __name__ == "__main__":
    main()
