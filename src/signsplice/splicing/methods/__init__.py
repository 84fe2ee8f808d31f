"""Cutters, transitions and durations, classical and learned."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from signsplice.errors import InputError

Found = TypeVar("Found")


class Method:
    """A part of splicing that a user can choose.

    name: what a user calls it by.
    summary: one line on how it works.
    learned: whether a network does the work.
    """

    name: str
    summary: str
    learned: bool = False


def find(kind: str, name: str, table: Mapping[str, Found]) -> Found:
    """The method of that name. Raises ``InputError`` with the kind and the existing names."""
    if name not in table:
        raise InputError(f"no {kind} {name!r}, expected one of {', '.join(table)}")
    return table[name]
