"""Runs many jobs in a few processes, and checks which of their files an interrupted call left complete."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

from signsplice.children import end_with_parent
from signsplice.errors import SignspliceError


class Pool:
    """Runs jobs in worker processes, or in this one if ``processes`` is 1. A context manager: it returns a function
    ``run(job, items)`` that yields the results in the order of the items, with at most nine jobs submitted ahead. The
    processes end with this one, even if it is killed.
    """

    def __init__(self, processes: int) -> None:
        self.pool = ProcessPoolExecutor(processes, initializer=end_with_parent) if processes > 1 else None

    def __enter__(self) -> Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]:
        return self._run

    def __exit__(self, *_: object) -> None:
        if self.pool is not None:
            self.pool.shutdown(cancel_futures=True)

    def _run(self, job: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
        if self.pool is None:
            yield from map(job, items)
            return
        futures = []
        try:
            for item in items:
                futures.append(self.pool.submit(job, item))
                if len(futures) > 8:
                    yield futures.pop(0).result()
            for future in futures:
                yield future.result()
        except BrokenProcessPool as error:
            raise SignspliceError("a worker process was ended from outside; the same call continues") from error


def is_whole(path: Path) -> bool:
    """Returns whether a .npz file exists and every byte in it agrees with its checksum."""
    try:
        with ZipFile(path) as archive:
            return bool(archive.namelist()) and archive.testzip() is None
    except (OSError, BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError, zlib.error):
        return False  # missing, cut off, or damaged in its directory
