"""Pages from rows: templates with figures, the tables alone, and the committed ones from the committed results."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from signsplice.errors import InputError
from signsplice_paper import pages, published, results, tables
from toys import DOCS, committed_results, of_rows, row


def test_committed_pages_come_from_committed_results(tmp_path: Path) -> None:
    found = committed_results()
    shutil.copytree(DOCS.parent / pages.TEMPLATES, tmp_path / pages.TEMPLATES)
    (tmp_path / "docs").mkdir()
    for name in ("speed-cpu.json", "speed-paper.json"):
        shutil.copy(DOCS / name, tmp_path / "docs")
    written = pages.write(found, tmp_path / "docs", "cpu")
    assert {pages.TABLE, "README.md"} <= {path.name for path in written}
    for path in written:
        committed = DOCS / path.name
        assert committed.is_file(), f"{committed}: not there; `signsplice-paper tables`"
        assert committed.read_bytes() == path.read_bytes(), f"{committed}: `signsplice-paper tables`"


FOUND = of_rows(
    row("lptransformer", condition=published.EQUAL, scores={"paa": 0.7}),
    row("lptransformer", condition=published.EQUAL, seed=1, scores={"paa": 0.8}),
    row("lptransformer", condition=published.EQUAL, taught="another", scores={"paa": 0.6}),
    row("lptransformer", condition=published.EQUAL, split="unseen-words", taught="another", scores={"paa": 0.3}),
    row("lptransformer-printed", condition=published.AS_PRINTED, optimiser="sgd", scores={"paa": 0.1}),
    row("lstm", condition=published.EQUAL, fr=None, scores={"paa": 0.25, "within_1": 0.9}),
    row("lstm", condition=published.EQUAL, fr=None, split="unseen-signer", scores={"paa": 0.5, "within_1": 0.7}),
    row("a+b", scale=results.CLASSICAL, optimiser="", fr=None, seed=None, given="positions and length"),
)


@pytest.mark.parametrize(
    ("asked", "figure"),
    [
        ("lptransformer paa 2", "0.75"),
        ("lptransformer paa 2 spread", "0.75 [0.70, 0.80]"),
        ("lptransformer paa,mse short", "0.75 | 0.0016"),
        ("lptransformer/lstm paa 1", "3.0"),
        ("lstm@unseen-signer paa 1", "0.5"),
        ("lptransformer* paa 1", "0.6"),
        ("lptransformer@unseen-words* paa 1", "0.3"),
        ("lptransformer-printed~sgd paa 1", "0.1"),
        ("a+b bleu-1 1", "0.8"),
    ],
)
def test_a_template_takes_a_figure_from_the_rows(asked: str, figure: str) -> None:
    assert pages.fill_template(f"It is {{{{{asked}}}}}.", FOUND, "cpu") == f"It is {figure}."


def test_a_template_takes_times_from_files_and_lines_from_rows(tmp_path: Path) -> None:
    timed = {"system": "lstm", "decoding": "one-by-one", "writes": "transition", "n_parameters": 2_340_000}
    (tmp_path / "speed-cpu.json").write_text(json.dumps({"rows": [timed | {"ms_median": 1.26, "times_base": 0.5}]}))
    text = pages.fill_template(
        "{{speed cpu}}{{speed cpu transformer}}\n{{summary lstm lptransformer*}}", FOUND, "cpu", tmp_path
    )
    assert text.splitlines() == [
        "| LSTM | one-by-one | transition | 2.3 | 1.3 | 0.50 |",
        f"| LSTM | {published.EQUAL} | {tables.ON_SPLIT} | 0.990 | 0.250 | 0.9800 | 0.0016 | 0.500 | - | 0.800 | - |",
        f"| LpTransformer | {published.EQUAL} | {tables.ON_MANY} | "
        "0.990 | 0.600 | 0.9800 | 0.0016 | 0.500 | 0.800 | - | - |",
    ]
    with pytest.raises(InputError, match="no row of scale"):
        pages.fill_template("{{summary nobody}}", FOUND, "cpu")


@pytest.mark.parametrize(
    "asked",
    [
        *("lptransformer paa", "lptransformer paa 3 more", "lptransformer nothing 3", "nobody paa 3"),
        *("lstm@unseen-words paa 3", "lstm* paa 3", "lstm~sgd paa 3", "lptransformer paa many"),
        *("summary nobody", "table random"),
    ],
)
def test_what_no_row_has_is_named(asked: str) -> None:
    with pytest.raises(InputError, match=r"^\{\{.*\}\}: "):
        pages.fill_template(f"{{{{{asked}}}}}", FOUND, "cpu")


def test_pages_are_those_of_the_templates_or_the_tables_alone(tmp_path: Path) -> None:
    folder = tmp_path / "docs"
    folder.mkdir()
    assert [path.name for path in pages.write(FOUND, folder, "cpu")] == ["table.csv", "tables.md"]
    assert (folder / "table.csv").read_text() == tables.format_csv(FOUND, "cpu")
    assert (folder / "tables.md").read_text() == tables.format_page(FOUND, "cpu")
    (tmp_path / "templates").mkdir()
    (tmp_path / "templates" / "claims.md").write_text("PAA: {{lstm paa 2}}\n")
    assert [path.name for path in pages.write(FOUND, folder, "cpu")] == ["table.csv", "claims.md"]
    head, body = (folder / "claims.md").read_text().splitlines()
    assert "templates/claims.md" in head
    assert body == "PAA: 0.25"
