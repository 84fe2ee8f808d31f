"""Worker processes. Each does one job at a time; ``fair_queue`` decides whose. A process that ends, busy or not, is
noticed at once and replaced.
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
_NICENESS = 5
"""Of long jobs: where quick jobs want the processor, these have a quarter of it (sched(7): a weight of 335 to 1024)."""


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
    started: set when it is ready or has ended.
    ended: set when the process has ended.
    spent: its processor time when it last told, or was killed, seconds.
    """

    def __init__(self, settings: Settings, is_quick: bool, on_end: Callable[[WorkerProcess], None]) -> None:
        """Start the process. ``is_quick``: whether it does quick jobs, those of streams among them.

        ``on_end`` is called once, in the event loop, when it ends.
        """
        self._settings, self._on_end = settings, on_end
        self._loop = asyncio.get_running_loop()
        self._lock = asyncio.Lock()
        self._jobs: set[asyncio.Task[Any]] = set()
        self._answer: asyncio.Future[tuple[bool, Any]] | None = None
        self._has_begun = False
        self.is_ready, self.ended, self.started = False, asyncio.Event(), asyncio.Event()
        self.spent = 0.0
        self._start_limit = self._loop.call_later(settings.work_wall_seconds, self.kill)
        context = get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self._process = context.Process(target=_do_jobs, args=(far_end, settings, is_quick), daemon=True)
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
                    answer = (self.spent, False, error)
                self._loop.call_soon_threadsafe(self._take, *answer)
            self._process.join()
            self._loop.call_soon_threadsafe(self._end)

    def _take(self, spent: float, *answer: Any) -> None:
        self.spent = spent
        if not answer:  # the process is ready, or has begun a job
            self._has_begun = self.is_ready
            self.is_ready = True
            self.started.set()
            self._start_limit.cancel()
        elif self._answer is not None and not self._answer.done():
            self._answer.set_result(answer)

    def _end(self) -> None:
        if self.ended.is_set():
            return
        error = WorkerLostError("the process that worked on this ended; it was replaced")
        self._take(self.spent, False, error if self._has_begun else _not_started())
        self.ended.set()
        self.started.set()
        self._start_limit.cancel()
        self._on_end(self)

    def kill(self) -> None:
        """Kill the process; its running job raises ``WorkerLostError``."""
        self.spent = max(self.spent, _processor_seconds(self.pid) or 0.0)
        self._process.kill()
        self._end()

    def post(self, job: Callable[..., ResultT], *args: object) -> asyncio.Task[ResultT]:
        """As ``run``, for callers that need not wait for the result."""
        task = asyncio.create_task(self.run(job, *args))
        self._jobs.add(task)  # keeps the task alive
        task.add_done_callback(self._jobs.discard)
        task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return task

    async def run(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        """Call a function of ``work`` in the process and return its result. ``fair_queue`` does not cancel it.

        Raises what the job raises; ``InputError`` if it exceeds its work time or memory; ``BusyError`` if it takes
        longer than ``work_wall_seconds`` for another reason; ``WorkerLostError``.
        """
        async with self._lock:
            await self.started.wait()
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


def _do_jobs(pipe: Connection, settings: Settings, is_quick: bool) -> None:
    """Main function of the process: start, then do one job at a time until the service ends.

    Sends its processor time when it is ready and when it begins a job; after a job, also whether it succeeded and its
    result or error.
    """
    work.start_worker(settings)
    with suppress(Exception):  # if the lexicon is at fault, jobs report it
        work.warm_up(is_quick)
    if not is_quick:
        _lower_priority(0, os.getppid())
    gc.collect()
    gc.freeze()  # otherwise the first request waits 50 ms for a scan of all imported objects
    with suppress(EOFError, OSError):
        pipe.send((time.process_time(),))
        while True:
            job, args = pipe.recv()
            pipe.send((time.process_time(),))
            try:
                answer = (True, job(*args))
            except (SignspliceError, MemoryError) as error:
                answer = (False, error)
            except Exception as error:
                traceback.print_exc(file=sys.stderr)
                answer = (False, error)
            pipe.send((time.process_time(), *answer))


def _lower_priority(pid: int, service_pid: int) -> None:
    """Give a process that does long jobs less of the processor than the service has; 0 is the calling process."""
    if sys.platform != "win32":
        with suppress(OSError):  # it has already ended
            os.setpriority(os.PRIO_PROCESS, pid, os.getpriority(os.PRIO_PROCESS, service_pid) + _NICENESS)


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

    n_lost: number of processes replaced so far.
    """

    def __init__(self, settings: Settings, is_quick: bool) -> None:
        """Start the process. ``is_quick``: whether it does quick jobs, those of streams among them."""
        self._settings, self._is_quick = settings, is_quick
        self.n_lost = self._n_failed_starts = 0
        self._spent_before = 0.0
        self._is_closed = self._is_abandoned = False
        self._restart: asyncio.TimerHandle | None = None
        self._was_ready = False
        self._process = WorkerProcess(settings, is_quick, self._replace)

    @property
    def is_warm(self) -> bool:
        """Whether one of its processes has become ready."""
        return self._was_ready or self._process.is_ready

    @property
    def is_ready(self) -> bool:
        """Whether it begins a job at once."""
        return self._process.is_ready

    @property
    def spent(self) -> float:
        """Processor time of its processes so far, with their starts, seconds."""
        return self._spent_before + self._process.spent

    async def recover(self) -> None:
        """Return once its process is ready, or does not start."""
        while not (self.is_ready or self._process.ended.is_set()):
            await self._process.started.wait()

    def abandon(self) -> None:
        """End the running job, by killing the process, unless it is quick: then the process may hold streams."""
        self._is_abandoned = not self._is_quick
        if self._is_abandoned:
            self._process.kill()

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
        self._spent_before += self._process.spent
        self._process = WorkerProcess(self._settings, self._is_quick, self._replace)
        if not self._is_quick:  # the first starts of a service do not yield, these do
            _lower_priority(self._process.pid, 0)

    async def run(self, job: Callable[..., ResultT], *args: object) -> ResultT:
        """As ``WorkerProcess.run``, but tries again if a process ends before it begins the job."""
        return (await self.begin(job, *args))[1]

    async def begin(self, job: Callable[..., ResultT], *args: object) -> tuple[WorkerProcess, ResultT]:
        """Run a job; return its process, for further jobs that need its state there, and its result."""
        self._is_abandoned = False
        for _ in range(_MAX_STARTS):
            process = self._process
            try:
                return process, await process.run(job, *args)
            except NotStartedError:
                if self._is_abandoned:
                    raise
        raise BusyError("the processes for this end while they start; try again later")

    def close(self) -> None:
        """Kill the process."""
        self._is_closed = True
        if self._restart is not None:
            self._restart.cancel()
        self._process.kill()
