"""Tables: the paper's printed numbers, seeds, what is missing or not trained, refusals, Markdown, CSV and LaTeX."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import pytest

from signsplice.errors import InputError
from signsplice_paper import layout, lines, pages, published, results, tables
from signsplice_paper.curve import COLUMNS, Curve
from signsplice_paper.layout import RULE, Table
from signsplice_paper.results import CLASSICAL, MEAN, ResultRow, Results
from toys import of_rows, row

DESIGN = """
BLEU-1 0.744 0.881 0.735 0.894 BLEU-2 0.649 0.771 0.652 0.869 BLEU-3 0.599 0.677 0.615 0.848
BLEU-4 0.563 0.610 0.615 0.824 PTA 0.251 0.999 0.996 0.999 PAA 0.999 0.784 0.601 0.999
BLEU-1 0.854 0.823 0.844 0.894 BLEU-2 0.785 0.774 0.733 0.869 BLEU-3 0.731 0.697 0.688 0.848
BLEU-4 0.704 0.642 0.621 0.824 PTA 0.999 0.999 0.984 0.999 PAA 0.829 0.999 0.801 0.999
"""
"""Tables 1 and 3 as the paper prints them, by metric: a second copy that checks the first."""


def paper_rows(optimiser: str = "adamw", split: str = "random", **changes: object) -> list[ResultRow]:
    """Rows of the paper's systems with its printed scores."""
    out = []
    for n, (system, values) in enumerate({**published.TABLE_3, **published.TABLE_1}.items()):
        scores = {published.SCORES[m]: float(v) for m, v in zip(published.METRICS, values, strict=True)}
        printed = system == published.PRINTED
        times = {"conv-s2s": 2.0, "transformer": 60.0, published.PRINTED: 11.0, "lpt-printed-wc": 50.0}
        scores |= {"mse": 0.0015 if printed else 0.01, "accuracy": 0.99 if printed else 0.9 + n / 1000}
        scores |= {"ms_mean": times.get(system, 10.0)}
        fr = 8 if printed else None
        out.append(row(system, optimiser=optimiser, split=split, fr=fr, scores=scores, **changes))
    return out


def cells(text: str) -> list[list[str]]:
    return [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| ")]


def test_the_printed_numbers_equal_a_second_copy() -> None:
    words = DESIGN.split()
    for n, table in enumerate((published.TABLE_1, published.TABLE_3)):
        for m, metric in enumerate(published.METRICS):
            at = 5 * (6 * n + m)
            assert words[at] == metric
            assert [values[m] for values in table.values()] == words[at + 1 : at + 5]


@pytest.mark.parametrize(("n", "printed"), [(1, published.TABLE_1), (3, published.TABLE_3)])
def test_tables_hold_the_printed_numbers_exactly(n: int, printed: dict[str, tuple[str, ...]]) -> None:
    found = of_rows(*paper_rows())
    made = (tables.table_1 if n == 1 else tables.table_3)(found, "cpu")
    text = cells(layout.markdown(made[0]))
    for system, values in printed.items():
        (line,) = [c for c in text if c[:2] == [published.name(system), "the paper"]]
        assert line[2:8] == list(values)
        (measured,) = [c for c in text if c[0] == published.name(system) and c[1].startswith("AdamW")]
        assert measured[2:8] == list(values), "equal scores print alike"
        assert " & ".join(values) in layout.latex(made[0])


def test_seeds_are_shown_with_their_mean_and_range() -> None:
    found = of_rows(*(row("lpt", seed=seed, scores={"paa": paa}) for seed, paa in enumerate((0.7, 0.8, 0.9))))
    one = lines.line(found, "lpt", "cpu", "random")
    assert one.cell("paa") == "0.800 [0.700, 0.900]"
    assert one.origin == "AdamW, 100 steps, 3 seeds"
    assert one.seeds == "0, 1, 2"
    assert lines.line(of_rows(row("lpt")), "lpt", "cpu", "random").cell("paa") == "0.900", "one seed has no range"


def test_the_time_of_seeds_is_that_of_the_last_that_was_timed() -> None:
    timed = [row("lpt", seed=seed, scores={"ms_mean": 5.0 - 2.0 * seed}) for seed in (1, 0)]
    found = of_rows(*timed, row("lpt", seed=2, scores={"ms_mean": float("nan")}))
    one = lines.line(found, "lpt", "cpu", "random")
    assert (one.score("ms_mean"), one.cell("ms_mean", 1)) == (3.0, "3.0")


def test_systems_that_share_networks_are_compared_with_the_seeds_that_all_have() -> None:
    bleu = {0: 0.8, 1: 0.7, 2: 0.9}
    found = of_rows(
        *(row(published.PRINTED, seed=seed, scores={"bleu-4": score}) for seed, score in bleu.items()),
        *(row("lpt-printed-wa", seed=seed, scores={"bleu-4": 0.75}) for seed in (0, 1)),
        *(row(published.PRINTED, fr=6, seed=seed, scores={"bleu-4": 0.85}) for seed in (1, 2)),
    )
    assert lines.line(found, published.PRINTED, "cpu", "random").score("bleu-4") == pytest.approx(0.8)
    (table, *_) = tables.table_3(found, "cpu")
    cell = table.head.index("BLEU-4")
    shown = {r[0]: r for r in table.rows if len(r) > 1 and r[1].startswith("AdamW, 100")}
    assert shown["LpTransformer"][1] == shown["LPT-WA"][1] == "AdamW, 100 steps, 2 seeds"
    assert shown["LpTransformer"][cell] == "0.750 [0.700, 0.800]"
    (by_fr,) = tables.table_fr(found, "cpu")
    assert [r[by_fr.head.index("BLEU-4")] for r in by_fr.rows[1:]] == ["0.850 [0.850, 0.850]", "0.800 [0.700, 0.900]"]
    strange = of_rows(row(published.PRINTED, seed=0), row("lpt-printed-wa", seed=1))
    assert all(one.rows for one in tables.blocks_3(strange, "cpu", "random")[0][1] if one.name in ("LPT-WA",))


def test_a_system_below_the_mean_transition_is_marked_and_keeps_its_scores() -> None:
    mean = row("mean-transition", scale=MEAN, optimiser="", fr=None, seed=None, scores={"accuracy": 0.95})
    low = row(published.PRINTED, optimiser="sgd", scores={"accuracy": 0.9499, "bleu-1": 0.4321})
    found = of_rows(*paper_rows(), mean, low, row("lpt", scores={"accuracy": 0.95}))
    text = layout.markdown(tables.table_1(found, "cpu")[0])
    (sgd,) = [c for c in cells(text) if c[0] == "LpTransformer" and c[1].startswith("SGD")]
    assert sgd[1] == "SGD, 100 steps; below the mean transition"
    assert "0.432" in sgd
    assert not lines.line(found, "lpt", "cpu", "random").origin.endswith(lines.BELOW), "as good as the mean"
    better = found.merged([replace(low, seed=1, scores={**low.scores, "accuracy": 0.95})])
    assert lines.BELOW not in lines.line(better, published.PRINTED, "cpu", "random", "sgd").origin, "one seed is enough"
    assert any(c[0] == "mean transition" for c in cells(text))


def test_only_a_system_that_found_no_token_with_any_seed_is_not_trained() -> None:
    silent = row("lstm", fr=None, scores={"pta": 0.0, "bleu-1": 0.4321})
    text = layout.markdown(tables.table_1(of_rows(*paper_rows()[:1], silent), "cpu")[0])
    (shown,) = [c for c in cells(text) if c[0] == "LSTM" and c[1].startswith("AdamW")]
    assert shown[1] == "AdamW, 100 steps; not trained: no token found"
    assert set(shown[2:]) == {"-"}
    one_found = of_rows(silent, row("lstm", fr=None, seed=1, scores={"pta": 0.001}))
    assert lines.line(one_found, "lstm", "cpu", "random").is_known


def test_the_four_systems_stand_in_three_treatments_and_missing_ones_are_named() -> None:
    biased = row("lpt-printed-bias", treatment=published.BIAS_ALONE, scores={"bleu-1": 0.777})
    found = of_rows(row(published.PRINTED), biased, row("lstm", fr=None))
    (table,) = tables.table_treatments(found, "cpu")
    text = layout.markdown(table)
    shown = {tuple(c[:2]): c for c in cells(text)}
    assert shown["LpTransformer", "bias alone: AdamW, 100 steps"][2] == "0.777"
    assert ("LSTM", "equal treatment: AdamW, 100 steps") in shown
    for name in ("LSTM", "Transformer", "ConvS2S"):
        assert set(shown[name, "as printed: AdamW, not trained yet"][2:]) == {"-"}
    assert shown["LSTM", "the paper"][2] == published.TABLE_1["lstm"][0]
    assert tables.table_treatments(of_rows(), "cpu") == []


def test_what_is_missing_is_named() -> None:
    found = of_rows(*paper_rows()[-1:])
    text = layout.markdown(tables.table_1(found, "cpu")[0])
    for name in ("LSTM", "LPT+", "LPT+, no summary", "NAT", "CAM-STITCH LSTM"):
        (line,) = [c for c in cells(text) if c[:2] == [name, "AdamW, not trained yet"]]
        assert set(line[2:]) == {"-"}
    missing = pages.missing_rows(found, "cpu")
    assert missing == "Without any row yet: split unseen-words, split unseen-signer, scale paper."


def test_table_2_lists_the_parts_of_each_ablation() -> None:
    (table,) = tables.table_2(of_rows(row("lpt", n_parameters=1234567)), "cpu")
    found = {r[0]: r[1:] for r in table.rows}
    assert found["LPT-WA"][:2] == ("no", "yes")
    assert found["LPT-WC"][:2] == ("yes", "no")
    assert found["LPT-WAC"][:2] == ("no", "no")
    assert found["LpTransformer"] == ("yes", "yes", "none", "not trained yet")
    assert found["LPT+"] == ("yes", "yes", "all four", "1,234,567")


def test_rows_have_the_number_of_pairs_seen_where_a_curve_has_it() -> None:
    points = [(64.0, 1.0, 0.9, 0.01), (368_000.0, 25.0, 0.98, 0.01)]
    made = [Curve(published.PRINTED, "random", "cpu", "adamw", 8, 0, points, COLUMNS)]
    tables_made = tables.table_1(of_rows(*paper_rows()).merged(curves=made), "cpu")
    table = next(t for t in tables_made if t.label == "rows1-cpu-random")
    seen = {r[0]: r[table.head.index("pairs seen")] for r in table.rows if r}
    assert (seen["LpTransformer"], seen["LSTM"]) == ("368,000", "-")


def test_bleu_has_three_tolerances_and_margins_their_groups() -> None:
    scores = {f"{kind}-{n}@{t:g}": t for kind in ("bleu", "papineni") for n in range(1, 5) for t in (2e-5, 1e-4, 3e-4)}
    scores |= {f"n_margin_{n}": 10.0 * n for n in range(1, 5)} | {f"paa_margin_{n}": n / 10 for n in range(1, 5)}
    made = {t.label: t for t in tables.table_1(of_rows(row(published.PRINTED, scores=scores)), "cpu")}
    (line,) = [r for r in made["bleu1-cpu-random"].rows if r and r[0] == "LpTransformer" and "100 steps" in r[1]]
    assert line[2:] == ("0.000 / 0.000 / 0.000",) * 8
    margins = made["margins1-cpu-random"]
    assert margins.head[2:] == ("under 0.1", "0.1 to 0.2", "0.2 to 0.35", "0.35 or more")
    assert margins.rows[-1][2:] == ("0.100", "0.200", "0.300", "0.400")
    assert "Pairs in each: 10, 20, 30, 40." in margins.notes[0]
    assert "margins1-cpu-random" not in {t.label for t in tables.table_1(of_rows(*paper_rows()), "cpu")}


def classical_rows(split: str = "random") -> list[ResultRow]:
    like = {"scale": CLASSICAL, "optimiser": "", "fr": None, "seed": None, "steps": None, "split": split}
    return [
        row(system, given=given, **like) for system, given in (*tables.CLASSICAL_IN_TABLE_1, ("ends+slerp", "nothing"))
    ]


def test_sgd_that_reached_a_limit_is_marked_apart_from_sgd_that_stopped_improving() -> None:
    by_time, by_plateau = (
        lines.line(of_rows(row("lpt", optimiser="sgd", stopped=why)), "lpt", "cpu", "random", "sgd")
        for why in ("time", "plateau")
    )
    assert "ended by its limit" in by_time.origin
    assert "ended by its limit" not in by_plateau.origin


def test_rows_of_other_optimisers_scales_and_inputs_are_separate() -> None:
    found = of_rows(
        *paper_rows(), *paper_rows("sgd"), *paper_rows(scale="smoke"), *classical_rows(), row("nat", fr=None)
    )
    text = layout.markdown(tables.table_1(found, "cpu")[0])
    assert "scale cpu" in text
    assert sum(line[0] == "LpTransformer" for line in cells(text)) == 3
    assert "| AdamW, 100 steps |" in text
    assert "| SGD, 100 steps |" in text
    assert "| NAT | AdamW" in text
    assert "| true-positions+hermite | classical, given positions and length |" in text
    assert "ends+slerp" not in text
    (_, every) = tables.table_classical(found, "cpu")
    assert "ends+slerp" in layout.markdown(every)
    assert "msd<=" in text
    assert "paper\\|corpus" not in text, "signatures are in code, outside of cells"
    assert "`paper|corpus:c0ffee|split:random`" in text


@pytest.mark.parametrize("field", ["metrics_id", "protocol", "corpus"])
def test_tables_refuse_rows_that_differ_in_recipe(field: str) -> None:
    for make, system in ((tables.table_1, "lstm"), (tables.table_3, "lpt-printed-wa")):
        odd = row(system, fr=None, **{field: "another"})
        with pytest.raises(InputError, match="cannot be compared in one table"):
            make(of_rows(*paper_rows()).merged([odd]), "cpu")
    with pytest.raises(InputError, match="cannot be compared in one table"):
        tables.table_fr(of_rows(row(fr=8), row(fr=6, **{field: "another"})), "cpu")
    with pytest.raises(InputError, match="cannot be compared in one table"):
        tables.table_1(of_rows(*paper_rows(), *classical_rows()).merged([row("nat", fr=None, **{field: "x"})]), "cpu")


def test_the_sweep_of_fr_and_every_split_have_tables() -> None:
    sweep = [row("lpt", fr=fr) for fr in (10, 2, 8)]
    (table,) = tables.table_fr(of_rows(*sweep), "cpu")
    assert [r[0] for r in table.rows if r] == ["2", "8", "10"]
    assert tables.table_fr(of_rows(sweep[0]), "cpu") == []
    found = of_rows(*paper_rows(), *paper_rows(split="unseen-words", protocol="w"), *classical_rows("unseen-signer"))
    found_pages = pages.made(found, "cpu")
    assert [t.label for t in found_pages["table1"] if t.label.startswith("table1")] == [
        *("table1-cpu-random", "table1-cpu-unseen-words", "table1-cpu-unseen-signer")
    ]
    assert all(len(page) == 0 for page in pages.made(Results(), "cpu").values())


def test_times_of_two_machines_get_a_note() -> None:
    text = layout.markdown(tables.table_1(of_rows(*paper_rows()).merged([row("lstm", fr=None, machine="b")]), "cpu")[0])
    assert "Times are of 2 machines and cannot be compared: a machine; b." in text


def balanced(text: str) -> bool:
    depth = 0
    for character in re.sub(r"\\[{}]", "", text):
        depth += {"{": 1, "}": -1}.get(character, 0)
        if depth < 0:
            return False
    return depth == 0


def test_latex_is_well_formed(tmp_path: Path) -> None:
    found = of_rows(*paper_rows(), *paper_rows("sgd"), *classical_rows(), row("lpt", fr=6))
    for page in pages.made(found, "cpu").values():
        for table in page:
            text = layout.latex(table)
            assert balanced(text)
            environments = re.findall(r"\\(begin|end)\{(\w+)\}", text)
            assert environments == [("begin", "table"), ("begin", "tabular"), ("end", "tabular"), ("end", "table")]
            body = text.split(r"\begin{tabular}")[1].split(r"\end{tabular}")[0]
            columns = re.match(r"\{(\w+)\}", body)
            assert columns is not None
            for line in body.splitlines()[1:]:
                if line != r"\hline":
                    assert line.endswith(r" \\"), line
                    assert len(re.findall(r"(?<!\\)&", line)) == len(columns[1]) - 1, line
            assert not re.search(r"(?<!\\)[%#$_]", text), "characters of LaTeX commands are escaped"
            assert text.isascii()


def test_special_characters_are_escaped() -> None:
    table = Table(
        "50% of a_b & c", "x", ("a|b", "c", "d"), (("<1", "{}", "~^\\"), RULE, ("1", "2", "3")), ("by `m|n_o`",)
    )
    text = layout.latex(table)
    assert r"50\% of a\_b \& c" in text
    assert r"\textless{}1 & \{\} & \textasciitilde{}\textasciicircum{}\textbackslash{} \\" in text
    assert r"\texttt{m\textbar{}\allowbreak{}n\_o}" in text
    assert balanced(text)
    assert "| a\\|b | c | d |" in layout.markdown(table)
    with pytest.raises(ValueError, match="2 cells under 1 heads"):
        Table("", "x", ("a",), (("1", "2"),))
    assert [layout.short(x) for x in (0.0015, 0.0123, 0.2, 0.0, float("nan"))] == ["0.0015", "0.012", "0.20", "0", "-"]
    assert layout.number(float("nan")) == "-"


def test_pages_are_written_with_the_same_bytes(tmp_path: Path) -> None:
    found = of_rows(*paper_rows(), *classical_rows())
    with_csv = ("table1", "table2", "treatments", "table3", "classical")
    names = {"tables.md", *(f"{name}.csv" for name in with_csv)}
    assert {path.name for path in pages.write(found, tmp_path, "cpu")} == names
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    pages.write(found, tmp_path, "cpu")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == first
    assert pages.write(Results(), tmp_path / "none", "cpu") == []
    latex = {path.name for path in pages.write(found, tmp_path, "cpu", latex=True)} - names
    assert latex == {f"{name}.tex" for name in with_csv}


def test_a_csv_has_every_cell_of_its_tables(tmp_path: Path) -> None:
    found = of_rows(*paper_rows(), *paper_rows(split="unseen-words", protocol="w"), *classical_rows())
    pages.write(found, tmp_path, "cpu")
    with (tmp_path / "table1.csv").open(newline="") as file:
        lines = {(line["split"], line["system"], line["from"]): line for line in csv.DictReader(file)}
    for table in pages.made(found, "cpu")["table1"]:
        for cells_of in (one for one in table.rows if one and any(one[1:])):
            line = lines[table.split, cells_of[0], cells_of[1]]
            assert [line[head] for head in table.head[2:]] == list(cells_of[2:])
    assert lines["random", "LSTM", "AdamW, 100 steps"]["block"] == "the paper's systems"


def test_the_page_shows_the_main_lines_and_means_and_the_recipe_once(tmp_path: Path) -> None:
    seeds = [row("lpt", seed=seed, scores={"paa": paa}) for seed, paa in enumerate((0.7, 0.9))]
    pages.write(of_rows(*paper_rows(), *seeds, row("nat", fr=None)), tmp_path, "cpu")
    text = (tmp_path / "tables.md").read_text()
    first = text.split("\n## ")[1]
    assert first.startswith("Table 1 of the paper, scale cpu, random\n")
    shown = cells(first)
    assert shown[0] == ["system", "from", "BLEU-1", "BLEU-4", "PTA", "PAA", "Accuracy", "MSE", "ms a pair"]
    (line,) = [c for c in shown if c[0] == "LPT+"]
    assert line[1:6] == ["AdamW, 100 steps, 2 seeds", *line[2:5], "0.800"]
    assert not [c for c in shown if c[0] == "NAT"]
    assert "NAT" in (tmp_path / "table1.csv").read_text()
    assert "[table1.csv](table1.csv)" in text
    assert text.count("Judged by") == 1


def test_tables_with_two_values_of_one_column_make_no_csv() -> None:
    one = Table("", "x", ("a", "b", "c"), (("1", "2", "3"),))
    assert layout.as_csv([one, replace(one, head=("a", "b", "d"))]) == "a,b,c,d\n1,2,3,3\n"
    with pytest.raises(ValueError, match="has 3 and 4 under c"):
        layout.as_csv([one, replace(one, rows=(("1", "2", "4"),))])


def test_the_folder_of_the_other_truth_has_the_csv_alone(tmp_path: Path) -> None:
    results.save(of_rows(*paper_rows()), tmp_path / results.FILE)
    (tmp_path / "word").mkdir()
    assert {path.suffix for path in pages.write(of_rows(*paper_rows()), tmp_path / "word", "cpu")} == {".csv"}
