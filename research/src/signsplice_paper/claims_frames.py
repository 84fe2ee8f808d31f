"""The claims of the paper on the frames of a transition, and on classical methods."""

from __future__ import annotations

from signsplice_paper import published
from signsplice_paper.comparing import better, worst
from signsplice_paper.verdicts import Evidence, Finding, Judge, graded, known, shown

ALIKE, DISTORTED = 1.5, 1.5
"""Position errors over LpTransformer's, up to which first frames are alike, and from which later ones are distorted."""


def distortion(e: Evidence, lpt: str) -> Finding:
    """Holds if first frames of both rivals are alike and later ones distorted; in part for a half of it."""
    found = e.of(lpt, "lstm", "transformer")
    first, later = ([known(one, name) for one in found] for name in ("first_frames_error", "later_frames_error"))
    alike = max(first[1:]) <= ALIKE * first[0]
    distorted = [value >= DISTORTED * later[0] for value in later[1:]]
    figure = "; ".join(f"{one.name} {a:.1f} then {b:.1f}" for one, a, b in zip(found, first, later, strict=True))
    facts = {
        name: " and ".join(f"{value / values[0]:.2f}" for value in values[1:])
        for name, values in (("first", first), ("later", later))
    }
    return Finding(graded(alike and all(distorted), alike or any(distorted)), figure + " cm", facts)


def missing_frames(e: Evidence, lpt: str) -> Finding:
    """Holds if it makes fewer than nine tenths of the true frames."""
    (one,) = e.of("conv-s2s")
    ratio = known(one, "length_ratio")
    return Finding(
        graded(ratio < 0.9), f"{ratio:.2f} of the true frames; {shown(one.score('length_exact'))} of lengths right"
    )


def beats_classical_bleu(e: Evidence, lpt: str) -> Finding:
    """Holds if BLEU-4 is as high as that of every classical method that is given nothing."""
    return _beats_classical(e, lpt, "bleu-4", lower=False)


def beats_classical_velocity(e: Evidence, lpt: str) -> Finding:
    """Holds if the error of the joints' velocities is as small as that of every classical method given nothing."""
    return _beats_classical(e, lpt, "velocity_error", lower=True)


def _beats_classical(e: Evidence, lpt: str, name: str, lower: bool) -> Finding:
    (own,) = e.of(lpt)
    nothing, told = (e.classical(given, own) for given in ("nothing", "positions and length"))
    pick = min if lower else max
    best, best_told = (pick(found, key=lambda one: known(one, name)) for found in (nothing, told))
    verdict = worst([better(own, other, name, lower) for other in nothing])
    figure = "; ".join(f"{one.name} {one.cell(name)}" for one in (own, best))
    return Finding(verdict, figure, {"told": f"{best_told.name} {best_told.cell(name)}"})


def concurrent(e: Evidence, lpt: str) -> Finding:
    """Holds if BLEU-4 in one pass is at most 0.01 lower; in part at most 0.1."""
    a, b = (known(one, "bleu-4") for one in e.of(lpt, published.IN_ONE_PASS[lpt]))
    return Finding(graded(b >= a - 0.01, b >= a - 0.1), f"BLEU-4 {b:.3f} in one pass, {a:.3f} one by one")


JUDGES: dict[str, Judge] = {
    "distortion": distortion,
    "missing_frames": missing_frames,
    "beats_classical_bleu": beats_classical_bleu,
    "beats_classical_velocity": beats_classical_velocity,
    "concurrent": concurrent,
}
