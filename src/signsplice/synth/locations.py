"""Where a posture puts a hand: places on a signer's body and in space, parts of the hand, and the two brought together.

Everything is in the chest's axes of a right-handed signer, cm: X = -out, Y = up, Z = forward.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from signsplice.body import capsules
from signsplice.motion import rotation
from signsplice.motion.clip import Clip
from signsplice.motion.kinematics import forward, rest_positions
from signsplice.synth import hand, pose
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.phonology import ON_BASE, Posture, Vector
from signsplice.synth.signer import JOINTS, Signer, skeleton

Float = NDArray[np.float64]

# On the body: the joint, a point inside (shares of stature: out, up, forward) and the way out through the skin there.
_ON_BODY: dict[str, tuple[str, Vector, Vector]] = {
    "crown": ("Head", (0.0, 0.080, 0.000), (0.0, 1.0, 0.1)),
    "forehead": ("Head", (0.0, 0.080, 0.020), (0.0, 0.15, 1.0)),
    "temple": ("Head", (0.020, 0.068, 0.020), (0.85, 0.1, 0.55)),
    "eye": ("Head", (0.018, 0.050, 0.030), (0.25, 0.0, 1.0)),
    "ear": ("Head", (0.020, 0.048, 0.000), (1.0, 0.0, 0.1)),
    "nose": ("Head", (0.0, 0.041, 0.040), (0.0, 0.0, 1.0)),
    "cheek": ("Head", (0.015, 0.032, 0.020), (0.75, 0.0, 0.66)),
    "cheek-weak": ("Head", (-0.015, 0.032, 0.020), (-0.75, 0.0, 0.66)),
    "mouth": ("Head", (0.0, 0.017, 0.030), (0.0, 0.0, 1.0)),
    "mouth-corner": ("Head", (0.012, 0.017, 0.030), (0.35, 0.0, 0.94)),
    "chin": ("Head", (0.0, 0.000, 0.030), (0.0, -0.3, 0.95)),
    "chin-weak": ("Head", (-0.014, 0.003, 0.025), (-0.4, -0.2, 0.9)),
    "jaw": ("Head", (0.015, 0.012, 0.020), (0.9, -0.2, 0.4)),
    "under-chin": ("Head", (0.0, 0.004, 0.036), (0.0, -1.0, 0.25)),
    "throat": ("Neck", (0.0, 0.028, 0.000), (0.0, 0.0, 1.0)),
    "shoulder": ("RightArm", (-0.02, 0.0, 0.0), (0.1, 1.0, 0.25)),
    "shoulder-weak": ("LeftArm", (0.02, 0.0, 0.0), (-0.1, 0.9, 0.45)),
    "chest": ("Spine2", (0.0, 0.030, 0.0), (0.0, 0.0, 1.0)),
    "chest-strong": ("Spine2", (0.060, 0.030, 0.0), (0.2, 0.0, 1.0)),
    "heart": ("Spine2", (-0.050, 0.025, 0.0), (-0.15, 0.0, 1.0)),
    "belly": ("Spine", (0.0, 0.040, 0.0), (0.0, 0.0, 1.0)),
    "waist": ("Spine", (0.060, 0.010, 0.0), (0.5, 0.0, 0.85)),
    "waist-weak": ("Spine", (-0.060, 0.010, 0.0), (-0.5, 0.0, 0.85)),
}

# In space: out, up, forward of the chest joint in cm of the standard body.
_IN_SPACE: dict[str, Vector] = {
    "space": (10.0, 3.0, 25.0),
    "space-mid": (0.0, 3.0, 23.0),
    "space-in": (-9.0, 3.0, 24.0),
    "space-out": (20.0, 3.0, 24.0),
    "space-low": (11.0, -7.0, 25.0),
    "space-low-mid": (0.0, -8.0, 24.0),
    "space-high": (18.0, 14.0, 22.0),
    "space-high-out": (28.0, 22.0, 18.0),
    "space-far": (11.0, 7.0, 38.0),
    "face-space": (3.0, 25.0, 27.0),
    "side-space": (20.0, 26.0, 16.0),
    "above-head": (4.0, 46.0, 15.0),
}

# Parts of a hand: the joints and tips whose mean they are, the skin's distance from there (cm), and its way out of the
# hand (the hand's axes: fingers -X, palm -Y, thumb +Z) where the hand is the one that is touched.
_PARTS: dict[str, tuple[tuple[str, ...], float, Vector]] = {
    "palm": (("Wrist", "Index1", "Middle1", "Middle1", "Ring1"), 1.45, (0.0, -1.0, 0.0)),
    "back": (("Wrist", "Index1", "Middle1", "Middle1", "Ring1"), 1.45, (0.0, 1.0, 0.0)),
    "heel": (("Wrist", "Wrist", "Wrist", "Wrist", "Middle1"), 1.65, (0.7, -0.7, 0.0)),
    "wrist": (("Wrist",), 2.4, (0.0, -1.0, 0.0)),
    "radial": (("Index1",), 1.2, (0.0, 0.0, 1.0)),
    "ulnar": (("Pinky1", "Pinky1", "Wrist"), 1.25, (0.0, 0.0, -1.0)),
    "knuckles": (("Index1", "Middle1"), 1.2, (0.0, 1.0, 0.0)),
    "middles": (("Index2", "Middle2", "Ring2"), 1.05, (-1.0, 0.0, 0.0)),
    "thumb": (("ThumbTip",), 0.95, (-0.7, 0.0, 0.7)),
    "index": (("IndexTip",), 0.82, (-1.0, 0.0, 0.0)),
    "middle": (("MiddleTip",), 0.83, (-1.0, 0.0, 0.0)),
    "ring": (("RingTip",), 0.79, (-1.0, 0.0, 0.0)),
    "pinky": (("PinkyTip",), 0.70, (-1.0, 0.0, 0.0)),
    "tips": (("IndexTip", "MiddleTip"), 0.82, (-1.0, 0.0, 0.0)),
    "fingertips": (("IndexTip", "MiddleTip", "RingTip", "PinkyTip"), 0.8, (-1.0, 0.0, 0.0)),
    "pinch": (("IndexTip", "ThumbTip"), 0.88, (-1.0, 0.0, 0.0)),
    "index-side": (("Index2", "Index3"), 1.0, (0.0, 0.0, 1.0)),
    "pinky-side": (("Pinky1", "Pinky2"), 0.9, (0.0, 0.0, -1.0)),
}
_INDEX = {"Wrist": -1} | {name: n for n, name in enumerate(hand.POINTS)}

# On the weak hand: the part that is touched; fingers and back of the wrist have parts of their own.
_ON_BASE: dict[str, tuple[tuple[str, ...], float, Vector]] = {
    "base-palm": _PARTS["palm"],
    "base-back": _PARTS["back"],
    "base-radial": _PARTS["radial"],
    "base-ulnar": _PARTS["ulnar"],
    "base-fingertips": _PARTS["fingertips"],
    "base-index": _PARTS["index"],
    "base-fingers": (("Index2", "Middle2", "Ring2"), 0.95, (0.0, -1.0, 0.0)),
    "base-fingers-back": (("Index2", "Middle2", "Ring2"), 0.95, (0.0, 1.0, 0.0)),
    "base-wrist": (("Wrist",), 2.4, (0.0, 1.0, 0.0)),
    "base-heel": _PARTS["heel"],
}


@dataclass(frozen=True)
class Location:
    """A point (3,) in the chest's axes, cm, and the unit way out of the body there; in space there is none (zeros)."""

    point: Float
    out: Float


@cache
def body_locations(who: Signer) -> dict[str, Location]:
    """Every place on the body (weak arm apart) of a right-handed signer, its point on the skin found by a ray from
    outside.
    """
    rest = rest_positions(skeleton(who))
    chest = rest[JOINTS["Spine2"]]
    height = 1.70 * who.scale * 100.0
    names, origins, ways = list(_ON_BODY), [], []
    for joint, inside, out in _ON_BODY.values():
        origins.append(rest[JOINTS[joint]] + height * axes(inside))
        ways.append(axes(out) / np.linalg.norm(out))
    skin = _skin(np.array(origins), np.array(ways), who)
    return {name: Location(at - chest, way) for name, at, way in zip(names, skin, ways, strict=True)}


def _skin(origins: Float, ways: Float, who: Signer) -> Float:
    """Where rays from inside leave head and trunk for good (n, 3), by marching in from outside."""
    body = capsules.body_capsules(skeleton(who))
    wanted = [n for n, part in enumerate(body.parts) if part in ("face", "hair", "nose", "neck", "shirt")]
    rest = rest_positions(skeleton(who))
    starts = (rest[body.joints] + body.starts)[wanted]
    ways_in = (rest[body.joints] + body.ends)[wanted] - starts
    radii = body.radii[wanted]
    points = origins + 30.0 * who.scale * ways
    for _ in range(60):
        from_start = points[:, None] - starts
        t = np.clip(
            np.einsum("nkc,kc->nk", from_start, ways_in) / (np.einsum("kc,kc->k", ways_in, ways_in) + 1e-12), 0.0, 1.0
        )
        gap = np.linalg.norm(from_start - t[..., None] * ways_in, axis=-1) - (
            radii[:, 0] + t * (radii[:, 1] - radii[:, 0])
        )
        points = points - gap.min(axis=1)[:, None] * ways
    return np.asarray(points)


def axes(v: Vector | Float) -> Float:
    """Out, up, forward -> X, Y, Z of a right-handed signer."""
    return np.array([-v[0], v[1], v[2]])


def part_of(points: Float, names: tuple[str, ...]) -> Float:
    """The mean (..., 3) of some joints and tips of hands with ``hand.points`` (..., 20, 3)."""
    with_wrist = np.concatenate([points, np.zeros((*points.shape[:-2], 1, 3))], axis=-2)
    return np.asarray(with_wrist[..., [_INDEX[name] for name in names], :].mean(axis=-2))


def facing(palm: Vector, fingers: Vector) -> Float:
    """Rotation (4,) of a right hand whose fingers point along ``fingers`` and whose palm faces ``palm`` as nearly as
    that allows.
    """
    x = -axes(fingers)
    y = -axes(palm)
    y = y - (y @ x) * x
    y = y / np.linalg.norm(y)
    return rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1))


MIRROR = np.array([-1.0, 1.0, 1.0])


def strong(posture: Posture, who: Signer, weak: Float, meets: bool = False, size: float = 1.0) -> Float:
    """The strong hand's 27 numbers in a posture.

    weak: the weak hand's numbers at the time, for places on it. meets: the hands mirror one another, so that at a place
    on the midline they touch. size: of offsets in space.
    """
    return _numbers(*strong_at(posture, who, weak, meets, size), who)


def strong_at(
    posture: Posture, who: Signer, weak: Float, meets: bool = False, size: float = 1.0
) -> tuple[Float, Float, Float]:
    """The same as the wrist's place (3,), the hand's rotation (4,) and its angles."""
    place = _place(posture, who, weak)
    angles = HANDSHAPES[posture.shape].angles
    size = size * who.scale
    turned = facing(posture.palm, posture.fingers)
    skin = _PARTS[posture.part][1]
    unit = who.hands * who.scale
    part = rotation.rotate(turned, _part_in(posture.part, posture.shape)) * unit
    shift = axes(posture.shift) * size
    if place.out.any():
        target = place.point + (skin * unit + posture.off * who.scale) * place.out + shift
    elif meets and place.point[0] == 0.0:
        target = place.point + axes((skin * unit + posture.off * size, 0.0, 0.0)) + shift
    else:
        target = place.point + shift
    return target - part, turned, angles


@cache
def _part_in(part: str, shape: str) -> Float:
    """Where a part of the hand is in a handshape (3,), seen from the wrist of the standard hand."""
    return part_of(hand.points(HANDSHAPES[shape].angles), _PARTS[part][0])


def weak(posture: Posture, who: Signer, size: float = 1.0) -> Float:
    """The weak hand's 27 numbers in a posture of its own; ``in`` is towards the strong side for it."""
    return strong(posture, who, np.zeros(27), size=size)


def _numbers(wrist: Float, turned: Float, angles: Float, who: Signer) -> Float:
    return np.concatenate([wrist, pose.turn_of(wrist, turned, who), angles])


def _place(posture: Posture, who: Signer, weak_hand: Float) -> Location:
    name = posture.place
    if name in _IN_SPACE:
        return Location(axes(_IN_SPACE[name]) * who.scale, np.zeros(3))
    if name in _ON_BODY:
        return body_locations(who)[name]
    shoulder, elbow, wrist, turned = _weak_arm(weak_hand, who)
    if name in ON_BASE and name != "forearm-weak":
        names, skin, out = _ON_BASE[name]
        unit = who.hands * who.scale
        centre = wrist + rotation.rotate(turned, part_of(hand.points(weak_hand[pose.FINGERS]), names)) * unit
        way = rotation.rotate(turned, np.array(out) / np.linalg.norm(out))
        return Location((centre + skin * unit * way) * MIRROR, way * MIRROR)
    share, start, end, skin, outwards = {
        "forearm-weak": (0.5, elbow, wrist, 0.0205, (0.2, 0.9, 0.6)),
        "elbow-weak": (0.0, elbow, wrist, 0.025, (0.6, -0.3, 0.5)),
        "upper-arm-weak": (0.55, shoulder, elbow, 0.0275, (0.8, 0.0, 0.6)),
    }[name]
    along = (end - start) / np.linalg.norm(end - start)
    way = axes(outwards) - (axes(outwards) @ along) * along
    way = way / np.linalg.norm(way)
    point = start + share * (end - start) + skin * 170.0 * who.scale * way
    return Location(point * MIRROR, way * MIRROR)


def _weak_arm(numbers: Float, who: Signer) -> tuple[Float, Float, Float, Float]:
    """Shoulder, elbow, wrist (3,) and the hand's rotation (4,) of a weak arm, as a right arm."""
    return _known_weak_arm(numbers.tobytes(), who)


@lru_cache(maxsize=64)
def _known_weak_arm(content: bytes, who: Signer) -> tuple[Float, Float, Float, Float]:
    numbers = np.frombuffer(content)
    local, root = pose.rotations(np.concatenate([numbers, numbers, np.zeros(9)])[None], _right_handed(who))
    joints = [JOINTS[name] for name in ("Spine2", "RightArm", "RightForeArm", "RightHand")]
    turns, places = forward(Clip(skeleton(who), local, root, 30.0), joints)
    chest, shoulder, elbow, wrist = places[0]
    return shoulder - chest, elbow - chest, wrist - chest, rotation.from_matrix(turns[0, 3])


def _right_handed(who: Signer) -> Signer:
    return replace(who, left_handed=False) if who.left_handed else who
