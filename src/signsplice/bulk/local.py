"""Shards made by the processes of this machine."""

from __future__ import annotations

import os
import signal
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TypeVar

from signsplice.bulk.shards import ShardResult, make_shard
from signsplice.children import end_with_parent
from signsplice.errors import SignspliceError

Result = TypeVar("Result")

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of workers: how a product is cut among threads decides its last bits."""
_MOST_DEATHS = 8
"""A shard that was being made each time when so many processes ended one after another is to blame for it."""


def make_all(out: str, shards: Iterable[int], workers: int, n_kept: int) -> Iterator[ShardResult]:
    """Make these shards by ``workers`` processes, each as soon as it is whole.

    Processes that end are replaced, and their shards made again. Raises what ``make_shard`` raises, and
    ``SignspliceError`` for a shard that ends every process.
    """
    waiting = list(shards)[::-1]
    deaths: Counter[int] = Counter()
    while waiting:
        with _pool(workers) as pool:
            running: dict[Future[ShardResult], int] = {}
            try:
                while waiting or running:
                    while waiting and len(running) < 2 * workers:
                        running[pool.submit(make_shard, out, waiting[-1], n_kept)] = waiting[-1]
                        waiting.pop()
                    for done in wait(running, return_when=FIRST_COMPLETED).done:
                        result = done.result()
                        del running[done]
                        del deaths[result.shard]
                        yield result
            except BrokenProcessPool:
                begun = sorted(running.values())[:workers]
                deaths.update(begun)
                waiting += sorted(running.values(), reverse=True)
                if max(deaths.values()) >= _MOST_DEATHS:
                    worst = max(deaths, key=lambda shard: deaths[shard])
                    raise SignspliceError(
                        f"{out}: the processes that make shard {worst} end each time, out of memory or by a fault; "
                        "call again with fewer workers, or with fewer words kept in memory"
                    ) from None


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def alone(function: Callable[..., Result], *arguments: object) -> Result:
    """What a function gives in a process like those that make shards."""
    with _pool(1) as pool:
        return pool.submit(function, *arguments).result()


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that start anew, on one thread each, end with this one, and leave Ctrl-C to it."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_begin)
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):  # 3.14 has ProcessPoolExecutor.kill_workers
            process.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
