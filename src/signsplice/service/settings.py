"""Settings of a service: its address, and limits on all resources that a caller can use."""

from __future__ import annotations

import re
import socket
from dataclasses import dataclass, fields, replace
from functools import cached_property
from ipaddress import ip_address
from pathlib import Path

from signsplice.children import cores
from signsplice.errors import InputError
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits

MIB = 1 << 20
_LEAST_WORKER_BYTES = 256 * MIB
"""Minimum memory of a worker, bytes."""
_ORIGIN = re.compile(r"[a-z][a-z0-9+.-]*://([^\s/?#@:*\[\]]+|\[[0-9a-f:.]+\])(:\d{1,5})?", re.IGNORECASE)
_EMBEDDER = re.compile(r"https?://[a-z0-9.-]+(:\d{1,5})?", re.IGNORECASE)
"""Origins that a Content-Security-Policy may contain; it has no IPv6 addresses."""
LOOPBACK = ("127.0.0.1", "localhost", "::1", "[::1]")


@dataclass(frozen=True)
class Settings:
    """How a service runs. Raises ``InputError`` for a limit that is not positive, or an invalid address."""

    host: str = "127.0.0.1"
    """Address to listen on."""
    port: int = 8000
    """Port to listen on; 0 for any free one."""
    lexicons: tuple[str, ...] = ()
    """Folders of lexicons, of which the first that has a word wins; empty for the shipped words."""
    avatars: tuple[Path, ...] = ()
    """Files of avatars that callers may name."""
    allowed_hosts: tuple[str, ...] = ()
    """Host names to answer to, besides loopback and the machine's; "*" for any."""
    allowed_origins: tuple[str, ...] = ()
    """Origins of other pages that may call, e.g. "https://signs.example"."""
    allowed_embedders: tuple[str, ...] = ()
    """Origins of other pages that may show the service's page in a frame."""
    proxies: tuple[str, ...] = ()
    """Addresses of reverse proxies, whose X-Forwarded-For names the client."""
    n_workers: int = 0
    """Processes for quick jobs, those of streams among them, and as many again for long ones; 0 for one per core."""

    max_connections: int = 1000
    """Open connections; with more, requests are refused."""
    max_head_bytes: int = 64 * 1024
    """Size of a request's head, of its trailer, and of the framing of a chunk."""
    max_body_bytes: int = 64 * MIB
    """Size of a request's body; reading stops there."""
    max_json_bytes: int = 256 * 1024
    """Size of a JSON body, which the listening process itself validates."""
    max_files: int = 100
    """Files in one splice."""
    max_glosses: int = 200
    """Words and letters in one sentence."""
    max_frames: int = 40_000
    """Frames at the output's rate: of a whole request, of one file, or of one word of a stream; the default is 22
    minutes at 30 fps."""
    max_joints: int = int(DEFAULT_LIMITS.joints)
    """Joints of a skeleton."""
    max_client_waiting: int = 32
    """Requests from one address that run or wait for their turn; further ones are refused, to bound memory."""
    max_uploads: int = 8
    """Bodies over 1 MiB that are read at the same time."""
    max_client_uploads: int = 4
    """Of these, bodies from one address."""
    max_streams: int = 100
    """Open streams."""
    max_client_streams: int = 50
    """Of these, streams from one address."""
    max_avatar_bytes: int = 512 * MIB
    """Memory of all uploaded avatars, of which one may take a quarter; then one of the client with most is dropped."""
    max_client_avatars: int = 4
    """Uploaded avatars from one address; then the one named least recently is dropped."""
    avatar_seconds: float = 3600.0
    """Time after which an uploaded avatar is dropped that no request has named."""
    max_stream_words: int = 64
    """Words of a stream that wait to be signed; until one is signed, no more messages are read."""
    max_message_bytes: int = 16 * 1024
    """Size of one message from a stream's client."""
    head_seconds: float = 10.0
    """Time for a stream's first message to arrive."""
    idle_seconds: float = 15.0
    """Time between two parts of a body, or for a client to read 64 KiB of an answer."""
    body_seconds: float = 120.0
    """Time for a whole body to arrive, or for a client to read a whole answer."""
    drain_seconds: float = 8.0
    """Time for requests that run to be answered when the service stops."""
    work_seconds: float = 60.0
    """Processor time of one job in a worker, all its threads together; then the worker is killed and replaced. Other
    processes that load the machine do not shorten it. If processor time is unknown (macOS, Windows), wall-clock
    time."""
    work_wall_seconds: float = 600.0
    """Wall-clock time of one job in a worker, for jobs that block without using the processor."""
    stream_idle_seconds: float = 120.0
    """Time after which a stream is closed if its client is silent and nothing remains to be sent."""
    worker_bytes: int = 4 << 30
    """Memory of one worker, bytes; on Linux only."""

    def __post_init__(self) -> None:
        for name in limit_types():
            value = getattr(self, name)
            if not value > 0:
                raise InputError(f"{name} is {value}, expected a positive number")
        if len(self.avatar_files) < len(self.avatars):
            raise InputError("two avatars have one name; rename a file")
        if not 0 <= self.port < 65536:
            raise InputError(f"port {self.port}, expected 0 to 65535")
        for what, values, is_valid, expected in (
            ("proxy", self.proxies, _is_address, "an IP address"),
            ("origin", self.allowed_origins, _ORIGIN.fullmatch, "scheme://host or scheme://host:port"),
            ("embedder", self.allowed_embedders, _EMBEDDER.fullmatch, "http(s)://host or http(s)://host:port"),
        ):
            for value in values:
                if not is_valid(value):
                    raise InputError(f"{what} {value!r}, expected {expected}")
        if self.worker_bytes < _LEAST_WORKER_BYTES:
            raise InputError(f"worker_bytes is {self.worker_bytes}, expected at least {_LEAST_WORKER_BYTES} (256 MiB)")
        if self.n_workers < 0:
            raise InputError(f"{self.n_workers} workers, expected 0 (one per core) or more")

    @property
    def avatar_files(self) -> dict[str, Path]:
        """Name of an avatar -> its file."""
        return {path.stem: path for path in self.avatars}

    @property
    def workers(self) -> int:
        """Number of processes for quick jobs, and for long ones."""
        return self.n_workers or cores()

    @property
    def read_limits(self) -> ReadLimits:
        """The limits of the files of a request."""
        limits = {"file_bytes": self.max_body_bytes, "frames": self.max_frames, "joints": self.max_joints}
        return replace(DEFAULT_LIMITS, **limits)

    @property
    def is_local(self) -> bool:
        """Whether only this machine can call."""
        return self.host in LOOPBACK or (_is_address(self.host) and ip_address(self.host).is_loopback)

    @cached_property
    def hosts(self) -> tuple[str, ...]:
        """Values of the Host header to which the service answers."""
        machine = () if self.host in LOOPBACK else (socket.gethostname(),)
        return tuple(dict.fromkeys(name.lower() for name in (*LOOPBACK, self.host, *machine, *self.allowed_hosts)))

    def answers_to(self, host: str) -> bool:
        """Return whether the service answers to this Host header, given without its port.

        This stops DNS rebinding, in which a foreign page's name resolves to this machine. A service that listens beyond
        loopback also answers to any IP address.
        """
        host = host.lower()
        return "*" in self.allowed_hosts or host in self.hosts or (self.host not in LOOPBACK and _is_address(host))


def _is_address(host: str) -> bool:
    try:
        ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


def limit_types() -> dict[str, type]:
    """Return the type of every limit, int or float, by name."""
    return {
        field.name: type(field.default)
        for field in fields(Settings)
        if field.name.startswith(("max_", "worker_")) or field.name.endswith("_seconds")
    }
