"""Reads the tables beside the words of this package: places on the body, handshapes, frequencies."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "words"


def sections(name: str) -> dict[str, list[list[str]]]:
    """The lines below each [section] of a table, each as its words. # begins a comment."""
    found: dict[str, list[list[str]]] = {}
    rows: list[list[str]] = []
    for line in (FOLDER / f"{name}.txt").read_text(encoding="utf-8").splitlines():
        content = line.partition("#")[0].strip()
        if content.startswith("["):
            rows = found[content.strip("[]")] = []
        elif content:
            rows.append(content.split())
    return found
