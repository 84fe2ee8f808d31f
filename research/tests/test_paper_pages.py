"""The committed pages of the paper are what the command writes from the committed results."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from signsplice.errors import InputError
from signsplice_paper import page_template, pages, published, results
from toys import of_rows, row

DOCS = Path(__file__).resolve().parents[1] / "docs"


@pytest.mark.parametrize("name", ["", "word"])
def test_committed_tables_and_claims_come_from_committed_results(name: str, tmp_path: Path) -> None:
    folder = DOCS / name
    if not (folder / results.FILE).is_file():
        pytest.skip(f"{folder} holds no results")
    docs = tmp_path / "docs"
    shutil.copytree(DOCS.parent / page_template.TEMPLATES, tmp_path / page_template.TEMPLATES)
    for where in ("", "word"):
        if (DOCS / where / results.FILE).is_file():
            (docs / where).mkdir(parents=True, exist_ok=True)
            shutil.copy(DOCS / where / results.FILE, docs / where / results.FILE)
    found = results.load(folder / results.FILE)
    written = pages.write(found, docs / name, "cpu") + page_template.write(found, docs / name, "cpu")
    assert written
    assert {path.name for path in folder.glob("*.csv")} == {path.name for path in written if path.suffix == ".csv"}
    for path in written:
        committed = folder / path.name
        assert committed.is_file(), f"{committed}: not there; `signsplice-paper tables --out {folder}`"
        assert committed.read_bytes() == path.read_bytes(), f"{committed}: `signsplice-paper tables --out {folder}`"


def test_the_table_of_treatments_has_spreads_and_names_what_lacks_seeds() -> None:
    seeds = [row(published.PRINTED, seed=seed, scores={"paa": 0.7 + 0.1 * seed}) for seed in range(3)]
    partner = of_rows(*seeds, row("lstm", fr=None, scores={"pta": 0.25}))
    filled = page_template.filled("{{partner treatments}}\n{{partner seeds}}", {"partner": partner}, "cpu")
    *table, few = filled.splitlines()
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table]
    assert [row[1] for row in rows] == ["printed", "as printed", "equal treatment"] * 4
    assert rows[10][5] == "0.800 [0.700, 0.900]"
    assert rows[5][4] == "0.250", "one seed has no spread"
    assert few.startswith("three each, but 0 of ConvS2S, as printed; ")
    assert "1 of LSTM, equal treatment" in few
    assert "LpTransformer, as printed" not in few


def test_a_template_takes_means_spreads_ratios_splits_and_methods_from_the_rows() -> None:
    partner = of_rows(
        row("lpt", scores={"paa": 0.7}),
        row("lpt", seed=1, scores={"paa": 0.8}),
        row("lstm", fr=None, scores={"paa": 0.25}),
        row("lstm", fr=None, split="unseen-signer", scores={"paa": 0.5}),
        row("lpt", fr=6, scores={"paa": 0.1}),
        row("a+b", scale=results.CLASSICAL, optimiser="", fr=None, seed=None, given="positions and length"),
    )
    text = (
        "{{partner lpt paa 2}} {{partner lpt paa 2 spread}} {{partner lpt/lstm paa 1}} {{partner lpt#6 paa 1}} "
        "{{partner lstm@unseen-signer paa 1}} {{partner a+b:positions_and_length bleu-1 1}} {{partner lpt mse short}}"
    )
    filled = page_template.filled(text, {"partner": partner}, "cpu")
    assert filled == "0.75 0.75 [0.70, 0.80] 3.0 0.1 0.5 0.8 0.0016"
    for wrong in ("{{partner nat paa 3}}", "{{word lpt paa 3}}", "{{partner lpt paa}}", "{{partner lpt nothing 3}}"):
        with pytest.raises(InputError, match=r"partner|TRUTH"):
            page_template.filled(wrong, {"partner": partner}, "cpu")
