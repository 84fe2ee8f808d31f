"""The claims of the paper on fr and on its ablations, apart from time."""

from __future__ import annotations

from collections.abc import Sequence

from signsplice_paper import published
from signsplice_paper.comparing import above, best, better, each, worst
from signsplice_paper.layout import short
from signsplice_paper.plan import SWEEP
from signsplice_paper.verdicts import Evidence, Finding, Judge, NotTestedError, graded, known, together

STEADY = 0.005
"""Change of validation Accuracy in the last quarter of a training, below which it has converged."""
FALL = 0.01
"""Fall of validation Accuracy from its best, above which a network overfits."""


def best_fr(e: Evidence, lpt: str) -> Finding:
    """Holds if no other fr has less MSE or better Accuracy than 8; in part for one of both."""
    found = e.by_fr(lpt, SWEEP)
    ours = found.pop(published.BEST_FR, None)
    if ours is None or len(found) < 2:
        raise NotTestedError("fewer than three values of fr")
    verdicts = [
        worst([better(ours, other, name, lower) for other in found.values()])
        for name, lower in (("mse", True), ("accuracy", False))
    ]
    every = {published.BEST_FR: ours, **found}
    least = min(every, key=lambda fr: known(every[fr], "mse"))
    most = max(every, key=lambda fr: known(every[fr], "accuracy"))
    errors = [known(one, "mse") for one in every.values()]
    facts = {"low": short(min(errors)), "high": short(max(errors)), "of": ", ".join(map(str, sorted(every)))}
    return Finding(together(verdicts), f"least MSE at {least}, best Accuracy at {most}", facts)


def fr_overfits(e: Evidence, lpt: str) -> Finding:
    """Holds if validation Accuracy of fr = 6 ends more than ``FALL`` below its best with every seed; in part if it does
    with one.
    """
    if not e.by_fr(lpt, (6,)):
        raise NotTestedError("not trained yet: fr = 6")
    falls = [max(points) - points[-1] for points in e.accuracies(lpt, 6)]
    return Finding(graded(min(falls) > FALL, max(falls) > FALL), f"ends at most {max(falls):.4f} below its best")


def ablations_converge(e: Evidence, lpt: str) -> Finding:
    """Holds if no validation Accuracy changes by ``STEADY`` in the last quarter, whatever the seed; in part if that of
    one system does not.
    """
    systems = [e.accuracies(system) for system in _ablations(lpt, "wa", "wc", "wac")]
    changes = [max(abs(points[-1] - points[(len(points) - 1) * 3 // 4]) for points in seeds) for seeds in systems]
    verdict = graded(max(changes) < STEADY, min(changes) < STEADY)
    return Finding(verdict, f"at most {max(changes):.4f} in the last quarter")


def best_ablation(e: Evidence, lpt: str) -> Finding:
    """Holds if no ablation has a higher Accuracy."""
    return best(e, _ablations(lpt, "wa", "wc", "wac"), "accuracy", alike=True)


def attention_error(e: Evidence, lpt: str) -> Finding:
    """Holds if the MSE without attention is larger."""
    whole, without = found = e.of(*_ablations(lpt, "wa"), alike=True)
    facts = {"paa": each(found, "paa"), "pta": each(found, "pta")}
    return Finding(above(without, whole, "mse"), each(found, "mse"), facts)


def attention_paa(e: Evidence, lpt: str) -> Finding:
    """Holds if both ablations without attention have a lower PAA; in part for one of both."""
    return _lower(e, _ablations(lpt, "wa", "wac"), "paa")


def culling_bleu(e: Evidence, lpt: str) -> Finding:
    """Holds if both ablations without Culling have a lower BLEU-4; in part for one of both."""
    return _lower(e, _ablations(lpt, "wc", "wac"), "bleu-4")


def _ablations(lpt: str, *kinds: str) -> tuple[str, ...]:
    return (lpt, *(f"{lpt}-{kind}" for kind in kinds))


def _lower(e: Evidence, systems: Sequence[str], name: str) -> Finding:
    """Whether the others have a lower score than the first."""
    whole, *others = found = e.of(*systems, alike=True)
    verdicts = [above(whole, other, name) for other in others]
    return Finding(together(verdicts), each(found, name))


JUDGES: dict[str, Judge] = {
    "best_fr": best_fr,
    "fr_overfits": fr_overfits,
    "ablations_converge": ablations_converge,
    "best_ablation": best_ablation,
    "attention_error": attention_error,
    "attention_paa": attention_paa,
    "culling_bleu": culling_bleu,
}
