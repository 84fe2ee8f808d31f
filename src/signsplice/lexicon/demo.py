"""A handful of words that signsplice makes itself, so that a first splice needs no other file.

Each word is a few key poses of the hands (place, orientation, handshape), after common descriptions of American signs,
joined by minimum-jerk reaches and solved by two-bone inverse kinematics. They begin and end with both arms hanging. No
signer has checked them: they show splicing, they do not teach signing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import rotation
from signsplice.motion.clip import Clip, EndSite, Skeleton

Float = NDArray[np.float64]

FPS = 30.0
_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")

# Joint centres in cm of a signer 1.70 m tall in T-pose, facing +Z, left +X; segment shares as in motion.stance.
_SHOULDER = np.array([18.0, 139.0, -1.0])
_UPPER_ARM, _FOREARM = 29.0, 25.0
_KNUCKLES = {  # from the wrist: out along the hand, down, forward
    "Thumb": (3.0, -1.2, 3.0),
    "Index": (9.2, 0.0, 2.9),
    "Middle": (9.4, 0.2, 0.7),
    "Ring": (8.8, 0.0, -1.4),
    "Pinky": (8.0, -0.4, -3.3),
}
_PHALANGES = {
    "Thumb": (4.2, 3.2, 2.6),
    "Index": (4.2, 2.5, 2.1),
    "Middle": (4.7, 2.9, 2.3),
    "Ring": (4.3, 2.7, 2.2),
    "Pinky": (3.4, 2.0, 1.9),
}
_THUMB_WAY = np.array([0.72, -0.28, 0.63])

# Flexion of the three joints of each finger in degrees, then the thumb: (towards the palm, across it, bend of its last
# joints).
_OPEN, _CURLED = (4.0, 4.0, 2.0), (82.0, 98.0, 62.0)
_HANDSHAPES: dict[str, tuple[tuple[tuple[float, float, float], ...], tuple[float, float, float]]] = {
    "rest": (((16.0, 22.0, 12.0), (20.0, 26.0, 14.0), (24.0, 30.0, 16.0), (27.0, 32.0, 18.0)), (18.0, 8.0, 14.0)),
    "flat": ((_OPEN,) * 4, (10.0, -22.0, 8.0)),
    "index": ((_OPEN, _CURLED, _CURLED, _CURLED), (38.0, 42.0, 38.0)),
}


@dataclass(frozen=True)
class _Hand:
    """A hand at one moment: wrist place (cm, for the right hand; x is to the signer's right), the ways that fingers and
    palm point, and the handshape.
    """

    place: tuple[float, float, float]
    fingers: tuple[float, float, float]
    palm: tuple[float, float, float]
    shape: str


@dataclass(frozen=True)
class _Key:
    """Both hands at a time (s); a left hand of None hangs."""

    seconds: float
    right: _Hand
    left: _Hand | None = None


_HANGING = _Hand((23.0, 87.0, 5.0), (0.05, -1.0, 0.15), (-1.0, 0.0, 0.1), "rest")


def _circle(centre: tuple[float, float, float], radius: float, phase: float, **hand: object) -> list[_Hand]:
    """A hand at eight places around a circle in the plane of up and forward, moving back over the top."""
    turns = phase - 2.0 * np.pi * np.arange(1, 9) / 8.0
    x, y, z = centre
    return [_Hand((x, y + radius * np.sin(t), z + radius * np.cos(t)), **hand) for t in turns]  # type: ignore[arg-type]


def _words() -> dict[str, list[_Key]]:
    forward, left = (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)
    sign_right = _circle(
        (12.0, 118.0, 32.0), 6.0, 0.0, fingers=(-0.75, 0.55, 0.35), palm=(0.0, -0.3, 1.0), shape="index"
    )
    sign_left = _circle(
        (12.0, 118.0, 32.0), 6.0, np.pi, fingers=(-0.75, 0.55, 0.35), palm=(0.0, -0.3, 1.0), shape="index"
    )
    return {
        "HELLO": [
            _Key(0.45, _Hand((16.0, 151.0, 16.0), (-0.55, 0.8, 0.1), (-0.2, -0.35, 0.9), "flat")),
            _Key(0.60, _Hand((16.5, 152.0, 17.0), (-0.5, 0.85, 0.1), (-0.1, -0.3, 0.95), "flat")),
            _Key(0.95, _Hand((31.0, 152.0, 27.0), (0.25, 0.95, 0.15), (0.0, -0.1, 1.0), "flat")),
            _Key(1.10, _Hand((31.5, 152.0, 27.5), (0.28, 0.95, 0.15), (0.0, -0.1, 1.0), "flat")),
        ],
        "I": [
            _Key(0.42, _Hand((12.0, 121.0, 30.0), (-0.75, 0.05, -0.65), left, "index")),
            _Key(0.62, _Hand((8.5, 121.5, 24.5), (-0.7, 0.05, -0.7), left, "index")),
            _Key(0.80, _Hand((8.5, 121.5, 24.5), (-0.7, 0.05, -0.7), left, "index")),
        ],
        "DEAF": [
            _Key(0.50, _Hand((19.0, 144.0, 17.5), (-0.6, 0.7, -0.4), forward, "index")),
            _Key(0.62, _Hand((19.0, 144.5, 17.0), (-0.6, 0.7, -0.4), forward, "index")),
            _Key(0.84, _Hand((16.0, 138.0, 23.0), (-0.72, 0.6, -0.35), (-0.2, -0.2, 0.95), "index")),
            _Key(1.02, _Hand((15.5, 137.5, 22.5), (-0.72, 0.6, -0.35), (-0.2, -0.2, 0.95), "index")),
        ],
        "SIGN": [
            _Key(0.45 + 0.115 * n, right, left_hand)
            for n, (right, left_hand) in enumerate(
                zip([*sign_right, *sign_right[:4]], [*sign_left, *sign_left[:4]], strict=True)
            )
        ],
        "THANK-YOU": [
            _Key(0.45, _Hand((10.0, 138.0, 23.5), (-0.45, 0.85, -0.3), (-0.35, 0.1, -0.95), "flat")),
            _Key(0.56, _Hand((9.8, 138.0, 23.0), (-0.45, 0.85, -0.3), (-0.35, 0.1, -0.95), "flat")),
            _Key(0.95, _Hand((11.5, 122.0, 42.0), (-0.15, 0.45, 0.88), (-0.1, 0.9, -0.45), "flat")),
            _Key(1.10, _Hand((11.5, 121.0, 42.5), (-0.15, 0.42, 0.9), (-0.1, 0.9, -0.42), "flat")),
        ],
    }


WORDS = tuple(_words())
SENTENCE = ("HELLO", "I", "DEAF", "I", "SIGN", "THANK-YOU")
"""What the demo splices: a row of words chosen for their variety of places and hands, not as a grammatical sentence."""


def skeleton() -> Skeleton:
    """The signer's 53 joints, named in the Mixamo manner, in cm, rest pose T."""
    rows: list[tuple[str, str, tuple[float, float, float] | Float]] = [
        ("Hips", "", (0.0, 92.0, 0.0)),
        ("Spine", "Hips", (0.0, 10.0, -1.0)),
        ("Spine1", "Spine", (0.0, 12.0, -0.5)),
        ("Spine2", "Spine1", (0.0, 13.0, 0.0)),
        ("Neck", "Spine2", (0.0, 16.0, 0.5)),
        ("Head", "Neck", (0.0, 9.0, 2.0)),
        ("HeadTop_End", "Head", (0.0, 18.0, 1.0)),
    ]
    tips: list[tuple[str, Float]] = []
    for side, x in (("Left", 1.0), ("Right", -1.0)):
        mirror = np.array([x, 1.0, 1.0])
        collar = np.array([5.0, 137.0, -0.5])
        rows += [
            (f"{side}Shoulder", "Spine2", (collar - [0.0, 127.0, -1.5]) * mirror),
            (f"{side}Arm", f"{side}Shoulder", (_SHOULDER - collar) * mirror),
            (f"{side}ForeArm", f"{side}Arm", (x * _UPPER_ARM, 0.0, 0.0)),
            (f"{side}Hand", f"{side}ForeArm", (x * _FOREARM, 0.0, 0.0)),
        ]
        for finger in _FINGERS:
            way = (_THUMB_WAY / np.linalg.norm(_THUMB_WAY) if finger == "Thumb" else np.array([1.0, 0.0, 0.0])) * mirror
            lengths = _PHALANGES[finger]
            rows.append((f"{side}Hand{finger}1", f"{side}Hand", np.array(_KNUCKLES[finger]) * mirror))
            rows += [(f"{side}Hand{finger}{n + 1}", f"{side}Hand{finger}{n}", way * lengths[n - 1]) for n in (1, 2)]
            tips.append((f"{side}Hand{finger}3", way * lengths[2]))
        rows += [
            (f"{side}UpLeg", "Hips", (x * 9.0, -4.0, 0.0)),
            (f"{side}Leg", f"{side}UpLeg", (0.0, -41.0, 0.5)),
            (f"{side}Foot", f"{side}Leg", (0.0, -40.0, -1.5)),
            (f"{side}ToeBase", f"{side}Foot", (x * 1.0, -6.0, 12.0)),
        ]
    ordered = _depth_first(rows)
    index = {name: n for n, (name, _, _) in enumerate(ordered)}
    return Skeleton(
        names=tuple(f"mixamorig:{name}" for name in index),
        parents=np.array([index.get(parent, -1) for _, parent, _ in ordered]),
        offsets=np.array([offset for _, _, offset in ordered], np.float64),
        end_sites=tuple(EndSite(index[name], offset) for name, offset in tips),
    )


def _depth_first(rows: list[tuple[str, str, tuple[float, float, float] | Float]]) -> list[tuple[str, str, object]]:
    ordered: list[tuple[str, str, object]] = []

    def visit(parent: str) -> None:
        for row in rows:
            if row[1] == parent:
                ordered.append(row)
                visit(row[0])

    visit("")
    return ordered


def word(gloss: str) -> Clip:
    """The clip of one of ``WORDS``: hanging arms, the sign, hanging arms; 30 fps. Raises ``KeyError`` for any other."""
    keys = _words()[gloss]
    lead, tail = 0.15, 0.55
    timed = [_Key(0.0, _HANGING), _Key(lead, _HANGING)]
    timed += [_Key(lead + key.seconds, key.right, key.left) for key in keys]
    end = timed[-1].seconds + tail
    timed += [_Key(end, _HANGING), _Key(end + 0.15, _HANGING)]
    times = np.arange(round((end + 0.15) * FPS) + 1) / FPS
    body = skeleton()
    index = {name.removeprefix("mixamorig:"): n for n, name in enumerate(body.names)}
    local = np.tile(rotation.IDENTITY, (len(times), len(body), 1))
    _breathe(local, index, times)
    for side in ("Right", "Left"):
        hands = [key.right if side == "Right" else key.left or _HANGING for key in timed]
        _pose_arm(local, index, side, *_course(np.array([key.seconds for key in timed]), hands, times))
    return Clip(body, local, np.tile(body.offsets[0], (len(times), 1)), FPS, gloss)


def _breathe(local: Float, index: dict[str, int], times: Float) -> None:
    """A slow rise of the chest, and the head with it."""
    swing = np.deg2rad(0.6) * np.sin(2.0 * np.pi * times / 3.2)[:, None]
    local[:, index["Spine1"]] = rotation.exp(swing * [-1.0, 0.0, 0.0])
    local[:, index["Head"]] = rotation.exp(swing * [1.6, 0.5, 0.0])


def _course(at: Float, hands: list[_Hand], times: Float) -> tuple[Float, Float, Float, Float]:
    """Wrist places (T, 3), hand rotations (T, 4), finger flexions (T, 4, 3) and thumb angles (T, 3), as of a right
    hand.
    """
    n = np.clip(np.searchsorted(at, times, side="right") - 1, 0, len(at) - 2)
    u = np.clip((times - at[n]) / (at[n + 1] - at[n]), 0.0, 1.0)
    eased = u**3 * (10.0 + u * (-15.0 + 6.0 * u))
    dense = np.diff(at)[n] < 0.13  # keys along a path are passed without a stop
    eased = np.where(dense, u, eased)
    early = np.minimum(1.0, 1.6 * u)  # a handshape forms before the hand arrives
    early = early**3 * (10.0 + early * (-15.0 + 6.0 * early))
    places = np.array([hand.place for hand in hands]) * [-1.0, 1.0, 1.0]
    turns = np.array([_hand_rotation(hand) for hand in hands])
    flexions = np.deg2rad([_HANDSHAPES[hand.shape][0] for hand in hands])
    thumbs = np.deg2rad([_HANDSHAPES[hand.shape][1] for hand in hands])

    def mix(values: Float, share: Float) -> Float:
        w = share.reshape(-1, *([1] * (values.ndim - 1)))
        return np.asarray((1.0 - w) * values[n] + w * values[n + 1])

    return mix(places, eased), rotation.slerp(turns[n], turns[n + 1], eased), mix(flexions, early), mix(thumbs, early)


def _hand_rotation(hand: _Hand) -> Float:
    """Global rotation (4,) of the right hand: fingers from -X, palm from -Y, to where they are to point."""
    fingers = np.array(hand.fingers) * [-1.0, 1.0, 1.0]
    palm = np.array(hand.palm) * [-1.0, 1.0, 1.0]
    x = -fingers / np.linalg.norm(fingers)
    y = -(palm - (palm @ x) * x)
    y = y / np.linalg.norm(y)
    return rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1))


def _mirrored(q: Float) -> Float:
    """Rotations seen in the mirror plane x = 0."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, 1.0]))


def _pose_arm(
    local: Float, index: dict[str, int], side: str, places: Float, turns: Float, flexions: Float, thumbs: Float
) -> None:
    """Write one arm's rotations, solved as a right arm and mirrored for the left."""
    chest = local[:, index["Spine1"]]
    shoulder = _SHOULDER * [-1.0, 1.0, 1.0]
    reach = places - shoulder
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    reach = reach * np.minimum(1.0, 0.995 * (_UPPER_ARM + _FOREARM) / distance)
    distance = np.minimum(distance, 0.995 * (_UPPER_ARM + _FOREARM))
    along = (_UPPER_ARM**2 - _FOREARM**2 + distance**2) / (2.0 * distance)
    off = np.sqrt(np.maximum(_UPPER_ARM**2 - along**2, 0.0))
    way = reach / distance
    hint = np.array([-0.55, -1.0, -0.35])  # elbows hang down, out and a little back
    hint = hint - np.sum(way * hint, axis=-1, keepdims=True) * way
    elbow = along * way + off * hint / np.linalg.norm(hint, axis=-1, keepdims=True)
    upper, fore = elbow / _UPPER_ARM, (reach - elbow) / _FOREARM
    hinge = np.cross(upper, fore)
    hinge /= np.linalg.norm(hinge, axis=-1, keepdims=True)
    upper_turn, fore_turn = (_bone_rotation(bone, hinge) for bone in (upper, fore))
    # Half of the wrist's twist is the forearm's, as pronation is.
    twist = rotation.twist_angle(rotation.multiply(rotation.inverse(fore_turn), turns), np.array([1.0, 0.0, 0.0]))
    fore_turn = rotation.multiply(fore_turn, rotation.exp(0.5 * np.unwrap(twist)[:, None] * [1.0, 0.0, 0.0]))
    pose = {
        "Arm": rotation.multiply(rotation.inverse(_mirrored(chest) if side == "Left" else chest), upper_turn),
        "ForeArm": rotation.multiply(rotation.inverse(upper_turn), fore_turn),
        "Hand": rotation.multiply(rotation.inverse(fore_turn), turns),
    }
    for f, finger in enumerate(_FINGERS[1:]):
        for n in range(3):
            pose[f"Hand{finger}{n + 1}"] = rotation.exp(flexions[:, f, n, None] * [0.0, 0.0, 1.0])
    fold, across, bend = thumbs.T[..., None]
    pose["HandThumb1"] = rotation.exp(fold * [0.0, 0.0, 0.8] + across * [0.0, -1.0, 0.0])
    for n in (2, 3):
        pose[f"HandThumb{n}"] = rotation.exp(bend * [0.15, -0.75, 0.65])
    for name, q in pose.items():
        local[:, index[side + name]] = _mirrored(q) if side == "Left" else q


def _bone_rotation(bone: Float, hinge: Float) -> Float:
    """Global rotations (T, 4) that take the right arm's rest bone -X to ``bone`` and the elbow's axis +Y to
    ``hinge``.
    """
    return rotation.from_matrix(np.stack([-bone, hinge, np.cross(-bone, hinge)], axis=-1))
