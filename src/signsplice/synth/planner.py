"""Signs in notation -> motion: knots from postures and paths, courses through them, small motions, no body in another.

An isolated word is rest, preparation, the sign's segments, retraction, rest. Every hold, and the start and end of a
sign's movements, falls on a frame, and hands come to rest there: what is a hold and what a movement can be seen.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.clip import Clip
from signsplice.synth import locations, pose, trajectory
from signsplice.synth.avoidance import clear
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.overlays import lay_gesture, lay_local
from signsplice.synth.paths import PathMotion, moved
from signsplice.synth.phonology import IN_SPACE, Posture, Segment, Sign
from signsplice.synth.rng import stream
from signsplice.synth.signer import HANGING, STANDARD, Signer
from signsplice.synth.trajectory import Knot

Float = NDArray[np.float64]

FPS = 30.0

FIRST_HOLD_S, INNER_HOLD_S, LAST_HOLD_S = 0.15, 0.07, 0.40
"""Usual holds of a citation form; the last one is the longest (Liddell and Johnson 1989)."""
LAST_TOUCH_S = 0.1
"""A last hold that touches: hands rest on the body for a moment only."""
PREPARATION, RETRACTION = 1.06, 1.25
"""Time of the ways from and to rest over what the travel law gives."""
REST_S = 0.17


@dataclass(frozen=True)
class Events:
    """Frames of an isolated word that matter: ``up``: the last frame of rest; ``start``, ``end``: its first and last
    posture; ``down``: the first frame of rest again; ``first``: the first movement's [begin, end]; ``passes``: [begin,
    end] of every pass of the last movement, in order (its repetitions or turns); a word of one hold has neither.
    touches_first, touches_last: whether those postures touch the body.
    """

    up: int
    start: int
    end: int
    down: int
    first: tuple[int, int] | None
    passes: tuple[tuple[int, int], ...]
    touches_first: bool
    touches_last: bool


@dataclass(frozen=True, eq=False)
class IsolatedWord:
    """An isolated word as one signer made it: its states (T, 63), the clip they stand for, and its events."""

    sign: Sign
    who: Signer
    states: Float
    clip: Clip
    events: Events

    def __len__(self) -> int:
        return len(self.states)


def isolated(sign: Sign, who: Signer = STANDARD, take: int = 0, fps: float = FPS) -> IsolatedWord:
    """A sign as a dictionary shows it: both arms rest before and after. The same arguments give the same motion."""
    rng = stream("take", who.name, sign.gloss, take)
    made = _Core(sign, who, fps, rng)
    core, rest = made.states(), resting(who, sign.gloss, take)
    before, after = (max(2, round(fps * REST_S * rng.uniform(0.7, 1.6))) for _ in range(2))
    up = _reach_frames(rest, core[0], who, fps, PREPARATION * rng.uniform(0.94, 1.06))
    down = _reach_frames(core[-1], rest, who, fps, RETRACTION * rng.uniform(0.94, 1.06))
    still = _still(rest)
    states = np.concatenate(
        [
            np.broadcast_to(rest, (before, pose.SIZE)),
            trajectory.reach(still, _still(core[0]), up, who),
            core,
            trajectory.reach(_still(core[-1]), still, down, who),
            np.broadcast_to(rest, (after, pose.SIZE)),
        ]
    )
    offset = before + up
    states = states + trajectory.small_motions(len(states), fps, who, rng)
    made.overlay(states, offset)
    states = clear(states, who)
    return IsolatedWord(
        sign, who, states, pose.clip(states, who, fps, sign.gloss), made.events(before - 1, offset, down)
    )


def _still(state: Float) -> Float:
    return np.broadcast_to(state, (3, pose.SIZE))


_HELD = {
    "folded": (
        Posture("rest", "belly", "palm", (0.0, 0.3, -0.95), (-0.8, -0.6, 0.0), off=5.0),
        Posture("rest", "belly", "palm", (0.0, 0.3, -0.95), (-0.8, -0.6, 0.0), off=1.0, shift=(0.0, -2.0, 0.0)),
    ),
    "bent": (Posture("rest", "waist", "palm", (-0.9, -0.3, 0.0), (-0.3, -0.2, 0.93), off=7.0, shift=(3.0, 0.0, 0.0)),)
    * 2,
    "low": (
        Posture("rest", "belly", "palm", (-0.2, 0.1, -0.97), (-0.5, -0.86, 0.0), off=5.0, shift=(2.0, -13.0, 3.0)),
        Posture("rest", "belly", "palm", (-0.2, 0.1, -0.97), (-0.5, -0.86, 0.0), off=2.0, shift=(2.0, -15.0, 1.0)),
    ),
}
"""How the strong and the weak hand are held at rests that are not hanging."""
_HELD_LOWER_CM = 2.0
"""How much lower than these postures say."""


def resting(who: Signer, *names: str | int) -> Float:
    """The state (63,) of a signer who stands at rest; ``names`` tell one standing from another."""
    rng = stream("rest", who.name, *names)
    state = np.zeros(pose.SIZE)
    if who.rest != HANGING:
        for first, posture in zip((0, 27), _HELD[who.rest], strict=True):
            numbers = locations.weak(posture, who)
            numbers[:3] += 0.6 * rng.standard_normal(3) + np.array([0.0, 2.0 * who.rest_out_cm - _HELD_LOWER_CM, 0.0])
            numbers[6:] *= 1.0 + 0.06 * rng.standard_normal()
            state[first : first + 27] = numbers
        return state
    for first in (0, 27):
        jitter = 0.6 * rng.standard_normal(3)
        wrist = np.array([-26.0 - who.rest_out_cm, -39.5, 4.0 + who.rest_fwd_cm]) + jitter
        arms = 0.5 * (who.arms + 1.0)
        wrist = wrist * np.array([who.shoulders, arms, 1.0]) * who.scale
        state[first : first + 3] = wrist
        turned = locations.facing((-1.0, 0.0, -0.25), (0.05, -1.0, 0.12))
        state[first + 3 : first + 6] = pose.turn_of(wrist, turned, who)
        state[first + 6 : first + 27] = HANDSHAPES["rest"].angles * (1.0 + 0.06 * rng.standard_normal())
    return state


def _reach_frames(start: Float, end: Float, who: Signer, fps: float, share: float) -> int:
    travel = np.linalg.norm(pose.hands(end)[:, pose.WRIST] - pose.hands(start)[:, pose.WRIST], axis=-1).max()
    return max(4, round(fps * share * trajectory.travel_seconds(float(travel), who)) - 1)


class _Core:
    """The knots of a sign's segments, frame 0 at its first posture, and what lies over them."""

    def __init__(self, sign: Sign, who: Signer, fps: float, rng: np.random.Generator) -> None:
        self.sign, self.who, self.fps = sign, who, fps
        self.size = who.amplitude * float(np.exp(0.05 * rng.standard_normal()))
        self.tempo = float(np.exp(0.05 * np.clip(rng.standard_normal(), -2, 2)))
        self.jitter = 0.7 * who.scale * rng.standard_normal(3)
        self.knots: list[Knot] = []
        self.moves: list[tuple[Segment, int, int, tuple[tuple[int, int], ...]]] = []
        self.spans: list[tuple[Segment, int, int]] = []
        for n, segment in enumerate(sign.segments):
            self._add(n, segment)

    def states(self) -> Float:
        return trajectory.through(self.knots)

    def events(self, up: int, offset: int, down: int) -> Events:
        passes: list[tuple[int, int]] = []
        first = None
        if self.moves:
            begin, stop = self.moves[0][3][0]
            first = begin + offset, stop + offset
            passes = [(begin + offset, stop + offset) for begin, stop in self.moves[-1][3]]
        segments = self.sign.segments
        return Events(
            up=up,
            start=offset,
            end=offset + self.knots[-1].frame,
            down=offset + self.knots[-1].frame + down + 1,
            first=first,
            passes=tuple(passes),
            touches_first=touches(segments[0], self.sign),
            touches_last=touches(segments[-1], self.sign),
        )

    def _add(self, n: int, segment: Segment) -> None:
        segments = self.sign.segments
        last = n == len(segments) - 1
        if not self.knots:
            self.knots.append(Knot(0, self._start(segment), True))
        begin = self.knots[-1].frame
        if segment.kind == "M":
            self._move(segments[n - 1], segment, last or segments[n + 1].kind == "H")
        elif segment.kind == "H":
            usual = LAST_HOLD_S if last else FIRST_HOLD_S if n == 0 else INNER_HOLD_S
            if last and n > 0 and touches(segment, self.sign):
                usual = LAST_TOUCH_S
            n_frames = max(2, self._frames(segment.seconds or usual))
            self.knots.append(Knot(begin + n_frames, self.knots[-1].state, True))
        self.spans.append((segment, begin, self.knots[-1].frame))

    def _frames(self, seconds: float) -> int:
        return round(self.fps * seconds / self.tempo / self.who.tempo)

    def _start(self, segment: Segment) -> Float:
        """The first posture; hands that alternate stand where the next movement begins for each."""
        moves = [s for s in self.sign.segments if s.kind == "M"]
        if self.sign.hands == "alternating" and moves:
            return self._way(segment, moves[0]).at(0.0)
        return self._state(*self._hands(segment))

    def _hands(self, segment: Segment) -> tuple[Float, Float]:
        """Both hands' numbers in a segment's posture; a weak hand without one of its own mirrors the strong."""
        posture, weak = segment.strong, resting(self.who, self.sign.gloss)[27:54]
        if segment.weak is not None:
            weak = locations.weak(segment.weak, self.who, self.size)
        meets = self.sign.hands in ("symmetric", "alternating")
        strong = locations.strong(posture, self.who, weak, meets, self.size)
        if posture.place in IN_SPACE and not (meets and posture.place.endswith("-mid")):
            strong = moved(strong, self.jitter, self.who)
        return strong, strong if meets else weak

    def _way(self, before: Segment, segment: Segment) -> PathMotion:
        return PathMotion(segment, self.sign.hands, self.who, self._hands(before), self._hands(segment), self.size)

    def _state(self, strong: Float, weak: Float) -> Float:
        return np.concatenate([strong, weak, np.zeros(9)])

    def _move(self, before: Segment, segment: Segment, stops: bool) -> None:
        way = self._way(before, segment)
        begin = self.knots[-1].frame
        turns = max(1, round(abs(segment.path.revolutions))) if segment.path.kind == "circle" else 1
        count = 2 * segment.times - 1 if not way.still else segment.times
        each = self._frames(way.seconds()) if segment.seconds is None else round(segment.seconds * self.fps / count)
        least = 6 * turns if segment.path.kind == "circle" else 4
        each = max(least, each)
        passes = []
        for k in range(count):
            back = k % 2 == 1
            at = begin + k * each
            for s, share in way.steps(each):
                progress = 1.0 - s if back else s
                self.knots.append(Knot(at + round(share * each), way.at(progress), False))
            if not back:
                cut = [at + round(each * t / turns) for t in range(turns + 1)]
                passes += list(itertools.pairwise(cut))
        self.knots[-1] = replace(self.knots[-1], stop=stops)
        if segment.local is not None and way.still:
            passes = [(begin, self.knots[-1].frame)]
        self.moves.append((segment, begin, self.knots[-1].frame, tuple(passes)))

    def overlay(self, states: Float, offset: int) -> None:
        """Add local movements, head and trunk to states of the whole word, in place."""
        for segment, begin, end in self.spans:
            lay_gesture(states, segment, begin + offset, end + offset, self.fps)
        for segment, begin, end, _ in self.moves:
            if segment.local is not None:
                part = states[begin + offset : end + offset + 1]
                lay_local(part, segment, self.sign.hands, self.who)


def touches(segment: Segment, sign: Sign) -> bool:
    """Whether a segment's strong hand touches the body, the base hand, or (mirrored, on the midline) its fellow."""
    posture = segment.strong
    meets = sign.hands in ("symmetric", "alternating") and posture.place in ("space-mid", "space-low-mid")
    free = posture.place in IN_SPACE and not meets
    return not free and abs(posture.off) < 1.0 and all(abs(c) < 1.0 for c in posture.shift)
