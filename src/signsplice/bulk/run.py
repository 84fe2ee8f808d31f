"""A run: makes the missing shards of a folder, here or on a cluster, and summarises the folder."""

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
"""A shard in progress at this many breakdowns of the pool, without being completed in between, is blamed for them."""


def make_here(out: str, shards: Iterable[int], workers: int, n_words_kept: int) -> Iterator[ShardResult | None]:
    """Make these shards in ``workers`` processes; yields each when it is complete, and None every second in between.

    n_words_kept: number of words that each process keeps in memory.

    Replaces processes that end, and repeats their shards. Raises what ``make_shard`` raises, and ``SignspliceError``
    for a shard that ends every process.
    """
    waiting = list(shards)[::-1]
    deaths: Counter[int] = Counter()
    while waiting:
        with processes(workers) as pool:
            running: dict[Future[ShardResult], int] = {}
            try:
                while waiting or running:
                    while waiting and len(running) < 2 * workers:
                        running[pool.submit(make_shard, out, waiting[-1], n_words_kept)] = waiting[-1]
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


def call_in_process(function: Callable[..., Result], *arguments: object) -> Result:
    """Call a function in a process like those that make shards, and return its result."""
    with processes(1) as pool:
        return pool.submit(function, *arguments).result()


MOST_REASONS = 20
"""Maximum number of reasons for failed rows in a summary, the most frequent first."""


@dataclass(frozen=True)
class BulkSummary:
    """Content of a finished folder; independent of workers and interruptions.

    n_recipes, n_shards, n_failed: numbers of rows, of shards, and of rows without a sentence.
    n_seams, n_frames: of all sentences.
    n_bytes: size of the files of all shards.
    seconds: of motion.
    reasons: reason of failure -> number of rows, the most frequent ``MOST_REASONS``.
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
class RunProgress:
    """Progress of a run.

    n_before: rows of shards that existed before the run.
    n_done: rows so far, including earlier ones and those of unfinished shards.
    n_failed: failed rows of shards that this run has made.
    n_rows: total number of rows.
    """

    n_before: int
    n_done: int
    n_failed: int
    n_rows: int


def run(
    out: Path,
    options: BulkOptions,
    make_batches: Callable[[], Iterable[pa.RecordBatch]],
    workers: int | None = None,
    ray: str | None = None,
    n_words_kept: int = WORDS_KEPT,
    advance: Callable[[RunProgress], None] | None = None,
) -> BulkSummary:
    """Make the missing shards of a folder, in processes of this machine, or on the Ray cluster at the address ``ray``.
    Creates the folder if necessary. Returns the folder's summary, and writes it there.

    make_batches: makes the recipes, anew at each call.
    workers: number of workers; by default one per core of the machine, or of the cluster.
    n_words_kept: number of words that each worker keeps in memory.
    advance: called with the progress.

    Raises ``InputError`` if another call is writing there, and what ``prepare``, ``make_here``, ``cluster.make_all``
    and ``summarize`` raise.
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers {workers}, expected 1 or more")
    jobs.check_folder(out)
    with _begun(out, options, make_batches) as job:
        (out / jobs.INDEX).mkdir(exist_ok=True)
        atomic.sweep(out / jobs.INDEX)  # numbers of finished rows that an interrupted call left
        missing = [shard for shard in range(job.n_shards) if not jobs.is_whole(out, job, shard)]
        before = job.n_recipes - sum(len(job.rows(shard)) for shard in missing)
        done, failed = before, 0
        note = advance or (lambda _: None)
        note(RunProgress(before, done, failed, job.n_recipes))
        if missing:
            (out / jobs.SUMMARY).unlink(missing_ok=True)
        unfinished, shown = set(missing), before
        try:
            for shard in _make_shards(str(out.resolve()), missing, workers, ray, n_words_kept) if missing else ():
                if shard is not None:
                    done, failed = done + shard.n_rows, failed + shard.n_failed
                    unfinished.discard(shard.shard)
                shown = max(shown, done + jobs.rows_in_progress(out, unfinished))
                note(RunProgress(before, shown, failed, job.n_recipes))
        except KeyboardInterrupt:
            message = f"{done} of {job.n_recipes} rows are kept in {out}"
            raise KeyboardInterrupt(f"{message}; the same command continues from there") from None
        summary = summarize(out, job)
        atomic.write(out / jobs.SUMMARY, json.dumps(asdict(summary), indent=2, ensure_ascii=False) + "\n")
    return summary


@contextmanager
def _begun(out: Path, options: BulkOptions, make_batches: Callable[[], Iterable[pa.RecordBatch]]) -> Iterator[BulkJob]:
    """Yield the job of a folder and lock it against other calls. A refused call leaves no trace."""
    was_there = out.exists()
    with atomic.resumable_folder(out / jobs.UNFINISHED) as was_interrupted:
        try:
            job = jobs.prepare(out, options, make_batches)
        except BaseException:
            with suppress(OSError):
                if not was_interrupted:
                    (out / jobs.UNFINISHED).rmdir()
                if not was_there:
                    out.rmdir()
            raise
        try:
            yield job
        finally:
            for folder in (out, out / jobs.INDEX):
                atomic.sweep(folder)  # files that killed workers left


def _make_shards(
    out: str, missing: list[int], workers: int | None, ray: str | None, n_words_kept: int
) -> Iterator[ShardResult | None]:
    if ray is not None:
        return cluster.make_all(out, missing, ray, n_words_kept, workers)
    return make_here(out, missing, min(workers or cores(), len(missing)), n_words_kept)


def _read_index(out: Path, shard: int) -> pa.Table:
    path = jobs.index_path(out, shard)
    try:
        return pq.read_table(path, columns=["frames", "fps", "seams", "error"])
    except (pa.ArrowException, OSError, ValueError) as error:
        what = f"cannot be read as the index of shard {shard} ({str(error)[:200]})"
        raise FormatError(f"{what}; remove it, and the same call makes it anew", file=str(path)) from error


def summarize(out: Path, job: BulkJob) -> BulkSummary:
    """Summarise the shards of a folder from their index. Raises ``InputError`` if a shard is missing,
    ``FormatError`` if its index cannot be read.
    """
    reasons: Counter[str] = Counter()
    n_failed = n_seams = n_frames = n_bytes = 0
    seconds = 0.0
    for shard in range(job.n_shards):
        if not jobs.is_whole(out, job, shard):
            raise InputError(f"{out}: shard {shard} is not whole; the same call makes it")
        table = _read_index(out, shard)
        failed = [error for error in table["error"].to_pylist() if error is not None]
        reasons.update(failed)
        frames, rates = table["frames"].drop_null().to_numpy(), table["fps"].drop_null().to_numpy()
        n_failed += len(failed)
        n_seams += int(table["seams"].drop_null().to_numpy().sum())
        n_frames += int(frames.sum())
        seconds += float((frames / rates).sum())
        files = jobs.tar_path(out, shard), jobs.index_path(out, shard)
        n_bytes += sum(path.stat().st_size for path in files if path.exists())
    top_reasons = dict(sorted(reasons.most_common(MOST_REASONS), key=lambda row: (-row[1], row[0])))
    return BulkSummary(
        job.n_recipes, job.n_shards, n_failed, n_seams, n_frames, n_bytes, round(seconds, 3), top_reasons
    )
