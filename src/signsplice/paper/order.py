"""Whether the measured scores agree with the paper: the order of its systems per metric, and the claims of its text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

from signsplice.paper import published
from signsplice.paper.results import ResultRow


@dataclass(frozen=True)
class SystemOrder:
    """How far the measured order of systems agrees with the printed order.

    - agreeing: number of pairs of systems in the printed order
    - ordered: number of pairs of systems with different printed scores
    """

    agreeing: int
    ordered: int

    @property
    def verdict(self) -> str:
        """Yes or no, with the count; "-" if there is nothing to compare."""
        if not self.ordered:
            return "-"
        return f"{'yes' if self.agreeing == self.ordered else 'no'} ({self.agreeing}/{self.ordered})"


@dataclass(frozen=True)
class Claim:
    """A claim of the paper.

    - claim: the claim in words
    - printed: the value that the paper prints
    - measured: the value measured here
    - holds: whether the measured value agrees
    """

    claim: str
    printed: str
    measured: str
    holds: bool


def follows(printed: Mapping[str, float], measured: Mapping[str, float]) -> SystemOrder:
    """The order of the systems in both mappings from system to score.

    Pairs with equal printed scores are left out. A measured tie agrees with no order, and NaN ranks below every score.
    """
    shared = [system for system in printed if system in measured]
    agreeing = ordered = 0
    for a, b in permutations(shared, 2):
        if printed[a] > printed[b]:
            ordered += 1
            agreeing += _floor(measured[a]) > _floor(measured[b])
    return SystemOrder(agreeing, ordered)


def of_metric(table: Mapping[str, tuple[str, ...]], metric: str, rows: Mapping[str, ResultRow]) -> SystemOrder:
    """The order by one metric of one of the paper's tables, compared with rows by system."""
    column = published.METRICS.index(metric)
    printed = {system: float(values[column]) for system, values in table.items()}
    return follows(printed, {system: row.score(published.SCORES[metric]) for system, row in rows.items()})


def claims_1(rows: Mapping[str, ResultRow]) -> list[Claim]:
    """The claims of the paper's text about the four systems of table 1."""
    out: list[Claim] = []
    lpt, transformer = rows.get("lpt"), rows.get("transformer")
    others = [rows[system] for system in published.TABLE_1 if system in rows and system != "lpt"]
    if lpt is None:
        return out
    accuracy, error = lpt.score("accuracy"), lpt.score("mse")
    out.append(Claim("LpTransformer's Accuracy", f"about {published.ACCURACY}", f"{accuracy:.3f}", accuracy >= 0.985))
    out.append(Claim("LpTransformer's MSE", f"{published.MSE}", f"{error:.4f}", error <= published.VISIBLE))
    if others:
        best = max(_floor(row.score("accuracy")) for row in others)
        out.append(Claim("its Accuracy is the highest", "yes", f"next: {best:.3f}", accuracy > best))
        least = min(row.score("mse") for row in others)
        visible = least > published.VISIBLE
        out.append(Claim("the other systems' MSE is above 0.002", "yes", f"least: {least:.4f}", visible))
    if transformer is not None:
        times = transformer.score("ms_mean") / lpt.score("ms_mean")
        printed = f"{published.TIMES_FASTER:g} times"
        out.append(Claim("faster than Transformer", printed, f"{times:.1f} times", times >= published.TIMES_FASTER))
    ms = {row.system: row.score("ms_mean") for row in (lpt, *others)}
    if {"conv-s2s", "transformer"} <= ms.keys():
        fastest, slowest = min(ms, key=lambda s: ms[s]), max(ms, key=lambda s: ms[s])
        out.append(Claim("fastest", "ConvS2S", published.name(fastest), fastest == "conv-s2s"))
        out.append(Claim("slowest", "Transformer", published.name(slowest), slowest == "transformer"))
    return out


def claims_3(rows: Mapping[str, ResultRow]) -> list[Claim]:
    """The claims of the paper's text about the ablations of table 3."""
    out: list[Claim] = []
    lpt = rows.get("lpt")
    others = {system: rows[system] for system in published.TABLE_3 if system in rows and system != "lpt"}
    if lpt is None or not others:
        return out
    accuracy, best = lpt.score("accuracy"), max(_floor(row.score("accuracy")) for row in others.values())
    out.append(Claim("LPT's Accuracy is the highest", "yes", f"{accuracy:.4f}, next: {best:.4f}", accuracy > best))
    if "lpt-wa" in others:
        error, without = lpt.score("mse"), others["lpt-wa"].score("mse")
        measured = f"{without:.4f} versus {error:.4f}"
        out.append(Claim("without attention the error is larger", "yes", measured, without > error))
    for system in ("lpt-wc", "lpt-wac"):
        if system in others:
            times = others[system].score("ms_mean") / lpt.score("ms_mean")
            claim = f"{published.name(system)}, without culling, is slower"
            out.append(Claim(claim, "far longer", f"{times:.1f} times", times > 1.0))
    return out


def _floor(value: float) -> float:
    """The value, or minus infinity for NaN."""
    return -math.inf if math.isnan(value) else value
