"""Whether what was measured says what the paper says: the order of its systems, metric by metric, and its claims."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

from signsplice.paper import published
from signsplice.paper.results import ResultRow


@dataclass(frozen=True)
class SystemOrder:
    """How many pairs of systems the paper puts in an order, and how many of them are in that order here."""

    agreeing: int
    ordered: int

    @property
    def verdict(self) -> str:
        """Yes or no, with the count; "-" where there is nothing to compare."""
        if not self.ordered:
            return "-"
        return f"{'yes' if self.agreeing == self.ordered else 'no'} ({self.agreeing}/{self.ordered})"


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper, what it prints, what was measured, and whether it holds."""

    claim: str
    printed: str
    measured: str
    holds: bool


def follows(printed: Mapping[str, float], measured: Mapping[str, float]) -> SystemOrder:
    """Order of the systems that both know. Pairs that the paper prints as equal are left out; a tie here agrees with
    no order; a score that could not be counted is below every other.
    """
    there = [system for system in printed if system in measured]
    agreeing = ordered = 0
    for a, b in permutations(there, 2):
        if printed[a] > printed[b]:
            ordered += 1
            agreeing += _floor(measured[a]) > _floor(measured[b])
    return SystemOrder(agreeing, ordered)


def of_metric(table: Mapping[str, tuple[str, ...]], metric: str, rows: Mapping[str, ResultRow]) -> SystemOrder:
    """Order of one of the paper's metrics in one of its tables, beside rows by system."""
    at = published.METRICS.index(metric)
    printed = {system: float(values[at]) for system, values in table.items()}
    return follows(printed, {system: row.score(published.SCORES[metric]) for system, row in rows.items()})


def claims_1(rows: Mapping[str, ResultRow]) -> list[Claim]:
    """What the paper's text says of its four systems beside table 1."""
    out: list[Claim] = []
    lpt, transformer = rows.get("lpt"), rows.get("transformer")
    others = [rows[system] for system in published.TABLE_1 if system in rows and system != "lpt"]
    if lpt is None:
        return out
    own, error = lpt.score("accuracy"), lpt.score("mse")
    out.append(Claim("LpTransformer's Accuracy", f"about {published.ACCURACY}", f"{own:.3f}", own >= 0.985))
    out.append(Claim("LpTransformer's MSE", f"{published.MSE}", f"{error:.4f}", error <= published.VISIBLE))
    if others:
        best = max(_floor(row.score("accuracy")) for row in others)
        out.append(Claim("its Accuracy is the highest", "yes", f"next: {best:.3f}", own > best))
        least = min(row.score("mse") for row in others)
        beyond = least > published.VISIBLE
        out.append(Claim("the other systems' MSE is beyond 0.002", "yes", f"least: {least:.4f}", beyond))
    if transformer is not None:
        times = transformer.score("ms_mean") / lpt.score("ms_mean")
        printed = f"{published.TIMES_FASTER:g} times"
        out.append(Claim("faster than Transformer", printed, f"{times:.1f} times", times >= published.TIMES_FASTER))
    every = {row.system: row.score("ms_mean") for row in (lpt, *others)}
    if {"conv-s2s", "transformer"} <= every.keys():
        fastest, slowest = min(every, key=lambda s: every[s]), max(every, key=lambda s: every[s])
        out.append(Claim("fastest", "ConvS2S", published.name(fastest), fastest == "conv-s2s"))
        out.append(Claim("slowest", "Transformer", published.name(slowest), slowest == "transformer"))
    return out


def claims_3(rows: Mapping[str, ResultRow]) -> list[Claim]:
    """What the paper's text says of its ablations beside table 3."""
    out: list[Claim] = []
    lpt = rows.get("lpt")
    others = {system: rows[system] for system in published.TABLE_3 if system in rows and system != "lpt"}
    if lpt is None or not others:
        return out
    own, best = lpt.score("accuracy"), max(_floor(row.score("accuracy")) for row in others.values())
    out.append(Claim("LPT's Accuracy is the highest", "yes", f"{own:.4f}, next: {best:.4f}", own > best))
    if "lpt-wa" in others:
        error, without = lpt.score("mse"), others["lpt-wa"].score("mse")
        measured = f"{without:.4f} against {error:.4f}"
        out.append(Claim("without attention the error is larger", "yes", measured, without > error))
    for system in ("lpt-wc", "lpt-wac"):
        if system in others:
            times = others[system].score("ms_mean") / lpt.score("ms_mean")
            told = f"{published.name(system)}, without culling, is slower"
            out.append(Claim(told, "far longer", f"{times:.1f} times", times > 1.0))
    return out


def _floor(value: float) -> float:
    return -math.inf if math.isnan(value) else value
