"""The quality of a seam: the row that the report has for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from signsplice.motion import Clip, FloatArray, joined, kinematics, rotation
from signsplice.rig import metrics
from signsplice.rig.info import rig_info
from signsplice.rig.inspection import JUMP_DEG, JUMP_M_S
from signsplice.splicing.gap import CONTEXT, Cut, FilledGap, Gap
from signsplice.splicing.tempo import FAST_M_S

Score = Annotated[float, "NaN where unknown, null in JSON"]
LEAST_JERK_M_S3 = 10.0
"""Jerk that the frames around a transition are taken to have at least: below that of any seam of the words that ship
(13 m/s3 and more), above that of people who stand idle (1 to 2 m/s3). After a dead hold any motion would count as
thousands of times rougher.
"""
_FOOT_SLIDE_M = 0.05
_HANDS, _FEET = ("leftHand", "rightHand"), ("leftFoot", "rightFoot")
DEEP_M = 0.005
"""From this depth on a viewer sees a hand in the body."""


@dataclass(frozen=True)
class Seam:
    """The join of two signs.

    This is its row in the public result, with what it scores. While a sentence is made, a seam is a
    ``joins.join.PlannedSeam``.

    before, after: names of the two signs.
    pre_frame: last frame kept of ``before``, counted at the output rate.
    post_frame: first frame kept of ``after``, counted at the output rate. Under a tempo, ``pre_frame`` and
        ``post_frame`` are where the cutter cuts the clips, and spans reach a little further (``Span.source``).
    n_transition: number of new frames.
    seconds: n_transition / fps.
    velocity_jump: largest change of a wrist's velocity at either end of the transition, m/s; NaN where unknown.
    peak_speed_m_s: highest speed of a wrist in the transition, m/s; NaN where unknown.
    jerk_ratio: jerk of the wrists in the transition over that around it; NaN where unknown (``rig.metrics``).
    warnings: what a user should know, one line each.
    intrusion_mm: how deep a hand lies in head, trunk or the other hand in the transition, beyond what the signs
        themselves do, mm; None where that was not measured (no collision avoidance, no frames, no known arms).
    """

    before: str
    after: str
    pre_frame: int
    post_frame: int
    n_transition: int
    seconds: float
    velocity_jump: Score
    peak_speed_m_s: Score
    jerk_ratio: Score
    warnings: tuple[str, ...] = ()
    intrusion_mm: float | None = None


def score(
    gap: Gap,
    filled: FilledGap | None,
    before: str,
    after: str,
    cut: Cut,
    warnings: tuple[str, ...] = (),
    of_one_clip: bool = False,
    by_system: bool = False,
    positions: FloatArray | None = None,
) -> Seam:
    """The seam of a gap and its new frames, None where there are none, between the signs of these names; or within one
    clip, where no transition time was chosen and the feet are the same signer's. ``by_system``: whether a system chose
    the transition time. ``positions``: of ``seam_positions``, where those are known.
    """
    fps, first = gap.before.fps, min(len(gap.before), CONTEXT)
    info = rig_info(gap.before.skeleton)
    joints = info.roles.joints
    hands, feet = ([joints[role] for role in roles if role in joints] for roles in (_HANDS, _FEET))
    lines = [*warnings, *(() if filled is None else filled.warnings)]
    depth = None if filled is None else filled.depth
    jump = speed = jerk = float("nan")
    stop = first + gap.n_frames
    if positions is None:
        (positions,) = seam_positions([(gap, filled)])
    if hands:
        wrists = positions[:, : len(hands)]
        jump = metrics.velocity_jump(wrists, first, stop, fps)
        speed = metrics.peak_speed(wrists, first, stop, fps)
        jerk = metrics.jerk_ratio(wrists, first, stop, LEAST_JERK_M_S3 / fps**3)
        if speed > FAST_M_S:
            in_signs = [metrics.peak_speed(part, 0, len(part), fps) for part in (wrists[:first], wrists[stop:])]
            advice = "" if by_system else _advice(max(in_signs), "gap" if of_one_clip else "transition time")
            lines.append(f"a hand moves at {speed:.1f} m/s, faster than signs do{advice}")
    if by_system:
        window, _ = gap.window(None if filled is None else filled.clip)
        lines += _joint_jumps(window[first - 1 : stop + 1])
    if feet:
        slide = float(np.linalg.norm(positions[stop, len(hands) :] - positions[first - 1, len(hands) :], axis=-1).max())
        if slide > _FOOT_SLIDE_M:
            why = "it stands elsewhere after the gap" if of_one_clip else "the two clips stand differently"
            lines.append(f"a foot slides by {100.0 * slide:.0f} cm: {why}")
    if depth is not None and depth > DEEP_M:
        other = "gap" if of_one_clip else "transition time"
        lines.append(f"a hand passes {1e3 * depth:.0f} mm deep through the body; another {other} may help")
    return Seam(
        before=before,
        after=after,
        pre_frame=cut.pre,
        post_frame=cut.post,
        n_transition=gap.n_frames,
        seconds=gap.n_frames / fps,
        velocity_jump=jump,
        peak_speed_m_s=speed,
        jerk_ratio=jerk,
        warnings=tuple(lines),
        intrusion_mm=None if depth is None else 1e3 * depth,
    )


def seam_positions(gaps: Sequence[tuple[Gap, FilledGap | None]]) -> list[FloatArray]:
    """Positions (T, K, 3) of the hands and feet that a rig has, m, in the new frames of each gap, None where it has
    none, and up to ``CONTEXT`` frames on either side.
    """
    out: dict[int, FloatArray] = {}
    windows = [(gap.before[-CONTEXT:], *(() if new is None else (new.clip,)), gap.after[:CONTEXT]) for gap, new in gaps]
    for block in joined(windows):
        info = rig_info(block.clip.skeleton)
        seen = [info.roles.joints[role] for role in (*_HANDS, *_FEET) if role in info.roles.joints]
        positions = kinematics.forward(block.clip, [0, *seen])[1][:, 1:] * info.sizes.unit.metres
        out |= {row: positions[frames] for row, frames in block}
    return [out[row] for row in range(len(gaps))]


def _advice(speed_in_signs: float, time: str) -> str:
    """What may help where a hand is too fast in a transition: a longer ``time``, unless it jumps in the signs too."""
    if speed_in_signs <= JUMP_M_S:
        return f"; a longer {time} would help"
    return f"; a hand jumps in the signs beside it, at {speed_in_signs:.1f} m/s: a fault of the capture?"


def _joint_jumps(window: Clip) -> list[str]:
    """A line about the joint that turns farthest from one frame to the next, where that is a jump."""
    local = window.local_rotations
    turned = np.rad2deg(rotation.angle_between(local[:-1], local[1:])).max(axis=0)
    n_more = int((turned > JUMP_DEG).sum()) - 1
    if n_more < 0:
        return []
    joint = int(turned.argmax())
    name = window.skeleton.names[joint].rpartition(":")[2]
    more = f"; {n_more} more joint{'s' * (n_more != 1)} by more than {JUMP_DEG:g}" if n_more else ""
    return [f"{name} turns {turned[joint]:.0f} degrees in one frame{more}"]
