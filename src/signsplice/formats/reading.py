"""Safe reading of files, limits that keep small or broken files from costing unbounded time or memory, and one kind of
error for any failure of a parser.
"""

from __future__ import annotations

import math
import os
import stat
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from signsplice.errors import FormatError, InputError, LimitError, MissingExtraError

if TYPE_CHECKING:
    from signsplice.motion import Clip


JOINT_FRAME_BYTES = 80
"""Memory that one joint takes in one frame while its clip is created: rotation, translation, and checks of both."""


def check_most(count: float, noun: str, most: float, file: str) -> None:
    """Raise ``LimitError`` if a file holds more of something than allowed."""
    if count > most:
        raise LimitError(f"{count:,} {noun}, expected at most {most:,.0f}", file=file)


@dataclass(frozen=True)
class ReadLimits:
    """Limits for reading clips. The defaults allow two hours of 75 joints at 120 fps, 1.8 GB of BVH.

    file_bytes: size of a file, including its buffer files.
    unpacked_bytes: size of an archive's members, unpacked.
    expansion: how many times its own size an archive may unpack to; 64 MiB are always allowed.
    members: members of an archive.
    joints, depth: joints (and End Sites) of a skeleton, and how deep they nest in BVH.
    nodes: nodes of a glTF document.
    frames: frames of a clip, as read and at the output's rate.
    seconds, fps: duration and frame rate of a clip.
    free_bytes, growth: a clip's arrays, and the data they are decoded from, may take ``free_bytes`` of memory plus
        ``growth`` times the file's size. Resampling may grow a clip by as much.
    """

    file_bytes: float = 2 << 30
    unpacked_bytes: float = 8 << 30
    expansion: float = 200.0
    members: float = 100
    joints: float = 1024
    depth: float = 256
    nodes: float = 50_000
    frames: float = 2_000_000
    seconds: float = 86_400.0
    fps: float = 1000.0
    free_bytes: float = 48 << 20
    growth: float = 10.0

    def check_clip(
        self, n_frames: float, n_joints: int, fps: float, n_bytes: float, given_bytes: float, file: str = ""
    ) -> None:
        """Raise ``LimitError`` if a clip is larger than allowed; its arrays take ``n_bytes`` and come from
        ``given_bytes``.
        """
        what = f"{n_frames / fps:,.0f} s of {n_joints:,} joints at {fps:g} fps, {n_frames:,.0f} frames"
        for limit, value, unit in (
            (self.joints, n_joints, "joints"),
            (self.fps, fps, "fps"),
            (self.seconds, n_frames / fps, "seconds"),
            (self.frames, n_frames, "frames"),
        ):
            if not value <= limit:  # True for NaN too
                raise LimitError(f"{what}, expected at most {limit:,.0f} {unit}", file=file)
        self.check_memory(what, n_bytes, given_bytes, file)

    def check_resampling(self, clip: Clip, fps: float, speed: float = 1.0) -> None:
        """Raise ``LimitError`` if ``resample`` would make more frames than allowed, or far more than the clip has."""
        n_given, n_joints, _ = clip.local_rotations.shape
        n_frames, frame_bytes = n_given / clip.fps / speed * fps, n_joints * JOINT_FRAME_BYTES
        self.check_clip(n_frames, n_joints, fps, n_frames * frame_bytes, n_given * frame_bytes, clip.name)

    def check_memory(self, what: str, n_bytes: float, given_bytes: float, file: str = "") -> None:
        """Raise ``LimitError`` if ``what`` takes ``n_bytes`` of memory, far more than its source of ``given_bytes``."""
        max_bytes = self.free_bytes + self.growth * given_bytes
        if n_bytes > max_bytes:
            raise LimitError(
                f"{what} take {n_bytes / 1e6:,.0f} MB of memory, expected at most {max_bytes / 1e6:,.0f} MB from "
                f"{given_bytes:,.0f} bytes",
                file=file,
            )


DEFAULT_LIMITS = ReadLimits()
NO_LIMITS = ReadLimits(**{limit.name: math.inf for limit in fields(ReadLimits)})
"""No limits: for trusted files."""


_KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}
# A pipe that nobody writes to must not block, a terminal must not become ours, Windows must not translate line ends.
_FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY"))


def read_bytes(path: str | Path, most_bytes: float = DEFAULT_LIMITS.file_bytes) -> bytes:
    """Read the bytes of a regular file, or of one that a link leads to.

    Raises ``InputError`` with one line if it is missing, a folder, a pipe, a device, or not readable, and
    ``LimitError`` if it is larger than ``most_bytes``.
    """
    with open_file(path) as (file, size):
        check_most(size, "bytes", most_bytes, str(path))
        content = file.read(size + 1)
    if len(content) > size:
        raise InputError(f"{path}: grows while it is read; try again when it is complete")
    return content


@contextmanager
def open_file(path: str | Path) -> Iterator[tuple[BinaryIO, int]]:
    """Open a regular file, or one that a link leads to, for reading; yields it and its size in bytes.

    Raises ``InputError`` with one line if it is missing, a folder, a pipe, a device, or not readable, in the block
    too.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder, expected a file")
        with open(os.open(path, _FLAGS), "rb") as file:
            status = os.fstat(file.fileno())  # of the open file, even if its name has changed meanwhile
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


_PLAIN = (
    (KeyError, "it has no {0!r:.80}"),
    (IndexError, "a number in it names what is not there"),
    (RecursionError, "it nests too deeply"),
    (UnicodeError, "a text in it is not {0}"),
    ((struct.error, zlib.error, EOFError), "it is damaged or cut short"),
    (Exception, "its content does not fit together"),
)
"""Kind of error of Python itself -> what it means for the file; {0} is the error's first argument."""
_FAULTS = (AttributeError, ImportError, MemoryError, MissingExtraError, NameError)
"""Errors of the program, its installation or the machine, whatever a file holds."""


@contextmanager
def format_errors(file: str, kind: str) -> Iterator[None]:
    """Turn an error within the block into a ``FormatError`` that names ``file`` and says that it is no valid ``kind``;
    the original error is its ``__cause__``. Errors that no file causes pass through: ``_FAULTS``.

    Parsers and their libraries fail on broken files in more ways than any list of errors covers.
    """
    try:
        yield
    except FormatError:
        raise
    except Exception as error:
        raise as_format_error(error, file, kind) from error


def as_format_error(error: Exception, file: str, kind: str) -> FormatError:
    """Convert an error as ``format_errors`` does; returns a ``FormatError`` unchanged, and raises one of ``_FAULTS``.

    Errors of this package and of libraries say what is wrong; those of Python are written for programmers.
    """
    if isinstance(error, _FAULTS):
        raise error
    if isinstance(error, FormatError):
        return error
    reason = (str(error).splitlines() or [""])[0][:200]
    if not reason or type(error).__module__ in ("builtins", "struct", "zlib"):
        text = next(text for kinds, text in _PLAIN if isinstance(error, kinds))
        reason = text.format(*(error.args or ("such part",)))
    return FormatError(f"is no valid {kind} ({reason})", file=file)


def stem(file: str) -> str:
    """Return the name of a file without folder and suffix, with "?" for what UTF-8 cannot encode."""
    return Path(file).stem.encode("utf-8", "replace").decode("utf-8")
