"""Trained systems that run whole and come from other distributions.

A distribution registers a function under the entry point group ``signsplice.systems``. The function opens a folder:
it returns a ``WholeSystem``, or raises ``InputError`` for a folder that is none of its systems.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

from signsplice.errors import InputError
from signsplice.splicing.whole_system import WholeSystem

GROUP = "signsplice.systems"


def open_system(folder: str | Path) -> WholeSystem:
    """The trained system in a folder. Raises ``InputError`` where no installed distribution opens it."""
    refusal = InputError(f"{folder}: a system that signsplice-paper opens: install it (pip install ./research)")
    for entry in entry_points(group=GROUP):
        try:
            system: WholeSystem = entry.load()(folder)
            return system
        except InputError as error:
            refusal = error
    raise refusal
