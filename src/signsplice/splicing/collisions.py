"""Collision avoidance: no hand goes through head, trunk or the other hand between two signs.

The body consists of the capsules of ``body.capsules``. If a transition leads a hand into it, the wrist is pushed out,
in one direction for each stretch of frames inside. The pushes are spread smoothly over neighbouring frames and fade to
zero, with zero slope, at both signs. The frames of the signs never change. A sign may itself press a hand into the
capsules (a touched chin is not exactly at the capsule's surface): the transition may then be as deep as a straight line
between the depths of its ends.

Hands that touch one another the same way at both ends keep that contact: before any push each hand is moved half of the
way to it, and the hands may lie twice as deep as a straight line between the ends, since deep ends show that the
capsules are too thick for the signer. Hands that meet otherwise are pushed apart by half of the depth each.
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


@dataclass(frozen=True)
class AvoidanceSettings:
    """Limits and weights of the pushes that lead hands around the body."""

    frames_at_once: int = 250
    """Frames tested together, of several transitions: each takes a number per pair of capsules."""
    most_rounds: int = 30
    """Largest number of rounds of pushes per path."""
    most_tries: int = 10
    """Largest number of paths that are tried: an arm may be too short for the first."""
    least_gain: float = 0.05
    """Fraction of the remaining depth that a try must remove for another to follow."""
    listed_travel_m: float = 0.03
    """Distance that hands may move before the pairs of close capsules are listed again, m."""
    least_cosine: float = 0.35
    """Lower limit of the cosine, by which pushes are divided, of a stretch's direction and a frame's exit direction."""
    forward_weight: float = 0.3
    """Weight of the chest's forward direction against the exit directions; 0 when two hands meet, since it would push
    both the same way.
    """
    touch_fade_m: float = 0.006
    """Skin distance of two hands over which the weight of a touch at both ends decays by a factor e, m."""
    place_fade_m: float = 0.025
    """Change of one hand's place on the other between the ends over which that weight decays by a factor e, m."""


_AVOIDANCE = AvoidanceSettings()

TOLERANCE_M = 0.003
"""Depth that still counts as a touch, m."""


@dataclass(frozen=True, eq=False)
class ClearedTransition:
    """A transition that leads around the body.

    clip: the new frames.
    depth_before: largest depth of a hand in the body beyond what both ends allow, m; 0 if no hand was inside, None if
        the rig's arms are unknown.
    depth: the same after collision avoidance.
    """

    clip: Clip
    depth_before: float | None
    depth: float | None


def avoid_collisions(
    filled: Clip, before: Clip, after: Clip, fixed: int | None = None, most_tries: int = _AVOIDANCE.most_tries
) -> ClearedTransition:
    """Leads a transition between the last frame of ``before`` and the first of ``after`` around the body; returns it
    unchanged if the rig's arms are not known by name.

    fixed: side of an arm that does not move, 0 left or 1 right: the depth of its hand is ignored, and the other hand is
        led around that whole arm too.
    most_tries: largest number of paths that are tried.
    """
    return avoid_all_collisions([(filled, before, after)], fixed, most_tries)[0]


def avoid_all_collisions(
    transitions: Sequence[tuple[Clip, Clip, Clip]],
    fixed: int | None = None,
    most_tries: int = _AVOIDANCE.most_tries,
) -> list[ClearedTransition]:
    """``avoid_collisions`` of several transitions, each (``filled``, ``before``, ``after``)."""
    results = [ClearedTransition(filled, None, None) for filled, _, _ in transitions]
    windows = [(before[-1:], filled, after[:1]) for filled, before, after in transitions]
    for block in batch_clips(windows, _AVOIDANCE.frames_at_once):
        info = rig_info(block.clip.skeleton)
        if not info.has_arms:
            continue
        metres, firsts = info.sizes.unit.metres, block.starts[:-1]
        posed = _pose(block.clip, fixed)
        depth = posed.capsules.penetration(firsts.tolist(), fixed)[0] * metres
        touches = np.logical_or.reduceat((depth > TOLERANCE_M).any(axis=1), firsts)
        for is_near, (k, frames) in zip(touches, block, strict=True):
            filled, before, after = transitions[k]
            if not is_near or _worst(depth[frames]) == 0.0:
                results[k] = ClearedTransition(filled, 0.0, 0.0)
            else:
                results[k] = _lead_around(filled, (before, after), posed[frames], depth[frames], fixed, most_tries)
    return results


def depths(filled: Clip, before: Clip, after: Clip, fixed: int | None = None) -> FloatArray:
    """Returns the depth (n,) of the deeper hand in the body in each frame of a transition, beyond that of both ends, m;
    0 if no hand is inside. ``fixed``: as in ``avoid_collisions``.
    """
    depth, _ = _pose(_window(filled, before, after), fixed).capsules.penetration(fixed=fixed)
    metres = rig_info(filled.skeleton).sizes.unit.metres
    return _total_depth(_excess_depth(depth * metres).max(axis=1))


@dataclass(frozen=True, eq=False)
class _PosedWindow:
    """A transition with the frames on either side, posed.

    rotations: (T, J, 3, 3) of the joints in the world.
    positions: (T, J, 3) of the joints in the world, clip units.
    capsules: posed capsules of the body.
    """

    skeleton: Skeleton
    rotations: FloatArray
    positions: FloatArray
    capsules: collision.PosedCapsules

    def __getitem__(self, frames: slice) -> _PosedWindow:
        return _PosedWindow(self.skeleton, self.rotations[frames], self.positions[frames], self.capsules[frames])

    @property
    def forward(self) -> FloatArray:
        """The forward direction of the chest (T, 3): at right angles to the line of the shoulders and the trunk."""
        joints = rig_info(self.skeleton).arm_joints
        left_shoulder, right_shoulder, hips = (self.positions[:, joints[k]] for k in (0, 3, 6))
        forward = rotation.cross(left_shoulder - right_shoulder, left_shoulder + right_shoulder - 2.0 * hips)
        return np.asarray(forward / (np.linalg.norm(forward, axis=-1, keepdims=True) + 1e-12))


def _window(filled: Clip, before: Clip, after: Clip) -> Clip:
    return concatenate([before[-1:], filled, after[:1]])


def _pose(window: Clip, fixed: int | None = None) -> _PosedWindow:
    rotations, positions = kinematics.forward(window)
    capsules = collision.pose_capsules(window.skeleton, rotations, positions)
    if fixed is not None:
        capsules = replace(capsules, body=capsules.body.derived[_with_solid_arms][fixed])
    return _PosedWindow(window.skeleton, rotations, positions, capsules)


def _with_solid_arms(body: BodyCapsules) -> list[BodyCapsules]:
    """Returns the same capsules twice, with the left and with the right arm counted as trunk."""
    rows = [*zip(body.parts, body.sides, strict=True)]
    return [
        replace(body, parts=tuple("shirt" if part in ("sleeve", "cuff") and of == side else part for part, of in rows))
        for side in SIDES
    ]


def turn_elbow(filled: Clip, before: Clip, after: Clip, side: int) -> Clip:
    """Turns one elbow about the line from shoulder to wrist, so that the forearm lies no deeper in head and trunk than
    at both ends; hands do not move. The rig's arms must be known.
    """
    info = rig_info(filled.skeleton)
    metres = info.sizes.unit.metres
    posed = _pose(_window(filled, before, after))
    body, starts, ends = posed.capsules.body, posed.capsules.starts, posed.capsules.ends
    forearm = [n for n, part in enumerate(body.parts) if part == "cuff" and body.sides[n] == SIDES[side]]
    solid = [*body.groups.head, *body.groups.trunk]
    if not forearm or not solid:
        return filled
    depth = metres * collision.overlap(starts, ends, body.radii, forearm, solid)[0][:, 0]  # (n + 2, S)
    t = np.linspace(0.0, 1.0, len(depth))[:, None]
    allowed = TOLERANCE_M + np.maximum((1.0 - t) * depth[0] + t * depth[-1], 0.0)
    shoulder, elbow, wrist = (metres * posed.positions[:, info.arm_joints[3 * side + k]] for k in range(3))
    turns = swivel.choose(
        swivel.BentArm(shoulder, elbow, wrist, metres * body.radii[forearm[0]]),
        swivel.Obstacles(metres * starts[:, solid], metres * ends[:, solid], metres * body.radii[solid]),
        allowed,
        filled.fps,
    )
    swivels = np.zeros((len(filled), 2))
    swivels[:, side] = turns[1:-1] * curves.fade_window(len(filled))
    return arm_ik.move_wrists(filled, np.zeros((len(filled), 2, 3)), swivels)


def _lead_around(
    filled: Clip, edges: tuple[Clip, Clip], posed: _PosedWindow, depth: FloatArray, fixed: int | None, most_tries: int
) -> ClearedTransition:
    """``avoid_collisions`` for a posed transition between ``edges``, whose hands have depths (n + 2, 2), m."""
    metres = rig_info(filled.skeleton).sizes.unit.metres
    best, first, least, hold_weight = filled, 0.0, np.inf, 0.0
    for n in range(most_tries + 1):
        if n > 0:
            posed = _pose(_window(filled, *edges), fixed)
            depth = posed.capsules.penetration(fixed=fixed)[0] * metres
        start = np.zeros((len(posed.positions), 2, 3))
        if n == 0 and fixed is None:
            start, hold_weight = _holding_moves(posed, metres)
        worst = _worst(depth, hold_weight)
        if n == 0:
            first = worst
        gained = least - worst
        if gained > 0.0:
            best, least = filled, worst
        if worst == 0.0 or gained < _AVOIDANCE.least_gain * worst or n == most_tries:
            break
        filled = arm_ik.move_wrists(filled, _avoiding_moves(posed, metres, start, fixed, hold_weight))
    return ClearedTransition(best, first, least)


def _holding_moves(posed: _PosedWindow, metres: float) -> tuple[FloatArray, float]:
    """Returns moves (n + 2, 2, 3) that keep hands together which touch the same way at both ends, and their weight,
    which is near 0 for other hands.

    The middle of each hand has a place in the other hand's axes, which is interpolated linearly between the ends. The
    weight decays with the skin distance of the pair of capsules that touches at both ends, and with the distance
    between those places: hands that part and meet again, or turn on one another, move freely.
    """
    groups, starts = posed.capsules.body.groups, posed.capsules.starts
    ends = posed.capsules[:: len(starts) - 1]
    distance = ends.near_pairs(_AVOIDANCE.listed_travel_m / metres).persistent_contact_distance() * metres
    if not np.isfinite(distance):
        return np.zeros((len(starts), 2, 3)), 0.0
    offset = starts[:, groups.left].mean(axis=1) - starts[:, groups.right].mean(axis=1)
    arm_joints = rig_info(posed.skeleton).arm_joints
    hands = posed.rotations[:, [arm_joints[2], arm_joints[5]]]
    first, last = (hands[k].swapaxes(1, 2) @ offset[k] for k in (0, -1))  # (2, 3) in each hand's axes
    change = float(np.linalg.norm(last - first, axis=-1).max()) * metres
    weight = float(np.exp(-max(distance, 0.0) / _AVOIDANCE.touch_fade_m - (change / _AVOIDANCE.place_fade_m) ** 2))
    places = first + np.linspace(0.0, 1.0, len(offset))[:, None, None] * (last - first)
    closer = weight * (np.einsum("thij,thj->thi", hands, places).mean(axis=1) - offset)
    return np.stack([0.5 * closer, -0.5 * closer], axis=1), weight


def _avoiding_moves(
    posed: _PosedWindow, metres: float, moves: FloatArray, fixed: int | None, held: float
) -> FloatArray:
    """Returns moves (n, 2, 3) of the hands that lead the new frames around the body if the arms are long enough,
    starting from ``moves`` (n + 2, 2, 3); ``fixed``: side of a hand that does not move; ``held``: weight with which
    hands are held together.
    """
    n_between, forward = len(posed.positions) - 2, posed.forward
    fade, kernel = curves.fade_window(n_between)[:, None, None], _kernel(n_between)
    moves, slack = moves.copy(), _AVOIDANCE.listed_travel_m / metres
    listed = np.full_like(moves, np.inf)  # where hands were when pairs were listed
    for _ in range(_AVOIDANCE.most_rounds):
        if np.linalg.norm(moves - listed, axis=-1).sum(axis=1).max() > slack:
            listed = moves.copy()
            near = posed.capsules.near_pairs(slack, moves=listed, fixed=fixed)
        depth, exits = near.penetration(moves)
        excess = _excess_depth(depth * metres, held) / metres
        if excess.max() <= 0.0:
            break
        push = _pushes(excess + 0.3 * TOLERANCE_M / metres, exits[1:-1], forward[1:-1])
        moves[1:-1] += curves.smooth_over_time(push, kernel) * fade
    return moves[1:-1]


def _worst(depth: FloatArray, held: float = 0.0) -> float:
    """Returns the largest depth of the new frames beyond that of both ends, m, from depths (n + 2, 2), m."""
    return float(_total_depth(_excess_depth(depth, held).max()))


def _excess_depth(depth: FloatArray, held: float = 0.0) -> FloatArray:
    """Returns how much deeper (n, 2) than allowed each hand lies in the new frames, m, from depths (n + 2, 2) that
    include both ends; held: weight, 0 to 1, with which hands are held together: these may lie up to twice as deep.
    """
    t = np.linspace(0.0, 1.0, len(depth))[1:-1, None]
    ends = (1.0 + held) * np.maximum(depth[[0, -1]] - TOLERANCE_M, 0.0)
    return np.asarray(depth[1:-1] - (TOLERANCE_M + (1.0 - t) * ends[0] + t * ends[1]))


def _total_depth(excess: FloatArray) -> FloatArray:
    """Returns the depth beyond that of the ends, m, from the excess over the allowed depth; 0 if that is negative."""
    return np.where(excess > 0.0, excess + TOLERANCE_M, 0.0)


def _pushes(excess: FloatArray, exits: FloatArray, forward: FloatArray) -> FloatArray:
    """Returns pushes (n, 2, 3) out of the body for hands that are deeper than allowed by ``excess`` (n, 2).

    Every stretch is pushed in one direction: the mean of its frames' exit directions ``exits`` (n, 2, 3) and, if these
    disagree, forward. Two hands that are in one another are pushed half of the way each.
    """
    push = np.zeros_like(exits)
    meeting = (exits[:, 0] == -exits[:, 1]).all(axis=-1) & (excess > 0.0).all(axis=-1)
    forward = np.where(meeting[:, None], 0.0, _AVOIDANCE.forward_weight * forward)
    fraction = np.where(meeting[:, None], 0.5, 1.0)
    for side in (0, 1):
        for stretch in _stretches(excess[:, side] > 0.0):
            deep = excess[stretch, side, None]
            direction = (deep * (exits[stretch, side] + forward[stretch])).sum(axis=0)
            direction /= np.linalg.norm(direction) + 1e-12
            cosine = np.maximum(exits[stretch, side] @ direction, _AVOIDANCE.least_cosine)
            push[stretch, side] = fraction[stretch] * deep / cosine[:, None] * direction
    return push


def _stretches(inside: NDArray[np.bool_]) -> list[slice]:
    """Returns the runs of frames that lie inside."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _kernel(n_frames: int) -> FloatArray:
    """Returns the weights that spread a push over a gap: a bell an eighth of the gap wide, at least three frames."""
    width = max(1.2, n_frames / 8.0)
    side = int(np.ceil(2.5 * width))
    return np.asarray(np.exp(-0.5 * (np.arange(-side, side + 1) / width) ** 2))
