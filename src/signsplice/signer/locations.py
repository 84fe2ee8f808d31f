"""Hand states for postures: finds locations on a signer's body and in space, puts a part of the hand there, and places
hands at rest between signs.

All positions are in the chest's axes of a right-handed signer, cm: X = -out, Y = up, Z = forward.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from signsplice.body import capsules
from signsplice.motion import Clip, FloatArray, rotation
from signsplice.motion.cache import CACHE
from signsplice.motion.kinematics import forward, rest_positions
from signsplice.signer import hand, pose
from signsplice.signer.collisions import clear_of_shoulder, hand_clearances, in_contact
from signsplice.signer.hand import HandPart, hand_part
from signsplice.signer.handshapes import HANDSHAPES, handshape
from signsplice.signer.phonology import ON_ARM, PLACES, REST, Posture, on_arm
from signsplice.signer.pose import MIRROR
from signsplice.signer.signer import HANGING, JOINTS, Signer, skeleton, stream
from signsplice.signer.tables import Vector, vector

# words/places.txt describes each table.
_ON_BODY = {name: (joint, vector(inside), vector(normal)) for name, joint, inside, normal in PLACES["body"]}
ON_HEAD = frozenset(name for name, (joint, _, _) in _ON_BODY.items() if joint == "Head")
_IN_SPACE = {name: vector(point) for name, point in PLACES["space"]}
_ON_BASE = {
    name: HandPart(tuple(row[0].split(",")), float(row[1]), vector(row[2])) if len(row) > 1 else hand_part(row[0])
    for name, *row in PLACES["base"]
}
_ON_WEAK_ARM = {
    name: (bone, float(fraction), float(skin), vector(normal)) for name, bone, fraction, skin, normal in PLACES["arm"]
}

_TOUCH_ROUNDS = 3
"""How often a hand that is written on the skin is moved there."""


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
    """A signer's weak arm, which the strong hand may touch. Its joints are solved on first use.

    signer: owner of the arm
    hand: the weak hand's state (27,)
    """

    signer: Signer
    hand: FloatArray

    @cached_property
    def joints(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Positions (3,) of shoulder, elbow and wrist and the hand's rotation (4,), as of a right arm."""
        signer = replace(self.signer, left_handed=False)
        local_quats, roots = pose.rotations(pose.of_hands(self.hand, self.hand)[None], signer)
        names = ("Spine2", "RightArm", "RightForeArm", "RightHand")
        clip = Clip(skeleton(signer), local_quats, roots, 30.0)
        rotations, positions = forward(clip, [JOINTS[name] for name in names])
        chest, shoulder, elbow, wrist = positions[0]
        return shoulder - chest, elbow - chest, wrist - chest, rotation.from_matrix(rotations[0, 3])


def body_locations(signer: Signer) -> dict[str, Location]:
    """Every location on a right-handed signer's body except the weak arm, with its point on the skin, found by a ray.
    The cache keeps the last 64 signers.
    """
    return CACHE.recent(_body_locations, signer, most=64)


def on_joint(location: str, which: int) -> str:
    """The joint that carries a location on head or trunk for the strong (0) or weak (1) hand; the first of two."""
    name = location.partition("/")[0].partition(":")[0]
    joint = _ON_BODY[name if name in _ON_BODY else name.removesuffix("-weak")][0]
    return ("RightShoulder", "LeftShoulder")[(joint == "LeftArm") != which] if joint.endswith("Arm") else joint


def _body_locations(signer: Signer) -> dict[str, Location]:
    rest = rest_positions(skeleton(signer))
    chest = rest[JOINTS["Spine2"]]
    height = 1.70 * signer.scale * 100.0
    origins = [rest[JOINTS[joint]] + height * axes(inside) for joint, inside, _ in _ON_BODY.values()]
    normals = [axes(outward) / np.linalg.norm(outward) for _, _, outward in _ON_BODY.values()]
    skin = _skin(np.array(origins), np.array(normals), signer)
    return {name: Location(point - chest, normal) for name, point, normal in zip(_ON_BODY, skin, normals, strict=True)}


_LIFT_CM = 1.5
"""How far a composed location is lifted before it is moved to the skin, cm."""
_BESIDE_CM = 4.0
"""Largest distance of a composed location from the skin that its ray meets, cm."""


def _on_body(text: str, signer: Signer) -> Location:
    """A composed location on the body: ``A/B`` halfway between two, ``NAME:OUT,UP`` so many cm beside one,
    ``NAME-weak`` on the other side; its point is the skin's nearest.
    """
    named, (solid, chest) = body_locations(signer), _head_and_trunk(signer)
    ends = []
    for part_name in text.split("/"):
        name, _, offset = part_name.partition(":")
        place = named[name] if name in named else named[name.removesuffix("-weak")]
        mirror = np.ones(3) if name in named else MIRROR
        sideways = axes((*map(float, offset.split(",")), 0.0)) if offset else np.zeros(3)  # type: ignore[arg-type]
        ends.append((mirror * place.point + sideways * signer.scale, mirror * place.normal))
    point, normal = np.mean(ends, axis=0)
    point, normal = point + chest, normal / np.linalg.norm(normal)
    ahead = _skin(point[None], normal[None], signer)[0]
    passes_by = float(np.linalg.norm(ahead - point)) > _BESIDE_CM * signer.scale  # or the ray hits a part behind
    point = point + _LIFT_CM * signer.scale * normal if passes_by else ahead
    for _ in range(12):
        outward, gaps = (x[0] for x in _outward(point[None], *solid))
        nearest = int(gaps.argmin())
        normal = outward[nearest] / np.linalg.norm(outward[nearest])
        point = point - gaps[nearest] * normal
    return Location(point - chest, normal)


_Solid = tuple[FloatArray, FloatArray, FloatArray]


def _head_and_trunk(signer: Signer) -> tuple[_Solid, FloatArray]:
    """The capsules of head and trunk at rest: starts and spans (K, 3) of their axes, radii (K, 2); and the chest's
    position (3,).
    """
    body = capsules.body_capsules(skeleton(signer))
    rows = [n for n, part in enumerate(body.parts) if part in ("face", "hair", "nose", "neck", "shirt")]
    rest = rest_positions(skeleton(signer))
    starts = (rest[body.joints] + body.starts)[rows]
    spans = (rest[body.joints] + body.ends)[rows] - starts
    return (starts, spans, body.radii[rows]), rest[JOINTS["Spine2"]]


def _skin(origins: FloatArray, directions: FloatArray, signer: Signer) -> FloatArray:
    """Last exit points (N, 3) of rays from inside head and trunk, by sphere tracing from outside."""
    solid, _ = _head_and_trunk(signer)
    points = origins + 30.0 * signer.scale * directions
    for _ in range(60):
        _, clearance = _outward(points, *solid)
        points = points - clearance.min(axis=1)[:, None] * directions
    return np.asarray(points)


def _outward(
    points: FloatArray, starts: FloatArray, spans: FloatArray, radii: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Vectors (N, K, 3) from capsules' axes to points (N, 3), and distances (N, K) from the capsules' skin."""
    from_start = points[:, None] - starts  # (N, K, 3)
    t = np.einsum("nkc,kc->nk", from_start, spans) / (np.einsum("kc,kc->k", spans, spans) + 1e-12)
    t = np.clip(t, 0.0, 1.0)
    radius = radii[:, 0] + t * (radii[:, 1] - radii[:, 0])
    offsets = from_start - t[..., None] * spans
    return offsets, np.linalg.norm(offsets, axis=-1) - radius


def axes(v: Vector | FloatArray) -> FloatArray:
    """A vector (out, up, forward) in the chest's axes X, Y, Z of a right-handed signer."""
    return np.array([-v[0], v[1], v[2]])


def facing(palm: Vector, fingers: Vector) -> FloatArray:
    """Rotation (4,) of a right hand with fingers along ``fingers`` and the palm facing ``palm`` as far as they allow;
    read-only.
    """
    return CACHE.recent(_facing, palm, fingers, most=2048)


def _facing(palm: Vector, fingers: Vector) -> FloatArray:
    """``facing``."""
    x = -axes(fingers)
    y = -axes(palm)
    y = y - (y @ x) * x
    y = y / np.linalg.norm(y)
    quat = rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1))
    quat.flags.writeable = False
    return quat


def strong_hand(posture: Posture, weak: WeakArm, meets: bool = False, size: float = 1.0) -> FloatArray:
    """The strong hand's state (27,) in a posture, for the signer of the weak arm.

    weak: the weak arm at the time, for locations on it
    meets: whether the hands mirror one another, so that they touch at a location on the midline
    size: factor on offsets in space
    """
    wrist, quat, angles = strong_wrist(posture, weak, meets, size)
    signer, normal = weak.signer, locate(posture.location, weak).normal
    hand_state = np.concatenate([wrist, pose.hand_rotvecs(wrist, quat, signer), angles])
    if posture.touch:
        part = rotation.rotate(quat, hand_part(posture.part).centre(handshape(posture.shape).points))
        wrist, quat = clear_of_shoulder(wrist, quat, part * signer.hands * signer.scale, signer)
        hand_state[:6] = np.concatenate([wrist, pose.hand_rotvecs(wrist, quat, signer)])
        outward = (4.0 if posture.location in ON_ARM else 0.7) * normal
        return in_contact(hand_state, quat, None if meets else weak.hand, signer, outward)
    for _ in range(_TOUCH_ROUNDS * (posture.on_skin and normal.any())):
        gaps = hand_clearances(pose.of_hands(hand_state, weak.hand)[None], signer)[0]
        gap = gaps[2 if on_arm(posture.location) else 0]
        wrist = wrist + (max(posture.off, 0.0) * signer.scale - gap) * normal
        hand_state[:6] = np.concatenate([wrist, pose.hand_rotvecs(wrist, quat, signer)])
    return hand_state


def strong_wrist(
    posture: Posture, weak: WeakArm, meets: bool = False, size: float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """``strong_hand`` as the wrist's position (3,), the hand's rotation (4,) and its angles (21,)."""
    signer = weak.signer
    location = locate(posture.location, weak)
    shape, hand_site = handshape(posture.shape), hand_part(posture.part)
    size = size * signer.scale
    quat = facing(posture.palm, posture.fingers)
    unit, skin = signer.hands * signer.scale, hand_site.skin
    part = rotation.rotate(quat, hand_site.centre(shape.points)) * unit
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


def palm(posture: Posture, weak: WeakArm, meets: bool = False) -> FloatArray:
    """Position (3,), cm, of the middle of the strong palm in a posture, from the posture alone; arguments as for
    ``strong_hand``.
    """
    wrist, quat, _ = strong_wrist(posture, weak, meets)
    if posture.touch:
        wrist = strong_hand(posture, weak, meets)[pose.WRIST]
    centre = hand_part("palm").centre(handshape(posture.shape).points) * weak.signer.hands * weak.signer.scale
    return np.asarray(wrist + rotation.rotate(quat, centre))


_LIFTED_IN_SPACE = (0.0, 0.7, -0.7)


def lift_direction(posture: Posture, weak: WeakArm) -> FloatArray:
    """The unit vector (3,) along which a hand is lifted on its way back to a posture: away from the surface at it; in
    space up and towards the signer.
    """
    normal = locate(posture.location, weak).normal
    direction = normal if normal.any() else axes(_LIFTED_IN_SPACE)
    return np.asarray(direction / np.linalg.norm(direction))


def locate(name: str, weak: WeakArm) -> Location:
    """A location, by its name in ``LOCATIONS`` or composed (``is_location``), of the signer of the weak arm."""
    signer = weak.signer
    if name in _IN_SPACE:
        return Location(axes(_IN_SPACE[name]) * signer.scale, np.zeros(3))
    if name in _ON_BODY:
        return body_locations(signer)[name]
    if name.startswith("space:"):
        return Location(axes(vector(name[6:])) * signer.scale, np.zeros(3))
    if name == REST:
        return Location(resting(signer)[:3], np.zeros(3))
    if name not in _ON_WEAK_ARM and not name.startswith("base-"):
        return CACHE.recent(_on_body, name, signer, most=2048)
    return on_weak_arm(name, weak, *weak.joints)


def on_weak_arm(
    name: str, weak: WeakArm, shoulder: FloatArray, elbow: FloatArray, wrist: FloatArray, quat: FloatArray
) -> Location:
    """A location on the weak arm or its hand, with joints and hand rotation as of ``WeakArm.joints``."""
    signer = weak.signer
    if name not in _ON_WEAK_ARM:
        site = _ON_BASE[name] if name in _ON_BASE else hand_part(name[5:])
        unit, points = signer.hands * signer.scale, hand.points(weak.hand[pose.FINGERS])
        centre = wrist + rotation.rotate(quat, site.centre(points)) * unit
        normal = rotation.rotate(quat, site.normal(points))
        return Location((centre + site.skin * unit * normal) * MIRROR, normal * MIRROR)
    bone, fraction, skin, outward = _ON_WEAK_ARM[name]
    start, end = (elbow, wrist) if bone == "forearm" else (shoulder, elbow)
    direction = (end - start) / np.linalg.norm(end - start)
    normal = axes(outward) - (axes(outward) @ direction) * direction
    normal = normal / np.linalg.norm(normal)
    point = start + fraction * (end - start) + skin * 170.0 * signer.scale * normal
    return Location(point * MIRROR, normal * MIRROR)


_HELD = {
    "folded": (
        Posture("rest", "belly", "palm", (0.0, 0.3, -0.95), (-0.8, -0.6, 0.0), off=5.0),
        Posture("rest", "belly", "palm", (0.0, 0.3, -0.95), (-0.8, -0.6, 0.0), off=1.0, shift=(0.0, -2.0, 0.0)),
    ),
    "bent": (Posture("rest", "waist", "palm", (-0.9, -0.3, 0.0), (-0.3, -0.2, 0.93), off=7.0, shift=(3.0, 0.0, 0.0)),)
    * 2,
    "low": (
        Posture("rest", "belly", "palm", (-0.2, 0.1, -0.97), (-0.5, -0.86, 0.0), off=5.0, shift=(2.0, -13.0, 3.0)),
        Posture("rest", "belly", "palm", (-0.2, 0.1, -0.97), (-0.5, -0.86, 0.0), off=2.0, shift=(2.0, -15.0, 1.0)),
    ),
}
"""Postures of the strong and the weak hand at each rest except hanging."""
_HELD_LOWER_CM = 2.0
"""How much lower than these postures hands rest, cm."""


def resting(signer: Signer, *names: str | int) -> FloatArray:
    """The read-only state (65,) of a signer at rest; ``names`` seed its small variations."""
    return CACHE.recent(_resting, signer, *names, most=64)


def _resting(signer: Signer, *names: str | int) -> FloatArray:
    """``resting``."""
    rng = stream("rest", signer.name, *names)
    state = np.zeros(pose.SIZE)
    postures = (None, None) if signer.rest == HANGING else _HELD[signer.rest]
    for first, posture in zip((0, 27), postures, strict=True):
        jitter = 0.6 * rng.standard_normal(3)
        if posture is not None:
            hand_state = weak_hand(posture, signer)
            hand_state[:3] += jitter + np.array([0.0, 2.0 * signer.rest_out_cm - _HELD_LOWER_CM, 0.0])
            hand_state[6:] *= 1.0 + 0.06 * rng.standard_normal()
            state[first : first + 27] = hand_state
            continue
        wrist = np.array([-26.0 - signer.rest_out_cm, -39.5, 4.0 + signer.rest_fwd_cm]) + jitter
        arms = 0.5 * (signer.arms + 1.0)
        wrist = wrist * np.array([signer.shoulders, arms, 1.0]) * signer.scale
        state[first : first + 3] = wrist
        quat = facing((-1.0, 0.0, -0.25), (0.05, -1.0, 0.12))
        state[first + 3 : first + 6] = pose.hand_rotvecs(wrist, quat, signer)
        state[first + 6 : first + 27] = HANDSHAPES["rest"].angles * (1.0 + 0.06 * rng.standard_normal())
    state.flags.writeable = False
    return state
