"""How good a seam is: the line that the report has for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.rig import metrics, proportions
from signsplice.rig.roles import find_roles
from signsplice.splicing.cut import Cut

FAST_M_S = 2.5
"""Peaks of isolated words reach 1.7 to 2.5 m/s; a transition beyond that is faster than any sign."""
_FOOT_SLIDE_M = 0.05
DEEP_M = 0.005
"""Deeper than this a hand is seen to be in the body."""


@dataclass(frozen=True)
class Seam:
    """The join of two signs.

    pre_frame: last frame kept of ``before``; post_frame: first kept of ``after``; both counted at the output rate.
    seconds: n_transition / fps. velocity_jump, peak_speed_m_s, jerk_ratio: of the wrists, see ``motion.measures``; NaN
    where unknown. intrusion_mm: how deep a hand lies in head, trunk or the other hand in the transition, beyond what
    the signs themselves do; None where nobody looked (body sense off, no frames, no known arms).
    """

    before: str
    after: str
    pre_frame: int
    post_frame: int
    n_transition: int
    seconds: float
    velocity_jump: float
    peak_speed_m_s: float
    jerk_ratio: float
    warnings: tuple[str, ...] = ()
    intrusion_mm: float | None = None


def score(
    window: Clip,
    first: int,
    n_transition: int,
    before: str,
    after: str,
    cut: Cut,
    warnings: tuple[str, ...],
    depth: float | None = None,
) -> Seam:
    """Scores of a seam from a window of the output around it, whose frames [first, first + n_transition) are new;
    ``depth``, m, is what body sense said of them.
    """
    joints = find_roles(window.skeleton).joints
    hands = [joints[role] for role in ("leftHand", "rightHand") if role in joints]
    feet = [joints[role] for role in ("leftFoot", "rightFoot") if role in joints]
    said = list(warnings)
    jump = speed = jerk = float("nan")
    stop = first + n_transition
    metres = proportions.sizes(window.skeleton).unit.metres
    positions = kinematics.forward(window, [0, *hands, *feet])[1][:, 1:] * metres
    if hands:
        wrists = positions[:, : len(hands)]
        jump = metrics.velocity_jump(wrists, first, stop, window.fps)
        speed = metrics.peak_speed(wrists, first, stop, window.fps)
        jerk = metrics.jerk_ratio(wrists, first, stop)
        if speed > FAST_M_S:
            said.append(f"a hand moves at {speed:.1f} m/s, faster than signs do; a longer transition time would help")
    if feet:
        slide = float(np.linalg.norm(positions[stop, len(hands) :] - positions[first - 1, len(hands) :], axis=-1).max())
        if slide > _FOOT_SLIDE_M:
            said.append(f"a foot slides by {100.0 * slide:.0f} cm: the two clips stand differently")
    if depth is not None and depth > DEEP_M:
        said.append(f"a hand passes {1e3 * depth:.0f} mm deep through the body; another transition time may help")
    return Seam(
        before=before,
        after=after,
        pre_frame=cut.pre,
        post_frame=cut.post,
        n_transition=n_transition,
        seconds=n_transition / window.fps,
        velocity_jump=jump,
        peak_speed_m_s=speed,
        jerk_ratio=jerk,
        warnings=tuple(said),
        intrusion_mm=None if depth is None else 1e3 * depth,
    )
