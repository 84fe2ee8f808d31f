"""One verdict for every claim of the paper, from results.json.

A claim about LpTransformer is judged by the row that follows the print; what LPT+ gives stands beside it. A system that
is missing or not trained judges nothing. Where the corpora of two truths disagree, the claim holds in part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from signsplice.paper import published
from signsplice.paper.lines import TableLine, clip_lines, line
from signsplice.paper.results import CLASSICAL, Results

HOLDS, IN_PART, FAILS, UNTESTED = "holds", "holds in part", "does not hold", "not tested"
SPLIT = "random"
"""The split that judges: in the paper, too, every test word was seen in other pairs."""


@dataclass(frozen=True)
class Finding:
    """What the rows of one corpus say about a claim.

    - verdict: one of the four
    - figure: the measured values in words
    - facts: further measured values by name, for the reason
    """

    verdict: str
    figure: str
    facts: Mapping[str, str] = field(default_factory=dict)


class Evidence:
    """The rows of one corpus that judge claims."""

    def __init__(self, results: Results, scale: str) -> None:
        self.results, self.scale = results, scale

    def of(self, *systems: str) -> list[TableLine] | None:
        """The lines of some systems trained by AdamW; None if one is missing or not trained."""
        found = [line(self.results, system, self.scale, SPLIT) for system in systems]
        return found if all(one.is_known for one in found) else None

    def with_fr(self, fr: int, system: str) -> TableLine:
        """The line of a system with an fr."""
        return line(self.results, system, self.scale, SPLIT, fr=fr)

    def classical(self, given: str) -> list[TableLine]:
        """The classical methods that are given so much of the truth."""
        found = clip_lines(self.results, SPLIT)
        return [one for one in found if one.rows[0].scale == CLASSICAL and one.rows[0].given == given]

    def accuracies(self, system: str, fr: int | None = published.BEST_FR) -> list[float]:
        """Validation Accuracy over the training of a system, empty if unknown."""
        for curve in self.results.curves:
            key = (curve.system, curve.split, curve.scale, curve.optimiser)
            if key == (system, SPLIT, self.scale, "adamw") and curve.fr in (None, fr) and not curve.seed:
                at = tuple(getattr(curve, "columns", ("step", "accuracy"))).index("accuracy")
                return [float(value) for point in curve.points if (value := point[at]) is not None]
        return []


Judge = Callable[[Evidence, str], Finding | None]
"""The rows, and the system that stands for LpTransformer -> the finding; None if a row that it needs is missing."""


@dataclass(frozen=True)
class Claim:
    """A claim of the paper.

    - where: the section, table or figure
    - claim: the claim in words
    - printed: the value that the paper prints
    - judge: finds the verdict in rows; None for what rows cannot test
    - why: the reason for every verdict
    - of_lpt: whether it is about LpTransformer, so that LPT+ has a figure of its own
    """

    where: str
    claim: str
    printed: str
    judge: Judge | None
    why: Mapping[str, str]
    of_lpt: bool = True


@dataclass(frozen=True)
class ClaimVerdict:
    """A claim with its verdict.

    - claim: the claim
    - verdict: of all truths together
    - figures: the figure of every truth, "-" where it was not tested
    - improved: the figure of LPT+ on the first truth that has one
    - why: the reason
    """

    claim: Claim
    verdict: str
    figures: tuple[str, ...]
    improved: str
    why: str


def judge(claim: Claim, corpora: Sequence[Evidence]) -> ClaimVerdict:
    """The verdict on a claim, from the rows of one corpus for every truth."""
    found = [_finding(claim, e, published.PRINTED) for e in corpora]
    better = [_finding(claim, e, published.IMPROVED) for e in corpora] if claim.of_lpt else []
    tested = [one for one in found if one is not None]
    verdict = _together([one.verdict for one in tested])
    why = NO_ROW
    if len({one.verdict for one in tested}) > 1:
        why = f"the truths disagree: {', '.join(one.verdict for one in tested)}"
    elif tested or claim.judge is None:
        why = claim.why.get(verdict, "").format(**(tested[0].facts if tested else {}))
    improved = next((one.figure for one in better if one is not None), "-")
    return ClaimVerdict(claim, verdict, tuple("-" if one is None else one.figure for one in found), improved, why)


NO_ROW = "a row that it needs is missing or not trained"


def _finding(claim: Claim, evidence: Evidence, system: str) -> Finding | None:
    return None if claim.judge is None else claim.judge(evidence, system)


def _together(verdicts: Sequence[str]) -> str:
    if not verdicts:
        return UNTESTED
    return verdicts[0] if len(set(verdicts)) == 1 else IN_PART


def graded(holds: bool, in_part: bool = False) -> str:
    """The verdict for a claim that holds, or else in part."""
    return HOLDS if holds else IN_PART if in_part else FAILS


def shown(value: float, digits: int = 3) -> str:
    """A figure as text."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
