"""A run: the shards that are not there yet, made here or on a cluster; what the folder holds at the end."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from signsplice.bulk import cluster
from signsplice.bulk import job as jobs
from signsplice.bulk.job import BulkJob, BulkOptions
from signsplice.bulk.maker import WORDS_KEPT
from signsplice.bulk.shards import ShardResult, make_shard
from signsplice.children import cores, processes
from signsplice.errors import FormatError, InputError, SignspliceError
from signsplice.formats import atomic

Result = TypeVar("Result")

_MOST_DEATHS = 8
"""A shard that was being made each time when so many processes ended one after another is to blame for it."""


def make_here(out: str, shards: Iterable[int], workers: int, n_kept: int) -> Iterator[ShardResult | None]:
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


MOST_REASONS = 20
"""Reasons for failed rows that a summary lists, the most frequent first."""


@dataclass(frozen=True)
class BulkSummary:
    """What a finished folder holds; the same whoever made it, and in how many goes.

    n_recipes, n_shards, n_failed: rows, shards, and rows of which no sentence could be made.
    n_seams, n_frames, n_bytes: of all sentences, and of the files of their shards.
    seconds: of motion.
    reasons: why rows failed -> how many, the most frequent ``MOST_REASONS``.
    """

    n_recipes: int
    n_shards: int
    n_failed: int
    n_seams: int
    n_frames: int
    n_bytes: int
    seconds: float
    reasons: dict[str, int]


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    n_before: rows of shards that were there before.
    n_done, n_failed: rows so far, those of before and of unfinished shards among them; those that failed, of shards
        that this run has made.
    n_rows: all.
    """

    n_before: int
    n_done: int
    n_failed: int
    n_rows: int


def run(
    out: Path,
    options: BulkOptions,
    batches: Callable[[], Iterable[pa.RecordBatch]],
    workers: int | None = None,
    ray: str | None = None,
    n_kept: int = WORDS_KEPT,
    advance: Callable[[Progress], None] | None = None,
) -> BulkSummary:
    """Make what is missing of a folder of shards, by processes of this machine, or on the Ray cluster at the address
    ``ray``. The folder is begun where there is none.

    batches: makes the recipes, anew at each call.
    workers: how many; by default one for each core of the machine, or of the cluster.
    advance: is told how far it is.

    Raises ``InputError`` where another call is writing there, and what ``prepare``, ``make_here`` and
    ``cluster.make_all`` raise.
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers {workers}, expected 1 or more")
    jobs.check_out(out)
    with _begun(out, options, batches) as job:
        (out / jobs.INDEX).mkdir(exist_ok=True)
        atomic.sweep(out / jobs.INDEX)  # rows of shards that another call was making
        missing = [shard for shard in range(job.n_shards) if not jobs.is_whole(out, job, shard)]
        before = job.n_recipes - sum(len(job.rows(shard)) for shard in missing)
        done, failed = before, 0
        note = advance or (lambda _: None)
        note(Progress(before, done, failed, job.n_recipes))
        if missing:
            (out / jobs.SUMMARY).unlink(missing_ok=True)
        unfinished, shown = set(missing), before
        try:
            for shard in _make_shards(str(out.resolve()), missing, workers, ray, n_kept) if missing else ():
                if shard is not None:
                    done, failed = done + shard.n_rows, failed + shard.n_failed
                    unfinished.discard(shard.shard)
                shown = max(shown, done + jobs.rows_in_progress(out, unfinished))
                note(Progress(before, shown, failed, job.n_recipes))
        except KeyboardInterrupt:
            kept = f"{done} of {job.n_recipes} rows are kept in {out}"
            raise KeyboardInterrupt(f"{kept}; the same command continues from there") from None
        summary = summarize(out, job)
        atomic.write(out / jobs.SUMMARY, json.dumps(asdict(summary), indent=2, ensure_ascii=False) + "\n")
    return summary


@contextmanager
def _begun(out: Path, options: BulkOptions, batches: Callable[[], Iterable[pa.RecordBatch]]) -> Iterator[BulkJob]:
    """The job of a folder that no other call can write to. A call that is refused leaves no trace."""
    was_there = out.exists()
    with atomic.resumable_folder(out / jobs.UNFINISHED) as was_ended:
        try:
            job = jobs.prepare(out, options, batches)
        except BaseException:
            with suppress(OSError):
                if not was_ended:
                    (out / jobs.UNFINISHED).rmdir()
                if not was_there:
                    out.rmdir()
            raise
        try:
            yield job
        finally:
            for folder in (out, out / jobs.INDEX):
                atomic.sweep(folder)  # what workers that were killed have left


def _make_shards(
    out: str, missing: list[int], workers: int | None, ray: str | None, n_kept: int
) -> Iterator[ShardResult | None]:
    if ray is not None:
        return cluster.make_all(out, missing, ray, n_kept, workers)
    return make_here(out, missing, min(workers or cores(), len(missing)), n_kept)


def _index(out: Path, shard: int) -> pa.Table:
    path = jobs.index_of(out, shard)
    try:
        return pq.read_table(path, columns=["frames", "fps", "seams", "error"])
    except (pa.ArrowException, OSError, ValueError) as error:
        what = f"cannot be read as the index of shard {shard} ({str(error)[:200]})"
        raise FormatError(f"{what}; remove it, and the same call makes it anew", file=str(path)) from error


def summarize(out: Path, job: BulkJob) -> BulkSummary:
    """What the shards of a folder hold, from their index. Raises ``InputError`` where a shard is missing."""
    reasons: Counter[str] = Counter()
    n_failed = n_seams = n_frames = n_bytes = 0
    seconds = 0.0
    for shard in range(job.n_shards):
        if not jobs.is_whole(out, job, shard):
            raise InputError(f"{out}: shard {shard} is not whole; the same call makes it")
        table = _index(out, shard)
        failed = [error for error in table["error"].to_pylist() if error is not None]
        reasons.update(failed)
        frames, rates = table["frames"].drop_null().to_numpy(), table["fps"].drop_null().to_numpy()
        n_failed += len(failed)
        n_seams += int(table["seams"].drop_null().to_numpy().sum())
        n_frames += int(frames.sum())
        seconds += float((frames / rates).sum())
        files = jobs.tar_of(out, shard), jobs.index_of(out, shard)
        n_bytes += sum(path.stat().st_size for path in files if path.exists())
    most = dict(sorted(reasons.most_common(MOST_REASONS), key=lambda row: (-row[1], row[0])))
    return BulkSummary(job.n_recipes, job.n_shards, n_failed, n_seams, n_frames, n_bytes, round(seconds, 3), most)
