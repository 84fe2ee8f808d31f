"""The tables as pages: the main lines and columns on one Markdown page, all of them as CSV, and LaTeX where asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from signsplice.formats.atomic import replacing
from signsplice_paper import frame_errors, layout, published, tables
from signsplice_paper.layout import Table
from signsplice_paper.protocol import SPLITS
from signsplice_paper.results import FILE, Results

_COMPARED = tuple(published.name(system) for system in (*published.RIVALS, published.PRINTED, published.IMPROVED))
_ABLATIONS = (*published.ABLATIONS, published.PRINTED, *published.IMPROVED_ABLATIONS, published.IMPROVED)
_MEAN = published.name("mean-transition")
OTHER_TRUTH = "word"
"""Subfolder with the results of the other truth: it has the CSV alone, beside the pages and claims of its parent."""
PAGE = "tables.md"


@dataclass(frozen=True)
class _Group:
    """Tables of one CSV, and what of them stands on the page.

    - tables: those of a split
    - names: first cells of the lines that the page shows, None for all
    - heads: its columns, None for all
    - n_tables: how many of the first split's tables it shows
    """

    tables: Callable[[Results, str, str], list[Table]]
    names: tuple[str, ...] | None = None
    heads: tuple[str, ...] | None = None
    n_tables: int = 1


_SPLICING = ("BLEU-1", "BLEU-4", "PTA", "PAA", "Accuracy", "MSE", "ms a pair")
_TABLE_2 = "table2"
_METHODS = (
    *("truth", "assembled", "signsplice", "learned-fluent+learned", "pose-velocity+hermite", "true-positions+hermite"),
    *("commonest-cut+ridge", "lpt-positions+ridge", "true-positions+ridge"),
)
_GROUPS = {
    "table1": _Group(tables.table_1, (*_COMPARED, _MEAN), _SPLICING),
    _TABLE_2: _Group(
        lambda results, scale, split: tables.table_2(results, scale) if split == SPLITS[0] else [], n_tables=0
    ),
    "treatments": _Group(tables.table_treatments, n_tables=0),
    "table3": _Group(tables.table_3, tuple(map(published.name, _ABLATIONS)), _SPLICING[1:]),
    "fr": _Group(tables.table_fr, n_tables=0),
    "classical": _Group(
        tables.table_classical,
        (*_COMPARED, *_METHODS),
        ("Accuracy", "BLEU-4", *tables.viewed_titles()),
        n_tables=2,
    ),
    frame_errors.PAGE: _Group(frame_errors.table, n_tables=0),
}


def made(results: Results, scale: str) -> dict[str, list[Table]]:
    """The tables by CSV, each for every split that was judged; none if there is no row."""
    splits = SPLITS if results.rows else ()
    return {
        name: [
            replace(table, split="" if name == _TABLE_2 else split)
            for split in splits
            for table in group.tables(results, scale, split)
        ]
        for name, group in _GROUPS.items()
    }


def write(results: Results, folder: Path, scale: str, latex: bool = False) -> list[Path]:
    """Write the page and the CSVs, and ``.tex`` files if ``latex`` says so; the paths written."""
    found = {name: every for name, every in made(results, scale).items() if every}
    missing = missing_rows(results, scale)
    texts = {f"{name}.csv": layout.as_csv(every) for name, every in found.items()}
    if found and not is_of_other_truth(folder):
        texts[PAGE] = _page(found, missing)
    if latex:
        note = f"\n\n\\par {layout.escape(missing)}\n"
        texts |= {f"{name}.tex": "\n".join(map(layout.latex, every)).rstrip() + note for name, every in found.items()}
    for name, text in texts.items():
        put(folder / name, text)
    return [folder / name for name in texts]


def _page(found: dict[str, list[Table]], missing: str) -> str:
    """The main lines and columns of the first split of all tables; what they were judged by stands once at the end."""
    texts = [
        "# Tables",
        "Test pairs; of several seeds the mean. All lines, columns, ranges and splits: "
        + ", ".join(f"[{name}.csv]({name}.csv)" for name in found)
        + ".",
    ]
    for name, every in found.items():
        group = _GROUPS[name]
        shown = [
            layout.selected(table, group.names, group.heads)
            for table in [table for table in every if table.split == every[0].split][: group.n_tables]
        ]
        if name == "table1":  # the paper's own lines stand beside the treatments
            shown = [replace(one, rows=tuple(row for row in one.rows if row[1] != tables.PRINTED)) for one in shown]
        if group.n_tables > 1:  # systems that stand in several tables: with the seeds of the first
            first = {row[0]: row for row in reversed(shown[0].rows)}
            shown[0] = replace(shown[0], rows=tuple(row for row in shown[0].rows if first[row[0]] is row))
        for table in shown:
            body = layout.markdown(replace(table, notes=()))
            texts.append(body.replace(f"**{table.caption}**", f"## {table.caption}", 1).rstrip())
    judged = next((every[0].notes for every in found.values() if every[0].split), ())
    return "\n\n".join([*texts, "## How they were judged", *layout.paragraphs((*judged, missing))]) + "\n"


def is_of_other_truth(folder: Path) -> bool:
    """Whether a folder of results is the subfolder of the other truth."""
    whole = folder.resolve()
    return whole.name == OTHER_TRUTH and (whole.parent / FILE).exists()


def missing_rows(results: Results, scale: str) -> str:
    """What has no row at all, in a sentence."""
    judged = {row.split for row in results.rows}
    missing = [f"split {split}" for split in SPLITS if split not in judged]
    missing += [f"scale {other}" for other in ("cpu", "paper") if not results.find(scale=other)]
    return f"Without any row yet: {', '.join(missing)}." if missing else "Every split and scale has rows."


def put(path: Path, text: str) -> None:
    """Write a text atomically."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
