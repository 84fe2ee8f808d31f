"""Keeps strokes and circles of written signs in their written shape, and hands and elbows in place while they are
written to stay.

A disturbance (a body in the way, the other hand, a touch that gives way, a moving head) displaces only one end of a
stroke. Length and direction tell a reader more than a place in the open, so the other end moves along: in a row of
postures in the open, each is displaced as far as the touch before them, or otherwise as the most displaced one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from signsplice.motion import FloatArray
from signsplice.signer import arms, hand, locations, pose
from signsplice.signer.collisions import TOLERANCE_CM
from signsplice.signer.figure import Figure
from signsplice.signer.hand import hand_part
from signsplice.signer.location_targets import (
    CORRECTIONS,
    UNCORRECTED_LOCATIONS,
    PostureHold,
    WrittenMotion,
    limit_length,
    move_hands,
    resolve_collisions,
)
from signsplice.signer.locations import WeakArm
from signsplice.signer.phonology import REST, Posture, in_space, on_arm
from signsplice.signer.pose import MIRROR
from signsplice.signer.trajectory import wendland

_MOST_CM = 8.0
"""Largest displacement of a posture, cm."""
_MOST_FIRST_CM = 1.5
"""Largest displacement of a first posture for the sake of those that follow, cm."""
_LEFT_CM = 0.5
"""Error up to which all postures are left, cm."""
_HELD_S = 0.2
"""Time before and after a hold in which elbows move to and from their held directions, seconds."""
_STILL_CM = 0.5
"""How far a base hand that stays may move, cm."""
_TOGETHER_CM = 10.0
"""Distance of the skins up to which the strong hand moves with the base hand, cm."""
_BLOCKED_CM = 1.5
"""Distance from its goal at which a posture counts as blocked, cm."""


def keep_path_shape(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """Gives the strokes of a whole word's states (T, 65), free of collisions, their written shape."""
    signer, every = word.signer, word.holds
    rows = _rows(word)
    _, still = word.partition_holds(_is_open)
    before: list[FloatArray] = []
    goals: list[FloatArray] = []
    for first in (True, False):
        palms = _palms(states, word.figure)
        places = [_steadiest(palms[:, hold.which], hold) for hold in every]
        if first:
            before, places = places, _in_rows(places, rows, word)
        else:  # a row goes back if one of its postures was pushed out of the body
            for row in rows:
                if any(float(np.linalg.norm(places[n] - goals[n])) > _BLOCKED_CM * signer.scale for n in row):
                    places = [before[n] if n in row else place for n, place in enumerate(places)]
        goals = places
        missing = [
            (replace(hold, first=frame, last=frame), place - palms[frame, hold.which])
            for hold, place in zip(every, places, strict=True)
            if _is_open(hold.posture)
            for frame in range(hold.first, hold.last + 1)
        ]
        if max((float(np.linalg.norm(miss)) for _, miss in missing), default=0.0) < _LEFT_CM * signer.scale:
            break
        moved = resolve_collisions(move_hands(states, word.interpolate_displacements(missing, still), signer), word)
        depth = word.depth(moved)
        if depth <= TOLERANCE_CM or depth <= word.depth(states):
            states = moved
    return states


def keep_circles(states: FloatArray, planned: FloatArray, word: WrittenMotion) -> FloatArray:
    """Gives circles in a whole word's states (T, 65) the ``planned`` shape (T, 65) between their current ends: an
    obstacle moves a whole circle, not a side of it.
    """
    moves = np.zeros((len(states), 2, 3))
    for timed in word.segments:
        if not timed.segment.circles:
            continue
        frames = slice(timed.begin, timed.end + 1)
        now, planned_wrists = (pose.hands(x)[frames, :, pose.WRIST] for x in (states, planned))
        off = planned_wrists - now
        share = np.linspace(0.0, 1.0, len(off))[:, None, None]
        moves[frames] = off - off[0] - share * (off[-1] - off[0])
    if not moves.any():
        return states
    return arms.keep_elbows(resolve_collisions(move_hands(states, moves, word.signer), word), states, word.signer)


def keep_base_hand(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """Keeps base hands in a whole word's states (T, 65) in place while they are written to stay; a near strong hand
    moves with the correction.
    """
    if word.sign.hands != "base":
        return states
    moves = np.zeros((len(states), 2, 3))
    spans: list[tuple[int, int]] = []
    for before, timed in zip((None, *word.segments), word.segments, strict=False):
        moves_alone = timed.segment.weak_local or timed.segment.weak_path.kind == "circle"
        if before is None or moves_alone or before.segment.weak != timed.segment.weak:
            spans.append((timed.end, timed.end))
        elif timed.segment.weak and timed.segment.weak.location != REST:
            spans[-1] = spans[-1][0], timed.end
    signer, times = word.signer, np.arange(len(states))
    for first, last in spans:
        weak = pose.hands(states)[first : last + 1, 1, pose.WRIST]
        off = weak - np.median(weak, axis=0)
        back = limit_length(off, _STILL_CM * signer.scale) - off
        if not back.any():
            continue
        within = np.clip(times, first, last)
        fade = wendland(times, within[:, None], CORRECTIONS.reach_s * word.fps)
        frames = np.flatnonzero(fade[:, 0])
        capsules = word.figure.pose_arms(states[frames], frames).capsules
        groups = capsules.body.groups
        distance = capsules.nearest(groups.right, (groups.left,), _TOGETHER_CM)[0]
        shift = fade[frames] * back[within[frames] - first]
        moves[frames, 1] += shift
        moves[frames, 0] += MIRROR * shift * pose.smooth_step(2.0 - 2.0 * distance / _TOGETHER_CM)
    return move_hands(states, moves, signer)


def hold_elbows(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """Holds elbows in a whole word's states (T, 65) while hands stay, in the direction that bends wrists least."""
    directions, angles = arms.directions_of(states, word.signer), pose.solve_arms_and_angles(states, word.signer)[1]
    bent, reach = arms.beyond_easy(angles.stacked), round(_HELD_S * word.fps)
    # Elbows farther away in time stay; for one frame the later entry counts.
    missing = [
        (replace(hold, first=max(hold.first - reach, 0), last=hold.last + reach), np.zeros(3)) for hold in word.holds
    ]
    for hold in word.holds:
        frames = range(hold.first, hold.last + 1)
        best = min(frames, key=lambda frame: float(np.linalg.norm(bent[frame, hold.which])))
        turns = directions[best, hold.which] - directions[frames, hold.which]
        missing += [(replace(hold, first=frame, last=frame), x) for frame, x in zip(frames, turns, strict=True)]
    return arms.turn_elbows(states, directions + word.interpolate_displacements(missing), word.signer)


def _in_rows(places: Sequence[FloatArray], rows: Sequence[Sequence[int]], word: WrittenMotion) -> list[FloatArray]:
    """Places (3,) of palms, with equal displacements from the written places within each row."""
    new_places, written = [*places], dict[tuple[Posture, Posture | None], FloatArray]()
    every, signer = word.holds, word.signer
    for row in rows:
        if len(row) == 1:
            continue
        keys = [(every[n].posture, _weak_posture(every, every[n])) for n in row]
        for key in dict.fromkeys(keys):
            if key not in written:
                posture, weak = key
                arm = WeakArm(signer, locations.weak_hand(weak, signer) if weak else np.zeros(27))
                written[key] = locations.palm(posture, arm, word.sign.hands == "symmetric")
        off = np.array([places[n] - written[key] for n, key in zip(row, keys, strict=True)])
        lead = 0 if every[row[0]].posture.touch else int(np.linalg.norm(off, axis=1).argmax())
        goal = off[lead]
        changes = limit_length(goal - off, _MOST_CM * signer.scale)
        changes[0] = limit_length(goal, max(_MOST_FIRST_CM * signer.scale, float(np.linalg.norm(off[0])))) - off[0]
        for n, change in zip(row, changes, strict=True):
            new_places[n] = places[n] + change
    return new_places


def _is_open(posture: Posture) -> bool:
    return not posture.touch and posture.location not in UNCORRECTED_LOCATIONS


def _rows(word: WrittenMotion) -> list[list[int]]:
    """Rows of holds, by number, that strokes lead through. A new row begins at each touch, at a place that is written
    again, with the other hand, and at the other hand, which moves itself. A base hand stays if the other one is at it.
    """
    rows, sign = list[list[int]](), word.sign
    led = sign.hands == "base" and any(on_arm(segment.strong.location) for segment in sign.segments)
    for n, (before, hold) in enumerate(zip((None, *word.holds), word.holds, strict=False)):
        if (
            before is not None
            and before.which == hold.which
            and not (led and hold.which)
            and _is_open(hold.posture)
            and before.posture.location not in UNCORRECTED_LOCATIONS
            and not on_arm(hold.posture.location)
            and (before.posture.location == hold.posture.location or in_space(hold.posture.location))
        ):
            rows[-1].append(n)
        else:
            rows.append([n])
    return rows


def _weak_posture(every: Sequence[PostureHold], stay: PostureHold) -> Posture | None:
    """The weak hand's posture during a hold of the strong hand at it; None for any other hold."""
    if stay.which or not on_arm(stay.posture.location):
        return None
    weak = [hold.posture for hold in every if hold.which and hold.first <= stay.first]
    return weak[-1] if weak else None


def _palms(states: FloatArray, figure: Figure) -> FloatArray:
    """Middles of both palms (T, 2, 3) in the chest's axes, each as of a right hand."""
    arms = figure.pose_arms(states)
    fingers = pose.hands(states)[..., pose.FINGERS]
    centres = _PALM.centre(hand.points(fingers)) * figure.signer.hands * figure.signer.scale
    places = arms.positions[:, :, 3] + np.einsum("tkab,tkb->tka", arms.rotations[:, :, 3], centres * pose.MIRRORS)
    return np.asarray(pose.MIRRORS * places)


_PALM = hand_part("palm")


def _steadiest(palms: FloatArray, stay: PostureHold) -> FloatArray:
    """Place of a palm (T, 3) during a hold, from the frame nearest to all others."""
    there = palms[stay.first : stay.last + 1]
    return np.asarray(there[np.linalg.norm(there[:, None] - there, axis=-1).sum(axis=1).argmin()])
