"""Hands of written signs at their written places, on the body as it moves.

Places in open space have no marks, and yield a little if hands at them would bend a wrist farther than is comfortable:
a hand that is 4 cm lower or farther out still is where it is written. All of a sign moves alike, so that its movements
stay as they are; whatever touches the body or is at it stays where it is.

What a word goes through (limits of the wrist, elbows that move steadily, head and trunk, hands that keep apart) leaves
a hand, or a finger that touches, up to some centimetres from where its posture is written. Wrists are moved by what is
missing at each posture, spread in time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from signsplice.motion import FloatArray, rotation
from signsplice.motion.curves import minimum_jerk
from signsplice.motion.kinematics import rest_positions
from signsplice.signer import arms, hand, locations, pose
from signsplice.signer.arms import GRID, hardship
from signsplice.signer.collisions import NEAREST_CM, clear_collisions, penetration
from signsplice.signer.figure import ARMS, Figure, PosedSigner, pose_figure
from signsplice.signer.hand import hand_part
from signsplice.signer.locations import WeakArm, axes, facing, locate, on_joint, on_weak_arm
from signsplice.signer.phonology import ON_ARM, REST, Posture, Sign, in_space, on_arm, on_base
from signsplice.signer.pose import MIRROR
from signsplice.signer.signer import JOINTS, Signer, shoulder, skeleton
from signsplice.signer.timing import LANDING_S, TimedSegment
from signsplice.signer.trajectory import wendland

_MOVES = np.array([(0.0, up, fwd) for up in (0.0, -2.0, -4.0, 2.0) for fwd in (0.0, 2.0, 4.0, 6.0)])
"""Displacements that are tried, chest axes, cm."""
_OFF_CM, _ALONG_CM = 16.0, 32.0
"""How far a hand goes off its place, and along itself, where another part of it is there then, for a cost of 1."""
_FIRST_OFF_CM, _MOST_OFF_CM = 2.6, 4.5
"""How far it goes off at most in its first posture, whose place is written, and later on."""


def ease_places(sign: Sign, signer: Signer) -> Sign:
    """A written sign at places where its arms are comfortable; the sign itself where something is not in open space."""
    pairs = list(dict.fromkeys((one.strong, one.weak) for one in sign.segments))
    if not all(_is_open(posture, sign) for pair in pairs for posture in pair if posture):
        return sign
    nothing = np.zeros(27)
    found = []
    for strong, weak in pairs:
        arm = WeakArm(signer, locations.weak_hand(weak, signer) if weak and on_base(strong.location) else nothing)
        made = ((strong, arm), *(((weak, WeakArm(signer, nothing)),) if weak else ()))
        found += [locations.strong_wrist(one, its, sign.hands != "base")[:2] for one, its in made
                  if one.location != REST]  # fmt: skip
    if not found:
        return sign
    wrists, quats = (np.array(x) for x in zip(*found, strict=True))
    arms = pose.solve_arm(wrists + signer.scale * _MOVES[:, None], signer)  # (M, N)
    rotvecs = rotation.log(rotation.multiply(rotation.inverse(arms.fore), quats))
    hard, effort = hardship(arms, rotvecs, signer, GRID[::3])  # (M, N, S)
    easiest = (hard + effort).argmin(axis=-1)[..., None]
    along = _MOVES @ rotation.to_matrix(quats)[..., 0].T  # (M, N)
    off = np.sqrt(np.maximum(np.square(_MOVES).sum(axis=-1)[:, None] - np.square(along), 0.0))
    costs = np.take_along_axis(hard, easiest, axis=-1)[..., 0] + np.square(off / _OFF_CM) + np.square(along / _ALONG_CM)
    costs[(off[:, :1] > _FIRST_OFF_CM) | (off > _MOST_OFF_CM)] = np.inf
    move = _MOVES[costs.sum(axis=-1).argmin()]
    if not move.any():
        return sign
    segments = (replace(one, strong=_shift_posture(one.strong, move), weak=one.weak and _shift_posture(one.weak, move))
                for one in sign.segments)  # fmt: skip
    return replace(sign, segments=tuple(segments))


def _is_open(posture: Posture, sign: Sign) -> bool:
    """Whether a hand is in open space, or at the other one, which is."""
    return on_base(posture.location) or (in_space(posture.location) and not (posture.touch and sign.hands == "one"))


def _shift_posture(posture: Posture, move: FloatArray) -> Posture:
    """A posture in open space moved (3,)."""
    if posture.location == REST or on_base(posture.location):
        return posture
    out, up, fwd = np.add(posture.shift, move).tolist()
    return replace(posture, shift=(out, up, fwd))


_ROUNDS, _BETTER = 3, 0.85
"""How often hands are moved at most, and to what part of it what is missing shrinks where they are moved again."""
RADIUS_S = 0.3
"""How far from a posture in time a correction reaches."""
_LEFT_CM = 0.2
"""How far from its place a hand that touches nothing may stay."""
LEFT_ALONE = ON_ARM | {REST}
"""Locations where hands are left alone: a forearm that crosses the other arm would be pushed about."""
_MOST_CM = 8.0
"""How far a hand is moved at most."""
_MOST_PUSH_CM = 8.0
"""How far a hand is pushed out of the body at most."""
_BEHIND_CM = 12.0
"""From how far behind the shoulder on wrists stay."""
_BEFORE = np.array([-0.35, 0.0, 0.9367])
"""Where it is else moved."""


def apply_location_targets(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """States (T, 65) of a whole word with hands at their places at the end of each of its segments."""
    signer = word.signer
    wanted, still = word.partition_holds(lambda posture: posture.location not in LEFT_ALONE)
    moves = np.zeros((len(states), 2, 3))
    if not wanted:
        return states
    frames = sorted({one.first for one in wanted})
    rows = {frame: row for row, frame in enumerate(frames)}
    centres = [part_centre(states, one, signer) for one in wanted]
    least, best = np.inf, moves
    for n in range(_ROUNDS + 1):
        posed = pose_figure(word.figure, move_hands(states[frames], moves[frames], signer), np.array(frames))
        missing = [
            _missing(posed, rows[one.first], one, word.sign, centre)
            for one, centre in zip(wanted, centres, strict=True)
        ]
        left = sum(float(np.linalg.norm(miss)) for miss in missing)
        if left >= _BETTER * least:
            break
        least, best = left, moves
        if n == _ROUNDS or left == 0.0:
            break
        step = word.interpolate_displacements(zip(wanted, missing, strict=True), still)
        if word.sign.hands == "base":  # a hand at the other one goes where that one goes
            missing = [
                miss + MIRROR * step[one.first, 1] if not one.which and on_base(one.posture.location) else miss
                for one, miss in zip(wanted, missing, strict=True)
            ]
            step = word.interpolate_displacements(zip(wanted, missing, strict=True), still)
        moves = limit_length(moves + step, _MOST_CM)
    return move_hands(states, best, signer)


def part_centre(states: FloatArray, hold: PostureHold, signer: Signer) -> FloatArray:
    """Where the part that a posture names is in its hand's axes (3,), of a right hand, cm."""
    fingers = pose.hands(states)[hold.first, hold.which, pose.FINGERS]
    return hand_part(hold.posture.part).centre(hand.points(fingers)) * signer.hands * signer.scale


def move_hands(states: FloatArray, moves: FloatArray, signer: Signer) -> FloatArray:
    """States (T, 65) with hands moved (T, 2, 3) that are not turned, and elbows in the directions where they are."""
    if not moves.any():
        return states
    quats, steady = pose.hand_rotations(states, signer), arms.directions_of(states, signer)
    made = states.copy()
    wrists = move_into_reach(pose.hands(states)[..., pose.WRIST] + moves, signer)
    pose.hands(made)[..., pose.WRIST] = wrists
    arm = pose.solve_arm(wrists, signer)
    turned = rotation.multiply(rotation.inverse(arm.fore), quats)
    return arms.turn_arms(made, arm, turned, arms.swivels_to(arm, steady), signer)


def facing_as_written(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """Rotations (T, 2, 4) of the hands of states (T, 65), in the chest's axes, turned so that they are as written in
    each posture: near its shoulder a hand that is moved a little turns far with its forearm.
    """
    quats = pose.hand_rotations(states, word.signer)
    wanted, still = word.partition_holds(lambda posture: posture.location != REST)
    if not wanted:
        return quats
    made = [rotation.inverse(quats[one.first, one.which]) for one in wanted]
    written = [facing(one.posture.palm, one.posture.fingers) for one in wanted]
    turns = [rotation.log(rotation.multiply(goal, quat)) for goal, quat in zip(written, made, strict=True)]
    return rotation.multiply(
        rotation.exp(word.interpolate_displacements(zip(wanted, turns, strict=True), still)), quats
    )


def within_reach(states: FloatArray, signer: Signer) -> FloatArray:
    """States (T, 65) with wrists that are no nearer to their shoulders than an elbow can bend; hands are not turned."""
    reached = states.copy()
    both = pose.hands(reached)
    wrists = move_into_reach(both[..., pose.WRIST], signer)
    both[..., pose.ROTVEC] = pose.hand_rotvecs(wrists, pose.hand_rotations(states, signer), signer)
    both[..., pose.WRIST] = wrists
    return reached


def resolve_collisions(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """States (T, 65) of a word without collisions, hands pushed no farther than is of use: what an arm cannot reach is
    not clear anywhere.
    """
    mirrored = word.sign.hands == "symmetric"
    free = clear_collisions(states, word.signer, figure=word.figure, mirrored=mirrored).copy()
    wrists = pose.hands(states)[..., pose.WRIST]
    moves = limit_length(pose.hands(free)[..., pose.WRIST] - wrists, _MOST_PUSH_CM)
    pose.hands(free)[..., pose.WRIST] = move_into_reach(wrists + moves, word.signer)
    return free


def move_into_reach(wrists: FloatArray, signer: Signer) -> FloatArray:
    """Wrists (T, 2, 3) moved before the shoulder where they are so near to it that no elbow bends so far; far behind it
    they stay.
    """
    away = wrists / signer.scale - shoulder(signer)
    along = away @ _BEFORE
    beside = np.square(away).sum(axis=-1) - np.square(along)
    push = np.maximum(np.sqrt(np.maximum(NEAREST_CM**2 - beside, 0.0)) - along, 0.0)
    push = push * pose.smooth_step((along + _BEHIND_CM) / 8.0)
    return np.asarray(wrists + push[..., None] * _BEFORE * signer.scale)


def limit_length(vectors: FloatArray, most: float) -> FloatArray:
    """Vectors (..., 3) of a length of at most ``most``."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors * np.minimum(1.0, most / np.maximum(length, 1e-9)))


@dataclass(frozen=True)
class PostureHold:
    """A posture of the strong (0) or the weak hand (1) that is kept from a ``first`` frame to a ``last`` one."""

    first: int
    last: int
    which: int
    posture: Posture


@dataclass(frozen=True, eq=False)
class WrittenMotion:
    """A written sign whose motion is corrected.

    sign, segments: the sign, and its segments in time
    figure: of the states (T, 65) of the whole word but for their arms
    fps: frames a second
    """

    sign: Sign
    segments: Sequence[TimedSegment]
    figure: Figure
    fps: float

    @property
    def signer(self) -> Signer:
        """Who makes it, as if right-handed."""
        return self.figure.signer

    @cached_property
    def holds(self) -> list[PostureHold]:
        """Where hands are at the end of each segment, and so on (``posture_holds``)."""
        return posture_holds(self.segments, self.sign, self.fps)

    def partition_holds(self, changes: Callable[[Posture], bool]) -> tuple[list[PostureHold], list[PostureHold]]:
        """The holds of postures that ``changes`` holds for, and the others."""
        changed = [one for one in self.holds if changes(one.posture)]
        return changed, [one for one in self.holds if not changes(one.posture)]

    def depth(self, states: FloatArray) -> float:
        """How deep a hand lies in the body at most, cm."""
        return float(penetration(states, self.signer, figure=self.figure)[0].max())

    def interpolate_displacements(
        self, missing: Iterable[tuple[PostureHold, FloatArray]], still: Sequence[PostureHold] = (), parts: int = 1
    ) -> FloatArray:
        """Displacements (T, 2, C) that are what is ``missing`` (C,) of holds, 0 in those that are ``still``, go from
        one to the next between them, and fade within ``RADIUS_S``, or one of its ``parts``, before the first and after
        the last.
        """
        values = [*missing]
        size, times = len(values[0][1]), np.arange(len(self.figure.positions))
        values += [(one, np.zeros(size)) for one in still]
        moves, radius = np.zeros((len(times), 2, size)), max(3.0, RADIUS_S * self.fps / parts)
        for which in (0, 1):
            found = {frame: miss for one, miss in values if one.which == which for frame in (one.first, one.last)}
            if found:
                frames = np.array(sorted(found), np.intp)
                at = np.array([found[int(frame)] for frame in frames])
                u = np.interp(times, frames, np.arange(len(frames)))
                k = u.astype(np.intp)
                between = at[k] + minimum_jerk(u - k)[:, None] * (at[np.minimum(k + 1, len(at) - 1)] - at[k])
                moves[:, which] = between * wendland(times, np.clip(times, frames[0], frames[-1])[:, None], radius)
        return moves


def posture_holds(segments: Sequence[TimedSegment], sign: Sign, fps: float) -> list[PostureHold]:
    """Where hands are at the end of each segment, at both ends of each time that a movement is made, and in holds."""
    mirrored = sign.hands == "symmetric"
    found: list[PostureHold] = []
    for which in (0, 1):
        last: PostureHold | None = None
        for before, one in zip((None, *segments), segments, strict=False):
            posture = one.segment.strong if mirrored or not which else one.segment.weak
            if posture is None:
                continue
            if one.segment.kind == "H" and last is not None and last.posture == posture:
                lands = before is not None and before.segment.kind == "M" and not posture.touch
                landed = round(LANDING_S * fps) if lands else 0
                found[-1] = last = replace(last, first=min(last.first + landed, one.end), last=one.end)
                continue
            passes = one.passes if one.segment.times > 1 else ((one.begin, one.end),)
            for n, (begin, stop) in enumerate(passes):
                if n and last is not None:  # it goes back to where it began
                    found.append(PostureHold(begin, begin, which, last.posture))
                found.append(PostureHold(stop, stop, which, posture))
            last = found[-1]
    return found


def _missing(posed: PosedSigner, frame: int, hold: PostureHold, sign: Sign, part: FloatArray) -> FloatArray:
    """What moves the part of a hand from where it is to where a posture puts it, (3,), cm, in the chest's axes,
    mirrored for the weak hand as its state is. part: where it is in the hand's axes.
    """
    joint, mirror = ARMS[hold.which, 3], pose.MIRRORS[hold.which]
    here = posed.positions[frame, joint] + posed.rotations[frame, joint] @ (part * mirror)
    here = mirror * (here @ posed.rotations[frame, JOINTS["Spine2"]])
    missing = location_target(posed, frame, hold, sign) - here
    length = float(np.linalg.norm(missing))
    tolerance = 0.05 if hold.posture.touch else _LEFT_CM * posed.signer.scale
    return np.asarray(missing * max(0.0, min(length, _MOST_CM) - tolerance) / max(length, 1e-9))


def location_target(posed: PosedSigner, frame: int, hold: PostureHold, sign: Sign) -> FloatArray:
    """Where a posture puts the part of a hand, (3,), cm, in the chest's axes of a body as it is then, mirrored for the
    weak hand as its state is.
    """
    signer, state, which, posture = posed.signer, posed.states[frame], hold.which, hold.posture
    chest, mirror = posed.rotations[frame, JOINTS["Spine2"]], pose.MIRRORS[which]
    site, unit = hand_part(posture.part), signer.hands * signer.scale
    weak = WeakArm(signer, state[27:54])
    if on_arm(posture.location):
        left = ARMS[1, 1:]
        at_shoulder, elbow, wrist = posed.positions[frame, left] @ chest * MIRROR
        turned = chest.T @ posed.rotations[frame, left[2]]
        quat = rotation.from_matrix(MIRROR[:, None] * turned * MIRROR)
        found = on_weak_arm(posture.location, weak, at_shoulder, elbow, wrist, quat)
    else:
        found = locate(posture.location, weak)
    point, normal = found.point, found.normal
    if normal.any() and not on_arm(posture.location):  # the body as it is now
        carrier = JOINTS[on_joint(posture.location, which)]
        rest = rest_positions(skeleton(signer))
        turn = chest.T @ posed.rotations[frame, carrier]
        place = chest.T @ posed.positions[frame, carrier]
        point = mirror * (place + turn @ (mirror * point + rest[JOINTS["Spine2"]] - rest[carrier]))
        normal = mirror * (turn @ (mirror * normal))
    wanted = point + axes(posture.shift) * signer.scale
    if normal.any():
        wanted = wanted + (site.skin * unit + posture.off * signer.scale) * normal
    elif sign.hands == "symmetric" and found.point[0] == 0.0:
        wanted = wanted + axes((site.skin * unit + posture.off * signer.scale, 0.0, 0.0))
    return np.asarray(wanted)
