"""Faults at the k-th operation on the disk: a kill before it (of a write: in the middle of it), or an error of it.

The operations are those by which this package changes a disk: making, opening and writing files, flushing, renaming,
exchanging, linking and removing. The faulty call runs in a forked process, so that a kill is a kill: nothing is
cleaned up, and locks end with the process.
"""

from __future__ import annotations

import builtins
import io
import os
import traceback
import warnings
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

from signsplice.errors import InputError
from signsplice.formats import atomic

KILLED, REFUSED, DONE_DESPITE, NO_SUCH_OPERATION, BROKEN = 77, 78, 79, 80, 81
_OPERATIONS = ("mkdir", "fsync", "rename", "replace", "unlink", "remove", "rmdir", "link", "chmod")


class _Faults:
    """Counts operations; at number ``at`` the process ends (``code`` None) or the operation fails with ``code``."""

    def __init__(self, at: int, code: int | None) -> None:
        self.at, self.code, self.n_done = at, code, 0

    def before(self, in_the_middle: Callable[[], object] | None = None) -> None:
        self.n_done += 1
        if self.n_done != self.at:
            return
        if in_the_middle is not None:
            in_the_middle()
        if self.code is None:
            os._exit(KILLED)
        raise OSError(self.code, os.strerror(self.code))

    def wrapped(self, operation: Callable[..., Any]) -> Callable[..., Any]:
        def faulty(*arguments: Any, **named: Any) -> Any:
            self.before()
            return operation(*arguments, **named)

        return faulty

    def opened(self, opener: Callable[..., Any]) -> Callable[..., Any]:
        def faulty(file: Any, mode: str = "r", *arguments: Any, **named: Any) -> Any:
            if not set(mode) & set("wax+"):
                return opener(file, mode, *arguments, **named)
            self.before()
            return _FaultyFile(opener(file, mode, *arguments, **named), self)

        return faulty

    def install(self) -> None:
        for name in _OPERATIONS:
            setattr(os, name, self.wrapped(getattr(os, name)))
        system_open = os.open

        def faulty_open(path: Any, flags: int, *arguments: Any, **named: Any) -> int:
            if flags & os.O_CREAT:
                self.before()
            return system_open(path, flags, *arguments, **named)

        setattr(os, "open", faulty_open)  # noqa: B010
        setattr(atomic, "_exchange", self.wrapped(atomic._exchange))  # noqa: B010
        io.open = builtins.open = self.opened(io.open)


class _FaultyFile:
    """A file each of whose writes is an operation; of one that is not done, half of the bytes are."""

    def __init__(self, file: Any, faults: _Faults) -> None:
        self._file, self._faults = file, faults

    def write(self, content: Any) -> Any:
        def half() -> None:
            self._file.write(content[: len(content) // 2])
            self._file.flush()

        self._faults.before(half)
        return self._file.write(content)

    def __enter__(self) -> _FaultyFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def outcome(call: Callable[[], object], at: int, code: int | None = None) -> int:
    """How a call ends in a process of its own whose operation number ``at``, from 1, does not happen.

    code: the error of that operation; None: the process is killed there.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # newer Pythons warn of threads in a process that forks; this one has none
        child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    status = BROKEN
    try:
        faults = _Faults(at, code)
        faults.install()
        call()
        status = NO_SUCH_OPERATION if faults.n_done < at else DONE_DESPITE
    except InputError as error:
        status = REFUSED if "\n" not in str(error) else BROKEN
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def every_operation(
    prepare: Callable[[int], object], call: Callable[[int], object], code: int | None = None, step: int = 1
) -> Iterator[tuple[int, int]]:
    """Number and outcome of ``call(number)`` with a fault at each of its operations in turn, or every ``step``-th.

    prepare: called with the number before, without a fault.
    """
    for at in count(1, step):
        prepare(at)
        status = outcome(lambda at=at: call(at), at, code)  # type: ignore[misc]
        if status == NO_SUCH_OPERATION:
            return
        yield at, status
