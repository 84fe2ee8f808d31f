"""True splices: words that were recorded apart, joined by every method, and looked at where they meet.

Frames hidden in one take tell how well a gap is filled whose two ends belong together. At a true splice they do not:
each word's hands come from rest or go there. There is no true motion to compare with, so what is measured is what a
viewer would stumble over: jumps of speed and jerk at the seam, arms that drop between words, signs cut into, hands
that pass through the body.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.errors import InputError
from signsplice.evaluation.stitcher import stitch
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.rig import metrics, proportions
from signsplice.rig.arms import Arms, arm_joints, arms
from signsplice.splicing.cut import CUTTERS, DEFAULT_CUTTER
from signsplice.splicing.duration import DEFAULT_DURATION
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.learned import FLUENT, NAME
from signsplice.splicing.methods import choose
from signsplice.splicing.seam import DEEP_M
from signsplice.splicing.transition import DEFAULT_TRANSITION, TRANSITIONS
from signsplice.synth import notation, planner
from signsplice.synth.phonology import Sign
from signsplice.synth.planner import IsolatedWord
from signsplice.synth.rng import stream
from signsplice.synth.signer import HANGING, RESTS, STANDARD

Float = NDArray[np.float64]
Progress = Callable[[int, int], None]

AROUND = 8
"""Frames of each sign that are looked at beside the transition."""
DOWN_FRACTION = 0.15
"""An arm is down where it has risen by less than this share of its way from rest to the highest it comes."""
STITCHER = "stitcher"


@dataclass(frozen=True)
class SeamMeasurement:
    """A seam of two words: seconds from the last frame kept of the one to the first of the other; velocity jump (m/s),
    peak speed (m/s) and jerk ratio of the wrists; frames between the two strokes in which both arms are down; whether
    both strokes are whole; how deep a hand lies in the body in the transition, m, None where there are only points.
    """

    seconds: float
    velocity_jump: float
    peak_speed: float
    jerk_ratio: float
    arms_down: int
    whole: bool
    depth: float | None


@dataclass(frozen=True)
class SeamRow:
    """A method on ``n_joins`` seams: medians, but for arms_down (mean frames a seam), whole and deep (shares of seams)
    and deepest (m).
    """

    method: str
    n_joins: int
    seconds: float
    velocity_jump: float
    peak_speed: float
    jerk_ratio: float
    arms_down: float
    whole: float
    deep: float | None
    deepest: float | None


def signature(rest: str = HANGING) -> str:
    """What the numbers were measured by, with how the signer rests."""
    signer = "standard-signer" + ("" if rest == HANGING else f",rest:{rest}")
    return (
        f"joins|words:everyday,{signer},drawn:once|around:{AROUND}|{metrics.VELOCITY_JUMP}|{metrics.JERK_RATIO}"
        f"|arms-down:{DOWN_FRACTION:g}-of-rise,between-strokes|whole:first-to-last-movement|deep:{1e3 * DEEP_M:g}mm"
    )


def pairs(
    n_pairs: int, signs: Sequence[Sign] | None = None, rest: str = HANGING
) -> list[tuple[IsolatedWord, IsolatedWord]]:
    """``n_pairs`` pairs of different words of the standard signer, who rests as told, drawn once and for all; of those
    that ship by default. Raises ``InputError`` for a rest that there is not.
    """
    if rest not in RESTS:
        raise InputError(f"no rest {rest!r}, expected one of {', '.join(RESTS)}")
    who = replace(STANDARD, rest=rest)
    told = list(notation.everyday().values()) if signs is None else signs
    rng = stream("joins", len(told), n_pairs)
    drawn = [rng.choice(len(told), 2, replace=False).tolist() for _ in range(n_pairs)]
    made = {k: planner.isolated(told[k], who) for k in sorted({k for pair in drawn for k in pair})}
    return [(made[p], made[q]) for p, q in drawn]


def compared_methods(bundle: str | Path | None = None) -> dict[str, SpliceOptions]:
    """The methods that are compared: every classical cutter with Hermite, every classical transition with the classical
    default cutter, Hermite with body sense; and learned ones of a bundle, by default that which ships, where it can be
    read: all of them, and each part alone. Raises ``InputError`` for a bundle that is named and cannot be read.
    """
    plain = SpliceOptions(DEFAULT_CUTTER, DEFAULT_TRANSITION, DEFAULT_DURATION, avoid_collisions=False)
    out = {f"{name} + {DEFAULT_TRANSITION}": replace(plain, cutter=name) for name in CUTTERS}
    out |= {f"{DEFAULT_CUTTER} + {name}": replace(plain, transition=name) for name in TRANSITIONS}
    out |= {f"{DEFAULT_CUTTER} + {DEFAULT_TRANSITION}, body sense": replace(plain, avoid_collisions=True)}
    if choose(bundle=bundle).bundle is not None:
        own = SpliceOptions(NAME, NAME, NAME, bundle)
        out |= {f"{DEFAULT_CUTTER} + {NAME}": replace(plain, transition=NAME, bundle=bundle)}
        out |= {f"{NAME} + {DEFAULT_TRANSITION}": replace(own, transition=DEFAULT_TRANSITION, avoid_collisions=False)}
        out |= {f"{FLUENT} + {NAME}": replace(own, cutter=FLUENT, avoid_collisions=False)}
        out |= {f"{NAME} + {NAME}": replace(own, avoid_collisions=False), f"{NAME} + {NAME}, body sense": own}
    return out


def compare(
    words: Sequence[tuple[IsolatedWord, IsolatedWord]],
    methods: dict[str, SpliceOptions],
    progress: Progress | None = None,
) -> list[SeamRow]:
    """Every method on every pair of words, and the stitcher."""
    rows = []
    for done, (name, options) in enumerate([*methods.items(), (STITCHER, None)], 1):
        joins = [measure_stitched(p, q) if options is None else measure_spliced(p, q, options) for p, q in words]
        rows.append(_row(name, joins))
        if progress is not None:
            progress(done, len(methods) + 1)
    return rows


def measure_spliced(before: IsolatedWord, after: IsolatedWord, options: SpliceOptions) -> SeamMeasurement:
    """A seam as ``splice`` makes it."""
    result = splice([before.clip, after.clip], options)
    (seam,) = result.seams
    first, stop = next((s.output for s in result.spans if s.kind == "transition"), (seam.pre_frame + 1,) * 2)
    depth, _ = collision.hand_penetration(result.clip.skeleton, *kinematics.forward(result.clip[first - 1 : stop + 1]))
    metres = proportions.sizes(result.clip.skeleton).unit.metres
    inside = depth[1:-1] if len(depth) > 2 else depth
    wrists = kinematics.forward(result.clip, _wrists(result.clip))[1]
    kept = (0, seam.pre_frame + 1), (seam.post_frame, len(after))
    return _measure(wrists, (first, stop), before, after, kept, max(0.0, float(inside.max()) * metres))


def measure_stitched(before: IsolatedWord, after: IsolatedWord) -> SeamMeasurement:
    """A seam as the stitcher makes it."""
    made = stitch(before.clip, after.clip)
    wrists = made.positions[:, _wrists(before.clip)]
    return _measure(wrists, (made.first, made.stop), before, after, (made.kept_before, made.kept_after), None)


def _measure(
    wrists: Float,
    gap: tuple[int, int],
    before: IsolatedWord,
    after: IsolatedWord,
    kept: tuple[tuple[int, int], tuple[int, int]],
    depth: float | None,
) -> SeamMeasurement:
    first, stop = gap
    low = max(0, first - AROUND)
    window = wrists[low : stop + AROUND] * proportions.sizes(before.clip.skeleton).unit.metres
    fps, at, end = before.clip.fps, first - low, stop - low
    return SeamMeasurement(
        seconds=(stop - first) / fps,
        velocity_jump=metrics.velocity_jump(window, at, end, fps),
        peak_speed=metrics.peak_speed(window, at, end, fps),
        jerk_ratio=metrics.jerk_ratio(window, at, end),
        arms_down=_down(before, after, kept),
        whole=_whole(before, *kept[0]) and _whole(after, *kept[1]),
        depth=depth,
    )


def _whole(word: IsolatedWord, first: int, stop: int) -> bool:
    """Whether frames [first, stop) hold all movements of the sign, from first begin to last end, or a frame of its only
    posture.
    """
    events = word.events
    if events.first is None or not events.passes:
        return max(first, events.start) < min(stop, events.end + 1)
    return first <= events.first[0] and events.passes[-1][1] < stop


def _down(before: IsolatedWord, after: IsolatedWord, kept: tuple[tuple[int, int], tuple[int, int]]) -> int:
    """Frames kept between the two strokes in which both arms are down."""
    (_, stop), (first, _) = kept
    return int(_low(arms(before.clip))[before.events.end + 1 : stop].sum()) + int(
        _low(arms(after.clip))[first : after.events.start].sum()
    )


def _low(seen: Arms) -> NDArray[np.bool_]:
    reach = seen.lift.max(axis=1)
    rest = min(reach[0], reach[-1])
    return np.asarray(reach < rest + DOWN_FRACTION * (reach.max() - rest))


def _wrists(clip: Clip) -> list[int]:
    known = arm_joints(clip.skeleton)
    return [known[2], known[5]]


def _row(name: str, joins: Sequence[SeamMeasurement]) -> SeamRow:
    depths = [join.depth for join in joins if join.depth is not None]

    def middle(field: str) -> float:
        return float(np.nanmedian([getattr(join, field) for join in joins]))

    return SeamRow(
        method=name,
        n_joins=len(joins),
        seconds=middle("seconds"),
        velocity_jump=middle("velocity_jump"),
        peak_speed=middle("peak_speed"),
        jerk_ratio=middle("jerk_ratio"),
        arms_down=float(np.mean([join.arms_down for join in joins])),
        whole=float(np.mean([join.whole for join in joins])),
        deep=float(np.mean(np.array(depths) > DEEP_M)) if depths else None,
        deepest=max(depths) if depths else None,
    )


def table(rows: Sequence[SeamRow], rest: str = HANGING) -> list[str]:
    """The rows as Markdown, with their signature."""
    head = (
        *("method", "seconds", "velocity jump, m/s", "peak, m/s", "jerk ratio"),
        *("arms down, frames", "strokes whole", "deep in the body", "deepest, mm"),
    )
    lines = [f"`{signature(rest)}`", "", "| " + " | ".join(head) + " |", "| --- |" + " --- |" * (len(head) - 1)]
    for r in rows:
        body = (
            ("-", "-") if r.deep is None or r.deepest is None else (f"{100 * r.deep:.1f} %", f"{1e3 * r.deepest:.0f}")
        )
        cells = (
            *(r.method, f"{r.seconds:.2f}", f"{r.velocity_jump:.2f}", f"{r.peak_speed:.2f}", f"{r.jerk_ratio:.2f}"),
            *(f"{r.arms_down:.1f}", f"{100 * r.whole:.0f} %", *body),
        )
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, "", f"{rows[0].n_joins} seams each." if rows else ""]
