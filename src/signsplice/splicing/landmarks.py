"""Landmarks in the new frames between two words.

A point that both words show goes from one to the other by the limited Hermite curve of ``curves``, with its velocity at
both ends. A point that one word does not show at its end is carried by the joint of the fitted person that it belongs
to, as far from it as it was seen, and fades by its confidence: so a hand that comes into view arrives with its arm.

Rejected: to hang every point on its joint and let the pose's path carry it. Hidden frames of real signing are then
filled worse, with and without turning the points with the joint (workshop/docs/measured/landmarks.md): a pose that is
guessed from one camera trembles more than the points that it was guessed from. Nor a Gaussian process over three frames
at either end, which also keeps accelerations: it fills hidden frames better (26.7 thousandths of a shoulder width
instead of 31.4), but between words it carries on the fall of a hand, which then drops .3 shoulder widths instead of .1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body.landmarks import find_anchors
from signsplice.motion import Clip, FloatArray, concatenate, copy_unchecked, kinematics
from signsplice.motion.cache import CACHE
from signsplice.motion.points import Points, concatenate_points
from signsplice.splicing.curves import CLASSICAL_TRANSITION, TRANSITIONS, CurveProblem, CurveTransition
from signsplice.splicing.passes import Pass
from signsplice.splicing.seam import REFORMED, Seam


@dataclass(frozen=True)
class CarryLandmarks(Pass):
    """Sets the landmarks of a seam's new frames; runs last, on their final pose."""

    def concerns(self, seam: Seam) -> bool:
        """Whether there are new frames and both words have landmarks of one layout."""
        before, after = seam.before.retimed.points, seam.after.retimed.points
        has_both = before is not None and after is not None and before.layout == after.layout
        return has_both and seam.frames is not None

    def change(self, seam: Seam) -> Seam:
        """Returns the seam with landmarks in its new frames; those of a pause are the word's."""
        cut, n_held, new = seam.retimed_cut, seam.n_held, seam.new_frames
        assert seam.before_clip.points is not None
        points: Points | None = seam.before_clip.points[cut.pre + 1 : cut.pre + 1 + n_held]
        if n_held < len(new):
            ends = seam.before_clip, cut.pre + n_held, new[n_held:], seam.after_clip, cut.post
            carried = carry_points(*ends, follows_pose=seam.kind == REFORMED)
            points = concatenate_points([points, carried])
        return replace(seam, frames=copy_unchecked(new, points=points))


def carry_points(before: Clip, last: int, new: Clip, after: Clip, first: int, follows_pose: bool = False) -> Points:
    """Returns the landmarks of ``new`` frames between frame ``last`` of one clip and frame ``first`` of another.

    follows_pose: whether all points also move as their joints leave the straight way, as a letter is formed again.
    """
    ends = [(before, max(last - 1, 0)), (before, last), (after, first), (after, min(first + 1, len(after) - 1))]
    points = [clip.points[frame : frame + 1] for clip, frame in ends if clip.points is not None]
    values = np.concatenate([part.values for part in points]).astype(np.float64)  # (4, P, D)
    confidence = np.concatenate([part.confidence for part in points])  # (4, P)
    seen = confidence > 0.0
    values[~seen] = 0.0
    carried = _curve(values, seen, len(new), new.fps)
    moved = (seen[1] | seen[2]) if follows_pose else (seen[1] != seen[2])
    if len(rows := np.flatnonzero(moved & points[0].layout.in_image)):
        window = concatenate([before[last : last + 1], new, after[first : first + 1]])
        _carry_by_joints(carried, seen[1:3, rows], rows, points[0], window)
    u = (np.arange(1, len(new) + 1) / (len(new) + 1))[:, None]
    faded = confidence[1] + u * (confidence[2] - confidence[1])
    return points[0].changed(carried.astype(np.float32), faded.astype(np.float32))


def _curve(values: FloatArray, seen: NDArray[np.bool_], n_frames: int, fps: float) -> FloatArray:
    """Returns values (n, P, D) between the second and third of four ends (4, P, D), of which not all were ``seen``
    (4, P); those of the seen end where the other was not.
    """
    start = np.where(seen[1, :, None], values[1], values[2])
    stop = np.where(seen[2, :, None], values[2], values[1])
    both = (seen[1] & seen[2])[:, None]
    leaving = np.where(both & seen[0, :, None], values[1] - values[0], 0.0)
    entering = np.where(both & seen[3, :, None], values[3] - values[2], 0.0)
    hermite = TRANSITIONS[CLASSICAL_TRANSITION]
    assert isinstance(hermite, CurveTransition)
    times = np.arange(1, n_frames + 1) / fps
    problem = CurveProblem(stop - start, (leaving * fps, entering * fps), times, (n_frames + 1) / fps)
    return np.asarray(start + hermite.curve(problem))


def _carry_by_joints(
    carried: FloatArray, seen: NDArray[np.bool_], rows: NDArray[np.intp], points: Points, window: Clip
) -> None:
    """Moves points of ``carried`` (n, P, D), at ``rows`` (R,), as their joints leave the place where a word shows them,
    or, where both words do, the straight way between.

    seen: (2, R) whether the word before and the one after show them.
    window: the new frames and one on either side.
    """
    anchors = CACHE.recent(find_anchors, points.layout, window.skeleton, most=8)
    rotations, positions = kinematics.forward(window)
    joints = anchors.joints[rows]
    at = positions[:, joints] + np.einsum("tpab,pb->tpa", rotations[:, joints], anchors.offsets[rows])  # (n + 2, R, 3)
    u = np.linspace(0.0, 1.0, len(at))[1:-1, None] * np.ones(len(rows))
    u = np.where(seen[0], np.where(seen[1], u, 0.0), 1.0)[..., None]
    shift = points.framing.scale * (at[1:-1] - at[0] - u * (at[-1] - at[0]))
    carried[:, rows, 0] += shift[..., 0]
    carried[:, rows, 1] -= shift[..., 1]
