"""Keeps hands out of head, trunk and the other arm: wrists are pushed out of collisions, smoothly in time; and how far
hands are from what they may touch, skin to skin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from signsplice.body.collision import PosedCapsules
from signsplice.motion import FloatArray, curves, rotation
from signsplice.signer import pose
from signsplice.signer.figure import Figure, pose_signer
from signsplice.signer.phonology import MIRRORED_HANDS, Posture, on_arm
from signsplice.signer.signer import Signer, shoulder

TOLERANCE_CM = 0.2
"""Depth up to which a touch may press into the body."""
NEAR_CM = 1.0
"""Distance from the skin up to which a hand may be meant to touch it."""
_ROUNDS = 30
_STUCK_CM = 0.35
"""Depth from which a hand that is still in the body after these rounds is pushed on, in a steadier direction."""
_KERNEL = np.array([0.12, 0.35, 0.72, 1.0, 0.72, 0.35, 0.12])


def clear_collisions(
    states: FloatArray, signer: Signer, ends: bool = False, figure: Figure | None = None, mirrored: bool = False
) -> FloatArray:
    """States (T, 65) with wrists moved out of head, trunk and the other arm where they lay deeper than the tolerance.

    Each push is spread over about five frames. ``ends``: the frames belong between two others; pushes fade out towards
    both ends, so that their neighbours fit. ``figure``: of these states but for their arms.
    """
    figure = figure or Figure(states, signer)
    level = curves.fade_window(len(states)) if ends else np.ones(len(states))
    mean = np.zeros((len(states), 2, 3))
    depth, exits = _depths(figure.pose_arms(states).capsules)
    for n in range(2 * _ROUNDS):
        out = exits
        if n >= _ROUNDS:
            if depth.max() < _STUCK_CM:
                break
            # On either side of a nose or a finger by turns: the mean direction leads out.
            mean = 0.8 * mean + 0.2 * out
            out = mean / (np.linalg.norm(mean, axis=-1, keepdims=True) + 1e-9)
        gain = 0.6 if n < _ROUNDS // 2 else 1.0  # gently first: of two hands that meet, both are pushed
        push = gain * np.maximum(depth - 0.7 * TOLERANCE_CM, 0.0) * (depth > TOLERANCE_CM)
        if not push.any():
            break
        pushes = push[..., None] * out  # (T, 2, 3)
        if mirrored:
            pushes = np.repeat(pushes.mean(axis=1, keepdims=True), 2, axis=1)
            pushes[..., 0] = -np.abs(pushes[..., 0])  # away from the other hand, though they be past one another
        displacements = curves.smooth_over_time(pushes, _KERNEL) * level[:, None, None]
        states = states.copy()
        pose.hands(states)[..., pose.WRIST] += displacements
        frames = np.flatnonzero(displacements.any(axis=(1, 2)))
        depth[frames], exits[frames] = _depths(figure.pose_arms(states[frames], frames).capsules)
    return states


def penetration(
    states: FloatArray, signer: Signer, slack: float = 0.0, figure: Figure | None = None
) -> tuple[FloatArray, FloatArray]:
    """Depth (T, 2) of each hand, strong first, in head, trunk, the other arm or its hand, or of its forearm in the
    other arm, cm, some negative number where it is free by more than ``slack`` (then without a direction); and the unit
    direction (T, 2, 3) out of there in the chest's axes, mirrored for the weak hand as its state is. ``figure``: of
    these states but for their arms.
    """
    return _depths((figure or Figure(states, signer)).pose_arms(states).capsules, slack)


def _depths(capsules: PosedCapsules, slack: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """``penetration`` of capsules in the chest's axes."""
    depth, out = capsules.near_pairs(slack, forearms=True).penetration()
    return depth[:, ::-1], out[:, ::-1] * pose.MIRRORS


def touching(states: FloatArray, signer: Signer) -> NDArray[np.bool_]:
    """Whether either hand touches head, trunk or the other hand, or nearly does (T,)."""
    depth, _ = penetration(states, signer, NEAR_CM)
    return np.asarray(depth.max(axis=1) > -NEAR_CM)


TOUCH_CM = 0.5
"""Distance of the skins up to which hands count as touching."""


def hand_clearances(states: FloatArray, signer: Signer, most: float = np.inf) -> FloatArray:
    """Distances (T, 4) between skins, cm, negative inside, or ``most`` where they are greater: of the strong hand and
    of the weak one from head and trunk, of the strong hand from the weak hand or arm, and from the weak hand alone.
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
    """Distance (T,) between the skins of the two hands, cm, negative inside, or ``most`` where it is greater."""
    capsules = Figure(states, signer).pose_arms(states).capsules
    return capsules.nearest(capsules.body.groups.right, (capsules.body.groups.left,), most)[0][:, 0]


def into_touch(state: FloatArray, posture: Posture, hands: str, signer: Signer) -> FloatArray:
    """Displacements (2, 3) of the strong and the weak hand of a state (65,) that bring the skin of the strong one to
    that at which a posture is written; of hands that mirror one another both: to the body, or before it on the midline,
    to one another.
    """
    moves = np.zeros((2, 3))
    meets = hands in MIRRORED_HANDS
    if meets and posture.location.endswith("-mid"):
        moves[:, 0] = 0.5 * min(float(between_hands(state[None], signer)[0]), NEAR_CM)  # hands apart do not cross
        return moves
    turned = np.concatenate([state[27:54], state[:27], state[54:]])  # the weak hand in the strong one's place
    for which, one in enumerate((state, turned) if meets else (state,)):
        _, out = pose_signer(one[None], signer).distance(posture, 0)
        gap = hand_clearances(one[None], signer)[0, 2 if on_arm(posture.location) else 0]
        moves[which] = (max(posture.off, 0.0) * signer.scale - gap) * out
    return moves


_TOUCH_ROUNDS = 12
"""How often a hand whose part touches is moved out of what it lies in, or back, at most."""
NEAREST_CM, _MOST_LEAN = 16.5, np.deg2rad(40.0)
"""How near to its shoulder a wrist can be, and how far a hand that touches is turned for that."""


def clear_of_shoulder(
    wrist: FloatArray, quat: FloatArray, part: FloatArray, signer: Signer
) -> tuple[FloatArray, FloatArray]:
    """Wrist (3,) and rotation (4,) of a hand turned about a part of it, ``part`` (3,) from the wrist, so that the wrist
    is not so near to its shoulder that the elbow cannot bend so far.
    """
    centre = shoulder(signer) * signer.scale
    least = NEAREST_CM * signer.scale
    back, away = -part, centre - wrist - part
    axis = np.cross(away, back)
    lengths = float(np.linalg.norm(back) * np.linalg.norm(away))
    if np.linalg.norm(wrist - centre) >= least or np.linalg.norm(axis) < 1e-6:
        return wrist, quat
    wanted = np.arccos(np.clip((back @ back + away @ away - least**2) / (2.0 * lengths), -1.0, 1.0))
    angle = min(float(wanted - np.arccos(np.clip(back @ away / lengths, -1.0, 1.0))), _MOST_LEAN)
    turn = rotation.exp(angle * axis / np.linalg.norm(axis))
    return wrist + part + rotation.rotate(turn, back), rotation.multiply(turn, quat)


def in_contact(
    hand_state: FloatArray, quat: FloatArray, weak: FloatArray | None, signer: Signer, normal: FloatArray
) -> FloatArray:
    """A hand state (27,) moved as little as may be until the hand is no deeper in the body, or in the other hand, than
    a touch: by turns back to where its part touches, and out of what it lies in, rather along ``normal`` (3,). The
    other hand is ``weak`` (27,), or its mirror image where that is None.
    """
    wanted, made, free = hand_state[:3].copy(), hand_state.copy(), hand_state
    figure = Figure(pose.of_hands(made, made if weak is None else weak)[None], signer)
    for n in range(_TOUCH_ROUNDS):
        state = pose.of_hands(made, made if weak is None else weak)
        depth, out = penetration(state[None], signer, figure=figure)
        if depth[0, 0] > TOLERANCE_CM:
            way = out[0, 0] + normal
            share = 0.6 if weak is None else 1.0
            wrist = made[:3] + (depth[0, 0] - 0.5 * TOLERANCE_CM) * share * way / np.linalg.norm(way)
        else:
            free = made
            if np.linalg.norm(wanted - made[:3]) < 0.1 or n >= _TOUCH_ROUNDS - 4:
                break
            wrist = 0.5 * (made[:3] + wanted)
        made = np.concatenate([wrist, pose.hand_rotvecs(wrist, quat, signer), hand_state[6:]])
    return free if free is not hand_state else made
