"""Gestures of head and trunk that a sign makes beside its hands, in their own time."""

from __future__ import annotations

import re
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
_NUMBER = r"(-?[0-9]{1,3}(?:\.[0-9]{1,6})?)"
_TEXT = re.compile(
    rf"(head|trunk) {_NUMBER},{_NUMBER},{_NUMBER}(?: cycles={_NUMBER})?(?: from={_NUMBER})?(?: to={_NUMBER})?"
)
EXPECTED = "head|trunk FORWARD,LEFT,TILT [cycles=0:20] [from=0:1] [to=0:1], at most 60 degrees"


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

    def __str__(self) -> str:
        """The gesture in the notation, numbers to a thousandth."""
        numbers = ",".join(f"{round(angle, 3) + 0.0:g}" for angle in self.degrees)
        more = (("cycles", self.cycles, 0.0), ("from", self.begin, 0.0), ("to", self.end, 1.0))
        return " ".join([self.part, numbers, *(f"{key}={round(x, 3):g}" for key, x, usual in more if x != usual)])


def gesture(text: str) -> Gesture | None:
    """The gesture of a text in the notation; None where it is none (``EXPECTED`` says what is one)."""
    match = _TEXT.fullmatch(text)
    if match is None:
        return None
    x, y, z, cycles, begin, end = (float(n or usual) for n, usual in zip(match.groups()[1:], "000001", strict=True))
    well = max(abs(x), abs(y), abs(z)) <= 60.0 and 0.0 <= cycles <= 20.0 and 0.0 <= begin < end <= 1.0
    return Gesture(match[1], (x, y, z), cycles, begin, end) if well else None


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
