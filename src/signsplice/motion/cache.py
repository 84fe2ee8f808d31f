"""The last few results of functions by their arguments: the only values that a module of the package keeps.

What follows from one object alone lies in that object (``clip.Derived``).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

Value = TypeVar("Value")


class Cache:
    """Values by the function that computes them and its arguments; safe to clear at any time."""

    def __init__(self) -> None:
        self._recent: dict[Callable[..., Any], OrderedDict[tuple[Hashable, ...], Any]] = {}

    def recent(self, compute: Callable[..., Value], *arguments: Hashable, most: int) -> Value:
        """``compute(*arguments)``; the results of the last ``most`` different calls are kept."""
        kept = self._recent.setdefault(compute, OrderedDict())
        value = kept.pop(arguments, None)
        if value is None:
            value = compute(*arguments)
        kept[arguments] = value  # the last one
        while len(kept) > most:
            kept.popitem(last=False)
        found: Value = value
        return found

    def clear(self) -> None:
        """Forget all results."""
        self._recent.clear()


CACHE = Cache()
"""The package's only module-level state."""
