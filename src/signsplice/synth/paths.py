"""How hands go along a movement: straight, in an arc, round, to and fro, and how long it takes them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import rotation
from signsplice.synth import locations, pose, trajectory
from signsplice.synth.phonology import Path, Segment
from signsplice.synth.signer import Signer

Float = NDArray[np.float64]

STROKE = 0.70
"""Time of a sign's movements over what the travel law gives."""
CYCLE_S = {"wiggle": 0.28, "bend": 0.30, "twist": 0.26, "nod": 0.28, "tremble": 0.15}
"""A cycle of each local movement."""


def moved(numbers: Float, way: Float, who: Signer) -> Float:
    """A hand (27,) carried ``way`` (3,) cm without turning."""
    wrist = numbers[pose.WRIST]
    turned = rotation.multiply(pose.reach(wrist, who).fore, rotation.exp(numbers[pose.TURN]))
    return np.concatenate([wrist + way, pose.turn_of(wrist + way, turned, who), numbers[pose.FINGERS]])


@dataclass(frozen=True, eq=False)
class PathMotion:
    """How both hands go from one posture to another along a segment's path; progress 0 to 1.

    segment: the movement; hands: how they work together; start, end: the strong and the weak hand's numbers (27,) in
    its two postures; size: of paths, over the standard body's. ``still``: nothing but a local movement happens.
    """

    segment: Segment
    hands: str
    who: Signer
    start: tuple[Float, Float]
    end: tuple[Float, Float]
    size: float

    @property
    def still(self) -> bool:
        """Whether the hands stay where they are."""
        same = all(np.array_equal(a, b) for a, b in zip(self.start, self.end, strict=True))
        return same and self.segment.path.kind not in ("circle", "zigzag")

    def at(self, s: float) -> Float:
        """The state (63,) at progress ``s``."""
        alternating = self.hands == "alternating"
        strong = self._hand(0, s, 0.0)
        mirrored = self.hands in ("symmetric", "alternating")
        half_turn = alternating and self.segment.path.kind == "circle"
        weak = self._hand(0 if mirrored else 1, 1.0 - s if alternating and not half_turn else s, 0.5 * half_turn)
        return np.concatenate([strong, weak, np.zeros(9)])

    def _hand(self, which: int, s: float, phase: float) -> Float:
        start, end, path = self.start[which], self.end[which], self.segment.path
        numbers = start + s * (end - start)
        if which == 1:
            return numbers
        offset = locations.axes(path.direction) * path.size
        if path.kind == "arc":
            numbers = moved(numbers, offset * self.size * self.who.scale * np.sin(np.pi * s), self.who)
        elif path.kind == "zigzag":
            numbers = moved(
                numbers, offset * self.size * self.who.scale * np.sin(2.0 * np.pi * path.revolutions * s), self.who
            )
        elif path.kind == "circle":
            numbers = moved(numbers, _round(path, s, phase) * self.size * self.who.scale, self.who)
        return numbers

    def steps(self, n_frames: int) -> list[tuple[float, float]]:
        """Knots of one pass after its start: (progress, share of its time)."""
        path = self.segment.path
        if path.kind == "circle":
            n = max(2, round(6 * abs(path.revolutions)))
        elif path.kind == "zigzag":
            n = max(2, round(4 * path.revolutions))
        elif path.kind == "arc":
            shares = [0.25, 0.5, 0.75, 1.0] if n_frames >= 8 else [0.5, 1.0]
            return [(float(_progress(u)), u) for u in shares]
        else:
            return [(1.0, 1.0)]
        n = min(n, n_frames)
        return [(k / n, k / n) for k in range(1, n + 1)]

    def seconds(self) -> float:
        """How long one pass takes: by the travel law along the path, and time enough to turn, form and flutter."""
        local = self.segment.local
        if self.still and local is not None:
            return CYCLE_S[local.kind] * local.cycles
        fine = np.linspace(0.0, 1.0, 33)
        states = np.array([self.at(s) for s in fine])
        both = pose.hands(states)
        length = np.linalg.norm(np.diff(both[..., pose.WRIST], axis=0), axis=-1).sum(axis=0).max()
        kind, turns = self.segment.path.kind, abs(self.segment.path.revolutions)
        pieces = turns if kind == "circle" else 2.0 * turns if kind == "zigzag" else 1.0
        pieces = max(pieces, 1.0)
        move = pieces * trajectory.travel_seconds(float(length) / pieces, replace(self.who, tempo=1.0)) * STROKE
        turned = np.linalg.norm(both[-1, :, pose.TURN] - both[0, :, pose.TURN], axis=-1).max()
        formed = np.abs(both[-1, :, pose.FINGERS] - both[0, :, pose.FINGERS]).max()
        least = max(move, 0.10 + 0.13 * float(turned), 0.0 if formed < 0.1 else 0.12 + 0.06 * float(formed))
        if local is not None:
            least = max(least, CYCLE_S[local.kind] * local.cycles)
        return least


def _progress(u: float) -> float:
    """Progress of a minimum-jerk movement from rest to rest at time ``u`` (both 0 to 1)."""
    return u**3 * (10.0 + u * (-15.0 + 6.0 * u))


_PLANES = {"frontal": ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)), "sagittal": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}
_PLANES["horizontal"] = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))


def _round(path: Path, s: float, phase: float) -> Float:
    """Where a circle is, seen from its start at the top (horizontal: the front), for unit scale."""
    top, side = (locations.axes(v) for v in _PLANES[path.plane])
    angle = 2.0 * np.pi * (path.revolutions * s + phase)
    return np.asarray(path.size * ((np.cos(angle) - 1.0) * top + np.sin(angle) * side))
