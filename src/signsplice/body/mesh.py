"""The mannequin: the body of a skeleton as a mesh that its joints carry.

The capsules of ``body.capsules`` blend into one another, part by part (a shirt with its sleeves, a hand, a face).
Linear blend skinning binds the mesh to the joints, in the T-pose with fingers spread. The last phalanx of each
finger has its own tint, which keeps handshapes readable.

Its head has eyes, lids, brows, lips, teeth and tongue, and ARKit's 52 coefficients as morphs.
``workshop/runs/figure.py`` makes it, as ``figure.npz``, from MakeHuman's base mesh (CC0). Coordinates there are whole
numbers of ``_HEAD_STEP`` statures from the head's joint in the T-pose (left +X, up +Y, forward +Z). The head's skin
follows the capsules of head and neck, which hands touch.
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


@dataclass(frozen=True)
class MannequinShape:
    """Shape of the mannequin's mesh."""

    chin_radius: float = 0.024
    """Radius of the usual head's chin (``capsules``), statures; others scale the figure's head in proportion."""
    least_spacing: float = 0.06
    """Least distance of a part's vertices, in radii of its thickest capsule."""
    palm_blend: float = 0.0045
    """Blend radius within a palm, before palm and fingers are blended, statures."""
    limb_blend: float = 0.0005
    """Blend radius within a finger, an arm or a leg, before these are blended, statures."""
    bend_softness: float = 0.25
    """Factor on the softness (``_SOFT``) at elbows and knees: half-way between two folded bones, a vertex that both
    carry would be pinched.
    """
    bend_ball_radius: float = 0.95
    """Radius of the ball in an elbow or a knee, in radii of the limb."""
    sleeve_end: float = 0.90
    """Fraction of the forearm that the sleeve covers; from there on a bare wrist leads into the palm."""
    neck_end: float = 0.65
    """Fraction of the neck's capsule that is visible below the figure's head."""
    neck_radius: float = 0.97
    """Radius of that part, in radii of the neck's capsule."""
    wrist_radii: tuple[float, float] = (0.0125, 0.0135)
    """Radii of the bare wrist at its beginning within the sleeve and at the hand, statures."""
    crease_weight: float = 0.60
    """Ratio of the second to the first weight of skin that two phalanges carry, above which it is their crease."""
    crease_shade: float = 0.84
    """Brightness of a crease relative to the skin around it."""


_MANNEQUIN = MannequinShape()

_HEAD_STEP = 1e-5
"""Unit of the coordinates in ``figure.npz``, statures."""
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
    """Tells whether a body has a head, which the figure's replaces."""
    return "head1" in shape.keys and "head" in rig_info(skeleton).roles.joints


def head_parts(skeleton: Skeleton, shape: BodyCapsules, positions: FloatArray) -> tuple[MeshPart, ...]:
    """Returns the figure's head on a body with a head, by parts; ``positions``: (J, 3) joints in the bind pose."""
    info = rig_info(skeleton)
    head, step = info.roles.joints["head"], _step_length(shape)
    neck = info.roles.joints.get("neck", head)
    with files("signsplice.body").joinpath("figure.npz").open("rb") as file:
        stored = {name: np.asarray(array) for name, array in np.load(file).items()}
    points, normals = stored["vertices"] * step, stored["normals"].astype(np.float64)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    weight = stored["head_weights"] / 255.0
    ends = np.cumsum(stored["unit_counts"])
    coefficients = {
        name: (stored["unit_vertices"][end - n : end].astype(np.int64), stored["unit_moves"][end - n : end] * step)
        for name, n, end in zip(ARKIT_CHANNELS, stored["unit_counts"].tolist(), ends.tolist(), strict=True)
    }
    is_neck, is_one = weight < 0.5, (weight == 0.0) | (weight == 1.0)
    first, second = np.where(is_neck, neck, head), np.where(is_one, 0, np.where(is_neck, head, neck))
    larger = np.maximum(weight, 1.0 - weight)
    weights = np.stack([larger, 1.0 - larger, 0.0 * larger, 0.0 * larger], axis=1)
    joints = np.stack([first, second, 0 * first, 0 * first], axis=1)
    triangles = stored["triangles"].astype(np.int64)
    parts = []
    for number, (name, colour) in enumerate(_COLOURS.items()):
        used, corners = np.unique(triangles[stored["parts"] == number], return_inverse=True)
        moved = {coefficient: _moves_in_part(used, *rows) for coefficient, rows in coefficients.items()}
        morphs = {coefficient: rows for coefficient, rows in moved.items() if len(rows[0])}
        vertices, corners = positions[head] + points[used], corners.reshape(-1, 3)
        parts.append(MeshPart(name, colour, vertices, normals[used], corners, joints[used], weights[used], morphs))
    return tuple(parts)


def _step_length(shape: BodyCapsules) -> float:
    """Returns the length of a step of the file, clip units, from the thickness of the chin."""
    return _HEAD_STEP * float(shape.radii[shape.keys.index("head1"), 0]) / _MANNEQUIN.chin_radius


def _moves_in_part(
    used: NDArray[np.int64], rows: NDArray[np.int64], moves: FloatArray
) -> tuple[NDArray[np.int64], FloatArray]:
    """Returns the vertices (N,) of a part that a face coefficient moves, by their numbers in the part, and their moves
    (N, 3). ``used``: the part's vertices in the file; ``rows``, ``moves``: all that the coefficient moves.
    """
    index = np.minimum(np.searchsorted(used, rows), len(used) - 1)
    is_match = used[index] == rows
    return index[is_match], moves[is_match]


SKIN_COLOURS = {"right": (0.93, 0.72, 0.58), "left": (0.80, 0.58, 0.47), "": (0.90, 0.69, 0.56)}
"""Colours of skin, sRGB 0 to 1; the left hand is darker, to distinguish crossed hands."""
TIP_COLOURS = {"right": (0.97, 0.63, 0.55), "left": (0.85, 0.50, 0.45)}
"""Colours of last phalanges, sRGB 0 to 1."""
PART_COLOURS = {
    "shirt": (0.26, 0.31, 0.40),
    "sleeve": (0.30, 0.36, 0.46),
    "cuff": (0.30, 0.36, 0.46),
    "leg": (0.33, 0.33, 0.36),
    "shoe": (0.20, 0.20, 0.22),
    "hair": (0.27, 0.20, 0.17),
    "eye": (0.16, 0.13, 0.13),
    "mouth": (0.66, 0.36, 0.34),
}
"""Colours of parts that are no skin, sRGB 0 to 1."""

_STEP = {"face": 0.0036, "hair": 0.0060, "neck": 0.0100, "shirt": 0.0120, "leg": 0.0200, "shoe": 0.0140}
"""Distance of a part's vertices as a fraction of stature: 6 mm in the face of a body of 1.70 m; 4.8 mm by default."""
_BLEND = {"shirt": 0.0085, "face": 0.0035, "leg": 0.0040, "hand": 0.0014}
"""Blend radius of the capsules of a part, as a fraction of stature; 1 mm by default."""
_SOFT = {"shirt": 0.45}
"""Softness of the transition from one joint to the next, in mean radii of the capsule; 0.28 by default."""
_SPREAD_DEG = {"Index": 7.0, "Middle": 1.0, "Ring": -6.0, "Little": -14.0}
"""Spread of the fingers in the bind pose, degrees, so that their meshes do not merge."""
_GROWN = {"mouth": 0.0020, "eye": 0.0010}
"""Addition to the radii of parts on the face, as a fraction of stature, because blending makes the face fuller."""


def body_mesh(skeleton: Skeleton) -> tuple[MeshPart, ...]:
    """Returns the mesh of a skeleton in usual proportions, by parts, cached for its lifetime; an avatar's own mesh if
    it has one.
    """
    if isinstance(skeleton, Avatar) and skeleton.mesh:
        return skeleton.mesh
    return skeleton.derived[_body_mesh]


def _body_mesh(skeleton: Skeleton) -> tuple[MeshPart, ...]:
    return capsule_mesh(skeleton, body_capsules(skeleton))


def colour(part: str, side: str) -> tuple[float, float, float]:
    """Returns the colour of a capsule by its part and side, sRGB 0 to 1."""
    if part in PART_COLOURS:
        return PART_COLOURS[part]
    return TIP_COLOURS[side] if part.endswith("Tip") and side else SKIN_COLOURS[side]


def bind_pose(skeleton: Skeleton) -> tuple[FloatArray, FloatArray]:
    """Returns the bind pose: global rotations (J, 4), positions (J, 3), clip units, the root at the origin: the T-pose
    with fingers spread, or the rest pose of an avatar with its own mesh.
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
    blend_groups: (C,) number of the group in which each blends first.
    """

    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    joints: NDArray[np.intp]
    blend_groups: NDArray[np.intp]


def capsule_mesh(skeleton: Skeleton, shape: BodyCapsules) -> tuple[MeshPart, ...]:
    """Returns the mesh of a skeleton whose body has the given capsules, by parts."""
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
        groups.setdefault(_mesh_part(part, side), []).append(n)
    pieces = []
    for (kind, side), rows in groups.items():
        parts, sides = [shape.parts[n] for n in rows], [shape.sides[n] for n in rows]
        capsules = _MeshCapsules(
            starts[rows], ends[rows].copy(), shape.radii[rows], shape.joints[rows], _blend_groups(parts, sides)
        )
        if kind == "shirt":
            cuffs = [k for k, part in enumerate(parts) if part == "cuff"]
            forearms = capsules.ends[cuffs] - capsules.starts[cuffs]
            capsules.ends[cuffs] = capsules.starts[cuffs] + _MANNEQUIN.sleeve_end * forearms
        if kind == "face" and has_face:  # the neck below the figure's head, which goes into it
            ends_in = capsules.starts + _MANNEQUIN.neck_end * (capsules.ends - capsules.starts)
            kind, capsules = "neck", replace(capsules, ends=ends_in, radii=_MANNEQUIN.neck_radius * capsules.radii)
        if kind == "hand":
            capsules = _with_wrist(capsules, starts, ends, shape, side, height)
        capsules = replace(capsules, radii=capsules.radii + height * _GROWN.get(kind, 0.0))
        tint = colour(kind if kind in PART_COLOURS else parts[0], side)
        bends = _bends(capsules, [part in ("cuff", "leg") for part in parts])
        piece = _skin(f"{side} {kind}".strip(), kind, tint, capsules, height, bends)
        if bends.any():
            piece = _merge_parts([piece, *(_skin("", kind, tint, ball, height) for ball in _balls(capsules, bends))])
        pieces += _separate_creases(piece, phalanges) if kind == "hand" else [piece]
    return (*pieces, *(head_parts(skeleton, shape, positions) if has_face else ()))


def _separate_creases(hand: MeshPart, phalanges: NDArray[np.intp]) -> list[MeshPart]:
    """Returns a hand and the darker creases at its finger joints: skin that two phalanges carry about equally."""
    is_shared = hand.weights[:, 1] > _MANNEQUIN.crease_weight * hand.weights[:, 0]
    bends = np.isin(hand.joints[:, :2], phalanges).all(axis=1) & is_shared
    is_crease = bends[hand.triangles].all(axis=1)
    side, parts = hand.name.partition(" ")[0], []
    shades = ((hand.name, 1.0, ~is_crease), (f"{side} creases", _MANNEQUIN.crease_shade, is_crease))
    for name, shade, mask in shades:
        used, triangles = np.unique(hand.triangles[mask], return_inverse=True)
        red, green, blue = (shade * value for value in hand.colour)
        parts.append(MeshPart(
            name, (red, green, blue), hand.vertices[used], hand.normals[used], triangles.reshape(-1, 3),
            hand.joints[used], hand.weights[used],
        ))  # fmt: skip
    return [part for part in parts if len(part.triangles)]


def _bends(capsules: _MeshCapsules, can_bend: Sequence[bool]) -> NDArray[np.bool_]:
    """Tells which capsules (C,) begin at an elbow or a knee: those that ``can_bend``, at the end of another joint's."""
    gaps = np.linalg.norm(capsules.ends[None] - capsules.starts[:, None], axis=-1)
    follows = (gaps < 0.2 * capsules.radii[:, :1]) & (capsules.joints[:, None] != capsules.joints)
    return np.asarray(follows.any(axis=1) & np.resize(np.array(can_bend), len(capsules.starts)))


def _balls(capsules: _MeshCapsules, bends: NDArray[np.bool_]) -> list[_MeshCapsules]:
    """Returns a ball for every elbow and knee, in which the meshes on both sides end when the limb bends."""
    return [
        _MeshCapsules(
            start := capsules.starts[n : n + 1],
            start.copy(),
            _MANNEQUIN.bend_ball_radius * capsules.radii[n : n + 1, :1].repeat(2, axis=1),
            capsules.joints[n : n + 1],
            np.zeros(1, np.intp),
        )
        for n in np.flatnonzero(bends)
    ]


def _merge_parts(pieces: Sequence[MeshPart]) -> MeshPart:
    """Returns the pieces as one, with the name and colour of the first."""
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    return replace(
        pieces[0],
        vertices=np.concatenate([piece.vertices for piece in pieces]),
        normals=np.concatenate([piece.normals for piece in pieces]),
        triangles=np.concatenate([piece.triangles + k for piece, k in zip(pieces, starts[:-1], strict=True)]),
        joints=np.concatenate([piece.joints for piece in pieces]),
        weights=np.concatenate([piece.weights for piece in pieces]),
    )


def _mesh_part(part: str, side: str) -> tuple[str, str]:
    """Returns the kind and side of the part of the mesh that a capsule's part belongs to."""
    if part in ("sleeve", "cuff", "shirt"):
        return "shirt", ""
    if part in ("face", "nose", "neck"):
        return "face", ""
    return ("hand" if part in ("palm", *FINGERS) else part), side


def _blend_groups(parts: list[str], sides: list[str]) -> NDArray[np.intp]:
    """Returns groups (C,) of capsules that blend first: a palm, each finger, an arm, a leg, else each capsule alone."""
    limbs = {"sleeve": "arm", "cuff": "arm", "leg": "leg"} | {part: part for part in ("palm", *FINGERS)}
    names = [
        f"{limbs[part]} {side}" if part in limbs else str(n)
        for n, (part, side) in enumerate(zip(parts, sides, strict=True))
    ]
    return np.unique(names, return_inverse=True)[1]


def _with_wrist(
    capsules: _MeshCapsules, starts: FloatArray, ends: FloatArray, shape: BodyCapsules, side: str, height: float
) -> _MeshCapsules:
    """Returns a hand with the end of its forearm, which the sleeve leaves bare."""
    cuff = next((n for n, part in enumerate(shape.parts) if part == "cuff" and shape.sides[n] == side), None)
    if cuff is None:
        return capsules
    start = starts[cuff] + (_MANNEQUIN.sleeve_end - 0.15) * (ends[cuff] - starts[cuff])
    return _MeshCapsules(
        np.concatenate([capsules.starts, start[None]]),
        np.concatenate([capsules.ends, ends[cuff][None]]),
        np.concatenate([capsules.radii, height * np.array([_MANNEQUIN.wrist_radii])]),
        np.append(capsules.joints, shape.joints[cuff]),
        np.append(capsules.blend_groups, capsules.blend_groups[0]),  # the palm comes first
    )


def _skin(
    name: str,
    kind: str,
    tint: tuple[float, float, float],
    capsules: _MeshCapsules,
    height: float,
    bends: NDArray[np.bool_] | None = None,
) -> MeshPart:
    """Returns the surface of blended capsules as a part of the mesh; ``bends``: capsules (C,) that begin at a bend."""
    blend = height * _BLEND.get(kind, 0.0006)
    blends = {int(k): _MANNEQUIN.limb_blend * height for k in capsules.blend_groups}
    if kind == "hand":
        blends[int(capsules.blend_groups[0])] = _MANNEQUIN.palm_blend * height  # the palm comes first
    groups = [(np.flatnonzero(capsules.blend_groups == k), within) for k, within in blends.items()]

    def field(points: FloatArray) -> FloatArray:
        each = _distances(points, capsules)
        return _union(np.stack([_union(each[rows], within) for rows, within in groups]), blend)

    margin = capsules.radii.max() + 2.0 * blend
    low, high = (
        np.minimum(capsules.starts, capsules.ends).min(axis=0) - margin,
        np.maximum(capsules.starts, capsules.ends).max(axis=0),
    )
    step = max(height * _STEP.get(kind, 0.0028), _MANNEQUIN.least_spacing * float(capsules.radii.max()))
    vertices, normals, triangles = surface(field, low, high + margin, step)
    softness = _SOFT.get(kind, 0.28) * capsules.radii.mean(axis=1)
    if bends is not None:
        softness[bends] *= _MANNEQUIN.bend_softness
    joints, weights = _skin_weights(_distances(vertices, capsules).T, softness, capsules.joints)
    return MeshPart(name, tint, vertices, normals, triangles, joints, weights)


def _union(distances: FloatArray, blend: float) -> FloatArray:
    """Returns a smooth union (N,) of distances (C, N): a point close to several solids counts as slightly deeper."""
    if len(distances) == 1:
        return np.asarray(distances[0])
    nearest = distances.min(axis=0)
    closeness = np.exp((nearest - distances) / blend)
    return np.asarray(nearest - blend * np.log(closeness.T.copy().sum(axis=1)))  # copied: sums equal those of a row


def _distances(points: FloatArray, capsules: _MeshCapsules) -> FloatArray:
    """Returns signed distances (C, N) of points (N, 3) from tapered capsules, negative inside.

    A tapered capsule is the union of all balls between its two end balls.
    """
    axes, (first, second) = capsules.ends - capsules.starts, capsules.radii.T[:, :, None]  # (C, 3), (C, 1)
    squared, taper = np.einsum("cx,cx->c", axes, axes)[:, None], first - second
    slope = squared - taper**2
    cone = slope > 1e-12 * squared  # else one ball contains the other
    divisor = np.where(cone, squared, 1.0)
    middle = capsules.starts.mean(axis=0)  # small numbers keep the matrix products accurate
    points, starts = points - middle, capsules.starts - middle
    dots = axes @ points.T
    dots -= np.einsum("cx,cx->c", starts, axes)[:, None]
    far = np.einsum("nx,nx->n", points, points) + np.einsum("cx,cx->c", starts, starts)[:, None]
    far -= starts @ (2.0 * points).T
    np.maximum(far, 0.0, out=far)  # squared, from the start
    offset_squared = np.maximum(far - dots**2 / divisor, 0.0)  # squared, from the axis
    steep = np.sqrt(np.where(cone, slope, divisor) / divisor)
    offset = np.sqrt(offset_squared)
    # Centre of the ball with the nearest surface, from 0 at the start to l^2 at the end.
    centre = dots - taper * offset / steep
    distances: FloatArray = offset * steep + dots * taper / divisor - first
    start = np.sqrt(far) - first
    np.copyto(distances, np.sqrt(offset_squared + (dots - squared) ** 2 / divisor) - second, where=centre >= squared)
    np.copyto(distances, start, where=centre <= 0.0)
    if not cone.all():
        ball = np.where(first >= second, start, np.sqrt(np.maximum(far - 2.0 * dots + squared, 0.0)) - second)
        np.copyto(distances, ball, where=~cone)
    return distances


def _skin_weights(
    distances: FloatArray, softness: FloatArray, joints: NDArray[np.intp]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Returns skinning joints and weights (V, 4) of vertices, from distances (V, C) to the capsules of each joint.

    softness: (C,) distance over which a vertex passes from one capsule to the next; the smaller of two counts.
    """
    nearest = distances.argmin(axis=1)
    soft = np.minimum(softness, softness[nearest, None])
    falloff = np.exp(-(distances - distances.min(axis=1, keepdims=True)) / soft)
    carriers = np.unique(joints)
    joint_falloff = np.stack([falloff[:, joints == joint].max(axis=1) for joint in carriers], axis=1)
    n_missing = max(0, N_JOINTS - len(carriers))
    joint_falloff = np.pad(joint_falloff, ((0, 0), (0, n_missing)))
    carriers = np.pad(carriers, (0, n_missing))
    order = np.argsort(-joint_falloff, axis=1, kind="stable")[:, :N_JOINTS]
    weights = np.take_along_axis(joint_falloff, order, axis=1)
    weights[weights < 0.02 * weights[:, :1]] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    return np.where(weights > 0.0, carriers[order], 0).astype(np.int64), weights
