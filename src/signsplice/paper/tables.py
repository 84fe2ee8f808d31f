"""The paper's tables 1 and 3 from results.json, beside the paper's own numbers; what follows its order is said.

Every table names its scale, its protocol and how its BLEU was counted. Rows trained by SGD, as the paper did, and by
AdamW stand apart. A table of rows whose signatures differ is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from signsplice.formats.atomic import read_bytes, replacing
from signsplice.paper import layout, order, published
from signsplice.paper.layout import RULE, Table, number, short
from signsplice.paper.protocol import SPLITS
from signsplice.paper.results import CLASSICAL, ON_CLIPS, OWN, TAUGHT, ResultRow, Results, check_alike

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
"""Methods on clips that stand in table 1: the traditional ones that the paper names, what they could be at best, and
this project's networks.
"""
BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"
PAGES = ("table1", "table3", "fr", "classical")


def pick(results: Results, scale: str, split: str, optimiser: str, systems: Iterable[str]) -> dict[str, ResultRow]:
    """Rows by system for a table: fr as the paper chose it, the lowest seed where there are several."""
    found: dict[str, ResultRow] = {}
    for system in systems:
        rows = results.find(system=system, scale=scale, split=split, optimiser=optimiser, part="test")
        rows = [row for row in rows if row.fr in (None, published.BEST_FR)]
        if rows:
            found[system] = min(rows, key=lambda row: row.seed or 0)
    return found


def table_1(results: Results, scale: str, split: str = "random") -> list[Table]:
    """Table 1, the four systems, the others and methods on clips; and the paper's claims about it."""
    found = {o: pick(results, scale, split, o, published.TABLE_1) for o in OPTIMISERS}
    beyond = (*published.OTHERS, *published.IN_ONE_PASS.values())
    others = [row for o in OPTIMISERS for row in pick(results, scale, split, o, beyond).values()]
    on_clips = [row for key in IN_TABLE_1 for row in _on_clips(results, split, *key)]
    return _paper_tables(results, 1, published.TABLE_1, found, (others, on_clips), scale, split, order.claims_1)


def table_3(results: Results, scale: str, split: str = "random") -> list[Table]:
    """Table 3, the ablations; and the paper's claims about it."""
    found = {o: pick(results, scale, split, o, published.TABLE_3) for o in OPTIMISERS}
    return _paper_tables(results, 3, published.TABLE_3, found, (), scale, split, order.claims_3)


def table_fr(results: Results, scale: str, split: str = "random") -> list[Table]:
    """What fr, the frames kept by the culling layer on either side, does to LpTransformer."""
    tables = []
    for optimiser, told in OPTIMISERS.items():
        rows = results.find(system="lpt", scale=scale, split=split, optimiser=optimiser, part="test")
        by_fr = {row.fr: row for row in sorted(rows, key=lambda row: -(row.seed or 0)) if row.fr is not None}
        if len(by_fr) < 2:
            continue
        chosen = [by_fr[fr] for fr in sorted(by_fr)]
        check_alike(chosen)
        cells = [
            (
                *(str(row.fr), _given(row)),
                *(number(row.score(s)) for s in ("accuracy", "bleu-1", "bleu-4", "paa")),
                *(short(row.score("mse")), number(row.score("ms_mean"), 2)),
            )
            for row in chosen
        ]
        head = ("fr", "from", "Accuracy", "BLEU-1", "BLEU-4", "PAA", "MSE", "ms a pair")
        caption = f"fr of LpTransformer, {told}, scale {scale}, {split}; the paper chose {published.BEST_FR}"
        tables.append(Table(caption, f"fr-{optimiser}-{scale}-{split}", head, tuple(cells), _notes(results, chosen)))
    return tables


def table_classical(results: Results, split: str = "random") -> list[Table]:
    """Every method on clips, with what the paper does not measure."""
    rows = [row for scale in ON_CLIPS for row in results.find(scale=scale, split=split, part="test")]
    if not rows:
        return []
    check_alike(rows)
    told = {"nothing": 0, "length": 1, "positions": 2, "positions and length": 3}
    rows.sort(key=lambda row: (told.get(row.given, 4), row.system))
    return [_extra_metrics(results, rows, f"Methods on clips, {split}", f"classical-{split}")]


def table_extra_metrics(results: Results, scale: str, split: str = "random") -> list[Table]:
    """What the paper does not measure, of every trained row."""
    systems = (*published.TABLE_1, *published.TABLE_3, *published.OTHERS, *published.IN_ONE_PASS.values())
    rows = [row for o in OPTIMISERS for row in pick(results, scale, split, o, dict.fromkeys(systems)).values()]
    if not rows:
        return []
    check_alike(rows)
    return [
        _extra_metrics(results, rows, f"Beside the paper's measures, scale {scale}, {split}", f"beside-{scale}-{split}")
    ]


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
    check_alike(measured)
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
    said = [
        (claim.claim, OPTIMISERS[optimiser], claim.printed, claim.measured, "yes" if claim.holds else "no")
        for optimiser, by in found.items()
        for claim in claims(by)
    ]
    if said:
        head = ("the paper says", "trained by", "paper", "measured", "holds")
        caption = f"What the paper says beside table {n}, scale {scale}, {split}"
        tables.append(Table(caption, f"claims{n}-{scale}-{split}", head, tuple(said)))
    return tables


def _row(row: ResultRow) -> tuple[str, ...]:
    scores = [number(row.score(published.SCORES[metric])) for metric in published.METRICS]
    more = (number(row.score("paa_all")), number(row.score("accuracy")), short(row.score("mse")))
    return (published.name(row.system), _given(row), *scores, *more, number(row.score("ms_mean"), 2))


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
        (published.name(row.system), _given(row), *(number(row.score(name), digits) for name, digits, _ in columns))
        for row in rows
    ]
    return Table(
        caption, label, ("system", "from", *(title for _, _, title in columns)), tuple(cells), _notes(results, rows)
    )


def _given(row: ResultRow) -> str:
    if row.scale == CLASSICAL:
        return f"classical, told {row.given}"
    if row.scale == OWN:
        return f"signsplice, told {row.given}"
    if row.scale == TAUGHT:
        return f"signsplice, taught its training part, told {row.given}"
    steps = f", {row.steps} steps" if row.steps is not None else ""
    return OPTIMISERS.get(row.optimiser, row.optimiser) + steps


def _on_clips(results: Results, split: str, system: str, told: str) -> list[ResultRow]:
    rows = results.find(system=system, told=told, split=split, part="test")
    return [row for row in rows if row.scale in ON_CLIPS]


def _notes(results: Results, rows: Sequence[ResultRow]) -> tuple[str, ...]:
    told = results.signatures.get(rows[0].measures, {})
    recipes = "; ".join(f"`{told[name]}`" for name in ("accuracy", "mse", "bleu") if name in told)
    notes = [f"Judged by `{rows[0].protocol}`.", f"Measures `{rows[0].measures}`: {recipes}."]
    machines = sorted({row.machine for row in rows})
    if len(machines) > 1:
        notes.append(f"Times are of {len(machines)} machines and not to be compared: {'; '.join(machines)}.")
    else:
        notes.append(f"Times: {machines[0]}.")
    return tuple(notes)


def pages(results: Results, scale: str) -> dict[str, list[Table]]:
    """All tables by page: table1, table3, fr, classical; each for every split that was judged."""
    out: dict[str, list[Table]] = {page: [] for page in PAGES}
    for split in SPLITS:
        out["table1"] += table_1(results, scale, split)
        out["table3"] += table_3(results, scale, split)
        out["fr"] += table_fr(results, scale, split)
        out["classical"] += table_extra_metrics(results, scale, split) + table_classical(results, split)
    return out


def write(results: Results, folder: Path, scale: str, only: Sequence[str] = PAGES) -> list[Path]:
    """Write pages of tables, each as .md and .tex, and put tables 1 and 3 between the marks of a README.md that has
    them; the paths written.
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
