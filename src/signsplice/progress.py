"""Progress callbacks for long work."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import TypeVar

T = TypeVar("T")
Progress = Callable[[int, int], None]
"""Called with the number of finished items and the total."""


def track_progress(items: Collection[T], progress: Progress | None) -> Iterator[T]:
    """Yield the items in order and call ``progress`` after each."""
    for done, item in enumerate(items, 1):
        yield item
        if progress is not None:
            progress(done, len(items))
