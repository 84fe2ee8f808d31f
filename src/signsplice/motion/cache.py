"""A cache of the last few results of functions by their arguments: the package's only module-level state.

Values that depend on one object alone are cached in that object (``clip.Derived``).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

Value = TypeVar("Value")


class Cache:
    """Results by function and arguments; safe to clear at any time."""

    def __init__(self) -> None:
        self._recent: dict[Callable[..., Any], OrderedDict[tuple[Hashable, ...], Any]] = {}

    def recent(self, compute: Callable[..., Value], *arguments: Hashable, most: int) -> Value:
        """Return ``compute(*arguments)``; keeps the results of the last ``most`` different calls."""
        results = self._recent.setdefault(compute, OrderedDict())
        value = results.pop(arguments, None)
        if value is None:
            value = compute(*arguments)
        results[arguments] = value  # the last one
        while len(results) > most:
            results.popitem(last=False)
        result: Value = value
        return result

    def forget(self, compute: Callable[..., Any]) -> None:
        """Forget the results of one function."""
        self._recent.pop(compute, None)

    def clear(self) -> None:
        """Forget all results."""
        self._recent.clear()


CACHE = Cache()
"""The package's only module-level state."""
