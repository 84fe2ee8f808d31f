"""Atomic writing of files and folders: whole or not at all, even if a process is killed, a disk full or power fails.

Unfinished output lies beside its place under a hidden name, locked by the process that writes it. The lock ends with
the process, so the next process that writes there removes leftovers of a killed one. Finished output is flushed to
disk, then renamed.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from signsplice.errors import InputError

try:
    import fcntl
except ImportError:  # no Unix: nothing is locked, and so nothing is swept
    fcntl = None  # type: ignore[assignment]

_TEMPORARY = re.compile(r"\.signsplice-[0-9a-f]{16}(\..*)?", re.DOTALL)
_NO_SYNC = (errno.EACCES, errno.EPERM, errno.EINVAL, errno.ENOTSUP, errno.EBADF)
"""Errors of files that may be written but not read, and of systems that cannot flush a folder."""
_WAIT_S = 5.0
"""Seconds to wait for a folder that another process writes: children of a killed process take a moment to end."""


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``: renamed to ``path`` when the block succeeds, removed when it fails.

    It has the suffix of ``path``, since writers choose by suffix. Within an unfinished folder of ``replacing_folder``,
    itself atomic, it is ``path``. Raises ``InputError`` as ``check_writable`` does, and if the disk is full.
    """
    path = Path(path)
    check_writable(path)
    try:
        if any(_TEMPORARY.fullmatch(part) for part in path.absolute().parent.parts):
            yield path
            return
        mode = path.stat().st_mode & 0o777 if path.exists() else None
        private = 0o666 if mode is None else mode | 0o600  # as private as the file that it replaces
        with _temporary(path.parent, lambda new: new.touch(private, exist_ok=False), path.suffix) as temporary:
            yield temporary
            if mode is not None:
                os.chmod(temporary, mode)
            put_file(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: cannot write there ({error.strerror or error})") from error


def write(path: str | Path, content: str | bytes | memoryview) -> None:
    """Write a file as ``replacing`` does; text as UTF-8."""
    with replacing(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def check_writable(path: str | Path) -> None:
    """Raise ``InputError`` if ``path`` is a folder, a link or a special file such as a device, or if its folder is
    missing or not writable.
    """
    path = Path(path)
    if os.path.islink(path):
        raise InputError(f"{path}: is a link, which would be replaced; name the file that it leads to, or a new file")
    if os.path.isdir(path):
        raise InputError(f"{path}: is a folder, expected a file name to write to")
    if os.path.exists(path) and not os.path.isfile(path):
        kind = "pipe" if path.is_fifo() else "socket" if path.is_socket() else "device"
        raise InputError(f"{path}: is a {kind}, which would be replaced; name a file")
    _check_parent(path, path.parent)


def _check_parent(path: Path, parent: Path) -> None:
    if not parent.is_dir():
        raise InputError(f"{path}: folder {path.parent} does not exist; make it first")
    if not os.access(parent, os.W_OK):
        raise InputError(f"{path}: folder {path.parent} is not writable")


def put_file(temporary: Path, target: Path) -> None:
    """Rename a finished file to ``target`` so that it survives a power failure whole."""
    _sync(temporary)
    os.replace(temporary, target)
    _sync(target.parent)


@contextmanager
def replacing_folder(path: str | Path, hint: str = "nothing was left there half-written") -> Iterator[Path]:
    """Yield a temporary folder beside ``path``: takes its place when the block succeeds, removed when it fails.

    Replaces whatever is at ``path``: the caller has called ``check_folder``. Raises ``InputError``, which ends with
    ``hint``, if it cannot be written or the disk is full.
    """
    check_place(path)
    target = Path(path).resolve()  # "." has no name of its own
    if target.exists() and not target.is_dir():
        raise InputError(f"{path}: is a file, expected a folder or a new name")
    try:
        waiting = _recover(target)
        with _temporary(target.parent, os.mkdir) as temporary:
            yield temporary
            for written in (*temporary.rglob("*"), temporary):
                _sync(written)
            if not target.exists():
                os.rename(temporary, target)
            elif not _exchange(temporary, target):
                os.rename(target, waiting)
                try:
                    os.rename(temporary, target)
                finally:
                    _recover(target)
            _sync(target.parent)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); {hint}") from error


def check_folder(path: str | Path, mark: str, written: Callable[[Path], Collection[str]]) -> None:
    """Raise ``InputError`` if ``check_place`` does, or if ``path`` exists and is neither an empty folder nor earlier
    output alone: with the file ``mark``, and no file or folder that ``written`` does not name.

    written: returns the relative paths of the files of earlier output in a folder; raises ``InputError`` if the folder
    holds none.
    """
    path = Path(path)
    check_place(path)
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return
    if not (path.is_dir() and (path / mark).exists()):
        raise InputError(f"{path}: is there already and has no {mark}; choose a new name")
    check_nothing_else(path, written(path), mark)


def check_nothing_else(folder: Path, files: Collection[str], what: str) -> None:
    """Raise ``InputError`` if ``folder`` holds anything but ``files``, relative paths, and their folders."""
    known = {Path(file) for file in files}
    folders = {parent for file in known for parent in file.parents}
    entries = {path.relative_to(folder): path.is_dir() and not path.is_symlink() for path in folder.rglob("*")}
    unexpected = sorted(path for path, is_dir in entries.items() if path not in (folders if is_dir else known))
    if unexpected:
        raise InputError(
            f"{folder}: holds {unexpected[0]} beside its {what}, which would be lost; move it or choose a name"
        )


def check_place(path: str | Path) -> None:
    """Raise ``InputError`` if no folder can be put at ``path``: it is a link or a mount point, or its parent folder is
    missing or not writable.
    """
    path = Path(path)
    if path.is_symlink():
        raise InputError(f"{path}: is a link, which would be replaced; name the folder that it leads to, or a new one")
    if os.path.ismount(path):
        raise InputError(f"{path}: is a mount point, which cannot be replaced; name a folder within it")
    _check_parent(path, path.resolve().parent)


@contextmanager
def resumable_folder(path: Path) -> Iterator[bool]:
    """Make the folder ``path``, with its parents, and lock it against other processes; yields whether it existed.

    Removed when the block succeeds; kept when it fails, so that the next call continues there. Raises ``InputError`` if
    another process holds it.
    """
    was_there: list[bool] = []  # at each attempt

    def make() -> Path:
        was_there.append(path.exists())
        path.mkdir(parents=True, exist_ok=True)
        return path

    with _lock_new_path(make):
        yield was_there[-1]
        _remove(path)


def _exchange(path: Path, other: Path) -> bool:
    """Exchange two paths in one step; returns False if the system or the file system cannot."""
    if sys.platform != "linux":
        return False
    import ctypes

    rename, cwd, exchange = getattr(ctypes.CDLL(None), "renameat2", None), -100, 2  # AT_FDCWD, RENAME_EXCHANGE
    return rename is not None and rename(cwd, os.fsencode(path), cwd, os.fsencode(other), exchange) == 0


def _recover(target: Path) -> Path:
    """Return the path where a folder waits while another takes its place in two steps. A folder that waits there is
    moved back if a kill or an error has prevented the second step, else removed.
    """
    waiting = target.with_name(f".signsplice-old-{target.name}")
    if waiting.exists() and not target.exists():
        os.rename(waiting, target)
    _remove(waiting)
    return waiting


@contextmanager
def _temporary(parent: Path, make: Callable[[Path], object], suffix: str = "") -> Iterator[Path]:
    """Yield a new temporary path, made by ``make`` and locked, and remove it at the end; also removes leftovers of
    killed processes in the folder.
    """

    def new() -> Path:
        path = parent / f".signsplice-{os.urandom(8).hex()}{suffix}"
        make(path)
        return path

    sweep(parent)
    with _lock_new_path(new) as path:
        try:
            yield path
        finally:
            _remove(path)


def sweep(parent: Path) -> None:
    """Remove the temporary files and folders of a folder that no process holds."""
    for path in filter(lambda path: _TEMPORARY.fullmatch(path.name), parent.glob(".signsplice-*")):
        with suppress(OSError), _lock_path(path):
            _remove(path)


@contextmanager
def _lock_new_path(make: Callable[[], Path]) -> Iterator[Path]:
    """Yield the path that ``make`` makes, locked if the file system has locks. If another process removes it first, it
    is made again, until no other process holds it. Raises ``InputError`` if that takes too long.
    """
    until = time.monotonic() + _WAIT_S
    with ExitStack() as stack:
        while True:
            path = make()
            try:
                stack.enter_context(_lock_path(path))
                break
            except FileNotFoundError:
                continue
            except BlockingIOError:
                if time.monotonic() >= until:
                    raise InputError(f"{path}: another process is writing there; wait for it, or end it") from None
                time.sleep(0.05)
            except OSError:
                break
        yield path


@contextmanager
def _lock_path(path: Path) -> Iterator[None]:
    """Lock a file or folder for the block. Raises ``FileNotFoundError`` if it was removed or replaced meanwhile,
    ``BlockingIOError`` if another process holds it, ``OSError`` if the system or the file system has no locks.
    """
    if fcntl is None:
        raise OSError(errno.ENOTSUP, "no locks")
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not os.path.samestat(os.fstat(handle), os.lstat(path)):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        yield
    finally:
        os.close(handle)


def _remove(path: Path) -> None:
    """Remove a file or a folder as far as possible; the next process sweeps the rest."""
    with suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()


def _sync(path: Path) -> None:
    """Flush a file or folder to disk, if the system allows it."""
    try:
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise
