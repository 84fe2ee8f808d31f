"""How scores and times of two systems are compared, so that no claim turns on less than was measured.

Scores are compared with the digits that the paper prints; equal ones are as good, as in its tables. With several seeds
a difference up to their spread decides nothing. Times of a machine differ from run to run: a ratio below ``TIME_BAND``
decides nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

from signsplice_paper import published
from signsplice_paper.lines import SHORT, TableLine
from signsplice_paper.verdicts import FAILS, HOLDS, IN_PART, Evidence, Finding, NotTestedError, comparable, known

TIME_BAND = 1.3
"""Ratio of two times from which on they differ."""
DIGITS = {"mse": 4}
"""Digits in which scores are compared; three where none are stated."""


def better(one: TableLine, other: TableLine, name: str, lower: bool = False, theirs: str = "") -> str:
    """Whether a line has the larger score, or with ``lower`` the lesser one: holds if it is as good or better, in part
    if the seeds spread as much as the two differ, else it does not hold.

    theirs: the name of the other line's score, if it is another.
    """
    gain = _gain(one, other, name, theirs or name) * (-1 if lower else 1)
    return IN_PART if _is_noise(gain, one, other, name, theirs or name) else HOLDS if gain >= 0.0 else FAILS


def above(one: TableLine, other: TableLine, name: str, theirs: str = "") -> str:
    """Whether a line has the larger score, in the same way; here equal scores do not hold."""
    gain = _gain(one, other, name, theirs or name)
    return IN_PART if _is_noise(gain, one, other, name, theirs or name) else HOLDS if gain > 0.0 else FAILS


def _gain(one: TableLine, other: TableLine, name: str, theirs: str) -> float:
    digits = DIGITS.get(name, 3)
    return round(round(known(one, name), digits) - round(known(other, theirs), digits), digits)


def _is_noise(gain: float, one: TableLine, other: TableLine, name: str, theirs: str) -> bool:
    spread = max(max(values) - min(values) for values in (one.values(name), other.values(theirs)))
    return 0.0 < abs(gain) <= spread


def best(e: Evidence, systems: Sequence[str], name: str, lower: bool = False, alike: bool = False) -> Finding:
    """Whether the first system is as good as every other in a score; the fact ``other`` is the best of the others."""
    found = e.of(*systems, alike=alike)
    verdicts = [better(found[0], other, name, lower) for other in found[1:]]
    top = (min if lower else max)(found[1:], key=lambda one: known(one, name))
    return Finding(worst(verdicts), each(found, name), {"other": top.name})


def worst(verdicts: Sequence[str]) -> str:
    """The least favourable of some verdicts."""
    return next((verdict for verdict in (FAILS, IN_PART) if verdict in verdicts), HOLDS)


def each(found: Sequence[TableLine], name: str) -> str:
    """The names of lines, each with its score."""
    return "; ".join(f"{one.name} {one.cell(name, SHORT if name == 'mse' else 3)}" for one in found)


def rivals_score(name: str, lpt: str) -> str:
    """The name of a rival's score that is compared with ``name`` of ``lpt``: where that follows the print, which has
    no bias of the tokens, PTA and PAA of rivals are without it too.
    """
    return f"{name}_unbiased" if lpt == published.PRINTED and name in ("pta", "paa") else name


def milliseconds(found: Sequence[TableLine]) -> list[float]:
    """Mean time of a pair, ms, of each line. Raises ``NotTestedError`` for times of several machines."""
    comparable(found)
    if len({row.machine for one in found for row in one.rows}) > 1:
        raise NotTestedError("times of several machines")
    return [known(one, "ms_mean") for one in found]


def longer(ratio: float) -> str:
    """Whether a time is longer than another, from their ratio."""
    return HOLDS if ratio >= TIME_BAND else IN_PART if ratio > 1.0 / TIME_BAND else FAILS
