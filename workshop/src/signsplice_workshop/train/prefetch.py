"""Batches prepared in advance: while a network is trained on one, another process prepares the next."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from signsplice.children import end_with_parent
from signsplice.errors import SignspliceError
from signsplice.formats.reading import format_errors

Rows = NDArray[np.int64]

_ENDING_SECONDS = 5.0
"""Time that a process has to end by itself."""


class Dataset(Protocol):
    """The data of a training loop. Rows and batches depend on their arguments alone."""

    def __len__(self) -> int:
        """Returns the number of examples; roughly, if they are drawn without end."""
        ...

    def rows(self, step: int, size: int, seed: int) -> Rows:
        """Returns the rows of the batch of a step, which counts from 0."""
        ...

    def batch(self, rows: Sequence[int] | Rows, step: int = 0) -> Any:
        """Returns these rows as one batch."""
        ...


class _BatchWorker:
    """A process with a copy of a dataset that prepares the requested batches, one after another."""

    def __init__(self, dataset: Dataset) -> None:
        context = multiprocessing.get_context("fork")
        self._connection, remote = context.Pipe()
        self._process = context.Process(target=_serve, args=(dataset, remote, self._connection), daemon=True)
        self._process.start()
        remote.close()

    def request(self, rows: Rows, step: int) -> None:
        """Requests a batch."""
        try:
            self._connection.send((rows, step))
        except OSError as error:
            raise self._exit_error() from error

    def receive(self) -> Any:
        """Returns the first requested batch that is not received yet; None if preparing it failed."""
        try:
            return self._connection.recv()
        except (EOFError, OSError) as error:
            raise self._exit_error() from error

    def _exit_error(self) -> SignspliceError:
        self._process.join(1.0)
        return SignspliceError(
            f"the process that makes batches has ended (exit code {self._process.exitcode}); call again to continue "
            "from the last checkpoint"
        )

    def close(self) -> None:
        """Ends the process, whatever it is doing. It has some time to end by itself, and so to remove its own folder of
        temporary files, which it needs to send tensors.
        """
        self._connection.close()
        self._process.join(_ENDING_SECONDS)
        self._process.terminate()
        self._process.join()


def _serve(dataset: Dataset, connection: Connection, parent_end: Connection) -> None:
    """Answers requests until the parent closes its end or dies."""
    end_with_parent()
    parent_end.close()  # This process's copy; while it is open, the parent's death would go unnoticed.
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches both processes; the parent ends this one.
    torch.set_num_threads(1)
    try:
        while True:
            rows, step = connection.recv()
            try:
                batch = dataset.batch(rows, step)
            except Exception:
                batch = None  # The parent repeats it and gets the same error, with its traceback.
            connection.send(batch)
    except (EOFError, OSError):
        return


class _PrefetchedDataset:
    """A dataset whose next batch is prepared while the last one is used."""

    def __init__(self, dataset: Dataset, worker: _BatchWorker, rank_rows: slice) -> None:
        self._dataset, self._worker, self._rank_rows = dataset, worker, rank_rows
        self._size_and_seed: tuple[int, int] | None = None
        self._requested: tuple[int, Rows] | None = None

    def __len__(self) -> int:
        return len(self._dataset)

    def rows(self, step: int, size: int, seed: int) -> Rows:
        self._size_and_seed = (size, seed)
        return self._dataset.rows(step, size, seed)

    def batch(self, rows: Sequence[int] | Rows, step: int = 0) -> Any:
        rows = np.asarray(rows)
        requested, self._requested = self._requested, None
        if self._size_and_seed is not None:
            next_rows = self._dataset.rows(step + 1, *self._size_and_seed)[self._rank_rows]
            self._worker.request(next_rows, step + 1)
            self._requested = (step + 1, next_rows)
        if requested is not None:
            batch = self._worker.receive()
            if batch is not None and requested[0] == step and np.array_equal(requested[1], rows):
                return batch
        return self._dataset.batch(rows, step)


@contextmanager
def prefetch_batches(dataset: Dataset, rank: int = 0, count: int = 1) -> Iterator[Dataset]:
    """Yields the same dataset with a process that prepares batches in advance, which ends with the block.

    ``rank`` of ``count`` processes trains on every ``count``-th row of each batch. If the system cannot copy a process
    (Windows), this one prepares them all.
    """
    if "fork" not in multiprocessing.get_all_start_methods():
        yield dataset
        return
    worker = _BatchWorker(dataset)
    try:
        yield _PrefetchedDataset(dataset, worker, slice(rank, None, count))
    finally:
        worker.close()


T = TypeVar("T")


@contextmanager
def open_signer_file(path: Path) -> Iterator[Any]:
    """Yields the arrays of a signer's file, by name. Raises ``FormatError`` if the block cannot read them."""
    with format_errors(str(path), "file of signing to train on"), np.load(path) as stored:
        yield stored


def group_by_folder(paths: Sequence[Path]) -> list[list[Path]]:
    """Returns paths in their order, consecutive ones of the same folder in one list."""
    return [list(folder) for _, folder in groupby(paths, key=lambda path: path.parent)]


def draw_from_folders(folders: Sequence[Sequence[T]], rng: np.random.Generator) -> T:
    """Returns one entry of one of the folders, whatever their sizes."""
    folder = folders[int(rng.integers(len(folders))) if len(folders) > 1 else 0]
    return folder[int(rng.integers(len(folder)))]
