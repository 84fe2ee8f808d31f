"""Passes of a repeated movement, to and fro: signers make later ones smaller, and each in a time of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from signsplice.synth.avoidance import touching
from signsplice.synth.paths import PathMotion
from signsplice.synth.rng import stream

_LEAST_SIZE = 0.6
"""Least size of a later pass over the first one."""
_TIME_SPREAD = 0.15
"""How much longer or shorter than the first pass a later one may be, as a fraction."""


@dataclass(frozen=True)
class Stroke:
    """A stroke of a repeated movement along its path.

    start, stop: progress on the path, 0 to 1
    n_frames: its duration
    """

    start: float
    stop: float
    n_frames: int

    @property
    def forward(self) -> bool:
        """Whether it goes along the path, not back."""
        return self.stop > self.start

    def along(self, s: float) -> float:
        """How far along the path, or the way back, the hand is at progress ``s`` of the stroke, 0 to 1."""
        start, stop = (self.start, self.stop) if self.forward else (1.0 - self.start, 1.0 - self.stop)
        return start + (stop - start) * s


def strokes(path: PathMotion, count: int, n_frames: int, *names: str | int) -> list[Stroke]:
    """``count`` strokes to and fro, the first one whole and of ``n_frames``; ``names`` seed how later ones differ.

    What touches, touches in every pass: only the distance varies that a hand goes away from there. Where neither end
    touches, the far end is the last posture, which all passes reach; where both do, on circles, and where the hand goes
    back on another path, all are whole.
    """
    difference = path.signer.manner.pass_difference
    whole = path.circles or path.lift is not None or any(path.segment.step)
    if not difference or count == 1 or path.still or whole:
        return [Stroke(float(k % 2), float(1 - k % 2), n_frames) for k in range(count)]
    rng = stream("pass-difference", path.signer.name, *names)
    sizes = 1.0 - difference * rng.uniform(0.0, 1.0 - _LEAST_SIZE, count)
    times = 1.0 + difference * rng.uniform(-_TIME_SPREAD, _TIME_SPREAD, count)
    starts, stops = _touches(path)
    made = [Stroke(0.0, 1.0, n_frames)]
    for size, time in zip(sizes[1:].tolist(), times[1:].tolist(), strict=True):
        back, forth = 0.0 if starts else 1.0 - size, size if starts and not stops else 1.0
        made.append(Stroke(made[-1].stop, back if made[-1].forward else forth, max(4, round(n_frames * time))))
    return made


def _touches(path: PathMotion) -> tuple[bool, bool]:
    """Whether any hand touches at the start of a path, and at its end."""
    at_ends = touching(np.array([path.at(0.0), path.at(1.0)]), path.signer)
    return bool(at_ends[0]), bool(at_ends[1])


def varied_rounds(path: PathMotion, *names: str | int) -> tuple[PathMotion, Callable[[float], float]]:
    """The path with later revolutions of a circle, or swings of a zigzag, smaller; and the time of each fraction of it,
    0 to 1, each revolution in a time of its own. ``names`` seed how they differ.
    """
    difference, count = path.signer.manner.pass_difference, _rounds(path)
    if not difference or count < 2:
        return path, float
    rng = stream("round-difference", path.signer.name, *names)
    sizes = 1.0 - difference * rng.uniform(0.0, 1.0 - _LEAST_SIZE, count - 1)
    durations = 1.0 + difference * rng.uniform(-_TIME_SPREAD, _TIME_SPREAD, count)
    evenly = np.linspace(0.0, 1.0, count + 1)
    ends = np.cumsum([0.0, *durations]) / durations.sum()
    return replace(path, rounds=(1.0, *sizes.tolist())), lambda t: float(np.interp(t, evenly, ends))


def _rounds(path: PathMotion) -> int:
    """Revolutions of a circle or swings of a zigzag; 1 for other paths."""
    kind = path.segment.path.kind
    return max(1, round(abs(path.segment.path.revolutions))) if kind in ("circle", "zigzag") else 1
