"""What a service allows: every limit, with a safe default."""

from __future__ import annotations

import os
import socket
from dataclasses import dataclass, fields
from functools import cached_property
from ipaddress import ip_address
from pathlib import Path

from signsplice.errors import InputError

MIB = 1 << 20
LOOPBACK = ("127.0.0.1", "localhost", "::1", "[::1]")


@dataclass(frozen=True)
class Settings:
    """How a service runs. Raises ``InputError`` for a limit that is no positive number.

    host, port: where it listens. lexicon: folder of the words, None for those that ship. allowed_hosts: names by which
    it may be called, beside loopback and its own; "*" for any. allowed_origins: other pages' origins that may call it,
    e.g. "https://signs.example". n_workers: processes that answer requests, and as many again for streams; 0: one a
    core.
    """

    host: str = "127.0.0.1"
    port: int = 8000
    lexicon: Path | None = None
    allowed_hosts: tuple[str, ...] = ()
    allowed_origins: tuple[str, ...] = ()
    n_workers: int = 0

    max_body_bytes: int = 64 * MIB
    """Of a request; reading stops there."""
    max_json_bytes: int = 256 * 1024
    """Of a sentence: what is read as JSON is checked by the process that listens."""
    max_files: int = 100
    max_glosses: int = 200
    max_frames: int = 40_000
    """Of all clips of a request, or one word of a stream, at the output's rate, and of one file: 22 minutes at 30 a
    second.
    """
    max_waiting: int = 64
    """Requests that wait for a worker; more are sent away."""
    max_uploads: int = 8
    """Bodies over 1 MiB that are read at one time."""
    max_streams: int = 100
    max_stream_words: int = 64
    """Words of a stream that wait; its sender is read no further until one is signed."""
    max_message_bytes: int = 16 * 1024
    """Of one message of a stream's client."""
    head_seconds: float = 10.0
    """For the head of a request."""
    idle_seconds: float = 15.0
    """Between two parts of a body, or for a client to take a part of the answer."""
    body_seconds: float = 120.0
    """For a whole body."""
    work_seconds: float = 60.0
    """Of a worker for one request; then the worker is ended, and another takes its place."""
    stream_idle_seconds: float = 120.0
    """A stream that is told nothing and says nothing for so long is closed."""
    worker_bytes: int = 4 << 30
    """Memory that a worker may take, where the system can tell (Linux)."""

    def __post_init__(self) -> None:
        for name in limits():
            value = getattr(self, name)
            if not value > 0:
                raise InputError(f"{name} is {value}, expected a positive number")
        if not 0 <= self.port < 65536:
            raise InputError(f"port {self.port}, expected 0 to 65535")
        if self.n_workers < 0:
            raise InputError(f"{self.n_workers} workers, expected 0 (one a core) or more")

    @property
    def workers(self) -> int:
        """How many processes answer requests."""
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        return self.n_workers or cores

    @cached_property
    def hosts(self) -> tuple[str, ...]:
        """Names by which it may be called: what browsers send in Host."""
        own = () if self.host in LOOPBACK else (socket.gethostname(), socket.getfqdn())
        return tuple(dict.fromkeys(name.lower() for name in (*LOOPBACK, self.host, *own, *self.allowed_hosts)))

    def answers_to(self, host: str) -> bool:
        """Whether it may be called so. A page of another name that is led to this address by its name's server (DNS
        rebinding) is kept out; addresses themselves are let in where it listens beyond loopback.
        """
        host = host.lower()
        return "*" in self.allowed_hosts or host in self.hosts or (self.host not in LOOPBACK and _is_address(host))


def _is_address(host: str) -> bool:
    try:
        ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


def limits() -> dict[str, type]:
    """Every limit by name, and whether it is a whole number."""
    return {
        told.name: type(told.default)
        for told in fields(Settings)
        if told.name.startswith(("max_", "worker_")) or told.name.endswith("_seconds")
    }
