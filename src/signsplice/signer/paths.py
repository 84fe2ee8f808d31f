"""Motion of hands along a segment's path (straight, arc, circle, zigzag), its duration and its repetitions.

Signers make later passes of a repeated movement smaller, and vary their durations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion import FloatArray, rotation
from signsplice.motion.curves import minimum_jerk
from signsplice.signer import locations, pose, trajectory
from signsplice.signer.collisions import into_touch, touching
from signsplice.signer.phonology import MIRRORED_HANDS, Path, Segment
from signsplice.signer.signer import Signer, stream

MOVEMENT_PACE = 0.70
"""Duration of a sign's movements, over that of the travel law."""
_TOUCH_KNOTS = 6
"""Number of knots of a movement that stays in touch."""
_TOUCH_ROUNDS = 3
"""How often hands are moved towards the skin at each of these knots."""
CYCLE_S = {"wiggle": 0.28, "bend": 0.30, "twist": 0.26, "nod": 0.28, "tremble": 0.15, "swing": 0.26, "stir": 0.36}
"""Duration of one cycle of each local movement, seconds."""


def translate_hand(hand_state: FloatArray, displacement: FloatArray, signer: Signer) -> FloatArray:
    """Moves a hand state (27,) by ``displacement`` (3,), cm, without rotating the hand."""
    wrist = hand_state[pose.WRIST]
    moved = wrist + displacement
    fore, moved_fore = pose.solve_arm(np.stack([wrist, moved]), signer).fore
    quat = rotation.multiply(fore, rotation.exp(hand_state[pose.ROTVEC]))
    rotvec = rotation.log(rotation.multiply(rotation.inverse(moved_fore), quat))
    return np.concatenate([moved, pose.nearest_turn(rotvec, hand_state[pose.ROTVEC]), hand_state[pose.FINGERS]])


def without_spins(pairs: Sequence[tuple[FloatArray, FloatArray]]) -> list[tuple[FloatArray, FloatArray]]:
    """Turns each hand the short way between consecutive pairs of hand states (27,)."""
    new_pairs = list(pairs[:1])
    for pair in pairs[1:]:
        states = [state.copy() for state in pair]
        for state, before in zip(states, new_pairs[-1], strict=True):
            state[pose.ROTVEC] = pose.nearest_turn(state[pose.ROTVEC], before[pose.ROTVEC])
        new_pairs.append((states[0], states[1]))
    return new_pairs


def translate_state(state: FloatArray, displacement: FloatArray, signer: Signer, hands: str) -> FloatArray:
    """Moves the strong hand of a state (65,) by ``displacement`` (3,), cm, and a mirrored weak hand with it."""
    weak = translate_hand(state[27:54], displacement, signer) if hands in MIRRORED_HANDS else state[27:54]
    return np.concatenate([translate_hand(state[:27], displacement, signer), weak, state[54:]])


@dataclass(frozen=True, eq=False)
class PathMotion:
    """Both hands on their path from one posture to another; progress goes from 0 to 1.

    segment: the movement
    hands: how the hands work together, a name of ``HANDS``
    signer: its signer
    start: strong and weak hand state (27,) in the first posture
    end: strong and weak hand state (27,) in the second posture
    size: factor on the size of paths
    rounds: factors on the size of each revolution of a circle, or swing of a zigzag; empty for 1
    lift: largest displacement (3,), cm, of the strong hand on its way back; None if it goes back on the same path
    carried: whether the strong hand stays at the base hand and follows that hand's path
    """

    segment: Segment
    hands: str
    signer: Signer
    start: tuple[FloatArray, FloatArray]
    end: tuple[FloatArray, FloatArray]
    size: float
    rounds: tuple[float, ...] = ()
    lift: FloatArray | None = None
    carried: bool = False

    @property
    def still(self) -> bool:
        """Whether the hands stay in place, apart from a local movement."""
        same = all(np.array_equal(a, b) for a, b in zip(self.start, self.end, strict=True))
        return same and not {path.kind for path in self._paths} & {"circle", "zigzag"}

    @property
    def _paths(self) -> tuple[Path, ...]:
        """The strong hand's path, and a base hand's own."""
        return (self.segment.path, self.segment.weak_path) if self.hands == "base" else (self.segment.path,)

    @property
    def circles(self) -> bool:
        """Whether a hand circles."""
        return any(path.kind == "circle" for path in self._paths)

    @property
    def revolutions(self) -> int:
        """Revolutions of a pass: of the circling hand, the strong one first; 1 without a circle."""
        counts = [path.revolutions for path in self._paths if path.kind == "circle"]
        return max(1, round(abs(counts[0]))) if counts else 1

    def at(self, s: float) -> FloatArray:
        """The state (65,) at progress ``s``."""
        both = []
        for which, t, phase in self._both(s):
            hand_state, offset = self._straight(which, t), self._offset(which, t, phase)
            both.append(hand_state if offset is None else translate_hand(hand_state, offset, self.signer))
        state = pose.of_hands(*both)
        return self._in_touch(state) if self.segment.keeps else state

    def _in_touch(self, state: FloatArray) -> FloatArray:
        """The state (65,) with hands moved back into touch (``keep=touch``)."""
        for _ in range(_TOUCH_ROUNDS):
            moves = into_touch(state, self.segment.strong, self.hands, self.signer)
            hands = (
                translate_hand(hand_state, move, self.signer)
                for hand_state, move in zip(pose.hands(state), moves, strict=True)
            )
            state = np.concatenate([*hands, state[pose.TRUNK.start :]])
        return state

    def back(self, s: float) -> FloatArray:
        """The state (65,) at progress ``s`` of the way back for another pass."""
        if self.lift is None:
            return self.at(1.0 - s)
        both = [self._straight(which, 1.0 - t) for which, t, _ in self._both(s)]
        lift = self.lift * np.sin(np.pi * s)
        hands = (0, 1) if self.hands == "symmetric" else (0,)
        for which in hands:
            both[which] = translate_hand(both[which], lift, self.signer)
        return pose.of_hands(*both)

    def of_pass(self, k: int, s: float) -> FloatArray:
        """The state (65,) at progress ``s`` of pass ``k``; odd passes are the way back."""
        state = self.back(s) if k % 2 else self.at(s)
        if not any(self.segment.step):
            return state
        moved = locations.axes(self.segment.step) * self.size * self.signer.scale * (k // 2 + (k % 2) * s)
        strong, weak = pose.hands(state)
        weak = weak if self.hands == "one" else translate_hand(weak, moved * pose.MIRROR, self.signer)
        return np.concatenate([translate_hand(strong, moved, self.signer), weak, state[54:]])

    def _both(self, s: float) -> tuple[tuple[int, float, float], tuple[int, float, float]]:
        """For strong and weak hand at progress ``s``: whose path it follows (0 strong, 1 weak), its progress, and its
        phase on a circle, in revolutions.
        """
        mirrored = self.hands in MIRRORED_HANDS
        opposite = self.hands == "alternating" and self.segment.path.kind == "circle"
        reverse = self.hands == "alternating" and not opposite
        return (0, s, 0.0), (0 if mirrored else 1, 1.0 - s if reverse else s, 0.5 * opposite)

    def _straight(self, which: int, s: float) -> FloatArray:
        start, end = self.start[which], self.end[which]
        return start + s * (end - start)

    def _offset(self, which: int, s: float, phase: float) -> FloatArray | None:
        """Displacement (3,), cm, of a hand from the straight line; None if it stays on the line."""
        offset = self._path_offset(self.segment.weak_path if which == 1 else self.segment.path, s, phase)
        if which == 1 or not self.carried:
            return offset
        base_offset = self._path_offset(self.segment.weak_path, s, phase)
        if base_offset is None:
            return offset
        mirrored = np.asarray(base_offset * pose.MIRROR)
        return mirrored if offset is None else np.asarray(offset + mirrored)

    def _path_offset(self, path: Path, s: float, phase: float) -> FloatArray | None:
        """Displacement (3,), cm, on one path; None if the path has none."""
        if path.kind not in ("arc", "zigzag", "circle"):
            return None
        if path.kind == "circle":
            return _circle_offset(path, s, phase) * self._size_at(s) * self.signer.scale
        swing = np.sin(np.pi * s) if path.kind == "arc" else np.sin(2.0 * np.pi * path.revolutions * s)
        return np.asarray(locations.axes(path.direction) * path.size * self._size_at(s) * self.signer.scale * swing)

    def _size_at(self, s: float) -> float:
        """The factor on the path's size at progress ``s``; it changes smoothly from round to round."""
        if not self.rounds:
            return self.size
        middles = (np.arange(len(self.rounds)) + 0.5) / len(self.rounds)
        return self.size * float(np.interp(s, middles, self.rounds))

    def _length(self) -> float:
        """Length of the longer of the wrists' paths, cm."""
        wrists = np.empty((33, 2, 3))
        for n, s in enumerate(np.linspace(0.0, 1.0, len(wrists))):
            for k, (which, t, phase) in enumerate(self._both(float(s))):
                offset = self._offset(which, t, phase)
                wrists[n, k] = self._straight(which, t)[pose.WRIST] + (0.0 if offset is None else offset)
        return float(np.linalg.norm(np.diff(wrists, axis=0), axis=-1).sum(axis=0).max())

    def knots(self, n_frames: int, back: bool = False) -> list[tuple[float, float]]:
        """Knots of a pass of ``n_frames``, or of the way ``back``, after its start: (progress, fraction of time)."""
        kinds = {path.kind for path in self._paths}
        if kinds & {"circle", "zigzag"} and not (back and self.lift is not None):
            n = n_frames if self.segment.keeps else min(max(map(_n_knots, self._paths)), n_frames)
            return [(k / n, k / n) for k in range(1, n + 1)]
        if self.segment.keeps:
            times = (np.linspace(0.0, 1.0, min(_TOUCH_KNOTS, n_frames) + 1)[1:]).tolist()
            return [(float(minimum_jerk(u)), u) for u in times]
        if "arc" in kinds or self.lift is not None:
            times = [0.25, 0.5, 0.75, 1.0] if n_frames >= 8 else [0.5, 1.0]
            return [(float(minimum_jerk(u)), u) for u in times]
        return [(1.0, 1.0)]

    def seconds(self) -> float:
        """Duration of one pass, seconds: by the travel law along the path, and long enough for the hand's rotation, the
        change of handshape and the local movement.
        """
        local = self._local_seconds()
        if self.still and local:
            return local
        both = pose.hands(np.array([self.at(0.0), self.at(1.0)]))
        pieces = max(1.0, *(_PIECES.get(path.kind, 0.0) * abs(path.revolutions) for path in self._paths))
        usual_tempo = replace(self.signer, tempo=1.0)
        move = pieces * trajectory.travel_seconds(self._length() / pieces, usual_tempo) * MOVEMENT_PACE
        angle = np.linalg.norm(both[-1, :, pose.ROTVEC] - both[0, :, pose.ROTVEC], axis=-1).max()
        formed = np.abs(both[-1, :, pose.FINGERS] - both[0, :, pose.FINGERS]).max()
        least = max(move, 0.10 + 0.13 * float(angle), 0.0 if formed < 0.1 else 0.12 + 0.06 * float(formed))
        return max(least, local)

    def _local_seconds(self) -> float:
        """Duration of the longest local movement."""
        locals_ = [self.segment.local, self.segment.weak_local]
        locals_ += [local.also for local in locals_ if local is not None]
        return max(CYCLE_S[local.kind] * local.cycles if local is not None else 0.0 for local in locals_)


_PIECES = {"circle": 1.0, "zigzag": 2.0}
"""Movements, each with a peak of speed, in one revolution of a path."""


def _n_knots(path: Path) -> int:
    """Number of knots of a path."""
    per_revolution = {"circle": 6, "zigzag": 4}.get(path.kind, 0)
    return max(2, round(per_revolution * abs(path.revolutions)))


_PLANES = {"frontal": ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)), "sagittal": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}
_PLANES["horizontal"] = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))


def _circle_offset(path: Path, s: float, phase: float) -> FloatArray:
    """Displacement (3,) on a circle from its start, for unit scale: in a plane from the top (horizontal: the front);
    about an axis minus the straight way from its start to its end.
    """
    if path.plane:
        top, side = (locations.axes(v) for v in _PLANES[path.plane])
    else:
        top = locations.axes(path.start)
        side = path.ratio * np.cross(locations.axes(path.direction), top)

    def at(t: float) -> FloatArray:
        angle = 2.0 * np.pi * (path.revolutions * t + phase)
        return np.asarray(path.size * ((np.cos(angle) - 1.0) * top + np.sin(angle) * side))

    return at(s) if path.plane else at(s) - s * (at(1.0) - at(0.0))


_LEAST_SIZE = 0.6
"""Least size of a later pass over the first one."""
_TIME_SPREAD = 0.15
"""Largest difference in duration of a later pass from the first, as a fraction."""


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
        """Progress along the path, or the way back, at progress ``s`` of the stroke, 0 to 1."""
        start, stop = (self.start, self.stop) if self.forward else (1.0 - self.start, 1.0 - self.stop)
        return start + (stop - start) * s


def strokes(path: PathMotion, count: int, n_frames: int, *names: str | int) -> list[Stroke]:
    """``count`` strokes to and fro, the first whole and of ``n_frames``; ``names`` seed the variation of later ones.

    An end that touches does so in every pass; only the distance that a hand goes away varies. If neither end touches,
    all passes reach the last posture. If both ends touch, on circles, and if the hand goes back on another path, all
    strokes are whole.
    """
    difference = path.signer.manner.pass_difference
    is_whole = path.circles or path.lift is not None or any(path.segment.step)
    if not difference or count == 1 or path.still or is_whole:
        return [Stroke(float(k % 2), float(1 - k % 2), n_frames) for k in range(count)]
    rng = stream("pass-difference", path.signer.name, *names)
    sizes = 1.0 - difference * rng.uniform(0.0, 1.0 - _LEAST_SIZE, count)
    times = 1.0 + difference * rng.uniform(-_TIME_SPREAD, _TIME_SPREAD, count)
    starts, stops = touching(np.array([path.at(0.0), path.at(1.0)]), path.signer)
    new_strokes = [Stroke(0.0, 1.0, n_frames)]
    for size, time in zip(sizes[1:].tolist(), times[1:].tolist(), strict=True):
        back, forth = 0.0 if starts else 1.0 - size, size if starts and not stops else 1.0
        new_strokes.append(
            Stroke(new_strokes[-1].stop, back if new_strokes[-1].forward else forth, max(4, round(n_frames * time)))
        )
    return new_strokes


def vary_rounds(path: PathMotion, *names: str | int) -> tuple[PathMotion, Callable[[float], float]]:
    """The path with smaller later revolutions of a circle, or swings of a zigzag, and the map from a fraction of it to
    time, 0 to 1, with varied durations of its revolutions. ``names`` seed the variation.
    """
    difference, count = path.signer.manner.pass_difference, rounds(path)
    if not difference or count < 2:
        return path, float
    rng = stream("round-difference", path.signer.name, *names)
    sizes = 1.0 - difference * rng.uniform(0.0, 1.0 - _LEAST_SIZE, count - 1)
    durations = 1.0 + difference * rng.uniform(-_TIME_SPREAD, _TIME_SPREAD, count)
    evenly = np.linspace(0.0, 1.0, count + 1)
    ends = np.cumsum([0.0, *durations]) / durations.sum()
    return replace(path, rounds=(1.0, *sizes.tolist())), lambda t: float(np.interp(t, evenly, ends))


def rounds(path: PathMotion) -> int:
    """Revolutions of a circle or swings of a zigzag; 1 for other paths."""
    kind = path.segment.path.kind
    return max(1, round(abs(path.segment.path.revolutions))) if kind in ("circle", "zigzag") else 1
