"""A signer's pose in 63 numbers, and the joint rotations it stands for.

The numbers mix freely (sums, splines): places in cm and small rotation vectors that stay far from half a turn. For
each hand, strong first, both written as right hands (the weak one is mirrored at the end):

    wrist    3   from the chest joint, in the chest's axes, cm
    turn     3   the hand seen from the forearm of an arm with a hanging elbow, rotation vector
    fingers 21   hand.ANGLES

then trunk (3) and head (3) rotation vectors and the root's way (3) from where the signer stands, cm.

Arms are solved in closed form: two bones, the elbow on its circle where wrist and forearm are most at ease. Forearm and
wrist angles run into their limits softly, so that no sum of numbers can break a joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signsplice.motion import rotation
from signsplice.motion.clip import Clip
from signsplice.synth import hand
from signsplice.synth.signer import COLLAR, FOREARM, JOINTS, SHOULDER, UPPER_ARM, Signer, skeleton

Float = NDArray[np.float64]

SIZE = 63
WRIST, TURN, FINGERS = slice(0, 3), slice(3, 6), slice(6, 27)
"""Where a hand's numbers lie among its 27."""
TRUNK, HEAD, ROOT = slice(54, 57), slice(57, 60), slice(60, 63)

WRIST_LIMITS = np.deg2rad([[-38.0, 28.0], [-72.0, 82.0]])
"""Least and most deviation (towards the thumb positive) and flexion (towards the palm positive) of the wrist, radians;
American Academy of Orthopaedic Surgeons 1965, widened by 5 degrees for passive range."""
FOREARM_LIMIT = np.deg2rad(95.0)
"""Most turn of the forearm either way from thumb-up, radians (80 to 90 in the same source)."""
ELBOW_LIMIT = np.deg2rad(148.0)

_X = np.array([1.0, 0.0, 0.0])
_HINT = np.array([-0.55, -1.0, -0.35])  # a right elbow hangs down, out and a little back
_SWIVELS = np.deg2rad(np.linspace(-75.0, 45.0, 13))  # negative lifts the elbow outwards
_EASE = np.deg2rad([60.0, 22.0, 42.0, 32.0])  # turns of forearm, wrist sideways, wrist bent, elbow that cost 1
_SHARPNESS = 2.5


def hands(states: Float) -> Float:
    """The two hands' numbers (..., 2, 27) of states (..., 63), a view: strong, weak."""
    return states[..., :54].reshape(*states.shape[:-1], 2, 27)


@dataclass(frozen=True)
class Arm:
    """Right arms in the chest's axes: collar (..., 4), upper arm and forearm (..., 4) with a hanging elbow, the unit
    way from shoulder to wrist (..., 3), and the bend of the elbow (...), radians.
    """

    collar: Float
    upper: Float
    fore: Float
    direction: Float
    bend: Float


def reach(wrists: ArrayLike, who: Signer) -> Arm:
    """The right arm that brings the wrist to places (..., 3), cm from the chest joint, with a hanging elbow.

    Collar bones rise and come forward with the hand, as in the shoulder's rhythm (Inman, Saunders and Abbott 1944: at
    most about 15 degrees each way here). A place out of reach is drawn in softly along the line to the shoulder.
    """
    scale = who.scale
    wrists = np.asarray(wrists, np.float64) / scale
    broad = np.array([-who.shoulders, 1.0, 1.0])
    collar_at, shoulder_way = COLLAR * broad, SHOULDER * broad
    upper_arm, forearm = UPPER_ARM * who.arms, FOREARM * who.arms
    out = (wrists - collar_at - shoulder_way) / (upper_arm + forearm)
    rise = np.deg2rad(15.0) * _smooth_step((out[..., 1] + 0.35) / 1.2)
    forward = np.deg2rad(14.0) * _smooth_step((out[..., 2] + 0.5 * out[..., 0] - 0.25) / 0.9)
    collar = rotation.multiply(
        rotation.exp(forward[..., None] * np.array([0.0, 1.0, 0.0])), rotation.exp(rise[..., None] * [0.0, 0.0, -1.0])
    )
    way = wrists - collar_at - rotation.rotate(collar, shoulder_way)
    distance = np.linalg.norm(way, axis=-1, keepdims=True)
    way = way / distance
    least = np.sqrt(upper_arm**2 + forearm**2 + 2.0 * upper_arm * forearm * np.cos(ELBOW_LIMIT))
    distance = _soft(distance, least, 0.992 * (upper_arm + forearm), 0.04 * (upper_arm + forearm))
    along = (upper_arm**2 - forearm**2 + distance**2) / (2.0 * distance)
    off = np.sqrt(np.maximum(upper_arm**2 - along**2, 0.0))
    hint = _HINT - np.sum(way * _HINT, axis=-1, keepdims=True) * way
    elbow = along * way + off * hint / np.linalg.norm(hint, axis=-1, keepdims=True)
    upper, fore = elbow / upper_arm, (distance * way - elbow) / forearm
    hinge = np.cross(upper, fore)
    bend = np.arctan2(np.linalg.norm(hinge, axis=-1), np.sum(upper * fore, axis=-1))
    hinge /= np.linalg.norm(hinge, axis=-1, keepdims=True)
    return Arm(collar, _bone_rotation(upper, hinge), _bone_rotation(fore, hinge), way, bend)


def _bone_rotation(bone: Float, hinge: Float) -> Float:
    """Rotations (..., 4) that take the right arm's rest bone -X to ``bone`` and the elbow's axis +Y to ``hinge``."""
    return rotation.from_matrix(np.stack([-bone, hinge, np.cross(-bone, hinge)], axis=-1))


def turn_of(wrists: ArrayLike, hand_rotations: ArrayLike, who: Signer) -> Float:
    """The ``turn`` numbers (..., 3) of right hands at places (..., 3) with rotations (..., 4) in the chest's axes."""
    return rotation.log(rotation.multiply(rotation.inverse(reach(wrists, who).fore), hand_rotations))


def hand_rotations(states: Float, who: Signer) -> Float:
    """Rotations (..., 2, 4) of both hands in the chest's axes, as right hands, as the numbers ask (limits apart)."""
    parts = hands(states)
    return rotation.multiply(reach(parts[..., WRIST], who).fore, rotation.exp(parts[..., TURN]))


@dataclass(frozen=True)
class Wrist:
    """How a hand sits on its forearm: the elbow's swivel, the forearm's turn, the wrist's deviation and flexion
    (...), radians, before limits.
    """

    swivel: Float
    turn: Float
    deviation: Float
    flexion: Float


def wrist_angles(arm: Arm, turns: Float, who: Signer) -> Wrist:
    """The angles with which arms carry hands of ``turns`` (..., 3): the elbow goes where they are most at ease.

    Each swivel of a row is weighed by exp(-sharpness * cost), cost the sum of squared angles over what is easy; their
    mean is smooth in the pose, where the best one alone would jump.
    """
    about = rotation.rotate(rotation.inverse(arm.fore), arm.direction)[..., None, :]
    asked = rotation.exp(turns)[..., None, :]
    usual = -np.deg2rad(who.elbow_deg)
    relative = rotation.multiply(rotation.exp(-_SWIVELS[:, None] * about), asked)
    turn, deviation, flexion = _split(relative)
    angles = np.stack([turn, deviation, flexion, np.broadcast_to(_SWIVELS - usual, turn.shape)], axis=-1)
    cost = np.square(angles / _EASE).sum(axis=-1)
    weight = np.exp(-_SHARPNESS * (cost - cost.min(axis=-1, keepdims=True)))
    swivel = (weight * _SWIVELS).sum(axis=-1) / weight.sum(axis=-1)
    chosen = rotation.multiply(rotation.exp(-swivel[..., None] * about[..., 0, :]), asked[..., 0, :])
    return Wrist(swivel, *_split(chosen))


def _split(q: Float) -> tuple[Float, Float, Float]:
    """Twist about X, then deviation and flexion of what is left, of hands seen from their forearms."""
    q = q * np.where(q[..., 3:] < 0.0, -1.0, 1.0)
    twist = 2.0 * np.arctan2(q[..., 0], q[..., 3])
    swing = rotation.log(rotation.multiply(rotation.exp(-twist[..., None] * _X), q))
    return twist, swing[..., 1], swing[..., 2]


def clip(states: Float, who: Signer, fps: float, name: str = "") -> Clip:
    """The motion of states (T, 63) as a clip on the signer's skeleton."""
    return Clip(skeleton(who), *rotations(states, who), fps, name)


def rotations(states: Float, who: Signer) -> tuple[Float, Float]:
    """Local rotations (T, 53, 4) and root places (T, 3) of states (T, 63)."""
    n_frames = len(states)
    local = np.zeros((n_frames, len(JOINTS), 4))
    local[..., 3] = 1.0
    for name in ("Spine", "Spine1", "Spine2"):
        local[:, JOINTS[name]] = rotation.exp(states[:, TRUNK] / 3.0)
    for name, share in (("Neck", 0.4), ("Head", 0.6)):
        local[:, JOINTS[name]] = rotation.exp(share * states[:, HEAD])
    way = states[:, ROOT] * (np.array([-1.0, 1.0, 1.0]) if who.left_handed else 1.0)
    _stand(local, way)
    parts = hands(states)
    arm = reach(parts[..., WRIST], who)
    wrist = wrist_angles(arm, parts[..., TURN], who)
    swivel = rotation.exp(wrist.swivel[..., None] * arm.direction)
    upper, fore = (rotation.multiply(swivel, q) for q in (arm.upper, arm.fore))
    half_turn = rotation.exp(0.5 * _soft(wrist.turn, -FOREARM_LIMIT, FOREARM_LIMIT, 0.15)[..., None] * _X)
    (low_side, high_side), (low_bent, high_bent) = WRIST_LIMITS
    bent = [_soft(wrist.deviation, low_side, high_side, 0.15), _soft(wrist.flexion, low_bent, high_bent, 0.15)]
    swing = rotation.exp(np.stack([np.zeros_like(bent[0]), *bent], axis=-1))
    chain = {
        "Shoulder": arm.collar,
        "Arm": rotation.multiply(rotation.inverse(arm.collar), upper),
        "ForeArm": rotation.multiply(rotation.multiply(rotation.inverse(upper), fore), half_turn),
        "Hand": rotation.multiply(half_turn, swing),
    }
    fingers = hand.rotations(parts[..., FINGERS])
    sides = ("Left", "Right") if who.left_handed else ("Right", "Left")
    for n, side in enumerate(sides):
        mirror = np.array([1.0, -1.0, -1.0, 1.0]) if side == "Left" else 1.0
        for name, q in chain.items():
            local[:, JOINTS[side + name]] = q[:, n] * mirror
        first = JOINTS[f"{side}HandThumb1"]
        local[:, first : first + 15] = fingers[:, n] * mirror
    root = way * who.scale + skeleton(who).offsets[0]
    if who.left_handed:  # trunk and head, as the sway above, are written for a right-handed signer
        middle = [JOINTS[name] for name in ("Spine", "Spine1", "Spine2", "Neck", "Head")]
        local[:, middle] *= np.array([1.0, -1.0, -1.0, 1.0])
    return local, root


def _stand(local: Float, root: Float) -> None:
    """Legs that lean with the hips' way, so that the feet stay where they are."""
    leg = 81.0  # hip to ankle of the standard body, cm
    lean = np.stack([-root[:, 2], np.zeros(len(root)), root[:, 0]], axis=-1) / leg
    for side in ("Left", "Right"):
        local[:, JOINTS[f"{side}UpLeg"]] = rotation.exp(-lean)
        local[:, JOINTS[f"{side}Foot"]] = rotation.exp(lean)


def _smooth_step(x: Float) -> Float:
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 + x * (-15.0 + 6.0 * x)))


def _soft(x: ArrayLike, low: ArrayLike, high: ArrayLike, margin: float) -> Float:
    """``x`` kept between limits: untouched until ``margin`` from one, then ever slower towards it (C1, by tanh)."""
    x = np.asarray(x, np.float64)
    over, under = x - (np.asarray(high) - margin), (np.asarray(low) + margin) - x
    x = np.where(over > 0.0, np.asarray(high) - margin + margin * np.tanh(np.maximum(over, 0.0) / margin), x)
    return np.where(under > 0.0, np.asarray(low) + margin - margin * np.tanh(np.maximum(under, 0.0) / margin), x)
