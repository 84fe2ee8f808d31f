"""Tables: the paper's printed numbers, its order and claims, refusals, and Markdown and LaTeX."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from toys import of_rows, row

from signsplice.errors import InputError
from signsplice.paper import layout, order, published, tables
from signsplice.paper.layout import RULE, Table
from signsplice.paper.results import CLASSICAL, ResultRow, Results

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
        times = {"conv-s2s": 2.0, "transformer": 60.0, "lpt": 11.0, "lpt-wc": 50.0, "lpt-wac": 50.0}
        scores |= {"mse": 0.0015 if system == "lpt" else 0.01, "accuracy": 0.99 if system == "lpt" else 0.9 + n / 1000}
        scores |= {"ms_mean": times.get(system, 10.0)}
        fr = 8 if system == "lpt" else None
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


def test_printed_scores_agree_with_the_order_and_the_claims() -> None:
    found = of_rows(*paper_rows())
    for n, make in ((1, tables.table_1), (3, tables.table_3)):
        table, claims = make(found, "cpu")
        (line,) = [r for r in table.rows if r and r[0] == "follows the paper's order"]
        assert all(cell.startswith("yes") for cell in line[2:8]), n
        assert all(r[-1] == "yes" for r in claims.rows), claims.rows


def test_the_order_is_counted_by_pairs_of_systems() -> None:
    assert order.follows({"a": 3, "b": 2, "c": 1}, {"a": 0.3, "b": 0.2, "c": 0.1}).verdict == "yes (3/3)"
    assert order.follows({"a": 3, "b": 2, "c": 1}, {"a": 0.3, "b": 0.1, "c": 0.2}).verdict == "no (2/3)"
    assert order.follows({"a": 3, "b": 3, "c": 1}, {"a": 0.1, "b": 0.9, "c": 0.0}).verdict == "yes (2/2)", "a tie"
    assert order.follows({"a": 3, "b": 2}, {"a": 0.5, "b": 0.5}).verdict == "no (0/1)"
    assert order.follows({"a": 3, "b": 2}, {"a": float("nan"), "b": 0.0}).verdict == "no (0/1)"
    assert order.follows({"a": 3, "b": 2}, {"a": 0.5}).verdict == "-"


def test_claims_can_fail() -> None:
    rows = {r.system: r for r in paper_rows()}
    slow = row("lpt", scores={"accuracy": 0.9, "mse": 0.01, "ms_mean": 100.0})
    holds = {claim.claim: claim.holds for claim in order.claims_1({**rows, "lpt": slow})}
    assert not holds["LpTransformer's Accuracy"]
    assert not holds["LpTransformer's MSE"]
    assert not holds["faster than Transformer"]
    assert not holds["slowest"]
    assert holds["fastest"]
    assert order.claims_1({"lstm": rows["lstm"]}) == []
    assert order.claims_3({"lpt": rows["lpt"]}) == []


def classical_rows(split: str = "random") -> list[ResultRow]:
    like = {"scale": CLASSICAL, "optimiser": "", "fr": None, "seed": None, "steps": None, "split": split}
    return [row(system, given=given, **like) for system, given in (*tables.IN_TABLE_1, ("ends+slerp", "nothing"))]


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
    (every,) = tables.table_classical(found)
    assert "ends+slerp" in layout.markdown(every)
    assert "msd<=" in text
    assert "paper\\|corpus" not in text, "signatures are in code, outside of cells"
    assert "`paper|corpus:c0ffee|split:random`" in text


@pytest.mark.parametrize("field", ["metrics_id", "protocol", "corpus"])
def test_tables_refuse_rows_that_differ_in_recipe(field: str) -> None:
    for make, system in ((tables.table_1, "lstm"), (tables.table_3, "lpt-wa")):
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
    assert [r[0] for r in table.rows] == ["2", "8", "10"]
    assert tables.table_fr(of_rows(sweep[0]), "cpu") == []
    found = of_rows(*paper_rows(), *paper_rows(split="unseen-words", protocol="w"), *classical_rows("unseen-signer"))
    pages = tables.pages(found, "cpu")
    assert [t.label for t in pages["table1"] if t.label.startswith("table1")] == [
        *("table1-cpu-random", "table1-cpu-unseen-words", "table1-cpu-unseen-signer")
    ]
    assert all(len(page) == 0 for page in tables.pages(Results(), "cpu").values())


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
    for page in tables.pages(found, "cpu").values():
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


def test_pages_are_written_and_the_readme_is_filled(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{tables.BEGIN}\nold\n{tables.END}\nafter\n")
    found = of_rows(*paper_rows(), *classical_rows())
    written = {path.name for path in tables.write(found, tmp_path, "cpu")}
    assert written == {
        *("table1.md", "table1.tex", "table3.md", "table3.tex", "classical.md", "classical.tex", "README.md")
    }
    text = readme.read_text()
    assert text.startswith(f"before\n{tables.BEGIN}\n**Table 1 of the paper, scale cpu, random**")
    assert text.endswith(f"{tables.END}\nafter\n")
    assert "old" not in text.splitlines()
    tables.write(found, tmp_path, "cpu")
    assert readme.read_text() == text
    assert tables.write(Results(), tmp_path / "none", "cpu") == []
