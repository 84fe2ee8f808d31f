"""The paper's tables 1 to 3 from results.json next to the printed numbers, and tables of what it does not measure.

Every table states its scale, its protocol and its metrics. Rows trained by SGD, as in the paper, and by AdamW are
separate lines. Rows whose signatures differ are refused. What was not trained or not judged is named, not left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from signsplice_paper import bleu, metrics, pair_samples, published
from signsplice_paper.layout import RULE, Table, number
from signsplice_paper.lines import SHORT, TableLine, clip_lines, line, lines, mean_lines, pairs_seen, shared_seeds
from signsplice_paper.results import Results, check_comparable

Columns = Sequence[tuple[str, int | str, str]]
"""(score, digits, title) of every column."""
Block = tuple[str, list[TableLine]]
"""A title and its lines."""

PAPER_COLUMNS: Columns = (
    *((published.SCORES[metric], 3, metric) for metric in published.METRICS),
    ("within_1", 3, "within 1"),
    ("within_2", 3, "within 2"),
    ("accuracy", 3, "Accuracy"),
    ("mse", SHORT, "MSE"),
    ("ms_mean", 2, "ms a pair"),
)
POSITION_COLUMNS: Columns = (
    ("pta", 3, "PTA"),
    ("paa", 3, "PAA"),
    ("paa_all", 3, "PAA of all"),
    ("pta_unbiased", 3, "PTA without bias"),
    ("paa_unbiased", 3, "PAA without bias"),
    ("paa_all_unbiased", 3, "PAA of all without bias"),
    ("within_1", 3, "within 1"),
    ("within_2", 3, "within 2"),
    ("positions_off", 2, "frames off"),
    ("paa_train", 3, "PAA, pairs that taught"),
)
ERROR_COLUMNS: Columns = (
    ("length_exact", 3, "length exact"),
    ("length_ratio", 3, "frames made / true"),
    ("accuracy_equal", 4, "Accuracy, equal lengths"),
    ("mse_equal", SHORT, "MSE, equal lengths"),
    *((f"mse@{cost:g}", SHORT, f"MSE, a frame costs {cost:g}") for cost in metrics.FRAME_COSTS),
    ("accuracy_valid", 3, "Accuracy, validation"),
)
BLEU_COLUMNS = tuple(
    (tuple(f"{kind}-{n}@{t:g}" for t in bleu.TOLERANCES), f"{title} {n}")
    for kind, title in (("bleu", "BLEU"), ("papineni", "Papineni"))
    for n in range(1, bleu.ORDERS + 1)
)
FURTHER_COLUMNS: Columns = (
    ("accuracy", 3, "Accuracy"),
    ("mse", 5, "MSE"),
    ("bleu-4", 3, "BLEU-4"),
    ("positions_off", 2, "frames off"),
    ("within_2", 3, "within 2"),
    ("length_off", 2, "length off"),
    ("length_exact", 3, "exact"),
    ("position_error", 1, "error, arm/1000"),
    ("first_frames_error", 1, "first two frames, cm"),
    ("later_frames_error", 1, "later frames, cm"),
    ("velocity_error", 3, "velocity error, m/s"),
    ("motion_ratio", 2, "motion ratio"),
    ("velocity_error_unlike", 3, "velocity error, unlike words, m/s"),
    ("joint_jumps", 3, "pairs with a joint over 60 degrees in a frame"),
    ("bone_change", 3, "change of finger bones"),
    ("velocity_jump", 2, "velocity jump, m/s"),
    ("jerk_ratio", 2, "jerk ratio"),
    ("ms_median", 2, "ms, median"),
)

PRINTED = "the paper"
"""Where the paper's own lines are from."""
VIEWED = ("velocity_error_unlike", "joint_jumps", "bone_change")
"""Scores of ``viewed``: what the paper's metrics do not see."""

CLASSICAL_IN_TABLE_1 = (
    ("truth", "positions and length"),
    ("commonest-cut+ridge", "nothing"),
    ("mean-cut+ridge", "nothing"),
    ("lpt-positions+ridge", "nothing"),
    ("true-positions+ridge", "positions"),
    ("hand-distance+slerp", "nothing"),
    ("pose-velocity+hermite", "nothing"),
    ("pose-velocity+hermite", "length"),
    ("true-positions+slerp", "positions and length"),
    ("true-positions+hermite", "positions and length"),
)
OWN_IN_TABLE_1 = (
    ("assembled", "nothing"),
    ("true-positions+learned", "positions and length"),
    ("learned-fluent+learned", "nothing"),
    ("signsplice", "nothing"),
)
"""This project's networks as they are; nothing is claimed of them."""


def viewed_titles() -> tuple[str, ...]:
    """The titles of the columns of ``VIEWED``."""
    return tuple(title for name, _, title in FURTHER_COLUMNS if name in VIEWED)


def blocks_1(results: Results, scale: str, split: str) -> list[Block]:
    """The blocks of table 1: the paper's four systems, LPT+, one pass, related work, methods on clips."""
    return [
        ("the paper's systems", lines(results, (*published.RIVALS, published.PRINTED), scale, split)),
        ("LPT+", lines(results, (published.IMPROVED, *published.TAKEN_AWAY), scale, split)),
        ("in one pass", _judged(lines(results, tuple(published.IN_ONE_PASS.values()), scale, split))),
        ("related work, behind the SPSN of LPT+, with its bias", lines(results, published.RELATED, scale, split)),
        ("classical", clip_lines(results, split, CLASSICAL_IN_TABLE_1) + mean_lines(results, split)),
        ("this project", clip_lines(results, split, OWN_IN_TABLE_1)),
    ]


def blocks_3(results: Results, scale: str, split: str) -> list[Block]:
    """The blocks of table 3: the system as printed and its ablations, LPT+ and its own, each with the seeds that all of
    them have.
    """
    blocks: list[Block] = []
    for title, systems in (
        ("as printed", (*published.ABLATIONS, published.PRINTED)),
        ("LPT+", (*published.IMPROVED_ABLATIONS, published.IMPROVED)),
    ):
        blocks.append((title, lines(results, systems, scale, split, shared_seeds(results, systems, scale, split))))
    return [*blocks, ("", mean_lines(results, split))]


def table_1(results: Results, scale: str, split: str = "random") -> list[Table]:
    """Table 1 with the four systems and all others, and what the paper does not measure of them."""
    return _paper_tables(results, 1, blocks_1(results, scale, split), scale, split)


def table_2(results: Results, scale: str) -> list[Table]:
    """Table 2: the parts of every ablation, and what LPT+ adds to the print."""
    yes = {True: "yes", False: "no"}
    parts = {system: (yes[a], yes[c], "none") for system, (a, c) in published.TABLE_2.items()}
    parts |= {
        system.replace(published.PRINTED, published.IMPROVED): (a, c, "all four") for system, (a, c, _) in parts.items()
    }
    less = ("weights of eq. 7 as printed", "frames alone as input", "no summary of both words", "plain cross-entropy")
    parts |= {s: ("yes", "yes", f"all but one: {what}") for s, what in zip(published.TAKEN_AWAY, less, strict=True)}
    rows = []
    for system, cells in parts.items():
        known = line(results, system, scale, "random")
        n = {f"{row.n_parameters:,}" for row in known.rows if row.n_parameters}
        rows.append((published.name(system), *cells, ", ".join(sorted(n)) or "not trained yet"))
    head = ("model", "attention in SPSN", "Culling in TFGN", "additions", "parameters")
    return [Table(f"Table 2 of the paper, scale {scale}", f"table2-{scale}", head, tuple(rows))]


def table_3(results: Results, scale: str, split: str = "random") -> list[Table]:
    """Table 3 with the ablations, and what the paper does not measure of them."""
    return _paper_tables(results, 3, blocks_3(results, scale, split), scale, split)


def swept(results: Results, scale: str, split: str) -> tuple[str, list[TableLine]]:
    """The system with several values of fr, the printed one or LPT+, whose TFGN is the same; and its lines, with the
    seeds that all of them have.
    """
    for system in (published.PRINTED, published.IMPROVED):
        rows = results.find(system=system, scale=scale, split=split, optimiser="adamw", part="test")
        values = sorted({row.fr for row in rows if row.fr is not None})
        if len(values) > 1:
            seeds = shared_seeds(results, [system], scale, split, frs=values)
            return system, [line(results, system, scale, split, fr=fr, seeds=seeds) for fr in values]
    return published.PRINTED, []


def table_fr(results: Results, scale: str, split: str = "random") -> list[Table]:
    """LpTransformer by fr, the number of frames that Culling keeps on each side."""
    system, found = swept(results, scale, split)
    if not found:
        return []
    shown = ("accuracy", "bleu-1", "bleu-4", "paa", "mse", "mse_equal", "length_exact", "ms_mean")
    columns: Columns = [column for column in (*PAPER_COLUMNS, *ERROR_COLUMNS) if column[0] in shown]
    by_fr = [TableLine(f"{one.rows[0].fr}", one.origin, one.rows, one.trained) for one in found]
    caption = f"fr of {published.name(system)}, scale {scale}, {split}; the paper chose {published.BEST_FR}"
    return [_table(results, caption, f"fr-{scale}-{split}", columns, [("", by_fr)], first="fr")]


def table_treatments(results: Results, scale: str, split: str = "random") -> list[Table]:
    """The paper's four systems: as printed in the paper, and as judged here by what their tokens were given."""
    blocks: list[Block] = []
    for system, by_treatment in published.TREATED.items():
        made = [(treatment, line(results, of, scale, split)) for treatment, of in by_treatment.items()]
        named = [replace(one, name=published.name(system), origin=f"{t}: {one.origin}") for t, one in made]
        blocks.append(("", named))
    if not any(one.rows for _, made in blocks for one in made):
        return []
    columns: Columns = [
        *(column for column in PAPER_COLUMNS if column[0] not in ("within_1", "within_2", "ms_mean")),
        *(column for column in FURTHER_COLUMNS if column[0] in VIEWED),
    ]
    printed = [(*row[:-1], *("-" for _ in VIEWED)) for row in _printed(published.TABLE_1)]
    printed = [(*row[:8], *row[10:]) for row in printed]
    caption = f"Like with like: four systems by treatment, scale {scale}, {split}"
    return [_table(results, caption, f"treatments-{scale}-{split}", columns, blocks, printed)]


def table_classical(results: Results, scale: str, split: str = "random") -> list[Table]:
    """Metrics beyond the paper's of every trained system and of every method on clips."""
    trained = [
        one for _, made in (*blocks_1(results, scale, split)[:4], *blocks_3(results, scale, split)[:2]) for one in made
    ]
    trained = list({(one.name, one.origin): one for one in _judged(trained)}.values())
    found = clip_lines(results, split)
    out = []
    for title, label, made in (
        (f"Further metrics, scale {scale}, {split}", f"extra-{scale}-{split}", trained),
        (f"Methods on clips, {split}", f"classical-{split}", found),
    ):
        if made:
            out.append(_table(results, title, label, FURTHER_COLUMNS, [("", made)]))
    return out


def _paper_tables(results: Results, n: int, blocks: list[Block], scale: str, split: str) -> list[Table]:
    every = [one for _, made in blocks for one in made]
    if not any(one.rows for one in every):
        return []
    of = f"scale {scale}, {split}"
    printed = published.TABLE_1 if n == 1 else published.TABLE_3
    mine = f"{n}-{scale}-{split}"
    tables = [
        _table(results, f"Table {n} of the paper, {of}", f"table{mine}", PAPER_COLUMNS, blocks, _printed(printed)),
        _table(results, f"Positions, {of}", f"positions{mine}", POSITION_COLUMNS, blocks),
        _bleu_table(results, f"BLEU at three tolerances, {of}", f"bleu{mine}", blocks),
        _table(results, f"Lengths and errors, {of}", f"errors{mine}", ERROR_COLUMNS, blocks),
    ]
    if any(row.score("n_margin_1") > 0 for one in every for row in one.rows):
        tables.append(_margin_table(results, f"PAA by distance from another cut, {of}", f"margins{mine}", blocks))
    return [*tables, _rows_table(results, f"Rows of these tables, {of}", f"rows{mine}", blocks)]


def _printed(table: Mapping[str, tuple[str, ...]]) -> list[tuple[str, ...]]:
    """The rows as the paper prints them."""
    rows = []
    for system, values in table.items():
        of_lpt = (f"{published.ACCURACY:.2f}", f"{published.MSE:.4f}") if system == published.PRINTED else ("-", "-")
        rows.append((published.name(system), PRINTED, *values, "-", "-", *of_lpt, "-"))
    return rows


def _table(
    results: Results,
    caption: str,
    label: str,
    columns: Columns,
    blocks: Sequence[Block],
    before: Iterable[tuple[str, ...]] = (),
    first: str = "system",
) -> Table:
    rows = [*before, *_body(blocks, lambda one: tuple(one.cell(name, digits) for name, digits, _ in columns))]
    head = (first, "from", *(title for _, _, title in columns))
    return Table(caption, label, head, tuple(rows), _notes(results, blocks))


def _body(blocks: Sequence[Block], cells: Callable[[TableLine], tuple[str, ...]]) -> list[tuple[str, ...]]:
    """The rows of blocks; each block begins with a rule, and with its title where it has one."""
    rows: list[tuple[str, ...]] = []
    for title, made in blocks:
        if made:
            width = len(cells(made[0]))
            rows += [RULE, (f"{title}:", *("",) * (width + 1))] if title else [RULE]
            rows += [(one.name, one.origin, *cells(one)) for one in made]
    return rows


def _bleu_table(results: Results, caption: str, label: str, blocks: Sequence[Block]) -> Table:
    def cells(one: TableLine) -> tuple[str, ...]:
        return tuple(" / ".join(number(one.score(name)) for name in names) for names, _ in BLEU_COLUMNS)

    notes = (
        f"Two frames are equal up to {' / '.join(f'{t:g}' for t in bleu.TOLERANCES)}. BLEU is the paper's, the share "
        "of predicted n-grams that are found in the truth; Papineni's has clipping, the geometric mean and the brevity "
        "penalty.",
        *_notes(results, blocks),
    )
    head = ("system", "from", *(title for _, title in BLEU_COLUMNS))
    return Table(caption, label, head, tuple(_body(blocks, cells)), notes)


def _margin_table(results: Results, caption: str, label: str, blocks: Sequence[Block]) -> Table:
    columns: Columns = [(f"paa_margin_{n}", 3, name) for n, name in enumerate(pair_samples.margin_names(), 1)]
    kept = [(title, [one for one in made if one.values("paa_margin_1")]) for title, made in blocks]
    table = _table(results, caption, label, columns, kept)
    first = next(row for _, made in blocks for one in made for row in one.rows if row.score("n_margin_1") > 0)
    counts = [first.score(f"n_margin_{n}") for n in range(1, len(columns) + 1)]
    note = (
        "The rules of the truth give times between frames, which are rounded to frames. Columns: by how many frames "
        "the nearer of both cuts would have to move to become another frame. Pairs in each: "
        f"{', '.join(number(count, 0) for count in counts)}."
    )
    return replace(table, notes=(note, *table.notes))


def _rows_table(results: Results, caption: str, label: str, blocks: Sequence[Block]) -> Table:
    def cells(one: TableLine) -> tuple[str, ...]:
        rows = one.rows
        values = (
            [one.seeds],
            [f"{row.steps}" for row in rows if row.steps is not None],
            [f"{seen:,.0f}" for row in rows if (seen := pairs_seen(results, row))],
            [f"{row.n_parameters:,}" for row in rows if row.n_parameters],
            [f"{row.fr}" for row in rows if row.fr is not None],
            [number(row.token_bias, 2) for row in rows if row.token_bias is not None],
            [row.bundle for row in rows if row.bundle],
            [row.commit for row in rows],
            [f"{row.n_pairs}" for row in rows],
        )
        return tuple(", ".join(dict.fromkeys(found)) or "-" for found in values)

    titles = ("seeds", "steps", "pairs seen", "parameters", "fr", "token bias", "bundle", "judged at commit", "pairs")
    head = ("system", "from", *titles)
    kept = [(title, [one for one in made if one.rows]) for title, made in blocks]
    return Table(caption, label, head, tuple(_body(kept, cells)), _notes(results, blocks))


def _judged(found: Iterable[TableLine]) -> list[TableLine]:
    """The lines with rows."""
    return [one for one in found if one.rows]


def _notes(results: Results, blocks: Sequence[Block]) -> tuple[str, ...]:
    rows = [row for _, made in blocks for one in made for row in one.rows]
    check_comparable(rows)
    first = rows[0]
    signatures = results.signatures.get(first.metrics_id, {})
    recipes = "; ".join(f"`{signatures[name]}`" for name in ("accuracy", "mse", "bleu", "paa") if name in signatures)
    notes = [
        f"Judged by `{first.protocol}`; truth {first.truth or 'unknown'}.",
        f"Metrics `{first.metrics_id}`: {recipes}.",
    ]
    machines = sorted({row.machine for row in rows})
    if len(machines) > 1:
        notes.append(f"Times are of {len(machines)} machines and cannot be compared: {'; '.join(machines)}.")
    else:
        notes.append(f"Times: {machines[0]}.")
    return tuple(notes)
