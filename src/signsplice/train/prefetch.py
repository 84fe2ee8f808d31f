"""Batches made ahead: while a network learns from one, another process makes the next."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

Rows = NDArray[np.int64]


class Dataset(Protocol):
    """What a loop learns from: rows of a step, and rows side by side. Both are functions of their arguments alone."""

    def __len__(self) -> int:
        """How many pairs there are; of data without end, about how many."""
        ...

    def rows(self, step: int, size: int, seed: int) -> Rows:
        """The rows of a step's batch, counted from 0."""
        ...

    def batch(self, rows: Sequence[int] | Rows, step: int = 0) -> Any:
        """These rows side by side."""
        ...


_made: dict[str, Dataset] = {}


def _begin(data: Dataset) -> None:
    torch.set_num_threads(1)
    _made["data"] = data


def _batch(rows: Rows, step: int) -> Any:
    return _made["data"].batch(rows, step)


class _PrefetchedDataset:
    """Data whose next batch is being made while the last one is used."""

    def __init__(self, data: Dataset, pool: ProcessPoolExecutor, share: slice) -> None:
        self._data, self._pool, self._share = data, pool, share
        self._waiting: dict[int, tuple[Rows, Future[Any]]] = {}
        self._asked: tuple[int, int] | None = None

    def __len__(self) -> int:
        return len(self._data)

    def rows(self, step: int, size: int, seed: int) -> Rows:
        self._asked = (size, seed)
        return self._data.rows(step, size, seed)

    def batch(self, rows: Sequence[int] | Rows, step: int = 0) -> Any:
        rows = np.asarray(rows)
        known, future = self._waiting.pop(step, (None, None))
        self._waiting.clear()
        if self._asked is not None:
            following = self._data.rows(step + 1, *self._asked)[self._share]
            self._waiting[step + 1] = (following, self._pool.submit(_batch, following, step + 1))
        if future is not None and known is not None and np.array_equal(known, rows):
            return future.result()
        return self._data.batch(rows, step)


@contextmanager
def prefetched(data: Dataset, rank: int = 0, count: int = 1) -> Iterator[Dataset]:
    """The same data, with one process that makes batches ahead; ``rank`` of ``count`` trainers share each batch."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("fork"), _begin, (data,)) as pool:
        try:
            yield _PrefetchedDataset(data, pool, slice(rank, None, count))
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
