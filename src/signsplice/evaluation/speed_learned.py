"""Speed of what the networks that ship do: whole seams, sentences, streams. A part of the bench."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Iterator
from itertools import islice
from statistics import median
from typing import Any

import numpy as np

from signsplice.lexicon import shipped
from signsplice.motion.clip import Clip
from signsplice.splicing.engine import splice, stream
from signsplice.splicing.learned import LearnedCutter
from signsplice.splicing.methods import choose

N_STREAM = 1000
"""Words of a long stream; fewer where few repeats are asked for."""


def seams(repeats: int) -> dict[str, Any]:
    """Whole seams of words that ship, each pair another one, with the networks that ship: features, cut, duration,
    transition, body sense, join and scores, and how much of it the networks themselves take; and a sentence of ten.
    """
    cutter = choose().cutter
    if not isinstance(cutter, LearnedCutter):
        return {"networks": "none to be read"}
    graphs = cutter.reader.graphs
    with shipped() as words:
        clips = [words.clip(gloss) for gloss in words]
    rng = np.random.default_rng(0)
    times, bare = [], []
    for turn in range(20 * repeats + 20):
        # Fresh views of the clips: what was read of a word for an earlier seam must not count.
        before, after = (clips[k][:] for k in rng.choice(len(clips), 2, replace=False))
        inside, start = graphs.seconds, time.perf_counter()
        splice([before, after])
        if turn >= 20:
            times.append(1e3 * (time.perf_counter() - start))
            bare.append(1e3 * (graphs.seconds - inside))
    sentences = []
    for _ in range(repeats + 2):
        row = [clips[k][:] for k in rng.choice(len(clips), 10, replace=False)]
        start = time.perf_counter()
        splice(row)
        sentences.append(1e3 * (time.perf_counter() - start))
    return {
        "seam, p50, ms": float(np.percentile(times, 50)),
        "seam, p99, ms": float(np.percentile(times, 99)),
        "of it networks, ms": median(bare),
        "by the networks alone": median(times) / median(bare),
        "sentence of 10 words, ms": median(sentences[2:]),
    }


def streams(repeats: int) -> dict[str, Any]:
    """A stream: from the second word's being known to the first piece; and a long one, its second half by its first, in
    time and in memory at its peak.
    """
    with shipped() as words:
        clips = [words.clip(gloss) for gloss in words]

    def first_piece() -> float:
        known = 0.0

        def line() -> Iterator[Clip]:
            nonlocal known
            yield clips[0][:]
            known = time.perf_counter()
            yield clips[1][:]

        next(stream(line()))
        return 1e3 * (time.perf_counter() - known)

    n_words = min(N_STREAM, 40 * repeats)
    firsts = [first_piece() for _ in range(repeats + 3)][3:]
    peaks, seconds = [], []
    for traced in (False, True):
        pieces = stream(clips[n % len(clips)][:] for n in range(n_words))
        for _ in range(2):
            if traced:
                tracemalloc.start()
            start = time.perf_counter()
            for _ in islice(pieces, n_words):  # two pieces a word
                pass
            seconds.append(time.perf_counter() - start)
            if traced:
                peaks.append(tracemalloc.get_traced_memory()[1])
                tracemalloc.stop()
    return {
        "first piece, ms": median(firsts),
        f"{n_words} words, a word, ms": 1e3 * (seconds[0] + seconds[1]) / n_words,
        "second half by first, time": seconds[1] / seconds[0],
        "second half by first, memory": peaks[1] / peaks[0],
    }
