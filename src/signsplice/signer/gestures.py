"""Gestures of head and trunk that a sign makes beside its hands, in their own time."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.signer import pose

if TYPE_CHECKING:
    from signsplice.signer.timing import Events

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
    for gesture in gestures:
        hands, swings = (events.start, events.end), bool(gesture.degrees[1])
        height = level(len(states), fps, hands, gesture.begin, gesture.end, gesture.cycles, swings)
        part = pose.HEAD if gesture.part == "head" else pose.TRUNK
        states[:, part] += height[:, None] * np.deg2rad(gesture.degrees)


def level(
    n_frames: int,
    fps: float,
    hands: tuple[int, int],
    begin: float,
    end: float,
    cycles: float = 0.0,
    swings: bool = False,
) -> FloatArray:
    """How far (T,) a gesture has gone that lasts from ``begin`` to ``end`` of the time of the hands; these sign between
    the two frames ``hands``. ``cycles``: how often it goes there and back, ``swings``: to both sides.
    """
    t = np.arange(n_frames) / fps
    start, seconds = hands[0] / fps, max((hands[1] - hands[0]) / fps, 0.3)
    first, last = start + begin * seconds, start + end * seconds
    height = pose.smooth_step((t - first + _RAMP_S) / _RAMP_S) * pose.smooth_step((last + _RAMP_S - t) / _RAMP_S)
    if cycles:
        cycles = max(1.0, min(cycles, float(np.floor(_MOST_HZ * (last - first)))))
        phase = 2.0 * np.pi * cycles * np.clip((t - first) / (last - first), 0.0, 1.0)
        height = height * (np.sin(phase) if swings else 0.5 - 0.5 * np.cos(phase))
    return height
