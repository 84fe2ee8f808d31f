"""The search of learning rates and widths on validation pairs."""

from __future__ import annotations

import itertools
import json
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("torch")

from signsplice.errors import InputError
from signsplice_paper.train import scales, search, training
from signsplice_paper.train.search import SearchPlan, SearchRow
from training_toys import corpus


def row(rate: float, width: float, paa: float, part: str = "spsn") -> SearchRow:
    units = scales.make_parts("lptransformer", "cpu")[0]
    return SearchRow(
        part, rate, width, units.rate * rate, round(search.get_width(units.config) * width), {"paa": paa}, 5, 7, 1.0
    )


def test_every_part_is_tried_with_three_rates_and_two_widths() -> None:
    for name, part in ((part.name, part) for system in scales.SYSTEMS for part in scales.make_parts(system, "cpu")):
        tried = search.make_variants(part)
        assert len(tried) == 6
        assert [made for rate, width, made in tried if (rate, width) == (1.0, 1.0)] == [part], name
        for rate, width, made in tried:
            assert made.rate == pytest.approx(rate * part.rate)
            units = search.get_width(made.config)
            assert units == pytest.approx(width * search.get_width(part.config), rel=0.1)
            assert units % getattr(made.config, "n_heads", 1) == 0


def test_a_search_is_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "RATES", (1.0,))
    monkeypatch.setattr(search, "_count_steps", lambda part, config, pairs, cpu_s: round(cpu_s))
    plan = SearchPlan(corpus().folder, tmp_path / "work", "smoke", minutes=1 / 60)
    lines: list[str] = []
    assert search.run(plan, ["lstm"], tmp_path, 1, lines.append, deadline=time.monotonic() - 1.0) == []
    assert lines == ["time is up: 2 trainings are left; the same call continues"]
    rows = search.run(plan, ["lstm"], tmp_path, 1, lines.append)
    assert len(rows) == 2
    assert all({"accuracy", "paa"} <= row.scores.keys() and row.n_parameters > 0 for row in rows)
    assert [row.steps for row in rows] == [1, 1]
    assert rows[0].score == pytest.approx((rows[0].scores["accuracy"] + rows[0].scores["paa"]) / 2.0)
    assert search.read(tmp_path / search.FILE) == rows
    assert not list((tmp_path / "work").glob("*/*.pt")), "no weights are left"
    lines.clear()
    assert search.run(plan, ["lstm"], tmp_path, 1, lines.append) == rows
    assert lines == [], "nothing is trained again"
    with pytest.raises(InputError, match=r"search.json: a search of .*'minutes': 0.01.*, expected .*'minutes': 3"):
        search.run(SearchPlan(plan.pairs, plan.folder, "smoke", minutes=3), ["lstm"], tmp_path, 1, lines.append)
    (tmp_path / search.FILE).write_text(json.dumps({"rows": [{"part": "spsn"}]}))
    with pytest.raises(InputError, match="holds no search"):
        search.read(tmp_path / search.FILE)


@pytest.mark.parametrize("system", ["lptransformer", "lpt-plus", "lstm"])
def test_twice_the_time_is_twice_the_steps(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.count(0.0, 10.0)  # the timed steps take ten seconds
    monkeypatch.setattr(search, "time", SimpleNamespace(process_time=lambda: next(clock)))
    monkeypatch.setattr(search, "_TIMED_STEPS", 2)
    part = training.fit_to_skeleton(scales.make_parts(system, "smoke")[0], corpus())
    config = training.Training(system, "smoke")
    assert [search._count_steps(part, config, corpus(), cpu_s) for cpu_s in (60.0, 120.0, 0.1)] == [12, 24, 1]
