"""The pages of tables: a short one as Markdown, all lines and columns as CSV, and LaTeX where asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from signsplice.formats.atomic import replacing
from signsplice_paper import frame_errors, layout, published, tables
from signsplice_paper.extra_metrics import FIRST
from signsplice_paper.layout import Table
from signsplice_paper.protocol import SPLITS
from signsplice_paper.results import FILE, Results

_COMPARED = tuple(published.name(system) for system in (*published.RIVALS, published.PRINTED, published.IMPROVED))
_ABLATIONS = (*published.ABLATIONS, published.PRINTED, *published.IMPROVED_ABLATIONS, published.IMPROVED)
_MEAN = published.name("mean-transition")
OTHER_TRUTH = "word"
"""Subfolder with the results of the other truth: it has the CSV alone, beside the pages and claims of its parent."""


@dataclass(frozen=True)
class _Page:
    """What a page holds.

    - tables: those of a split
    - names: first cells of the lines that the short page shows, None for all
    - heads: its columns, None for all
    - n_tables: how many of the first split's tables it shows, one below the other
    - missing: whether it shows lines without a score
    """

    tables: Callable[[Results, str, str], list[Table]]
    names: tuple[str, ...] | None = None
    heads: tuple[str, ...] | None = None
    n_tables: int = 1
    missing: bool = False


_SPLICING = ("BLEU-1", "BLEU-4", "PTA", "PAA", "Accuracy", "MSE", "ms a pair")
_PAGES = {
    "table1": _Page(tables.table_1, (*_COMPARED, _MEAN), _SPLICING),
    "table2": _Page(lambda results, scale, split: tables.table_2(results, scale) if split == SPLITS[0] else []),
    "treatments": _Page(tables.table_treatments, missing=True),
    "table3": _Page(tables.table_3, tuple(map(published.name, _ABLATIONS)), _SPLICING[1:]),
    "fr": _Page(tables.table_fr, heads=("BLEU-4", "PAA", "Accuracy", "MSE", "ms a pair", "length exact")),
    "classical": _Page(
        tables.table_classical,
        (
            *_COMPARED,
            "pose-velocity+hermite",
            "true-positions+hermite",
            *(name for name, _ in (*tables.CLASSICAL_IN_TABLE_1[:5], *tables.OWN_IN_TABLE_1)),
        ),
        ("Accuracy", "BLEU-4", "error, arm/1000", "velocity error, m/s", *tables.viewed_titles(), "ms, median"),
        n_tables=2,
    ),
    frame_errors.PAGE: _Page(
        frame_errors.table, heads=(f"frames 1 to {FIRST}", *(f"frame {n}" for n in (1, 2, 3, 5, 8)))
    ),
}
PAGES = tuple(_PAGES)


def made(results: Results, scale: str) -> dict[str, list[Table]]:
    """The tables by page, each for every split that was judged; none if there is no row."""
    splits = SPLITS if results.rows else ()
    return {
        name: [
            replace(table, split="" if name == "table2" else split)
            for split in splits
            for table in page.tables(results, scale, split)
        ]
        for name, page in _PAGES.items()
    }


def write(results: Results, folder: Path, scale: str, only: Sequence[str] = PAGES, latex: bool = False) -> list[Path]:
    """Write pages as .md and .csv, and as .tex if ``latex`` says so; the paths written."""
    found = made(results, scale)
    missing = missing_rows(results, scale)
    written = []
    for page in only:
        every = found[page]
        if not every and not (page == "fr" and found["table1"]):  # fr is linked: it says that it has no rows
            continue
        texts = {}
        if not is_of_other_truth(folder):
            texts[".md"] = _short(page, every, scale) + (f"\n\n{missing}\n" if page == PAGES[0] else "\n")
        if every and page != "table2":
            texts[".csv"] = layout.as_csv(every)
        if latex:
            texts[".tex"] = "\n".join(map(layout.latex, every)).rstrip() or _nothing(scale)
            texts[".tex"] += f"\n\n\\par {layout.escape(missing)}\n"
        for suffix, text in texts.items():
            put(folder / f"{page}{suffix}", text)
            written.append(folder / f"{page}{suffix}")
    return written


def _short(page: str, every: Sequence[Table], scale: str) -> str:
    """The page of the first split's main lines and columns."""
    if not every:
        return _nothing(scale)
    shown = [table for table in every if table.split == every[0].split][: _PAGES[page].n_tables]
    of = _PAGES[page]
    shown = [layout.selected(table, of.names, of.heads, of.missing) for table in shown]
    if _PAGES[page].n_tables > 1:  # systems that stand in several tables: with the seeds of the first
        first = {row[0]: row for row in reversed(shown[0].rows)}
        shown[0] = replace(shown[0], rows=tuple(row for row in shown[0].rows if first[row[0]] is row))
    texts = [layout.markdown(replace(table, notes=())).rstrip() for table in shown]
    if page != "table2":
        texts.append(
            f"Test pairs; of several seeds the mean. All lines, columns, ranges and splits: [{page}.csv]({page}.csv)."
        )
    return "\n\n".join([*texts, *layout.paragraphs(shown[0].notes)])


def _nothing(scale: str) -> str:
    return f"No two rows to compare at scale {scale} yet."


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
