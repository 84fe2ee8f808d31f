"""What sentences in bulk cost: time a core, growth with workers, memory, bytes; and the core-hours that follow."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from signsplice.bulk import drawing, recipes
from signsplice.bulk.job import INDEX, BulkOptions, libraries, prepare, processor
from signsplice.bulk.maker import SentenceMaker
from signsplice.bulk.run import Progress, run
from signsplice.bulk.shards import make_shard
from signsplice.errors import MissingExtraError
from signsplice.lexicon.lexicon import Lexicon, open_lexicon
from signsplice.motion.cache import CACHE
from signsplice.splicing.bulk_splice import splice_many
from signsplice.splicing.engine import splice
from signsplice.splicing.options import open_learned

N_PAIRS, N_SENTENCES, WORDS = 6707 * 6706, 1_000_000, 10
"""What the core-hours are for: all ordered pairs of the paper's dictionary; ten-word sentences."""
_BLOCK = 64
_STAGES = 10
Advance = Callable[[str], None]


def measure(lexicon: str, count: int, n_memory: int, advance: Advance, seed: int = 0) -> dict[str, Any]:
    """All figures, JSON-ready, each with how it was taken; times are processor time unless they say wall.

    count: sentences of each timing. n_memory: ten-word sentences over which memory is watched. advance: is told what
    is measured next.
    """
    found: dict[str, Any] = {
        "processor": processor(),
        "cores": os.cpu_count(),
        "load": [round(load, 2) for load in os.getloadavg()] if hasattr(os, "getloadavg") else None,
        "libraries": libraries(),
        "bundle": open_learned().sha256,
        "count": count,
        "seed": seed,
    }
    with open_lexicon(lexicon) as words:
        found["words"] = len(drawing.signs(words))
        advance("seams, alone and together")
        found["seams"] = seams(words, count, seed)
        for name, batches, rows in _kinds(words, count, seed):
            advance(name)
            CACHE.clear()  # the time includes that of reading words and opening networks
            found[name] = shards(lexicon, batches, rows)
        advance("memory")
        found["memory"] = memory(words, n_memory, seed)
        advance("workers")
        found["workers"] = growth(lexicon, words, count, seed, None)
        with suppress(MissingExtraError):
            advance("workers of Ray")
            found["ray"] = growth(lexicon, words, count, seed, "local")
    found["core_hours"] = core_hours(found)
    return found


def _kinds(words: Lexicon, count: int, seed: int) -> Iterator[tuple[str, list[pa.RecordBatch], int]]:
    glosses = drawing.signs(words)
    n_pairs = min(10 * count, len(glosses) * (len(glosses) - 1))
    yield "pairs", [next(drawing.pairs(glosses))[:n_pairs]], n_pairs
    yield "sentences", list(drawing.random_recipes(glosses, count, (WORDS, WORDS), seed)), count


def seams(words: Lexicon, count: int, seed: int) -> dict[str, Any]:
    """Ms a seam of ``count`` pairs and of as many ten-word sentences, each alone and many together, in turns: of words
    that the networks have not read, and of words that they have.
    """
    maker, glosses = SentenceMaker(words), drawing.signs(words)
    found: dict[str, Any] = {"block": _BLOCK}
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
            apart = [[replace(clip) for clip in clips] for clips in block]  # a word is known by its object
            with _add_cpu_time(times, "new_alone"):
                for clips in apart:
                    splice(clips)
            copies = {id(clip): replace(clip) for clips in block for clip in clips}
            with _add_cpu_time(times, "new_together"):
                splice_many([[copies[id(clip)] for clip in clips] for clips in block])
        n_seams = sum(len(clips) - 1 for clips in sentences)
        found[name] = {way: 1e3 * seconds / n_seams for way, seconds in times.items()}
    return found


@contextmanager
def _add_cpu_time(times: dict[str, float], name: str) -> Iterator[None]:
    """Adds the processor time of a block to ``times[name]``, seconds."""
    began = time.process_time()
    yield
    times[name] += time.process_time() - began


def shards(lexicon: str, batches: list[pa.RecordBatch], n_rows: int) -> dict[str, Any]:
    """Ms of processor time and bytes a row of one shard of these recipes, reading words and writing files included;
    with clips, and with recipes and hashes alone.
    """
    found: dict[str, Any] = {"rows": n_rows}
    for store in ("frames", "recipes"):
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out"
            prepare(out, BulkOptions(lexicon, store=store, shard_size=n_rows), lambda: batches)
            (out / INDEX).mkdir()
            made = make_shard(str(out), 0, 1 << 20)
        found[f"{store}_ms"] = 1e3 * made.cpu_s / n_rows
        found[f"{store}_bytes"] = made.n_bytes / n_rows
        found["seams"], found["frames"] = made.n_seams / n_rows, made.n_frames / n_rows
    return found


def memory(words: Lexicon, count: int, seed: int) -> list[dict[str, float]]:
    """Resident memory, MB, of this process while it makes ``count`` ten-word sentences, in ten stages."""
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
    """Resident memory of this process, MB; 0.0 where the system does not say."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except OSError:
        return 0.0


def growth(lexicon: str, words: Lexicon, count: int, seed: int, ray: str | None) -> list[dict[str, float]]:
    """Wall and sentences a second of ``count`` ten-word sentences by 1 and by 2 workers, twice each in turns, from the
    first finished shard to the last, so that the start of processes and the first words are not in it.
    """
    glosses = drawing.signs(words)
    n_rows = max(count, 40)
    batches = list(drawing.random_recipes(glosses, n_rows, (WORDS, WORDS), seed))
    best: dict[int, float] = {}
    for workers in (1, 2, 2, 1):
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out"
            options = BulkOptions(lexicon, shard_size=max(n_rows // 40, 1))
            times: list[tuple[float, int]] = []

            def note(state: Progress, times: list[tuple[float, int]] = times) -> None:
                times.append((time.perf_counter(), state.n_done))

            run(out, options, lambda: batches, workers, ray, advance=note)
            settled = times[1 + workers :]
            rate = (settled[-1][1] - settled[0][1]) / (settled[-1][0] - settled[0][0])
            best[workers] = max(best.get(workers, 0.0), rate)
    return [{"workers": workers, "sentences_a_second": rate, "ratio": rate / best[1]} for workers, rate in best.items()]


def core_hours(found: Mapping[str, Any]) -> dict[str, Any]:
    """Core-hours and bytes of all pairs of the paper's dictionary and of a million ten-word sentences."""
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
    """The figures as tables in Markdown, with the arithmetic."""
    seam, hours = found["seams"], found["core_hours"]
    frames, hashes = hours["sentences_frames"], hours["sentences_recipes"]
    made = found.get("made_with", {"commit": "not recorded", "words": "not recorded"})
    lines = [
        f"- {frames['rows']:,} ten-word sentences take {frames['hours']:.1f} core-hours with clips, "
        f"{hashes['hours']:.1f} as recipes and hashes.",
        f"- A seam of such a sentence takes {seam['sentences']['new_together']:.2f} ms of processor time where words "
        f"are new, {seam['sentences']['read_together']:.2f} ms where they are known.",
        "",
        f"Processor: {found['processor']}, {found['cores']} cores, load {found['load']} when it began; "
        f"{found['words']} signs (sha256 {made['words'][:12]}); networks {str(found['bundle'])[:12]}; commit "
        f"{made['commit']}. Written by `signsplice bench bulk`.",
    ]
    ways = {"new": "not read before", "read": "read before"}
    kinds = [(name, way) for name in ("pairs", "sentences") for way in ways]
    times = [(f"{name}, words {ways[way]}", *(seam[name][f"{way}_{how}"] for how in ("alone", "together")))
             for name, way in kinds]  # fmt: skip
    head = "ms of processor time a seam", "each alone", f"{seam['block']} together", "together / alone"
    lines += _table(head, [(name, f"{one:.2f}", f"{many:.2f}", f"{many / one:.2f}") for name, one, many in times])
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
    rows = [(f"{stage['sentences']:,}", f"{stage['mb']:.0f}") for stage in found["memory"]]
    lines += _table(("ten-word sentences made by one process", "resident memory, MB"), rows)
    return "\n".join(lines) + "\n"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table in Markdown below an empty line."""
    return ["", *(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))]
