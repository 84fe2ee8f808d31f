"""Turns signs in notation into motion: knots from postures and paths, trajectories through them, small motions,
collision avoidance.

An isolated word consists of rest, preparation, the sign's segments, retraction and rest. Holds, and starts and ends of
movements, are stops; with the trait ``off_frame`` they lie up to 0.45 frames from the nearest frame, the
event's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.signer import elbows, gestures, leeway, pose, strokes, thumbs, trajectory, twists, two_hands
from signsplice.signer.avoidance import TOUCH_CM, clear_collisions, penetration, skin_clearances, touching_sides
from signsplice.signer.body_motion import add_body_motion, wrist_movements
from signsplice.signer.carrying import roughly
from signsplice.signer.comfort import directed, eased
from signsplice.signer.figure import Figure
from signsplice.signer.locations import resting
from signsplice.signer.manner import PLAIN
from signsplice.signer.phonology import Sign, in_space
from signsplice.signer.placing import cleared, facing_as_written, placed, within_reach
from signsplice.signer.rng import stream
from signsplice.signer.segment_plan import FPS, SegmentPlan, TimedSegment
from signsplice.signer.signer import STANDARD, Signer
from signsplice.signer.timing import Events, between_frames
from signsplice.signer.touching import brought_to_touch

PREPARATION_PACE, RETRACTION_PACE = 1.06, 1.25
"""Duration of the reaches from and to rest, over what the travel law gives."""
REST_S = 0.17
"""Usual rest before and after the word."""
_DEEPEST_CM, _CLEARED_AGAIN = 0.4, 3
"""How deep a hand of a written sign may lie in the body, and how often one that is deeper is moved out again."""


@dataclass(frozen=True, eq=False)
class IsolatedWord:
    """An isolated word as a signer made it.

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

    @property
    def posture_frames(self) -> list[tuple[int, int]]:
        """(segment, frame) of each posture: the first one, and that at the end of each movement."""
        found = [(n, one.passes[0][1] if one.segment.times > 1 and one.passes else one.end) for n, one in
                 enumerate(self.segments) if one.segment.kind == "M"]  # fmt: skip
        return [(0, self.events.start), *found]


def isolated(sign: Sign, signer: Signer = STANDARD, take: int = 0, fps: float = FPS) -> IsolatedWord:
    """A sign in citation form, as in a dictionary: both arms rest before and after it. The same arguments give the same
    motion; another ``take`` varies it a little.
    """
    rng = stream("take", signer.name, sign.gloss, take)
    if sign.kind == "written":
        sign = leeway.taken(sign, signer)
    plan = SegmentPlan(sign, signer, fps, rng, take)
    knots = between_frames(plan.knots, plan.stops(), signer, sign.gloss, take)
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
    events = plan.events(before - 1, offset, down)
    span = events.up, events.start, events.end, events.down
    near = None
    if sign.kind == "written":  # hands are brought to their places afterwards
        near = roughly(states, replace(signer, left_handed=False), fps)
    states = two_hands.with_separate_timing(states, sign, signer, take, fps, span, near)
    states = plan.low_passed(states, offset)
    if signer.manner != PLAIN:  # splines through uneven knots swing a little beyond them
        trajectory.clip_fingers(states)
        states = thumbs.opened(states)
    states = states + trajectory.small_motions(len(states), fps, signer, rng)
    plan.add_overlays(states, offset)
    gestures.add(states, sign.gestures, events, fps)
    states = add_body_motion(states, events, signer, fps, near)
    segments = tuple(one.later(offset) for one in plan.timed)
    states = _settled(states, segments, sign, signer, fps)
    clip = pose.clip(states, signer, fps, sign.gloss)
    return IsolatedWord(sign, signer, states, clip, _with_touches(events, clip, sign, signer), segments)


def _settled(
    states: FloatArray, segments: tuple[TimedSegment, ...], sign: Sign, signer: Signer, fps: float
) -> FloatArray:
    """States (T, 65) of a whole word with steady elbows and without collisions; of a written sign at its places."""
    if sign.kind == "written":
        return _written(states, segments, sign, signer, fps)
    for _ in range(2):  # a forearm that is turned can meet the other hand
        states = clear_collisions(elbows.steadied(states, signer, fps), signer)
    return states


def _written(
    states: FloatArray, segments: tuple[TimedSegment, ...], sign: Sign, signer: Signer, fps: float
) -> FloatArray:
    """The same of a written sign, with hands at their written places, in the written directions as far as is easy."""
    directions = facing_as_written(states, segments, sign, signer, fps)
    states, hanging = elbows.from_hanging(within_reach(states, signer), signer)
    figure = Figure(states, hanging)
    planned = states
    states = placed(directed(states, directions, hanging), segments, sign, figure, fps)
    if sign.hands == "symmetric" or not all(in_space(one.segment.strong.location) for one in segments):
        states = cleared(states, figure, sign)
    states = elbows.steadied(directed(states, directions, hanging), hanging, fps, led=True, figure=figure)
    wrists = wrist_movements(segments, sign.hands, len(states))
    states = cleared(placed(eased(states, directions, hanging, *wrists), segments, sign, figure, fps), figure, sign)
    touching = brought_to_touch(states, segments, sign, figure, fps)
    touching = strokes.as_written(touching, segments, sign, figure, fps)
    touching = strokes.rounded(touching, planned, segments, sign, figure)
    touching = strokes.still(touching, segments, sign, figure, fps)
    touching = strokes.held(touching, segments, sign, hanging, fps)
    states = twists.steadied(elbows.slowed(touching, hanging, fps), hanging, fps)
    if states is not touching:
        states = elbows.kept(cleared(states, figure, sign), states, hanging)
    for _ in range(_CLEARED_AGAIN):
        if penetration(states, hanging, figure=figure)[0].max() <= _DEEPEST_CM:
            break
        states = strokes.still(cleared(states, figure, sign), segments, sign, figure, fps)
    return elbows.from_easy(states, signer)


def _reach_frames(start: FloatArray, end: FloatArray, signer: Signer, fps: float, pace: float) -> int:
    travel = np.linalg.norm(pose.hands(end)[:, pose.WRIST] - pose.hands(start)[:, pose.WRIST], axis=-1).max()
    return max(4, round(fps * pace * trajectory.travel_seconds(float(travel), signer)) - 1)


def _with_touches(events: Events, clip: Clip, sign: Sign, signer: Signer) -> Events:
    """A word's events with how near its hands come to the skin in its first and last postures."""
    first, last = skin_clearances(clip, (events.start, events.end), touching_sides(sign, signer))
    return replace(
        events,
        touches_first=bool(first <= TOUCH_CM),
        touches_last=bool(last <= TOUCH_CM),
        gap_first_cm=float(first),
        gap_last_cm=float(last),
    )
