"""Bytes of files that are safe to read, and one kind of error for whatever goes wrong in a parser."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from signsplice.errors import FormatError, InputError, LimitError
from signsplice.formats.limits import DEFAULT_LIMITS

_KINDS = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
# A pipe that nobody writes to must not block, a terminal must not become ours, Windows must not translate line ends.
_FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY"))


def read_bytes(path: str | Path, most_bytes: float = DEFAULT_LIMITS.file_bytes) -> bytes:
    """The bytes of a regular file, or of one that a link leads to.

    Raises ``InputError`` with one line where it is missing, a folder, a pipe, a device, or not readable, and
    ``LimitError`` where it is larger than ``most_bytes``.
    """
    with opened(path) as (file, size):
        if size > most_bytes:
            raise LimitError(f"{size:,} bytes, expected at most {most_bytes:,.0f}", file=str(path))
        content = file.read(size + 1)
    if len(content) > size:
        raise InputError(f"{path}: grows while it is read; try again when it is complete")
    return content


@contextmanager
def opened(path: str | Path) -> Iterator[tuple[BinaryIO, int]]:
    """A regular file, or one that a link leads to, open for reading, and its size in bytes.

    Raises ``InputError`` with one line where it is missing, a folder, a pipe, a device, or not readable, in the block
    too.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder, expected a file")
        with open(os.open(path, _FLAGS), "rb") as file:
            status = os.fstat(file.fileno())  # of the file that is open, whatever its name leads to by now
            if not stat.S_ISREG(status.st_mode):
                kind = _KINDS.get(stat.S_IFMT(status.st_mode), "no file")
                raise InputError(f"{path}: is {kind}, expected a regular file; save what it holds to one first")
            yield file, status.st_size
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:  # a zero byte in the name
        raise InputError(f"{str(path)!r}: cannot be read ({error})") from error


@contextmanager
def format_errors(file: str, kind: str) -> Iterator[None]:
    """Turns whatever a parser raises within the block into a ``FormatError`` that names ``file`` and says that it is no
    valid ``kind``; the original error is its ``__cause__``.

    Parsers and the libraries under them fail in many ways on broken files, and no list of these was ever complete.
    """
    try:
        yield
    except FormatError:
        raise
    except Exception as error:
        raise as_format_error(error, file, kind) from error


def as_format_error(error: Exception, file: str, kind: str) -> FormatError:
    """What ``format_errors`` makes of an error; a ``FormatError`` itself."""
    if isinstance(error, FormatError):
        return error
    if isinstance(error, InputError):
        return FormatError(f"is no valid {kind} ({error})", file=file)
    if isinstance(error, MemoryError):
        return FormatError("needs more memory than there is", file=file)
    reason = (str(error).splitlines() or [""])[0][:200]
    return FormatError(f"is no valid {kind} ({type(error).__name__}{': ' if reason else ''}{reason})", file=file)


def stem(file: str) -> str:
    """The name of a file without folder and suffix, as text that can be written anywhere."""
    return Path(file).stem.encode("utf-8", "replace").decode("utf-8")
