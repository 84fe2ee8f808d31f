"""Motion of written signs, measured by a reader and a geometry that share nothing with the compiler."""

from __future__ import annotations

from pathlib import Path

import pytest

import written_measures as measures

ROWS = list(measures.rows(Path(__file__).parent / "written_signs.sigml"))


@pytest.mark.parametrize("row", ROWS, ids=[row.gloss for row in ROWS])
def test_hands_are_where_the_sign_is_written(row: measures.Row) -> None:
    assert not row.refused
    for name, error in row.errors.items():
        limit = measures.LIMITS[name.split()[-1]]
        assert error <= (limit if name in ("touch", "deep") else 1.2 * limit), name


def test_all_ten_signs_are_measured() -> None:
    assert len(ROWS) == 10
    assert sum("touch" in row.errors for row in ROWS) >= 4
    assert sum(name.startswith("last") for row in ROWS for name in row.errors) >= 5
