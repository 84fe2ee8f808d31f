"""The page "What holds and what does not": every claim of the paper with its verdict, our figures and the reason.

The texts are in claims.toml: a reason for every verdict. Every figure is filled in from the rows.
"""

from __future__ import annotations

import re
import textwrap
import tomllib
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from signsplice_paper import claims, results
from signsplice_paper.comparing import TIME_BAND
from signsplice_paper.layout import Table, as_csv, markdown
from signsplice_paper.pages import OTHER_TRUTH, is_of_other_truth, put
from signsplice_paper.results import Results
from signsplice_paper.verdicts import FAILS, HOLDS, IN_PART, SPLIT, UNTESTED, Claim, ClaimVerdict, Evidence, judge

PAGE = "claims"
_WIDTH = 110
_KEYS = {HOLDS: "holds", IN_PART: "in_part", FAILS: "fails", UNTESTED: "untested"}
UNEQUAL_TRAINING = {
    "cpu": "**Equal time, not equal pairs**: a system has about 25 core-minutes. In them TFGN saw most pairs, LSTM "
    "three quarters as many, Transformer three eighths, ConvS2S and TFGN without Culling (LPT-WC, LPT-WAC) a fifth. "
    "TFGN without Culling and Transformer have half of its feed-forward width. All networks are smaller than the "
    "paper's.",
}
"""By scale, how the trainings of compared systems differ (``train.scales``)."""


def all_claims() -> list[Claim]:
    """The claims of claims.toml."""
    text = files("signsplice_paper").joinpath("claims.toml").read_text(encoding="utf-8")
    return [_claim(entry) for entry in tomllib.loads(text)["claim"]]


def _claim(entry: Mapping[str, Any]) -> Claim:
    same = dict.fromkeys(_KEYS, entry["why"]) if "why" in entry else {}
    why = same | {verdict: entry[key] for verdict, key in _KEYS.items() if key in entry}
    judged_by = claims.JUDGES[entry["judge"]] if "judge" in entry else None
    return Claim(entry["where"], entry["claim"], entry["printed"], judged_by, why, entry.get("of_lpt", True))


def judged(by_truth: Mapping[str, Results], scale: str) -> list[ClaimVerdict]:
    """Every claim with its verdict, from the results of one corpus for every truth."""
    corpora = [Evidence(found, scale) for found in by_truth.values()]
    return [judge(claim, corpora) for claim in all_claims()]


def table(by_truth: Mapping[str, Results], scale: str) -> Table:
    """All that is known of every claim."""
    found = judged(by_truth, scale)
    count = Counter(one.verdict for one in found)
    tally = ", ".join(f"{count[verdict]} {verdict}" for verdict in (HOLDS, IN_PART, FAILS, UNTESTED) if count[verdict])
    truths = list(by_truth)
    here = tuple(f"here, {truth} truth" for truth in truths)
    head = ("where", "claim of the paper", "printed", *here, "verdict", "why", f"LPT+, {truths[0]} truth")
    rows = tuple(
        (one.claim.where, one.claim.claim, one.claim.printed, *one.figures, one.verdict, one.why, one.improved)
        for one in found
    )
    return Table(f"{len(found)} claims: {tally}", "claims", head, rows)


def page(whole: Table, scale: str) -> str:
    """The page as Markdown: without sections, ranges of seeds, asides in brackets of a reason, and LPT+'s figures."""
    rows = []
    for _, *cells, why, improved in filter(None, whole.rows):
        means = (_without(r"\[[^]]*\]", cell) for cell in cells)
        rows.append((*means, _without(r"\((?:[^()]|\([^()]*\))*\)", why), improved.partition(":")[0]))
    table = replace(whole, head=whole.head[1:], rows=tuple(rows))
    first, *notes = _notes(scale)
    finding, _, lines = markdown(table).partition("\n\n")
    return "\n\n".join(["# What holds and what does not", finding, first, lines.rstrip(), "\n".join(notes)]) + "\n"


def _without(pattern: str, text: str) -> str:
    return re.sub(f" {pattern}", "", text)


def _notes(scale: str) -> list[str]:
    """What a reader has to know of the verdicts: a paragraph, then the points of a list."""
    first = (
        f"Scale {scale}, split {SPLIT}, AdamW, test pairs. LpTransformer, which follows the print, judges; LPT+ stands "
        "beside it. What is not trained, or below the mean transition with every seed, judges nothing. Where the two "
        "truths disagree, a claim holds in part. [claims.csv](claims.csv) adds sections, ranges of seeds and LPT+'s "
        "figures."
    )
    points = [
        "**Rivals have more than the print gives them**: differences between frames, a loss that weighs the tokens, "
        "a bias of the tokens; LSTM a summary of both words, LSTM and ConvS2S training on their own frames. "
        "LpTransformer has none of these, LPT+ all but the last. Beside LpTransformer, PTA and PAA of rivals are "
        "without bias.",
        UNEQUAL_TRAINING.get(scale, ""),
        "**Scores** are compared at the print's digits, and equal ones are as good. A difference within the spread of "
        "the seeds decides nothing (holds in part). A frame too many or too few costs 0.002: lambda is ours.",
        f"**Times** are of one CPU thread: a ratio below {TIME_BAND:g} decides nothing.",
        "**Ablations and fr** share networks, and are compared with the seeds that all of them have. With one seed, "
        "nobody knows how far another would move a score; of 1,000 pairs, the standard error of a PAA of 0.8 is 0.013.",
    ]
    wrapped = (textwrap.fill(f"- {point}", _WIDTH, subsequent_indent="  ") for point in points if point)
    return [textwrap.fill(first, _WIDTH), *wrapped]


def write(found: Results, folder: Path, scale: str) -> list[Path]:
    """Write claims.md and claims.csv from the results of a folder and of its subfolder ``word``; the paths written.

    None in that subfolder itself, so that every claim has one verdict.
    """
    if not found.rows or is_of_other_truth(folder):
        return []
    by_truth = {_truth(found): found}
    other = results.load(folder / OTHER_TRUTH / results.FILE)
    if other.rows:
        by_truth[_truth(other)] = other
    whole = table(by_truth, scale)
    texts = {".md": page(whole, scale), ".csv": as_csv([whole])}
    for suffix, text in texts.items():
        put(folder / f"{PAGE}{suffix}", text)
    return [folder / f"{PAGE}{suffix}" for suffix in texts]


def _truth(found: Results) -> str:
    return Evidence(found, "").truth
