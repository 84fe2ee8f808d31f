"""The pages of a folder of results: the table as CSV, and either pages whose figures a template takes from
results.json, or the tables alone.

``templates/NAME.md`` beside a folder of results becomes ``NAME.md`` in it. Between double braces stands what is looked
up:

    {{lptransformer accuracy 3}}              the mean over the seeds, three digits
    {{lptransformer pta,paa 3}}               two cells of a table
    {{lptransformer accuracy 3 spread}}       with the least and the largest of the seeds
    {{lpt-plus@unseen-words paa 3}}           another split than random
    {{lpt-plus@unseen-words* paa 3}}          taught on many words and bodies
    {{lptransformer-printed~sgd pta 3}}       by SGD
    {{transformer/lptransformer ms_median 1}} the ratio of the two scores
    {{table random}}                          a split's table
    {{table unseen-words lptransformer lpt-plus}}    of these systems
    {{splits lptransformer lpt-plus*}}        lines by split: both positions exact, in brackets within one frame
    {{summary lptransformer lpt-plus*}}       lines: scores of known words, and exact positions of the other splits
    {{speed cpu}}                             lines of speed-cpu.json, by system and decoding
    {{search}}                                lines of search.json, by system, width and rate
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.formats.json_files import read_json
from signsplice_paper import layout, published, tables
from signsplice_paper.protocol import SPLITS
from signsplice_paper.results import Results
from signsplice_paper.tables import HERE, ON_MANY, SHORT, TableLine, format_score, line

TEMPLATES = "templates"
"""Folder of templates, beside that of the results."""
TABLE, PAGE = "table.csv", "tables.md"
_FIGURE = re.compile(r"\{\{([^{}]+)\}\}")
_HEAD = "<!-- Made from templates/{name} and results.json by `signsplice-paper tables`: change that. -->\n"


def write(found: Results, folder: Path, scale: str) -> list[Path]:
    """Write the table as CSV, and the pages of the templates beside a folder of results, or where there are none the
    page of tables; the paths written.
    """
    texts = {TABLE: tables.as_csv(found, scale)}
    templates = sorted((folder.resolve().parent / TEMPLATES).glob("*.md"))
    for path in templates:
        text = fill_template(path.read_text(encoding="utf-8"), found, scale, folder)
        texts[path.name] = _HEAD.format(name=path.name) + text
    if not templates:
        texts[PAGE] = tables.page(found, scale)
    for name, text in texts.items():
        with replacing(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def fill_template(text: str, found: Results, scale: str, folder: Path = Path()) -> str:
    """A template with its figures, and tables of the files beside results.json in ``folder``. Raises ``InputError`` for
    a figure that no row has.
    """

    def figure(asked: re.Match[str]) -> str:
        if asked[1].startswith("speed "):
            return _times(folder / f"speed-{asked[1].split()[1]}.json")
        return _format_search(folder / "search.json") if asked[1] == "search" else _figure(asked[1], found, scale)

    return _FIGURE.sub(figure, text)


def _times(path: Path) -> str:
    """The lines of a table of prediction times."""
    rows = read_json(path, "prediction times")["rows"]
    return "\n".join(
        f"| {published.name(row['system'])} | {row['decoding']} | {row['writes']} | {row['n_parameters'] / 1e6:.1f} | "
        f"{row['ms_median']:.1f} | {row['times_base']:.2f} |"
        for row in rows
    )


def _format_search(path: Path) -> str:
    """The lines of a table of rates and widths that were tried: a line for each system and width."""
    rows = read_json(path, "a search")["rows"]
    scores = {(row["part"], row["units"], row["learning_rate"]): row["scores"] for row in rows}
    return "\n".join(
        f"| {published.name(part)} | {units} | {rate:.2g} | {layout.number(row.get('paa', math.nan))} | "
        f"{layout.number(row.get('accuracy', math.nan), 4)} |"
        for (part, units, rate), row in sorted(scores.items())
    )


def _figure(asked: str, found: Results, scale: str) -> str:
    words = asked.split()
    if words[0] == "table" and len(words) > 1:
        table = tables.table(found, scale, words[1], words[2:] or None)
        if table is None:
            raise InputError(f"{{{{{asked}}}}}: no row of scale {scale}")
        return "\n".join(layout.markdown(table).splitlines()[2:]).rstrip()
    if words[0] == "summary" and len(words) > 1:
        return "\n".join(_summary(asked, found, scale) for asked in words[1:])
    if words[0] == "splits" and len(words) > 1:
        return "\n".join(_by_split(asked, found, scale) for asked in words[1:])
    if len(words) not in (3, 4) or words[3:] not in ([], ["spread"]) or not (words[2] == SHORT or words[2].isdecimal()):
        raise InputError(f"{{{{{asked}}}}}: expected SYSTEM SCORE DIGITS [spread], table SPLIT or splits SYSTEM")
    systems, scores, places = words[:3]
    digits = SHORT if places == SHORT else int(places)
    of = [_line(system, found, scale) for system in systems.split("/")]
    cells = []
    for score in scores.split(","):
        values = [one.score(score) for one in of]
        if any(map(math.isnan, values)):
            raise InputError(f"{{{{{asked}}}}}: no row of scale {scale} has it")
        ratio = values[0] if len(values) == 1 else values[0] / values[1]
        cells.append(of[0].cell(score, digits) if words[3:] else format_score(ratio, digits))
    return " | ".join(cells)


def _summary(asked: str, found: Results, scale: str) -> str:
    system, star = asked.removesuffix("*"), "*" if asked.endswith("*") else ""
    name, *optimiser = system.split("~")
    known, *others = (_line("~".join([f"{name}", *optimiser]) + f"@{split}{star}", found, scale) for split in SPLITS)
    if not known.rows:
        raise InputError(f"{{{{summary {asked}}}}}: no row of scale {scale}")
    scores = (("pta", 3), ("paa", 3), ("accuracy", 4), ("mse", SHORT), ("bleu-4", 3))
    cells = [known.cell(score, digits) for score, digits in scores]
    cells += [one.cell("paa_all", 3) for one in others]
    return f"| {known.system} | {known.condition} | {known.taught} | {' | '.join(cells)} |"


def _by_split(asked: str, found: Results, scale: str) -> str:
    system, star = asked.removesuffix("*"), "*" if asked.endswith("*") else ""
    of = [_line(f"{system}@{split}{star}", found, scale) for split in SPLITS]
    known = next((one for one in of if one.rows), None)
    if known is None:
        raise InputError(f"{{{{splits {asked}}}}}: no row of scale {scale}")
    cells = [f"{format_score(one.score('paa_all'), 3)} ({format_score(one.score('within_1'), 3)})" for one in of]
    return f"| {known.system}, {known.condition} | {known.taught} | {' | '.join(cells)} |"


def _line(asked: str, found: Results, scale: str) -> TableLine:
    taught = ON_MANY if asked.endswith("*") else HERE
    system, _, split = asked.removesuffix("*").partition("@")
    system, _, optimiser = system.partition("~")
    return line(found, scale, system, split or "random", taught, optimiser or "adamw")
