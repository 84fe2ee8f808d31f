"""What sentences in bulk cost: the page of the figures, and the arithmetic in it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from signsplice.bench import bulk
from signsplice.errors import InputError
from signsplice.lexicon.lexicon import SHIPPED, Lexicon

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


def test_figures_that_were_measured_are_kept_and_the_missing_ones_say_why(monkeypatch: pytest.MonkeyPatch) -> None:
    found = json.loads(MEASURED.read_text(encoding="utf-8"))

    def growth(lexicon: str, words: Lexicon, count: int, seed: int, ray: str | None) -> list[dict[str, float]]:
        if ray is not None:
            raise InputError(f"ray {ray}: no cluster there (no room)")
        return list(found["workers"])

    monkeypatch.setattr(bulk, "growth", growth)
    monkeypatch.setattr(bulk, "seams", lambda *_: found["seams"])
    monkeypatch.setattr(bulk, "memory", lambda *_: found["memory"])
    monkeypatch.setattr(bulk, "shards", lambda *_: found["pairs"])
    measured = bulk.measure(str(SHIPPED), 40, 10, lambda _: None)
    assert measured["workers"] == found["workers"]
    assert "ray" not in measured
    assert measured["not_measured"] == {"workers of Ray": "ray local: no cluster there (no room)"}
    assert measured["core_hours"]["pairs_frames"] == found["core_hours"]["pairs_frames"]
    page = bulk.page(measured)
    assert "\n\nNo figures of workers of Ray: ray local: no cluster there (no room)\n" in page
    assert ", processes |" in page
    assert ", Ray |" not in page
