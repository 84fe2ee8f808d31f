"""Turns signs in notation into motion: knots from postures and paths, trajectories through them, small motions,
collision avoidance.

An isolated word consists of rest, preparation, the sign's segments, retraction and rest. Every hold, and the start and
end of a sign's movements, falls on a frame where the hands stop, so that a hold can be distinguished from a movement.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.clip import Clip
from signsplice.synth import locations, pose, trajectory, two_hands, undershoot
from signsplice.synth.avoidance import clear_collisions, touching
from signsplice.synth.body_motion import add_body_motion
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.locations import WeakArm
from signsplice.synth.low_pass import low_passed
from signsplice.synth.manner import PLAIN
from signsplice.synth.overlays import add_gesture, add_local_movement
from signsplice.synth.passes import strokes, varied_rounds
from signsplice.synth.paths import PathMotion, drifted, translated
from signsplice.synth.phonology import IN_SPACE, ON_BASE, Posture, Segment, Sign
from signsplice.synth.rng import stream
from signsplice.synth.signer import HANGING, STANDARD, Signer
from signsplice.synth.timing import between_frames, hold_pause, tempo_of
from signsplice.synth.touch_events import TOUCH_CM, skin_gaps, touching_sides
from signsplice.synth.trajectory import Knot

Float = NDArray[np.float64]

FPS = 30.0

FIRST_HOLD_S, INNER_HOLD_S, LAST_HOLD_S = 0.15, 0.07, 0.40
"""Usual holds of a citation form; the last one is the longest (Liddell and Johnson 1989)."""
LAST_TOUCH_S = 0.1
"""A last hold that touches the body: hands rest there for a moment only."""
PREPARATION_PACE, RETRACTION_PACE = 1.06, 1.25
"""Duration of the reaches from and to rest, over what the travel law gives."""
REST_S = 0.17
"""Usual rest before and after the word."""


@dataclass(frozen=True)
class Events:
    """Frames of an isolated word, and how near its hands are to the skin in its first and last postures.

    Skin distances are those of ``touch_events``: of the strong hand, or of either where the hands mirror one another,
    to head, trunk, the other hand and the other arm.

    up: the last frame of rest
    start: the first posture
    end: the last posture
    down: the first frame of rest again
    first: the first movement, [begin, end]; None for a word without movement
    passes: [begin, end] of every pass of the last movement, in order: its repetitions, or a circle's revolutions
    touches_first: whether the first posture touches: a skin distance of at most 5 mm
    touches_last: whether the last posture touches
    gap_first_cm: skin distance at ``start``; None in corpora of version 1, whose touches are those of the notation
    gap_last_cm: skin distance at ``end``
    """

    up: int
    start: int
    end: int
    down: int
    first: tuple[int, int] | None
    passes: tuple[tuple[int, int], ...]
    touches_first: bool = False
    touches_last: bool = False
    gap_first_cm: float | None = None
    gap_last_cm: float | None = None


@dataclass(frozen=True, eq=False)
class IsolatedWord:
    """An isolated word as a signer made it.

    sign: the sign in notation
    signer: who made it
    states: the motion as states, (T, 63)
    clip: the same motion on the signer's skeleton
    events: its events
    """

    sign: Sign
    signer: Signer
    states: Float
    clip: Clip
    events: Events

    def __len__(self) -> int:
        return len(self.states)


def isolated(sign: Sign, signer: Signer = STANDARD, take: int = 0, fps: float = FPS) -> IsolatedWord:
    """A sign in citation form, as in a dictionary: both arms rest before and after it. The same arguments give the same
    motion; another ``take`` varies it a little.
    """
    rng = stream("take", signer.name, sign.gloss, take)
    segments = _SegmentPlan(sign, signer, fps, rng, take)
    knots = between_frames(segments.knots, segments.stops(), signer, sign.gloss, take)
    rest = resting(signer, sign.gloss, take)
    before, after = (max(2, round(fps * REST_S * rng.uniform(0.7, 1.6))) for _ in range(2))
    up = _reach_frames(rest, knots[0].state, signer, fps, PREPARATION_PACE * rng.uniform(0.94, 1.06))
    down = _reach_frames(knots[-1].state, rest, signer, fps, RETRACTION_PACE * rng.uniform(0.94, 1.06))
    states = np.concatenate(
        [
            np.broadcast_to(rest, (before, pose.SIZE)),
            trajectory.from_rest_to_rest(knots, rest, up, down, signer),
            np.broadcast_to(rest, (after, pose.SIZE)),
        ]
    )
    offset = before + up
    events = segments.events(before - 1, offset, down)
    span = events.up, events.start, events.end, events.down
    states = two_hands.in_their_own_time(states, sign, signer, take, fps, span)
    states = segments.low_passed(states, offset)
    if signer.manner != PLAIN:  # splines through uneven knots swing a little beyond them
        trajectory.clip_fingers(states)
    states = states + trajectory.small_motions(len(states), fps, signer, rng)
    segments.add_overlays(states, offset)
    states = add_body_motion(states, events, signer, fps, (sign.gloss, take))
    states = clear_collisions(states, signer)
    clip = pose.clip(states, signer, fps, sign.gloss)
    return IsolatedWord(sign, signer, states, clip, _with_touches(events, clip, sign, signer))


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
"""Postures of the strong and the weak hand at each rest but hanging."""
_HELD_LOWER_CM = 2.0
"""How much lower than these postures hands rest."""


def resting(signer: Signer, *names: str | int) -> Float:
    """The state (63,) of a signer at rest; ``names`` seed its small variations."""
    rng = stream("rest", signer.name, *names)
    state = np.zeros(pose.SIZE)
    if signer.rest != HANGING:
        for first, posture in zip((0, 27), _HELD[signer.rest], strict=True):
            hand_state = locations.weak_hand(posture, signer)
            offset = np.array([0.0, 2.0 * signer.rest_out_cm - _HELD_LOWER_CM, 0.0])
            hand_state[:3] += 0.6 * rng.standard_normal(3) + offset
            hand_state[6:] *= 1.0 + 0.06 * rng.standard_normal()
            state[first : first + 27] = hand_state
        return state
    for first in (0, 27):
        jitter = 0.6 * rng.standard_normal(3)
        wrist = np.array([-26.0 - signer.rest_out_cm, -39.5, 4.0 + signer.rest_fwd_cm]) + jitter
        arms = 0.5 * (signer.arms + 1.0)
        wrist = wrist * np.array([signer.shoulders, arms, 1.0]) * signer.scale
        state[first : first + 3] = wrist
        quat = locations.facing((-1.0, 0.0, -0.25), (0.05, -1.0, 0.12))
        state[first + 3 : first + 6] = pose.hand_rotvecs(wrist, quat, signer)
        state[first + 6 : first + 27] = HANDSHAPES["rest"].angles * (1.0 + 0.06 * rng.standard_normal())
    return state


def _reach_frames(start: Float, end: Float, signer: Signer, fps: float, pace: float) -> int:
    travel = np.linalg.norm(pose.hands(end)[:, pose.WRIST] - pose.hands(start)[:, pose.WRIST], axis=-1).max()
    return max(4, round(fps * pace * trajectory.travel_seconds(float(travel), signer)) - 1)


def _with_touches(events: Events, clip: Clip, sign: Sign, signer: Signer) -> Events:
    """A word's events with how near its hands come to the skin in its first and last postures."""
    first, last = skin_gaps(clip, (events.start, events.end), touching_sides(sign, signer))
    return replace(
        events,
        touches_first=bool(first <= TOUCH_CM),
        touches_last=bool(last <= TOUCH_CM),
        gap_first_cm=float(first),
        gap_last_cm=float(last),
    )


@dataclass(frozen=True)
class _TimedSegment:
    """A segment, its [begin, end] frames, and for a movement those of each pass."""

    segment: Segment
    begin: int
    end: int
    passes: tuple[tuple[int, int], ...] = ()


class _SegmentPlan:
    """A sign's segments in time, frame 0 at the first posture, and the knots of their trajectory."""

    def __init__(self, sign: Sign, signer: Signer, fps: float, rng: np.random.Generator, take: int) -> None:
        self.sign, self.signer, self.fps, self.take = sign, signer, fps, take
        self.size = signer.amplitude * float(np.exp(0.05 * rng.standard_normal()))
        self.tempo = float(np.exp(0.05 * np.clip(rng.standard_normal(), -2, 2)))
        self.jitter = 0.7 * signer.scale * rng.standard_normal(3)
        self.pace = tempo_of(sign, signer, take)
        self.postures = self._postures()
        self._set_out()
        least = fps * self.pace.least_s / signer.tempo / (self.stop + 1)
        if least > 1.0:
            self.pace = replace(self.pace, movement=least * self.pace.movement)
            self._set_out()

    def _set_out(self) -> None:
        """Set the knots and the segments in time."""
        self.knots = [Knot(0, self._first_state(), True)]
        self.timed = [self._add(n, segment) for n, segment in enumerate(self.sign.segments)]

    @property
    def stop(self) -> int:
        """The frame of the last knot set so far."""
        return round(self.knots[-1].frame)

    def stops(self) -> list[int]:
        """Frames, 0 at the first posture, where a segment or a pass begins or ends, in order."""
        spans = [span for timed in self.timed for span in ((timed.begin, timed.end), *timed.passes)]
        return sorted({frame for span in spans for frame in span})

    def low_passed(self, states: Float, offset: int) -> Float:
        """States of the whole word as the signer's low pass leaves them."""
        deviation = self.signer.manner.low_pass_frames * self.fps / FPS
        if not deviation:
            return states
        frames = [frame + offset for frame in self.stops()]
        told = {t.end + offset for t in self.timed if touches(t.segment, self.sign)}
        passes = [(begin + offset, stop + offset) for t in self.timed for begin, stop in t.passes]
        touched = touching(states[frames], self.signer)
        return low_passed(
            states, deviation, passes, [f for f, one in zip(frames, touched, strict=True) if one or f in told]
        )

    def events(self, up: int, offset: int, down: int) -> Events:
        """The word's events, its first posture at frame ``offset``, with ``down`` frames of retraction."""
        moves = [
            [(begin + offset, stop + offset) for begin, stop in timed.passes] for timed in self.timed if timed.passes
        ]
        return Events(
            up=up,
            start=offset,
            end=offset + self.stop,
            down=offset + self.stop + down + 1,
            first=moves[0][0] if moves else None,
            passes=tuple(moves[-1]) if moves else (),
        )

    def add_overlays(self, states: Float, offset: int) -> None:
        """Add local movements and gestures of head and trunk to states of the whole word, in place."""
        for timed in self.timed:
            add_gesture(states, timed.segment, timed.begin + offset, timed.end + offset, self.fps)
        for timed in self.timed:
            if timed.segment.local is not None:
                part = states[timed.begin + offset : timed.end + offset + 1]
                add_local_movement(part, timed.segment, self.sign.hands, self.signer)

    def _postures(self) -> list[tuple[Float, Float]]:
        """Both hand states at the end of each segment; a weak hand without a posture of its own mirrors or rests."""
        meets = self.sign.hands in ("symmetric", "alternating")
        arms: dict[Posture | None, WeakArm] = {}
        pairs = []
        for segment in self.sign.segments:
            if segment.weak not in arms:
                arms[segment.weak] = WeakArm(self.signer, self._weak_hand(segment.weak))
            weak = arms[segment.weak]
            strong = locations.strong_hand(segment.strong, weak, meets, self.size)
            location = segment.strong.location
            if location in IN_SPACE and not (meets and location.endswith("-mid")):
                strong = translated(strong, self.jitter, self.signer)
            pairs.append((strong, strong if meets else weak.hand))
        tempo, rest = self.tempo * self.signer.tempo / self.pace.movement, resting(self.signer, self.sign.gloss)
        touching = [touches(segment, self.sign) for segment in self.sign.segments]
        return undershoot.undershot(pairs, self.sign, touching, rest, tempo, self.signer)

    def _weak_hand(self, posture: Posture | None) -> Float:
        if posture is None:
            return resting(self.signer, self.sign.gloss)[27:54]
        return locations.weak_hand(posture, self.signer, self.size)

    def _first_state(self) -> Float:
        """The first posture; hands that alternate are where the first movement begins for each."""
        moves = [n for n, s in enumerate(self.sign.segments) if s.kind == "M"]
        if self.sign.hands == "alternating" and moves:
            return self._path(moves[0], begin=0).at(0.0)
        return np.concatenate([*self.postures[0], np.zeros(9)])

    def _add(self, n: int, segment: Segment) -> _TimedSegment:
        """Add a segment's knots."""
        segments = self.sign.segments
        last = n == len(segments) - 1
        begin = self.stop
        passes: tuple[tuple[int, int], ...] = ()
        if segment.kind == "M":
            passes = self._add_passes(n, segment, stops=last or segments[n + 1].kind == "H")
        elif segment.kind == "H":
            usual = LAST_HOLD_S if last else FIRST_HOLD_S if n == 0 else INNER_HOLD_S
            factor = self.pace.last_hold if last else self.pace.first_hold if n == 0 else 1.0
            if last and n > 0 and touches(segment, self.sign):
                usual, factor = LAST_TOUCH_S, self.pace.last_touch
            pause_s, drift = hold_pause(self.signer, self.sign, self.take, n)
            n_frames = max(2, self._frames(segment.seconds or usual, factor) + round(self.fps * pause_s))
            state = self.knots[-1].state
            if pause_s and not touches(segment, self.sign):
                state = drifted(state, drift, self.signer, self.sign.hands)
            self.knots.append(Knot(begin + n_frames, state, True))
        return _TimedSegment(segment, begin, self.stop, passes)

    def _frames(self, seconds: float, factor: float) -> int:
        return round(self.fps * seconds * factor / self.tempo / self.signer.tempo)

    def _path(self, n: int, begin: int) -> PathMotion:
        """The motion of segment ``n`` from the posture of segment ``begin``."""
        segment, postures = self.sign.segments[n], self.postures
        ends = (segment.strong, self.sign.segments[begin].strong)
        lift = None
        if segment.lift:
            surface = next((end for end in ends if end.location not in IN_SPACE), ends[0])
            weak = WeakArm(self.signer, postures[n][1])
            lift = locations.lifted(surface, weak) * segment.lift * self.signer.scale
        carried = all(end.location in ON_BASE for end in ends)
        return PathMotion(
            segment, self.sign.hands, self.signer, postures[begin], postures[n], self.size, lift=lift, carried=carried
        )

    def _add_passes(self, n: int, segment: Segment, stops: bool) -> tuple[tuple[int, int], ...]:
        """Add a movement's knots; the frames of its passes."""
        path = self._path(n, begin=n - 1)
        start = begin = self.stop
        revolutions = path.revolutions
        count = 2 * segment.times - 1 if not path.still else segment.times
        each = self._frames(path.seconds() / segment.tempo, self.pace.movement)
        if segment.seconds is not None:
            each = round(segment.seconds * self.fps / count)
        each = max(6 * revolutions if path.circles else 4, each)
        path, turned = varied_rounds(path, self.sign.gloss, self.take, n)
        passes = []
        for k, stroke in enumerate(strokes(path, count, each, self.sign.gloss, self.take, n)):
            for s, fraction in path.knots(stroke.n_frames, not stroke.forward):
                time = turned(fraction) * stroke.n_frames
                time = time if path.rounds and s < 1.0 else round(time)  # uneven rounds: knots less than a frame apart
                self.knots.append(Knot(start + time, path.of_pass(k, stroke.along(s)), False))
            if stroke.forward:
                cuts = [start + round(stroke.n_frames * turned(t / revolutions)) for t in range(revolutions + 1)]
                passes += list(itertools.pairwise(cuts))
            start += stroke.n_frames
        self.knots[-1] = replace(self.knots[-1], stop=stops)
        if segment.local is not None and path.still:
            return ((begin, self.stop),)
        return tuple(passes)


def touches(segment: Segment, sign: Sign) -> bool:
    """Whether the notation puts a segment's strong hand on the body, the base hand, or (mirrored, on the midline) the
    other hand. What is seen to touch, which events tell, can differ.
    """
    posture = segment.strong
    meets = sign.hands in ("symmetric", "alternating") and posture.location in ("space-mid", "space-low-mid")
    free = posture.location in IN_SPACE and not meets
    return not free and abs(posture.off) < 1.0 and all(abs(c) < 1.0 for c in posture.shift)
