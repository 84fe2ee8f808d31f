"""Words that were recorded apart, joined by every method and measured at the seam.

Frames hidden in one take show how well a gap is filled whose two ends belong together. At a seam of two recordings they
do not: each word's hands come from rest and go back to it. There is no true motion to compare with, so this measures
the faults that a viewer notices: jumps of velocity and jerk, arms that drop or hands that dip between the words, signs
cut short, hands in the body, faces that jump or blink by half.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.errors import InputError
from signsplice.evaluation import faces
from signsplice.evaluation.hands import wrist_joints, wrist_positions
from signsplice.evaluation.seam_rows import SeamMeasurement, SeamRow
from signsplice.evaluation.stitcher import stitch
from signsplice.evaluation.strokes import keeps_stroke, output_frame, stroke
from signsplice.evaluation.tables import Progress, counted, markdown_columns, percent, shown
from signsplice.motion import kinematics, rotation
from signsplice.motion.arrays import FloatArray
from signsplice.rig import metrics
from signsplice.rig.arms import Arms, arms
from signsplice.rig.info import rig_info
from signsplice.signer import notation, planner
from signsplice.signer.phonology import Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import HANGING, RESTS, STANDARD, Signer, stream
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.gap import Cut
from signsplice.splicing.methods.choice import choose
from signsplice.splicing.methods.cut import CLASSICAL_CUTTER, CUTTERS
from signsplice.splicing.methods.duration import CLASSICAL_DURATION
from signsplice.splicing.methods.learned import FLUENT, NAME
from signsplice.splicing.methods.transition import CLASSICAL_TRANSITION, TRANSITIONS
from signsplice.splicing.passes.free_hand import NATURAL
from signsplice.splicing.passes.idle_hand import idle_hands
from signsplice.splicing.seam import DEEP_M
from signsplice.splicing.tempo import NATURAL as NATURAL_TEMPO

FrameRange = tuple[int, int]

AROUND = 8
"""Frames of each sign that are measured next to the transition."""
DOWN_FRACTION = 0.15
"""An arm is down where it has risen by less than this fraction of the height from rest to its highest."""
DIP_M, DEEP_DIP_M = 0.03, 0.06
"""From these depths on a hand is counted as dipping, and as dipping deep."""
ELBOW_STEP_M = 0.08
"""An elbow that goes farther in a frame is seen to jump."""
STITCHER = "stitcher"


def signature(rest: str = HANGING) -> str:
    """The recipe of the numbers, with the signer's rest where it is not the usual one."""
    signer = "standard-signer" + ("" if rest == HANGING else f",rest:{rest}")
    return (
        f"joins|words:everyday,{signer},drawn:once|around:{AROUND}|{metrics.VELOCITY_JUMP}|{metrics.JERK_RATIO}"
        f"|arms-down:{DOWN_FRACTION:g}-of-rise,between-strokes|whole:first-to-last-movement|deep:{1e3 * DEEP_M:g}mm"
        f"|idle-hand:wrist,transition+rest,max|dip:strong-wrist,{1e2 * DIP_M:g}+{1e2 * DEEP_DIP_M:g}cm"
        f"|head:max|elbow-step:{1e2 * ELBOW_STEP_M:g}cm|{faces.SIGNATURE}"
    )


def word_pairs(
    n_pairs: int, signs: Sequence[Sign] | None = None, rest: str = HANGING
) -> list[tuple[IsolatedWord, IsolatedWord]]:
    """Pairs of different words by the standard signer, with random faces; the same arguments always give the same.

    signs: the words to draw from, by default those that ship. rest: how the signer's arms rest. Raises ``InputError``
    for an unknown rest.
    """
    if rest not in RESTS:
        raise InputError(f"no rest {rest!r}, expected one of {', '.join(RESTS)}")
    signs = list(notation.everyday().values()) if signs is None else signs
    rng = stream("joins", len(signs), n_pairs)
    drawn = [rng.choice(len(signs), 2, replace=False).tolist() for _ in range(n_pairs)]
    signer = replace(STANDARD, rest=rest)
    words = {k: planner.isolated(signs[k], signer) for k in sorted({k for pair in drawn for k in pair})}
    words = {k: replace(word, clip=faces.with_random_face(word.clip, k)) for k, word in words.items()}
    return [(words[p], words[q]) for p, q in drawn]


def compared_methods(bundle: str | Path | None = None) -> dict[str, SpliceOptions]:
    """Methods to compare, by name.

    Classical: each cutter with Hermite, each transition with the default cutter, and Hermite with collision avoidance.
    Learned, where ``bundle`` (by default the one that ships) can be read: all parts together, and each part with
    classical ones. Raises ``InputError`` for a named bundle that cannot be read.
    """
    plain = SpliceOptions(CLASSICAL_CUTTER, CLASSICAL_TRANSITION, CLASSICAL_DURATION, avoid_collisions=False)
    out = {f"{name} + {CLASSICAL_TRANSITION}": replace(plain, cutter=name) for name in CUTTERS}
    out |= {f"{CLASSICAL_CUTTER} + {name}": replace(plain, transition=name) for name in TRANSITIONS}
    out[f"{CLASSICAL_CUTTER} + {CLASSICAL_TRANSITION}, collision avoidance"] = replace(plain, avoid_collisions=True)
    if choose(bundle=bundle).bundle is not None:
        default = SpliceOptions(NAME, NAME, NAME, bundle)
        learned = replace(default, avoid_collisions=False)
        out[f"{CLASSICAL_CUTTER} + {NAME}"] = replace(plain, transition=NAME, bundle=bundle)
        out[f"{NAME} + {CLASSICAL_TRANSITION}"] = replace(learned, transition=CLASSICAL_TRANSITION)
        out[f"{FLUENT} + {NAME}"] = replace(learned, cutter=FLUENT)
        out[f"{NAME} + {NAME}"] = learned
        out[f"{NAME} + {NAME}, collision avoidance"] = default
        out[f"{NAME} + {NAME}, collision avoidance, natural free hand"] = replace(default, free_hand=NATURAL)
        out[f"{NAME} + {NAME}, collision avoidance, natural tempo"] = replace(default, tempo=NATURAL_TEMPO)
    return out


def compare(
    words: Sequence[tuple[IsolatedWord, IsolatedWord]],
    methods: Mapping[str, SpliceOptions],
    progress: Progress | None = None,
) -> list[SeamRow]:
    """One row for each method, and one for the stitcher."""
    return [
        _row(name, [measure_stitched(p, q) if options is None else measure_spliced(p, q, options) for p, q in words])
        for name, options in counted([*methods.items(), (STITCHER, None)], progress)
    ]


def measure_spliced(before: IsolatedWord, after: IsolatedWord, options: SpliceOptions) -> SeamMeasurement:
    """A seam made by ``splice``."""
    result = splice([before.clip, after.clip], options)
    (seam,) = result.seams
    left, entered = (span for span in result.spans if span.kind == "sign")
    first, stop = left.output[1], entered.output[0]
    rotations, positions = kinematics.forward(result.clip[first - 1 : stop + 1])
    depth, _ = collision.hand_penetration(result.clip.skeleton, rotations, positions)
    inside = depth[1:-1] if len(depth) > 2 else depth
    info = rig_info(result.clip.skeleton)
    deepest = max(0.0, float(inside.max()) * info.sizes.unit.metres)
    kept = (0, seam.pre_frame + 1), (seam.post_frame, len(after))
    wrists = wrist_positions(result.clip)
    measured = _measure(wrists, (first, stop), before, after, kept, deepest)
    rests = [
        (hand.side, first, output_frame(entered, seam.post_frame + hand.n_rest))
        if hand.arrives
        else (hand.side, output_frame(left, seam.pre_frame + 1 - hand.n_rest), stop)
        for hand in idle_hands(before.clip, after.clip, Cut(seam.pre_frame, seam.post_frame))
    ]
    strokes = output_frame(left, stroke(before)[1]), output_frame(entered, stroke(after)[0])
    between = min(round(strokes[0]), first - 1), max(round(strokes[1]), stop)
    peak, dip = _idle_peak(wrists, rests, result.clip.fps), _dip(wrists, before.signer, *between)
    head = rotation.from_matrix(rotations[:, info.roles.joints["head"]])
    elbows = positions[:, [info.arm_joints[1], info.arm_joints[4]]] * info.sizes.unit.metres
    jumps, half = faces.faults(result.clip.face, (first, stop), before.clip, after.clip)
    return replace(
        measured,
        face_jumps=jumps,
        half_blink=half,
        idle_peak=peak,
        stroke_dip=dip,
        head_peak=float(np.rad2deg(rotation.angle_between(head[1:], head[:-1])).max()) * result.clip.fps,
        elbow_step=metrics.peak_speed(elbows, 1, len(elbows) - 1, 1.0),
    )


def _idle_peak(wrists: FloatArray, rests: Sequence[tuple[int, float, float]], fps: float) -> float | None:
    """Highest speed (m/s) of idle hands, of wrists (T, 2, 3), each by its side and the frames from the begin to the end
    of the gap and of its rest; None without any.
    """
    last = len(wrists) - 1
    peaks = [
        metrics.peak_speed(wrists[:, [side]], max(round(start), 0), min(round(stop), last), fps)
        for side, start, stop in rests
    ]
    return max(peaks, default=None)


def _dip(wrists: FloatArray, signer: Signer, first: int, last: int) -> float:
    """How far the strong wrist of wrists (T, 2, 3), m, sinks below its lower end of frames ``first`` to ``last``."""
    heights = wrists[first : last + 1, 0 if signer.left_handed else 1, 1]  # the signer stands upright along +Y
    return max(0.0, float(min(heights[0], heights[-1]) - heights.min()))


def measure_stitched(before: IsolatedWord, after: IsolatedWord) -> SeamMeasurement:
    """A seam made by the stitcher; faces go straight from word to word."""
    made = stitch(before.clip, after.clip)
    skeleton = before.clip.skeleton
    wrists = made.positions[:, wrist_joints(skeleton)] * rig_info(skeleton).sizes.unit.metres
    kept = made.kept_before, made.kept_after
    measured = _measure(wrists, (made.first, made.stop), before, after, kept, None)
    cut, n_frames = Cut(kept[0][1] - 1, kept[1][0]), made.stop - made.first
    face = faces.straight(before.clip, after.clip, cut, n_frames)
    jumps, half = faces.faults(face, (cut.pre + 1, cut.pre + 1 + n_frames), before.clip, after.clip)
    return replace(measured, face_jumps=jumps, half_blink=half)


def _measure(
    wrists: FloatArray,
    gap: FrameRange,
    before: IsolatedWord,
    after: IsolatedWord,
    kept: tuple[FrameRange, FrameRange],
    depth: float | None,
) -> SeamMeasurement:
    """Measurement of one seam.

    wrists: (T, 2, 3) of the joined clip, m. gap: its new frames. kept: of each word, the frames that are in it.
    """
    first, stop = gap
    start = max(0, first - AROUND)
    window = wrists[start : stop + AROUND]
    fps, first_new, end_new = before.clip.fps, first - start, stop - start
    return SeamMeasurement(
        seconds=(stop - first) / fps,
        velocity_jump=metrics.velocity_jump(window, first_new, end_new, fps),
        peak_speed=metrics.peak_speed(window, first_new, end_new, fps),
        jerk_ratio=metrics.jerk_ratio(window, first_new, end_new),
        arms_down=_n_frames_down(before, after, kept),
        whole=keeps_stroke(before, *kept[0]) and keeps_stroke(after, *kept[1]),
        depth=depth,
        dip=_dip(wrists, before.signer, max(first - 1, 0), min(stop, len(wrists) - 1)),
    )


def _n_frames_down(before: IsolatedWord, after: IsolatedWord, kept: tuple[FrameRange, FrameRange]) -> int:
    """Frames kept between the two strokes in which both arms are down."""
    (_, stop), (first, _) = kept
    leaving = _are_down(arms(before.clip))[before.events.end + 1 : stop]
    entering = _are_down(arms(after.clip))[first : after.events.start]
    return int(leaving.sum()) + int(entering.sum())


def _are_down(motion: Arms) -> NDArray[np.bool_]:
    """Whether both arms are down, for each frame (T,)."""
    height = motion.lift.max(axis=1)
    rest = min(height[0], height[-1])
    return np.asarray(height < rest + DOWN_FRACTION * (height.max() - rest))


def _row(name: str, seams: Sequence[SeamMeasurement]) -> SeamRow:
    depths = [seam.depth for seam in seams if seam.depth is not None]
    idle_peaks = [seam.idle_peak for seam in seams if seam.idle_peak is not None]
    stroke_dips = [seam.stroke_dip for seam in seams if seam.stroke_dip is not None]
    heads = [seam.head_peak for seam in seams if seam.head_peak is not None]

    def median(field: str) -> float:
        return float(np.nanmedian([getattr(seam, field) for seam in seams]))

    return SeamRow(
        method=name,
        n_seams=len(seams),
        seconds=median("seconds"),
        velocity_jump=median("velocity_jump"),
        peak_speed=median("peak_speed"),
        jerk_ratio=median("jerk_ratio"),
        arms_down=float(np.mean([seam.arms_down for seam in seams])),
        whole=float(np.mean([seam.whole for seam in seams])),
        deep=_fraction_over(depths, DEEP_M),
        deepest=max(depths, default=None),
        idle_peak=float(np.median(idle_peaks)) if idle_peaks else None,
        idle_fastest=max(idle_peaks, default=None),
        dips=_fraction_over([seam.dip for seam in seams], DIP_M),
        deep_dips=_fraction_over([seam.dip for seam in seams], DEEP_DIP_M),
        stroke_dips=_fraction_over(stroke_dips, DIP_M),
        deep_stroke_dips=_fraction_over(stroke_dips, DEEP_DIP_M),
        deepest_dip=max(stroke_dips, default=None),
        head_peak=float(np.median(heads)) if heads else None,
        elbow_steps=_fraction_over([seam.elbow_step for seam in seams if seam.elbow_step is not None], ELBOW_STEP_M),
        face_jumps=float(np.mean([seam.face_jumps for seam in seams])),
        half_blinks=float(np.mean([seam.half_blink for seam in seams])),
    )


def _fraction_over(values: Sequence[float], least: float) -> float | None:
    return float(np.mean(np.array(values) > least)) if values else None


_COLUMNS: dict[str, Callable[[SeamRow], str]] = {
    "method": lambda row: row.method,
    "seconds": lambda row: f"{row.seconds:.2f}",
    "velocity jump, m/s": lambda row: f"{row.velocity_jump:.2f}",
    "peak, m/s": lambda row: f"{row.peak_speed:.2f}",
    "jerk ratio": lambda row: f"{row.jerk_ratio:.2f}",
    "arms down, frames": lambda row: f"{row.arms_down:.1f}",
    "strokes whole": lambda row: percent(row.whole),
    "deep in the body": lambda row: percent(row.deep, ".1f"),
    "deepest, mm": lambda row: shown(row.deepest, ".0f", 1e3),
    "idle hand, m/s": lambda row: shown(row.idle_peak, ".2f"),
    "its fastest, m/s": lambda row: shown(row.idle_fastest, ".2f"),
    "dips over 3 / 6 cm": lambda row: f"{percent(row.dips)} / {percent(row.deep_dips)}",
    "stroke to stroke": lambda row: f"{percent(row.stroke_dips)} / {percent(row.deep_stroke_dips)}",
    "deepest, cm": lambda row: shown(row.deepest_dip, ".1f", 1e2),
    "head, degrees/s": lambda row: shown(row.head_peak, ".0f"),
    "elbow steps over 8 cm": lambda row: percent(row.elbow_steps, ".1f"),
    "face jumps": lambda row: percent(row.face_jumps, ".1f"),
    "half blinks": lambda row: percent(row.half_blinks, ".1f"),
}


def table(rows: Sequence[SeamRow], rest: str = HANGING) -> list[str]:
    """The rows as Markdown, with their signature."""
    counted = f"{rows[0].n_seams} seams each." if rows else ""
    return [f"`{signature(rest)}`", "", *markdown_columns(_COLUMNS, rows), "", counted]
