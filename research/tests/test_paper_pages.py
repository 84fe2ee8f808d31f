"""The committed pages of the paper are what the command writes from the committed results."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from signsplice_paper import claims_page, pages, results

DOCS = Path(__file__).resolve().parents[1] / "docs"


@pytest.mark.parametrize("name", ["", "word"])
def test_committed_tables_and_claims_come_from_committed_results(name: str, tmp_path: Path) -> None:
    folder = DOCS / name
    if not (folder / results.FILE).is_file():
        pytest.skip(f"{folder} holds no results")
    for where in ("", "word"):
        if (DOCS / where / results.FILE).is_file():
            (tmp_path / where).mkdir(exist_ok=True)
            shutil.copy(DOCS / where / results.FILE, tmp_path / where / results.FILE)
    found = results.load(folder / results.FILE)
    written = pages.write(found, tmp_path / name, "cpu") + claims_page.write(found, tmp_path / name, "cpu")
    assert written
    assert {path.name for path in folder.glob("*.csv")} == {path.name for path in written if path.suffix == ".csv"}
    for path in written:
        committed = folder / path.name
        assert committed.is_file(), f"{committed}: not there; `signsplice-paper tables --out {folder}`"
        assert committed.read_bytes() == path.read_bytes(), f"{committed}: `signsplice-paper tables --out {folder}`"
