"""Processes that end with the process that started them, also where that one is killed."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from multiprocessing.process import BaseProcess
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of workers: how a product is cut among threads decides its last bits."""


def end_with_parent() -> None:
    """Let this process, a child made by ``multiprocessing``, end as soon as its parent has ended."""
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that start anew, on one thread each, end with this one, and leave Ctrl-C to it."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_begin)
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):  # 3.14 has ProcessPoolExecutor.kill_workers
            process.kill()
        # else its reader waits for the rest of a result that was being written
        pool._result_queue._writer.close()  # type: ignore[attr-defined]
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def in_order(function: Callable[[Item], Result], items: Iterable[Item], workers: int) -> Iterator[Result]:
    """What a function gives for each item, in their order, by so many processes; few are ahead of what is taken.

    With one worker no process is started. Raises what the function raises, and ``BrokenProcessPool`` where a process
    ends.
    """
    if workers == 1:
        yield from map(function, items)
        return
    with processes(workers) as pool:
        ahead: deque[Future[Result]] = deque()
        for item in items:
            ahead.append(pool.submit(function, item))
            if len(ahead) > 4 * workers:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def parent_death_hook() -> Callable[[], None] | None:
    """What ``subprocess.Popen`` calls as ``preexec_fn`` so that the system kills the child when the calling thread has
    ended; None where the system cannot (only Linux can).
    """
    if sys.platform != "linux":
        return None
    import ctypes

    control, parent = ctypes.CDLL(None).prctl, os.getpid()
    set_signal = 1  # PR_SET_PDEATHSIG

    def bind() -> None:
        control(set_signal, signal.SIGKILL)
        if os.getppid() != parent:  # it has ended before the call
            os._exit(1)

    return bind
