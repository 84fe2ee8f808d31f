"""Brings hands of written signs to their written places on the moving body.

Places in open space have no marks and yield a little if hands there would bend a wrist uncomfortably: a hand 4 cm lower
or farther out still is at its written place. A whole sign moves alike, so that its movements keep their shape; hands
that touch the body or are at it do not move.

Later steps (limits of the wrist, steady elbows, head and trunk, collisions) leave a hand, or a touching finger, up to
some centimetres from its written place. The wrists are moved by the error at each posture, spread in time.
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
from signsplice.signer.arms import CANDIDATE_SWIVELS, hardship
from signsplice.signer.collisions import CLEARANCE, clear_collisions, penetration
from signsplice.signer.figure import ARMS, Figure, PosedSigner, pose_figure
from signsplice.signer.hand import hand_part
from signsplice.signer.locations import WeakArm, axes, facing, locate, on_joint, on_weak_arm
from signsplice.signer.phonology import ON_ARM, REST, Posture, Sign, in_space, on_arm, on_base
from signsplice.signer.pose import MIRROR
from signsplice.signer.signer import JOINTS, Signer, shoulder, skeleton
from signsplice.signer.timing import LANDING_S, TimedSegment
from signsplice.signer.trajectory import wendland


@dataclass(frozen=True)
class PlaceMoves:
    """Costs and limits of moves of places in open space."""

    across_cost_cm: float = 16.0
    """Displacement across the fingers that costs 1, cm."""
    along_cost_cm: float = 32.0
    """Displacement along the fingers that costs 1, cm: another part of the hand is at the place then."""
    first_across_cm: float = 2.6
    """Largest displacement across the fingers in the first posture, whose place is written, cm."""
    later_across_cm: float = 4.5
    """Largest displacement across the fingers in later postures, cm."""


@dataclass(frozen=True)
class HandCorrections:
    """Limits of corrections that bring hands to their written places."""

    rounds: int = 3
    """Largest number of corrections."""
    stopping_ratio: float = 0.85
    """Error over the previous one from which on corrections stop."""
    reach_s: float = 0.3
    """Distance from a posture in time at which its correction ends, seconds."""
    tolerance_cm: float = 0.2
    """Distance from its place that a hand without a touch may keep, cm."""
    largest_cm: float = 8.0
    """Largest correction of a hand, cm."""
    largest_push_cm: float = 8.0
    """Largest push of a hand out of the body, cm."""
    behind_shoulder_cm: float = 12.0
    """Distance behind the shoulder beyond which wrists stay, cm."""


_PLACE_MOVES = PlaceMoves()
CORRECTIONS = HandCorrections()

UNCORRECTED_LOCATIONS = ON_ARM | {REST}
"""Locations at which hands are not corrected: a forearm that crosses the other arm would be pushed about."""
_FRONT_DIRECTION = np.array([-0.35, 0.0, 0.9367])
"""Direction in which wrists too near the shoulder are moved, a unit vector: forward and outwards."""
_CANDIDATE_MOVES = np.array([(0.0, up, fwd) for up in (0.0, -2.0, -4.0, 2.0) for fwd in (0.0, 2.0, 4.0, 6.0)])
"""Candidate displacements of places in open space, in the chest's axes, cm."""


def ease_places(sign: Sign, signer: Signer) -> Sign:
    """Moves a written sign to places with comfortable arms; returns it unchanged if any hand is not in open space."""
    pairs = list(dict.fromkeys((segment.strong, segment.weak) for segment in sign.segments))
    if not all(_is_open(posture, sign) for pair in pairs for posture in pair if posture):
        return sign
    nothing = np.zeros(27)
    wrist_poses = []
    for strong, weak in pairs:
        arm = WeakArm(signer, locations.weak_hand(weak, signer) if weak and on_base(strong.location) else nothing)
        placed = ((strong, arm), *(((weak, WeakArm(signer, nothing)),) if weak else ()))
        wrist_poses += [locations.strong_wrist(posture, its, sign.hands != "base")[:2] for posture, its in placed
                        if posture.location != REST]  # fmt: skip
    if not wrist_poses:
        return sign
    wrists, quats = (np.array(x) for x in zip(*wrist_poses, strict=True))
    arms = pose.solve_arm(wrists + signer.scale * _CANDIDATE_MOVES[:, None], signer)  # (M, N)
    rotvecs = rotation.log(rotation.multiply(rotation.inverse(arms.fore), quats))
    hard, effort = hardship(arms, rotvecs, signer, CANDIDATE_SWIVELS[::3])  # (M, N, S)
    easiest = (hard + effort).argmin(axis=-1)[..., None]
    lengthwise = _CANDIDATE_MOVES @ rotation.to_matrix(quats)[..., 0].T  # (M, N)
    across = np.sqrt(np.maximum(np.square(_CANDIDATE_MOVES).sum(axis=-1)[:, None] - np.square(lengthwise), 0.0))
    costs = (
        np.take_along_axis(hard, easiest, axis=-1)[..., 0]
        + np.square(across / _PLACE_MOVES.across_cost_cm)
        + np.square(lengthwise / _PLACE_MOVES.along_cost_cm)
    )
    costs[(across[:, :1] > _PLACE_MOVES.first_across_cm) | (across > _PLACE_MOVES.later_across_cm)] = np.inf
    move = _CANDIDATE_MOVES[costs.sum(axis=-1).argmin()]
    if not move.any():
        return sign
    segments = (
        replace(s, strong=_shift_posture(s.strong, move), weak=s.weak and _shift_posture(s.weak, move))
        for s in sign.segments
    )
    return replace(sign, segments=tuple(segments))


def _is_open(posture: Posture, sign: Sign) -> bool:
    """Whether a hand is in open space, or at another hand that is."""
    return on_base(posture.location) or (in_space(posture.location) and not (posture.touch and sign.hands == "one"))


def _shift_posture(posture: Posture, move: FloatArray) -> Posture:
    """A posture in open space, displaced by ``move`` (3,), cm."""
    if posture.location == REST or on_base(posture.location):
        return posture
    outward, up, fwd = np.add(posture.shift, move).tolist()
    return replace(posture, shift=(outward, up, fwd))


def apply_location_targets(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """Moves hands of a whole word's states (T, 65) to their places at the end of each segment."""
    signer = word.signer
    targets, still = word.partition_holds(lambda posture: posture.location not in UNCORRECTED_LOCATIONS)
    moves = np.zeros((len(states), 2, 3))
    if not targets:
        return states
    frames = sorted({hold.first for hold in targets})
    rows = {frame: row for row, frame in enumerate(frames)}
    centres = [part_centre(states, hold, signer) for hold in targets]
    least, best = np.inf, moves
    for n in range(CORRECTIONS.rounds + 1):
        posed = pose_figure(word.figure, move_hands(states[frames], moves[frames], signer), np.array(frames))
        missing = [
            _missing(posed, rows[hold.first], hold, word.sign, centre)
            for hold, centre in zip(targets, centres, strict=True)
        ]
        total = sum(float(np.linalg.norm(miss)) for miss in missing)
        if total >= CORRECTIONS.stopping_ratio * least:
            break
        least, best = total, moves
        if n == CORRECTIONS.rounds or total == 0.0:
            break
        step = word.interpolate_displacements(zip(targets, missing, strict=True), still)
        if word.sign.hands == "base":  # a hand at the other hand moves with it
            missing = [
                miss + MIRROR * step[hold.first, 1] if not hold.which and on_base(hold.posture.location) else miss
                for hold, miss in zip(targets, missing, strict=True)
            ]
            step = word.interpolate_displacements(zip(targets, missing, strict=True), still)
        moves = limit_length(moves + step, CORRECTIONS.largest_cm)
    return move_hands(states, best, signer)


def part_centre(states: FloatArray, hold: PostureHold, signer: Signer) -> FloatArray:
    """Position (3,) of the part that a posture names, in the axes of its hand, as a right hand, cm."""
    fingers = pose.hands(states)[hold.first, hold.which, pose.FINGERS]
    return hand_part(hold.posture.part).centre(hand.points(fingers)) * signer.hands * signer.scale


def move_hands(states: FloatArray, moves: FloatArray, signer: Signer) -> FloatArray:
    """Moves hands of states (T, 65) by ``moves`` (T, 2, 3), cm, without turning them or changing elbow directions."""
    if not moves.any():
        return states
    quats, steady = pose.hand_rotations(states, signer), arms.directions_of(states, signer)
    new_states = states.copy()
    wrists = move_into_reach(pose.hands(states)[..., pose.WRIST] + moves, signer)
    pose.hands(new_states)[..., pose.WRIST] = wrists
    arm = pose.solve_arm(wrists, signer)
    turned = rotation.multiply(rotation.inverse(arm.fore), quats)
    return arms.turn_arms(new_states, arm, turned, arms.swivels_to(arm, steady), signer)


def facing_as_written(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """Rotations (T, 2, 4) of the hands of states (T, 65), in the chest's axes, corrected to the written ones in each
    posture: near its shoulder, a small move of a hand turns it far with its forearm.
    """
    quats = pose.hand_rotations(states, word.signer)
    targets, still = word.partition_holds(lambda posture: posture.location != REST)
    if not targets:
        return quats
    inverses = [rotation.inverse(quats[hold.first, hold.which]) for hold in targets]
    written = [facing(hold.posture.palm, hold.posture.fingers) for hold in targets]
    turns = [rotation.log(rotation.multiply(goal, quat)) for goal, quat in zip(written, inverses, strict=True)]
    return rotation.multiply(
        rotation.exp(word.interpolate_displacements(zip(targets, turns, strict=True), still)), quats
    )


def within_reach(states: FloatArray, signer: Signer) -> FloatArray:
    """Moves wrists of states (T, 65) that are nearer to their shoulders than elbows can bend; hands are not turned."""
    reached = states.copy()
    both = pose.hands(reached)
    wrists = move_into_reach(both[..., pose.WRIST], signer)
    both[..., pose.ROTVEC] = pose.hand_rotvecs(wrists, pose.hand_rotations(states, signer), signer)
    both[..., pose.WRIST] = wrists
    return reached


def resolve_collisions(states: FloatArray, word: WrittenMotion) -> FloatArray:
    """Moves hands of a word's states (T, 65) out of collisions, by a limited push: places out of an arm's reach are
    clear nowhere.
    """
    mirrored = word.sign.hands == "symmetric"
    free = clear_collisions(states, word.signer, figure=word.figure, mirrored=mirrored).copy()
    wrists = pose.hands(states)[..., pose.WRIST]
    moves = limit_length(pose.hands(free)[..., pose.WRIST] - wrists, CORRECTIONS.largest_push_cm)
    pose.hands(free)[..., pose.WRIST] = move_into_reach(wrists + moves, word.signer)
    return free


def move_into_reach(wrists: FloatArray, signer: Signer) -> FloatArray:
    """Moves wrists (T, 2, 3) to the front of the shoulder if they are nearer to it than an elbow can bend; wrists far
    behind it stay.
    """
    offset = wrists / signer.scale - shoulder(signer)
    forward = offset @ _FRONT_DIRECTION
    sideways_sq = np.square(offset).sum(axis=-1) - np.square(forward)
    push = np.maximum(np.sqrt(np.maximum(CLEARANCE.least_wrist_distance_cm**2 - sideways_sq, 0.0)) - forward, 0.0)
    push = push * pose.smooth_step((forward + CORRECTIONS.behind_shoulder_cm) / 8.0)
    return np.asarray(wrists + push[..., None] * _FRONT_DIRECTION * signer.scale)


def limit_length(vectors: FloatArray, most: float) -> FloatArray:
    """Shortens vectors (..., 3) to a length of at most ``most``."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors * np.minimum(1.0, most / np.maximum(length, 1e-9)))


@dataclass(frozen=True)
class PostureHold:
    """A posture that the strong (0) or the weak hand (1) keeps from the frame ``first`` to the frame ``last``."""

    first: int
    last: int
    which: int
    posture: Posture


@dataclass(frozen=True, eq=False)
class WrittenMotion:
    """A written sign during the correction of its motion.

    sign, segments: the sign, and its segments in time
    figure: the body in the states (T, 65) of the whole word, apart from the arms
    fps: frames a second
    """

    sign: Sign
    segments: Sequence[TimedSegment]
    figure: Figure
    fps: float

    @property
    def signer(self) -> Signer:
        """The signer, as if right-handed."""
        return self.figure.signer

    @cached_property
    def holds(self) -> list[PostureHold]:
        """The holds of ``posture_holds``."""
        return posture_holds(self.segments, self.sign, self.fps)

    def partition_holds(self, changes: Callable[[Posture], bool]) -> tuple[list[PostureHold], list[PostureHold]]:
        """The holds whose postures satisfy ``changes``, and the others."""
        changed = [hold for hold in self.holds if changes(hold.posture)]
        return changed, [hold for hold in self.holds if not changes(hold.posture)]

    def depth(self, states: FloatArray) -> float:
        """Largest depth of a hand in the body, cm."""
        return float(penetration(states, self.signer, figure=self.figure)[0].max())

    def interpolate_displacements(
        self, missing: Iterable[tuple[PostureHold, FloatArray]], still: Sequence[PostureHold] = (), parts: int = 1
    ) -> FloatArray:
        """Displacements (T, 2, C) that equal ``missing`` (C,) in its holds and 0 in the holds ``still``, pass from one
        hold to the next between them, and fade within ``reach_s`` / ``parts`` before the first and after the last.
        """
        values = [*missing]
        size, times = len(values[0][1]), np.arange(len(self.figure.positions))
        values += [(hold, np.zeros(size)) for hold in still]
        moves, radius = np.zeros((len(times), 2, size)), max(3.0, CORRECTIONS.reach_s * self.fps / parts)
        for which in (0, 1):
            by_frame = {
                frame: miss for hold, miss in values if hold.which == which for frame in (hold.first, hold.last)
            }
            if by_frame:
                frames = np.array(sorted(by_frame), np.intp)
                displacements = np.array([by_frame[int(frame)] for frame in frames])
                u = np.interp(times, frames, np.arange(len(frames)))
                k = u.astype(np.intp)
                between = displacements[k] + minimum_jerk(u - k)[:, None] * (
                    displacements[np.minimum(k + 1, len(displacements) - 1)] - displacements[k]
                )
                moves[:, which] = between * wendland(times, np.clip(times, frames[0], frames[-1])[:, None], radius)
        return moves


def posture_holds(segments: Sequence[TimedSegment], sign: Sign, fps: float) -> list[PostureHold]:
    """Postures at the end of each segment, at both ends of each pass of a movement, and in holds."""
    mirrored = sign.hands == "symmetric"
    holds: list[PostureHold] = []
    for which in (0, 1):
        last: PostureHold | None = None
        for before, timed in zip((None, *segments), segments, strict=False):
            posture = timed.segment.strong if mirrored or not which else timed.segment.weak
            if posture is None:
                continue
            if timed.segment.kind == "H" and last is not None and last.posture == posture:
                lands = before is not None and before.segment.kind == "M" and not posture.touch
                landed = round(LANDING_S * fps) if lands else 0
                holds[-1] = last = replace(last, first=min(last.first + landed, timed.end), last=timed.end)
                continue
            passes = timed.passes if timed.segment.times > 1 else ((timed.begin, timed.end),)
            for n, (begin, stop) in enumerate(passes):
                if n and last is not None:  # the hand goes back to its start
                    holds.append(PostureHold(begin, begin, which, last.posture))
                holds.append(PostureHold(stop, stop, which, posture))
            last = holds[-1]
    return holds


def _missing(posed: PosedSigner, frame: int, hold: PostureHold, sign: Sign, part: FloatArray) -> FloatArray:
    """Displacement (3,), cm, from the part of a hand to its place in a posture, in the chest's axes, mirrored for the
    weak hand as its state is. part: position of the part in the hand's axes.
    """
    joint, mirror = ARMS[hold.which, 3], pose.MIRRORS[hold.which]
    place = posed.positions[frame, joint] + posed.rotations[frame, joint] @ (part * mirror)
    place = mirror * (place @ posed.rotations[frame, JOINTS["Spine2"]])
    missing = location_target(posed, frame, hold, sign) - place
    length = float(np.linalg.norm(missing))
    tolerance = 0.05 if hold.posture.touch else CORRECTIONS.tolerance_cm * posed.signer.scale
    return np.asarray(missing * max(0.0, min(length, CORRECTIONS.largest_cm) - tolerance) / max(length, 1e-9))


def location_target(posed: PosedSigner, frame: int, hold: PostureHold, sign: Sign) -> FloatArray:
    """Place (3,), cm, of the part of a hand in a posture, in the chest's axes of the body in this frame, mirrored for
    the weak hand as its state is.
    """
    signer, state, which, posture = posed.signer, posed.states[frame], hold.which, hold.posture
    chest, mirror = posed.rotations[frame, JOINTS["Spine2"]], pose.MIRRORS[which]
    site, unit = hand_part(posture.part), signer.hands * signer.scale
    weak = WeakArm(signer, state[27:54])
    if on_arm(posture.location):
        left_joints = ARMS[1, 1:]
        at_shoulder, elbow, wrist = posed.positions[frame, left_joints] @ chest * MIRROR
        turned = chest.T @ posed.rotations[frame, left_joints[2]]
        quat = rotation.from_matrix(MIRROR[:, None] * turned * MIRROR)
        location = on_weak_arm(posture.location, weak, at_shoulder, elbow, wrist, quat)
    else:
        location = locate(posture.location, weak)
    point, normal = location.point, location.normal
    if normal.any() and not on_arm(posture.location):  # the body as it is now
        carrier = JOINTS[on_joint(posture.location, which)]
        rest = rest_positions(skeleton(signer))
        turn = chest.T @ posed.rotations[frame, carrier]
        place = chest.T @ posed.positions[frame, carrier]
        point = mirror * (place + turn @ (mirror * point + rest[JOINTS["Spine2"]] - rest[carrier]))
        normal = mirror * (turn @ (mirror * normal))
    target = point + axes(posture.shift) * signer.scale
    if normal.any():
        target = target + (site.skin * unit + posture.off * signer.scale) * normal
    elif sign.hands == "symmetric" and location.point[0] == 0.0:
        target = target + axes((site.skin * unit + posture.off * signer.scale, 0.0, 0.0))
    return np.asarray(target)
