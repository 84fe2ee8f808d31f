"""Pages written by hand, whose figures a template takes from results.json.

``templates/NAME.md`` beside a folder of results becomes ``NAME.md`` in it. Between double braces stands
what is looked up:

    {{partner lpt-printed accuracy 3}}                the mean over the seeds, three digits
    {{partner lpt-printed pta,paa 3}}                 two cells of a table
    {{partner lpt-printed accuracy 3 spread}}         with the least and the largest of the seeds
    {{partner transformer@unseen-signer pta 3}}       another split than random
    {{partner pose-velocity+hermite:nothing bleu-4 3}}    a method, by what it was given of the truth
    {{partner lpt-printed#6 mse short}}               another fr; "short" has two significant figures
    {{partner transformer/lpt-printed ms_mean 1}}     the ratio of the two scores
    {{partner treatments}}  {{partner seeds}}         the four systems by treatment; how many seeds each line has
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

from signsplice.errors import InputError
from signsplice_paper import results, treatments
from signsplice_paper.lines import SHORT, TableLine, line, written
from signsplice_paper.pages import OTHER_TRUTH, is_of_other_truth, put
from signsplice_paper.results import Results

TEMPLATES = "templates"
"""Folder of templates, beside that of the results."""
_FIGURE = re.compile(r"\{\{([^{}]+)\}\}")
_HEAD = "<!-- Made from templates/{name} and results.json by `signsplice-paper tables`: change that. -->\n"


def filled(text: str, known: Mapping[str, Results], scale: str) -> str:
    """A template with its figures. Raises ``InputError`` for one that no row has."""
    return _FIGURE.sub(lambda found: _figure(found[1], known, scale), text)


def _figure(asked: str, known: Mapping[str, Results], scale: str) -> str:
    words = asked.split()
    if words[1:] in (["treatments"], ["seeds"]) and words[0] in known:
        if words[1] == "seeds":
            return treatments.seeds(known[words[0]], scale)
        return "\n".join(f"| {' | '.join(cells)} |" for cells in treatments.rows(known[words[0]], scale))
    if len(words) not in (4, 5) or words[0] not in known or words[4:] not in ([], ["spread"]):
        raise InputError(f"{{{{{asked}}}}}: expected TRUTH SYSTEM SCORE DIGITS [spread], of {', '.join(known)}")
    truth, systems, scores, places = words[:4]
    digits = SHORT if places == SHORT else int(places)
    found = [_line(system, known[truth], scale) for system in systems.split("/")]
    cells = []
    for score in scores.split(","):
        values = [one.score(score) for one in found]
        if any(map(math.isnan, values)):
            raise InputError(f"{{{{{asked}}}}}: no row of scale {scale} has it")
        ratio = values[0] if len(values) == 1 else values[0] / values[1]
        cells.append(found[0].cell(score, digits) if words[4:] else written(ratio, digits))
    return " | ".join(cells)


def _line(asked: str, found: Results, scale: str) -> TableLine:
    system, _, split = asked.partition("@")
    system, _, fr = system.partition("#")
    system, _, given = system.partition(":")
    split = split or "random"
    if given:
        rows = found.find(system=system, given=given.replace("_", " "), split=split, part="test")
        return TableLine(system, given, tuple(rows[:1]))
    return line(found, system, scale, split, fr=int(fr) if fr else None)


def write(found: Results, folder: Path, scale: str) -> list[Path]:
    """Write the pages whose templates lie beside a folder of results, from these and those of its subfolder ``word``;
    the paths written. None in that subfolder itself.
    """
    if is_of_other_truth(folder):
        return []
    known = by_truth(found, folder)
    written = []
    for template in sorted((folder.resolve().parent / TEMPLATES).glob("*.md")):
        page = folder / template.name
        put(page, _HEAD.format(name=template.name) + filled(template.read_text(encoding="utf-8"), known, scale))
        written.append(page)
    return written


def by_truth(found: Results, folder: Path) -> dict[str, Results]:
    """The results of a folder and those of its subfolder ``word``, by truth."""
    other = results.load(folder / OTHER_TRUTH / results.FILE)
    return {next((row.truth for row in each.rows), ""): each for each in (found, other) if each.rows}
