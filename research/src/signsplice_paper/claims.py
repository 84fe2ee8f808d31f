"""The claims of the paper's text and table 1 on scores, how each is judged, and the judges of all claims by name."""

from __future__ import annotations

import math

from signsplice_paper import claims_culling, claims_frames, claims_time, metrics, published
from signsplice_paper.comparing import above, best, better, each, rivals_score
from signsplice_paper.layout import short
from signsplice_paper.verdicts import HOLDS, Evidence, Finding, Judge, graded, known, shown

EXACT = 0.995
"""From here on a share of pairs counts as all of them; the paper prints 0.999."""


def accuracy(e: Evidence, lpt: str) -> Finding:
    """Holds from 0.985 on, which rounds to the printed 0.99."""
    (one,) = e.of(lpt)
    value = known(one, "accuracy")
    facts = {"exact": shown(one.score("length_exact")), "equal": shown(one.score("accuracy_equal"), 4)}
    return Finding(graded(value >= published.ACCURACY - 0.005), shown(value, 4), facts)


def best_accuracy(e: Evidence, lpt: str) -> Finding:
    """Holds if no rival has a higher Accuracy."""
    return best(e, (lpt, *published.RIVALS), "accuracy")


def mse(e: Evidence, lpt: str) -> Finding:
    """Holds up to the printed MSE; in part up to the threshold of what viewers see."""
    (one,) = e.of(lpt)
    value = known(one, "mse")
    ends = [short(one.score(f"mse@{cost:g}")) for cost in (metrics.FRAME_COSTS[0], metrics.FRAME_COSTS[-1])]
    facts = {"equal": short(one.score("mse_equal")), "low": ends[0], "high": ends[1]}
    return Finding(graded(round(value, 4) <= published.MSE, value <= published.VISIBLE), short(value), facts)


def others_visible(e: Evidence, lpt: str) -> Finding:
    """Holds if the MSE of all three rivals is at least twice the threshold of what viewers see, whatever a frame too
    many or too few costs; in part if one is above the threshold at any of these costs.
    """
    found = e.of(*published.RIVALS)
    values = [known(one, f"mse@{cost:g}") for one in found for cost in metrics.FRAME_COSTS]
    facts = {"low": short(min(values)), "high": short(max(values))}
    verdict = graded(min(values) >= 2.0 * published.VISIBLE, max(values) > published.VISIBLE)
    return Finding(verdict, each(found, "mse"), facts)


def every_metric(e: Evidence, lpt: str) -> Finding:
    """Holds if it is as good as every rival in all metrics of table 1; in part in at least three of six. A rival
    without a score, such as the PAA of one that emits no token, is not better.
    """
    own, *others = e.of(lpt, *published.RIVALS)
    best_in = 0
    for name in published.SCORES.values():
        theirs = rivals_score(name, lpt)
        scored = [other for other in others if not math.isnan(other.score(theirs))]
        best_in += all(better(own, other, name, theirs=theirs) == HOLDS for other in scored)
    n = len(published.METRICS)
    return Finding(graded(best_in == n, best_in >= n / 2), f"best in {best_in} of {n}")


def stable_bleu(e: Evidence, lpt: str) -> Finding:
    """Holds if it loses the least from BLEU-1 to BLEU-4, relative to BLEU-1; in part if less than one rival."""
    found = e.of(lpt, *published.RIVALS)
    scores = [(known(one, "bleu-1"), known(one, "bleu-4")) for one in found]
    lost = [round(1.0 - last / first, 3) if first > 0.0 else 1.0 for first, last in scores]
    less = [lost[0] < other for other in lost[1:]]
    figure = "; ".join(f"{one.name} {a:.3f} to {b:.3f}" for one, (a, b) in zip(found, scores, strict=True))
    return Finding(graded(all(less), any(less)), figure)


def convs2s_silent(e: Evidence, lpt: str) -> Finding:
    """Holds for a PTA without bias below a half; in part below 0.95."""
    (one,) = e.of("conv-s2s")
    value = known(one, "pta_unbiased")
    return Finding(graded(value < 0.5, value < 0.95), f"{value:.3f} without bias, {shown(one.score('pta'))} with")


def others_emit(e: Evidence, lpt: str) -> Finding:
    """Holds for PTAs without bias of at least 0.98; in part for one of both."""
    found = e.of("lstm", "transformer")
    near = [known(one, "pta_unbiased") >= 0.98 for one in found]
    return Finding(graded(all(near), any(near)), each(found, "pta_unbiased") + " without bias")


def others_misplace(e: Evidence, lpt: str) -> Finding:
    """Holds if fewer than half of the positions of both are exact; in part if both have fewer than its own."""
    own, *others = e.of(lpt, "lstm", "transformer")
    theirs = rivals_score("paa", lpt)
    fewer = all(above(own, other, "paa", theirs) == HOLDS for other in others)
    figure = f"{each(others, theirs)}; {each([own], 'paa')}"
    return Finding(graded(all(known(other, theirs) < 0.5 for other in others), fewer), figure)


def exact_positions(e: Evidence, lpt: str) -> Finding:
    """Holds from a PTA and a PAA of ``EXACT`` on; in part for one of both, or if so many of all pairs have positions
    within two frames.
    """
    (one,) = e.of(lpt)
    pta, paa, near = (known(one, name) for name in ("pta", "paa", "within_2"))
    ends = [one.score(name) for name in ("paa_margin_1", "paa_margin_4")]
    margins = "not known" if any(map(math.isnan, ends)) else f"{ends[0]:.3f} to {ends[1]:.3f}"
    train = one.score("paa_train")
    facts = {"train": "not known" if math.isnan(train) else shown(train), "margins": margins}
    verdict = graded(min(pta, paa) >= EXACT, max(pta, paa, pta * near) >= EXACT)
    return Finding(verdict, f"PTA {pta:.3f}, PAA {paa:.3f}, within 2 frames {near:.3f}", facts)


def transformer_error(e: Evidence, lpt: str) -> Finding:
    """Holds if its Accuracy is lower than that of LSTM."""
    found = e.of("transformer", "lstm")
    return Finding(above(found[1], found[0], "accuracy"), each(found, "accuracy"))


JUDGES: dict[str, Judge] = {
    "accuracy": accuracy,
    "best_accuracy": best_accuracy,
    "mse": mse,
    "others_visible": others_visible,
    "every_metric": every_metric,
    "stable_bleu": stable_bleu,
    "convs2s_silent": convs2s_silent,
    "others_emit": others_emit,
    "others_misplace": others_misplace,
    "exact_positions": exact_positions,
    "transformer_error": transformer_error,
    **claims_time.JUDGES,
    **claims_culling.JUDGES,
    **claims_frames.JUDGES,
}
"""What claims.toml names."""
