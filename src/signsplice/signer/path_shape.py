"""Strokes and circles of written signs that are as they are written, and hands and elbows that stay where they are
written to.

What puts a posture off its place (a body in the way, the other hand, a touch that gives way, a head that moves) puts
only one end of a stroke off. Length and direction tell a reader more than a place in the open, so the other end goes
along: in a row of postures in the open each is as far off as the one in a touch before them, or else as the one that is
farthest off.
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
    LEFT_ALONE,
    RADIUS_S,
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
"""How far a posture is moved at most."""
_MOST_FIRST_CM = 1.5
"""How far off its place a posture that no stroke has led to may be for the sake of those that follow."""
_LEFT_CM = 0.5
"""How far off all may be and are left."""
_HELD_S = 0.2
"""How long before and after a hold elbows go to and from where they stay."""
_STILL_CM, _TOGETHER_CM = 0.5, 10.0
"""How far a base hand that stays may move, and up to which distance of skins the strong hand goes where it does."""
_BLOCKED_CM = 1.5
"""How far from where it was to go a posture is that something is in the way of."""


def keep_path_shape(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """States (T, 65) of a whole word, free of collisions, with strokes as they are written."""
    signer, every = word.signer, word.holds
    rows = _rows(word)
    _, still = word.partition_holds(_is_open)
    before: list[FloatArray] = []
    goals: list[FloatArray] = []
    for first in (True, False):
        palms = _palms(states, word.figure)
        places = [_steadiest(palms[:, one.which], one) for one in every]
        if first:
            before, places = places, _in_rows(places, rows, word)
        else:  # a row with a posture that was pushed out of the body goes back
            for row in rows:
                if any(float(np.linalg.norm(places[n] - goals[n])) > _BLOCKED_CM * signer.scale for n in row):
                    places = [before[n] if n in row else place for n, place in enumerate(places)]
        goals = places
        missing = [
            (replace(one, first=frame, last=frame), place - palms[frame, one.which])
            for one, place in zip(every, places, strict=True)
            if _is_open(one.posture)
            for frame in range(one.first, one.last + 1)
        ]
        if max((float(np.linalg.norm(miss)) for _, miss in missing), default=0.0) < _LEFT_CM * signer.scale:
            break
        whole = resolve_collisions(move_hands(states, word.interpolate_displacements(missing, still), signer), word)
        depth = word.depth(whole)
        if depth <= TOLERANCE_CM or depth <= word.depth(states):
            states = whole
    return states


def keep_circles(states: FloatArray, planned: FloatArray, word: WrittenMotion) -> FloatArray:
    """States (T, 65) of a whole word with circles as they were ``planned`` (T, 65) between where they begin and end
    now: what was in the way moves all of a circle, not a side of it.
    """
    moves = np.zeros((len(states), 2, 3))
    for one in word.segments:
        if not one.segment.circles:
            continue
        frames = slice(one.begin, one.end + 1)
        now, then = (pose.hands(x)[frames, :, pose.WRIST] for x in (states, planned))
        off = then - now
        share = np.linspace(0.0, 1.0, len(off))[:, None, None]
        moves[frames] = off - off[0] - share * (off[-1] - off[0])
    if not moves.any():
        return states
    return arms.keep_elbows(resolve_collisions(move_hands(states, moves, word.signer), word), states, word.signer)


def keep_base_hand(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """States (T, 65) of a whole word with base hands that stay while they are written to: what moved them apart from
    the strong hand moves that one, where it is near.
    """
    if word.sign.hands != "base":
        return states
    moves = np.zeros((len(states), 2, 3))
    spans: list[tuple[int, int]] = []
    for before, one in zip((None, *word.segments), word.segments, strict=False):
        own = one.segment.weak_local or one.segment.weak_path.kind == "circle"
        if before is None or own or before.segment.weak != one.segment.weak:
            spans.append((one.end, one.end))
        elif one.segment.weak and one.segment.weak.location != REST:
            spans[-1] = spans[-1][0], one.end
    signer, times = word.signer, np.arange(len(states))
    for first, last in spans:
        weak = pose.hands(states)[first : last + 1, 1, pose.WRIST]
        off = weak - np.median(weak, axis=0)
        back = limit_length(off, _STILL_CM * signer.scale) - off
        if not back.any():
            continue
        within = np.clip(times, first, last)
        fade = wendland(times, within[:, None], RADIUS_S * word.fps)
        frames = np.flatnonzero(fade[:, 0])
        capsules = word.figure.pose_arms(states[frames], frames).capsules
        groups = capsules.body.groups
        apart = capsules.nearest(groups.right, (groups.left,), _TOGETHER_CM)[0]
        along = fade[frames] * back[within[frames] - first]
        moves[frames, 1] += along
        moves[frames, 0] += MIRROR * along * pose.smooth_step(2.0 - 2.0 * apart / _TOGETHER_CM)
    return move_hands(states, moves, signer)


def hold_elbows(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """States (T, 65) of a whole word with elbows that stay while hands stay: where these bend wrists least."""
    directions, wrist = arms.directions_of(states, word.signer), pose.solve_arms_and_wrists(states, word.signer)[1]
    bent, reach = arms.beyond_easy(wrist.angles), round(_HELD_S * word.fps)
    # What is farther away in time stays; of the same frame the later one counts.
    missing = [
        (replace(one, first=max(one.first - reach, 0), last=one.last + reach), np.zeros(3)) for one in word.holds
    ]
    for one in word.holds:
        frames = range(one.first, one.last + 1)
        best = min(frames, key=lambda frame: float(np.linalg.norm(bent[frame, one.which])))
        turns = directions[best, one.which] - directions[frames, one.which]
        missing += [(replace(one, first=frame, last=frame), x) for frame, x in zip(frames, turns, strict=True)]
    return arms.turn_elbows(states, directions + word.interpolate_displacements(missing), word.signer)


def _in_rows(places: Sequence[FloatArray], rows: Sequence[Sequence[int]], word: WrittenMotion) -> list[FloatArray]:
    """The places (3,) of palms, those of a row all as far off what is written."""
    made, written = [*places], dict[tuple[Posture, Posture | None], FloatArray]()
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
            made[n] = places[n] + change
    return made


def _is_open(posture: Posture) -> bool:
    return not posture.touch and posture.location not in LEFT_ALONE


def _rows(word: WrittenMotion) -> list[list[int]]:
    """Stays that strokes lead through, by their numbers: a row begins anew at each touch, at a place that is written
    again, with the other hand, and at the other hand, which itself moves. A base hand stays where the other one is at
    it.
    """
    rows, sign = list[list[int]](), word.sign
    led = sign.hands == "base" and any(on_arm(segment.strong.location) for segment in sign.segments)
    for n, (before, one) in enumerate(zip((None, *word.holds), word.holds, strict=False)):
        if (
            before is not None
            and before.which == one.which
            and not (led and one.which)
            and _is_open(one.posture)
            and before.posture.location not in LEFT_ALONE
            and not on_arm(one.posture.location)
            and (before.posture.location == one.posture.location or in_space(one.posture.location))
        ):
            rows[-1].append(n)
        else:
            rows.append([n])
    return rows


def _weak_posture(every: Sequence[PostureHold], stay: PostureHold) -> Posture | None:
    """The weak hand's posture at the time of a stay of the strong hand at it; None for any other stay."""
    if stay.which or not on_arm(stay.posture.location):
        return None
    weak = [one.posture for one in every if one.which and one.first <= stay.first]
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
    """Where a palm (T, 3) is while it stays: in the frame nearest to all others."""
    there = palms[stay.first : stay.last + 1]
    return np.asarray(there[np.linalg.norm(there[:, None] - there, axis=-1).sum(axis=1).argmin()])
