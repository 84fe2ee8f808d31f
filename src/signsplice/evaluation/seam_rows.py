"""What is measured of a seam, and the row of a method in the table of ``seams``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SeamMeasurement:
    """One seam of two words; speeds, jumps and jerk are of the wrists.

    seconds: length of the transition.
    velocity_jump: largest change of velocity at the ends of the transition, m/s.
    peak_speed: highest speed in the transition, m/s.
    jerk_ratio: RMS jerk in the transition over that of the frames around it.
    arms_down: frames kept between the two strokes in which both arms are down.
    whole: whether both strokes are kept whole.
    depth: greatest depth of a hand in the body in the transition, m; None for a method that makes points only.
    idle_peak: highest speed of a hand that only goes to rest or comes from it, in the transition and while it rests,
        m/s; None where no hand does, and for a method that makes points only.
    dip: how far the strong wrist sinks below the lower end of the transition, m.
    stroke_dip: how far it sinks below the lower of the last stroke's end and the next stroke's start, from the one to
        the other, m; None for a method that makes points only.
    head_peak: how fast the head turns in the transition at most, degrees/s; None for a method that makes points only.
    elbow_step: how far an elbow goes in a frame of the transition at most, m; None for a method that makes points only.
    face_jumps, half_blink: faults of the face (``faces.faults``).
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


@dataclass(frozen=True)
class SeamRow:
    """One method over all seams: medians where nothing else is noted.

    method: cutter and transition.
    n_seams: seams measured.
    seconds, velocity_jump, peak_speed, jerk_ratio: as in ``SeamMeasurement``.
    arms_down: mean frames per seam.
    whole: fraction of the seams that keep both strokes whole.
    deep: fraction of the seams in which a hand lies more than ``seam.DEEP_M`` in the body; None without a body.
    deepest: greatest depth, m; None without a body.
    idle_peak, idle_fastest: of the seams with a hand that only goes to rest or comes from it, its highest speed, m/s:
        the median and the greatest; None without a body, or where no seam has one.
    dips, deep_dips: fraction of the seams whose ``dip`` is over ``seams.DIP_M``, and over ``seams.DEEP_DIP_M``.
    stroke_dips, deep_stroke_dips: the same of ``stroke_dip``; None without a body.
    deepest_dip: the greatest ``stroke_dip``, m; None without a body.
    head_peak: as in ``SeamMeasurement``; None without a body.
    elbow_steps: fraction of the seams whose ``elbow_step`` is over ``seams.ELBOW_STEP_M``; None without a body.
    face_jumps, half_blinks: fraction of the seams with these faults.
    """

    method: str
    n_seams: int
    seconds: float
    velocity_jump: float
    peak_speed: float
    jerk_ratio: float
    arms_down: float
    whole: float
    deep: float | None
    deepest: float | None
    idle_peak: float | None
    idle_fastest: float | None
    dips: float | None
    deep_dips: float | None
    stroke_dips: float | None
    deep_stroke_dips: float | None
    deepest_dip: float | None
    head_peak: float | None
    elbow_steps: float | None
    face_jumps: float
    half_blinks: float
