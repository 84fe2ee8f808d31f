"""Distributes jobs among worker processes. Each does one job at a time. A process that ends, busy or not, is noticed at
once and replaced.
"""

from __future__ import annotations

import asyncio
import gc
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from signsplice.errors import InputError, SignspliceError
from signsplice.service import work
from signsplice.service.settings import Settings

ResultT = TypeVar("ResultT")

_CHECK_SECONDS = 0.25
"""How often the work time of a running job is compared with its limit."""


class BusyError(SignspliceError):
    """The service has too much to do; the same request may succeed later."""


class WorkerLostError(SignspliceError):
    """A worker process ended before a job was done."""


class NotStartedError(WorkerLostError):
    """A worker process ended before it began a job; another process can do it."""


def _not_started() -> NotStartedError:
    return NotStartedError("the process that was to work on this ended; it was replaced")


class WorkerProcess:
    """One process. It starts, becomes ready, and ends: killed by ``kill``, by a limit, or from outside.

    A thread waits for messages of the process. The pipe breaks when the process ends, so that no caller waits for a
    dead process.

    is_ready: whether it has started, so that it does jobs.
    ended: set when the process has ended.
    """

    def __init__(self, settings: Settings, for_streams: bool, on_end: Callable[[WorkerProcess], None]) -> None:
        """Start the process. ``for_streams``: whether it does jobs of streams.

        ``on_end`` is called once, in the event loop, when it ends.
        """
        self._settings, self._on_end = settings, on_end
        self._loop = asyncio.get_running_loop()
        self._lock = asyncio.Lock()
        self._jobs: set[asyncio.Task[Any]] = set()
        self._answer: asyncio.Future[tuple[bool, Any]] | None = None
        self._has_begun = False
        self.is_ready, self.ended, self._started = False, asyncio.Event(), asyncio.Event()
        self._start_limit = self._loop.call_later(settings.work_wall_seconds, self.kill)
        context = get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self._process = context.Process(target=_do_jobs, args=(far_end, settings, for_streams), daemon=True)
        self._process.start()
        far_end.close()
        threading.Thread(target=self._receive, daemon=True).start()

    @property
    def pid(self) -> int:
        """Process number."""
        return self._process.pid or 0

    def _receive(self) -> None:
        """Pass messages of the process to the event loop, until it ends; runs in a thread."""
        with suppress(RuntimeError):  # the event loop is closed: no caller waits any more
            while True:
                try:
                    answer = self._pipe.recv()
                except (EOFError, OSError):
                    break
                except Exception as error:  # an unreadable answer; the next one may be readable
                    answer = (False, error)
                self._loop.call_soon_threadsafe(self._take, answer)
            self._process.join()
            self._loop.call_soon_threadsafe(self._end)

    def _take(self, answer: tuple[bool, Any] | None) -> None:
        if answer is None:  # the process is ready, or has begun a job
            self._has_begun = self.is_ready
            self.is_ready = True
            self._started.set()
            self._start_limit.cancel()
        elif self._answer is not None and not self._answer.done():
            self._answer.set_result(answer)

    def _end(self) -> None:
        if self.ended.is_set():
            return
        error = WorkerLostError("the process that worked on this ended; it was replaced")
        self._take((False, error if self._has_begun else _not_started()))
        self.ended.set()
        self._started.set()
        self._start_limit.cancel()
        self._on_end(self)

    def kill(self) -> None:
        """Kill the process; its running job raises ``WorkerLostError``."""
        self._process.kill()
        self._end()

    async def run(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        """Call a function of ``work`` in the process and return its result.

        Cancelling the caller stops neither the job nor its limits.

        Raises what the job raises; ``InputError`` if it exceeds its work time or memory; ``BusyError`` if it takes
        longer than ``work_wall_seconds`` for another reason; ``WorkerLostError``.
        """
        return await asyncio.shield(self.post(job, *args))

    def post(self, job: Callable[..., ResultT], *args: object) -> asyncio.Task[ResultT]:
        """As ``run``, for callers that need not wait for the result."""
        task = asyncio.create_task(self._run_alone(job, *args))
        self._jobs.add(task)  # keeps the task alive after its caller is cancelled
        task.add_done_callback(self._jobs.discard)
        task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return task

    async def _run_alone(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        async with self._lock:
            await self._started.wait()
            if self.ended.is_set():
                raise _not_started()
            self._answer, self._has_begun = self._loop.create_future(), False
            try:
                async with asyncio.timeout(self._settings.work_wall_seconds):
                    done, result = await self._within_work_time(self._answer, (job, args))
            except TimeoutError:
                self.kill()
                raise BusyError(
                    f"not done after {self._settings.work_wall_seconds:g} s; the machine is overloaded, try again later"
                ) from None
        if done:
            return result  # type: ignore[no-any-return]
        if isinstance(result, MemoryError):
            raise InputError("took more memory than a request may; send less, or shorter clips")
        raise result

    async def _within_work_time(
        self, answer: asyncio.Future[tuple[bool, Any]], request: tuple[Callable[..., Any], tuple[object, ...]]
    ) -> tuple[bool, Any]:
        work_seconds = _work_clock(self.pid)
        try:
            await asyncio.to_thread(self._pipe.send, request)  # in a thread, since uploads are long
        except OSError:
            self.kill()
            raise _not_started() from None
        while not (await asyncio.wait({answer}, timeout=_CHECK_SECONDS))[0]:
            if work_seconds() > self._settings.work_seconds:
                self.kill()
                limit = self._settings.work_seconds
                raise InputError(f"took more than {limit:g} s of work; send less, or shorter clips")
        return answer.result()


def _do_jobs(pipe: Connection, settings: Settings, for_streams: bool) -> None:
    """Main function of the process: start, then do one job at a time until the service ends.

    Sends None when it is ready and when it begins a job; after a job, whether it succeeded and its result or error.
    """
    work.start_worker(settings)
    with suppress(Exception):  # if the lexicon is at fault, jobs report it
        work.warm_up(for_streams)
    gc.collect()
    gc.freeze()  # otherwise the first request waits 50 ms for a scan of all imported objects
    with suppress(EOFError, OSError):
        pipe.send(None)
        while True:
            job, args = pipe.recv()
            pipe.send(None)
            try:
                answer = (True, job(*args))
            except (SignspliceError, MemoryError) as error:
                answer = (False, error)
            except Exception as error:
                traceback.print_exc(file=sys.stderr)
                answer = (False, error)
            pipe.send(answer)


def _work_clock(pid: int) -> Callable[[], float]:
    """Return a function that returns the seconds that a process has worked since this call; 0 after it has ended.

    On Linux this is processor time of all threads together, so that other processes that keep the processors busy do
    not count. Elsewhere it is wall-clock time.
    """
    start, wall_start = _processor_seconds(pid), time.monotonic()
    if start is None:
        return lambda: time.monotonic() - wall_start
    return lambda: (_processor_seconds(pid) or start) - start


def _processor_seconds(pid: int) -> float | None:
    """Return user plus system time of a process, seconds; None if unknown."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
    values = text.rpartition(")")[2].split()  # after the program's name, from field 3 of proc(5) on
    return (int(values[11]) + int(values[12])) / os.sysconf("SC_CLK_TCK")  # utime, stime


_MAX_STARTS = 3
"""Maximum number of successive process starts that a job waits for."""
_RESTART_SECONDS = 5.0
"""Pause before the next start if processes repeatedly end while they start, seconds."""


class Worker:
    """A worker, backed by one process; if that ends, the next one starts.

    busy: number of jobs that run or wait for it.
    is_warm: whether one of its processes has become ready.
    n_lost: number of processes replaced so far.
    """

    def __init__(self, settings: Settings, for_streams: bool) -> None:
        """Start the process. ``for_streams``: whether it does jobs of streams."""
        self._settings, self._for_streams = settings, for_streams
        self.busy = self.n_lost = self._n_failed_starts = 0
        self._is_closed = False
        self._restart: asyncio.TimerHandle | None = None
        self._was_ready = False
        self._process = WorkerProcess(settings, for_streams, self._replace)

    @property
    def is_warm(self) -> bool:
        """Whether one of its processes has become ready."""
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
        """As ``WorkerProcess.run``, but tries again if a process ends before it begins the job."""
        return (await self.begin(job, *args))[1]

    async def begin(self, job: Callable[..., ResultT], *args: object) -> tuple[WorkerProcess, ResultT]:
        """Run a job; return its process, for further jobs that need its state there, and its result."""
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
        """Whether every worker is warm."""
        return all(worker.is_warm for worker in self._workers)

    async def run(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        """As ``Worker.run``, on the least busy one."""
        return await self.least_loaded(lambda worker: worker.busy).run(job, *args)

    def least_loaded(self, load: Callable[[Worker], int]) -> Worker:
        """Return the worker with the least ``load``."""
        return min(self._workers, key=load)

    def close(self) -> None:
        """Kill all processes."""
        for worker in self._workers:
            worker.close()
