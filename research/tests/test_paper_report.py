"""The report of the rebuilt paper as PDF."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from signsplice.errors import InputError
from signsplice_paper import results
from signsplice_paper.report import write

RESEARCH = Path(__file__).resolve().parents[1]


def test_the_report_is_a_pdf_of_at_most_four_pages_from_committed_results(tmp_path: Path) -> None:
    pytest.importorskip("typst")
    folder = RESEARCH / "docs"
    write(results.load(folder / results.FILE), folder, "cpu", tmp_path / "report.pdf")
    data = (tmp_path / "report.pdf").read_bytes()
    assert data.startswith(b"%PDF-")
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", data)) <= 4


def test_without_rows_or_template_the_report_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    pytest.importorskip("typst")
    folder = tmp_path / "docs"
    folder.mkdir()
    with pytest.raises(InputError, match=r"report\.typ: not there"):
        write(results.load(folder / results.FILE), folder, "cpu", tmp_path / "report.pdf")
    shutil.copytree(RESEARCH / "templates", tmp_path / "templates")
    shutil.copy(RESEARCH / "docs" / "treatments.svg", folder)
    with pytest.raises(InputError, match="no rows of partner truth"):
        write(results.load(folder / results.FILE), folder, "cpu", tmp_path / "report.pdf")
    assert not (tmp_path / "report.pdf").exists()
