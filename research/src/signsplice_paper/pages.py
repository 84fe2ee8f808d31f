"""The pages of a folder of results: the table as CSV, and either pages whose figures a template takes from
results.json, or the tables alone.

``templates/NAME.md`` next to a folder of results becomes ``NAME.md`` in it. Fields between double braces are filled:

    {{lptransformer accuracy 3}}              the mean over the seeds, three digits
    {{lptransformer pta,paa 3}}               two cells of a table
    {{lptransformer accuracy 3 spread}}       with the least and the largest of the seeds
    {{lpt-plus@unseen-words paa 3}}           another split than random
    {{lpt-plus@unseen-words* paa 3}}          taught on many words and bodies
    {{lptransformer-printed~sgd pta 3}}       by SGD
    {{transformer/lptransformer ms_median 1}} the ratio of the two scores
    {{summary lptransformer lpt-plus*}}       lines: scores of known words, and exact positions of the other splits
    {{speed cpu}}                             lines of speed-cpu.json, by system and decoding
    {{speed paper transformer}}               lines of one system
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.formats.json_files import read_json
from signsplice_paper import published, tables
from signsplice_paper.protocol import SPLITS
from signsplice_paper.results import Results
from signsplice_paper.tables import ON_MANY, ON_SPLIT, SHORT, TableLine, find_line, format_score

TEMPLATES = "templates"
"""Folder of templates, next to that of the results."""
TABLE, PAGE = "table.csv", "tables.md"
_FIGURE = re.compile(r"\{\{([^{}]+)\}\}")
_HEAD = "<!-- Made from templates/{name} and results.json by `signsplice-paper tables`: change that. -->\n"


def write(results: Results, folder: Path, scale: str) -> list[Path]:
    """Writes the table as CSV, and the pages of the templates next to a folder of results, or without templates the
    page of tables; returns the paths.
    """
    texts = {TABLE: tables.format_csv(results, scale)}
    templates = sorted((folder.resolve().parent / TEMPLATES).glob("*.md"))
    for path in templates:
        text = fill_template(path.read_text(encoding="utf-8"), results, scale, folder)
        texts[path.name] = _HEAD.format(name=path.name) + text
    if not templates:
        texts[PAGE] = tables.format_page(results, scale)
    for name, text in texts.items():
        with replacing(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def fill_template(text: str, results: Results, scale: str, folder: Path = Path()) -> str:
    """Returns a template with its fields filled from the results, and from the files next to results.json in
    ``folder``. Raises ``InputError`` for a field that no row has.
    """

    def fill_field(match: re.Match[str]) -> str:
        if match[1].startswith("speed "):
            scale_name, *systems = match[1].split()[1:]
            return _format_times(folder / f"speed-{scale_name}.json", systems)
        return _format_field(match[1], results, scale)

    return _FIGURE.sub(fill_field, text)


def _format_times(path: Path, systems: Sequence[str]) -> str:
    """Returns the lines of a table of prediction times of ``systems``, of all if none is named."""
    rows = read_json(path, "prediction times")["rows"]
    return "\n".join(
        f"| {published.get_display_name(row['system'])} | {row['decoding']} | {row['writes']} | "
        f"{row['n_parameters'] / 1e6:.1f} | {row['ms_median']:.1f} | {row['times_base']:.2f} |"
        for row in rows
        if not systems or row["system"] in systems
    )


def _format_field(field: str, results: Results, scale: str) -> str:
    words = field.split()
    if words[0] == "summary" and len(words) > 1:
        return "\n".join(_format_summary(field, results, scale) for field in words[1:])
    if len(words) not in (3, 4) or words[3:] not in ([], ["spread"]) or not (words[2] == SHORT or words[2].isdecimal()):
        raise InputError(f"{{{{{field}}}}}: expected SYSTEM SCORE DIGITS [spread] or summary SYSTEM")
    systems, scores, digits_text = words[:3]
    digits = SHORT if digits_text == SHORT else int(digits_text)
    lines = [_find_line(system, results, scale) for system in systems.split("/")]
    cells = []
    for score in scores.split(","):
        values = [line.score(score) for line in lines]
        if any(map(math.isnan, values)):
            raise InputError(f"{{{{{field}}}}}: no row of scale {scale} has it")
        ratio = values[0] if len(values) == 1 else values[0] / values[1]
        cells.append(lines[0].format_cell(score, digits) if words[3:] else format_score(ratio, digits))
    return " | ".join(cells)


def _format_summary(system_text: str, results: Results, scale: str) -> str:
    system, star = system_text.removesuffix("*"), "*" if system_text.endswith("*") else ""
    name, *optimiser = system.split("~")
    known_words, *unseen = (
        _find_line("~".join([f"{name}", *optimiser]) + f"@{split}{star}", results, scale) for split in SPLITS
    )
    if not known_words.rows:
        raise InputError(f"{{{{summary {system_text}}}}}: no row of scale {scale}")
    scores = (("pta", 3), ("paa", 3), ("accuracy", 4), ("mse", SHORT), ("bleu-4", 3))
    cells = [known_words.format_cell(score, digits) for score, digits in scores]
    cells += [line.format_cell("paa_all", 3) for line in unseen]
    return f"| {known_words.system} | {known_words.condition} | {known_words.taught} | {' | '.join(cells)} |"


def _find_line(system_text: str, results: Results, scale: str) -> TableLine:
    taught = ON_MANY if system_text.endswith("*") else ON_SPLIT
    system, _, split = system_text.removesuffix("*").partition("@")
    system, _, optimiser = system.partition("~")
    return find_line(results, scale, system, split or "random", taught, optimiser or "adamw")
