"""Measured rows as Markdown tables and as JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_STORED = {"avoids_collisions": "body_sense", "n_seams": "n_joins", "keyframed": "drawn"}
"""Fields of rows whose JSON key is another word: files written before must stay comparable."""


def markdown(head: Sequence[object], rows: Iterable[Sequence[object]]) -> list[str]:
    """Lines of a Markdown table."""
    return [_line(head), _line(["---"] * len(head)), *map(_line, rows)]


def _line(cells: Sequence[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def to_json(row: DataclassInstance) -> dict[str, Any]:
    """A row with the keys that ``signsplice evaluate --json`` prints."""
    return {_STORED.get(name, name): value for name, value in asdict(row).items()}


def tables_in(lines: Iterable[str]) -> list[dict[str, Any]]:
    """The tables among lines of Markdown: each with its section, the paragraph before it, and its rows as shown."""
    found: list[dict[str, Any]] = []
    section, paragraph, head = "", list[str](), list[str]()
    for line in lines:
        if line.startswith("#"):
            section = line.strip("# ")
        elif not line.startswith("|"):
            paragraph, head = ([] if head or (line and paragraph[-1:] == [""]) else paragraph) + [line], []
        elif not head:
            head = _cells(line)
            found.append({"section": section, "text": " ".join(paragraph).strip(), "rows": []})
        elif not line.startswith("| ---"):
            found[-1]["rows"].append(dict(zip(head, _cells(line), strict=True)))
    return found


def csv_text(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Rows as the text of a CSV file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([head, *rows])
    return text.getvalue()


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]
