"""Gestures of head and trunk that a sign makes beside its hands, in their own time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.synth import pose

if TYPE_CHECKING:
    from signsplice.synth.timing import Events

_RAMP_S = 0.22
"""How long a gesture takes to be reached and to be over."""
_MOST_HZ = 2.5
"""Nods or shakes a second at most."""


@dataclass(frozen=True)
class Gesture:
    """A gesture of head or trunk.

    part: head or trunk
    degrees: how far it turns: forward, to the left, towards the right shoulder
    cycles: how often it goes there and back; a turn to the side swings to both; 0: it goes there and stays
    begin, end: fractions of the time between the sign's first posture and its last
    """

    part: str
    degrees: tuple[float, float, float]
    cycles: float = 0.0
    begin: float = 0.0
    end: float = 1.0


def add(states: FloatArray, gestures: tuple[Gesture, ...], events: Events, fps: float) -> None:
    """Add gestures to the states (T, 65) of a word of a right-handed signer, in place."""
    t = np.arange(len(states)) / fps
    start, seconds = events.start / fps, max((events.end - events.start) / fps, 0.3)
    for gesture in gestures:
        begin, end = start + gesture.begin * seconds, start + gesture.end * seconds
        level = pose.smooth_step((t - begin + _RAMP_S) / _RAMP_S) * pose.smooth_step((end + _RAMP_S - t) / _RAMP_S)
        if gesture.cycles:
            cycles = max(1.0, min(gesture.cycles, float(np.floor(_MOST_HZ * (end - begin)))))
            phase = 2.0 * np.pi * cycles * np.clip((t - begin) / (end - begin), 0.0, 1.0)
            level = level * (np.sin(phase) if gesture.degrees[1] else 0.5 - 0.5 * np.cos(phase))
        states[:, pose.HEAD if gesture.part == "head" else pose.TRUNK] += level[:, None] * np.deg2rad(gesture.degrees)
