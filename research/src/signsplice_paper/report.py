"""The report of the rebuilt paper as PDF, in the form of journals of reproduction, from Typst and results.json."""

from __future__ import annotations

import hashlib
import re
import tempfile
from datetime import date
from importlib.metadata import version
from pathlib import Path

from signsplice.errors import InputError, MissingExtraError
from signsplice.formats.atomic import replacing
from signsplice_paper import pages, published, results, tables
from signsplice_paper.results import Results

_TEMPLATE, _FIGURE = "report.typ", "figure4c.svg"
_SCORES = (("bleu-1", 3), ("bleu-4", 3), ("pta", 3), ("paa", 3), ("accuracy", 3), ("mse", tables.SHORT))
_SPREAD = re.compile(r" \[(.*), (.*)\]$")
_BELOW = r" \\ #text(size: 6pt)[\1 to \2]"


def write(all_results: Results, folder: Path, scale: str, output_file: Path, day: date) -> None:
    """Writes the report of a folder of results to ``output_file``, dated ``day``. Raises ``InputError`` if its
    template, its figure or a row is missing, ``MissingExtraError`` without Typst.
    """
    try:
        import typst
    except ImportError as error:
        raise MissingExtraError("the report needs Typst: pip install 'signsplice-paper[report]'") from error
    files = {}
    for name, path in (
        ("main.typ", folder.resolve().parent / pages.TEMPLATES / _TEMPLATE),
        (_FIGURE, folder / _FIGURE),
    ):
        if not path.is_file():
            raise InputError(f"{path}: not there; the report needs it")
        files[name] = path.read_bytes()
    if not all_results.rows:
        raise InputError(f"{folder / results.FILE}: no rows, which the report is about")
    text = files["main.typ"].decode("utf-8")
    for name, value in {
        "version": version("signsplice"), "corpus": all_results.rows[0].corpus, "results": str(results.VERSION),
        "rows": _format_rows(all_results, scale),
        "date": f"datetime(year: {day.year}, month: {day.month}, day: {day.day})",
        "sha256": hashlib.sha256((folder / results.FILE).read_bytes()).hexdigest()[:12],
    }.items():  # fmt: skip
        text = text.replace(f"{{{{{name}}}}}", value)
    files["main.typ"] = pages.fill_template(text, all_results, scale, folder).encode()
    with tempfile.TemporaryDirectory(prefix="signsplice-report-") as build_folder, replacing(output_file) as temporary:
        for name, data in files.items():
            Path(build_folder, name).write_bytes(data)
        temporary.write_bytes(typst.compile(Path(build_folder, "main.typ"), format="pdf", ignore_system_fonts=True))


def _format_rows(all_results: Results, scale: str) -> str:
    """Returns the rows of a Typst table: the paper's four systems as the paper prints them and by condition. The least
    and the largest of the seeds stand small below their mean.
    """
    rows = []
    for system, by_condition in published.CONDITIONS.items():
        printed = dict(zip(published.METRICS, published.TABLE_1[system], strict=True))
        stated = (f"{published.ACCURACY}", f"{published.MSE}") if system == published.PRINTED else ("-", "-")
        cells = [printed[score] for score in ("BLEU-1", "BLEU-4", "PTA", "PAA")]
        rows.append([published.get_display_name(system), tables.PAPERS_FIGURES, *cells, *stated])
        for condition, name in by_condition.items():
            line = tables.find_line(all_results, scale, name, "random")
            rows.append(
                [
                    "",
                    condition,
                    *(_SPREAD.sub(_BELOW, line.format_cell(score, digits)) for score, digits in _SCORES),
                ]
            )
    return "\n".join("    " + " ".join(f"[{cell}]," for cell in row) for row in rows)
