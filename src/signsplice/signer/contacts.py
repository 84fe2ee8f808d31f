"""Brings the written parts of hands into their written touches, in the written directions; each requirement yields a
little if they conflict (damped least squares; Marquardt 1963).

The solution moves the wrist, the hand about it, and the elbow at the frames of touches, and fades between them.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.motion import FloatArray, rotation
from signsplice.signer import arms, locations, pose
from signsplice.signer.figure import ARMS, PosedSigner, out_of_capsules, pose_figure, surface
from signsplice.signer.hand import hand_part
from signsplice.signer.location_targets import (
    PostureHold,
    WrittenMotion,
    location_target,
    move_into_reach,
    part_centre,
    resolve_collisions,
)
from signsplice.signer.phonology import MIRRORED_HANDS, in_space
from signsplice.signer.signer import JOINTS, Signer


@dataclass(frozen=True)
class ContactCosts:
    """Costs of touches, and when their solution stops."""

    gap_cm: float = 0.12
    """Distance of the touching part from the skin that costs 1, cm."""
    depth_cm: float = 0.1
    """Depth of the rest of the hand beyond ``free_depth_cm`` that costs 1, cm."""
    free_depth_cm: float = 0.12
    """Depth that costs nothing, cm."""
    place_cm: float = 1.2
    """Distance from the written place that costs 1, cm."""
    turn: float = np.deg2rad(3.8)
    """Angle from the written directions that costs 1, radians."""
    settled: float = 1.0
    """Cost up to which a touch needs no solution."""
    solved: float = 0.3
    """Cost at which the solution of a touch stops."""
    rounds: int = 5
    """Number of rounds in which all touches are solved."""
    steps: int = 8
    """Largest number of steps of one solution."""


_COSTS = ContactCosts()

_MOVEMENT_SCALES = np.array([6.0] * 3 + [np.deg2rad(30.0)] * 3 + [np.deg2rad(15.0)])
"""Movements of wrist (cm), hand and elbow (radians) that cost 1."""
_LARGEST_STEP = np.array([2.0] * 3 + [np.deg2rad(10.0)] * 3 + [np.deg2rad(8.0)])
"""Largest movements in one step."""
_DERIVATIVE_STEPS = np.array([0.02] * 3 + [0.004] * 3 + [0.01])
"""Movements for finite-difference derivatives."""


@dataclass(frozen=True, eq=False)
class _ContactTarget(PostureHold):
    """A written touch.

    meets: whether two mirrored hands touch one another
    centre: (3,) centre of the touching part in its hand's axes, cm
    """

    meets: bool
    centre: FloatArray


@dataclass(frozen=True, eq=False)
class _Poses:
    """A signer at the frames of N touches.

    states: (N, 65)
    quats: (N, 2, 4) rotations of hands in the chest's axes
    elbows: (N, 2, 3) directions of elbows
    """

    states: FloatArray
    quats: FloatArray
    elbows: FloatArray

    @classmethod
    def of(cls, states: FloatArray, signer: Signer) -> _Poses:
        """The poses of states."""
        arm, swivels = arms.solve_arms(states, signer)
        quats = rotation.multiply(arm.fore, rotation.exp(pose.hands(states)[..., pose.ROTVEC]))
        return cls(states, quats, arms.directions_at(arm, swivels))


@dataclass(frozen=True, eq=False)
class _ContactProblem:
    """N touches to solve, each in its pose.

    word: their word
    poses: the signer's poses
    targets: the written touches
    goals: (N, 3) places of the touching parts, in the chest's axes, cm
    """

    word: WrittenMotion
    poses: _Poses
    targets: Sequence[_ContactTarget]
    goals: FloatArray

    def __getitem__(self, rows: NDArray[np.intp]) -> _ContactProblem:
        """Some of the touches."""
        current = self.poses
        poses = _Poses(current.states[rows], current.quats[rows], current.elbows[rows])
        return _ContactProblem(self.word, poses, [self.targets[row] for row in rows], self.goals[rows])


def solve_contacts(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """Brings hands of a whole word's states (T, 65), free of collisions, into their written touches."""
    signer, sign, mirrored = word.signer, word.sign, word.sign.hands in MIRRORED_HANDS
    touch_holds, still = word.partition_holds(lambda posture: posture.touch)
    targets = list[_ContactTarget]()
    for hold in touch_holds:
        meets = mirrored and in_space(hold.posture.location)
        if not (hold.which and meets):
            centre = part_centre(states, hold, signer) * pose.MIRRORS[hold.which]
            targets.append(_ContactTarget(**vars(hold), meets=meets, centre=centre))
    if not targets:
        return states
    best, moved = np.inf, states
    frames = np.array([target.first for target in targets])
    for n in range(_COSTS.rounds + 1):
        poses = _Poses.of(moved[frames], signer)
        posed = pose_figure(word.figure, poses.states, frames)
        goals = np.array([location_target(posed, row, target, sign) for row, target in enumerate(targets)])
        touches = _ContactProblem(word, poses, targets, goals)
        cost = np.square(_residuals(touches, np.zeros((len(frames), 1, 7)))).sum(axis=(1, 2))
        if cost.sum() < best:
            best, states = float(cost.sum()), moved
        if n == _COSTS.rounds:
            break
        unsettled = np.flatnonzero(cost > _COSTS.settled).tolist()
        if not unsettled:
            break
        like: dict[int, Hashable] = {row: row for row in unsettled}
        if n == 0:  # repeated touches begin alike, and those of hands that mirror one another
            like = {row: (mirrored or targets[row].which, targets[row].posture) for row in unsettled}
        elif sign.hands == "symmetric":
            like = {row: (targets[row].first, targets[row].posture) for row in unsettled}
        firsts = {key: row for row, key in reversed(like.items())}
        solved = dict(zip(firsts, _solve_arm_steps(touches[np.array([*firsts.values()])]), strict=True))
        steps = np.array([solved[like[row]] if row in like else np.zeros(7) for row in range(len(targets))])
        missing = [(replace(target, which=which), x) for target, x in zip(targets, steps, strict=True)
                   for which in ((0, 1) if target.meets else (target.which,))]  # fmt: skip
        moved = resolve_collisions(
            _move_arms(moved, word.interpolate_displacements(missing, still, 1 + n), signer), word
        )
    return states


def _move_arms(states: FloatArray, steps: FloatArray, signer: Signer) -> FloatArray:
    """Moves wrists, hands and elbows of both arms in states (N, 65) by ``steps`` (N, 2, 7)."""
    wrists, (arm, quats, swivels) = _arms(_Poses.of(states, signer), steps, signer)
    changed = states.copy()
    pose.hands(changed)[..., pose.WRIST] = wrists
    return arms.turn_arms(changed, arm, quats, swivels, signer)


def _arms(at: _Poses, steps: FloatArray, signer: Signer) -> tuple[FloatArray, tuple[pose.Arm, FloatArray, FloatArray]]:
    """Wrists (N, 2, 3) moved by ``steps`` (N, 2, 7); and their arms with hanging elbows, the rotations (N, 2, 4) of
    hands from these forearms, and the swivels (N, 2) of elbows.
    """
    wrists = move_into_reach(pose.hands(at.states)[..., pose.WRIST] + steps[..., :3], signer)
    arm = pose.solve_arm(wrists, signer)
    quats = rotation.multiply(rotation.exp(steps[..., 3:6]), at.quats)
    swivels = arms.swivels_to(arm, at.elbows) + steps[..., 6]
    return wrists, (arm, rotation.multiply(rotation.inverse(arm.fore), quats), swivels)


def _solve_arm_steps(touches: _ContactProblem) -> FloatArray:
    """Movements (N, 7) of wrist, hand and elbow that solve touches."""
    n = len(touches.targets)
    going, damping = np.arange(n), np.full(n, 0.1)
    x, best_x, best = np.zeros((n, 7)), np.zeros((n, 7)), np.full(n, np.inf)
    slopes: dict[int, tuple[FloatArray, FloatArray]] = {}
    probes = np.concatenate([np.zeros((1, 7)), np.diag(_DERIVATIVE_STEPS)])
    for _ in range(_COSTS.steps):
        residuals = _residuals(touches[going], x[going, None] + probes)  # (G, 8, R)
        for n, values in zip(going.tolist(), residuals, strict=True):
            cost = float(values[0] @ values[0])
            damping[n] *= 0.3 if cost < best[n] else 8.0
            if cost < best[n]:
                slope = (values[1:] - values[0]) / _DERIVATIVE_STEPS[:, None]
                best[n], best_x[n], slopes[n] = cost, x[n], (slope, values[0])
            slope, value = slopes[n]
            normal = slope @ slope.T
            normal += damping[n] * np.diag(np.diag(normal))
            step = -np.linalg.solve(normal, slope @ value)
            x[n] = best_x[n] + step * min(1.0, float((_LARGEST_STEP / np.maximum(np.abs(step), 1e-9)).min()))
        going = going[best[going] > _COSTS.solved]
        if not len(going):
            break
    return best_x


def _residuals(touches: _ContactProblem, x: FloatArray) -> FloatArray:
    """Residuals (N, K, R) of touches after movements (N, K, 7); 1 is equally bad in each number."""
    each, figure = touches[np.repeat(np.arange(len(x)), x.shape[1])], touches.word.figure
    hands = np.array([[target.meets or target.which == which for which in (0, 1)] for target in each.targets])
    _, (arm, quats, swivels) = _arms(each.poses, hands[..., None] * x.reshape(-1, 1, 7), figure.signer)
    frames = np.array([target.first for target in each.targets])
    posed = pose_figure(figure, each.poses.states, frames, (arm, pose.arm_angles_at(arm, quats, swivels)))
    rows = [slice(row * x.shape[1], (row + 1) * x.shape[1]) for row in range(len(x))]
    return np.array([_missing(posed, *args) for args in zip(rows, touches.targets, touches.goals, x, strict=True)])


def _missing(posed: PosedSigner, rows: slice, one: _ContactTarget, aim: FloatArray, x: FloatArray) -> FloatArray:
    capsules = posed.arms.capsules
    body, starts, ends = capsules.body, capsules.starts[rows], capsules.ends[rows]
    groups, radii, mirror = body.groups, body.radii, pose.MIRRORS[one.which]
    chest = posed.rotations[rows, JOINTS["Spine2"]]
    touching_hand, other_hand, arm = (
        (groups.left, groups.right, groups.right_arm) if one.which else (groups.right, groups.left, groups.left_arm)
    )
    unit, wrist = posed.signer.hands * posed.signer.scale, ARMS[one.which, 3]
    part = hand_part(one.posture.part)
    point = posed.positions[rows, wrist] + posed.rotations[rows, wrist] @ one.centre
    place = np.einsum("kb,kba->ka", point, chest) * mirror
    touched = np.array(other_hand if one.meets else surface(one.posture.location, body, one.which))
    gap = out_of_capsules(point, starts[:, touched], ends[:, touched], radii[touched])[1].min(axis=1) - part.skin * unit
    solid = [*groups.head, *groups.trunk, *arm, *other_hand]
    depth = collision.overlap(starts, ends, radii, touching_hand, solid)[0].max(axis=2)
    turned = mirror[:, None] * np.einsum("kba,kbc->kac", chest, posed.rotations[rows, wrist]) * mirror
    written = locations.facing(one.posture.palm, one.posture.fingers)
    turn = rotation.log(rotation.multiply(rotation.from_matrix(turned), rotation.inverse(written)))
    deep = np.maximum(depth - _COSTS.free_depth_cm, 0.0) / _COSTS.depth_cm
    return np.hstack(
        [gap[:, None] / _COSTS.gap_cm, deep, (place - aim) / _COSTS.place_cm, turn / _COSTS.turn, x / _MOVEMENT_SCALES]
    )
