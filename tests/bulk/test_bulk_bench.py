"""What sentences in bulk cost: the page of the figures, and the arithmetic in it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from signsplice.bench import bulk

pytest.importorskip("pyarrow")


MEASURED = Path(__file__).parents[2] / "workshop" / "docs" / "measured" / "scale.json"


def test_the_page_in_the_docs_is_that_of_its_figures() -> None:
    found = json.loads(MEASURED.read_text(encoding="utf-8"))
    assert bulk.page(found) == MEASURED.with_suffix(".md").read_text(encoding="utf-8")
    assert bulk.core_hours(found) == found["core_hours"]


def test_core_hours_are_rows_times_milliseconds() -> None:
    one = {"frames_ms": 3.6, "frames_bytes": 1e6, "recipes_ms": 0.36, "recipes_bytes": 100.0}
    hours = bulk.core_hours({"pairs": one, "sentences": one})
    assert hours["sentences_frames"] == {"rows": 1_000_000, "hours": pytest.approx(1.0), "tb": pytest.approx(1.0)}
    assert hours["pairs_recipes"]["hours"] == pytest.approx(4.4977142)
