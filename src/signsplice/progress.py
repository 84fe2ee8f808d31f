"""How far long work is, told to whoever asked for it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import TypeVar

T = TypeVar("T")
Progress = Callable[[int, int], None]
"""Called with how many are done, and of how many."""


def track_progress(items: Collection[T], progress: Progress | None) -> Iterator[T]:
    """The items in order, with a call of ``progress`` after each is done."""
    for done, item in enumerate(items, 1):
        yield item
        if progress is not None:
            progress(done, len(items))
