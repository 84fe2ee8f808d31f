"""The report of the rebuilt paper as PDF."""

from __future__ import annotations

import hashlib
import re
import shutil
from datetime import date
from pathlib import Path

import pytest

from signsplice.errors import InputError
from signsplice_paper import published, report, results
from signsplice_paper.results import Results
from toys import DOCS, committed_results, of_rows, row

DAY = date(2026, 11, 28)
TEMPLATE = """
Version {{version}}, corpus {{corpus}}, results {{results}}: LSTM has {{lstm pta 2}}.

#table(columns: 8, {{rows}})

#image("figure4c.svg")
"""
DRAWING = '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"><rect width="9" height="9"/></svg>'


def folder_with(tmp_path: Path, template: str | None, drawing: str | None) -> Path:
    """A folder of results with a template beside it and a drawing in it."""
    folder = tmp_path / "docs"
    for path, text in ((tmp_path / "templates" / "report.typ", template), (folder / "figure4c.svg", drawing)):
        path.parent.mkdir()
        if text is not None:
            path.write_text(text)
    (folder / results.FILE).write_text("{}")
    return folder


def test_the_report_of_committed_results_is_a_pdf_of_at_most_four_pages(tmp_path: Path) -> None:
    pytest.importorskip("typst")
    found = committed_results()
    shutil.copytree(DOCS.parent / "templates", tmp_path / "templates")
    shutil.copytree(DOCS, tmp_path / "docs")
    report.write(found, tmp_path / "docs", "cpu", tmp_path / "report.pdf", DAY)
    data = (tmp_path / "report.pdf").read_bytes()
    assert data.startswith(b"%PDF-")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", data)) <= 4
    results_hash = hashlib.sha256((DOCS / results.FILE).read_bytes()).hexdigest()[:12].encode()
    for pdf in (data, (DOCS / "report.pdf").read_bytes()):
        assert results_hash in pdf, "of these results: `signsplice-paper report`"
        assert b"signsplice contributors" in pdf


def test_a_template_becomes_a_pdf(tmp_path: Path) -> None:
    pytest.importorskip("typst")
    folder = folder_with(tmp_path, TEMPLATE, DRAWING)
    report.write(of_rows(row("lstm", condition=published.EQUAL)), folder, "cpu", tmp_path / "report.pdf", DAY)
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF-")


def test_the_rows_are_the_four_systems_as_printed_and_by_condition() -> None:
    seeds = [row("lstm", condition=published.EQUAL, seed=seed, scores={"paa": 0.7 + 0.1 * seed}) for seed in range(3)]
    lines = report._format_rows(of_rows(*seeds), "cpu").splitlines()
    assert len(lines) == 3 * len(published.CONDITIONS)
    lstm = next(k for k, line in enumerate(lines) if "[LSTM]" in line)
    assert "[printed], [0.881], [0.610], [0.999], [0.784], [-], [-]," in lines[lstm]
    assert "[as printed], [-], [-], [-], [-], [-], [-]," in lines[lstm + 1], "not trained yet"
    assert r"[0.800 \ #text(size: 6pt)[0.700 to 0.900]]" in lines[lstm + 2]
    assert "[LpTransformer], [printed]" in lines[-3]
    assert "[0.99], [0.0015]," in lines[-3]


@pytest.mark.parametrize(
    ("template", "drawing", "rows", "message"),
    [
        (None, DRAWING, True, r"report\.typ: not there"),
        (TEMPLATE, None, True, r"figure4c\.svg: not there"),
        (TEMPLATE, DRAWING, False, "no rows"),
        (TEMPLATE + "{{lstm nothing 3}}", DRAWING, True, "no row of scale cpu has it"),
    ],
)
def test_where_something_lacks_the_report_is_refused_and_nothing_is_written(
    template: str | None, drawing: str | None, rows: bool, message: str, tmp_path: Path
) -> None:
    pytest.importorskip("typst")
    found = of_rows(row("lstm", condition=published.EQUAL)) if rows else Results()
    with pytest.raises(InputError, match=message):
        report.write(found, folder_with(tmp_path, template, drawing), "cpu", tmp_path / "report.pdf", DAY)
    assert not (tmp_path / "report.pdf").exists()
