"""Values computed from an object live as long as it does, and only the last few results of a function are kept."""

from __future__ import annotations

import gc
import pickle
import weakref
from dataclasses import replace

import pytest

from signsplice.motion import Clip, copy_unchecked
from signsplice.motion.cache import Cache
from signsplice.motion.clip import HasDerived


class Owner(HasDerived):
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

    owner = Owner()
    value = weakref.ref(owner.derived[compute])
    gc.collect()
    assert value() is owner.derived[compute]
    gc.disable()
    try:
        del owner
        assert value() is None, "no circle keeps it until memory is searched"
    finally:
        gc.enable()


def test_every_function_and_every_owner_has_its_own_value() -> None:
    owners, functions = (Owner(), Owner()), (Counted(), Counted())
    values = [owner.derived[function] for owner in owners for function in functions]
    assert len({id(value) for value in values}) == 4
    assert [owner.derived[function] for owner in owners for function in functions] == values
    assert [function.n_calls for function in functions] == [2, 2]


def test_copies_of_a_clip_begin_without_values(words: dict[str, Clip]) -> None:
    clip, function = replace(words["SIGN"]), Counted()
    value = clip.derived[function]
    for copy in (copy_unchecked(clip), clip[:], replace(clip), pickle.loads(pickle.dumps(clip))):
        assert copy.derived[function] is not value
    assert clip.derived[function] is value


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
        owner.derived[raises_first]
    assert owner.derived[raises_first] == 2
    calls.clear()
    with pytest.raises(ValueError, match="first call"):
        cache.recent(raises_first, 1, most=1)
    assert cache.recent(raises_first, 1, most=1) == 2


def test_clearing_forgets_everything() -> None:
    cache, owner, functions = Cache(), Owner(), (Counted(), Counted())
    for _ in range(2):
        cache.recent(functions[0], 1, most=3)
        cache.clear()
        _ = owner.derived[functions[1]]
        owner.derived.clear()
    assert [function.n_calls for function in functions] == [2, 2]
