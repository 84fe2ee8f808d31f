"""The paper's tables 1 and 3 from results.json next to the printed numbers, and whether the paper's order holds.

Every table states its scale, its protocol and how its BLEU was counted. Rows trained by SGD, as in the paper, and by
AdamW are separate. Rows whose signatures differ are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from signsplice.formats.atomic import replacing
from signsplice.formats.reading import read_bytes
from signsplice.paper import layout, order, published
from signsplice.paper.layout import RULE, Table, number, short
from signsplice.paper.protocol import SPLITS
from signsplice.paper.results import (
    CLASSICAL,
    CLIP_SCALES,
    CORPUS_TRAINED,
    GIVEN,
    SHIPPED,
    ResultRow,
    Results,
    check_comparable,
)

OPTIMISERS = {"adamw": "AdamW", "sgd": "SGD"}
HEAD = ("system", "from", *published.METRICS, "PAA of all", "Accuracy", "MSE", "ms a pair")
IN_TABLE_1 = (
    ("hand-distance+slerp", "nothing"),
    ("pose-velocity+hermite", "nothing"),
    ("pose-velocity+hermite", "length"),
    ("true-positions+slerp", "positions and length"),
    ("true-positions+hermite", "positions and length"),
    ("true-positions+learned", "positions and length"),
    ("learned-fluent+learned", "nothing"),
)
"""Methods on clips in table 1: the traditional ones that the paper names, the same with true positions or lengths, and
this project's networks.
"""
BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"
PAGES = ("table1", "table3", "fr", "classical")


def pick(results: Results, scale: str, split: str, optimiser: str, systems: Iterable[str]) -> dict[str, ResultRow]:
    """One row per system for a table: with the paper's fr, and the lowest seed if there are several."""
    found: dict[str, ResultRow] = {}
    for system in systems:
        rows = results.find(system=system, scale=scale, split=split, optimiser=optimiser, part="test")
        rows = [row for row in rows if row.fr in (None, published.BEST_FR)]
        if rows:
            found[system] = min(rows, key=lambda row: row.seed or 0)
    return found


def table_1(results: Results, scale: str, split: str = "random") -> list[Table]:
    """Table 1 with the four systems, the others and methods on clips, and a table of the paper's claims about it."""
    found = {o: pick(results, scale, split, o, published.TABLE_1) for o in OPTIMISERS}
    unpublished = (*published.OTHERS, *published.IN_ONE_PASS.values())
    others = [row for o in OPTIMISERS for row in pick(results, scale, split, o, unpublished).values()]
    on_clips = [row for key in IN_TABLE_1 for row in _on_clips(results, split, *key)]
    return _paper_tables(results, 1, published.TABLE_1, found, (others, on_clips), scale, split, order.claims_1)


def table_3(results: Results, scale: str, split: str = "random") -> list[Table]:
    """Table 3 with the ablations, and a table of the paper's claims about it."""
    found = {o: pick(results, scale, split, o, published.TABLE_3) for o in OPTIMISERS}
    return _paper_tables(results, 3, published.TABLE_3, found, (), scale, split, order.claims_3)


def table_fr(results: Results, scale: str, split: str = "random") -> list[Table]:
    """LpTransformer by fr, the number of frames that Culling keeps on each side."""
    tables = []
    for optimiser, optimiser_name in OPTIMISERS.items():
        rows = results.find(system="lpt", scale=scale, split=split, optimiser=optimiser, part="test")
        by_fr = {row.fr: row for row in sorted(rows, key=lambda row: -(row.seed or 0)) if row.fr is not None}
        if len(by_fr) < 2:
            continue
        chosen = [by_fr[fr] for fr in sorted(by_fr)]
        check_comparable(chosen)
        cells = [
            (
                *(str(row.fr), _origin(row)),
                *(number(row.score(s)) for s in ("accuracy", "bleu-1", "bleu-4", "paa")),
                *(short(row.score("mse")), number(row.score("ms_mean"), 2)),
            )
            for row in chosen
        ]
        head = ("fr", "from", "Accuracy", "BLEU-1", "BLEU-4", "PAA", "MSE", "ms a pair")
        caption = f"fr of LpTransformer, {optimiser_name}, scale {scale}, {split}; the paper chose {published.BEST_FR}"
        tables.append(Table(caption, f"fr-{optimiser}-{scale}-{split}", head, tuple(cells), _notes(results, chosen)))
    return tables


def table_classical(results: Results, split: str = "random") -> list[Table]:
    """Every method on clips, with metrics beyond the paper's."""
    rows = [row for scale in CLIP_SCALES for row in results.find(scale=scale, split=split, part="test")]
    if not rows:
        return []
    check_comparable(rows)
    rows.sort(key=lambda row: (GIVEN.index(row.given) if row.given in GIVEN else len(GIVEN), row.system))
    return [_extra_metrics(results, rows, f"Methods on clips, {split}", f"classical-{split}")]


def table_extra_metrics(results: Results, scale: str, split: str = "random") -> list[Table]:
    """Metrics beyond the paper's for every trained row."""
    systems = (*published.TABLE_1, *published.TABLE_3, *published.OTHERS, *published.IN_ONE_PASS.values())
    rows = [row for o in OPTIMISERS for row in pick(results, scale, split, o, dict.fromkeys(systems)).values()]
    if not rows:
        return []
    check_comparable(rows)
    return [_extra_metrics(results, rows, f"Further metrics, scale {scale}, {split}", f"extra-{scale}-{split}")]


def _paper_tables(
    results: Results,
    n: int,
    printed: Mapping[str, tuple[str, ...]],
    found: Mapping[str, Mapping[str, ResultRow]],
    more: Sequence[Sequence[ResultRow]],
    scale: str,
    split: str,
    claims: Callable[[Mapping[str, ResultRow]], list[order.Claim]],
) -> list[Table]:
    measured = [row for rows in found.values() for row in rows.values()] + [row for rows in more for row in rows]
    if not measured:
        return []
    check_comparable(measured)
    rows: list[tuple[str, ...]] = []
    for system, values in printed.items():
        of_lpt = (f"{published.ACCURACY:.2f}", f"{published.MSE:.4f}") if system == "lpt" else ("-", "-")
        rows.append((published.name(system), "the paper", *values, "-", *of_lpt, "-"))
        rows += [_row(by[system]) for by in found.values() if system in by]
    for block in more:
        rows += [RULE, *map(_row, block)] if block else []
    rows.append(RULE)
    for optimiser, by in found.items():
        if len(by) > 1:
            verdicts = [order.of_metric(printed, metric, by).verdict for metric in published.METRICS]
            rows.append(("follows the paper's order", OPTIMISERS[optimiser], *verdicts, "", "", "", ""))
    caption = f"Table {n} of the paper, scale {scale}, {split}"
    tables = [Table(caption, f"table{n}-{scale}-{split}", HEAD, tuple(rows), _notes(results, measured))]
    judged_claims = [
        (claim.claim, OPTIMISERS[optimiser], claim.printed, claim.measured, "yes" if claim.holds else "no")
        for optimiser, by in found.items()
        for claim in claims(by)
    ]
    if judged_claims:
        head = ("claim of the paper", "trained by", "paper", "measured", "holds")
        caption = f"Claims of the paper's text about table {n}, scale {scale}, {split}"
        tables.append(Table(caption, f"claims{n}-{scale}-{split}", head, tuple(judged_claims)))
    return tables


def _row(row: ResultRow) -> tuple[str, ...]:
    scores = [number(row.score(published.SCORES[metric])) for metric in published.METRICS]
    more = (number(row.score("paa_all")), number(row.score("accuracy")), short(row.score("mse")))
    return (published.name(row.system), _origin(row), *scores, *more, number(row.score("ms_mean"), 2))


def _extra_metrics(results: Results, rows: Sequence[ResultRow], caption: str, label: str) -> Table:
    columns = (
        ("accuracy", 3, "Accuracy"),
        ("mse", 5, "MSE"),
        ("bleu-4@2e-05", 3, "BLEU-4 at 2e-5"),
        ("bleu-4@5e-05", 3, "at 5e-5"),
        ("bleu-4@0.0001", 3, "at 1e-4"),
        ("bleu-4@0.0003", 3, "at 3e-4"),
        ("positions_off", 2, "frames off"),
        ("within_2", 3, "within 2"),
        ("length_off", 2, "length off"),
        ("length_exact", 3, "exact"),
        ("position_error", 1, "error, arm/1000"),
        ("motion_ratio", 2, "motion ratio"),
        ("velocity_jump", 2, "velocity jump, m/s"),
        ("jerk_ratio", 2, "jerk ratio"),
        ("ms_median", 2, "ms, median"),
    )
    cells = [
        (published.name(row.system), _origin(row), *(number(row.score(name), digits) for name, digits, _ in columns))
        for row in rows
    ]
    return Table(
        caption, label, ("system", "from", *(title for _, _, title in columns)), tuple(cells), _notes(results, rows)
    )


def _origin(row: ResultRow) -> str:
    """The cell that states how a row's system was trained, or what its method was given."""
    if row.scale == CLASSICAL:
        return f"classical, given {row.given}"
    if row.scale == SHIPPED:
        return f"signsplice, given {row.given}"
    if row.scale == CORPUS_TRAINED:
        return f"signsplice, trained on the split, given {row.given}"
    steps = f", {row.steps} steps" if row.steps is not None else ""
    return OPTIMISERS.get(row.optimiser, row.optimiser) + steps


def _on_clips(results: Results, split: str, system: str, given: str) -> list[ResultRow]:
    rows = results.find(system=system, given=given, split=split, part="test")
    return [row for row in rows if row.scale in CLIP_SCALES]


def _notes(results: Results, rows: Sequence[ResultRow]) -> tuple[str, ...]:
    signatures = results.signatures.get(rows[0].metrics_id, {})
    recipes = "; ".join(f"`{signatures[name]}`" for name in ("accuracy", "mse", "bleu") if name in signatures)
    notes = [f"Judged by `{rows[0].protocol}`.", f"Metrics `{rows[0].metrics_id}`: {recipes}."]
    machines = sorted({row.machine for row in rows})
    if len(machines) > 1:
        notes.append(f"Times are of {len(machines)} machines and cannot be compared: {'; '.join(machines)}.")
    else:
        notes.append(f"Times: {machines[0]}.")
    return tuple(notes)


def pages(results: Results, scale: str) -> dict[str, list[Table]]:
    """The tables by page (table1, table3, fr, classical), each for every split that was judged."""
    out: dict[str, list[Table]] = {page: [] for page in PAGES}
    for split in SPLITS:
        out["table1"] += table_1(results, scale, split)
        out["table3"] += table_3(results, scale, split)
        out["fr"] += table_fr(results, scale, split)
        out["classical"] += table_extra_metrics(results, scale, split) + table_classical(results, split)
    return out


def write(results: Results, folder: Path, scale: str, only: Sequence[str] = PAGES) -> list[Path]:
    """Write pages of tables as .md and .tex, and the tables of table1, table3 and fr between the marks of README.md if
    the folder has one; the paths written.
    """
    made = pages(results, scale)
    written = []
    for page in only:
        if made[page]:
            for suffix, form in ((".md", layout.markdown), (".tex", layout.latex)):
                path = folder / f"{page}{suffix}"
                _put(path, "\n".join(form(table) for table in made[page]).rstrip() + "\n")
                written.append(path)
    readme = folder / "README.md"
    if readme.is_file():
        text = read_bytes(readme).decode("utf-8")
        if BEGIN in text and END in text:
            tables = "\n".join(layout.markdown(table) for page in ("table1", "table3", "fr") for table in made[page])
            before, after = text.split(BEGIN)[0], text.split(END, 1)[1]
            _put(readme, f"{before}{BEGIN}\n{tables}{END}{after}")
            written.append(readme)
    return written


def _put(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
