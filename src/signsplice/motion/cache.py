"""The one place where the process keeps what it computed before; the rest of the package has no hidden state.

Two kinds of values are kept. ``of`` keeps a value for as long as the object lives that it was computed from (the roles
of a skeleton, the arms of a clip); ``kept`` is a decorator that does so. ``recent`` keeps the last few results of a
function by its arguments (opened bundles). All are typed by the function that computes the value.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

Owner = TypeVar("Owner")
Value = TypeVar("Value")


class Cache:
    """Values by what they were computed from and by which function; safe to clear at any time."""

    def __init__(self) -> None:
        self._by_owner: WeakKeyDictionary[Any, dict[Callable[..., Any], Any]] = WeakKeyDictionary()
        self._recent: dict[Callable[..., Any], OrderedDict[tuple[Hashable, ...], Any]] = {}

    def of(self, owner: Owner, compute: Callable[[Owner], Value]) -> Value:
        """``compute(owner)``, computed once and kept as long as ``owner`` lives; the value must not refer to it."""
        kept = self._by_owner.get(owner)
        if kept is None:
            kept = self._by_owner[owner] = {}
        if compute not in kept:
            kept[compute] = compute(owner)
        value: Value = kept[compute]
        return value

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

    def forget(self, *owners: object) -> None:
        """Forget everything that was computed from these objects."""
        for owner in owners:
            self._by_owner.pop(owner, None)

    def clear(self) -> None:
        """Forget everything."""
        self._by_owner.clear()
        self._recent.clear()


CACHE = Cache()
"""The package's only module-level state."""


def kept(compute: Callable[[Owner], Value]) -> Callable[[Owner], Value]:
    """The function ``compute``, whose values are kept as ``CACHE.of`` keeps them."""

    @wraps(compute)
    def value_of(owner: Owner) -> Value:
        return CACHE.of(owner, compute)

    return value_of
