"""Clients that read slowly, or hang up: they lose their places, and others are served."""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, suppress

import httpx
import pytest
from test_service_floods import UPGRADE
from websockets.exceptions import ConnectionClosed

from serving import PATIENCE_S, http_client, process_of, stream_client, wait_until_warm

pytestmark = pytest.mark.slow
BODY = json.dumps({"glosses": ["HELLO", "DEAF", "FRIEND", "THANK-YOU"] * 10, "formats": ["bvh", "glb"]}).encode()
REQUEST = (
    b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    b"Content-Length: %d\r\n\r\n" % len(BODY)
) + BODY
"""A request for an answer of some MB."""
FORM = (
    b"POST /v1/splice HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; boundary=x\r\n"
    b"Content-Length: 9000\r\n\r\n--x\r\nContent-Disposition: form-data; name=files; filename=a.bvh\r\n\r\nHIER"
)


def start_service(idle_s: float, body_s: float) -> AbstractContextManager[httpx.Client]:
    """A client of a service with these limits; once it has ended, its log must have no traceback."""
    limits = f"idle_seconds={idle_s}", f"body_seconds={body_s}", "max_client_waiting=4", "max_connections=100"
    return http_client("serve", "--workers=1", *(f"--limit={limit}" for limit in limits))


@pytest.fixture(scope="module")
def hasty() -> Iterator[httpx.Client]:
    """A client of a service with short limits."""
    with start_service(4.0, 9.0) as client:
        wait_until_warm(client)
        yield client


def bare_connection(client: httpx.Client, source: str = "127.0.0.1") -> socket.socket:
    """A connection whose end here buffers little."""
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.bind((source, 0))
    connection.connect((client.base_url.host, client.base_url.port))
    connection.settimeout(PATIENCE_S)
    return connection


def becomes(is_done: Callable[[], bool], read: Callable[[], object], pause: float) -> bool:
    """Whether something comes to pass before patience ends, with ``read`` called at every pause."""
    deadline = time.monotonic() + PATIENCE_S
    while not is_done():
        if time.monotonic() > deadline:
            return False
        with suppress(OSError, ConnectionClosed, TimeoutError):
            read()
        time.sleep(pause)
    return True


@pytest.mark.parametrize("n_bytes", [0, 2000], ids=["unread", "at 4 kB a second"])
def test_a_connection_whose_answer_is_not_read_in_time_is_closed(hasty: httpx.Client, n_bytes: int) -> None:
    """At 4 kB a second the answer would take longer than this test waits."""
    service = process_of(hasty)
    with bare_connection(hasty) as client:
        client.sendall(REQUEST)
        client.recv(1)
        port = client.getsockname()[1]

        def is_closed() -> bool:
            return all(not peer.raddr or peer.raddr.port != port for peer in service.net_connections("tcp"))

        assert becomes(is_closed, lambda: client.recv(n_bytes) if n_bytes else None, 0.5)


def test_answers_that_one_address_leaves_unread_keep_no_other_waiting() -> None:
    with start_service(900.0, 900.0) as patient, ExitStack() as stack:
        wait_until_warm(patient)
        answers = []
        for _ in range(12):
            client = stack.enter_context(bare_connection(patient))
            client.sendall(REQUEST)
            answers.append(client.recv(12))
        with bare_connection(patient, "127.0.0.2") as other_client:
            other_client.sendall(REQUEST)
            assert b" 200" in other_client.recv(12)
    assert sum(b" 200" in answer for answer in answers) <= 5


def test_a_stream_that_is_read_more_slowly_than_it_plays_loses_its_place(hasty: httpx.Client) -> None:
    """A message, some 0.2 s of motion, is read every second: all would take longer than this test waits."""
    has_lost = False
    with (
        suppress(ConnectionClosed),
        bare_connection(hasty) as client,
        stream_client(hasty, sock=client, max_queue=1, close_timeout=0.1) as stream,
    ):
        stream.send('{"type": "open", "paced": false}')
        for _ in range(50):
            stream.send('{"type": "word", "gloss": "fs-ABCDEFGHIJKLMNOP"}')
        assert stream.recv(timeout=PATIENCE_S)
        is_over = lambda: hasty.get("/healthz").json()["streams"] == 0  # noqa: E731
        has_lost = becomes(is_over, lambda: stream.recv(timeout=1.0), 1.0)
        client.close()
    assert has_lost


def test_clients_that_hang_up_leave_no_traceback(hasty: httpx.Client) -> None:
    """Before or in an answer, in a body or a form, in a stream's handshake or words; the fixture reads the log."""
    for k in range(60):
        with bare_connection(hasty) as client:
            client.sendall((REQUEST, REQUEST, REQUEST[:-20], UPGRADE + b"\r\n", UPGRADE + b"\r\n", FORM)[k % 6])
            if k % 6 in (1, 4):
                client.recv(1)
            if k % 6 == 4:
                for message in (b'{"type":"open","paced":false}', *[b'{"type":"word","gloss":"HELLO"}'] * 3):
                    client.sendall(bytes([0x81, 0x80 | len(message)]) + bytes(4) + message)
                client.recv(1000)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset, not an end
    time.sleep(5.0)
    assert hasty.get("/healthz").status_code == 200
