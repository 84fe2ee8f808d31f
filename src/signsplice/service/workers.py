"""Worker processes, among which jobs are distributed; one that ends is replaced at once, whether it worked or not."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from signsplice.service.settings import Settings

ResultT = TypeVar("ResultT")

_MAX_STARTS = 3
"""Processes whose start a job waits for, one after another."""
_RESTART_SECONDS = 5.0
"""Longest pause before the start of the next process, where one after another ends while it starts."""


class Worker:
    """The place of one process. When that ends, the next one is started.

    busy: number of jobs that run or wait for it.
    is_warm: whether a process has been ready here.
    n_lost: number of processes replaced so far.
    """

    def __init__(self, settings: Settings, for_streams: bool) -> None:
        """Start the process. ``for_streams``: whether its jobs are those of streams."""
        self._settings, self._for_streams = settings, for_streams
        self.busy = self.n_lost = self._n_failed_starts = 0
        self._is_closed = False
        self._restart: asyncio.TimerHandle | None = None
        self._was_ready = False
        self._process = WorkerProcess(settings, for_streams, self._replace)

    @property
    def is_warm(self) -> bool:
        """Whether its process has been ready once, or is."""
        return self._was_ready or self._process.is_ready

    def _replace(self, ended: WorkerProcess) -> None:
        if self._is_closed:
            return
        self.n_lost += 1
        self._was_ready |= ended.is_ready
        self._n_failed_starts = 0 if ended.is_ready else self._n_failed_starts + 1
        if self._n_failed_starts < _MAX_STARTS:
            self._start()
        else:  # something is wrong with the machine; do not keep it busy with starts
            self._restart = asyncio.get_running_loop().call_later(_RESTART_SECONDS, self._start)

    def _start(self) -> None:
        self._process = WorkerProcess(self._settings, self._for_streams, self._replace)

    async def run(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        """As ``WorkerProcess.run``. A process that ends before it begins the job is not the job's fault."""
        return (await self.begin(job, *args))[1]

    async def begin(self, job: Callable[..., ResultT], *args: object) -> tuple[WorkerProcess, ResultT]:
        """The process that did the job, for further jobs that need what it left there; and the job's result."""
        self.busy += 1
        try:
            for _ in range(_MAX_STARTS):
                process = self._process
                with suppress(NotStartedError):
                    return process, await process.run(job, *args)
        finally:
            self.busy -= 1
        raise BusyError("the processes for this end while they start; try again later")

    def close(self) -> None:
        """Kill the process."""
        self._is_closed = True
        if self._restart is not None:
            self._restart.cancel()
        self._process.kill()


class Workers:
    """Several workers."""

    def __init__(self, settings: Settings, n: int, for_streams: bool = False) -> None:
        self._workers = [Worker(settings, for_streams) for _ in range(n)]

    @property
    def n_lost(self) -> int:
        """Number of processes replaced so far."""
        return sum(worker.n_lost for worker in self._workers)

    @property
    def is_warm(self) -> bool:
        """Whether a process has been ready in every place."""
        return all(worker.is_warm for worker in self._workers)

    async def run(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        """As ``Worker.run``, on the least busy one."""
        return await self.least_loaded(lambda worker: worker.busy).run(job, *args)

    def least_loaded(self, load: Callable[[Worker], int]) -> Worker:
        """The worker for which ``load`` is least."""
        return min(self._workers, key=load)

    def close(self) -> None:
        """Kill all processes."""
        for worker in self._workers:
            worker.close()
