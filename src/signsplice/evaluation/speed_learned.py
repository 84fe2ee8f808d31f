"""Speed of the networks that ship: whole seams, sentences and streams."""

from __future__ import annotations

import time
import tracemalloc
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from statistics import median
from typing import Any

import numpy as np

from signsplice.lexicon import shipped
from signsplice.motion import Clip
from signsplice.motion.cache import CACHE
from signsplice.splicing.engine import splice, stream
from signsplice.splicing.methods.choice import choose
from signsplice.splicing.methods.learned import LearnedCutter
from signsplice.splicing.networks.word_reader import WordReader


def milliseconds(run: Callable[[], object]) -> float:
    """Wall-clock time of one call, ms."""
    start = time.perf_counter()
    run()
    return 1e3 * (time.perf_counter() - start)


def median_milliseconds(repeats: int, *runs: Callable[[], object]) -> list[float]:
    """Median time of each call, ms. The calls alternate, so that a change of the machine's speed affects all alike."""
    for run in runs:
        run()
    times = [[milliseconds(run) for run in runs] for _ in range(repeats)]
    return [median(column) for column in zip(*times, strict=True)]


def forget(clips: Iterable[Clip], reader: WordReader | None = None) -> None:
    """Clear what is cached of clips, so that the next call computes it again."""
    clips = list(clips)
    CACHE.forget(*clips)
    if reader is not None:
        reader.forget(*clips)


N_STREAM = 1000
"""Words of a long stream; fewer with few repeats."""
N_WARM_UP = 20
"""Seams before the first that is timed."""


def seams(repeats: int) -> dict[str, Any]:
    """Times of whole seams (features, cut, duration, transition, collision avoidance, join, scores), of the part that
    the networks take, and of a sentence of ten words; a different pair of the words that ship each time.
    """
    cutter = choose().cutter
    if not isinstance(cutter, LearnedCutter):
        return {"networks": "none to be read"}
    reader = cutter.reader
    with shipped() as words:
        clips = [words.clip(gloss) for gloss in words]
    rng = np.random.default_rng(0)
    times, inside = [], []  # ms of the whole call and of the networks in it
    for n in range(20 * repeats + N_WARM_UP):
        pair = [clips[k] for k in rng.choice(len(clips), 2, replace=False)]
        forget(pair, reader)
        seconds = reader.sessions.seconds
        took = milliseconds(partial(splice, pair))
        if n >= N_WARM_UP:
            times.append(took)
            inside.append(1e3 * (reader.sessions.seconds - seconds))
    sentences = []
    for _ in range(repeats + 2):
        words_of_sentence = [clips[k] for k in rng.choice(len(clips), 10, replace=False)]
        forget(words_of_sentence, reader)
        sentences.append(milliseconds(partial(splice, words_of_sentence)))
    return {
        "seam, p50, ms": float(np.percentile(times, 50)),
        "seam, p99, ms": float(np.percentile(times, 99)),
        "of it networks, ms": median(inside),
        "by the networks alone": median(times) / median(inside),
        "sentence of 10 words, ms": median(sentences[2:]),
    }


def streams(repeats: int) -> dict[str, Any]:
    """Time from the moment the second word is known to the first piece; and of a long stream the time per word and its
    second half over its first, in time and in peak memory.
    """
    cutter = choose().cutter
    reader = cutter.reader if isinstance(cutter, LearnedCutter) else None
    with shipped() as words:
        clips = [words.clip(gloss) for gloss in words]

    def first_piece() -> float:
        start = 0.0

        def two_words() -> Iterator[Clip]:
            nonlocal start
            yield clips[0]
            start = time.perf_counter()
            yield clips[1]

        forget(clips[:2], reader)
        next(stream(two_words()))
        return 1e3 * (time.perf_counter() - start)

    def unread(count: int) -> Iterator[Clip]:
        """Words in turn, each as if it were new."""
        for n in range(count):
            forget([clips[n % len(clips)]], reader)
            yield clips[n % len(clips)]

    n_words = min(N_STREAM, 40 * repeats)
    firsts = [first_piece() for _ in range(repeats + 3)][3:]
    peaks, seconds = [], []
    for traced in (False, True):
        pieces = stream(unread(n_words))
        for _ in range(2):
            if traced:
                tracemalloc.start()
            half = islice(pieces, n_words)  # a word makes two pieces
            seconds.append(1e-3 * milliseconds(partial(deque, half, maxlen=0)))
            if traced:
                peaks.append(tracemalloc.get_traced_memory()[1])
                tracemalloc.stop()
    return {
        "first piece, ms": median(firsts),
        f"{n_words} words, a word, ms": 1e3 * (seconds[0] + seconds[1]) / n_words,
        "second half by first, time": seconds[1] / seconds[0],
        "second half by first, memory": peaks[1] / peaks[0],
    }
