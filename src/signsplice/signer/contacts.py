"""Hands of written signs in touch with what they are written to touch, by the part that is written, in the written
directions: where not all of that can be had, each gives way a little (damped least squares; Marquardt 1963).

What moves is the wrist, the hand about it, and the elbow, at the frames of touches; between them this fades.
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

_ROUNDS, _STEPS = 5, 8
"""How often all touches are brought about, and in how many steps each time."""
_GAP_CM, _DEEP_CM, _PLACE_CM, _TURNED = 0.12, 0.1, 1.2, np.deg2rad(3.8)
"""What costs 1: distance of the part from the skin, depth of the rest of the hand beyond what is free, distance from
the written place along the skin, and angle from the written directions."""
_FREE_CM = 0.12
"""Depth that is free."""
_SETTLED, _REACHED = 1.0, 0.3
"""Cost of a touch that is left as it is, and with which one that is worked on is left."""
_SIZE = np.array([6.0] * 3 + [np.deg2rad(30.0)] * 3 + [np.deg2rad(15.0)])
"""Movements of wrist, hand and elbow that cost 1."""
_MOST = np.array([2.0] * 3 + [np.deg2rad(10.0)] * 3 + [np.deg2rad(8.0)])
"""Movements in one step, at most."""
_DIFFERENCE = np.array([0.02] * 3 + [0.004] * 3 + [0.01])
"""Movements by which derivatives are found."""


@dataclass(frozen=True, eq=False)
class _ContactTarget(PostureHold):
    """A touch that is written.

    meets: whether it is of both hands, which mirror one another
    centre: (3,) of the part that touches, in its hand's axes, cm
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
    """N touches to be brought about, each in its pose.

    word: whose they are
    poses: where the signer is
    targets: what is to touch
    goals: (N, 3) places of the parts that touch, in the chest's axes, cm
    """

    word: WrittenMotion
    poses: _Poses
    targets: Sequence[_ContactTarget]
    goals: FloatArray

    def __getitem__(self, rows: NDArray[np.intp]) -> _ContactProblem:
        """Some of the touches."""
        at = self.poses
        poses = _Poses(at.states[rows], at.quats[rows], at.elbows[rows])
        return _ContactProblem(self.word, poses, [self.targets[row] for row in rows], self.goals[rows])


def solve_contacts(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """States (T, 65) of a whole word, free of collisions, in which hands touch as they are written to."""
    signer, sign, mirrored = word.signer, word.sign, word.sign.hands in MIRRORED_HANDS
    wanted, still = word.partition_holds(lambda posture: posture.touch)
    targets = list[_ContactTarget]()
    for one in wanted:
        meets = mirrored and in_space(one.posture.location)
        if not (one.which and meets):
            centre = part_centre(states, one, signer) * pose.MIRRORS[one.which]
            targets.append(_ContactTarget(**vars(one), meets=meets, centre=centre))
    if not targets:
        return states
    best, moved = np.inf, states
    frames = np.array([one.first for one in targets])
    for n in range(_ROUNDS + 1):
        at = _Poses.of(moved[frames], signer)
        posed = pose_figure(word.figure, at.states, frames)
        goals = np.array([location_target(posed, row, one, sign) for row, one in enumerate(targets)])
        touches = _ContactProblem(word, at, targets, goals)
        cost = np.square(_residuals(touches, np.zeros((len(frames), 1, 7)))).sum(axis=(1, 2))
        if cost.sum() < best:
            best, states = float(cost.sum()), moved
        if n == _ROUNDS:
            break
        some = np.flatnonzero(cost > _SETTLED).tolist()
        if not some:
            break
        like: dict[int, Hashable] = {row: row for row in some}
        if n == 0:  # repeated touches begin alike, and those of hands that mirror one another
            like = {row: (mirrored or targets[row].which, targets[row].posture) for row in some}
        elif sign.hands == "symmetric":
            like = {row: (targets[row].first, targets[row].posture) for row in some}
        firsts = {key: row for row, key in reversed(like.items())}
        solved = dict(zip(firsts, _solve_arm_steps(touches[np.array([*firsts.values()])]), strict=True))
        found = np.array([solved[like[row]] if row in like else np.zeros(7) for row in range(len(targets))])
        missing = [(replace(one, which=which), x) for one, x in zip(targets, found, strict=True)
                   for which in ((0, 1) if one.meets else (one.which,))]  # fmt: skip
        moved = resolve_collisions(
            _move_arms(moved, word.interpolate_displacements(missing, still, 1 + n), signer), word
        )
    return states


def _move_arms(states: FloatArray, steps: FloatArray, signer: Signer) -> FloatArray:
    """States (N, 65) with both hands' wrists, hands and elbows moved by ``steps`` (N, 2, 7)."""
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
    """Movements (N, 7) of wrist, hand and elbow that bring about touches."""
    n = len(touches.targets)
    going, damping = np.arange(n), np.full(n, 0.1)
    x, best_x, best = np.zeros((n, 7)), np.zeros((n, 7)), np.full(n, np.inf)
    slopes: dict[int, tuple[FloatArray, FloatArray]] = {}
    probes = np.concatenate([np.zeros((1, 7)), np.diag(_DIFFERENCE)])
    for _ in range(_STEPS):
        found = _residuals(touches[going], x[going, None] + probes)  # (G, 8, R)
        for n, values in zip(going.tolist(), found, strict=True):
            cost = float(values[0] @ values[0])
            damping[n] *= 0.3 if cost < best[n] else 8.0
            if cost < best[n]:
                best[n], best_x[n], slopes[n] = cost, x[n], ((values[1:] - values[0]) / _DIFFERENCE[:, None], values[0])
            slope, value = slopes[n]
            normal = slope @ slope.T
            normal += damping[n] * np.diag(np.diag(normal))
            step = -np.linalg.solve(normal, slope @ value)
            x[n] = best_x[n] + step * min(1.0, float((_MOST / np.maximum(np.abs(step), 1e-9)).min()))
        going = going[best[going] > _REACHED]
        if not len(going):
            break
    return best_x


def _residuals(touches: _ContactProblem, x: FloatArray) -> FloatArray:
    """What is missing (N, K, R) of touches with movements (N, K, 7); 1 is as bad in each number."""
    each, figure = touches[np.repeat(np.arange(len(x)), x.shape[1])], touches.word.figure
    hands = np.array([[one.meets or one.which == which for which in (0, 1)] for one in each.targets])
    _, (arm, quats, swivels) = _arms(each.poses, hands[..., None] * x.reshape(-1, 1, 7), figure.signer)
    frames = np.array([one.first for one in each.targets])
    posed = pose_figure(figure, each.poses.states, frames, (arm, pose.wrist_at(arm, quats, swivels)))
    rows = [slice(row * x.shape[1], (row + 1) * x.shape[1]) for row in range(len(x))]
    return np.array([_missing(posed, *one) for one in zip(rows, touches.targets, touches.goals, x, strict=True)])


def _missing(posed: PosedSigner, rows: slice, one: _ContactTarget, aim: FloatArray, x: FloatArray) -> FloatArray:
    capsules = posed.arms.capsules
    body, starts, ends = capsules.body, capsules.starts[rows], capsules.ends[rows]
    groups, radii, mirror = body.groups, body.radii, pose.MIRRORS[one.which]
    chest = posed.rotations[rows, JOINTS["Spine2"]]
    own, other, arm = (
        (groups.left, groups.right, groups.right_arm) if one.which else (groups.right, groups.left, groups.left_arm)
    )
    unit, wrist = posed.signer.hands * posed.signer.scale, ARMS[one.which, 3]
    part = hand_part(one.posture.part)
    at = posed.positions[rows, wrist] + posed.rotations[rows, wrist] @ one.centre
    here = np.einsum("kb,kba->ka", at, chest) * mirror
    touched = np.array(other if one.meets else surface(one.posture.location, body, one.which))
    gap = out_of_capsules(at, starts[:, touched], ends[:, touched], radii[touched])[1].min(axis=1) - part.skin * unit
    solid = [*groups.head, *groups.trunk, *arm, *other]
    depth = collision.overlap(starts, ends, radii, own, solid)[0].max(axis=2)
    turned = mirror[:, None] * np.einsum("kba,kbc->kac", chest, posed.rotations[rows, wrist]) * mirror
    written = locations.facing(one.posture.palm, one.posture.fingers)
    away = rotation.log(rotation.multiply(rotation.from_matrix(turned), rotation.inverse(written)))
    deep = np.maximum(depth - _FREE_CM, 0.0) / _DEEP_CM
    return np.hstack([gap[:, None] / _GAP_CM, deep, (here - aim) / _PLACE_CM, away / _TURNED, x / _SIZE])
