"""A clip on another body: rotations first, then wrists and elbows moved so that hands keep places and contacts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from signsplice.body import arm_ik, swivel
from signsplice.body.capsules import BodyCapsules, capsule_ends
from signsplice.body.fit import Fit, PosedBody
from signsplice.body.touch import gaps
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
    arms_ = [metres * part for part in arm_ik.moved_elbows(carried, moves)]
    source, target = fit.source, fit.carried
    keys = [k for k in source.body.keys if k in target.body.keys]
    names = [source.body.keys[n] for n in (*source.body.groups.head, *source.body.groups.trunk)]
    names = [k for k in names if k in keys and not (k.endswith("Shoulder") or k.startswith("collar"))]
    ours, theirs = ([body.keys.index(k) for k in names] for body in (target.body, source.body))
    out = np.zeros((len(moves), 2))
    for side, word in enumerate(("left", "right")):
        own = source.body.keys.index(f"{word}LowerArm")
        n, count = len(moves), len(names)
        p = np.repeat(source.starts[:, own], count, axis=0)
        u = np.repeat(source.ends[:, own], count, axis=0) - p
        q = source.starts[:, theirs].reshape(-1, 3)
        radii = source.radii
        found = gaps(p, u, q, source.ends[:, theirs].reshape(-1, 3) - q, np.broadcast_to(radii[own], (n * count, 2)), np.tile(radii[theirs], (n, 1)))
        allowed = np.maximum(-found.distance.reshape(n, count), 0.0)
        solid = target.starts[:, ours], target.ends[:, ours], target.radii[ours]
        own = target.body.keys.index(f"{word}LowerArm")
        out[:, side] = swivel.choose(*(part[:, side] for part in arms_), target.radii[own], solid, allowed, fit.fps)
    return out


_FADE_S = 0.15


def signing(clip: Clip) -> Float:
    """How much each frame (T,) is signing: 1 while the arms are away from rest, fading to 0 outside."""
    start, stop = active_span(arms(clip))
    frames = np.arange(len(clip))
    outside = np.maximum(np.maximum(start - frames, frames - (stop - 1)), 0) / clip.fps
    return np.asarray(np.clip(1.0 - outside / _FADE_S, 0.0, 1.0))
