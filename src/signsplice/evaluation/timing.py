"""Wall-clock time of calls."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from statistics import median

from signsplice.motion.cache import CACHE
from signsplice.motion.clip import Clip
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
