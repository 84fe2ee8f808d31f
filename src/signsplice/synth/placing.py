"""Hands of written signs brought to their written places in the motion, on the body as it moves.

What a word goes through (limits of the wrist, elbows that move steadily, head and trunk, hands that keep apart) leaves
a hand, or a finger that touches, up to some centimetres from where its posture is written. Wrists are moved by what is
missing at each posture, spread in time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.kinematics import rest_positions
from signsplice.synth import hand, pose
from signsplice.synth.contact import PosedSigner, posed_signer
from signsplice.synth.hand_parts import hand_part
from signsplice.synth.locations import MIRROR, WeakArm, axes, locate, on_joint, on_weak_arm
from signsplice.synth.phonology import ON_ARM, REST, Posture, Sign, on_arm
from signsplice.synth.segment_plan import TimedSegment, bump
from signsplice.synth.signer import COLLAR, JOINTS, SHOULDER, Signer, skeleton

_ROUNDS = 3
RADIUS_S = 0.3
"""How far from a posture in time a correction reaches."""
_LEFT_CM = 0.5
"""How far from its place a hand that touches nothing may stay."""
_LEFT_ALONE = ON_ARM | {REST}
"""Locations where hands are left alone: a forearm that crosses the other arm would be pushed about."""
_MOST_CM = 8.0
"""How far a hand is moved at most."""
_STEADY = 0.1
"""What keeps corrections at frames beside one another from growing."""
_NEAREST_CM = 16.5
"""How near to its shoulder a wrist is at least."""
_BEHIND_CM = 12.0
"""From how far behind the shoulder on wrists stay."""
_BEFORE = np.array([-0.35, 0.0, 0.9367])
"""Where it is else moved."""
_SIDES = ("Right", "Left")


def placed(states: FloatArray, segments: Sequence[TimedSegment], sign: Sign, signer: Signer, fps: float) -> FloatArray:
    """States (T, 65) of a whole word with hands at their places at the end of each of its segments."""
    signer = replace(signer, left_handed=False)
    wanted = [one for one in postures(segments, sign) if one[2].location not in _LEFT_ALONE]
    moves = np.zeros((len(states), 2, 3))
    if not wanted:
        return states
    frames = sorted({frame for frame, *_ in wanted})
    rows = {frame: row for row, frame in enumerate(frames)}
    centres = [_part(pose.hands(states)[frame, which], posture, signer) for frame, which, posture in wanted]
    quats = pose.hand_rotations(states[frames], signer)
    least, best = np.inf, moves
    for n in range(_ROUNDS + 1):
        posed = posed_signer(_moved(states[frames], quats, moves[frames], signer), signer)
        found = [
            (frame, which, _missing(posed, rows[frame], which, posture, sign, centre))
            for (frame, which, posture), centre in zip(wanted, centres, strict=True)
        ]
        left = sum(float(np.linalg.norm(miss)) for *_, miss in found)
        if left < least:
            least, best = left, moves
        if n == _ROUNDS or left == 0.0:
            break
        moves = moves + spread(found, len(states), max(3.0, RADIUS_S * fps))
        moves = _limited(moves, _MOST_CM)
    return _moved(states, pose.hand_rotations(states, signer), best, signer)


def _moved(states: FloatArray, quats: FloatArray, moves: FloatArray, signer: Signer) -> FloatArray:
    """States (T, 65) with hands, whose rotations are ``quats`` (T, 2, 4), moved (T, 2, 3)."""
    if not moves.any():
        return states
    moved = states.copy()
    both = pose.hands(moved)
    both[..., pose.WRIST] = _within_reach(both[..., pose.WRIST] + moves, signer)
    both[..., pose.ROTVEC] = pose.hand_rotvecs(both[..., pose.WRIST], quats, signer)
    return moved


def _within_reach(wrists: FloatArray, signer: Signer) -> FloatArray:
    """Wrists (T, 2, 3) moved before the shoulder where they are so near to it that no elbow bends so far; far behind it
    they stay.
    """
    away = wrists / signer.scale - (COLLAR + SHOULDER) * np.array([-signer.shoulders, 1.0, 1.0])
    along = away @ _BEFORE
    beside = np.square(away).sum(axis=-1) - np.square(along)
    push = np.maximum(np.sqrt(np.maximum(_NEAREST_CM**2 - beside, 0.0)) - along, 0.0)
    push = push * pose.smooth_step((along + _BEHIND_CM) / 8.0)
    return np.asarray(wrists + push[..., None] * _BEFORE * signer.scale)


def _limited(vectors: FloatArray, most: float) -> FloatArray:
    """Vectors (..., 3) of a length of at most ``most``."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors * np.minimum(1.0, most / np.maximum(length, 1e-9)))


def spread(
    missing: Sequence[tuple[int, int, FloatArray]], n_frames: int, radius: float, steady: float = _STEADY
) -> FloatArray:
    """Displacements (T, 2, C) that are what is missing (C,) at some frames of each hand, and fade in ``radius`` frames
    from them.
    """
    moves = np.zeros((n_frames, 2, len(missing[0][2])))
    for which in (0, 1):
        found = {frame: miss for frame, w, miss in missing if w == which}
        frames = np.array(sorted(found), np.intp)
        if len(frames):
            near = bump(frames, frames, radius) + steady * np.eye(len(frames))
            factors = np.linalg.solve(near, np.array([found[int(frame)] for frame in frames]))
            moves[:, which] = bump(np.arange(n_frames), frames, radius) @ factors
    return moves


def postures(segments: Sequence[TimedSegment], sign: Sign) -> Iterator[tuple[int, int, Posture]]:
    """Frame, hand (0 strong, 1 weak) and posture of each segment's end; of a movement that is made more often, of each
    time that its posture touches.
    """
    mirrored = sign.hands == "symmetric"
    for one in segments:
        hands = ((0, one.segment.strong), (1, one.segment.strong if mirrored else one.segment.weak))
        for which, posture in hands:
            if posture is not None:
                ends = [stop for _, stop in one.passes] if posture.touch and one.segment.times > 1 else [one.end]
                yield from ((frame, which, posture) for frame in ends)


def _part(hand_state: FloatArray, posture: Posture, signer: Signer) -> FloatArray:
    """Where the part of a right hand that a posture names is in the hand's axes, (3,), cm."""
    return hand_part(posture.part).centre(hand.points(hand_state[pose.FINGERS])) * signer.hands * signer.scale


def _missing(posed: PosedSigner, frame: int, which: int, posture: Posture, sign: Sign, part: FloatArray) -> FloatArray:
    """What moves the part of a hand from where it is to where a posture puts it, (3,), cm, in the chest's axes,
    mirrored for the weak hand as its state is. part: where it is in the hand's axes.
    """
    chest, origin = posed.rotations[frame, JOINTS["Spine2"]], posed.positions[frame, JOINTS["Spine2"]]
    joint, mirror = JOINTS[f"{_SIDES[which]}Hand"], MIRROR if which else np.ones(3)
    here = posed.positions[frame, joint] + posed.rotations[frame, joint] @ (part * mirror)
    missing = goal(posed, frame, which, posture, sign) - mirror * ((here - origin) @ chest)
    length = float(np.linalg.norm(missing))
    stays = 0.05 if posture.touch else _LEFT_CM * posed.signer.scale
    return np.asarray(missing * max(0.0, min(length, _MOST_CM) - stays) / max(length, 1e-9))


def goal(posed: PosedSigner, frame: int, which: int, posture: Posture, sign: Sign) -> FloatArray:
    """Where a posture puts the part of a hand, (3,), cm, in the chest's axes of a body as it is then, mirrored for the
    weak hand as its state is.
    """
    signer, state = posed.signer, posed.states[frame]
    chest, origin = posed.rotations[frame, JOINTS["Spine2"]], posed.positions[frame, JOINTS["Spine2"]]
    site, unit = hand_part(posture.part), signer.hands * signer.scale
    mirror = MIRROR if which else np.ones(3)
    weak = WeakArm(signer, state[27:54])
    if on_arm(posture.location):
        left = [JOINTS[name] for name in ("LeftArm", "LeftForeArm", "LeftHand")]
        shoulder, elbow, wrist = (posed.positions[frame, left] - origin) @ chest * MIRROR
        turned = chest.T @ posed.rotations[frame, left[2]]
        quat = rotation.from_matrix(MIRROR[:, None] * turned * MIRROR)
        found = on_weak_arm(posture.location, weak, shoulder, elbow, wrist, quat)
    else:
        found = locate(posture.location, weak)
    point, normal = found.point, found.normal
    if normal.any() and not on_arm(posture.location):  # the body as it is now
        carrier = JOINTS[on_joint(posture.location)]
        rest = rest_positions(skeleton(signer))
        turn = chest.T @ posed.rotations[frame, carrier]
        place = chest.T @ (posed.positions[frame, carrier] - origin)
        point = mirror * (place + turn @ (mirror * point + rest[JOINTS["Spine2"]] - rest[carrier]))
        normal = mirror * (turn @ (mirror * normal))
    wanted = point + axes(posture.shift) * signer.scale
    if normal.any():
        wanted = wanted + (site.skin * unit + posture.off * signer.scale) * normal
    elif sign.hands == "symmetric" and found.point[0] == 0.0:
        wanted = wanted + axes((site.skin * unit + posture.off * signer.scale, 0.0, 0.0))
    return np.asarray(wanted)
