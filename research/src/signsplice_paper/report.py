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


def write(found: Results, folder: Path, scale: str, out: Path, day: date) -> None:
    """Write the report of a folder of results to ``out``, dated ``day``. Raises ``InputError`` where its template, its
    figure or a row is missing, ``MissingExtraError`` without Typst.
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
    if not found.rows:
        raise InputError(f"{folder / results.FILE}: no rows, which the report is about")
    text = files["main.typ"].decode("utf-8")
    for name, value in {
        "version": version("signsplice"), "corpus": found.rows[0].corpus, "results": str(results.VERSION),
        "rows": _rows(found, scale), "date": f"datetime(year: {day.year}, month: {day.month}, day: {day.day})",
        "sha256": hashlib.sha256((folder / results.FILE).read_bytes()).hexdigest()[:12],
    }.items():  # fmt: skip
        text = text.replace(f"{{{{{name}}}}}", value)
    files["main.typ"] = pages.fill_template(text, found, scale, folder).encode()
    with tempfile.TemporaryDirectory(prefix="signsplice-report-") as made, replacing(out) as temporary:
        for name, data in files.items():
            Path(made, name).write_bytes(data)
        temporary.write_bytes(typst.compile(Path(made, "main.typ"), format="pdf", ignore_system_fonts=True))


def _rows(found: Results, scale: str) -> str:
    """Rows of a Typst table: the paper's four systems as the paper prints them and by condition. The least and the
    largest of the seeds stand small below their mean.
    """
    rows = []
    for system, by_condition in published.CONDITIONS.items():
        known = dict(zip(published.METRICS, published.TABLE_1[system], strict=True))
        both = (f"{published.ACCURACY}", f"{published.MSE}") if system == published.PRINTED else ("-", "-")
        cells = [known[name] for name in ("BLEU-1", "BLEU-4", "PTA", "PAA")]
        rows.append([published.name(system), tables.PRINTED, *cells, *both])
        for condition, of in by_condition.items():
            one = tables.line(found, scale, of, "random")
            rows.append(["", condition, *(_SPREAD.sub(_BELOW, one.cell(name, digits)) for name, digits in _SCORES)])
    return "\n".join("    " + " ".join(f"[{cell}]," for cell in row) for row in rows)
