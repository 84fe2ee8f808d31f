"""Joins separately recorded words by every method and measures the seam.

Frames hidden in one take show how well a gap is filled whose two ends belong together. At a seam of two recordings the
ends do not belong together: each word's hands come from rest and go back to it. There is no true motion to compare
with, so this measures the faults that a viewer notices: jumps of velocity and jerk, arms that drop or hands that dip
between the words, signs cut short, hands in the body, faces that jump or blink by half.

A baseline is the stitcher of spoken-to-signed (PyPI, 0.4.0; MIT), rebuilt from its published description. It joins
clips of landmarks in four steps:

1. It trims each clip to the frames in which a wrist is above its elbow, five frames wider.
2. It shortens a trimmed clip of more than 0.8 s to 0.8 s.
3. It compares the end of the first and the beginning of the second (0.3 s, or 0.3 of the clip) by the distance of their
   points and joins them at the nearest pair of frames, with int(0.07 fps) frames between, interpolated linearly.
4. It low-passes all points (Butterworth, order 4, 6 Hz, forward and backward).

It moves points, so bones change length, and its filter also changes the signs. Here the points are the joints of a
clip, all with the same confidence; the stitcher leaves faces unfiltered, and there are none here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, filtfilt

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig import metrics
from signsplice.rig.info import Arms, arms, rig_info
from signsplice.rig.roles import CHANNELS
from signsplice.signer import notation, planner
from signsplice.signer.phonology import Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import HANGING, RESTS, STANDARD, Signer, stream
from signsplice.splicing.contracts import Cut
from signsplice.splicing.curves import CLASSICAL_TRANSITION, TRANSITIONS
from signsplice.splicing.cutters import CLASSICAL_CUTTER, CUTTERS
from signsplice.splicing.durations import DEFAULT_DURATION
from signsplice.splicing.durations import NATURAL as NATURAL_TEMPO
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.learned import FLUENT, NAME
from signsplice.splicing.options import choose
from signsplice.splicing.person import TRANSITION, owned_channels
from signsplice.splicing.seam import DEEP_M
from signsplice_workshop.measure import faces, motion_scores
from signsplice_workshop.measure.collisions import hand_penetration
from signsplice_workshop.measure.hands import (
    keeps_stroke,
    output_frame,
    stroke,
    word_span,
    wrist_joints,
    wrist_positions,
)
from signsplice_workshop.measure.measures import (
    Measure,
    Progress,
    Row,
    aggregate,
    format_measures,
    make_row,
    percent,
    track_progress,
)

MARGIN_FRAMES = 5
LONGEST_S = 0.8
SEARCH_S = SEARCH_FRACTION = 0.3
GAP_S = 0.07
ORDER, CUTOFF_HZ = 4, 6.0


@dataclass(frozen=True, eq=False)
class Stitched:
    """Two words joined.

    positions: joint positions (T, J, 3), clip units.
    first, stop: the interpolated frames [first, stop).
    kept_before, kept_after: half-open range of frames of each word's clip, counted before any shortening, that are in
        the result.
    """

    positions: FloatArray
    first: int
    stop: int
    kept_before: tuple[int, int]
    kept_after: tuple[int, int]


def stitch(before: Clip, after: Clip) -> Stitched:
    """Joins two clips of one skeleton and rate. Raises ``InputError`` if the rig's arms are not known by name."""
    fps = before.fps
    spans = [_find_raised_span(clip) for clip in (before, after)]
    p, q = (
        _limit_duration(kinematics.forward(clip)[1][first:stop], fps)
        for clip, (first, stop) in zip((before, after), spans, strict=True)
    )  # (T, J, 3)
    n_p, n_q = (max(1, int(min(SEARCH_S * fps, SEARCH_FRACTION * len(points)))) for points in (p, q))
    tail, head = p[-n_p:].reshape(n_p, -1), q[:n_q].reshape(n_q, -1)
    distances = np.linalg.norm(tail[:, None] - head[None], axis=-1)  # (n_p, n_q)
    i, j = np.unravel_index(int(distances.argmin()), distances.shape)
    last, entry = len(p) - n_p + int(i), int(j)
    n_gap = int(GAP_S * fps)
    weight = np.arange(1, n_gap + 1)[:, None, None] / (n_gap + 1)
    filled = (1.0 - weight) * p[last] + weight * q[entry]
    joined = np.concatenate([p[: last + 1], filled, q[entry:]])
    return Stitched(
        _low_pass(joined, fps),
        last + 1,
        last + 1 + n_gap,
        _source_range(spans[0], len(p), 0, last + 1),
        _source_range(spans[1], len(q), entry, len(q)),
    )


def _find_raised_span(clip: Clip) -> tuple[int, int]:
    """Returns the frames in which a wrist is above its elbow, five frames wider; the whole clip if none is."""
    motion = arms(clip)
    raised = np.flatnonzero((((motion.wrists - motion.elbows) @ motion.up) > 0.0).any(axis=1))
    if not len(raised):
        return 0, len(clip)
    return max(0, int(raised[0]) - MARGIN_FRAMES), min(len(clip), int(raised[-1]) + 1 + MARGIN_FRAMES)


def _limit_duration(points: FloatArray, fps: float) -> FloatArray:
    """Returns the same motion (T, J, 3) in at most 0.8 s."""
    max_frames = round(LONGEST_S * fps)
    if len(points) <= max_frames:
        return points
    times = np.linspace(0.0, len(points) - 1.0, max_frames)
    low = np.minimum(times.astype(int), len(points) - 2)
    weight = (times - low)[:, None, None]
    return np.asarray((1.0 - weight) * points[low] + weight * points[low + 1])


def _source_range(span: tuple[int, int], n_frames: int, first: int, stop: int) -> tuple[int, int]:
    """Returns the frames of the clip that lie in [first, stop) of its trimmed span, which was resampled to
    ``n_frames``.
    """
    scale = (span[1] - span[0] - 1) / max(n_frames - 1, 1)
    return span[0] + int(np.ceil(first * scale - 1e-9)), span[0] + int((stop - 1) * scale + 1e-9) + 1


def _low_pass(points: FloatArray, fps: float) -> FloatArray:
    b, a = butter(ORDER, CUTOFF_HZ / (0.5 * fps))
    if len(points) <= 3 * max(len(a), len(b)):
        return points
    return np.asarray(filtfilt(b, a, points, axis=0))


@dataclass(frozen=True)
class SeamMeasurement:
    """Measurement of one seam of two words; speeds, jumps and jerk are of the wrists.

    seconds: length of the transition.
    velocity_jump: largest change of velocity at the ends of the transition, m/s.
    peak_speed: highest speed in the transition, m/s.
    jerk_ratio: RMS jerk in the transition over that of the frames around it.
    arms_down: number of frames between the two strokes in which both arms are down.
    whole: whether the seam keeps both strokes whole.
    depth: greatest depth of a hand in the body in the transition, m; None for a method that makes points only.
    idle_peak: highest speed of a hand that only one word owns, in the transition and up to the end of the other stroke,
        m/s; None where no hand does, and for a method that makes points only.
    dip: how far the strong wrist sinks below the lower end of the transition, m.
    stroke_dip: how far it sinks below the lower of the last stroke's end and the next stroke's start, between the two,
        m; None for a method that makes points only.
    head_peak: highest speed of the head in the transition, degrees/s; None for a method that makes points only.
    elbow_step: largest step of an elbow in a frame of the transition, m; None for a method that makes points only.
    face_jumps, half_blink: faults of the face (``find_faults``).
    """

    seconds: float
    velocity_jump: float
    peak_speed: float
    jerk_ratio: float
    arms_down: int
    whole: bool
    depth: float | None
    dip: float
    idle_peak: float | None = None
    stroke_dip: float | None = None
    head_peak: float | None = None
    elbow_step: float | None = None
    face_jumps: bool = False
    half_blink: bool = False


FrameRange = tuple[int, int]

AROUND = 8
"""Number of frames of each sign that are measured next to the transition."""
DOWN_FRACTION = 0.15
"""An arm is down if it has risen by less than this fraction of the height from rest to its highest."""
DIP_M, DEEP_DIP_M = 0.03, 0.06
"""Depths above which a hand counts as dipping, and as dipping deep."""
ELBOW_STEP_M = 0.08
"""Step of an elbow in a frame above which it is seen to jump."""
STITCHER = "stitcher"


def _fraction_above(limit: float) -> Callable[[FloatArray], float]:
    return lambda values: float(np.mean(values > limit))


MEASURES = (
    Measure("method", "method"),
    Measure("n_joins", function=len),
    Measure("seconds", "seconds", "{:.2f}", function=aggregate("seconds", np.nanmedian)),
    Measure("velocity_jump", "velocity jump, m/s", "{:.2f}", function=aggregate("velocity_jump", np.nanmedian)),
    Measure("peak_speed", "peak, m/s", "{:.2f}", function=aggregate("peak_speed", np.nanmedian)),
    Measure("jerk_ratio", "jerk ratio", "{:.2f}", function=aggregate("jerk_ratio", np.nanmedian)),
    Measure("arms_down", "arms down, frames", "{:.1f}", function=aggregate("arms_down", np.mean)),
    percent("whole", "strokes whole", 0, aggregate("whole", np.mean)),
    percent("deep", "deep in the body", 1, aggregate("depth", _fraction_above(DEEP_M))),
    Measure("deepest", "deepest, mm", "{:.0f}", 1e3, aggregate("depth", np.max)),
    Measure("idle_peak", "idle hand, m/s", "{:.2f}", function=aggregate("idle_peak", np.median)),
    Measure("idle_fastest", "its fastest, m/s", "{:.2f}", function=aggregate("idle_peak", np.max)),
    percent("dips", "dips over 3 / 6 cm", 0, aggregate("dip", _fraction_above(DIP_M))),
    Measure("deep_dips", "dips over 3 / 6 cm", " / {:.0f} %", 100.0, aggregate("dip", _fraction_above(DEEP_DIP_M))),
    percent("stroke_dips", "stroke to stroke", 0, aggregate("stroke_dip", _fraction_above(DIP_M))),
    Measure(
        "deep_stroke_dips",
        "stroke to stroke",
        " / {:.0f} %",
        100.0,
        aggregate("stroke_dip", _fraction_above(DEEP_DIP_M)),
    ),
    Measure("deepest_dip", "deepest, cm", "{:.1f}", 1e2, aggregate("stroke_dip", np.max)),
    Measure("head_peak", "head, degrees/s", "{:.0f}", function=aggregate("head_peak", np.median)),
    percent("elbow_steps", "elbow steps over 8 cm", 1, aggregate("elbow_step", _fraction_above(ELBOW_STEP_M))),
    percent("face_jumps", "face jumps", 1, aggregate("face_jumps", np.mean)),
    percent("half_blinks", "half blinks", 1, aggregate("half_blink", np.mean)),
)
"""Measures of a method over all seams: medians, but the mean of ``arms_down``, the greatest value where a name says so,
and fractions of the seams. None for a method without a body, or without a seam in which a hand only goes to rest or
comes from it.
"""


def signature(rest: str = HANGING) -> str:
    """Returns the recipe of the numbers, with the signer's rest if it is not the usual one."""
    signer = "standard-signer" + ("" if rest == HANGING else f",rest:{rest}")
    return (
        f"joins|words:everyday,{signer},drawn:once|around:{AROUND}|{motion_scores.VELOCITY_JUMP}|{motion_scores.JERK_RATIO}"
        f"|arms-down:{DOWN_FRACTION:g}-of-rise,between-strokes|whole:first-to-last-movement|deep:{1e3 * DEEP_M:g}mm"
        f"|idle-hand:wrist,transition+other-stroke,max|dip:strong-wrist,{1e2 * DIP_M:g}+{1e2 * DEEP_DIP_M:g}cm"
        f"|head:max|elbow-step:{1e2 * ELBOW_STEP_M:g}cm|{faces.SIGNATURE}"
    )


def word_pairs(
    n_pairs: int, signs: Sequence[Sign] | None = None, rest: str = HANGING
) -> list[tuple[IsolatedWord, IsolatedWord]]:
    """Returns pairs of different words by the standard signer, with random faces; the same arguments always give the
    same.

    signs: the words to draw from, by default those that ship. rest: how the signer's arms rest. Raises ``InputError``
    for an unknown rest.
    """
    if rest not in RESTS:
        raise InputError(f"no rest {rest!r}, expected one of {', '.join(RESTS)}")
    signs = list(notation.everyday().values()) if signs is None else signs
    rng = stream("joins", len(signs), n_pairs)
    drawn = [rng.choice(len(signs), 2, replace=False).tolist() for _ in range(n_pairs)]
    signer = replace(STANDARD, rest=rest)
    words = {k: planner.synthesize_word(signs[k], signer) for k in sorted({k for pair in drawn for k in pair})}
    words = {k: replace(word, clip=faces.add_random_face(word.clip, k)) for k, word in words.items()}
    return [(words[p], words[q]) for p, q in drawn]


def methods_to_compare(bundle: str | Path | None = None) -> dict[str, SpliceOptions]:
    """Returns the methods to compare, by name.

    Classical: each cutter with Hermite, each transition with the default cutter, and Hermite with collision avoidance.
    Learned, if ``bundle`` (by default the one that ships) can be read: all parts together, and each part with classical
    ones. Raises ``InputError`` for a named bundle that cannot be read.
    """
    classical = SpliceOptions(CLASSICAL_CUTTER, CLASSICAL_TRANSITION, DEFAULT_DURATION, avoid_collisions=False)
    methods = {f"{name} + {CLASSICAL_TRANSITION}": replace(classical, cutter=name) for name in CUTTERS}
    methods |= {f"{CLASSICAL_CUTTER} + {name}": replace(classical, transition=name) for name in TRANSITIONS}
    methods[f"{CLASSICAL_CUTTER} + {CLASSICAL_TRANSITION}, collision avoidance"] = replace(
        classical, avoid_collisions=True
    )
    if choose(bundle=bundle).bundle is not None:
        default = SpliceOptions(NAME, NAME, bundle=bundle)
        learned = replace(default, avoid_collisions=False)
        methods[f"{CLASSICAL_CUTTER} + {NAME}"] = replace(classical, transition=NAME, bundle=bundle)
        methods[f"{NAME} + {CLASSICAL_TRANSITION}"] = replace(learned, transition=CLASSICAL_TRANSITION)
        methods[f"{FLUENT} + {NAME}"] = replace(learned, cutter=FLUENT)
        methods[f"{NAME} + {NAME}"] = learned
        methods[f"{NAME} + {NAME}, collision avoidance"] = default
        as_recorded = replace(default, free_hand=TRANSITION, person=0.0)
        methods[f"{NAME} + {NAME}, collision avoidance, nobody between the signs"] = as_recorded
        methods[f"{NAME} + {NAME}, collision avoidance, natural tempo"] = replace(default, tempo=NATURAL_TEMPO)
    return methods


def compare(
    words: Sequence[tuple[IsolatedWord, IsolatedWord]],
    methods: Mapping[str, SpliceOptions],
    progress: Progress | None = None,
) -> list[Row]:
    """Returns one row for each method, and one for the stitcher."""
    return [
        make_row(
            MEASURES,
            [measure_stitched(p, q) if options is None else measure_spliced(p, q, options) for p, q in words],
            method=name,
        )
        for name, options in track_progress([*methods.items(), (STITCHER, None)], progress)
    ]


def measure_spliced(before: IsolatedWord, after: IsolatedWord, options: SpliceOptions) -> SeamMeasurement:
    """Measures a seam made by ``splice``."""
    result = splice([before.clip, after.clip], options)
    (seam,) = result.seams
    left_span, entered_span = (word_span(result.spans, k) for k in range(2))
    first, stop = left_span.output[1], entered_span.output[0]
    rotations, positions = kinematics.forward(result.clip[first - 1 : stop + 1])
    depth, _ = hand_penetration(result.clip.skeleton, rotations, positions)
    gap_depth = depth[1:-1] if len(depth) > 2 else depth
    info = rig_info(result.clip.skeleton)
    deepest = max(0.0, float(gap_depth.max()) * info.sizes.unit.metres)
    kept_ranges = (0, seam.pre_frame + 1), (seam.post_frame, len(after))
    wrists = wrist_positions(result.clip)
    measured = _measure_seam(wrists, (first, stop), before, after, kept_ranges, deepest)
    owned = owned_channels(before.clip), owned_channels(after.clip)
    idle = [
        (side, first, output_frame(entered_span, stroke(after)[1]))
        if channel in owned[0]
        else (side, output_frame(left_span, stroke(before)[0]), stop)
        for side, channel in enumerate(CHANNELS[:2])
        if (channel in owned[0]) != (channel in owned[1])
    ]
    strokes = output_frame(left_span, stroke(before)[1]), output_frame(entered_span, stroke(after)[0])
    dip_range = min(round(strokes[0]), first - 1), max(round(strokes[1]), stop)
    peak, dip = _idle_peak_speed(wrists, idle, result.clip.fps), _dip_depth(wrists, before.signer, *dip_range)
    head = rotation.from_matrix(rotations[:, info.roles.joints["head"]])
    elbows = positions[:, [info.arm_joints[1], info.arm_joints[4]]] * info.sizes.unit.metres
    face_jumps, half_blink = faces.find_faults(result.clip.face, (first, stop), before.clip, after.clip)
    return replace(
        measured,
        face_jumps=face_jumps,
        half_blink=half_blink,
        idle_peak=peak,
        stroke_dip=dip,
        head_peak=float(np.rad2deg(rotation.angle_between(head[1:], head[:-1])).max()) * result.clip.fps,
        elbow_step=metrics.peak_speed(elbows, 1, len(elbows) - 1, 1.0),
    )


def _idle_peak_speed(wrists: FloatArray, rests: Sequence[tuple[int, float, float]], fps: float) -> float | None:
    """Returns the highest speed (m/s) of idle hands, from wrists (T, 2, 3) and, for each hand, its side and the first
    and last frame; None without idle hands.
    """
    last = len(wrists) - 1
    peaks = [
        metrics.peak_speed(wrists[:, [side]], max(round(start), 0), min(round(stop), last), fps)
        for side, start, stop in rests
    ]
    return max(peaks, default=None)


def _dip_depth(wrists: FloatArray, signer: Signer, first: int, last: int) -> float:
    """Returns how far the strong wrist of wrists (T, 2, 3), m, sinks below its lower end of frames ``first`` to
    ``last``.
    """
    heights = wrists[first : last + 1, 0 if signer.left_handed else 1, 1]  # the signer stands upright along +Y
    return max(0.0, float(min(heights[0], heights[-1]) - heights.min()))


def measure_stitched(before: IsolatedWord, after: IsolatedWord) -> SeamMeasurement:
    """Measures a seam made by the stitcher; faces go straight from word to word."""
    stitched = stitch(before.clip, after.clip)
    skeleton = before.clip.skeleton
    wrists = stitched.positions[:, wrist_joints(skeleton)] * rig_info(skeleton).sizes.unit.metres
    kept_ranges = stitched.kept_before, stitched.kept_after
    measured = _measure_seam(wrists, (stitched.first, stitched.stop), before, after, kept_ranges, None)
    cut, n_frames = Cut(kept_ranges[0][1] - 1, kept_ranges[1][0]), stitched.stop - stitched.first
    face = faces.join_linearly(before.clip, after.clip, cut, n_frames)
    face_jumps, half_blink = faces.find_faults(face, (cut.pre + 1, cut.pre + 1 + n_frames), before.clip, after.clip)
    return replace(measured, face_jumps=face_jumps, half_blink=half_blink)


def _measure_seam(
    wrists: FloatArray,
    gap: FrameRange,
    before: IsolatedWord,
    after: IsolatedWord,
    kept_ranges: tuple[FrameRange, FrameRange],
    depth: float | None,
) -> SeamMeasurement:
    """Measures one seam.

    wrists: (T, 2, 3) of the joined clip, m. gap: its new frames. kept_ranges: of each word, the frames that are in it.
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
        arms_down=_count_frames_down(before, after, kept_ranges),
        whole=keeps_stroke(before, *kept_ranges[0]) and keeps_stroke(after, *kept_ranges[1]),
        depth=depth,
        dip=_dip_depth(wrists, before.signer, max(first - 1, 0), min(stop, len(wrists) - 1)),
    )


def _count_frames_down(before: IsolatedWord, after: IsolatedWord, kept_ranges: tuple[FrameRange, FrameRange]) -> int:
    """Returns the number of frames kept between the two strokes in which both arms are down."""
    (_, stop), (first, _) = kept_ranges
    leaving = _are_down(arms(before.clip))[before.events.end + 1 : stop]
    entering = _are_down(arms(after.clip))[first : after.events.start]
    return int(leaving.sum()) + int(entering.sum())


def _are_down(motion: Arms) -> NDArray[np.bool_]:
    """Whether both arms are down, for each frame (T,)."""
    height = motion.lift.max(axis=1)
    rest = min(height[0], height[-1])
    return np.asarray(height < rest + DOWN_FRACTION * (height.max() - rest))


def table(rows: Sequence[Row], rest: str = HANGING) -> list[str]:
    """Returns the rows as Markdown, with their signature."""
    caption = f"{rows[0].n_joins} seams each." if rows else ""
    return [f"`{signature(rest)}`", "", *format_measures(MEASURES, rows), "", caption]
