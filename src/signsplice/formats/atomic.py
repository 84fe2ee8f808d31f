"""Files and folders that are written whole or not at all, also when a process is killed, a disk full or power fails.

What is unfinished lies beside its place, under a hidden name that ``_TEMPORARY`` matches, locked by the process that
writes it. The lock ends with the process, so that the next one that writes there recognises what a kill left behind,
and removes it. What is finished is flushed to disk before it is renamed, and its folder after that.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import sys
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from signsplice.errors import InputError

try:
    import fcntl
except ImportError:  # no Unix: nothing is locked, and so nothing is swept
    fcntl = None  # type: ignore[assignment]

_TEMPORARY = re.compile(r"\.signsplice-[0-9a-f]{16}(\..*)?", re.DOTALL)
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2
_NO_EXCHANGE = (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EPERM)
"""Errors of systems and file systems that cannot exchange two paths."""
_NO_SYNC = (errno.EINVAL, errno.ENOTSUP)
"""Errors of file systems that cannot flush a folder."""
_WAIT_S = 5.0
"""How long to wait for a folder that another process is writing: children of a killed one take a moment to end."""


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary path in the folder of ``path``: renamed to ``path`` when the block succeeds, removed when it fails.

    It has the suffix of ``path``, since writers choose by suffix. Within an unfinished folder of ``replacing_folder``,
    which is whole or not at all itself, it is ``path``. Raises ``InputError`` as ``check_writable`` does, and where the
    disk is full.
    """
    path = Path(path)
    check_writable(path)
    try:
        if any(_TEMPORARY.fullmatch(part) for part in path.absolute().parent.parts):
            yield path
            return
        mode = path.stat().st_mode & 0o777 if path.exists() else None
        with _temporary(path.parent, lambda new: _make_file(new, mode), path.suffix) as temporary:
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
    """Raise ``InputError`` where ``path`` is a folder, a link or a special file such as a device, or its own folder is
    missing or not writable.
    """
    path = Path(path)
    try:
        kind = path.lstat().st_mode
    except OSError:
        kind = stat.S_IFREG  # nothing is there; the folder is checked below
    if stat.S_ISDIR(kind):
        raise InputError(f"{path}: is a folder, expected a file name to write to")
    if stat.S_ISLNK(kind):
        raise InputError(f"{path}: is a link, which would be replaced; name the file that it leads to, or a new file")
    if not stat.S_ISREG(kind):
        raise InputError(f"{path}: is {_special(kind)}, which would be replaced; name a file")
    if not path.parent.is_dir():
        raise InputError(f"{path}: folder {path.parent} does not exist; make it first")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: folder {path.parent} is not writable")


def _special(mode: int) -> str:
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"


def put_file(made: Path, target: Path) -> None:
    """Rename a finished file to ``target`` so that it is still there, whole, after power has failed."""
    _sync(made)
    os.replace(made, target)
    _sync(target.parent)


@contextmanager
def replacing_folder(path: str | Path, hint: str = "nothing was left there half-written") -> Iterator[Path]:
    """A temporary folder next to ``path``: takes its place when the block succeeds, removed when it fails.

    Whatever is at ``path`` is replaced: the caller has asked ``check_folder``. Raises ``InputError``, which ends with
    ``hint``, where it cannot be written or the disk is full.
    """
    check_place(path)
    target = Path(path).resolve()  # "." has no name of its own
    if target.exists() and not target.is_dir():
        raise InputError(f"{path}: is a file, expected a folder or a new name")
    try:
        _recover(target)
        with _temporary(target.parent, os.mkdir) as temporary:
            yield temporary
            for parent, _, names in os.walk(temporary, topdown=False):
                for name in names:
                    _sync(Path(parent, name))
                _sync(Path(parent))
            _put_folder(temporary, target)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); {hint}") from error


def check_folder(path: str | Path, mark: str, written: Callable[[Path], Collection[str]]) -> None:
    """Raise ``InputError`` where ``check_place`` does, or where something is at ``path`` that is neither an empty
    folder nor earlier output alone: with the file ``mark``, and no other file or folder than ``written`` names.

    written: paths of the files, relative to the folder, that earlier output holds; raises ``InputError`` where the
    folder is none.
    """
    path = Path(path)
    check_place(path)
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return
    if not (path.is_dir() and (path / mark).exists()):
        raise InputError(f"{path}: is there already and has no {mark}; choose a new name")
    check_nothing_else(path, written(path), mark)


def check_nothing_else(folder: Path, files: Collection[str], what: str) -> None:
    """Raise ``InputError`` where ``folder`` holds something beside ``files``, relative paths, and their folders."""
    known = {Path(file) for file in files}
    folders = {parent for file in known for parent in file.parents}
    found = {path.relative_to(folder): path.is_dir() and not path.is_symlink() for path in folder.rglob("*")}
    others = sorted(path for path, is_dir in found.items() if path not in (folders if is_dir else known))
    if others:
        raise InputError(
            f"{folder}: holds {others[0]} beside its {what}, which would be lost; move it or choose a name"
        )


def check_place(path: str | Path) -> None:
    """Raise ``InputError`` where no folder can be put at ``path``: it is a link or a mount point, or its own folder is
    missing or not writable.
    """
    path = Path(path)
    if path.is_symlink():
        raise InputError(f"{path}: is a link, which would be replaced; name the folder that it leads to, or a new one")
    parent = path.resolve().parent
    if not parent.is_dir():
        raise InputError(f"{path}: folder {path.parent} does not exist; make it first")
    if os.path.ismount(path):
        raise InputError(f"{path}: is a mount point, which cannot be replaced; name a folder within it")
    if not os.access(parent, os.W_OK):
        raise InputError(f"{path}: folder {path.parent} is not writable")


@contextmanager
def resumable_folder(path: Path) -> Iterator[bool]:
    """Makes the folder ``path``, with those that it is in, and keeps other processes out of it; gives whether it was
    there already. It is removed when the block succeeds; when it fails, it stays, and the next call continues there.
    Raises ``InputError`` where another process is in it.
    """
    lock, was_there = None, False
    while True:
        try:
            path.mkdir(parents=True)
            was_there = False
        except FileExistsError:
            was_there = True
        with suppress(FileNotFoundError):  # removed since by another process that has finished
            lock = _lock(path, _WAIT_S)
            break
    try:
        yield was_there
        _remove(path)
    finally:
        _unlock(lock)


def _put_folder(made: Path, target: Path) -> None:
    """Put a finished folder in the place of ``target``; what was there is then at ``made``, or gone.

    Where two folders cannot be exchanged in one step, a kill may leave nothing at ``target``: ``_recover`` brings it
    back.
    """
    if not target.exists():
        os.rename(made, target)
    elif not _exchange(made, target):
        old = _old(target)
        os.rename(target, old)
        try:
            os.rename(made, target)
        except OSError:
            os.rename(old, target)
            raise
        _remove(old)
    _sync(target.parent)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two paths in one step; False where the system or the file system cannot."""
    if sys.platform != "linux":
        return False
    import ctypes

    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except AttributeError:
        return False
    if rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in _NO_EXCHANGE:
        return False
    raise OSError(code, os.strerror(code), str(other))


def _old(target: Path) -> Path:
    """Where a folder waits while another takes its place in two steps."""
    return target.with_name(f".signsplice-old-{target.name}")


def _recover(target: Path) -> None:
    """Undo the first of two steps where a kill has prevented the second."""
    old = _old(target)
    if old.exists():
        if target.exists():
            _remove(old)
        else:
            os.rename(old, target)


# --- temporary files and folders


@contextmanager
def _temporary(parent: Path, make: Callable[[Path], object], suffix: str = "") -> Iterator[Path]:
    """A new temporary path, locked and made by ``make``. Whatever is there at the end is removed, and so is what killed
    processes have left in the folder.
    """
    sweep(parent)
    while True:
        path = parent / f".signsplice-{os.urandom(8).hex()}{suffix}"
        make(path)
        with suppress(FileNotFoundError, InputError):  # swept by another process before it was locked
            lock = _lock(path)
            break
    try:
        yield path
    finally:
        _remove(path)
        _unlock(lock)


def _make_file(path: Path, mode: int | None) -> None:
    """Make an empty file as private as the one that it is to replace."""
    permissions = 0o666 if mode is None else mode | stat.S_IRUSR | stat.S_IWUSR
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, permissions))


def sweep(parent: Path) -> None:
    """Remove the temporary files and folders of a folder that no process holds."""
    names: list[str] = []
    with suppress(OSError):  # a folder that may be written, but not listed
        names = os.listdir(parent)
    for name in filter(_TEMPORARY.fullmatch, names):
        with suppress(OSError, InputError):
            lock = _lock(parent / name)
            if lock is not None:
                _remove(parent / name)
            _unlock(lock)


def _lock(path: Path, wait_s: float = 0.0) -> int | None:
    """A descriptor that locks a file or folder until it is closed; None where the file system has no locks.

    Raises ``FileNotFoundError`` where the path is gone or another file by then, ``InputError`` where another process
    holds it after ``wait_s``.
    """
    if fcntl is None:
        return None
    lock = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        until = time.monotonic() + wait_s
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() >= until:
                    raise InputError(f"{path}: another process is writing there; wait for it, or end it") from None
                time.sleep(0.05)
        if not os.path.samestat(os.fstat(lock), os.lstat(path)):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    except OSError as error:
        os.close(lock)
        if isinstance(error, FileNotFoundError):
            raise
        return None
    except InputError:
        os.close(lock)
        raise
    return lock


def _unlock(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


def _remove(path: Path) -> None:
    """Remove a file or a folder as far as that is possible; the rest is swept by the next process."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()


def _sync(path: Path) -> None:
    """Flush a file or folder to disk."""
    if os.name != "posix":
        return
    try:
        handle = os.open(path, os.O_RDONLY)
    except PermissionError:  # what may be written, but not read, is flushed when the system does so
        return
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise
    finally:
        os.close(handle)
