"""Files to clips and back. ``FORMATS`` is the one table of file formats: a new format is one module and one row.

A format's module is imported when a file of that format is read or written, so that this table costs nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing

if TYPE_CHECKING:
    from signsplice.motion.clip import Clip


@dataclass(frozen=True)
class FileFormat:
    """A file format: one row of ``FORMATS``.

    suffix: end of the names of its files, lower case with the dot.
    module: module of this package with ``read(path) -> Clip``; with ``encode(clip) -> bytes`` where clips are written;
        with ``parse(content, file) -> Clip`` where there is a media type. Empty for a format that is only planned.
    writes: whether clips are written in it.
    media_type: its Content-Type in HTTP; empty for a format that the HTTP service neither accepts nor sends.
    holds: what a planned format holds, for the error message.
    """

    suffix: str
    module: str = ""
    writes: bool = True
    media_type: str = ""
    holds: str = ""


FORMATS = {
    row.suffix: row
    for row in (
        FileFormat(".bvh", "bvh", media_type="text/plain; charset=utf-8"),
        FileFormat(".npz", "npz"),
        FileFormat(".glb", "glb", media_type="model/gltf-binary"),
        FileFormat(".gltf", "glb", writes=False),
        FileFormat(".vrma", "vrma", media_type="model/gltf-binary"),
        FileFormat(".pose", holds="landmark"),
    )
}
"""Suffix -> format, in the order in which messages and help texts list them."""

READ_SUFFIXES = tuple(row.suffix for row in FORMATS.values() if row.module)
"""Suffixes that ``load`` reads."""
WRITE_SUFFIXES = tuple(row.suffix for row in FORMATS.values() if row.module and row.writes)
"""Suffixes that ``save`` and ``encode`` write."""
WIRE_SUFFIXES = tuple(row.suffix for row in FORMATS.values() if row.media_type)
"""Suffixes that ``parse`` reads: those of the HTTP service, which also sends them."""


def load(path: str | Path) -> Clip:
    """The clip in a file, by its suffix, one of ``READ_SUFFIXES``. Raises ``InputError`` for another suffix or a file
    that cannot be read.
    """
    clip: Clip = _module(path, "read", READ_SUFFIXES).read(path)
    return clip


def parse(content: bytes, file: str) -> Clip:
    """The clip in the bytes of a file, by the suffix of its name, one of ``WIRE_SUFFIXES``. For uploads: no file is
    opened, whatever the bytes refer to. Raises as ``load`` does.
    """
    clip: Clip = _module(file, "taken", WIRE_SUFFIXES).parse(content, file)
    return clip


def save(clip: Clip, path: str | Path) -> None:
    """Write a clip to a file by its suffix, one of ``WRITE_SUFFIXES``, whole or not at all. Raises ``InputError`` for
    another suffix, a clip that the format cannot hold, or a file that cannot be written.
    """
    check_suffix(path)
    with replacing(path) as temporary:
        try:
            content = encode(clip, str(path))
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        temporary.write_bytes(content)


def encode(clip: Clip, file: str) -> bytes:
    """The bytes of a clip's file, by the suffix of its name, one of ``WRITE_SUFFIXES``. Raises ``InputError`` for
    another suffix or a clip that the format cannot hold.
    """
    content: bytes = _module(file, "written", WRITE_SUFFIXES).encode(clip)
    return content


def check_suffix(path: str | Path) -> None:
    """Raise ``InputError`` where ``save`` would refuse a path because of its suffix."""
    _format(path, "written", WRITE_SUFFIXES)


def listed(suffixes: Sequence[str]) -> str:
    """Suffixes as a phrase: ".bvh, .glb or .vrma"."""
    return f"{', '.join(suffixes[:-1])} or {suffixes[-1]}"


def _module(path: str | Path, done: str, suffixes: Sequence[str]) -> Any:
    return import_module(f"{__name__}.{_format(path, done, suffixes).module}")


def _format(path: str | Path, done: str, suffixes: Sequence[str]) -> FileFormat:
    """The format of a path, or an ``InputError`` that says what cannot be ``done`` with it."""
    suffix = Path(path).suffix.lower()
    if suffix in suffixes:
        return FORMATS[suffix]
    expected = f"expected {listed(suffixes)}"
    row = FORMATS.get(suffix)
    if row is not None and row.holds:
        raise InputError(f"{path}: {row.holds} files cannot be {done} yet, {expected}")
    raise InputError(f"{path}: a file with suffix {suffix or '(none)'} cannot be {done}, {expected}")
