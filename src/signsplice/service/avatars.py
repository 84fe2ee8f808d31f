"""Avatars that clients upload once, to be named in later requests and streams."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from dataclasses import dataclass
from secrets import token_urlsafe

from signsplice.errors import InputError
from signsplice.service.settings import Settings


@dataclass(frozen=True)
class _Upload:
    client: str
    content: bytes
    expiry: asyncio.TimerHandle


class UploadedAvatars:
    """Uploaded avatars by id, in memory. One that no request names for ``avatar_seconds`` is dropped; beyond
    ``max_client_avatars`` and ``max_avatar_bytes``, those named least recently are.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._uploads: OrderedDict[str, _Upload] = OrderedDict()

    def add(self, client: str, content: bytes) -> str:
        """Keep an avatar, as ``work.pickle_avatar`` returns it, and return its id."""
        key = f"upload-{token_urlsafe(16)}"
        self._keep(key, client, content)
        own = [each for each, upload in self._uploads.items() if upload.client == client]
        for each in own[: -self._settings.max_client_avatars]:
            self._drop(each)
        while sum(len(upload.content) for upload in self._uploads.values()) > self._settings.max_avatar_bytes:
            self._drop(next(iter(self._uploads)))
        return key

    def content(self, name: str | None) -> bytes | None:
        """Return the avatar that a request names, as it was added; None for no name, or an avatar of the settings.
        Raises ``InputError`` for any other name.
        """
        if name is None or name in self._settings.avatar_files:
            return None
        if name not in self._uploads:
            names = [*sorted(self._settings.avatar_files), "the id of an upload that is kept; upload it again"]
            raise InputError(f"avatar {name!r:.80}: expected {' or '.join(names)}")
        upload = self._drop(name)
        self._keep(name, upload.client, upload.content)
        return upload.content

    def _keep(self, key: str, client: str, content: bytes) -> None:
        expiry = asyncio.get_running_loop().call_later(self._settings.avatar_seconds, self._drop, key)
        self._uploads[key] = _Upload(client, content, expiry)

    def _drop(self, key: str) -> _Upload:
        upload = self._uploads.pop(key)
        upload.expiry.cancel()
        return upload
