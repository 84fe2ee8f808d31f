"""A clip on another body: rotations first, then wrists and elbows moved so that hands keep places and contacts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from signsplice.body import arm_ik, swivel
from signsplice.body.capsules import BodyCapsules, capsule_ends
from signsplice.body.fit import Fit, PosedBody
from signsplice.body.touch import forearm_pairs, near_pairs, pair_gaps
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.rig.arms import active_span, arms
from signsplice.rig.info import rig_info

Float = NDArray[np.float64]


def posed_body(clip: Clip, body: BodyCapsules) -> PosedBody:
    """A clip's body over time, in metres."""
    info = rig_info(clip.skeleton)
    metres = info.sizes.unit.metres
    rotations, positions = kinematics.forward(clip)
    starts, ends = capsule_ends(body, rotations, positions)
    joints = info.arm_joints
    shoulders, elbows, wrists = (metres * positions[:, [joints[k], joints[3 + k]]] for k in range(3))
    lengths = np.linalg.norm(elbows[0] - shoulders[0], axis=-1) + np.linalg.norm(wrists[0] - elbows[0], axis=-1)
    return PosedBody(body, metres * starts, metres * ends, metres * body.radii, shoulders, elbows, wrists, lengths)


def fitted(source: Clip, source_body: BodyCapsules, carried: Clip, body: BodyCapsules) -> Clip:
    """``carried``, the rotations of ``source`` on another skeleton, with wrists moved to keep places and contacts."""
    fit = Fit(posed_body(source, source_body), posed_body(carried, body), source.fps, signing(source))
    metres = rig_info(carried.skeleton).sizes.unit.metres
    moves = fit.moves()
    swivels = _swivels(fit, carried, moves / metres, metres)
    moved = posed_body(arm_ik.move_wrists(carried, moves / metres, swivels), body)
    return arm_ik.move_wrists(carried, fit.again(moves, moved) / metres, swivels)


def _swivels(fit: Fit, carried: Clip, moves: Float, metres: float) -> Float:
    """Turns (T, 2) of both elbows that keep forearms as clear of head and trunk as at the source."""
    shoulders, elbows, wrists = (metres * part for part in arm_ik.moved_elbows(carried, moves))
    source, target = fit.source, fit.carried
    shared = frozenset(source.body.keys) & frozenset(target.body.keys)
    theirs, ours = (forearm_pairs(body, shared) for body in (source.body, target.body))
    out = np.zeros((len(moves), 2))
    for side in (0, 1):
        (columns,) = np.nonzero(ours.own_side == side)
        if not len(columns):
            continue
        own = ours.own[columns[0]]
        starts, ends = target.starts.copy(), target.ends.copy()
        starts[:, own], ends[:, own] = elbows[:, side], wrists[:, side]
        frames, k = near_pairs(starts, ends, target.radii, ours, 0.03)
        solids = np.intersect1d(k, columns)
        if not len(solids):
            continue
        n = len(moves)
        frames, k = np.repeat(np.arange(n), len(solids)), np.tile(solids, n)
        then = pair_gaps(source.starts, source.ends, source.radii, theirs, frames, k).distance
        allowed = np.maximum(-then.reshape(n, -1), 0.0)
        rows = ours.other[solids]
        solid = target.starts[:, rows], target.ends[:, rows], target.radii[rows]
        arm = shoulders[:, side], elbows[:, side], wrists[:, side]
        out[:, side] = swivel.choose(*arm, target.radii[own], solid, allowed, fit.fps)
    return out


_FADE_S = 0.15
_HANGING, _RAISED = 0.95, 0.85
"""Height of a shoulder above its wrist, arm lengths, from which on an arm hangs, and up to which it does not."""


def signing(clip: Clip) -> Float:
    """How much each arm signs in each frame (T, 2): 1 while it is raised and the arms are away from rest, else 0."""
    seen = arms(clip)
    start, stop = active_span(seen)
    frames = np.arange(len(clip))
    outside = np.maximum(np.maximum(start - frames, frames - (stop - 1)), 0) / clip.fps
    drop = (seen.shoulders - seen.wrists) @ seen.up / seen.length
    raised = np.clip((_HANGING - drop) / (_HANGING - _RAISED), 0.0, 1.0)
    return np.asarray(raised * np.clip(1.0 - outside / _FADE_S, 0.0, 1.0)[:, None])
