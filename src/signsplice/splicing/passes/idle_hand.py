"""Idle hands: at a seam, those that are at rest on one side of it and away from rest on the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.motion import Clip, kinematics
from signsplice.rig.info import Arms, arms, rig_info
from signsplice.rig.roles import SIDES
from signsplice.splicing.gap import Cut

_NEAR_REST, _TURNED_RAD = 0.13, np.deg2rad(20.0)
"""A hand is at rest where it is this near to where it rests from the hips, in arm lengths, and turned by no more than
this. While the other hand signs, that of the synthetic signer stays within 0.12 and 16 degrees, however it rests; one
that signs too has 0.20 at least. (From the shoulders, which sway, it is 0.20 against 0.22.)
"""
_HANGING, _LOW = 0.25, 0.6
"""Height, in arm lengths above a hanging wrist, up to which an arm hangs; up to which both hands rest where both are
still (folded before the belly, held before the waist).
"""
_STILL_M_S = 0.3
_CLEAR_M = 0.03
"""A signing hand this near to the other arm may be about to touch it: that arm keeps its frames from there on."""


@dataclass(frozen=True)
class IdleHand:
    """A hand that is at rest on one side of a seam and away from it on the other.

    side: 0 left, 1 right.
    arrives: it goes to rest; else it comes from it.
    n_rest: frames next to the seam in which it rests.
    """

    side: int
    arrives: bool
    n_rest: int


def idle_hands(before: Clip, after: Clip, cut: Cut) -> list[IdleHand]:
    """The idle hands of a seam; none on a rig whose arms are not known by name."""
    if not rig_info(before.skeleton).has_arms:
        return []
    p, q = arms(before), arms(after)
    found = []
    for side in (0, 1):
        left = _frames_at_rest(p, side, cut.pre, -1)
        entered = _frames_at_rest(q, side, cut.post, 1)
        if bool(left) != bool(entered):
            found.append(IdleHand(side, entered > 0, left or entered))
    return found


def _frames_at_rest(motion: Arms, side: int, frame: int, step: int) -> int:
    """Frames from one on, forwards or backwards, in which a hand is where it rests at that end of the clip (step 1: the
    beginning); 0 where it does not rest there.
    """
    end = 0 if step > 0 else -1
    positions = motion.wrists - motion.hips[:, None]  # (T, 2, 3)
    edge = positions[:4] if step > 0 else positions[-4:]
    speeds = np.linalg.norm(np.diff(edge, axis=0), axis=-1).max(axis=0, initial=0.0) * motion.fps * motion.metres
    heights, is_still = motion.lift[end], speeds < _STILL_M_S
    hangs = heights[side] < _HANGING and is_still[side]
    if not (hangs or (heights.max() < _LOW and is_still.all())):
        return 0
    here, there = slice(frame, None, step), motion.hand_rotations[end, side]
    near = np.linalg.norm(positions[here, side] - positions[end, side], axis=-1) < _NEAR_REST * motion.length
    cosines = 0.5 * (np.einsum("tab,ab->t", motion.hand_rotations[here, side], there) - 1.0)
    run = near & (cosines > np.cos(_TURNED_RAD))
    return len(run) if run.all() else int(np.argmin(run))


def is_approached(clip: Clip, side: int) -> NDArray[np.bool_]:
    """For every frame (T,) whether the hand of the other side is near the arm of this one."""
    posed = collision.posed_capsules(clip.skeleton, *kinematics.forward(clip))
    body = posed.body
    own = [n for n, of in enumerate(body.sides) if of == SIDES[side] and body.parts[n] not in ("leg", "shoe")]
    other = body.groups.right if side == 0 else body.groups.left
    if not own or not other:
        return np.zeros(len(clip), bool)
    overlap, _ = collision.overlap(posed.starts, posed.ends, body.radii, other, own)
    return np.asarray(-overlap.max(axis=(1, 2)) * rig_info(clip.skeleton).sizes.unit.metres < _CLEAR_M)


def arm_joints(clip: Clip, side: int) -> tuple[int, ...]:
    """Every joint of an arm, from the collarbone to the fingertips, where the rig's arms are known."""
    info = rig_info(clip.skeleton)
    collarbone = info.roles.joints.get(f"{SIDES[side]}Shoulder", info.arm_joints[3 * side])
    return tuple(kinematics.subtree(clip.skeleton, collarbone))
