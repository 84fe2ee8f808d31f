"""The table: the paper's printed numbers, seeds, conditions, what systems were taught on, refusals, and its forms."""

from __future__ import annotations

import csv
import io
import math
from typing import Any

import pytest

from signsplice.errors import InputError
from signsplice_paper import layout, published, tables
from signsplice_paper.layout import Table
from signsplice_paper.results import CLASSICAL, FITTED, MEAN, SHIPPED, ResultRow, Results
from signsplice_paper.tables import ON_MANY, ON_SPLIT, PAPERS_FIGURES
from toys import of_rows, row

DESIGN = """
BLEU-1 0.744 0.881 0.735 0.894 BLEU-2 0.649 0.771 0.652 0.869 BLEU-3 0.599 0.677 0.615 0.848
BLEU-4 0.563 0.610 0.615 0.824 PTA 0.251 0.999 0.996 0.999 PAA 0.999 0.784 0.601 0.999
BLEU-1 0.854 0.823 0.844 0.894 BLEU-2 0.785 0.774 0.733 0.869 BLEU-3 0.731 0.697 0.688 0.848
BLEU-4 0.704 0.642 0.621 0.824 PTA 0.999 0.999 0.984 0.999 PAA 0.829 0.999 0.801 0.999
"""
"""Tables 1 and 3 as the paper prints them, by metric: a second copy that checks the first."""


def system(name: str = published.LPTRANSFORMER, **changes: Any) -> ResultRow:
    """A row of one of the paper's systems."""
    condition = published.AS_PRINTED if name.endswith("printed") else published.EQUAL
    return row(name, **{"condition": condition, **changes})


def method(name: str, scale: str = CLASSICAL, **changes: Any) -> ResultRow:
    """A row of a method on clips."""
    return row(name, scale=scale, optimiser="", fr=None, seed=None, steps=None, **changes)


def paper_rows() -> list[ResultRow]:
    """Rows of the paper's systems with its printed scores."""
    return [
        system(name, scores={published.SCORES[m]: float(v) for m, v in zip(published.METRICS, values, strict=True)})
        for name, values in (published.TABLE_1 | published.TABLE_3).items()
    ]


def cells(text: str) -> list[list[str]]:
    return [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| ")]


def test_the_printed_numbers_equal_a_second_copy() -> None:
    words = DESIGN.split()
    whole = published.TABLE_1[published.PRINTED]
    for n, values in enumerate(([*published.TABLE_1.values()], [*published.TABLE_3.values(), whole])):
        for m, metric in enumerate(published.METRICS):
            at = 5 * (6 * n + m)
            assert words[at] == metric
            assert [of[m] for of in values] == words[at + 1 : at + 5]


def test_the_table_has_the_printed_and_the_measured_scores() -> None:
    made = tables.make_table(of_rows(*paper_rows()), "cpu", "random")
    assert made is not None
    shown = {tuple(line[:2]): dict(zip(made.head, line, strict=True)) for line in made.rows}
    for name, values in (published.TABLE_1 | published.TABLE_3).items():
        printed = shown[published.get_display_name(name), PAPERS_FIGURES]
        condition = published.EQUAL if name in (*published.RIVALS, *published.ABLATIONS) else published.AS_PRINTED
        measured = shown[published.get_display_name(name), condition]
        for metric, value in zip(published.METRICS, values, strict=True):
            if metric in tables.ON_PAGE:
                assert printed[metric] == measured[metric] == value
    whole = shown["LpTransformer", PAPERS_FIGURES]
    assert (whole["Accuracy"], whole["MSE"], whole["both exact"]) == ("0.99", "0.0015", "-")
    assert shown["LSTM", PAPERS_FIGURES]["Accuracy"] == "-", "it is printed of no rival"
    words = tables.make_table(of_rows(system("lstm", split="unseen-words")), "cpu", "unseen-words")
    assert words is not None
    assert [line[1] for line in words.rows] == [published.EQUAL], "the paper judged one split"


def test_seeds_are_shown_with_their_mean_and_range() -> None:
    found = of_rows(*(system("lpt-plus", seed=seed, scores={"paa": 0.7 + 0.1 * seed}) for seed in range(3)))
    one = tables.find_line(found, "cpu", "lpt-plus", "random")
    assert one.score("paa") == pytest.approx(0.8)
    assert one.format_cell("paa") == "0.800 [0.700, 0.900]"
    assert one.format_cell("mse", tables.SHORT) == "0.0016 [0.0016, 0.0016]"
    assert one.n_seeds == 3
    assert tables.find_line(of_rows(system("lpt-plus")), "cpu", "lpt-plus", "random").format_cell("paa") == "0.900", (
        "one seed has no range"
    )
    unknown = tables.find_line(found, "cpu", "lstm", "random")
    assert (unknown.n_seeds, unknown.format_cell("paa")) == (0, "-")
    assert math.isnan(unknown.score("paa"))


def test_the_time_of_seeds_is_that_of_the_last_that_was_timed() -> None:
    timed = [system("lpt-plus", seed=seed, scores={"ms_median": 5.0 - 2.0 * seed}) for seed in (1, 0)]
    found = of_rows(*timed, system("lpt-plus", seed=2, scores={"ms_median": float("nan")}))
    one = tables.find_line(found, "cpu", "lpt-plus", "random")
    assert (one.score("ms_median"), one.format_cell("ms_median", 1)) == (3.0, "3.0")


def test_positions_of_a_system_that_found_no_token_with_any_seed_are_not_shown() -> None:
    silent = system("lstm-printed", scores={"pta": 0.0, "paa": None, "paa_all": 0.0, "bleu-1": 0.4321})
    one = tables.find_line(of_rows(silent), "cpu", "lstm-printed", "random")
    assert [one.format_cell(name) for name in ("pta", "paa", "paa_all", "bleu-1")] == ["0.000", "-", "-", "0.432"]
    heard = system("lstm-printed", seed=1, scores={"pta": 0.001, "paa": 1.0, "paa_all": 0.001})
    two = tables.find_line(of_rows(silent, heard), "cpu", "lstm-printed", "random")
    assert [two.format_cell(name) for name in ("paa", "paa_all")] == ["1.000", "0.001 [0.000, 0.001]"]


def test_lines_are_apart_by_condition_optimiser_and_what_was_taught() -> None:
    rows = [
        method("learned-fluent+learned", SHIPPED),
        method("mean-transition", MEAN),
        method("commonest-cut+ridge", FITTED),
        system(published.LPTRANSFORMER, taught="another", scores={"paa": 0.4}),
        system("lptransformer-wa"),
        system("lpt-plus"),
        system(published.PRINTED, optimiser="sgd"),
        *(system(name, seed=seed) for seed in (0, 1) for name in (published.LPTRANSFORMER, published.PRINTED)),
        system("lstm"),
        system("lstm", scale="smoke"),
        system("conv-s2s", part="valid"),
        system("transformer", split="unseen-words"),
    ]
    found = of_rows(*rows)
    assert [
        (one.system, one.condition, one.taught, one.n_seeds) for one in tables.list_lines(found, "cpu", "random")
    ] == [
        ("LSTM", published.EQUAL, ON_SPLIT, 1),
        ("LpTransformer", published.AS_PRINTED, ON_SPLIT, 2),
        ("LpTransformer", f"{published.AS_PRINTED}, SGD", ON_SPLIT, 1),
        ("LpTransformer", published.EQUAL, ON_SPLIT, 2),
        ("LPT+", published.EQUAL, ON_SPLIT, 1),
        ("LPT-WA", published.EQUAL, ON_SPLIT, 1),
        ("LpTransformer", published.EQUAL, ON_MANY, 1),
        ("commonest-cut+ridge", "given nothing", "-", 1),
        ("mean transition", "given nothing", "-", 1),
        ("learned-fluent+learned", "given nothing", "-", 1),
    ]
    assert tables.find_line(found, "cpu", published.LPTRANSFORMER, "random", ON_MANY).score("paa") == 0.4
    assert tables.find_line(found, "cpu", published.PRINTED, "random", optimiser="sgd").n_seeds == 1
    assert tables.find_line(found, "cpu", "mean-transition", "random").n_seeds == 1


@pytest.mark.parametrize("field", ["metrics_id", "protocol", "corpus"])
def test_rows_that_differ_in_recipe_stand_in_no_table_together(field: str) -> None:
    odd = system("lstm", **{field: "another"})
    found = of_rows(*paper_rows()).merge([odd])
    with pytest.raises(InputError, match=f"cannot be compared in one table: {field}"):
        tables.make_table(found, "cpu", "random")
    apart = of_rows(system("lpt-plus"), system("lstm", split="unseen-words", **{field: "another"}))
    assert "unseen-words" in tables.format_csv(apart, "cpu"), "each split has a protocol of its own"


def test_the_csv_has_every_line_of_every_split_with_all_columns() -> None:
    rows = [*paper_rows(), system("lstm", seed=1, steps=300), system("lstm", split="unseen-both")]
    rows += [method("mean-transition", MEAN, split="unseen-words", scores={"joint_jumps": None})]
    found = of_rows(*rows)
    lines = list(csv.DictReader(io.StringIO(tables.format_csv(found, "cpu"))))
    assert len(lines) == len(paper_rows()) + 2
    assert [line["split"] for line in lines[-2:]] == ["unseen-words", "unseen-both"]
    assert {title for _, _, title in tables.COLUMNS} <= set(lines[0])
    lstm = next(line for line in lines if (line["split"], line["system"]) == ("random", "LSTM"))
    assert (lstm["seeds"], lstm["steps"], lstm["taught on"]) == ("2", "100/300", ON_SPLIT)
    one = tables.find_line(found, "cpu", "lstm", "random")
    assert [lstm[title] for _, _, title in tables.COLUMNS] == [
        one.format_cell(name, d) for name, d, _ in tables.COLUMNS
    ]
    assert lines[-2]["over 60 degrees"] == "-"


def test_the_page_shows_the_tables_of_all_splits_that_have_rows() -> None:
    text = tables.format_page(of_rows(*paper_rows(), system("lpt-plus", split="unseen-signer", n_pairs=7)), "cpu")
    assert text.startswith("# Tables\n")
    assert "**random: 3 test pairs**" in text
    assert "**unseen-signer: 7 test pairs**" in text
    assert "unseen-words" not in text
    assert ["LPT+", published.EQUAL, ON_SPLIT] in [line[:3] for line in cells(text)]
    named = tables.make_table(of_rows(*paper_rows()), "cpu", "random", ["lstm"])
    assert named is not None
    measured = [line for line in named.rows if line[1] != PAPERS_FIGURES]
    assert [line[0] for line in measured] == ["LSTM"]
    assert tables.make_table(Results(), "cpu", "random") is None
    assert tables.make_table(of_rows(*paper_rows()), "cpu", "random", ["nobody"]) is None


def test_markdown_has_the_caption_the_cells_and_the_notes() -> None:
    table = Table("50% of a_b & c", "x", ("a|b", "c"), (("<1", "2"),), ("by `m|n_o`, " + "word " * 60,))
    lines = layout.format_markdown(table).splitlines()
    assert lines[:5] == ["**50% of a_b & c**", "", "| a\\|b | c |", "| --- | --- |", "| <1 | 2 |"]
    assert lines[6].startswith("by `m|n_o`, word")
    assert 1 < len(lines[6:]) <= 4, "wrapped"
    assert max(map(len, lines)) <= 160
    with pytest.raises(ValueError, match="2 cells under 1 heads"):
        Table("", "x", ("a",), (("1", "2"),))


def test_scores_are_written_with_the_digits_that_mean_something() -> None:
    assert [layout.format_short(x) for x in (0.0015, 0.0123, 0.2, 0.0, float("nan"))] == [
        "0.0015",
        "0.012",
        "0.20",
        "0",
        "-",
    ]
    assert [layout.format_number(x) for x in (0.12345, float("nan"))] == ["0.123", "-"]
    assert (tables.format_score(0.0123, tables.SHORT), tables.format_score(0.0123, 1)) == ("0.012", "0.0")
