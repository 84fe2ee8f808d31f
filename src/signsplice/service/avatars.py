"""Avatars that clients upload once, to be named in later requests and streams."""

from __future__ import annotations

import asyncio
from collections import Counter
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
    ``max_client_avatars`` and ``max_avatar_bytes``, that one of the client, or of the one with most bytes, that was
    named least recently.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._uploads: dict[str, _Upload] = {}

    def add(self, client: str, content: bytes) -> str:
        """Keep an avatar, as ``work.pickle_avatar`` returns it, and return its id."""
        key = f"upload-{token_urlsafe(16)}"
        self._keep(key, client, content)
        if len(self._ids(client)) > self._settings.max_client_avatars:
            self._drop(self._ids(client)[0])
        while (sizes := self._sizes()).total() > self._settings.max_avatar_bytes:
            self._drop(self._ids(sizes.most_common(1)[0][0])[0])
        return key

    def _ids(self, client: str) -> list[str]:
        """Return the ids of a client's avatars, the one named least recently first."""
        return [key for key, upload in self._uploads.items() if upload.client == client]

    def _sizes(self) -> Counter[str]:
        """Return the bytes of every client's avatars."""
        sizes = Counter[str]()
        for upload in self._uploads.values():
            sizes[upload.client] += len(upload.content)
        return sizes

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
