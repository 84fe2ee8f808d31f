"""Cost of sentences in bulk: time per core, scaling with workers, memory, bytes; and the resulting core-hours."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from signsplice.bulk import drawing, recipes
from signsplice.bulk.job import INDEX, BulkOptions, libraries, prepare, processor
from signsplice.bulk.maker import SentenceMaker
from signsplice.bulk.run import RunProgress, run
from signsplice.bulk.shards import make_shard
from signsplice.errors import SignspliceError
from signsplice.lexicon.lexicon import Lexicon, open_lexicon
from signsplice.motion.cache import CACHE
from signsplice.splicing.bulk_splice import splice_many
from signsplice.splicing.engine import splice
from signsplice.splicing.options import open_learned

N_PAIRS = 6707 * 6706
"""Ordered pairs of the paper's dictionary, for which core-hours are computed."""
N_SENTENCES = 1_000_000
"""Sentences for which core-hours are computed."""
WORDS = 10
"""Words of a sentence."""
_BLOCK = 64
_STAGES = 10
Advance = Callable[[str], None]


def measure(lexicon: str, count: int, n_memory: int, advance: Advance, seed: int = 0) -> dict[str, Any]:
    """Return all figures and their conditions, JSON-ready; times are processor time unless named wall. What cannot be
    measured here, such as workers of Ray where none start, stands in ``not_measured`` with the reason.

    count: sentences of each timing. n_memory: ten-word sentences of the memory measurement. advance: called with the
    name of the next measurement.
    """
    figures: dict[str, Any] = {
        "processor": processor(),
        "cores": os.cpu_count(),
        "load": [round(load, 2) for load in os.getloadavg()] if hasattr(os, "getloadavg") else None,
        "libraries": libraries(),
        "bundle": open_learned().sha256,
        "count": count,
        "seed": seed,
    }
    with open_lexicon(lexicon) as words:
        figures["words"] = len(drawing.signs(words))
        advance("seams, alone and together")
        figures["seams"] = seams(words, count, seed)
        for name, batches, rows in _kinds(words, count, seed):
            advance(name)
            CACHE.clear()  # the time includes reading words and opening networks
            figures[name] = shards(lexicon, batches, rows)
        advance("memory")
        figures["memory"] = memory(words, n_memory, seed)
        figures["not_measured"] = {}
        for name, what, ray in (("workers", "workers", None), ("ray", "workers of Ray", "local")):
            advance(what)
            try:
                figures[name] = growth(lexicon, words, count, seed, ray)
            except SignspliceError as error:
                figures["not_measured"][what] = str(error)
    figures["core_hours"] = core_hours(figures)
    return figures


def _kinds(words: Lexicon, count: int, seed: int) -> Iterator[tuple[str, list[pa.RecordBatch], int]]:
    glosses = drawing.signs(words)
    n_pairs = min(10 * count, len(glosses) * (len(glosses) - 1))
    yield "pairs", [next(drawing.pairs(glosses))[:n_pairs]], n_pairs
    yield "sentences", list(drawing.random_recipes(glosses, count, (WORDS, WORDS), seed)), count


def seams(words: Lexicon, count: int, seed: int) -> dict[str, Any]:
    """Measure processor time per seam, ms, of ``count`` pairs and of as many ten-word sentences, alternately one by one
    and in blocks; of words whose network features are not cached, and of words whose features are.
    """
    maker, glosses = SentenceMaker(words), drawing.signs(words)
    figures: dict[str, Any] = {"block": _BLOCK}
    for name, batches in (
        ("pairs", drawing.pairs(glosses, count, seed)),
        ("sentences", drawing.random_recipes(glosses, count, (WORDS, WORDS), seed)),
    ):
        sentences = [maker.clips(row) for batch in batches for row in recipes.recipes_of(batch)]
        splice_many(sentences)
        times = dict.fromkeys(("new_alone", "new_together", "read_alone", "read_together"), 0.0)
        for start in range(0, len(sentences), _BLOCK):
            block = sentences[start : start + _BLOCK]
            with _add_cpu_time(times, "read_alone"):
                for clips in block:
                    splice(clips)
            with _add_cpu_time(times, "read_together"):
                splice_many(block)
            sentence_copies = [[replace(clip) for clip in clips] for clips in block]  # words are cached by object
            with _add_cpu_time(times, "new_alone"):
                for clips in sentence_copies:
                    splice(clips)
            copies = {id(clip): replace(clip) for clips in block for clip in clips}
            with _add_cpu_time(times, "new_together"):
                splice_many([[copies[id(clip)] for clip in clips] for clips in block])
        n_seams = sum(len(clips) - 1 for clips in sentences)
        figures[name] = {case: 1e3 * seconds / n_seams for case, seconds in times.items()}
    return figures


@contextmanager
def _add_cpu_time(times: dict[str, float], name: str) -> Iterator[None]:
    """Add the processor time of a block to ``times[name]``, seconds."""
    began = time.process_time()
    yield
    times[name] += time.process_time() - began


def shards(lexicon: str, batches: list[pa.RecordBatch], n_rows: int) -> dict[str, Any]:
    """Measure processor time, ms, and bytes per row of one shard of these recipes, including reading words and writing
    files; with clips, and with recipes and hashes alone.
    """
    figures: dict[str, Any] = {"rows": n_rows}
    for store in ("frames", "recipes"):
        with tempfile.TemporaryDirectory() as folder:
            job_folder = Path(folder) / "out"
            prepare(job_folder, BulkOptions(lexicon, store=store, shard_size=n_rows), lambda: batches)
            (job_folder / INDEX).mkdir()
            result = make_shard(str(job_folder), 0, 1 << 20)
        figures[f"{store}_ms"] = 1e3 * result.cpu_s / n_rows
        figures[f"{store}_bytes"] = result.n_bytes / n_rows
        figures["seams"], figures["frames"] = result.n_seams / n_rows, result.n_frames / n_rows
    return figures


def memory(words: Lexicon, count: int, seed: int) -> list[dict[str, float]]:
    """Measure resident memory, MB, of this process while it makes ``count`` ten-word sentences, in ten stages."""
    maker = SentenceMaker(words)
    done = 0
    stages: list[dict[str, float]] = []
    for batch in drawing.random_recipes(drawing.signs(words), count, (WORDS, WORDS), seed):
        rows = recipes.recipes_of(batch)
        for start in range(0, len(rows), _BLOCK):
            maker.make(rows[start : start + _BLOCK])
            done += len(rows[start : start + _BLOCK])
            if done * _STAGES >= (len(stages) + 1) * count:
                stages.append({"sentences": done, "mb": resident_mb()})
    return stages


def resident_mb() -> float:
    """Return the resident memory of this process, MB; 0.0 if unknown."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except OSError:
        return 0.0


def growth(lexicon: str, words: Lexicon, count: int, seed: int, ray: str | None) -> list[dict[str, float]]:
    """Measure sentences per second of wall time with 1 and with 2 workers, twice each, alternately, for ``count``
    ten-word sentences; from the first finished shards to the last, to exclude the start of processes.
    """
    glosses = drawing.signs(words)
    n_rows = max(count, 40)
    batches = list(drawing.random_recipes(glosses, n_rows, (WORDS, WORDS), seed))
    best: dict[int, float] = {}
    for workers in (1, 2, 2, 1):
        with tempfile.TemporaryDirectory() as folder:
            job_folder = Path(folder) / "out"
            options = BulkOptions(lexicon, shard_size=max(n_rows // 40, 1))
            times: list[tuple[float, int]] = []

            def note(state: RunProgress, times: list[tuple[float, int]] = times) -> None:
                times.append((time.perf_counter(), state.n_done))

            run(job_folder, options, lambda: batches, workers, ray, advance=note)
            settled = times[1 + workers :]
            rate = (settled[-1][1] - settled[0][1]) / (settled[-1][0] - settled[0][0])
            best[workers] = max(best.get(workers, 0.0), rate)
    return [{"workers": workers, "sentences_a_second": rate, "ratio": rate / best[1]} for workers, rate in best.items()]


def core_hours(found: Mapping[str, Any]) -> dict[str, Any]:
    """Compute core-hours and bytes of all pairs of the paper's dictionary and of a million ten-word sentences."""
    rows = {"pairs": N_PAIRS, "sentences": N_SENTENCES}
    hours: dict[str, Any] = {}
    for name, n in rows.items():
        for store in ("frames", "recipes"):
            hours[f"{name}_{store}"] = {
                "rows": n,
                "hours": n * found[name][f"{store}_ms"] / 3.6e6,
                "tb": n * found[name][f"{store}_bytes"] / 1e12,
            }
    return hours


def page(found: Mapping[str, Any]) -> str:
    """Format the figures as tables in Markdown, with the arithmetic."""
    seam, hours = found["seams"], found["core_hours"]
    frames, hashes = hours["sentences_frames"], hours["sentences_recipes"]
    made_with = found.get("made_with", {"commit": "not recorded", "words": "not recorded"})
    lines = [
        f"- {frames['rows']:,} ten-word sentences take {frames['hours']:.1f} core-hours with clips, "
        f"{hashes['hours']:.1f} as recipes and hashes.",
        f"- A seam of such a sentence takes {seam['sentences']['new_together']:.2f} ms of processor time where words "
        f"are new, {seam['sentences']['read_together']:.2f} ms where they are known.",
        "",
        f"Processor: {found['processor']}, {found['cores']} cores, load {found['load']} when it began; "
        f"{found['words']} signs (sha256 {made_with['words'][:12]}); networks {str(found['bundle'])[:12]}; commit "
        f"{made_with['commit']}. Written by `signsplice bench bulk`.",
    ]
    states = {"new": "not read before", "read": "read before"}
    kinds = [(name, state) for name in ("pairs", "sentences") for state in states]
    times = [(f"{name}, words {states[state]}", *(seam[name][f"{state}_{how}"] for how in ("alone", "together")))
             for name, state in kinds]  # fmt: skip
    head = "ms of processor time a seam", "each alone", f"{seam['block']} together", "together / alone"
    lines += _table(
        head, [(name, f"{alone:.2f}", f"{together:.2f}", f"{together / alone:.2f}") for name, alone, together in times]
    )
    rows: list[Sequence[str]] = []
    for name, row in hours.items():
        kind, store = name.split("_")
        ms, n_bytes = (found[kind][f"{store}_{unit}"] for unit in ("ms", "bytes"))
        of_row = f"{row['rows']:,}", f"{ms:.2f}", f"{row['hours']:.1f}", f"{n_bytes:,.0f}", f"{row['tb']:.4f}"
        rows.append((f"{kind}, `--store {store}`", *of_row))
    lines += _table(("what", "rows", "ms a row", "core-hours = rows x ms / 3,600,000", "bytes a row", "TB"), rows)
    rates = [(kind, row) for kind, name in (("processes", "workers"), ("Ray", "ray")) for row in found.get(name, ())]
    rows = [(f"{r['workers']:.0f}, {kind}", f"{r['sentences_a_second']:.2f}", f"{r['ratio']:.2f}") for kind, r in rates]
    lines += _table(("workers", "sentences a second, wall", "ratio"), rows)
    for what, why in found.get("not_measured", {}).items():
        lines += ["", f"No figures of {what}: {why}"]
    rows = [(f"{stage['sentences']:,}", f"{stage['mb']:.0f}") for stage in found["memory"]]
    lines += _table(("ten-word sentences made by one process", "resident memory, MB"), rows)
    return "\n".join(lines) + "\n"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Format a table in Markdown below an empty line."""
    return ["", *(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))]
