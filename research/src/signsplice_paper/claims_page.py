"""The page "What holds and what does not": every claim of the paper with its verdict, our figures and the reason.

The texts are in claims.toml: a reason for every verdict. Every figure is filled in from the rows.
"""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from signsplice_paper import claims, results
from signsplice_paper.comparing import TIME_BAND
from signsplice_paper.layout import Table, markdown
from signsplice_paper.results import Results
from signsplice_paper.tables import put
from signsplice_paper.verdicts import FAILS, HOLDS, IN_PART, SPLIT, UNTESTED, Claim, ClaimVerdict, Evidence, judge

PAGE = "claims.md"
_KEYS = {HOLDS: "holds", IN_PART: "in_part", FAILS: "fails", UNTESTED: "untested"}
UNEQUAL_TRAINING = {
    "cpu": (
        "- **Equal time, not equal pairs**: steps were chosen so that a system has about 25 core-minutes, half each",
        "  for positions and frames if these are two networks (in figure 4(c), measured on a faster day, 10 to 18).",
        "  In them TFGN saw most pairs, LSTM three quarters as many, Transformer three eighths, ConvS2S and TFGN",
        "  without Culling (LPT-WC, LPT-WAC) a fifth. TFGN without Culling and Transformer have half of TFGN's",
        "  feed-forward width. Related work had less time.",
    )
}
"""By scale, how the trainings of compared systems differ (``train.scales``)."""
OTHER_TRUTH = "word"
"""Subfolder with the results of the other truth; one page serves both."""


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


def page(by_truth: Mapping[str, Results], scale: str) -> str:
    """The page as Markdown."""
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
    table = markdown(Table(f"{len(found)} claims: {tally}", "claims", head, rows))
    return "\n".join(["# What holds and what does not", "", *_head(scale), "", table])


def _head(scale: str) -> list[str]:
    """What a reader has to know before the verdicts."""
    return [
        f"Scale {scale}, split {SPLIT}, AdamW, test pairs. The row that follows the print judges (LpTransformer in",
        "the tables); LPT+ stands beside it. What is not trained, or below the mean transition with every seed, judges",
        "nothing. Where two truths disagree, a claim holds in part; where a reason's figures differ, / parts them.",
        "",
        "- **Rivals have more than the print gives them**: differences between frames, a loss that weighs the tokens,",
        "  a bias of the tokens chosen on validation pairs; LSTM a summary of both words, LSTM and ConvS2S training on",
        "  their own frames. LpTransformer has none of these, LPT+ all but the last. Beside LpTransformer, PTA and",
        "  PAA of rivals are without bias; all else is with it.",
        *UNEQUAL_TRAINING.get(scale, ()),
        "- **Scores** are compared at the print's three digits (MSE: four), and equal ones are as good, as in the",
        '  print; with several seeds a difference up to their spread decides nothing: "holds in part". lambda, the',
        "  cost of a wrong length, is ours: a frame too many or too few counts 0.002.",
        f"- **Times** are of one CPU thread, rows one after another: a ratio below {TIME_BAND:g} decides nothing.",
        "- **Ablations and fr** share networks, and are compared with the seeds that all of them have.",
        "- **Seeds**: the rows say how many. With one, nobody knows how far another would move a score; of 1,000 pairs",
        "  alone, the standard error of a PAA of 0.8 is 0.013.",
        "",
        "Criteria: paper/claims*.py. Rows, seeds, pairs seen: [table 1](table1.md), [table 3](table3.md), [fr](fr.md).",
    ]


def write(found: Results, folder: Path, scale: str) -> list[Path]:
    """Write claims.md from the results of a folder and of its subfolder ``word``; the paths written. None in that
    subfolder itself, so that every claim has one verdict.
    """
    if not found.rows or (folder.resolve().name == OTHER_TRUTH and (folder.resolve().parent / results.FILE).exists()):
        return []
    by_truth = {_truth(found): found}
    other = results.load(folder / OTHER_TRUTH / results.FILE)
    if other.rows:
        by_truth[_truth(other)] = other
    put(folder / PAGE, page(by_truth, scale))
    return [folder / PAGE]


def _truth(found: Results) -> str:
    return Evidence(found, "").truth
