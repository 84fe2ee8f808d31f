"""A fair queue for worker processes: next is the waiting job of the client that has had the least work."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from signsplice.service.workers import Worker

ResultT = TypeVar("ResultT")


@dataclass(eq=False)
class _Turn:
    """A job that waits or runs.

    seconds: its expected work.
    since: when it came, by ``time.monotonic``.
    """

    client: str
    workers: Sequence[Worker]
    seconds: float
    job: Callable[[Worker], Coroutine[Any, Any, Any]]
    answer: asyncio.Future[Any] = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    since: float = field(default_factory=time.monotonic)


class FairQueue:
    """One queue for several workers. Work is processor time, with the restart of a process that a client costs.

    This is start-time fair queuing (Goyal, Vin and Cheng 1996), but a client that comes back starts at the work of the
    active client that has had the least, not at that of the last job: otherwise long jobs at one worker would put a new
    client behind those that use other workers. Idle time earns nothing; when nothing runs or waits, all start anew.

    shared: workers of which a client has all but one at most, so that one is free for others, if there are several.
    """

    def __init__(self, shared: Sequence[Worker] = ()) -> None:
        self._shared = shared
        self._waiting: list[_Turn] = []
        self._running: dict[Worker, _Turn] = {}
        self._work: dict[str, float] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def wait_seconds(self) -> float:
        """How long the job that has waited longest has waited; 0 if none waits."""
        return max((time.monotonic() - turn.since for turn in self._waiting), default=0.0)

    async def run(
        self,
        client: str,
        workers: Sequence[Worker],
        seconds: float,
        job: Callable[[Worker], Coroutine[Any, Any, ResultT]],
    ) -> ResultT:
        """Do a job at one of ``workers`` when it is the client's turn, and return its result. ``seconds``: its expected
        work, which counts while it runs; then the work done counts.

        Cancelling the caller removes a waiting job, and makes the worker of a running one ``abandon`` it.
        """
        turn = _Turn(client, workers, seconds, job)
        self._admit(client)
        self._waiting.append(turn)
        self._grant()
        try:
            return await turn.answer  # type: ignore[no-any-return]
        finally:
            if turn in self._waiting:
                self._waiting.remove(turn)
            for worker in [worker for worker, running in self._running.items() if running is turn]:
                if turn.answer.cancelled():
                    worker.abandon()

    async def _serve(self, turn: _Turn, worker: Worker) -> None:
        """Do a job, charge its work, and give the worker to the next once it has recovered."""
        before = worker.spent
        try:
            result = None if turn.answer.done() else await turn.job(worker)
            if not turn.answer.done():
                turn.answer.set_result(result)
        except Exception as error:
            if not turn.answer.done():
                turn.answer.set_exception(error)
        await worker.recover()
        self._work[turn.client] += worker.spent - before
        del self._running[worker]
        self._grant()

    def _admit(self, client: str) -> None:
        """Set the work of a client that comes back, and forget that of clients who would come back to the same."""
        active = {turn.client for turn in (*self._waiting, *self._running.values())}
        if client not in active:
            least = min((self._work[name] for name in active), default=0.0)
            self._work = {name: work for name, work in self._work.items() if active and work >= least}
            self._work.setdefault(client, least)

    def _grant(self) -> None:
        """Give free workers to those whose turn it is."""
        waiting = [turn for turn in self._waiting if not turn.answer.done()]
        while choices := [(turn, worker) for turn in waiting if (worker := self._find_free_worker(turn))]:
            turn, worker = min(choices, key=lambda choice: self._count_work(choice[0].client))
            waiting.remove(turn)
            self._waiting.remove(turn)
            self._running[worker] = turn
            task = asyncio.create_task(self._serve(turn, worker))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    def _count_work(self, client: str) -> float:
        """Return a client's work so far, with what its running jobs are expected to take, seconds."""
        return self._work[client] + sum(turn.seconds for turn in self._running.values() if turn.client == client)

    def _find_free_worker(self, turn: _Turn) -> Worker | None:
        """Return a free worker for a job, one that is ready if possible; None if it has to wait."""
        n_held = sum(self._running[worker].client == turn.client for worker in self._shared if worker in self._running)
        barred = self._shared if n_held >= max(1, len(self._shared) - 1) else ()
        free = [worker for worker in turn.workers if worker not in self._running and worker not in barred]
        return min(free, key=lambda worker: not worker.is_ready, default=None)
