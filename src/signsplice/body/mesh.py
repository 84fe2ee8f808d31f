"""The mannequin: the body of a skeleton as a mesh that its joints carry.

The capsules of ``body.capsules`` are blended into one another, part by part (a shirt with its sleeves, a hand, a face).
The mesh is bound to the joints by linear blend skinning, in the T-pose with fingers spread. The last phalanx of each
finger has a tint of its own, so that handshapes can be read.

Its head has eyes, lids, brows, lips, teeth and tongue, and ARKit's 52 coefficients as its morphs. ``figure.npz`` is
made by ``workshop/runs/figure.py`` from MakeHuman's base mesh (CC0), in steps of ``_HEAD_STEP`` statures about the
head's joint in the T-pose (left +X, up +Y, forward +Z). Its skin follows that of the capsules of head and neck, which
hands touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import N_JOINTS, Avatar, BodyCapsules, MeshPart, body_capsules, capsule_ends
from signsplice.body.surface_nets import surface
from signsplice.motion import FloatArray, Skeleton, kinematics, rotation
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS
from signsplice.rig.t_pose import positions_from_rotations

_HEAD_STEP = 1e-5
_CHIN_RADIUS = 0.024
"""Radius of the usual head's chin (``capsules``), statures: what a larger head is measured by."""
_COLOURS = {
    "face": (0.90, 0.69, 0.56),
    "lips": (0.76, 0.45, 0.41),
    "eye": (0.95, 0.94, 0.92),
    "iris": (0.33, 0.24, 0.17),
    "pupil": (0.07, 0.06, 0.06),
    "lash": (0.16, 0.11, 0.09),
    "brow": (0.24, 0.17, 0.13),
    "teeth": (0.95, 0.93, 0.88),
    "tongue": (0.56, 0.26, 0.28),
    "hair": (0.27, 0.20, 0.17),
}
"""Parts in the order of their numbers in the file, and their colours, sRGB 0 to 1."""


def has_head(skeleton: Skeleton, shape: BodyCapsules) -> bool:
    """Whether a body has the head that the figure's stands for."""
    return "head1" in shape.keys and "head" in rig_info(skeleton).roles.joints


def head_parts(skeleton: Skeleton, shape: BodyCapsules, positions: FloatArray) -> tuple[MeshPart, ...]:
    """The figure's head on a body that has one, part by part; ``positions`` (J, 3): of the joints in the bind pose."""
    info = rig_info(skeleton)
    head, size = info.roles.joints["head"], _size(shape)
    neck = info.roles.joints.get("neck", head)
    with files("signsplice.body").joinpath("figure.npz").open("rb") as file:
        stored = {name: np.asarray(array) for name, array in np.load(file).items()}
    points, normals = stored["vertices"] * size, stored["normals"].astype(np.float64)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    weight = stored["head_weights"] / 255.0
    ends = np.cumsum(stored["unit_counts"])
    units = {
        name: (stored["unit_vertices"][end - n : end].astype(np.int64), stored["unit_moves"][end - n : end] * size)
        for name, n, end in zip(ARKIT_CHANNELS, stored["unit_counts"].tolist(), ends.tolist(), strict=True)
    }
    is_neck, is_one = weight < 0.5, (weight == 0.0) | (weight == 1.0)
    first, second = np.where(is_neck, neck, head), np.where(is_one, 0, np.where(is_neck, head, neck))
    most = np.maximum(weight, 1.0 - weight)
    weights = np.stack([most, 1.0 - most, 0.0 * most, 0.0 * most], axis=1)
    joints = np.stack([first, second, 0 * first, 0 * first], axis=1)
    triangles = stored["triangles"].astype(np.int64)
    out = []
    for number, (name, colour) in enumerate(_COLOURS.items()):
        used, own = np.unique(triangles[stored["parts"] == number], return_inverse=True)
        moved = {unit: _of_part(used, *rows) for unit, rows in units.items()}
        morphs = {unit: rows for unit, rows in moved.items() if len(rows[0])}
        at, own = positions[head] + points[used], own.reshape(-1, 3)
        out.append(MeshPart(name, colour, at, normals[used], own, joints[used], weights[used], morphs))
    return tuple(out)


def _size(shape: BodyCapsules) -> float:
    """Clip units of a step of the file: by the thickness of the chin."""
    return _HEAD_STEP * float(shape.radii[shape.keys.index("head1"), 0]) / _CHIN_RADIUS


def _of_part(
    used: NDArray[np.int64], rows: NDArray[np.int64], moves: FloatArray
) -> tuple[NDArray[np.int64], FloatArray]:
    """The vertices of a part that a unit moves, by their numbers there, and their moves (N, 3)."""
    at = np.minimum(np.searchsorted(used, rows), len(used) - 1)
    own = used[at] == rows
    return at[own], moves[own]


SKIN = {"right": (0.93, 0.72, 0.58), "left": (0.80, 0.58, 0.47), "": (0.90, 0.69, 0.56)}
"""Colours of skin, sRGB 0 to 1; the left hand is darker, so that crossed hands can be distinguished."""
TIPS = {"right": (0.97, 0.63, 0.55), "left": (0.85, 0.50, 0.45)}
CLOTHES = {
    "shirt": (0.26, 0.31, 0.40),
    "sleeve": (0.30, 0.36, 0.46),
    "cuff": (0.30, 0.36, 0.46),
    "leg": (0.33, 0.33, 0.36),
    "shoe": (0.20, 0.20, 0.22),
    "hair": (0.27, 0.20, 0.17),
    "eye": (0.16, 0.13, 0.13),
    "mouth": (0.66, 0.36, 0.34),
}

_STEP = {"face": 0.0036, "hair": 0.0060, "neck": 0.0100, "shirt": 0.0120, "leg": 0.0200, "shoe": 0.0140}
"""Distance of a part's vertices as a fraction of stature: 6 mm in the face of a body of 1.70 m; 4.8 mm by default."""
_COARSEST = 0.06
"""No part needs a smaller distance than this fraction of its thickest capsule."""
_BLEND = {"shirt": 0.0085, "face": 0.0035, "leg": 0.0040, "hand": 0.0014}
"""Blend radius of the capsules of a part, as a fraction of stature; 1 mm by default."""
_PALM_BLEND, _LIMB_BLEND = 0.0045, 0.0005
"""Blend radius within a palm, and within a finger, an arm or a leg, before these are blended with each other."""
_SOFT = {"shirt": 0.45}
"""Softness of the transition from one joint to the next, as a fraction of the capsule's thickness."""
_SPREAD_DEG = {"Index": 7.0, "Middle": 1.0, "Ring": -6.0, "Little": -14.0}
"""How far fingers are spread in the bind pose, so that their meshes do not merge."""
_BENT = 0.25
"""Factor on that softness at elbows and knees: half-way between two bones that are folded onto one another, a vertex
that both carry would be pinched.
"""
_BALL = 0.95
"""Thickness of the ball in an elbow or a knee, as a fraction of the limb's."""
_CUFF_END = 0.90
"""Fraction of the forearm that the sleeve covers; from there on a bare wrist leads into the palm."""
_NECK_END, _NECK_WITHIN = 0.65, 0.97
"""Fraction of the neck's capsule that is seen below the figure's head, and its thickness there."""
_WRIST = (0.0125, 0.0135)
_CREASE, _CREASE_SHADE = 0.60, 0.84
"""From which weight of the second of two phalanges, in that of the first, skin is their crease, and how dark it is."""
_GROWN = {"mouth": 0.0020, "eye": 0.0010}
"""Added to the radii of parts on the face, as a fraction of stature, because blending makes the face fuller."""


def body_mesh(skeleton: Skeleton) -> tuple[MeshPart, ...]:
    """The mesh of a skeleton in usual proportions, part by part, kept as long as the skeleton lives; an avatar's own
    where it has one.
    """
    if isinstance(skeleton, Avatar) and skeleton.mesh:
        return skeleton.mesh
    return skeleton.derived[_body_mesh]


def _body_mesh(skeleton: Skeleton) -> tuple[MeshPart, ...]:
    return capsule_mesh(skeleton, body_capsules(skeleton))


def colour(part: str, side: str) -> tuple[float, float, float]:
    """The colour of a capsule's part."""
    if part in CLOTHES:
        return CLOTHES[part]
    return TIPS[side] if part.endswith("Tip") and side else SKIN[side]


def bind_pose(skeleton: Skeleton) -> tuple[FloatArray, FloatArray]:
    """The bind pose: global rotations (J, 4) and positions (J, 3), clip units, the root at the origin. It is the T-pose
    with fingers spread; the rest pose of an avatar with a mesh of its own.
    """
    if isinstance(skeleton, Avatar) and skeleton.mesh:
        return np.tile(rotation.IDENTITY, (len(skeleton), 1)), kinematics.rest_positions(skeleton)
    info = rig_info(skeleton)
    joints, rotations = info.roles.joints, info.t_pose.rotations.copy()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for finger, degrees in _SPREAD_DEG.items():
            # Palms face down and index fingers are in front: spreading is a rotation about the vertical.
            turn = rotation.exp([0.0, -sign * np.deg2rad(degrees), 0.0])
            first = joints.get(f"{side}{finger}Proximal")
            for joint in () if first is None else kinematics.subtree(skeleton, first):
                rotations[joint] = rotation.multiply(turn, rotations[joint])
    return rotations, positions_from_rotations(skeleton, rotations)


@dataclass(frozen=True, eq=False)
class _MeshCapsules:
    """The capsules of one part in the bind pose.

    starts, ends: (C, 3) of their axes.
    radii: (C, 2) at both ends.
    joints: (C,) that carry them.
    bundles: (C,) number of the group in which each is blended first.
    """

    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    joints: NDArray[np.intp]
    bundles: NDArray[np.intp]


def capsule_mesh(skeleton: Skeleton, shape: BodyCapsules) -> tuple[MeshPart, ...]:
    """The mesh of a skeleton whose body has the given capsules, part by part."""
    rotations, positions = bind_pose(skeleton)
    starts, ends = (p[0] for p in capsule_ends(shape, rotation.to_matrix(rotations)[None], positions[None]))
    height = rig_info(skeleton).sizes.stature or float(np.ptp(np.concatenate([starts, ends]), axis=0).max()) or 1.0
    groups: dict[tuple[str, str], list[int]] = {}
    has_face = has_head(skeleton, shape)
    roles = rig_info(skeleton).roles.joints.items()
    phalanges = np.array([joint for role, joint in roles for finger in FINGERS if finger in role], np.intp)
    for n, (part, side) in enumerate(zip(shape.parts, shape.sides, strict=True)):
        if has_face and part in ("face", "nose", "hair", "eye", "mouth"):
            continue
        groups.setdefault(_part_of(part, side), []).append(n)
    pieces = []
    for (kind, side), own in groups.items():
        parts, sides = [shape.parts[n] for n in own], [shape.sides[n] for n in own]
        made = _MeshCapsules(starts[own], ends[own].copy(), shape.radii[own], shape.joints[own], _bundles(parts, sides))
        if kind == "shirt":
            cuffs = [k for k, part in enumerate(parts) if part == "cuff"]
            made.ends[cuffs] = made.starts[cuffs] + _CUFF_END * (made.ends[cuffs] - made.starts[cuffs])
        if kind == "face" and has_face:  # the neck below the figure's head, which goes into it
            ends_in = made.starts + _NECK_END * (made.ends - made.starts)
            kind, made = "neck", replace(made, ends=ends_in, radii=_NECK_WITHIN * made.radii)
        if kind == "hand":
            made = _with_wrist(made, starts, ends, shape, side, height)
        made = replace(made, radii=made.radii + height * _GROWN.get(kind, 0.0))
        tint = colour(kind if kind in CLOTHES else parts[0], side)
        bends = _bends(made, [part in ("cuff", "leg") for part in parts])
        piece = _skin(f"{side} {kind}".strip(), kind, tint, made, height, bends)
        if bends.any():
            piece = _merge_parts([piece, *(_skin("", kind, tint, ball, height) for ball in _balls(made, bends))])
        pieces += _separate_creases(piece, phalanges) if kind == "hand" else [piece]
    return (*pieces, *(head_parts(skeleton, shape, positions) if has_face else ()))


def _separate_creases(hand: MeshPart, phalanges: NDArray[np.intp]) -> list[MeshPart]:
    """A hand, and the darker creases at the joints of its fingers: where two phalanges carry the skin alike."""
    bends = np.isin(hand.joints[:, :2], phalanges).all(axis=1) & (hand.weights[:, 1] > _CREASE * hand.weights[:, 0])
    is_crease = bends[hand.triangles].all(axis=1)
    side, parts = hand.name.partition(" ")[0], []
    shades = ((hand.name, 1.0, ~is_crease), (f"{side} creases", _CREASE_SHADE, is_crease))
    for name, shade, own in shades:
        used, triangles = np.unique(hand.triangles[own], return_inverse=True)
        red, green, blue = (shade * value for value in hand.colour)
        parts.append(MeshPart(
            name, (red, green, blue), hand.vertices[used], hand.normals[used], triangles.reshape(-1, 3),
            hand.joints[used], hand.weights[used],
        ))  # fmt: skip
    return [part for part in parts if len(part.triangles)]


def _bends(own: _MeshCapsules, may: Sequence[bool]) -> NDArray[np.bool_]:
    """Which capsules (C,), among those that ``may``, begin where one of another joint ends: at elbows and knees."""
    apart = np.linalg.norm(own.ends[None] - own.starts[:, None], axis=-1)
    follows = (apart < 0.2 * own.radii[:, :1]) & (own.joints[:, None] != own.joints)
    return np.asarray(follows.any(axis=1) & np.resize(np.array(may), len(own.starts)))


def _balls(own: _MeshCapsules, bends: NDArray[np.bool_]) -> list[_MeshCapsules]:
    """A ball in every elbow and knee, in which the meshes on both sides end when the limb bends."""
    return [
        _MeshCapsules(at := own.starts[n : n + 1], at.copy(), _BALL * own.radii[n : n + 1, :1].repeat(2, axis=1),
                  own.joints[n : n + 1], np.zeros(1, np.intp))
        for n in np.flatnonzero(bends)
    ]  # fmt: skip


def _merge_parts(pieces: Sequence[MeshPart]) -> MeshPart:
    """Pieces as one, named and coloured as the first."""
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    return replace(
        pieces[0],
        vertices=np.concatenate([piece.vertices for piece in pieces]),
        normals=np.concatenate([piece.normals for piece in pieces]),
        triangles=np.concatenate([piece.triangles + k for piece, k in zip(pieces, starts[:-1], strict=True)]),
        joints=np.concatenate([piece.joints for piece in pieces]),
        weights=np.concatenate([piece.weights for piece in pieces]),
    )


def _part_of(part: str, side: str) -> tuple[str, str]:
    if part in ("sleeve", "cuff", "shirt"):
        return "shirt", ""
    if part in ("face", "nose", "neck"):
        return "face", ""
    return ("hand" if part in ("palm", *FINGERS) else part), side


def _bundles(parts: list[str], sides: list[str]) -> NDArray[np.intp]:
    """Groups (C,) of capsules that are blended first: a palm, each finger, an arm, a leg, else each capsule alone."""
    limbs = {"sleeve": "arm", "cuff": "arm", "leg": "leg"} | {part: part for part in ("palm", *FINGERS)}
    names = [
        f"{limbs[part]} {side}" if part in limbs else str(n)
        for n, (part, side) in enumerate(zip(parts, sides, strict=True))
    ]
    return np.unique(names, return_inverse=True)[1]


def _with_wrist(
    own: _MeshCapsules, starts: FloatArray, ends: FloatArray, shape: BodyCapsules, side: str, height: float
) -> _MeshCapsules:
    """A hand with the end of its forearm, which the sleeve leaves bare."""
    cuff = next((n for n, part in enumerate(shape.parts) if part == "cuff" and shape.sides[n] == side), None)
    if cuff is None:
        return own
    start = starts[cuff] + (_CUFF_END - 0.15) * (ends[cuff] - starts[cuff])
    return _MeshCapsules(
        np.concatenate([own.starts, start[None]]),
        np.concatenate([own.ends, ends[cuff][None]]),
        np.concatenate([own.radii, height * np.array([_WRIST])]),
        np.append(own.joints, shape.joints[cuff]),
        np.append(own.bundles, own.bundles[0]),  # the palm comes first
    )


def _skin(
    name: str,
    kind: str,
    tint: tuple[float, float, float],
    own: _MeshCapsules,
    height: float,
    bends: NDArray[np.bool_] | None = None,
) -> MeshPart:
    blend = height * _BLEND.get(kind, 0.0006)
    blends = {int(k): _LIMB_BLEND * height for k in own.bundles}
    if kind == "hand":
        blends[int(own.bundles[0])] = _PALM_BLEND * height  # the palm comes first
    bundles = [(np.flatnonzero(own.bundles == k), within) for k, within in blends.items()]

    def field(points: FloatArray) -> FloatArray:
        each = _distances(points, own)
        return _union(np.stack([_union(each[rows], within) for rows, within in bundles]), blend)

    margin = own.radii.max() + 2.0 * blend
    low, high = np.minimum(own.starts, own.ends).min(axis=0) - margin, np.maximum(own.starts, own.ends).max(axis=0)
    step = max(height * _STEP.get(kind, 0.0028), _COARSEST * float(own.radii.max()))
    vertices, normals, triangles = surface(field, low, high + margin, step)
    softness = _SOFT.get(kind, 0.28) * own.radii.mean(axis=1)
    if bends is not None:
        softness[bends] *= _BENT
    joints, weights = _skin_weights(_distances(vertices, own).T, softness, own.joints)
    return MeshPart(name, tint, vertices, normals, triangles, joints, weights)


def _union(distances: FloatArray, blend: float) -> FloatArray:
    """A smooth union (N,) of distances (C, N): a point near to several solids counts as a little deeper inside."""
    if len(distances) == 1:
        return np.asarray(distances[0])
    nearest = distances.min(axis=0)
    near = np.exp((nearest - distances) / blend)
    return np.asarray(nearest - blend * np.log(near.T.copy().sum(axis=1)))  # copied: sums are those of a row


def _distances(points: FloatArray, own: _MeshCapsules) -> FloatArray:
    """Signed distances (C, N) of points (N, 3) from tapered capsules, negative inside.

    A tapered capsule is the union of all balls between its two end balls.
    """
    axes, (first, second) = own.ends - own.starts, own.radii.T[:, :, None]  # (C, 3), (C, 1)
    squared, taper = np.einsum("cx,cx->c", axes, axes)[:, None], first - second
    slope = squared - taper**2
    cone = slope > 1e-12 * squared  # else the one ball holds the other
    whole = np.where(cone, squared, 1.0)
    middle = own.starts.mean(axis=0)  # small numbers keep the matrix products exact
    points, starts = points - middle, own.starts - middle
    along = axes @ points.T
    along -= np.einsum("cx,cx->c", starts, axes)[:, None]
    far = np.einsum("nx,nx->n", points, points) + np.einsum("cx,cx->c", starts, starts)[:, None]
    far -= starts @ (2.0 * points).T
    np.maximum(far, 0.0, out=far)  # squared, from the start
    across = np.maximum(far - along**2 / whole, 0.0)  # squared, from the axis
    steep = np.sqrt(np.where(cone, slope, whole) / whole)
    away = np.sqrt(across)
    # The ball whose surface is nearest has its centre here, from 0 at the start to l^2 at the end.
    centre = along - taper * away / steep
    out: FloatArray = away * steep + along * taper / whole - first
    start = np.sqrt(far) - first
    np.copyto(out, np.sqrt(across + (along - squared) ** 2 / whole) - second, where=centre >= squared)
    np.copyto(out, start, where=centre <= 0.0)
    if not cone.all():
        ball = np.where(first >= second, start, np.sqrt(np.maximum(far - 2.0 * along + squared, 0.0)) - second)
        np.copyto(out, ball, where=~cone)
    return out


def _skin_weights(
    distances: FloatArray, softness: FloatArray, joints: NDArray[np.intp]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Skinning joints and weights (V, 4) of vertices, by their distances (V, C) from the capsules of each joint.

    softness: (C,) distance over which a vertex passes from one capsule to the next; the smaller of two counts.
    """
    nearest = distances.argmin(axis=1)
    soft = np.minimum(softness, softness[nearest, None])
    falloff = np.exp(-(distances - distances.min(axis=1, keepdims=True)) / soft)
    names = np.unique(joints)
    whole = np.stack([falloff[:, joints == joint].max(axis=1) for joint in names], axis=1)
    whole = np.pad(whole, ((0, 0), (0, max(0, N_JOINTS - len(names)))))
    names = np.pad(names, (0, max(0, N_JOINTS - len(names))))
    order = np.argsort(-whole, axis=1, kind="stable")[:, :N_JOINTS]
    weights = np.take_along_axis(whole, order, axis=1)
    weights[weights < 0.02 * weights[:, :1]] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    return np.where(weights > 0.0, names[order], 0).astype(np.int64), weights
