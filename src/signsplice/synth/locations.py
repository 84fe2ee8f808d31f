"""Hand states for postures: where locations on a signer's body and in space are, and a part of the hand put there.

All positions are in the chest's axes of a right-handed signer, cm: X = -out, Y = up, Z = forward.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from signsplice.body import capsules
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.cache import CACHE
from signsplice.motion.clip import Clip
from signsplice.motion.kinematics import forward, rest_positions
from signsplice.synth import hand, pose
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.phonology import Posture, Vector
from signsplice.synth.signer import JOINTS, Signer, skeleton

# On the body: a joint; a point inside the body, seen from it (out, up, forward, fractions of stature); the direction
# from there out through the skin.
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

ON_HEAD = frozenset(name for name, (joint, _, _) in _ON_BODY.items() if joint == "Head")

# In space: out, up and forward from the chest joint, cm of the standard body.
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
    "locus:1": (8.0, 3.0, 17.0),
    "locus:2": (8.0, 3.0, 36.0),
    "locus:3": (28.0, 3.0, 29.0),
    "locus:3-weak": (-14.0, 3.0, 29.0),
}
_IN_SPACE |= {"subject": _IN_SPACE["locus:1"], "object": _IN_SPACE["locus:2"]}

# Parts of a hand: the joints and tips whose mean position they are; the distance of the skin from there, cm; the
# direction out of the hand (in its axes: fingers -X, palm -Y, thumb +Z), for a hand that is touched.
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
    "two-fingers": (("Index1", "Index2", "Middle1", "Middle2"), 1.0, (0.0, -1.0, 0.0)),
    "pinky-side": (("Pinky1", "Pinky2"), 0.9, (0.0, 0.0, -1.0)),
}
_INDEX = {"Wrist": -1} | {name: n for n, name in enumerate(hand.POINTS)}

# On the weak hand: the part that is touched.
_ON_BASE: dict[str, tuple[tuple[str, ...], float, Vector]] = {
    "base-palm": _PARTS["palm"],
    "base-back": _PARTS["back"],
    "base-radial": _PARTS["radial"],
    "base-ulnar": _PARTS["ulnar"],
    "base-fingertips": _PARTS["fingertips"],
    "base-index": _PARTS["index"],
    "base-index-back": (("Index2", "Index3"), 0.9, (0.0, 1.0, 0.0)),
    "base-two-fingers": (("Index3", "Middle3"), 0.85, (0.0, 1.0, 0.0)),
    "base-fingers": (("Index2", "Middle2", "Ring2"), 0.95, (0.0, -1.0, 0.0)),
    "base-fingers-back": (("Index2", "Middle2", "Ring2"), 0.95, (0.0, 1.0, 0.0)),
    "base-wrist": (("Wrist",), 2.4, (0.0, 1.0, 0.0)),
    "base-heel": _PARTS["heel"],
}

# On the weak arm: the bone; where along it, as a fraction; the distance of the skin, as a fraction of stature, and its
# direction (out, up, forward).
_ON_WEAK_ARM: dict[str, tuple[str, float, float, Vector]] = {
    "forearm-weak": ("forearm", 0.5, 0.0205, (0.2, 0.9, 0.6)),
    "elbow-weak": ("forearm", 0.0, 0.025, (0.6, -0.3, 0.5)),
    "upper-arm-weak": ("upper arm", 0.55, 0.0275, (0.8, 0.0, 0.6)),
}

MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Location:
    """A point that a hand can be brought to.

    point: position (3,) in the chest's axes, cm
    normal: unit vector (3,) out of the body there; zeros in space
    """

    point: FloatArray
    normal: FloatArray


@dataclass(frozen=True, eq=False)
class WeakArm:
    """A signer's weak arm, which the strong hand may touch. Its joints are solved when first asked for.

    signer: whose arm it is
    hand: the weak hand's state (27,)
    """

    signer: Signer
    hand: FloatArray

    @cached_property
    def joints(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Positions (3,) of shoulder, elbow and wrist and the hand's rotation (4,), as of a right arm."""
        signer = replace(self.signer, left_handed=False)
        local_quats, roots = pose.rotations(np.concatenate([self.hand, self.hand, np.zeros(9)])[None], signer)
        names = ("Spine2", "RightArm", "RightForeArm", "RightHand")
        clip = Clip(skeleton(signer), local_quats, roots, 30.0)
        rotations, positions = forward(clip, [JOINTS[name] for name in names])
        chest, shoulder, elbow, wrist = positions[0]
        return shoulder - chest, elbow - chest, wrist - chest, rotation.from_matrix(rotations[0, 3])


def body_locations(signer: Signer) -> dict[str, Location]:
    """Every location on a right-handed signer's body (weak arm apart), its point on the skin, found by a ray. Those of
    the last 64 signers are kept.
    """
    return CACHE.recent(_body_locations, signer, most=64)


def _body_locations(signer: Signer) -> dict[str, Location]:
    rest = rest_positions(skeleton(signer))
    chest = rest[JOINTS["Spine2"]]
    height = 1.70 * signer.scale * 100.0
    origins, normals = [], []
    for joint, inside, out in _ON_BODY.values():
        origins.append(rest[JOINTS[joint]] + height * axes(inside))
        normals.append(axes(out) / np.linalg.norm(out))
    skin = _skin(np.array(origins), np.array(normals), signer)
    return {name: Location(point - chest, normal) for name, point, normal in zip(_ON_BODY, skin, normals, strict=True)}


def _skin(origins: FloatArray, directions: FloatArray, signer: Signer) -> FloatArray:
    """Points (N, 3) where rays from inside leave head and trunk for good, by sphere tracing from outside."""
    body = capsules.body_capsules(skeleton(signer))
    wanted = [n for n, part in enumerate(body.parts) if part in ("face", "hair", "nose", "neck", "shirt")]
    rest = rest_positions(skeleton(signer))
    starts = (rest[body.joints] + body.starts)[wanted]  # (K, 3)
    spans = (rest[body.joints] + body.ends)[wanted] - starts
    radii = body.radii[wanted]  # (K, 2)
    points = origins + 30.0 * signer.scale * directions
    for _ in range(60):
        from_start = points[:, None] - starts  # (N, K, 3)
        t = np.einsum("nkc,kc->nk", from_start, spans) / (np.einsum("kc,kc->k", spans, spans) + 1e-12)
        t = np.clip(t, 0.0, 1.0)
        radius = radii[:, 0] + t * (radii[:, 1] - radii[:, 0])
        clearance = np.linalg.norm(from_start - t[..., None] * spans, axis=-1) - radius
        points = points - clearance.min(axis=1)[:, None] * directions
    return np.asarray(points)


def axes(v: Vector | FloatArray) -> FloatArray:
    """A vector (out, up, forward) in the chest's axes X, Y, Z of a right-handed signer."""
    return np.array([-v[0], v[1], v[2]])


def part_of(points: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """The mean position (..., 3) of some joints and tips of hands with ``hand.points`` (..., 20, 3)."""
    with_wrist = np.concatenate([points, np.zeros((*points.shape[:-2], 1, 3))], axis=-2)
    return np.asarray(with_wrist[..., [_INDEX[name] for name in names], :].mean(axis=-2))


def facing(palm: Vector, fingers: Vector) -> FloatArray:
    """Rotation (4,) of a right hand whose fingers point along ``fingers`` and whose palm faces ``palm`` as nearly as
    that allows.
    """
    x = -axes(fingers)
    y = -axes(palm)
    y = y - (y @ x) * x
    y = y / np.linalg.norm(y)
    return rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1))


def strong_hand(posture: Posture, weak: WeakArm, meets: bool = False, size: float = 1.0) -> FloatArray:
    """The strong hand's state (27,) in a posture, for the signer of the weak arm.

    weak: the weak arm at the time, for locations on it
    meets: whether the hands mirror one another, so that they touch at a location on the midline
    size: factor on offsets in space
    """
    wrist, quat, angles = strong_wrist(posture, weak, meets, size)
    return np.concatenate([wrist, pose.hand_rotvecs(wrist, quat, weak.signer), angles])


def strong_wrist(
    posture: Posture, weak: WeakArm, meets: bool = False, size: float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same as the wrist's position (3,), the hand's rotation (4,) and its angles (21,)."""
    signer = weak.signer
    location = locate(posture.location, weak)
    shape = HANDSHAPES[posture.shape]
    size = size * signer.scale
    quat = facing(posture.palm, posture.fingers)
    names, skin, _ = _PARTS[posture.part]
    unit = signer.hands * signer.scale
    part = rotation.rotate(quat, part_of(shape.points, names)) * unit
    shift = axes(posture.shift) * size
    if location.normal.any():
        target = location.point + (skin * unit + posture.off * signer.scale) * location.normal + shift
    elif meets and location.point[0] == 0.0:
        target = location.point + axes((skin * unit + posture.off * size, 0.0, 0.0)) + shift
    else:
        target = location.point + shift
    return target - part, quat, shape.angles


def weak_hand(posture: Posture, signer: Signer, size: float = 1.0) -> FloatArray:
    """The weak hand's state (27,) in a posture of its own; ``in`` is towards the strong side for it."""
    return strong_hand(posture, WeakArm(signer, np.zeros(27)), size=size)


_LIFTED_IN_SPACE = (0.0, 0.7, -0.7)


def lifted(posture: Posture, weak: WeakArm) -> FloatArray:
    """The unit vector (3,) along which a hand is lifted on its way back to a posture: away from the surface that it is
    at; in space up and towards the signer.
    """
    normal = locate(posture.location, weak).normal
    direction = normal if normal.any() else axes(_LIFTED_IN_SPACE)
    return np.asarray(direction / np.linalg.norm(direction))


def locate(name: str, weak: WeakArm) -> Location:
    """A location, by its name in ``LOCATIONS``, of the signer of the weak arm."""
    signer = weak.signer
    if name in _IN_SPACE:
        return Location(axes(_IN_SPACE[name]) * signer.scale, np.zeros(3))
    if name in _ON_BODY:
        return body_locations(signer)[name]
    shoulder, elbow, wrist, quat = weak.joints
    if name in _ON_BASE:
        names, skin, out = _ON_BASE[name]
        unit = signer.hands * signer.scale
        centre = wrist + rotation.rotate(quat, part_of(hand.points(weak.hand[pose.FINGERS]), names)) * unit
        normal = rotation.rotate(quat, np.array(out) / np.linalg.norm(out))
        return Location((centre + skin * unit * normal) * MIRROR, normal * MIRROR)
    bone, fraction, skin, out = _ON_WEAK_ARM[name]
    start, end = (elbow, wrist) if bone == "forearm" else (shoulder, elbow)
    along = (end - start) / np.linalg.norm(end - start)
    normal = axes(out) - (axes(out) @ along) * along
    normal = normal / np.linalg.norm(normal)
    point = start + fraction * (end - start) + skin * 170.0 * signer.scale * normal
    return Location(point * MIRROR, normal * MIRROR)
