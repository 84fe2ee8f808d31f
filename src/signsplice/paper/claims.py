"""The claims of the paper's text, tables and figures, and how each is judged."""

from __future__ import annotations

from itertools import pairwise

from signsplice.paper import published
from signsplice.paper.layout import short
from signsplice.paper.lines import TableLine
from signsplice.paper.order import Evidence, Finding, Judge, graded, shown
from signsplice.paper.plan import SWEEP

RIVALS = published.RIVALS
ALIKE, DISTORTED = 1.5, 1.5
"""Position errors over LpTransformer's, up to which first frames are alike, and from which later ones are distorted."""


def accuracy(e: Evidence, lpt: str) -> Finding | None:
    """Holds from 0.985 on, which rounds to the printed 0.99."""
    found = e.of(lpt)
    if found is None:
        return None
    value = found[0].score("accuracy")
    facts = {"exact": shown(found[0].score("length_exact")), "equal": shown(found[0].score("accuracy_equal"), 4)}
    return Finding(graded(value >= published.ACCURACY - 0.005), shown(value, 4), facts)


def best_accuracy(e: Evidence, lpt: str) -> Finding | None:
    """Holds if no rival has a higher Accuracy."""
    return _best(e, (lpt, *RIVALS), "accuracy", largest=True, digits=4)


def mse(e: Evidence, lpt: str) -> Finding | None:
    """Holds up to the printed MSE; in part up to the threshold of what viewers see."""
    found = e.of(lpt)
    if found is None:
        return None
    value = found[0].score("mse")
    facts = {"equal": short(found[0].score("mse_equal"))}
    return Finding(graded(round(value, 4) <= published.MSE, value <= published.VISIBLE), short(value), facts)


def others_visible(e: Evidence, lpt: str) -> Finding | None:
    """Holds if the MSE of all three rivals is above the threshold of what viewers see; in part if one is."""
    found = e.of(*RIVALS)
    if found is None:
        return None
    above = [one.score("mse") > published.VISIBLE for one in found]
    return Finding(graded(all(above), any(above)), _each(found, "mse"))


def times_faster(e: Evidence, lpt: str) -> Finding | None:
    """Holds from 4.5 times on, which rounds to the printed 5; in part if it is faster at all."""
    found = e.of(lpt, "transformer")
    if found is None:
        return None
    times = found[1].score("ms_mean") / found[0].score("ms_mean")
    return Finding(graded(times >= published.TIMES_FASTER - 0.5, times > 1.1), f"{times:.1f} times")


def in_real_time(system: str | None, can: bool) -> Judge:
    """Whether a system takes less time for a transition than the transition lasts, or, without ``can``, more."""

    def judged(e: Evidence, lpt: str) -> Finding | None:
        found = e.of(system or lpt)
        if found is None:
            return None
        ms, seen = found[0].score("ms_mean"), found[0].score("frames_ms")
        return Finding(graded((ms < seen) == can), f"{ms:.0f} ms for {seen:.0f} ms of motion")

    return judged


def fastest(e: Evidence, lpt: str) -> Finding | None:
    """Holds if ConvS2S has the shortest time."""
    return _best(e, ("conv-s2s", lpt, "lstm", "transformer"), "ms_mean", largest=False, digits=1)


def slowest(e: Evidence, lpt: str) -> Finding | None:
    """Holds if Transformer has the longest time."""
    return _best(e, ("transformer", lpt, "lstm", "conv-s2s"), "ms_mean", largest=True, digits=1)


def error_and_speed(e: Evidence, lpt: str) -> Finding | None:
    """Holds if it has the least MSE and the shortest time of four; in part for one of both."""
    found = e.of(lpt, *RIVALS)
    if found is None:
        return None
    least, quickest = (min(found, key=lambda one: one.score(name)) for name in ("mse", "ms_mean"))
    both = [least is found[0], quickest is found[0]]
    return Finding(graded(all(both), any(both)), f"least MSE {least.name}, fastest {quickest.name}")


def every_metric(e: Evidence, lpt: str) -> Finding | None:
    """Holds if no rival is better in any metric of table 1; in part for at least three of six."""
    found = e.of(lpt, *RIVALS)
    if found is None:
        return None
    names = [published.SCORES[metric] for metric in published.METRICS]
    best = [all(found[0].score(name) >= other.score(name) for other in found[1:]) for name in names]
    return Finding(graded(all(best), sum(best) >= 3), f"best in {sum(best)} of {len(best)}")


def stable_bleu(e: Evidence, lpt: str) -> Finding | None:
    """Holds if it loses the least from BLEU-1 to BLEU-4, relative to BLEU-1; in part if less than one rival."""
    found = e.of(lpt, *RIVALS)
    if found is None:
        return None
    lost = [1.0 - one.score("bleu-4") / one.score("bleu-1") for one in found]
    less = [lost[0] < other for other in lost[1:]]
    figure = "; ".join(f"{one.name} {one.score('bleu-1'):.3f} to {one.score('bleu-4'):.3f}" for one in found)
    return Finding(graded(all(less), any(less)), figure)


def convs2s_silent(e: Evidence, lpt: str) -> Finding | None:
    """Holds for a PTA without bias below a half; in part below 0.95."""
    found = e.of("conv-s2s")
    if found is None:
        return None
    value = found[0].score("pta_unbiased")
    return Finding(graded(value < 0.5, value < 0.95), f"{value:.3f} without bias, {found[0].score('pta'):.3f} with")


def others_emit(e: Evidence, lpt: str) -> Finding | None:
    """Holds for PTAs without bias of at least 0.98; in part for one of both."""
    found = e.of("lstm", "transformer")
    if found is None:
        return None
    near = [one.score("pta_unbiased") >= 0.98 for one in found]
    return Finding(graded(all(near), any(near)), _each(found, "pta_unbiased") + " without bias")


def others_misplace(e: Evidence, lpt: str) -> Finding | None:
    """Holds if fewer than half of their positions are exact; in part if fewer than of its own."""
    found = e.of(lpt, "lstm", "transformer")
    if found is None:
        return None
    own, others = found[0].score("paa"), [one.score("paa") for one in found[1:]]
    return Finding(graded(max(others) < 0.5, max(others) < own), _each(found, "paa"))


def exact_positions(e: Evidence, lpt: str) -> Finding | None:
    """Holds from a PAA of 0.995 on; in part if so many are within two frames."""
    found = e.of(lpt)
    if found is None:
        return None
    one = found[0]
    figure = f"PTA {shown(one.score('pta'))}, PAA {shown(one.score('paa'))}, within 2 {shown(one.score('within_2'))}"
    facts = {
        "train": shown(one.score("paa_train")),
        "near": shown(one.score("paa_margin_1")),
        "far": shown(one.score("paa_margin_4")),
    }
    return Finding(graded(one.score("paa") >= 0.995, one.score("within_2") >= 0.995), figure, facts)


def best_fr(e: Evidence, lpt: str) -> Finding | None:
    """Holds if fr = 8 has the least MSE and the best Accuracy; in part for one of both."""
    found = _sweep(e, lpt)
    if found is None:
        return None
    by_mse = min(found, key=lambda fr: found[fr].score("mse"))
    by_accuracy = max(found, key=lambda fr: found[fr].score("accuracy"))
    values = [one.score("mse") for one in found.values()]
    figure = f"least MSE at {by_mse}, best Accuracy at {by_accuracy}; MSE {short(min(values))} to {short(max(values))}"
    right = [by_mse == published.BEST_FR, by_accuracy == published.BEST_FR]
    return Finding(graded(all(right), any(right)), figure)


def fr_takes_time(e: Evidence, lpt: str) -> Finding | None:
    """Holds if the time grows with every fr; in part if it is longer for the largest than for the smallest."""
    found = _sweep(e, lpt)
    if found is None:
        return None
    frs = sorted(found)
    times = [found[fr].score("ms_mean") for fr in frs]
    grows = all(a <= b for a, b in pairwise(times))
    figure = f"{times[0]:.1f} ms at {frs[0]}, {times[-1]:.1f} at {frs[-1]}"
    return Finding(graded(grows, times[-1] > times[0]), figure)


def fr_overfits(e: Evidence, lpt: str) -> Finding | None:
    """Holds if validation Accuracy ends more than 0.01 below its best."""
    points = e.accuracies(lpt, 6)
    if len(points) < 2 or not e.with_fr(6, lpt).is_known:
        return None
    fall = max(points) - points[-1]
    return Finding(graded(fall > 0.01), f"{fall:.4f} below its best at the end")


def ablations_converge(e: Evidence, lpt: str) -> Finding | None:
    """Holds if no validation Accuracy changes by 0.005 in the last quarter; in part if one does not."""
    curves = [e.accuracies(system) for system in (lpt, f"{lpt}-wa", f"{lpt}-wc", f"{lpt}-wac")]
    if any(len(points) < 4 for points in curves):
        return None
    rises = [abs(points[-1] - points[3 * len(points) // 4]) for points in curves]
    return Finding(graded(max(rises) < 0.005, min(rises) < 0.005), f"at most {max(rises):.4f} in the last quarter")


def best_ablation(e: Evidence, lpt: str) -> Finding | None:
    """Holds if no ablation has a higher Accuracy."""
    return _best(e, (lpt, f"{lpt}-wa", f"{lpt}-wc", f"{lpt}-wac"), "accuracy", largest=True, digits=4)


def attention_error(e: Evidence, lpt: str) -> Finding | None:
    """Holds if the MSE without attention is larger."""
    found = e.of(lpt, f"{lpt}-wa")
    if found is None:
        return None
    return Finding(graded(found[1].score("mse") > found[0].score("mse")), _each(found, "mse"))


def culling_time(e: Evidence, lpt: str) -> Finding | None:
    """Holds if both ablations take at least twice as long; in part if both take longer."""
    found = e.of(lpt, f"{lpt}-wc", f"{lpt}-wac")
    if found is None:
        return None
    times = [one.score("ms_mean") / found[0].score("ms_mean") for one in found[1:]]
    return Finding(graded(min(times) >= 2.0, min(times) > 1.1), f"{times[0]:.1f} and {times[1]:.1f} times")


def attention_paa(e: Evidence, lpt: str) -> Finding | None:
    """Holds if both ablations without attention have a lower PAA; in part for one of both."""
    return _lower(e, lpt, ("wa", "wac"), "paa")


def culling_bleu(e: Evidence, lpt: str) -> Finding | None:
    """Holds if both ablations without Culling have a lower BLEU-4; in part for one of both."""
    return _lower(e, lpt, ("wc", "wac"), "bleu-4")


def distortion(e: Evidence, lpt: str) -> Finding | None:
    """Holds if first frames of both rivals are alike and later ones distorted; in part for a half of it."""
    found = e.of(lpt, "lstm", "transformer")
    if found is None:
        return None
    first, later = ([one.score(name) for one in found] for name in ("first_frames_error", "later_frames_error"))
    alike = max(first[1:]) <= ALIKE * first[0]
    distorted = [value >= DISTORTED * later[0] for value in later[1:]]
    figure = "; ".join(f"{one.name} {a:.1f} then {b:.1f}" for one, a, b in zip(found, first, later, strict=True))
    return Finding(graded(alike and all(distorted), alike or any(distorted)), figure + " cm")


def missing_frames(e: Evidence, lpt: str) -> Finding | None:
    """Holds if it makes fewer than nine tenths of the true frames."""
    found = e.of("conv-s2s")
    if found is None:
        return None
    ratio, exact = found[0].score("length_ratio"), found[0].score("length_exact")
    return Finding(graded(ratio < 0.9), f"{ratio:.2f} of the true frames; {exact:.3f} of lengths right")


def transformer_error(e: Evidence, lpt: str) -> Finding | None:
    """Holds if its Accuracy is lower than that of LSTM."""
    found = e.of("transformer", "lstm")
    if found is None:
        return None
    return Finding(graded(found[0].score("accuracy") < found[1].score("accuracy")), _each(found, "accuracy"))


def beats_classical(name: str, largest: bool) -> Judge:
    """Whether it is better than every classical method; in part if only than those that are given nothing."""

    def judged(e: Evidence, lpt: str) -> Finding | None:
        found, nothing, told = e.of(lpt), e.classical("nothing"), e.classical("positions and length")
        if found is None or not nothing or not told:
            return None
        sign = 1.0 if largest else -1.0
        best, best_told = (max(rows, key=lambda one: sign * one.score(name)) for rows in (nothing, told))
        own = sign * found[0].score(name)
        figure = "; ".join(f"{one.name} {one.cell(name)}" for one in (found[0], best, best_told)) + " (given the truth)"
        return Finding(graded(own > sign * best_told.score(name), own > sign * best.score(name)), figure)

    return judged


def classical_time(e: Evidence, lpt: str) -> Finding | None:
    """Holds if every classical method that is given nothing takes longer; in part if one does."""
    found, nothing = e.of(lpt), e.classical("nothing")
    if found is None or not nothing:
        return None
    times = [one.score("ms_mean") for one in nothing]
    figure = f"{min(times):.1f} to {max(times):.1f} ms, {found[0].name} {found[0].score('ms_mean'):.1f}"
    own = found[0].score("ms_mean")
    return Finding(graded(min(times) > own, max(times) > own), figure)


def concurrent(e: Evidence, lpt: str) -> Finding | None:
    """Holds if BLEU-4 in one pass is at most 0.01 lower; in part at most 0.1."""
    found = e.of(lpt, published.IN_ONE_PASS[lpt])
    if found is None:
        return None
    a, b = (one.score("bleu-4") for one in found)
    return Finding(graded(b >= a - 0.01, b >= a - 0.1), f"BLEU-4 {b:.3f} in one pass, {a:.3f} one by one")


def _best(e: Evidence, systems: tuple[str, ...], name: str, largest: bool, digits: int) -> Finding | None:
    """Whether the first system has the largest (or least) value."""
    found = e.of(*systems)
    if found is None:
        return None
    best = (max if largest else min)(found, key=lambda one: one.score(name))
    figure = "; ".join(f"{one.name} {one.cell(name, digits)}" for one in found)
    return Finding(graded(best is found[0]), figure, {"other": best.name})


def _lower(e: Evidence, lpt: str, ablations: tuple[str, ...], name: str) -> Finding | None:
    """Whether ablations have a lower score than the whole system."""
    found = e.of(lpt, *(f"{lpt}-{ablation}" for ablation in ablations))
    if found is None:
        return None
    lower = [one.score(name) < found[0].score(name) for one in found[1:]]
    return Finding(graded(all(lower), any(lower)), _each(found, name))


def _each(found: list[TableLine], name: str) -> str:
    return "; ".join(f"{one.name} {one.cell(name, 'short' if name == 'mse' else 3)}" for one in found)


def _sweep(e: Evidence, lpt: str) -> dict[int, TableLine] | None:
    found = {fr: one for fr in SWEEP if (one := e.with_fr(fr, lpt)).is_known}
    return found if len(found) > 2 and published.BEST_FR in found else None


JUDGES: dict[str, Judge] = {
    "accuracy": accuracy,
    "best_accuracy": best_accuracy,
    "mse": mse,
    "others_visible": others_visible,
    "times_faster": times_faster,
    "fastest": fastest,
    "slowest": slowest,
    "error_and_speed": error_and_speed,
    "every_metric": every_metric,
    "stable_bleu": stable_bleu,
    "convs2s_silent": convs2s_silent,
    "others_emit": others_emit,
    "others_misplace": others_misplace,
    "exact_positions": exact_positions,
    "best_fr": best_fr,
    "fr_takes_time": fr_takes_time,
    "fr_overfits": fr_overfits,
    "ablations_converge": ablations_converge,
    "best_ablation": best_ablation,
    "attention_error": attention_error,
    "culling_time": culling_time,
    "attention_paa": attention_paa,
    "culling_bleu": culling_bleu,
    "distortion": distortion,
    "missing_frames": missing_frames,
    "transformer_error": transformer_error,
    "classical_time": classical_time,
    "concurrent": concurrent,
    "real_time": in_real_time(None, can=True),
    "transformer_late": in_real_time("transformer", can=False),
    "beats_classical_bleu": beats_classical("bleu-4", largest=True),
    "beats_classical_velocity": beats_classical("velocity_error", largest=False),
}
"""What claims.toml names."""
