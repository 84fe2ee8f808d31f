"""Tables of words and numbers that ship beside the modules that read them, and vectors of three numbers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

FOLDER = Path(__file__).parent / "words"
"""Signs and tables of this package."""


def sections(module: str, name: str) -> dict[str, list[list[str]]]:
    """The lines below each [section] of words/NAME.txt beside the file of ``module``, split into words. # begins a
    comment.
    """
    tables: dict[str, list[list[str]]] = {}
    rows: list[list[str]] = []
    for line in (Path(module).parent / "words" / f"{name}.txt").read_text(encoding="utf-8").splitlines():
        content = line.partition("#")[0].strip()
        if content.startswith("["):
            rows = tables[content.strip("[]")] = []
        elif content:
            rows.append(content.split())
    return tables


Vector = tuple[float, float, float]


def to_vector(values: Iterable[float]) -> Vector:
    """Three numbers as a vector."""
    x, y, z = map(float, values)
    return x, y, z


def vector(text: str) -> Vector:
    """Three numbers with commas between them."""
    return to_vector(map(float, text.split(",")))
