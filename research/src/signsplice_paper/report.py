"""The report of the rebuilt paper as PDF, in the form of journals of reproduction, from Typst and results.json."""

from __future__ import annotations

import re
import tempfile
from importlib.metadata import version
from pathlib import Path

from signsplice.errors import InputError, MissingExtraError
from signsplice.formats.atomic import replacing
from signsplice_paper import page_template, results, treatments
from signsplice_paper.results import Results

_TEMPLATE = "report.typ"
_SPREAD = re.compile(r" \[(.*), (.*)\]$")
_BELOW = r" \\ #text(size: 6pt)[\1 to \2]"


def write(found: Results, folder: Path, scale: str, out: Path) -> None:
    """Write the report of a folder of results to ``out``. Raises ``InputError`` where its template, its figure or a row
    is missing, ``MissingExtraError`` without Typst.
    """
    try:
        import typst
    except ImportError as error:
        raise MissingExtraError("the report needs Typst: pip install 'signsplice-paper[report]'") from error
    figure = f"{treatments.NAME}.svg"
    files = {}
    for name, path in (
        ("main.typ", folder.resolve().parent / page_template.TEMPLATES / _TEMPLATE),
        (figure, folder / figure),
    ):
        if not path.is_file():
            raise InputError(f"{path}: not there; the report needs it")
        files[name] = path.read_bytes()
    known = page_template.by_truth(found, folder)
    partner = known.get("partner")
    if partner is None:
        raise InputError(f"{folder / results.FILE}: no rows of partner truth, which the report is about")
    text = files["main.typ"].decode("utf-8")
    text = text.replace("{{version}}", version("signsplice")).replace("{{treatments}}", _treatments(partner, scale))
    files["main.typ"] = page_template.filled(text, known, scale).encode()
    with tempfile.TemporaryDirectory(prefix="signsplice-report-") as made, replacing(out) as temporary:
        for name, data in files.items():
            Path(made, name).write_bytes(data)
        temporary.write_bytes(typst.compile(Path(made, "main.typ"), format="pdf", ignore_system_fonts=True))


def _treatments(partner: Results, scale: str) -> str:
    """Rows of a Typst table; the least and the largest of the seeds stand small below their mean."""
    rows = ([_SPREAD.sub(_BELOW, cell) for cell in row] for row in treatments.rows(partner, scale))
    return "\n".join("    " + " ".join(f"[{cell}]," for cell in row) for row in rows)
