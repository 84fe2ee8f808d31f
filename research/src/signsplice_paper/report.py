"""The report of the rebuilt paper as PDF, in the form of journals of reproduction, from Typst and results.json."""

from __future__ import annotations

import tempfile
from importlib.metadata import version
from pathlib import Path

from signsplice.errors import InputError, MissingExtraError
from signsplice.formats.atomic import replacing
from signsplice_paper import page_template, published, results, treatment_figure
from signsplice_paper.lines import MISSING, SHORT, line, written
from signsplice_paper.results import Results

_TEMPLATE = "report.typ"
_SCORES: dict[str, int | str] = {"bleu-1": 3, "bleu-4": 3, "pta": 3, "paa": 3, "accuracy": 3, "mse": SHORT}


def write(found: Results, folder: Path, scale: str, out: Path) -> None:
    """Write the report of a folder of results to ``out``. Raises ``InputError`` where its template, its figure or a row
    is missing, ``MissingExtraError`` without Typst.
    """
    try:
        import typst
    except ImportError as error:
        raise MissingExtraError("the report needs Typst: pip install 'signsplice-paper[report]'") from error
    figure = f"{treatment_figure.NAME}.svg"
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
    for name, value in (("{{version}}", version("signsplice")), ("{{treatments}}", _treatments(partner, scale))):
        text = text.replace(name, value)
    files["main.typ"] = page_template.filled(text, known, scale).encode()
    with tempfile.TemporaryDirectory(prefix="signsplice-report-") as made, replacing(out) as temporary:
        for name, data in files.items():
            Path(made, name).write_bytes(data)
        temporary.write_bytes(typst.compile(Path(made, "main.typ"), format="pdf", ignore_system_fonts=True))


def _treatments(partner: Results, scale: str) -> str:
    """Rows of a Typst table: each system as printed in the paper, then by treatment."""
    rows = []
    for system, by_treatment in published.TREATED.items():
        printed = dict(zip(published.METRICS, published.TABLE_1[system], strict=True))
        both = (f"{published.ACCURACY}", f"{published.MSE}") if system == published.PRINTED else ("-", "-")
        rows.append(
            (published.name(system), "printed", *(printed[m] for m in ("BLEU-1", "BLEU-4", "PTA", "PAA")), *both)
        )
        rows += [("", treatment, *_cells(partner, of, scale)) for treatment, of in by_treatment.items()]
    return "\n".join("    " + " ".join(f"[{cell}]," for cell in row) for row in rows)


def _cells(partner: Results, system: str, scale: str) -> list[str]:
    one = line(partner, system, scale, "random")
    if not one.rows:
        return [MISSING, *[""] * (len(_SCORES) - 1)]
    return [written(one.score(name), digits) for name, digits in _SCORES.items()]
