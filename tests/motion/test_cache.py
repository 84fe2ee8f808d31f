"""motion.cache: a value lives as long as the object it was computed from, and only the last few results are kept."""

from __future__ import annotations

import gc
import weakref

import pytest

from signsplice.motion.cache import CACHE, Cache, kept


class Owner:
    """An object from which values are computed."""


class Counted:
    """A function that returns a new object at each call, and counts its calls."""

    def __init__(self) -> None:
        self.n_calls = 0

    def __call__(self, *arguments: object) -> object:
        self.n_calls += 1
        return [self.n_calls]


def test_a_value_is_computed_once_and_lives_as_long_as_its_owner() -> None:
    class Value:
        """A value that can be referred to weakly."""

    def compute(owner: Owner) -> Value:
        return Value()

    cache, owner = Cache(), Owner()
    value = weakref.ref(cache.of(owner, compute))
    gc.collect()
    assert value() is cache.of(owner, compute)
    del owner
    gc.collect()
    assert value() is None


def test_every_function_and_every_owner_has_its_own_value() -> None:
    cache, owners, functions = Cache(), (Owner(), Owner()), (Counted(), Counted())
    values = [cache.of(owner, function) for owner in owners for function in functions]
    assert len({id(value) for value in values}) == 4
    assert [cache.of(owner, function) for owner in owners for function in functions] == values
    assert [function.n_calls for function in functions] == [2, 2]


def test_only_the_most_recently_used_results_are_kept() -> None:
    cache, function = Cache(), Counted()
    first = cache.recent(function, "a", most=2)
    cache.recent(function, "b", most=2)
    assert cache.recent(function, "a", most=2) is first, "and used again"
    cache.recent(function, "c", most=2)
    assert cache.recent(function, "a", most=2) is first
    assert function.n_calls == 3
    cache.recent(function, "b", most=2)
    assert function.n_calls == 4, "b was used longest ago"


def test_a_function_that_raises_is_called_again() -> None:
    def raises_first(argument: object) -> int:
        calls.append(argument)
        if len(calls) == 1:
            raise ValueError("the first call fails")
        return len(calls)

    calls: list[object] = []
    cache, owner = Cache(), Owner()
    with pytest.raises(ValueError, match="first call"):
        cache.of(owner, raises_first)
    assert cache.of(owner, raises_first) == 2
    calls.clear()
    with pytest.raises(ValueError, match="first call"):
        cache.recent(raises_first, 1, most=1)
    assert cache.recent(raises_first, 1, most=1) == 2


def test_a_decorated_function_is_called_once_an_owner_and_keeps_its_name() -> None:
    calls: list[Owner] = []

    @kept
    def counted(owner: Owner) -> int:
        """How often it was called."""
        calls.append(owner)
        return len(calls)

    first, second = Owner(), Owner()
    assert [counted(one) for one in (first, second, first, second)] == [1, 2, 1, 2]
    assert (counted.__name__, counted.__doc__) == ("counted", "How often it was called.")
    CACHE.forget(first)
    assert (counted(first), counted(second)) == (3, 2)


def test_clearing_forgets_everything() -> None:
    cache, owner, functions = Cache(), Owner(), (Counted(), Counted())
    for _ in range(2):
        cache.of(owner, functions[0])
        cache.recent(functions[1], 1, most=3)
        cache.clear()
    assert [function.n_calls for function in functions] == [2, 2]


def test_forgetting_an_owner_keeps_the_values_of_others() -> None:
    cache, function, owners = Cache(), Counted(), (Owner(), Owner())
    first, second = (cache.of(owner, function) for owner in owners)
    cache.forget(owners[0], Owner())
    assert cache.of(owners[0], function) is not first
    assert cache.of(owners[1], function) is second
