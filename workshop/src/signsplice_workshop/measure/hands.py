"""Measures the hands of a clip: wrists, bends of fingers, differences from a mirror image; also the strokes of
synthetic words, and the frames of a sentence that show them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion import Clip, FloatArray, Skeleton, kinematics
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES, finger_roles
from signsplice.signer.planner import IsolatedWord
from signsplice.splicing.engine import Span
from signsplice_workshop.corpora.pairs import Pairs


def wrist_joints(skeleton: Skeleton) -> list[int]:
    """Returns the joints of the left and the right wrist; joints whose role is not known are left out."""
    joints = rig_info(skeleton).roles.joints
    return [joints[role] for role in ("leftHand", "rightHand") if role in joints]


def wrist_positions(clip: Clip) -> FloatArray:
    """Returns the positions (T, W, 3) of the wrists in the order of ``wrist_joints``, m."""
    _, positions = kinematics.forward(clip, wrist_joints(clip.skeleton))
    return positions * rig_info(clip.skeleton).sizes.unit.metres


def strong_wrist(clip: Clip, strong: str) -> FloatArray:
    """Returns the positions (T, 3) of the wrist of the strong side ("left" or "right"), m, on a rig with both hands
    known.
    """
    return wrist_positions(clip)[:, 0 if strong == "left" else 1]


def strong_side(pairs: Pairs, word: int = 0) -> str:
    """Returns the strong side, "left" or "right", of the signer of a corpus's word, by default of the first signer."""
    return "left" if pairs.signers[word >= len(pairs.head["words"]) // 2].left_handed else "right"


def busier_side(clip: Clip) -> str:
    """Returns the side, "left" or "right", whose wrist moves farther; it counts as a real signer's strong side."""
    left, right = np.linalg.norm(np.diff(wrist_positions(clip), axis=0), axis=-1).sum(axis=0)
    return "left" if left > right else "right"


MIRRORED_SPEED, MIRRORED_COSINE, MIRRORED_FRAMES = 0.3, 0.5, 6
"""Hands mirror each other while both wrists are faster than the first (arm lengths a second), the cosine between one
wrist's velocity and the mirror image of the other's exceeds the second, and both hold for at least the third (frames).
"""
_LARGEST_LAG = 3


@dataclass(frozen=True, eq=False)
class HandLikeness:
    """Differences of two hands that mirror each other.

    cm: distance of the right wrist from the mirror image of the left one in N frames (N,). The mirror is the plane
        through the middle of the shoulders, across their line.
    lag: number of frames by which one hand is behind the other, for each stretch in which both wrists become faster
        than ``MIRRORED_SPEED`` (K,): the shift, up to three frames, at which the speeds of both correlate best.
    """

    cm: FloatArray
    lag: FloatArray


def hand_likeness(clips: Sequence[Clip], stretches: Sequence[Sequence[tuple[int, int]]] | None = None) -> HandLikeness:
    """Returns the differences of the hands in stretches [begin, end] of frames of each clip; None finds the stretches
    in which the hands mirror each other (``MIRRORED_SPEED``, ``MIRRORED_COSINE``, ``MIRRORED_FRAMES``).
    """
    distances, lags = [np.empty(0)], []
    for n, clip in enumerate(clips):
        hands, speed, cosine = _mirror_wrist_motion(clip)
        clip_stretches = _find_mirrored_stretches(speed, cosine) if stretches is None else stretches[n]
        for begin, end in clip_stretches:
            distances.append(np.linalg.norm(hands[0, begin : end + 1] - hands[1, begin : end + 1], axis=-1))
            if end > begin and speed[:, begin:end].max(axis=1).min() > MIRRORED_SPEED:
                lags.append(_lag(speed, begin, end))
    return HandLikeness(100.0 * np.concatenate(distances), np.array(lags))


def _mirror_wrist_motion(clip: Clip) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns the right wrist and the left one's mirror image (2, T, 3), m, their speeds (2, T - 1), arm lengths a
    second, and the cosine (T - 1,) between their velocities.
    """
    info = rig_info(clip.skeleton)
    roles = ("rightHand", "leftHand", "leftUpperArm", "rightUpperArm")
    _, positions = kinematics.forward(clip, [info.roles.joints[role] for role in roles])
    right, left, left_shoulder, right_shoulder = np.swapaxes(positions * info.sizes.unit.metres, 0, 1)  # (T, 3) each
    middle = 0.5 * (left_shoulder + right_shoulder)
    mirror_normal = (left_shoulder - right_shoulder) / np.linalg.norm(
        left_shoulder - right_shoulder, axis=-1, keepdims=True
    )
    image = left - middle
    image = image - 2.0 * (image * mirror_normal).sum(-1, keepdims=True) * mirror_normal
    hands = np.stack([right - middle, image])
    velocity = np.diff(hands, axis=1) * clip.fps / (info.sizes.arm_length * info.sizes.unit.metres)
    speed = np.linalg.norm(velocity, axis=-1)
    return hands, speed, np.einsum("ti,ti->t", *velocity) / np.maximum(speed.prod(axis=0), 1e-12)


def _find_mirrored_stretches(speed: FloatArray, cosine: FloatArray) -> list[tuple[int, int]]:
    """Returns the stretches [begin, end] in which the hands mirror each other."""
    is_mirrored = (speed.min(axis=0) > MIRRORED_SPEED) & (cosine > MIRRORED_COSINE)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_mirrored, [False]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= MIRRORED_FRAMES]


def _lag(speed: FloatArray, first: int, stop: int) -> float:
    """Returns the number of frames by which one of two speeds (2, T) is behind the other over [first, stop), with a
    fraction of a frame from a parabola through the best shift and its neighbours.
    """
    shifts = [
        shift
        for shift in range(-_LARGEST_LAG, _LARGEST_LAG + 1)
        if first + shift >= 0 and stop + shift <= speed.shape[1]
    ]
    scores = np.array([_correlation(speed[0, first:stop], speed[1, first + shift : stop + shift]) for shift in shifts])
    best = int(np.argmax(scores))
    if not 0 < best < len(shifts) - 1:
        return float(abs(shifts[best]))
    before, peak, after = scores[best - 1 : best + 2]
    curvature = before - 2.0 * peak + after
    return float(abs(shifts[best] + (0.5 * (before - after) / curvature if curvature < 0.0 else 0.0)))


def _correlation(a: FloatArray, b: FloatArray) -> float:
    a, b = a - a.mean(), b - b.mean()
    return float((a * b).sum() / max(float(np.sqrt((a**2).sum() * (b**2).sum())), 1e-12))


def flexions(clip: Clip) -> dict[str, FloatArray]:
    """Returns finger and joint number ("Index 2") -> its bend in every frame, degrees, left hand then right (2 T,).

    The bend is the angle between the bones on either side; joint 1 is the nearest to the wrist. Fingers whose joints a
    rig lacks are left out.
    """
    roles = rig_info(clip.skeleton).roles.joints
    rotations, positions = kinematics.forward(clip)
    tip_positions = np.swapaxes(kinematics.tip_positions(clip, rotations, positions), 0, 1)
    tips = dict(zip((site.joint for site in clip.skeleton.end_sites), tip_positions, strict=True))
    bends: dict[str, list[FloatArray]] = {}
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
                bends.setdefault(f"{finger} {n}", []).append(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))
    return {name: np.concatenate(rows) for name, rows in bends.items()}


def stroke(word: IsolatedWord) -> tuple[int, int]:
    """Returns the first and last frame of the movements of a sign, or of its only posture."""
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


def word_span(spans: Sequence[Span], word: int) -> Span:
    """Returns the spans of a sentence's word, its sign and its retraction, as one."""
    parts = [span for span in spans if span.clip == word]
    sources, outputs = [span.source or (0, 0) for span in parts], [span.output for span in parts]
    warp = [
        pair
        for span, source in zip(parts, sources, strict=True)
        for pair in span.warp or zip(range(*span.output), map(float, range(*source)), strict=True)
    ]
    return replace(
        parts[0],
        source=(sources[0][0], sources[-1][1]),
        output=(outputs[0][0], outputs[-1][1]),
        warp=tuple(warp) if any(span.warp for span in parts) else None,
    )


def output_frame(span: Span, frame: int) -> float:
    """Returns the output frame at which a sign's span shows a recorded frame, or would if it went on."""
    if span.warp is None or span.source is None:
        return frame - (span.source or (0, 0))[0] + span.output[0]
    outputs, sources = np.array(span.warp).T
    return float(np.interp(frame, sources, outputs))
