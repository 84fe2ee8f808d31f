"""Runs the service on a socket."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Callable, Mapping, Sequence
from math import ceil
from typing import Any

import uvicorn

from signsplice.errors import InputError
from signsplice.service import monitoring as log
from signsplice.service.app import create
from signsplice.service.protocols import protocols
from signsplice.service.settings import Settings


def serve(
    settings: Settings, scenes: Sequence[Mapping[str, Any]] = (), on_open: Callable[[str], None] | None = None
) -> None:
    """Listen until interrupted. ``on_open`` is called with the page's address once the socket is open.

    Raises ``InputError`` where the address cannot be listened on, or the lexicon cannot be opened.
    """
    app = create(settings, scenes)
    http, websocket = protocols(settings)
    config = uvicorn.Config(
        app,
        http=http,
        ws=websocket,
        ws_per_message_deflate=False,  # costs more than it saves on frames
        ws_max_size=settings.max_message_bytes,
        proxy_headers=bool(settings.proxies),
        forwarded_allow_ips=list(settings.proxies),
        timeout_graceful_shutdown=ceil(settings.drain_seconds),
        log_level="error",  # uvicorn writes a warning for every bad request: a flood would fill the log
        access_log=False,
        server_header=False,
    )
    log.quieten()
    with _listen(settings) as listener:
        if on_open is not None:
            host = settings.host if ":" not in settings.host else f"[{settings.host}]"
            on_open(f"http://{host}:{listener.getsockname()[1]}/")
        uvicorn.Server(config).run(sockets=[listener])


def _listen(settings: Settings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        return socket.create_server((settings.host, settings.port), family=family, backlog=512)
    except OSError as error:
        number = error.errno or 0
        if number < 0 or number == errno.EADDRNOTAVAIL:  # below zero: the name was not found
            advice = "name one, e.g. 127.0.0.1 or 0.0.0.0"
            raise InputError(f"cannot listen: host {settings.host} is no address of this machine; {advice}") from error
        reason = os.strerror(number)  # the error's own repeats the address
        raise InputError(f"cannot listen on {settings.host}:{settings.port} ({reason}); try another port") from error
