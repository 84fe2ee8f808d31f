"""Contacts of thumbs within their hand, kept on a hand of other proportions.

The contact of the thumb defines a handshape (it distinguishes F, O and S). With copied rotations the thumb misses
fingers that are longer or shorter than the source's. So thumb and finger turn a little at their first joints: a damped
least-squares problem (Gauss-Newton, Wampler 1986) of a few unknowns, for each hand and frame,

    E(x) = sum w |(p - q)(x) - n (r + d)|^2 + mu |x|^2 + sum c (x_f - x_g)^2

over pairs of a thumb's and a finger's or the palm's capsules, with nearest points p, q, direction n and clearance d as
at the source, and w that falls with d. The last sum keeps neighbouring fingers f, g together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import BodyCapsules
from signsplice.body.collision import Clearances, clearances
from signsplice.body.contacts import PosedBody, pose_body
from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.motion.curves import smooth_over_time
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES

Index = NDArray[np.intp]

ALIKE = 0.03
"""Hands whose bones have the same proportions up to this fraction keep their contacts by rotations alone."""
MOST_RADIANS = float(np.deg2rad(15.0))
"""Largest turn of a first joint, radians."""
_NEAR_M = 0.012
"""Largest clearance of a pair that counts, at the source, m."""
_FADE_M = 0.004
"""Clearance over which the weight of a pair falls by a factor e, m."""
_DAMPING = 2e-4
"""mu, m^2: a fingertip is 6 to 8 cm from its first joint, so that a touch outweighs it twenty times."""
_TOGETHER = 2e-3
"""c of neighbouring fingers that point the same way, m^2."""
_APART_RADIANS = float(np.deg2rad(15.0))
"""Angle between neighbouring fingers over which c falls, radians."""
_STEPS = 3
_WIDTH_S = 0.05
"""Time over which a turn comes and goes, s."""
_THUMB = ("ThumbMetacarpal", "ThumbProximal", "ThumbDistal")
_SEGMENTS = ("Palm", "Proximal", "Intermediate", "Distal")
_FLEXION = np.array([0.0, 0.0, 1.0])
"""Axis, in the T-pose, about which fingers bend at their knuckles."""


def keep_thumb_contacts(source: Clip, source_body: BodyCapsules, carried: Clip, body: BodyCapsules) -> Clip:
    """Returns ``carried``, the rotations of ``source`` on another skeleton, with thumbs and fingers turned at their
    first joints so that thumbs keep their contacts; unchanged if hands have the same proportions.
    """
    hands = [hand for side in SIDES if (hand := _hand(side, source_body, body, carried))]
    if not hands:
        return carried
    posed_source, posed = pose_body(source, source_body), pose_body(carried, body)
    local = np.array(carried.local_rotations)
    global_rotations, _ = kinematics.forward(carried)
    for hand in hands:
        _turn(hand, posed_source, posed, global_rotations, carried, local)
    return replace(carried, local_rotations=local)


@dataclass(frozen=True, eq=False)
class _Hand:
    """A hand of two bodies, with K pairs of a thumb's capsule and a finger's or the palm's.

    source, target: rows (K,) of the thumb's and of the other capsule on each body.
    fingers: (K,) 1 to 4 for a finger's capsule, 0 for the palm's, which no finger moves.
    firsts: first joints of the thumb and of the four fingers.
    pivots: (5,) rows of the target's capsules that begin at these joints.
    neighbours: (4,) rows of the source's capsules that begin at the four fingers' first joints.
    """

    source: tuple[Index, Index]
    target: tuple[Index, Index]
    fingers: Index
    firsts: tuple[int, ...]
    pivots: Index
    neighbours: Index


def _hand(side: str, a: BodyCapsules, b: BodyCapsules, clip: Clip) -> _Hand | None:
    """Returns the pairs of a hand; None if both bodies have the same hand, or one lacks the thumb or a finger."""
    shared = frozenset(a.keys) & frozenset(b.keys)
    first_keys = [side + next((key for key in _THUMB if side + key in shared), "")]
    first_keys += [f"{side}{finger}Proximal" for finger in FINGERS[1:]]
    if not shared.issuperset(first_keys) or _are_alike(a, b, [key for key in shared if key.startswith(side)]):
        return None
    joints = rig_info(clip.skeleton).roles.joints
    thumb_keys = [side + key for key in _THUMB[1:] if side + key in shared]
    other_keys = [(n, key) for n, f in enumerate(FINGERS[1:], 1) for s in _SEGMENTS if (key := side + f + s) in shared]
    pairs = [(thumb_key, key, 0 if key.endswith("Palm") else n) for thumb_key in thumb_keys for n, key in other_keys]
    first, second = ([body.keys.index(pair[k]) for pair in pairs] for body, k in ((a, 0), (a, 1)))
    third, fourth = ([body.keys.index(pair[k]) for pair in pairs] for body, k in ((b, 0), (b, 1)))
    return _Hand(
        source=(np.array(first, np.intp), np.array(second, np.intp)),
        target=(np.array(third, np.intp), np.array(fourth, np.intp)),
        fingers=np.array([n for *_, n in pairs], np.intp),
        firsts=tuple(joints[key] for key in first_keys),
        pivots=np.array([b.keys.index(key) for key in first_keys], np.intp),
        neighbours=np.array([a.keys.index(key) for key in first_keys[1:]], np.intp),
    )


def _are_alike(a: BodyCapsules, b: BodyCapsules, keys: list[str]) -> bool:
    """Tells whether the bones of two hands have the same proportions."""
    first, second = (
        dict(zip(body.keys, np.linalg.norm(body.ends - body.starts, axis=-1), strict=True)) for body in (a, b)
    )
    ratios = np.array([second[key] / first[key] for key in keys if any(f in key for f in FINGERS) and first[key] > 0.0])
    return bool(np.abs(ratios / np.median(ratios) - 1.0).max() < ALIKE)


def _turn(
    hand: _Hand, source: PosedBody, carried: PosedBody, rotations: FloatArray, clip: Clip, local: FloatArray
) -> None:
    """Turn the first joints of a hand in the local rotations (T, J, 4) of a clip."""
    n_frames, n_pairs = len(local), len(hand.fingers)
    gaps = _clearances(source, hand.source)
    fade = np.exp(-np.maximum(gaps.distance, 0.0) / _FADE_M) - np.exp(-_NEAR_M / _FADE_M)
    weight = np.maximum(fade, 0.0).reshape(n_frames, n_pairs)
    frames, pairs = np.flatnonzero(weight.any(axis=1)), np.flatnonzero(weight.any(axis=0))
    if not len(frames):
        return
    chosen = np.ix_(frames, pairs)
    parts = zip(hand.target, (gaps.own_at, gaps.other_at), strict=True)
    points = [_points(carried, frames, rows[pairs], shares.reshape(weight.shape)[chosen]) for rows, shares in parts]
    (p, thick), (q, other_thick) = points
    clearance, normals = gaps.distance.reshape(weight.shape)[chosen], gaps.normals.reshape(*weight.shape, 3)[chosen]
    goal = normals * (clearance + thick + other_thick)[..., None]
    info = rig_info(clip.skeleton)
    axes = np.stack([
        rotations[frames, joint] @ rotation.rotate(rotation.inverse(info.t_pose.rotations[joint]), _FLEXION)
        for joint in hand.firsts[1:]
    ], axis=1)  # fmt: skip
    pivots = carried.starts[frames][:, hand.pivots]
    rotvecs = np.zeros((n_frames, len(hand.firsts), 3))
    coupled = _coupling(source.ends[frames][:, hand.neighbours] - source.starts[frames][:, hand.neighbours])
    rotvecs[frames] = _solve(p, q, goal, weight[chosen], hand.fingers[pairs], pivots, axes, coupled)
    width = _WIDTH_S * clip.fps
    side = int(np.ceil(3.0 * width))
    rotvecs = smooth_over_time(rotvecs, np.exp(-0.5 * (np.arange(-side, side + 1) / width) ** 2))
    for n, joint in enumerate(hand.firsts):
        above = rotation.from_matrix(rotations[:, clip.skeleton.parents[joint]])
        local_turn = rotation.multiply(rotation.multiply(rotation.inverse(above), rotation.exp(rotvecs[:, n])), above)
        local[:, joint] = rotation.multiply(local_turn, local[:, joint])


def _coupling(bones: FloatArray) -> FloatArray:
    """Returns the damping (F, 7, 7) of the unknowns, from the fingers' first bones (F, 4, 3) at the source."""
    axes = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    angle = np.arccos(np.clip(np.einsum("fix,fix->fi", axes[:, :-1], axes[:, 1:]), -1.0, 1.0))
    together = _TOGETHER * np.exp(-((angle / _APART_RADIANS) ** 2))
    damping = np.tile(_DAMPING * np.eye(7), (len(bones), 1, 1))
    for n in range(3):
        for i, j, sign in ((3 + n, 3 + n, 1.0), (4 + n, 4 + n, 1.0), (3 + n, 4 + n, -1.0), (4 + n, 3 + n, -1.0)):
            damping[:, i, j] += sign * together[:, n]
    return damping


def _solve(
    p: FloatArray,
    q: FloatArray,
    goal: FloatArray,
    weight: FloatArray,
    fingers: Index,
    pivots: FloatArray,
    axes: FloatArray,
    damping: FloatArray,
) -> FloatArray:
    """Returns rotation vectors (F, 5, 3), in the world, of the first joints of the thumb and four fingers.

    p, q: (F, K, 3) points of the thumb and of its counterpart. goal: (F, K, 3) target of p - q. weight: (F, K).
    pivots: (F, 5, 3) the first joints. axes: (F, 4, 3) unit vectors about which the fingers bend.
    damping: (F, 7, 7) of the unknowns.
    """
    n = len(p)
    x = np.zeros((n, 7))  # the thumb's rotation vector, and an angle for each finger
    moves = fingers > 0
    column = np.maximum(fingers - 1, 0)
    for _ in range(_STEPS):
        vectors = np.concatenate([x[:, None, :3], x[:, 3:, None] * axes], axis=1)
        quaternions = rotation.exp(vectors)
        thumb = rotation.rotate(quaternions[:, None, 0], p - pivots[:, :1])
        arm = q - pivots[:, 1 + column]
        finger = np.where(moves[:, None], rotation.rotate(quaternions[:, 1 + column], arm), arm)
        error = (pivots[:, :1] + thumb) - (pivots[:, 1 + column] + finger) - goal
        jacobian = np.zeros((*error.shape, 7))  # (F, K, 3, 7)
        for axis in range(3):
            jacobian[..., axis] = rotation.cross(np.eye(3)[axis], thumb)
        swing = np.where(moves[:, None], rotation.cross(axes[:, column], finger), 0.0)
        jacobian[:, range(len(column)), :, 3 + column] -= swing.swapaxes(0, 1)
        weighted = weight[..., None, None] * jacobian
        normal = np.einsum("fkci,fkcj->fij", weighted, jacobian) + damping
        slope = np.einsum("fkci,fkc->fi", weighted, error) + np.einsum("fij,fj->fi", damping, x)
        x = x - np.linalg.solve(normal, slope[..., None])[..., 0]
        x[:, :3] *= np.minimum(1.0, MOST_RADIANS / (np.linalg.norm(x[:, :3], axis=1, keepdims=True) + 1e-12))
        x[:, 3:] = np.clip(x[:, 3:], -MOST_RADIANS, MOST_RADIANS)
    return np.concatenate([x[:, None, :3], x[:, 3:, None] * axes], axis=1)


def _clearances(posed: PosedBody, rows: tuple[Index, Index]) -> Clearances:
    """Returns skin distances of all pairs in all frames, frame by frame (T K)."""
    p, u, q, v = (
        part.reshape(-1, 3)
        for row in rows
        for part in (posed.starts[:, row], posed.ends[:, row] - posed.starts[:, row])
    )
    own_radii, other_radii = (np.tile(posed.radii[row], (len(posed.starts), 1)) for row in rows)
    return clearances(p - q, u, v, own_radii, other_radii)


def _points(posed: PosedBody, frames: Index, rows: Index, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns points (F, K, 3) along capsules at shares ``at`` (F, K) of their axes, and the radii (F, K) there."""
    start, end, radii = posed.starts[np.ix_(frames, rows)], posed.ends[np.ix_(frames, rows)], posed.radii[rows]
    return start + at[..., None] * (end - start), radii[:, 0] + at * (radii[:, 1] - radii[:, 0])
