"""Collision avoidance: no hand goes through head, trunk or the other hand between two signs.

The body is the capsules of ``body.capsules``. Where a transition would lead a hand into it, the wrist is led around:
for each stretch of frames inside, it is pushed out in one direction. The pushes are spread smoothly over neighbouring
frames, and fade to nothing, with their slope, at both signs. The frames of the signs are never changed. A sign may
itself press a hand into the capsules (the chin that it touches is not exactly where ours is): a transition may then be
as deep as a straight line between its two ends is.

Hands that touch one another the same way at both ends stay so: before any push they are moved to where one hand lay on
the other, each half of the way, and they may lie twice as deep as a straight line between the ends: where the ends lie
deep, the capsules are too thick for the signer. Two hands that meet elsewhere are pushed apart each half of the depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body import arm_ik, collision, swivel
from signsplice.body.capsules import BodyCapsules
from signsplice.motion import Clip, FloatArray, Skeleton, batch_clips, concatenate, curves, kinematics, rotation
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES

TOLERANCE_M = 0.003
"""A touch may press this deep, m."""
_FRAMES_AT_ONCE = 250
"""Frames of several transitions that are tested together: every pair of capsules is a number in each."""
_MAX_ROUNDS = 30
"""Rounds of pushes, at most, until a path around the body is found."""
_SLACK_M = 0.03
"""How much farther hands may move, m, before the pairs of near capsules are listed anew."""
_MAX_TRIES = 10
"""Paths that are tried: an arm may be too short for the first."""
_LEAST_GAIN = 0.05
"""Fraction of the remaining depth by which a try has to lessen it for another to follow."""
_LEAST_COSINE = 0.35
"""Least cosine between a stretch's direction and the exit direction of a frame by which a push is lengthened."""
_FORWARD_WEIGHT = 0.3
"""How much the chest's forward direction counts beside the exit directions; not where two hands meet, since it would
push both alike."""
_TOUCH_M = 0.006
"""Skin distance of two hands, m, over which a touch at both ends counts for less."""
_SAME_PLACE_M = 0.025
"""How much one hand's place on the other may differ between the ends, m, until a touch counts for less."""


@dataclass(frozen=True, eq=False)
class ClearedTransition:
    """A transition that leads around the body.

    clip: the new frames.
    depth_before: how deep a hand was in the body at the worst frame, beyond what both ends allow, m; 0 where no hand
        was, None on a rig whose arms are not known.
    depth: the same after collision avoidance.
    """

    clip: Clip
    depth_before: float | None
    depth: float | None


def avoid_collisions(filled: Clip, before: Clip, after: Clip, fixed: int | None = None) -> ClearedTransition:
    """A transition between the last frame of ``before`` and the first of ``after``, led around the body; unchanged on a
    rig whose arms are not known by name.

    fixed: side of an arm that stays as it is, 0 left or 1 right: where its hand lies is not looked at, and the other
        hand is led around that whole arm too.
    """
    return avoid_all_collisions([(filled, before, after)], fixed)[0]


def avoid_all_collisions(
    transitions: Sequence[tuple[Clip, Clip, Clip]], fixed: int | None = None
) -> list[ClearedTransition]:
    """``avoid_collisions`` of several transitions, each (``filled``, ``before``, ``after``)."""
    out = [ClearedTransition(filled, None, None) for filled, _, _ in transitions]
    windows = [(before[-1:], filled, after[:1]) for filled, before, after in transitions]
    for block in batch_clips(windows, _FRAMES_AT_ONCE):
        info = rig_info(block.clip.skeleton)
        if not info.has_arms:
            continue
        metres, firsts = info.sizes.unit.metres, block.starts[:-1]
        posed = _pose(block.clip, fixed)
        depth = _depths_of(posed.capsules.penetration(firsts.tolist())[0], fixed) * metres
        touches = np.logical_or.reduceat((depth > TOLERANCE_M).any(axis=1), firsts)
        for is_near, (k, frames) in zip(touches, block, strict=True):
            filled, before, after = transitions[k]
            if not is_near or _worst(depth[frames]) == 0.0:
                out[k] = ClearedTransition(filled, 0.0, 0.0)
            else:
                out[k] = _lead_around(filled, before, after, posed[frames], fixed)
    return out


def depths(filled: Clip, before: Clip, after: Clip) -> FloatArray:
    """How deep (n,) a hand lies in the body in each frame of a transition, beyond what both ends call for, m; 0 where
    none does.
    """
    depth, _ = _pose(_window(filled, before, after)).capsules.penetration()
    return _total_depth(_excess_depth(depth * rig_info(filled.skeleton).sizes.unit.metres).max(axis=1))


@dataclass(frozen=True, eq=False)
class _PosedWindow:
    """A transition with the frames on either side, posed.

    rotations: (T, J, 3, 3) of the joints in the world.
    positions: (T, J, 3) of the joints in the world, clip units.
    capsules: the body's.
    """

    skeleton: Skeleton
    rotations: FloatArray
    positions: FloatArray
    capsules: collision.PosedCapsules

    def __getitem__(self, frames: slice) -> _PosedWindow:
        return _PosedWindow(self.skeleton, self.rotations[frames], self.positions[frames], self.capsules[frames])

    @property
    def forward(self) -> FloatArray:
        """The direction in front of the chest (T, 3): at right angles to the shoulders and the trunk."""
        joints = rig_info(self.skeleton).arm_joints
        left, right, hips = (self.positions[:, joints[k]] for k in (0, 3, 6))
        forward = rotation.cross(left - right, left + right - 2.0 * hips)
        return np.asarray(forward / (np.linalg.norm(forward, axis=-1, keepdims=True) + 1e-12))


def _window(filled: Clip, before: Clip, after: Clip) -> Clip:
    return concatenate([before[-1:], filled, after[:1]])


def _pose(window: Clip, fixed: int | None = None) -> _PosedWindow:
    rotations, positions = kinematics.forward(window)
    capsules = collision.pose_capsules(window.skeleton, rotations, positions)
    if fixed is not None:
        capsules = replace(capsules, body=_with_solid_arm(capsules.body, fixed))
    return _PosedWindow(window.skeleton, rotations, positions, capsules)


def _with_solid_arm(body: BodyCapsules, side: int) -> BodyCapsules:
    """The same capsules, with the arm of one side counted as trunk."""
    solid = [part in ("sleeve", "cuff") and of == SIDES[side] for part, of in zip(body.parts, body.sides, strict=True)]
    parts = ("shirt" if more else part for part, more in zip(body.parts, solid, strict=True))
    return replace(body, parts=tuple(parts))


def turn_elbow(filled: Clip, before: Clip, after: Clip, side: int) -> Clip:
    """The transition with one elbow turned about the line from shoulder to wrist, so that the forearm keeps out of head
    and trunk as far as at both ends; hands stay where they are. On a rig whose arms are known.
    """
    info = rig_info(filled.skeleton)
    metres = info.sizes.unit.metres
    posed = _pose(_window(filled, before, after))
    body, starts, ends = posed.capsules.body, posed.capsules.starts, posed.capsules.ends
    own = [n for n, part in enumerate(body.parts) if part == "cuff" and body.sides[n] == SIDES[side]]
    solid = [*body.groups.head, *body.groups.trunk]
    if not own or not solid:
        return filled
    depth = metres * collision.overlap(starts, ends, body.radii, own, solid)[0][:, 0]  # (n + 2, S)
    t = np.linspace(0.0, 1.0, len(depth))[:, None]
    allowed = TOLERANCE_M + np.maximum((1.0 - t) * depth[0] + t * depth[-1], 0.0)
    shoulder, elbow, wrist = (metres * posed.positions[:, info.arm_joints[3 * side + k]] for k in range(3))
    turns = swivel.choose(
        swivel.BentArm(shoulder, elbow, wrist, metres * body.radii[own[0]]),
        swivel.Solid(metres * starts[:, solid], metres * ends[:, solid], metres * body.radii[solid]),
        allowed,
        filled.fps,
    )
    swivels = np.zeros((len(filled), 2))
    swivels[:, side] = turns[1:-1] * curves.fade_window(len(filled))
    return arm_ik.move_wrists(filled, np.zeros((len(filled), 2, 3)), swivels)


def _depths_of(depth: FloatArray, fixed: int | None) -> FloatArray:
    """Depths (T, 2) in which that of a hand that stays as it is counts for nothing."""
    return depth if fixed is None else np.where(np.arange(2) == fixed, -np.inf, depth)


def _lead_around(filled: Clip, before: Clip, after: Clip, posed: _PosedWindow, fixed: int | None) -> ClearedTransition:
    """``avoid_collisions`` of a transition that is posed already."""
    metres = rig_info(filled.skeleton).sizes.unit.metres
    best, first, least, held = filled, 0.0, np.inf, 0.0
    for n in range(_MAX_TRIES + 1):
        if n > 0:
            posed = _pose(_window(filled, before, after), fixed)
        near = posed.capsules.near_pairs(_SLACK_M / metres)
        start = np.zeros((len(posed.positions), 2, 3))
        if n == 0 and fixed is None:
            start, held = _holding_moves(posed, near, metres)
        worst = _worst(_depths_of(near.penetration()[0], fixed) * metres, held)
        if n == 0:
            first = worst
        gained = least - worst
        if gained > 0.0:
            best, least = filled, worst
        if worst == 0.0 or gained < _LEAST_GAIN * worst or n == _MAX_TRIES:
            break
        filled = arm_ik.move_wrists(filled, _avoiding_moves(posed, near, metres, start, fixed, held))
    return ClearedTransition(best, first, least)


def _holding_moves(posed: _PosedWindow, near: collision.NearPairs, metres: float) -> tuple[FloatArray, float]:
    """Moves (n + 2, 2, 3) that keep hands on one another which touch the same way at both ends, and how much they do
    so; near 0 for others.

    The middle of each hand has a place in the other hand's axes; between the ends it goes straight from one to the
    other. How much that counts falls smoothly with the skin distance of the pair of capsules that touches at both ends
    and with how far those places are from one another: hands that part and meet anew, or turn on one another, go their
    own way.
    """
    groups, starts = posed.capsules.body.groups, posed.capsules.starts
    distance = near.persistent_contact_distance() * metres
    if not np.isfinite(distance):
        return np.zeros((len(starts), 2, 3)), 0.0
    apart = starts[:, groups.left].mean(axis=1) - starts[:, groups.right].mean(axis=1)
    arm_joints = rig_info(posed.skeleton).arm_joints
    hands = posed.rotations[:, [arm_joints[2], arm_joints[5]]]
    first, last = (hands[k].swapaxes(1, 2) @ apart[k] for k in (0, -1))  # (2, 3) in each hand's axes
    change = float(np.linalg.norm(last - first, axis=-1).max()) * metres
    weight = float(np.exp(-max(distance, 0.0) / _TOUCH_M - (change / _SAME_PLACE_M) ** 2))
    places = first + np.linspace(0.0, 1.0, len(apart))[:, None, None] * (last - first)
    closer = weight * (np.einsum("thij,thj->thi", hands, places).mean(axis=1) - apart)
    return np.stack([0.5 * closer, -0.5 * closer], axis=1), weight


def _avoiding_moves(
    posed: _PosedWindow, near: collision.NearPairs, metres: float, moves: FloatArray, fixed: int | None, held: float
) -> FloatArray:
    """Moves (n, 2, 3) of the hands, if arms were long enough, that lead the frames between around the body, begun at
    ``moves`` (n + 2, 2, 3); ``near``: pairs of capsules within ``_SLACK_M``; ``fixed``: side of a hand that stays;
    ``held``: how much hands are held together.
    """
    n_between, forward = len(posed.positions) - 2, posed.forward
    fade, kernel = curves.fade_window(n_between)[:, None, None], _kernel(n_between)
    moves, slack = moves.copy(), _SLACK_M / metres
    for _ in range(_MAX_ROUNDS):
        farthest = 2.0 * float(np.linalg.norm(moves, axis=-1).max())  # two hands may move apart
        if farthest > slack:
            slack = farthest + _SLACK_M / metres
            near = posed.capsules.near_pairs(slack)
        depth, exits = near.penetration(moves)
        excess = _excess_depth(_depths_of(depth, fixed) * metres, held) / metres
        if excess.max() <= 0.0:
            break
        push = _pushes(excess + 0.3 * TOLERANCE_M / metres, exits[1:-1], forward[1:-1])
        moves[1:-1] += curves.smooth_over_time(push, kernel) * fade
    return moves[1:-1]


def _worst(depth: FloatArray, held: float = 0.0) -> float:
    """The greatest depth of the frames between beyond what both ends call for, m, from depths (n + 2, 2), m."""
    return float(_total_depth(_excess_depth(depth, held).max()))


def _excess_depth(depth: FloatArray, held: float = 0.0) -> FloatArray:
    """How much deeper (n, 2) than allowed each hand lies in the frames between, m, from depths (n + 2, 2) with those of
    both ends; held: how much hands are held together, from 0 to 1, which may then lie up to twice as deep.
    """
    t = np.linspace(0.0, 1.0, len(depth))[1:-1, None]
    ends = (1.0 + held) * np.maximum(depth[[0, -1]] - TOLERANCE_M, 0.0)
    return np.asarray(depth[1:-1] - (TOLERANCE_M + (1.0 - t) * ends[0] + t * ends[1]))


def _total_depth(excess: FloatArray) -> FloatArray:
    """Depth beyond what the ends call for, m, from the excess over what is allowed; 0 where nothing is too deep."""
    return np.where(excess > 0.0, excess + TOLERANCE_M, 0.0)


def _pushes(excess: FloatArray, exits: FloatArray, forward: FloatArray) -> FloatArray:
    """Pushes (n, 2, 3) out of the body where a hand is deeper than allowed by ``excess`` (n, 2).

    Every stretch is pushed in one direction: the mean of its frames' exit directions ``exits`` (n, 2, 3) and, where
    those disagree, forward. Where the two hands are in one another, each goes half of the way.
    """
    push = np.zeros_like(exits)
    meeting = (exits[:, 0] == -exits[:, 1]).all(axis=-1) & (excess > 0.0).all(axis=-1)
    forward, fraction = np.where(meeting[:, None], 0.0, _FORWARD_WEIGHT * forward), np.where(meeting[:, None], 0.5, 1.0)
    for side in (0, 1):
        for stretch in _stretches(excess[:, side] > 0.0):
            deep = excess[stretch, side, None]
            along = (deep * (exits[stretch, side] + forward[stretch])).sum(axis=0)
            along /= np.linalg.norm(along) + 1e-12
            cosine = np.maximum(exits[stretch, side] @ along, _LEAST_COSINE)
            push[stretch, side] = fraction[stretch] * deep / cosine[:, None] * along
    return push


def _stretches(inside: NDArray[np.bool_]) -> list[slice]:
    """Runs of frames that lie inside."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _kernel(n_frames: int) -> FloatArray:
    """Weights by which a push spreads over a gap: a bell an eighth of the gap wide, three frames at least."""
    width = max(1.2, n_frames / 8.0)
    side = int(np.ceil(2.5 * width))
    return np.asarray(np.exp(-0.5 * (np.arange(-side, side + 1) / width) ** 2))
