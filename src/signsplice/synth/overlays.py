"""Movements laid over a sign's trajectory: local movements of the hand, gestures of head and trunk."""

from __future__ import annotations

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.synth import hand, pose, trajectory
from signsplice.synth.phonology import Segment
from signsplice.synth.signer import Signer


def add_local_movement(states: FloatArray, segment: Segment, hands: str, signer: Signer) -> None:
    """Add a segment's local movement to its states (n, 63), in place."""
    local = segment.local
    assert local is not None
    n = len(states)
    u = np.linspace(0.0, 1.0, n)
    level = trajectory.window(n, max(1, round(0.18 * n)))
    for which in (0, 1):
        if which == 1 and hands not in ("symmetric", "alternating"):
            continue
        phase = np.pi if which == 1 and hands == "alternating" else 0.0
        hand_states = states[:, 27 * which : 27 * which + 27]  # (n, 27), a view
        swing = np.sin(2.0 * np.pi * local.cycles * u + phase) * level
        amplitude = np.deg2rad(local.amplitude)
        if local.kind == "twist":
            hand_states[:, 3] += amplitude * swing
        elif local.kind == "nod":
            hand_states[:, 5] += amplitude * swing
        elif local.kind == "tremble":
            hand_states[:, 0] += local.amplitude * signer.scale * swing
        fingers = hand_states[:, pose.FINGERS][:, :16].reshape(n, 4, 4)
        if local.kind == "wiggle":
            for f in range(4):
                one = np.sin(2.0 * np.pi * local.cycles * u + phase - 1.2 * f) * level
                fingers[:, f, 1] += amplitude * one
                fingers[:, f, 2] += 0.4 * amplitude * (one + level)
        elif local.kind == "bend":
            close = 0.5 * (1.0 - np.cos(2.0 * np.pi * local.cycles * u + phase)) * level
            fingers[:, :, 1] += (amplitude * close)[:, None]
        angles = hand_states[:, pose.FINGERS]
        np.clip(angles, hand.LIMITS[:, 0], hand.LIMITS[:, 1], out=angles)


def add_gesture(states: FloatArray, segment: Segment, begin: int, end: int, fps: float) -> None:
    """Add a segment's head and trunk movement to states (T, 63) of the whole word, in place.

    The gesture begins a little before frame ``begin`` and ends a little after ``end``.
    """
    margin = round(0.2 * fps)
    frames = slice(max(begin - margin, 0), min(end + margin + 1, len(states)))
    n = frames.stop - frames.start
    u, level = np.linspace(0.0, 1.0, n), trajectory.window(n, margin + 1)
    head, trunk = states[frames, pose.HEAD], states[frames, pose.TRUNK]
    cycles = max(1.0, round(2.2 * n / fps))
    swing = np.sin(2.0 * np.pi * cycles * u) * level
    if segment.head == "nod":
        head[:, 0] += np.deg2rad(9.0) * 0.5 * (1.0 - np.cos(2.0 * np.pi * cycles * u)) * level
    elif segment.head == "shake":
        head[:, 1] += np.deg2rad(11.0) * swing
    elif segment.head:
        head[:, 2] += np.deg2rad(8.0 if segment.head == "tilt" else -8.0) * level
    lean = {"fwd": (0, 6.0), "back": (0, -5.0), "out": (2, 5.0), "in": (2, -5.0)}
    if segment.trunk:
        axis, angle = lean[segment.trunk]
        trunk[:, axis] += np.deg2rad(angle) * level
