"""Hands of a clip: wrists, bends of fingers, how far the two differ as in a mirror; and the strokes of synthetic words,
which are known, and where a sentence shows them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.motion import Clip, FloatArray, Skeleton, kinematics
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES, finger_roles
from signsplice.signer.planner import IsolatedWord
from signsplice.splicing.engine import Span
from signsplice_workshop.corpora.pairs import Pairs


def wrist_joints(skeleton: Skeleton) -> list[int]:
    """Joints of the left and the right wrist; those whose role is not known are left out."""
    joints = rig_info(skeleton).roles.joints
    return [joints[role] for role in ("leftHand", "rightHand") if role in joints]


def wrist_positions(clip: Clip) -> FloatArray:
    """Positions (T, W, 3) of the wrists in the order of ``wrist_joints``, m."""
    _, positions = kinematics.forward(clip, wrist_joints(clip.skeleton))
    return positions * rig_info(clip.skeleton).sizes.unit.metres


def strong_wrist(clip: Clip, strong: str) -> FloatArray:
    """Positions (T, 3) of the wrist of the strong side ("left" or "right"), m, on a rig with both hands known."""
    return wrist_positions(clip)[:, 0 if strong == "left" else 1]


def strong_side(pairs: Pairs, word: int = 0) -> str:
    """The strong side, "left" or "right", of the signer of a corpus's word, by default of the first signer."""
    return "left" if pairs.signers[word >= len(pairs.head["words"]) // 2].left_handed else "right"


def busier_side(clip: Clip) -> str:
    """The side, "left" or "right", whose wrist moves farther, which is taken for a real signer's strong side."""
    left, right = np.linalg.norm(np.diff(wrist_positions(clip), axis=0), axis=-1).sum(axis=0)
    return "left" if left > right else "right"


MIRRORED_SPEED, MIRRORED_COSINE, MIRRORED_FRAMES = 0.3, 0.5, 6
"""Hands mirror each other while both wrists are faster than this (arm lengths a second), one wrist's velocity and the
mirror image of the other's have at least this cosine, and both for at least so many frames.
"""
_LARGEST_LAG = 3


@dataclass(frozen=True, eq=False)
class HandLikeness:
    """How far two hands differ that mirror each other.

    cm: distance of the right wrist from the mirror image of the left one in N frames (N,). The mirror is the plane
        through the middle of the shoulders, across their line.
    lag: by how many frames one hand is behind the other, for each stretch in which both wrists become faster than
        ``MIRRORED_SPEED`` (K,): the shift, up to three frames, at which the speeds of both correlate best.
    """

    cm: FloatArray
    lag: FloatArray


def hand_likeness(clips: Sequence[Clip], stretches: Sequence[Sequence[tuple[int, int]]] | None = None) -> HandLikeness:
    """How far the hands differ in stretches [begin, end] of frames of each clip, or where ``MIRRORED_SPEED`` and the
    numbers with it say that they mirror each other.
    """
    distances, lags = [np.empty(0)], []
    for n, clip in enumerate(clips):
        hands, speed, cosine = _mirror_wrist_motion(clip)
        found = _alike(speed, cosine) if stretches is None else stretches[n]
        for begin, end in found:
            distances.append(np.linalg.norm(hands[0, begin : end + 1] - hands[1, begin : end + 1], axis=-1))
            if end > begin and speed[:, begin:end].max(axis=1).min() > MIRRORED_SPEED:
                lags.append(_lag(speed, begin, end))
    return HandLikeness(100.0 * np.concatenate(distances), np.array(lags))


def _mirror_wrist_motion(clip: Clip) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The right wrist and the left one's mirror image (2, T, 3), m, their speeds (2, T - 1), arm lengths a second, and
    the cosine (T - 1,) between their velocities.
    """
    info = rig_info(clip.skeleton)
    roles = ("rightHand", "leftHand", "leftUpperArm", "rightUpperArm")
    _, positions = kinematics.forward(clip, [info.roles.joints[role] for role in roles])
    right, left, one, other = np.swapaxes(positions * info.sizes.unit.metres, 0, 1)  # (T, 3) each
    middle = 0.5 * (one + other)
    across = (one - other) / np.linalg.norm(one - other, axis=-1, keepdims=True)
    image = left - middle
    image = image - 2.0 * (image * across).sum(-1, keepdims=True) * across
    hands = np.stack([right - middle, image])
    velocity = np.diff(hands, axis=1) * clip.fps / (info.sizes.arm_length * info.sizes.unit.metres)
    speed = np.linalg.norm(velocity, axis=-1)
    return hands, speed, np.einsum("ti,ti->t", *velocity) / np.maximum(speed.prod(axis=0), 1e-12)


def _alike(speed: FloatArray, cosine: FloatArray) -> list[tuple[int, int]]:
    """Stretches [begin, end] in which the hands mirror each other."""
    alike = (speed.min(axis=0) > MIRRORED_SPEED) & (cosine > MIRRORED_COSINE)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], alike, [False]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= MIRRORED_FRAMES]


def _lag(speed: FloatArray, first: int, stop: int) -> float:
    """By how many frames one of two speeds (2, T) is behind the other over [first, stop), with a fraction of a frame
    from a parabola through the best shift and its neighbours.
    """
    shifts = [s for s in range(-_LARGEST_LAG, _LARGEST_LAG + 1) if first + s >= 0 and stop + s <= speed.shape[1]]
    scores = np.array([_correlation(speed[0, first:stop], speed[1, first + s : stop + s]) for s in shifts])
    best = int(np.argmax(scores))
    if not 0 < best < len(shifts) - 1:
        return float(abs(shifts[best]))
    before, at, after = scores[best - 1 : best + 2]
    bow = before - 2.0 * at + after
    return float(abs(shifts[best] + (0.5 * (before - after) / bow if bow < 0.0 else 0.0)))


def _correlation(a: FloatArray, b: FloatArray) -> float:
    a, b = a - a.mean(), b - b.mean()
    return float((a * b).sum() / max(float(np.sqrt((a**2).sum() * (b**2).sum())), 1e-12))


def flexions(clip: Clip) -> dict[str, FloatArray]:
    """Finger and joint number ("Index 2") -> its bend in every frame, degrees, left hand then right (2 T,).

    The bend is the angle between the bones on either side; joint 1 is the nearest to the wrist. Fingers whose joints a
    rig lacks are left out.
    """
    roles = rig_info(clip.skeleton).roles.joints
    rotations, positions = kinematics.forward(clip)
    tip_positions = np.swapaxes(kinematics.tip_positions(clip, rotations, positions), 0, 1)
    tips = dict(zip((site.joint for site in clip.skeleton.end_sites), tip_positions, strict=True))
    out: dict[str, list[FloatArray]] = {}
    for side in SIDES:
        for finger in FINGERS:
            chain = [f"{side}Hand", *(side + role for role in finger_roles(finger))]
            if not all(role in roles for role in chain):
                continue
            points = [positions[:, roles[role]] for role in chain]  # (T, 3) each
            last = roles[chain[-1]]
            children = clip.skeleton.children[last]
            if last in tips:
                points.append(tips[last])
            elif children:
                points.append(positions[:, children[0]])
            for n, (a, b, c) in enumerate(zip(points[:-2], points[1:-1], points[2:], strict=True), 1):
                u, v = b - a, c - b
                cosine = (u * v).sum(-1) / np.maximum(np.linalg.norm(u, axis=-1) * np.linalg.norm(v, axis=-1), 1e-12)
                out.setdefault(f"{finger} {n}", []).append(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))
    return {name: np.concatenate(rows) for name, rows in out.items()}


def stroke(word: IsolatedWord) -> tuple[int, int]:
    """First and last frame of the movements of a sign, or of its only posture."""
    events = word.events
    if events.first is None or not events.passes:
        return events.start, events.end
    return events.first[0], events.passes[-1][1]


def keeps_stroke(word: IsolatedWord, first: int, stop: int) -> bool:
    """Whether frames [first, stop) hold all movements of the sign, or a frame of its only posture."""
    begin, end = stroke(word)
    if word.events.first is None or not word.events.passes:
        return max(first, begin) < min(stop, end + 1)
    return first <= begin and end < stop


def output_frame(span: Span, frame: int) -> float:
    """The output frame at which a sign's span shows a recorded frame, or would if it went on."""
    if span.warp is None or span.source is None:
        return frame - (span.source or (0, 0))[0] + span.output[0]
    outputs, sources = np.array(span.warp).T
    return float(np.interp(frame, sources, outputs))
