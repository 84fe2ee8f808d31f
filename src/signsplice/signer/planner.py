"""Turns signs in notation into motion: segments in time, knots from postures and paths, trajectories through knots,
small motions, collision avoidance.

An isolated word consists of rest, preparation, the sign's segments, retraction and rest. Holds, and starts and ends of
movements, are stops; with the trait ``off_frame`` a stop lies up to 0.45 frames from the frame of its event.

Faster signing lowers signs at the forehead (Tyrone and Mauk 2010, Journal of Phonetics 38: 317-328) and leaves
movements short of their targets (Mauk 2003, Undershoot in two modalities, University of Texas). A touch stays a touch.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion import Clip, FloatArray
from signsplice.signer import arms, handshapes, location_targets, locations, path_shape, pose, trajectory, two_hands
from signsplice.signer.body_motion import (
    add_body_motion,
    add_gesture,
    add_gestures,
    add_local_movement,
    approximate_nearness,
    wrist_movements,
)
from signsplice.signer.collisions import TOUCH_CM, clear_collisions, hand_clearances, touching
from signsplice.signer.contacts import solve_contacts
from signsplice.signer.figure import Figure
from signsplice.signer.location_targets import (
    WrittenMotion,
    apply_location_targets,
    facing_as_written,
    resolve_collisions,
    within_reach,
)
from signsplice.signer.locations import ON_HEAD, WeakArm, resting
from signsplice.signer.paths import (
    PathMotion,
    rounds,
    strokes,
    translate_hand,
    translate_state,
    vary_rounds,
    without_spins,
)
from signsplice.signer.phonology import MIRRORED_HANDS, REST, Posture, Segment, Sign, in_space, on_base
from signsplice.signer.signer import PLAIN, STANDARD, Signer, stream
from signsplice.signer.timing import LANDING_S, Events, SignTake, TimedSegment, between_frames, hold_pause, tempo_of
from signsplice.signer.trajectory import Knot, low_passed

FPS = 30.0


@dataclass(frozen=True)
class CitationDurations:
    """Usual durations of the parts of a citation form."""

    first_hold_s: float = 0.15
    """First hold, seconds."""
    inner_hold_s: float = 0.07
    """Hold between movements, seconds."""
    last_hold_s: float = 0.40
    """Last hold, seconds; it is the longest (Liddell and Johnson 1989)."""
    last_touch_s: float = 0.1
    """Last hold that touches the body, seconds: hands rest there for a moment only."""
    preparation_pace: float = 1.06
    """Duration of the reach from rest, over that of the travel law."""
    retraction_pace: float = 1.25
    """Duration of the reach to rest, over that of the travel law."""
    rest_s: float = 0.17
    """Rest before and after the word, seconds."""


@dataclass(frozen=True)
class Undershoot:
    """How far short of their places the movements of a signer of usual undershoot stay."""

    usual_cm: float = 0.5
    """Distance at the usual tempo, cm."""
    largest_cm: float = 2.0
    """Largest distance, cm."""
    largest_share: float = 0.1
    """Largest distance as a fraction of the movement."""
    head_lowering: float = 0.5
    """Lowering of signs at the head over the distance by which movements stay short; the sum is limited."""


DURATIONS = CitationDurations()
_UNDERSHOOT = Undershoot()

_LARGEST_DEPTH_CM = 0.4
"""Largest depth of a hand of a written sign in the body, cm."""
_N_CLEARINGS = 3
"""How often a deeper hand is moved out again, at most."""


class SegmentPlan:
    """A sign's segments in time, frame 0 at the first posture, and the knots of their trajectory."""

    def __init__(self, sign: Sign, signer: Signer, fps: float, rng: np.random.Generator, take: int) -> None:
        self.sign, self.signer, self.fps, self.take = sign, signer, fps, take
        self.size = signer.amplitude * float(np.exp(0.05 * rng.standard_normal()))
        self.tempo = float(np.exp(0.05 * np.clip(rng.standard_normal(), -2, 2)))
        self.jitter = 0.7 * signer.scale * rng.standard_normal(3)
        self.pace = tempo_of(sign, signer, take)
        self.postures = self._postures()
        self._plan_segments()
        least = fps * self.pace.least_s / signer.tempo / (self.stop + 1)
        if least > 1.0:
            self.pace = replace(self.pace, movement=least * self.pace.movement)
            self._plan_segments()

    def _plan_segments(self) -> None:
        """Set the knots and the segments in time."""
        circles = self.sign.segments[0].kind == "X" and self.sign.segments[1].path.kind == "circle"
        self.knots = [Knot(0, self._first_state(), not (circles and self.pace.landing))]
        self.landed: FloatArray | None = None
        self.timed = [self._add(n, segment) for n, segment in enumerate(self.sign.segments)]

    @property
    def stop(self) -> int:
        """The frame of the last knot set so far."""
        return round(self.knots[-1].frame)

    def stops(self) -> list[int]:
        """Frames at which a segment or a pass begins or ends, in order; 0 is the first posture."""
        spans = [span for timed in self.timed for span in ((timed.begin, timed.end), *timed.passes)]
        return sorted({frame for span in spans for frame in span})

    def low_passed(self, states: FloatArray, offset: int) -> FloatArray:
        """States of the whole word after the signer's low pass."""
        deviation = self.signer.manner.low_pass_frames * self.fps / FPS
        if not deviation:
            return states
        frames = [frame + offset for frame in self.stops()]
        touch_frames = {t.end + offset for t in self.timed if touches(t.segment, self.sign)}
        passes = [span for t in self.timed for span in t.later(offset).passes]
        if self.sign.kind != "written":
            touched = touching(states[frames], self.signer)
            touch_frames |= {frame for frame, is_touch in zip(frames, touched, strict=True) if is_touch}
        return low_passed(states, deviation, passes, sorted(touch_frames))

    def events(self, up: int, offset: int, down: int) -> Events:
        """The word's events, its first posture at frame ``offset``, with ``down`` frames of retraction."""
        moves = [timed.later(offset).passes for timed in self.timed if timed.passes]
        first, passes = (moves[0][0], moves[-1]) if moves else (None, ())
        return Events(up, offset, offset + self.stop, offset + self.stop + down + 1, first, passes)

    def add_overlays(self, states: FloatArray, offset: int) -> None:
        """Add local movements and gestures of head and trunk to states of the whole word, in place. Wrist movements of
        written signs are added later, when their elbows are known.
        """
        for timed in self.timed:
            add_gesture(states, timed.segment, timed.begin + offset, timed.end + offset, self.fps)
        for timed in self.timed:
            part = states[timed.begin + offset : timed.end + offset + 1]
            add_local_movement(part, timed.segment, self.sign.hands, self.signer, self.sign.kind != "written")

    def _postures(self) -> list[tuple[FloatArray, FloatArray]]:
        """Both hand states at the end of each segment; a weak hand without a posture of its own mirrors or rests."""
        meets = self.sign.hands in MIRRORED_HANDS
        arms: dict[Posture | None, WeakArm] = {}
        strong_hands: dict[tuple[Posture, Posture | None], FloatArray] = {}
        pairs = []
        for segment in self.sign.segments:
            if segment.weak not in arms:
                arms[segment.weak] = WeakArm(self.signer, self._weak_hand(segment.weak))
            weak = arms[segment.weak]
            key = segment.strong, segment.weak
            strong = strong_hands.get(key)
            if strong is None:
                strong = strong_hands[key] = locations.strong_hand(segment.strong, weak, meets, self.size)
            location = segment.strong.location
            if location == REST:
                strong = resting(self.signer, self.sign.gloss)[:27]
            elif in_space(location) and not (meets and location.endswith("-mid")) and not segment.strong.touch:
                strong = translate_hand(strong, self.jitter, self.signer)
            pairs.append((strong, strong if meets else weak.hand))
        return self._undershot(without_spins(pairs))

    def _undershot(self, pairs: list[tuple[FloatArray, FloatArray]]) -> list[tuple[FloatArray, FloatArray]]:
        """Both hand states at the end of each segment, the strong one moved towards the previous segment (the first one
        towards rest) unless it touches. A mirrored weak hand moves too. A posture that is kept stays the same.
        """
        sign, signer = self.sign, self.signer
        amount = short_cm(self.tempo * signer.tempo / self.pace.movement, signer)
        if amount == 0.0 or sign.kind == "written":  # hands of written signs are brought to their places afterwards
            return pairs
        states = np.array([pose.of_hands(*pair) for pair in pairs])
        close = hand_clearances(states, signer, TOUCH_CM)[:, [0, 2]].min(axis=1) < TOUCH_CM
        moved: list[tuple[FloatArray, FloatArray]] = []
        for n, (strong, weak) in enumerate(pairs):
            short = strong
            if n and np.array_equal(strong, pairs[n - 1][0]):
                short = moved[-1][0]
            elif not (close[n] or touches(sign.segments[n], sign)):
                before = states[n - 1] if n else resting(signer, sign.gloss)
                back = before[pose.WRIST] - strong[pose.WRIST]
                shift = back * min(amount / max(float(np.linalg.norm(back)), 1e-9), _UNDERSHOOT.largest_share)
                if sign.segments[n].strong.location in ON_HEAD:
                    shift = shift - np.array([0.0, _UNDERSHOOT.head_lowering * amount, 0.0])
                    limit = _UNDERSHOOT.largest_cm * signer.manner.undershoot * signer.scale
                    shift *= min(1.0, limit / float(np.linalg.norm(shift)))
                short = translate_hand(strong, shift, signer)
            moved.append((short, short if weak is strong else weak))
        return moved

    def _weak_hand(self, posture: Posture | None) -> FloatArray:
        if posture is None or posture.location == REST:
            return resting(self.signer, self.sign.gloss)[27:54]
        return locations.weak_hand(posture, self.signer, self.size)

    def _first_state(self) -> FloatArray:
        """The first posture; alternating hands are at the start of their own first movements."""
        moves = [n for n, s in enumerate(self.sign.segments) if s.kind == "M"]
        if self.sign.hands == "alternating" and moves:
            return self._path(moves[0], begin=0).at(0.0)
        return pose.of_hands(*self.postures[0])

    def _add(self, n: int, segment: Segment) -> TimedSegment:
        """Add a segment's knots."""
        segments = self.sign.segments
        last = n == len(segments) - 1
        begin = self.stop
        passes: tuple[tuple[int, int], ...] = ()
        if segment.kind == "M":
            passes = self._add_passes(n, segment)
        elif segment.kind == "H":
            usual = DURATIONS.last_hold_s if last else DURATIONS.first_hold_s if n == 0 else DURATIONS.inner_hold_s
            factor = self.pace.last_hold if last else self.pace.first_hold if n == 0 else 1.0
            if last and n > 0 and touches(segment, self.sign):
                usual, factor = DURATIONS.last_touch_s, self.pace.last_touch
            pause_s, drift = hold_pause(self.signer, self.sign, self.take, n)
            n_frames = max(2, self._frames(segment.seconds or usual, factor) + round(self.fps * pause_s))
            if self.landed is not None:
                landing = LANDING_S * self.fps
                if self.sign.kind == "written":  # a slow movement comes to rest as slowly
                    between = self.knots[-1].frame - self.knots[-2].frame
                    landing = 1.3 * between if segments[n - 1].circles else max(landing, between / 3.0)
                self.knots.append(Knot(begin + min(n_frames - 1, round(landing)), self.landed, True))
            state, self.landed = self.knots[-1].state, None
            if pause_s and not touches(segment, self.sign):
                state = translate_state(state, drift, self.signer, self.sign.hands)
            self.knots.append(Knot(begin + n_frames, state, True))
        return TimedSegment(segment, begin, self.stop, passes)

    def _frames(self, seconds: float, factor: float) -> int:
        return round(self.fps * seconds * factor / self.tempo / self.signer.tempo)

    def _path(self, n: int, begin: int) -> PathMotion:
        """The motion of segment ``n`` from the posture of segment ``begin``."""
        segment, postures = self.sign.segments[n], self.postures
        ends = (segment.strong, self.sign.segments[begin].strong)
        lift = None
        if segment.lift:
            surface = next((end for end in ends if not in_space(end.location)), ends[0])
            weak = WeakArm(self.signer, postures[n][1])
            lift = locations.lift_direction(surface, weak) * segment.lift * self.signer.scale
        carried = all(on_base(end.location) for end in ends)
        return PathMotion(
            segment, self.sign.hands, self.signer, postures[begin], postures[n], self.size, lift=lift, carried=carried
        )

    def _add_passes(self, n: int, segment: Segment) -> tuple[tuple[int, int], ...]:
        """Add a movement's knots and return the frames of its passes."""
        path = self._path(n, begin=n - 1)
        start = begin = self.stop
        revolutions = path.revolutions
        count = 2 * segment.times - 1 if not path.still else segment.times
        each = self._frames(path.seconds() / segment.tempo, self.pace.movement)
        least = self.pace.revolution_s * revolutions if path.circles else self.pace.stroke_s if count == 1 else 0.0
        each = max(each, self._frames(least / segment.tempo, 1.0))
        if segment.seconds is not None:
            each = round(segment.seconds * self.fps / count)
        each = max(6 * revolutions if path.circles else 4, each)
        path, turned = vary_rounds(path, self.sign.gloss, self.take, n)
        passes = []
        for k, stroke in enumerate(strokes(path, count, each, self.sign.gloss, self.take, n)):
            for s, fraction in path.knots(stroke.n_frames, not stroke.forward):
                time = turned(fraction) * stroke.n_frames
                if s == 1.0 or not (path.rounds or (path.circles and self.sign.kind == "written")):
                    time = round(time)  # knots of even and uneven rounds lie between frames
                self.knots.append(Knot(start + time, path.of_pass(k, stroke.along(s)), False))
            if stroke.forward:
                cuts = [start + round(stroke.n_frames * turned(t / revolutions)) for t in range(revolutions + 1)]
                passes += list(itertools.pairwise(cuts))
            start += stroke.n_frames
        landing = self.pace.landing
        if self.sign.kind == "written":  # of the last round; circles come to rest in less of it
            landing /= max(rounds(path), revolutions) * (2.0 if path.circles else 1.0)
        self._arrive(n, path.of_pass(k, stroke.along(1.0 - landing)))
        if path.still:
            return ((begin, self.stop),)
        return tuple(passes)

    def _arrive(self, n: int, short: FloatArray) -> None:
        """End movement ``n`` as its successor requires: it passes into another movement, flows into the retraction,
        stops, or comes from the state ``short`` of its last posture to that posture within a following open hold.
        """
        end, rest = self.knots[-1], self.sign.segments[n + 1 :]
        holds_next = bool(rest) and rest[0].kind == "H"
        stops = holds_next if rest else not self.pace.landing
        if rest and self.sign.kind == "written":
            segment = self.sign.segments[n]  # hands stay for what wrists or fingers do
            stops = holds_next or (rest[0].strong, rest[0].weak) == (segment.strong, segment.weak)
        if holds_next and self.pace.landing and not self._is_touching(self.sign.segments[n], end.state):
            self.landed, stops = end.state, False
            end = replace(end, state=short)
        self.knots[-1] = replace(end, stop=stops)

    def _is_touching(self, segment: Segment, state: FloatArray) -> bool:
        """Whether hands touch at a segment's end: by the notation in written signs, otherwise by the state."""
        if self.sign.kind == "written":
            return touches(segment, self.sign)
        return bool(touching(state[None], self.signer)[0])


def touches(segment: Segment, sign: Sign) -> bool:
    """Whether the notation puts a segment's strong hand on the body, the base hand, or (mirrored, on the midline) the
    other hand. The touches that events report can differ.
    """
    posture = segment.strong
    meets = sign.hands in MIRRORED_HANDS and posture.location in ("space-mid", "space-low-mid")
    free = in_space(posture.location) and not meets and not posture.touch
    return not free and abs(posture.off) < 1.0 and all(abs(c) < 1.0 for c in posture.shift)


def short_cm(tempo: float, signer: Signer) -> float:
    """How far short of its place a movement of a tempo (1 is usual) stays, cm: a few mm to 2 cm."""
    return signer.manner.undershoot * min(_UNDERSHOOT.usual_cm * tempo**3, _UNDERSHOOT.largest_cm) * signer.scale


@dataclass(frozen=True, eq=False)
class IsolatedWord:
    """An isolated word of a signer.

    sign: the sign in notation
    signer: who made it
    states: the motion as states, (T, 65)
    clip: the same motion on the signer's skeleton
    events: its events
    segments: its segments in time, frames of the word
    """

    sign: Sign
    signer: Signer
    states: FloatArray
    clip: Clip
    events: Events
    segments: tuple[TimedSegment, ...]

    def __len__(self) -> int:
        return len(self.states)


def synthesize_word(sign: Sign, signer: Signer = STANDARD, take: int = 0, fps: float = FPS) -> IsolatedWord:
    """Synthesizes a sign in citation form, as in a dictionary: both arms rest before and after it. Equal arguments give
    equal motion; another ``take`` varies it a little.
    """
    rng = stream("take", signer.name, sign.gloss, take)
    if sign.kind == "written":
        sign = location_targets.ease_places(sign, signer)
    plan = SegmentPlan(sign, signer, fps, rng, take)
    knots = between_frames(plan.knots, plan.stops(), signer, sign.gloss, take)
    rest = resting(signer, sign.gloss, take)
    before, after = (max(2, round(fps * DURATIONS.rest_s * rng.uniform(0.7, 1.6))) for _ in range(2))
    up = _reach_frames(rest, knots[0].state, signer, fps, DURATIONS.preparation_pace * rng.uniform(0.94, 1.06))
    down = _reach_frames(knots[-1].state, rest, signer, fps, DURATIONS.retraction_pace * rng.uniform(0.94, 1.06))
    word = trajectory.from_rest_to_rest(knots, rest, up, down, signer)
    states = np.concatenate([np.tile(rest, (before, 1)), word, np.tile(rest, (after, 1))])
    offset = before + up
    events = plan.events(before - 1, offset, down)
    closeness = approximate_nearness(states, signer, fps) if sign.kind == "written" else None
    states = two_hands.with_separate_timing(states, SignTake(sign, signer, take, fps), events, closeness)
    states = plan.low_passed(states, offset)
    if signer.manner != PLAIN:  # splines through uneven knots swing a little beyond them
        trajectory.clip_fingers(states)
        states = handshapes.open_thumbs(states)
    states = states + trajectory.small_motions(len(states), fps, signer, rng)
    plan.add_overlays(states, offset)
    add_gestures(states, sign.gestures, events, fps)
    states = add_body_motion(states, events, signer, fps, closeness)
    segments = tuple(timed.later(offset) for timed in plan.timed)
    if sign.kind == "written":
        states = _refine_written_states(states, segments, sign, signer, fps)
    else:
        for _ in range(2):  # a forearm that is turned can meet the other hand
            states = clear_collisions(arms.smooth_elbows(states, signer, fps), signer)
    clip = pose.clip(states, signer, fps, sign.gloss)
    return IsolatedWord(sign, signer, states, clip, events, segments)


def _refine_written_states(
    states: FloatArray, segments: tuple[TimedSegment, ...], sign: Sign, signer: Signer, fps: float
) -> FloatArray:
    """Refines the states (T, 65) of a written word: hands at their written places, in the written directions as far as
    these are easy, steady elbows, no collisions.
    """
    planned, hanging = arms.from_hanging(within_reach(states, signer), signer)
    word = WrittenMotion(sign, segments, Figure(planned, hanging), fps)
    directions = facing_as_written(states, word)
    states = apply_location_targets(arms.turn_hands(planned, directions, hanging), word)
    if sign.hands == "symmetric" or not all(in_space(timed.segment.strong.location) for timed in segments):
        states = resolve_collisions(states, word)
    states = arms.smooth_elbows(
        arms.turn_hands(states, directions, hanging), hanging, fps, led=True, figure=word.figure
    )
    wrists = wrist_movements(segments, sign.hands, len(states))
    states = apply_location_targets(arms.ease_wrists(states, directions, hanging, *wrists), word)
    touching = path_shape.keep_path_shape(solve_contacts(resolve_collisions(states, word), word), word)
    touching = path_shape.keep_base_hand(path_shape.keep_circles(touching, planned, word), word)
    touching = path_shape.hold_elbows(touching, word)
    states = arms.limit_forearm_speed(arms.limit_elbow_speed(touching, hanging, fps), hanging, fps)
    if states is not touching:
        states = arms.keep_elbows(resolve_collisions(states, word), states, hanging)
    for _ in range(_N_CLEARINGS):
        if word.depth(states) <= _LARGEST_DEPTH_CM:
            break
        states = path_shape.keep_base_hand(resolve_collisions(states, word), word)
    return arms.from_easy(states, signer)


def _reach_frames(start: FloatArray, end: FloatArray, signer: Signer, fps: float, pace: float) -> int:
    travel = np.linalg.norm(pose.hands(end)[:, pose.WRIST] - pose.hands(start)[:, pose.WRIST], axis=-1).max()
    return max(4, round(fps * pace * trajectory.travel_seconds(float(travel), signer)) - 1)
