"""Files and folders that are written whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from signsplice.errors import InputError


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary path in the folder of ``path``: renamed to ``path`` when the block succeeds, removed when it fails.

    It has the suffix of ``path``, since writers choose by suffix. Raises ``InputError`` where the folder is missing or
    not writable, or ``path`` is a folder.
    """
    path = Path(path)
    check_writable(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise InputError(f"{path}: cannot write there ({error.strerror})") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)  # mkstemp makes a private file; give it the mode that open() would have given
        os.umask(umask)
        temporary.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~umask)
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot write there ({error.strerror or error})") from error
    finally:
        temporary.unlink(missing_ok=True)


def check_writable(path: str | Path) -> None:
    """Raise ``InputError`` where ``path`` is a folder, or its own folder is missing or not writable."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, expected a file name to write to")
    if not path.parent.is_dir():
        raise InputError(f"{path}: folder {path.parent} does not exist; make it first")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: folder {path.parent} is not writable")


@contextmanager
def replacing_folder(path: str | Path, mark: str) -> Iterator[Path]:
    """A temporary folder next to ``path``: renamed to ``path`` when the block succeeds, removed when it fails.

    A folder at ``path`` is replaced only if it is empty or holds the file ``mark``, by which earlier output is
    recognised. Raises ``InputError`` where something else is there, it cannot be written, or the disk is full.
    """
    target = Path(path)
    check_folder(target, mark)
    temporary: Path | None = None
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.resolve().parent))
        yield temporary
        put_folder(temporary, target)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); nothing was left there") from error
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def check_folder(path: Path, mark: str) -> None:
    """Raise ``InputError`` where ``replacing_folder(path, mark)`` would refuse."""
    parent = path.resolve().parent
    if not parent.is_dir():
        raise InputError(f"{path}: folder {path.parent} does not exist; make it first")
    if not os.access(parent, os.W_OK):
        raise InputError(f"{path}: folder {path.parent} is not writable")
    if path.exists() and not (path.is_dir() and ((path / mark).exists() or not any(path.iterdir()))):
        raise InputError(f"{path}: is there already and has no {mark}; choose a new name")


def put_folder(made: Path, target: Path) -> None:
    """Rename a finished folder to ``target``; a folder that was there is restored if that fails."""
    target = target.resolve()
    umask = os.umask(0)  # mkdtemp makes a private folder
    os.umask(umask)
    made.chmod(0o777 & ~umask)
    old = target.with_name(f".{target.name}-old-{os.getpid()}")
    if target.exists():
        target.rename(old)
    try:
        made.rename(target)
    except OSError:
        if old.exists():
            old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)
