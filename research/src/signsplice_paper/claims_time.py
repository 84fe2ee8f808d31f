"""The claims of the paper on time, all measured on one thread of a CPU. A ratio below ``TIME_BAND`` decides nothing."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from signsplice_paper import published
from signsplice_paper.comparing import TIME_BAND, best, longer, milliseconds, worst
from signsplice_paper.lines import TableLine
from signsplice_paper.plan import SWEEP
from signsplice_paper.verdicts import HOLDS, Evidence, Finding, Judge, NotTestedError, graded, known, together


def times_faster(e: Evidence, lpt: str) -> Finding:
    """Holds from 4.5 times on, which rounds to the printed 5; in part if it is faster."""
    own, other = milliseconds(e.of(lpt, "transformer"))
    times = other / own
    return Finding(graded(times >= published.TIMES_FASTER - 0.5, longer(times) == HOLDS), f"{times:.1f} times")


def real_time(e: Evidence, lpt: str) -> Finding:
    """Holds if a transition takes less time on a CPU than it lasts. A slower CPU says nothing of the claim's GPU."""
    (one,) = found = e.of(lpt)
    (ms,), seen = milliseconds(found), known(one, "frames_ms")
    if ms >= seen:
        raise NotTestedError(f"needs a GPU: {ms:.0f} ms on one thread of a CPU")
    return Finding(HOLDS, f"{ms:.1f} ms for {seen:.0f} ms of motion")


def transformer_late(e: Evidence, lpt: str) -> Finding:
    """Holds if Transformer takes longer than the transition lasts."""
    (one,) = found = e.of("transformer")
    (ms,), seen = milliseconds(found), known(one, "frames_ms")
    return Finding(longer(ms / seen), f"{ms:.1f} ms for {seen:.0f} ms of motion")


def fastest(e: Evidence, lpt: str) -> Finding:
    """Holds if ConvS2S has the shortest time."""
    found = e.of("conv-s2s", lpt, "lstm", "transformer")
    own, *others = milliseconds(found)
    return Finding(longer(min(others) / own), _times(found), {"other": found[1:][others.index(min(others))].name})


def slowest(e: Evidence, lpt: str) -> Finding:
    """Holds if Transformer has the longest time."""
    found = e.of("transformer", lpt, "lstm", "conv-s2s")
    own, *others = milliseconds(found)
    return Finding(longer(own / max(others)), _times(found), {"other": found[1:][others.index(max(others))].name})


def error_and_speed(e: Evidence, lpt: str) -> Finding:
    """Holds if it has the least MSE and the shortest time of four; in part for one of both."""
    systems = (lpt, *published.RIVALS)
    found = e.of(*systems)
    own, *others = times = milliseconds(found)
    verdicts = [best(e, systems, "mse", lower=True).verdict, longer(min(others) / own)]
    least = min(found, key=lambda one: known(one, "mse"))
    figure = f"least MSE {least.name}, fastest {found[times.index(min(times))].name}"
    return Finding(together(verdicts), figure)


def fr_takes_time(e: Evidence, lpt: str) -> Finding:
    """Holds if the largest fr takes longer than the smallest and has not the least MSE alone; in part for one of
    both.
    """
    found = e.by_fr(lpt, SWEEP)
    if len(found) < 3:
        raise NotTestedError("fewer than three values of fr")
    frs = sorted(found)
    lines = [found[fr] for fr in frs]
    times = milliseconds(lines)
    errors = [round(known(one, "mse"), 4) for one in lines]
    need_not = graded(min(errors[:-1]) <= errors[-1])
    falls = sum(b < a for a, b in pairwise(times))
    figure = f"{times[0]:.1f} ms at {frs[0]}, {times[-1]:.1f} at {frs[-1]}"
    facts = {"falls": f"{falls} of {len(times) - 1}"}
    return Finding(together([longer(times[-1] / times[0]), need_not]), figure, facts)


def culling_time(e: Evidence, lpt: str) -> Finding:
    """Holds if both ablations take at least twice as long; in part if one takes longer."""
    own, *others = milliseconds(e.of(lpt, f"{lpt}-wc", f"{lpt}-wac", alike=True))
    times = [other / own for other in others]
    verdict = graded(min(times) >= 2.0, max(times) >= TIME_BAND)
    return Finding(verdict, f"{times[0]:.1f} and {times[1]:.1f} times")


def classical_time(e: Evidence, lpt: str) -> Finding:
    """Holds if every classical method that is given nothing takes longer; in part if one does."""
    (one,) = e.of(lpt)
    own, *others = milliseconds([one, *e.classical("nothing", one)])
    verdicts = [longer(other / own) for other in others]
    verdict = worst(verdicts) if HOLDS not in verdicts else together(verdicts)
    return Finding(verdict, f"{min(others):.1f} to {max(others):.1f} ms, {one.name} {own:.1f}")


def _times(found: Sequence[TableLine]) -> str:
    return "; ".join(f"{one.name} {one.cell('ms_mean', 1)}" for one in found) + " ms"


JUDGES: dict[str, Judge] = {
    "times_faster": times_faster,
    "real_time": real_time,
    "transformer_late": transformer_late,
    "fastest": fastest,
    "slowest": slowest,
    "error_and_speed": error_and_speed,
    "fr_takes_time": fr_takes_time,
    "culling_time": culling_time,
    "classical_time": classical_time,
}
