"""Worker processes: jobs go to the least busy one, one at a time; one that dies or takes too long is replaced."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from typing import TypeVar

from signsplice.errors import InputError, SignspliceError
from signsplice.service import work
from signsplice.service.settings import Settings

Result = TypeVar("Result")


class BusyError(SignspliceError):
    """There is more to do than may wait."""


class WorkerLostError(SignspliceError):
    """A worker process ended in the middle of a job."""


class WorkerProcess:
    """One process. ``busy``: jobs that it does or that wait for it; ``n_lost``: processes that were replaced."""

    def __init__(self, settings: Settings, skin: bool) -> None:
        self._settings, self._skin = settings, skin
        self._turn = asyncio.Lock()
        self._jobs: set[asyncio.Task[object]] = set()
        self.busy = self.n_lost = self.generation = 0
        self._start()

    def _start(self) -> None:
        self._pool = ProcessPoolExecutor(1, get_context("spawn"), work.begin, (self._settings,))
        self._pid = self._pool.submit(work.identity)
        self._pool.submit(work.warm, self._skin)

    async def run(self, job: Callable[..., Result], *args: object) -> Result:
        """What a job of ``work`` gives. A caller that goes away does not stop it, nor the watch on its time.

        Raises what the job raises; ``InputError`` where it takes longer than it may; ``WorkerLostError``.
        """
        task = asyncio.create_task(self._alone(job, *args))
        self._jobs.add(task)  # else nobody would hold a task whose caller went away
        task.add_done_callback(self._jobs.discard)
        task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return await asyncio.shield(task)

    async def _alone(self, job: Callable[..., Result], *args: object) -> Result:
        self.busy += 1
        try:
            async with self._turn:
                return await self._timed(job, *args)
        finally:
            self.busy -= 1

    async def _timed(self, job: Callable[..., Result], *args: object) -> Result:
        limit = self._settings.work_seconds
        try:
            await asyncio.wrap_future(self._pid)  # the process is up: starting it is not the job's time
            try:
                begun = self._pool.submit(job, *args)
            except BrokenProcessPool:  # it ended while it had nothing to do, which is no fault of this job
                self._replace()
                await asyncio.wrap_future(self._pid)
                begun = self._pool.submit(job, *args)
            return await asyncio.wait_for(asyncio.wrap_future(begun), limit)
        except TimeoutError:
            self._replace()
            raise InputError(f"took more than {limit:g} s of work; send less, or shorter clips") from None
        except BrokenProcessPool:
            self._replace()
            raise WorkerLostError("the process that worked on this ended; it was replaced") from None
        except MemoryError:
            raise InputError("took more memory than a request may; send less, or shorter clips") from None

    def _replace(self) -> None:
        self._kill()
        self.n_lost += 1
        self.generation += 1
        self._start()

    def _kill(self) -> None:
        """End the process, whatever it does."""
        if self._pid.done() and not self._pid.cancelled() and self._pid.exception() is None:
            with suppress(ProcessLookupError):
                os.kill(self._pid.result(), getattr(signal, "SIGKILL", signal.SIGTERM))
        self._pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """End the process and the jobs that wait for it."""
        for task in self._jobs:
            task.cancel()
        self._kill()


class Workers:
    """A row of processes."""

    def __init__(self, settings: Settings, n: int, skin: bool = False) -> None:
        self._row = [WorkerProcess(settings, skin) for _ in range(n)]
        self._most = settings.max_waiting

    @property
    def waiting(self) -> int:
        """Jobs that are done or wait."""
        return sum(worker.busy for worker in self._row)

    @property
    def n_lost(self) -> int:
        """Processes that were replaced so far."""
        return sum(worker.n_lost for worker in self._row)

    async def run(self, job: Callable[..., Result], *args: object) -> Result:
        """As ``Worker.run``, by the least busy one. Raises ``BusyError`` too."""
        if self.waiting >= self._most:
            raise BusyError(f"{self.waiting} requests wait already; try again in a moment")
        return await min(self._row, key=lambda worker: worker.busy).run(job, *args)

    def pick(self, load: Callable[[WorkerProcess], int]) -> WorkerProcess:
        """The worker with the least load, to stay with."""
        return min(self._row, key=load)

    def close(self) -> None:
        """End all of them."""
        for worker in self._row:
            worker.close()
