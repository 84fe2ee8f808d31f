"""Shards made by the processes of this machine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from signsplice.bulk.shards import ShardResult, make_shard
from signsplice.children import processes
from signsplice.errors import SignspliceError

Result = TypeVar("Result")

_MOST_DEATHS = 8
"""A shard that was being made each time when so many processes ended one after another is to blame for it."""


def make_all(out: str, shards: Iterable[int], workers: int, n_kept: int) -> Iterator[ShardResult | None]:
    """Make these shards by ``workers`` processes, each as soon as it is whole; None once a second in between.

    Processes that end are replaced, and their shards made again. Raises what ``make_shard`` raises, and
    ``SignspliceError`` for a shard that ends every process.
    """
    waiting = list(shards)[::-1]
    deaths: Counter[int] = Counter()
    while waiting:
        with processes(workers) as pool:
            running: dict[Future[ShardResult], int] = {}
            try:
                while waiting or running:
                    while waiting and len(running) < 2 * workers:
                        running[pool.submit(make_shard, out, waiting[-1], n_kept)] = waiting[-1]
                        waiting.pop()
                    ended = wait(running, 1.0, FIRST_COMPLETED).done
                    if not ended:
                        yield None
                    for done in ended:
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


def alone(function: Callable[..., Result], *arguments: object) -> Result:
    """What a function gives in a process like those that make shards."""
    with processes(1) as pool:
        return pool.submit(function, *arguments).result()
