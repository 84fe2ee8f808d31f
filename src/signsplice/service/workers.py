"""Worker processes: each does one job at a time; one that ends or exceeds a limit is replaced."""

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
from signsplice.service.processor_time import WorkTime
from signsplice.service.settings import Settings

ResultT = TypeVar("ResultT")

_CHECK_SECONDS = 0.25
"""How often the work time of a running job is compared with its limit."""


class BusyError(SignspliceError):
    """The service has too much to do; the same request may succeed later."""


class WorkerLostError(SignspliceError):
    """A worker process ended in the middle of a job."""


class _WorkTimeError(Exception):
    """A job used up its work time."""


class WorkerProcess:
    """One process, replaced when it is lost. ``skin``: whether it makes the mannequin's skin at its start.

    busy: number of jobs that run or wait for it.
    n_lost: number of processes replaced so far.
    generation: changes with every replacement, which loses the streams that the process held.
    """

    def __init__(self, settings: Settings, skin: bool) -> None:
        self._settings, self._skin = settings, skin
        self._lock = asyncio.Lock()
        self._jobs: set[asyncio.Task[object]] = set()
        self.busy = self.n_lost = self.generation = 0
        self._start()

    def _start(self) -> None:
        self._pool = ProcessPoolExecutor(1, get_context("spawn"), work.start_worker, (self._settings,))
        self._pid = self._pool.submit(work.process_id)
        self._warm = self._pool.submit(work.warm_up, self._skin)

    async def run(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        """The result of a function of ``work``, called in the process.

        A caller that is cancelled stops neither the job nor its limits.

        Raises what the job raises; ``InputError`` where it needs more work time or memory than it may; ``BusyError``
        where it takes longer than ``work_wall_seconds`` for another reason; ``WorkerLostError``.
        """
        task = asyncio.create_task(self._run_alone(job, *args))
        self._jobs.add(task)  # keeps the task alive after its caller was cancelled
        task.add_done_callback(self._jobs.discard)
        task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return await asyncio.shield(task)

    async def _run_alone(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        self.busy += 1
        try:
            async with self._lock:
                return await self._run_limited(job, *args)
        finally:
            self.busy -= 1

    async def _run_limited(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        limits = self._settings
        try:
            async with asyncio.timeout(limits.work_wall_seconds):
                return await self._within_work_time(await self._submit(job, *args))
        except _WorkTimeError:
            self._replace()
            raise InputError(f"took more than {limits.work_seconds:g} s of work; send less, or shorter clips") from None
        except TimeoutError:
            self._replace()
            raise BusyError(
                f"not done after {limits.work_wall_seconds:g} s; the machine is overloaded, try again later"
            ) from None
        except BrokenProcessPool:
            self._replace()
            raise WorkerLostError("the process that worked on this ended; it was replaced") from None
        except MemoryError:
            raise InputError("took more memory than a request may; send less, or shorter clips") from None

    async def _submit(self, job: Callable[..., ResultT], *args: object) -> asyncio.Future[ResultT]:
        """The started job, in a process that is ready for it."""
        await self._ready()
        try:
            return asyncio.wrap_future(self._pool.submit(job, *args))
        except BrokenProcessPool:  # the process ended while it was idle, which is not this job's fault
            self._replace()
            await self._ready()
            return asyncio.wrap_future(self._pool.submit(job, *args))

    async def _ready(self) -> None:
        """Wait for the start of the process, which is no part of a job's work time."""
        await asyncio.wrap_future(self._pid)
        with suppress(Exception):  # if it is the lexicon's fault, jobs report it
            await asyncio.wrap_future(self._warm)

    async def _within_work_time(self, result: asyncio.Future[ResultT]) -> ResultT:
        work_time = WorkTime(self._pid.result())
        try:
            while not (await asyncio.wait({result}, timeout=_CHECK_SECONDS))[0]:
                if work_time.seconds() > self._settings.work_seconds:
                    raise _WorkTimeError
            return result.result()
        finally:
            result.cancel()  # does nothing to a result that has come

    def _replace(self) -> None:
        self._kill()
        self.n_lost += 1
        self.generation += 1
        self._start()

    def _kill(self) -> None:
        if self._pid.done() and not self._pid.cancelled() and self._pid.exception() is None:
            with suppress(ProcessLookupError):
                os.kill(self._pid.result(), getattr(signal, "SIGKILL", signal.SIGTERM))
        self._pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """Kill the process; jobs that wait for it are cancelled."""
        for task in self._jobs:
            task.cancel()
        self._kill()


class Workers:
    """Several worker processes, among which jobs are distributed."""

    def __init__(self, settings: Settings, n: int, skin: bool = False) -> None:
        self._processes = [WorkerProcess(settings, skin) for _ in range(n)]
        self._max_waiting = settings.max_waiting

    @property
    def waiting(self) -> int:
        """Number of jobs that run or wait."""
        return sum(worker.busy for worker in self._processes)

    @property
    def n_lost(self) -> int:
        """Number of processes replaced so far."""
        return sum(worker.n_lost for worker in self._processes)

    async def run(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        """As ``WorkerProcess.run``, on the least busy process. Raises ``BusyError`` also where too many jobs wait."""
        if self.waiting >= self._max_waiting:
            raise BusyError(f"{self.waiting} requests wait already; try again in a moment")
        return await self.least_loaded(lambda worker: worker.busy).run(job, *args)

    def least_loaded(self, load: Callable[[WorkerProcess], int]) -> WorkerProcess:
        """The process for which ``load`` is least."""
        return min(self._processes, key=load)

    def close(self) -> None:
        """Kill all processes."""
        for worker in self._processes:
            worker.close()
