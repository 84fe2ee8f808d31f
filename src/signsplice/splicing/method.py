"""What every cutter and transition tells of itself, and how one is found by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, TypeVar

from signsplice.errors import InputError

Found = TypeVar("Found")


class Method(Protocol):
    """A part of splicing that a user can choose."""

    @property
    def name(self) -> str:
        """The name a user calls it by."""
        ...

    @property
    def summary(self) -> str:
        """One line on how it works."""
        ...

    @property
    def learned(self) -> bool:
        """Whether a network does the work."""
        ...


def find(kind: str, name: str, table: Mapping[str, Found]) -> Found:
    """The method of that name. Raises ``InputError`` that says the kind and the names there are."""
    if name not in table:
        raise InputError(f"no {kind} {name!r}, expected one of {', '.join(table)}")
    return table[name]
