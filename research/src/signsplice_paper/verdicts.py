"""One verdict for every claim of the paper, from results.json.

A claim about LpTransformer is judged by the row that follows the print; what LPT+ gives stands beside it. A system that
is missing or not trained judges nothing, nor does a score that nothing was counted for. Where the corpora of two truths
disagree, the claim holds in part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from signsplice_paper import published
from signsplice_paper.lines import TableLine, clip_lines, line, shared_seeds
from signsplice_paper.results import CLASSICAL, Results, check_comparable

HOLDS, IN_PART, FAILS, UNTESTED = "holds", "holds in part", "does not hold", "not tested"
SPLIT = "random"
"""The split that judges: in the paper, too, every test word was seen in other pairs."""


class NotTestedError(Exception):
    """A claim cannot be judged; the message says what is missing."""


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
        self.truth = next((row.truth for row in results.rows if row.truth), "partner")

    def of(self, *systems: str, alike: bool = False) -> list[TableLine]:
        """The lines of some systems trained by AdamW; ``alike``: with the seeds that all of them have, as systems that
        share networks are compared. Raises ``NotTestedError`` if one is missing or not trained, and ``InputError`` if
        they cannot be compared.
        """
        seeds = shared_seeds(self.results, systems, self.scale, SPLIT) if alike else ()
        found = [line(self.results, system, self.scale, SPLIT, seeds=seeds) for system in systems]
        missing = [one.name for one in found if not one.rows]
        low = [one.name for one in found if one.rows and not one.trained]
        if missing or low:
            parts = (("not trained yet", missing), ("below the mean transition", low))
            raise NotTestedError("; ".join(f"{what}: {', '.join(names)}" for what, names in parts if names))
        return comparable(found)

    def by_fr(self, system: str, values: Iterable[int]) -> dict[int, TableLine]:
        """The lines of a system by fr, as far as there are any, with the seeds that all of them have."""
        frs = list(values)
        seeds = shared_seeds(self.results, [system], self.scale, SPLIT, frs=frs)
        found = {fr: line(self.results, system, self.scale, SPLIT, fr=fr, seeds=seeds) for fr in frs}
        known = {fr: one for fr, one in found.items() if one.is_known}
        comparable(known.values())
        return known

    def classical(self, given: str, compared: TableLine) -> list[TableLine]:
        """The classical methods that are given so much of the truth, comparable with another line."""
        rows = [one for one in clip_lines(self.results, SPLIT) if one.rows[0].scale == CLASSICAL]
        found = [one for one in rows if one.rows[0].given == given]
        if not found:
            raise NotTestedError(f"no classical method given {given}")
        return comparable([compared, *found])[1:]

    def accuracies(self, system: str, fr: int = published.BEST_FR, least: int = 8) -> list[list[float]]:
        """Validation Accuracy over the training of a system, for every seed that has a curve. Raises ``NotTestedError``
        if none has, or one of them has fewer points than ``least``.
        """
        curves = []
        for curve in self.results.curves:
            key = (curve.system, curve.split, curve.scale, curve.optimiser)
            if key == (system, SPLIT, self.scale, "adamw") and curve.fr in (None, fr):
                curves.append([value for value in curve.column("accuracy") if value is not None])
        if min(map(len, curves), default=0) < least:
            raise NotTestedError(f"no curve of {least} points: {published.name(system)}")
        return curves


Judge = Callable[[Evidence, str], Finding]
"""The rows, and the system that stands for LpTransformer -> the finding; ``NotTestedError`` if something is missing."""


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
    - improved: the verdict and the figure of LPT+ on the first truth
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
    tested = [one for one in found if one.verdict != UNTESTED]
    truths = [e.truth for e, one in zip(corpora, found, strict=True) if one.verdict != UNTESTED]
    verdict = together([one.verdict for one in tested])
    if len({one.verdict for one in tested}) > 1:
        why = _disagreement(claim, truths, tested)
    elif tested or claim.judge is None:
        why = claim.why[verdict].format(**_facts(tested))
    else:
        why = found[0].facts["missing"]
    better = _finding(claim, corpora[0], published.IMPROVED) if claim.of_lpt else None
    improved = "-" if better is None or better.verdict == UNTESTED else f"{better.verdict}: {better.figure}"
    return ClaimVerdict(claim, verdict, tuple(one.figure for one in found), improved, why)


def _disagreement(claim: Claim, truths: Sequence[str], found: Sequence[Finding]) -> str:
    """The verdict of each truth that was tested, and its reason: in brackets, or at the end where all have the same."""
    verdicts = [f"{truth}: {one.verdict}" for truth, one in zip(truths, found, strict=True)]
    reasons = [claim.why[one.verdict].format(**one.facts) for one in found]
    if len(set(reasons)) == 1:
        return f"{', '.join(verdicts)}; {reasons[0]}"
    return "; ".join(f"{verdict} ({reason})" for verdict, reason in zip(verdicts, reasons, strict=True))


def _finding(claim: Claim, evidence: Evidence, system: str) -> Finding:
    if claim.judge is None:
        return Finding(UNTESTED, "-")
    try:
        return claim.judge(evidence, system)
    except NotTestedError as error:
        return Finding(UNTESTED, "-", {"missing": str(error)})


def _facts(tested: Sequence[Finding]) -> dict[str, str]:
    """The facts of all truths, in the order of the truths where they differ."""
    names = tested[0].facts if tested else ()
    return {name: " / ".join(dict.fromkeys(one.facts[name] for one in tested)) for name in names}


def together(verdicts: Sequence[str]) -> str:
    """One verdict for several: theirs if they agree, else in part."""
    if not verdicts:
        return UNTESTED
    return verdicts[0] if len(set(verdicts)) == 1 else IN_PART


def graded(holds: bool, in_part: bool = False) -> str:
    """The verdict for a claim that holds, or else in part."""
    return HOLDS if holds else IN_PART if in_part else FAILS


def comparable(found: Iterable[TableLine]) -> list[TableLine]:
    """The same lines. Raises ``InputError`` if their rows differ in metrics, protocol or corpus."""
    out = list(found)
    check_comparable([row for one in out for row in one.rows])
    return out


def known(one: TableLine, name: str) -> float:
    """A score of a line. Raises ``NotTestedError`` where it is NaN."""
    value = one.score(name)
    if math.isnan(value):
        raise NotTestedError(f"{one.name} has no {name}")
    return value


def shown(value: float, digits: int = 3) -> str:
    """A figure as text."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
