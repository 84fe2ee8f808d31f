"""A seam: two words and the frames between them, from its cut to its score.

A seam is frozen and extended by ``replace``: planning sets cut and gap, the passes (``passes``) set new frames and
edits of the two words, and emitting it sets the score.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from signsplice.motion import Clip, FloatArray, batch_clips, kinematics, rotation
from signsplice.rig import metrics
from signsplice.rig.info import rig_info
from signsplice.rig.inspection import JUMP_DEG, JUMP_M_S
from signsplice.splicing.contracts import CONTEXT, Cut, Gap, gap_at
from signsplice.splicing.durations import HUMAN
from signsplice.splicing.word import AlignedWord, Edit, apply_edits

SeamKind = Literal["signs", "letters", "slid letters", "reformed letters", "system", "one clip"]
"""signs: two words, not both letters. letters: two letters of one spelled word that look different. slid, reformed
letters: two that look the same, distinguished by a slide or by forming the second again. system: made by a system that
splices whole words. one clip: a gap within one clip.
"""
SIGNS: SeamKind = "signs"
LETTERS: SeamKind = "letters"
SLID: SeamKind = "slid letters"
REFORMED: SeamKind = "reformed letters"
SYSTEM: SeamKind = "system"
ONE_CLIP: SeamKind = "one clip"

Number = Annotated[float, "NaN where unknown, null in JSON"]
LEAST_JERK_M_S3 = 10.0
"""Lower limit of the jerk around a transition, m/s3: below that of any seam of the shipped words (13 and more), above
that of people who stand idle (1 to 2). Otherwise any motion after a perfect hold would count as thousands of times
rougher.
"""
_FOOT_SLIDE_M = 0.05
"""Distance from which on a sliding foot gives a warning, m."""
_HANDS = ("leftHand", "rightHand")
"""Roles of the hands."""
_FEET = ("leftFoot", "rightFoot")
"""Roles of the feet."""
DEEP_M = 0.005
"""Depth from which on a viewer sees a hand in the body, m."""


@dataclass(frozen=True)
class SeamScore:
    """How good a seam is: its row in the result and in the report.

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
    velocity_jump: Number
    peak_speed_m_s: Number
    jerk_ratio: Number
    warnings: tuple[str, ...] = ()
    intrusion_mm: float | None = None


@dataclass(frozen=True, eq=False)
class Seam:
    """Two words of a sentence and the frames between them.

    kind: kind of the seam.
    before, after: the words; ``after.entry`` is the frame at which this seam enters it.
    cut: the last kept frame of ``before`` and the first of ``after``, as recorded (``AlignedWord.clip``).
    gap: number of new frames, with the retimed frames on either side.
    warnings: what a user should know, one line each.
    frames: the new frames; None if there are none, or none yet.
    frame_warnings: what a user should know about how they were made, one line each.
    depth: depth of a hand in the body in them, m; None if not measured.
    earlier: edits of ``before`` at the seam before it.
    leaving: edits of ``before`` at this seam.
    entering: edits of ``after`` at this seam.
    gap_edits: the edits that the gap shows.
    n_held: number of new frames, the first ones, that are a pause in which ``before`` is held.
    score: score of the seam; None before it is emitted.
    """

    kind: SeamKind
    before: AlignedWord
    after: AlignedWord
    cut: Cut
    gap: Gap
    warnings: tuple[str, ...] = ()
    frames: Clip | None = None
    frame_warnings: tuple[str, ...] = ()
    depth: float | None = None
    earlier: tuple[Edit, ...] = ()
    leaving: tuple[Edit, ...] = ()
    entering: tuple[Edit, ...] = ()
    gap_edits: tuple[Edit, ...] = ()
    n_held: int = 0
    score: SeamScore | None = None

    @property
    def is_open(self) -> bool:
        """Whether a transition must make its frames: the gap has some, and no system made them."""
        return self.gap.n_frames > 0 and self.kind != SYSTEM

    @property
    def new_frames(self) -> Clip:
        """The new frames. Raises ``ValueError`` if there are none."""
        if self.frames is None:
            raise ValueError(f"no frames between {self.before.clip.name} and {self.after.clip.name}")
        return self.frames

    @cached_property
    def retimed_cut(self) -> Cut:
        """The cut in frames of the retimed words."""
        return Cut(self.before.frames.last(self.cut.pre), self.after.frames.first(self.cut.post))

    @property
    def edits(self) -> tuple[Edit, ...]:
        """All edits of both words so far."""
        return (*self.earlier, *self.leaving, *self.entering)

    @cached_property
    def before_clip(self) -> Clip:
        """The retimed word before, with its edits so far."""
        return apply_edits(self.before.retimed, (*self.earlier, *self.leaving))

    @cached_property
    def after_clip(self) -> Clip:
        """The retimed word after, with its edits so far."""
        return apply_edits(self.after.retimed, self.entering)

    def with_gap(self, n_frames: int) -> Seam:
        """Returns the seam with a gap of ``n_frames`` between the words as edited so far; its frames do not change."""
        gap = gap_at(
            self.before_clip, self.after_clip, self.retimed_cut, n_frames, self.before.first_frame, self.gap.keyed
        )
        return replace(self, gap=gap, gap_edits=self.edits)


def plan_seam(
    kind: SeamKind,
    before: AlignedWord,
    after: AlignedWord,
    cut: Cut,
    n_frames: int,
    warnings: tuple[str, ...],
    arrival_s: float = 0.0,
    slide_m: float = 0.0,
) -> Seam:
    """Returns the seam of two words at a cut of the recorded ones, with an open gap; ``arrival_s`` and ``slide_m``: of
    the word after.
    """
    if cut.pre <= before.entry and before.entry > 0:
        frame = before.frames.n_left_out + before.entry
        line = f"{before.clip.name} is left at frame {frame}, where it was entered: only that frame is kept"
        warnings = (*warnings, line)
    after = replace(after, entry=cut.post, arrival_s=arrival_s, slide_m=slide_m)
    retimed = Cut(before.frames.last(cut.pre), after.first_frame)
    gap = gap_at(before.retimed, after.retimed, retimed, n_frames, before.first_frame, before.keyed or after.keyed)
    return Seam(kind, before, after, cut, gap, warnings)


def score_seam(seam: Seam, positions: FloatArray) -> Seam:
    """Returns the finished seam with its score; ``positions``: from ``seam_positions``."""
    gap, is_one_clip, is_system = seam.gap, seam.kind == ONE_CLIP, seam.kind == SYSTEM
    fps, first = gap.before.fps, min(len(gap.before), CONTEXT)
    stop, roles = first + gap.n_frames, rig_info(gap.before.skeleton).roles.joints
    n_hands = sum(role in roles for role in _HANDS)
    time = "gap" if is_one_clip else "transition time"
    lines = [*seam.warnings, *seam.frame_warnings]
    jump = speed = jerk = float("nan")
    if n_hands:
        wrists = positions[:, :n_hands]
        jump = metrics.velocity_jump(wrists, first, stop, fps)
        speed = metrics.peak_speed(wrists, first, stop, fps)
        jerk = metrics.jerk_ratio(wrists, first, stop, LEAST_JERK_M_S3 / fps**3)
        if speed > HUMAN.largest_speed_m_s:
            in_signs = [metrics.peak_speed(part, 0, len(part), fps) for part in (wrists[:first], wrists[stop:])]
            advice = "" if is_system else _advice(max(in_signs), time)
            lines.append(f"a hand moves at {speed:.1f} m/s, faster than signs do{advice}")
    if is_system:
        window, _ = gap.window(seam.frames)
        lines += _joint_jumps(window[first - 1 : stop + 1])
    feet = positions[[first - 1, stop], n_hands:]  # (2, F, 3)
    slide = float(np.linalg.norm(feet[1] - feet[0], axis=-1).max(initial=0.0))
    if slide > _FOOT_SLIDE_M:
        why = "it stands elsewhere after the gap" if is_one_clip else "the two clips stand differently"
        lines.append(f"a foot slides by {100.0 * slide:.0f} cm: {why}")
    if seam.depth is not None and seam.depth > DEEP_M:
        lines.append(f"a hand passes {1e3 * seam.depth:.0f} mm deep through the body; another {time} may help")
    score = SeamScore(
        before=seam.before.clip.name,
        after=seam.after.clip.name,
        pre_frame=seam.cut.pre + seam.before.frames.n_left_out,
        post_frame=seam.cut.post + seam.after.frames.n_left_out,
        n_transition=gap.n_frames,
        seconds=gap.n_frames / fps,
        velocity_jump=jump,
        peak_speed_m_s=speed,
        jerk_ratio=jerk,
        warnings=tuple(lines),
        intrusion_mm=None if seam.depth is None else 1e3 * seam.depth,
    )
    return replace(seam, score=score)


def seam_positions(seams: Sequence[Seam]) -> list[FloatArray]:
    """Returns positions (T, K, 3) of the hands and feet that a rig has, m, in the new frames of each seam, if any, and
    up to ``CONTEXT`` frames on either side.
    """
    positions_of: dict[int, FloatArray] = {}
    windows = [
        (seam.gap.before[-CONTEXT:], *(() if seam.frames is None else (seam.frames,)), seam.gap.after[:CONTEXT])
        for seam in seams
    ]
    for block in batch_clips(windows):
        info = rig_info(block.clip.skeleton)
        seen = [info.roles.joints[role] for role in (*_HANDS, *_FEET) if role in info.roles.joints]
        positions = kinematics.forward(block.clip, [0, *seen])[1][:, 1:] * info.sizes.unit.metres
        positions_of |= {row: positions[frames] for row, frames in block}
    return [positions_of[row] for row in range(len(seams))]


def _advice(speed_in_signs: float, time: str) -> str:
    """Returns advice for a hand too fast in a transition: a longer ``time``, unless it jumps in the signs too."""
    if speed_in_signs <= JUMP_M_S:
        return f"; a longer {time} would help"
    return f"; a hand jumps in the signs beside it, at {speed_in_signs:.1f} m/s: a fault of the capture?"


def _joint_jumps(window: Clip) -> list[str]:
    """Returns a warning about the joint that turns farthest from one frame to the next, if that is a jump."""
    local = window.local_rotations
    turned = np.rad2deg(rotation.angle_between(local[:-1], local[1:])).max(axis=0)
    n_more = int((turned > JUMP_DEG).sum()) - 1
    if n_more < 0:
        return []
    joint = int(turned.argmax())
    name = window.skeleton.names[joint].rpartition(":")[2]
    suffix = f"; {n_more} more joint{'s' * (n_more != 1)} by more than {JUMP_DEG:g}" if n_more else ""
    return [f"{name} turns {turned[joint]:.0f} degrees in one frame{suffix}"]
