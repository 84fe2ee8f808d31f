"""Pushes wrists out of collisions with head, trunk and the other arm, smoothly in time, and measures the distances of
hands from surfaces that they may touch, skin to skin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.collision import PosedCapsules
from signsplice.motion import FloatArray, curves, rotation
from signsplice.signer import pose
from signsplice.signer.figure import Figure, pose_signer
from signsplice.signer.phonology import MIRRORED_HANDS, Posture, on_arm
from signsplice.signer.signer import Signer, shoulder


@dataclass(frozen=True)
class ClearanceSettings:
    """Limits and rounds of the movements that clear hands of the body."""

    nearly_touching_cm: float = 1.0
    """Distance from the skin up to which a hand counts as nearly touching, cm."""
    n_rounds: int = 30
    """Largest number of rounds of pushes, and of further rounds for hands that are stuck."""
    stuck_depth_cm: float = 0.35
    """Depth in the body from which on a hand counts as stuck after these rounds, and is pushed on steadily, cm."""
    n_touch_rounds: int = 12
    """How often a hand whose part touches is moved out of a collision, or back, at most."""
    least_wrist_distance_cm: float = 16.5
    """Smallest distance of a wrist from its shoulder, cm."""
    largest_turn: float = np.deg2rad(40.0)
    """Largest turn of a touching hand that keeps this distance, radians."""


CLEARANCE = ClearanceSettings()

TOLERANCE_CM = 0.2
"""Depth to which a touch may press into the body, cm."""
_PUSH_KERNEL = np.array([0.12, 0.35, 0.72, 1.0, 0.72, 0.35, 0.12])
"""Weights of a push in the frames around it."""


def clear_collisions(
    states: FloatArray, signer: Signer, ends: bool = False, figure: Figure | None = None, mirrored: bool = False
) -> FloatArray:
    """Moves wrists of states (T, 65) out of head, trunk and the other arm if they lie deeper than the tolerance.

    Each push is spread over about five frames. ``ends``: the frames belong between two others; pushes fade out towards
    both ends, so that their neighbours fit. ``figure``: of these states, apart from their arms.
    """
    figure = figure or Figure(states, signer)
    level = curves.fade_window(len(states)) if ends else np.ones(len(states))
    mean = np.zeros((len(states), 2, 3))
    depth, exits = _depths(figure.pose_arms(states).capsules)
    for n in range(2 * CLEARANCE.n_rounds):
        directions = exits
        if n >= CLEARANCE.n_rounds:
            if depth.max() < CLEARANCE.stuck_depth_cm:
                break
            # The hand alternates between both sides of a nose or a finger: the mean direction leads out.
            mean = 0.8 * mean + 0.2 * directions
            directions = mean / (np.linalg.norm(mean, axis=-1, keepdims=True) + 1e-9)
        gain = 0.6 if n < CLEARANCE.n_rounds // 2 else 1.0  # gently first: if two hands meet, both are pushed
        push = gain * np.maximum(depth - 0.7 * TOLERANCE_CM, 0.0) * (depth > TOLERANCE_CM)
        if not push.any():
            break
        pushes = push[..., None] * directions  # (T, 2, 3)
        if mirrored:
            pushes = np.repeat(pushes.mean(axis=1, keepdims=True), 2, axis=1)
            pushes[..., 0] = -np.abs(pushes[..., 0])  # away from the other hand, even if they have crossed
        displacements = curves.smooth_over_time(pushes, _PUSH_KERNEL) * level[:, None, None]
        states = states.copy()
        pose.hands(states)[..., pose.WRIST] += displacements
        frames = np.flatnonzero(displacements.any(axis=(1, 2)))
        depth[frames], exits[frames] = _depths(figure.pose_arms(states[frames], frames).capsules)
    return states


def penetration(
    states: FloatArray, signer: Signer, slack: float = 0.0, figure: Figure | None = None
) -> tuple[FloatArray, FloatArray]:
    """Depth (T, 2) of each hand, strong first, in head, trunk, the other arm or its hand, or of its forearm in the
    other arm, cm, any negative number if it is free by more than ``slack`` (then without a direction); and the unit
    direction (T, 2, 3) out of the body in the chest's axes, mirrored for the weak hand as its state is. ``figure``: of
    these states, apart from their arms.
    """
    return _depths((figure or Figure(states, signer)).pose_arms(states).capsules, slack)


def _depths(capsules: PosedCapsules, slack: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """``penetration`` for capsules in the chest's axes."""
    depth, directions = capsules.near_pairs(slack, forearms=True).penetration()
    return depth[:, ::-1], directions[:, ::-1] * pose.MIRRORS


def touching(states: FloatArray, signer: Signer) -> NDArray[np.bool_]:
    """Whether either hand touches head, trunk or the other hand, or nearly does (T,)."""
    depth, _ = penetration(states, signer, CLEARANCE.nearly_touching_cm)
    return np.asarray(depth.max(axis=1) > -CLEARANCE.nearly_touching_cm)


TOUCH_CM = 0.5
"""Distance of the skins up to which hands count as touching, cm."""


def hand_clearances(states: FloatArray, signer: Signer, most: float = np.inf) -> FloatArray:
    """Distances (T, 4) between skins, cm, negative inside, at most ``most``: of the strong hand and of the weak one
    from head and trunk, of the strong hand from the weak hand or arm, and from the weak hand alone.
    """
    capsules = Figure(states, signer).pose_arms(states).capsules
    body, groups = capsules.body, capsules.body.groups
    solid = (*groups.head, *groups.trunk)
    parts = zip(body.parts, body.sides, strict=True)
    arm = tuple(n for n, (part, side) in enumerate(parts) if side == "left" and part in ("sleeve", "cuff"))
    strong = capsules.nearest(groups.right, (solid, arm, groups.left), most)[0]
    weak = capsules.nearest(groups.left, (solid,), most)[0]
    return np.column_stack([strong[:, 0], weak[:, 0], strong[:, 1:].min(axis=1), strong[:, 2]])


def between_hands(states: FloatArray, signer: Signer, most: float = np.inf) -> FloatArray:
    """Distance (T,) between the skins of the two hands, cm, negative inside, at most ``most``."""
    capsules = Figure(states, signer).pose_arms(states).capsules
    return capsules.nearest(capsules.body.groups.right, (capsules.body.groups.left,), most)[0][:, 0]


def into_touch(state: FloatArray, posture: Posture, hands: str, signer: Signer) -> FloatArray:
    """Displacements (2, 3) of the strong and the weak hand of a state (65,) that bring the strong hand's skin to the
    skin at which a posture is written. Mirrored hands both move: to the body, or on the midline before it to one
    another.
    """
    moves = np.zeros((2, 3))
    meets = hands in MIRRORED_HANDS
    if meets and posture.location.endswith("-mid"):
        distance = float(between_hands(state[None], signer)[0])
        moves[:, 0] = 0.5 * min(distance, CLEARANCE.nearly_touching_cm)  # hands apart do not cross
        return moves
    turned = np.concatenate([state[27:54], state[:27], state[54:]])  # the weak hand in the strong one's place
    for which, strong_state in enumerate((state, turned) if meets else (state,)):
        _, direction = pose_signer(strong_state[None], signer).distance(posture, 0)
        gap = hand_clearances(strong_state[None], signer)[0, 2 if on_arm(posture.location) else 0]
        moves[which] = (max(posture.off, 0.0) * signer.scale - gap) * direction
    return moves


def clear_of_shoulder(
    wrist: FloatArray, quat: FloatArray, part: FloatArray, signer: Signer
) -> tuple[FloatArray, FloatArray]:
    """Turns a hand about a part of it, ``part`` (3,) from the wrist, so that the wrist is not nearer to its shoulder
    than the elbow can bend; returns wrist (3,) and rotation (4,).
    """
    centre = shoulder(signer) * signer.scale
    least = CLEARANCE.least_wrist_distance_cm * signer.scale
    back, to_shoulder = -part, centre - wrist - part
    axis = np.cross(to_shoulder, back)
    lengths = float(np.linalg.norm(back) * np.linalg.norm(to_shoulder))
    if np.linalg.norm(wrist - centre) >= least or np.linalg.norm(axis) < 1e-6:
        return wrist, quat
    goal_angle = np.arccos(np.clip((back @ back + to_shoulder @ to_shoulder - least**2) / (2.0 * lengths), -1.0, 1.0))
    angle = min(float(goal_angle - np.arccos(np.clip(back @ to_shoulder / lengths, -1.0, 1.0))), CLEARANCE.largest_turn)
    turn = rotation.exp(angle * axis / np.linalg.norm(axis))
    return wrist + part + rotation.rotate(turn, back), rotation.multiply(turn, quat)


def in_contact(
    hand_state: FloatArray, quat: FloatArray, weak: FloatArray | None, signer: Signer, normal: FloatArray
) -> FloatArray:
    """Moves a hand state (27,) as little as possible until the hand lies no deeper in the body or the other hand than a
    touch: alternately back to the touch of its part, and out of collisions, preferably along ``normal`` (3,). The other
    hand is ``weak`` (27,), or the mirror image if that is None.
    """
    goal, moved, free = hand_state[:3].copy(), hand_state.copy(), hand_state
    figure = Figure(pose.of_hands(moved, moved if weak is None else weak)[None], signer)
    for n in range(CLEARANCE.n_touch_rounds):
        state = pose.of_hands(moved, moved if weak is None else weak)
        depth, directions = penetration(state[None], signer, figure=figure)
        if depth[0, 0] > TOLERANCE_CM:
            direction = directions[0, 0] + normal
            share = 0.6 if weak is None else 1.0
            wrist = moved[:3] + (depth[0, 0] - 0.5 * TOLERANCE_CM) * share * direction / np.linalg.norm(direction)
        else:
            free = moved
            if np.linalg.norm(goal - moved[:3]) < 0.1 or n >= CLEARANCE.n_touch_rounds - 4:
                break
            wrist = 0.5 * (moved[:3] + goal)
        moved = np.concatenate([wrist, pose.hand_rotvecs(wrist, quat, signer), hand_state[6:]])
    return free if free is not hand_state else moved
