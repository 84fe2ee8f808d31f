"""The figure: the mesh of a signer in clothes, whose proportions are those of any skeleton, and which its joints carry.

``workshop/runs/figure.py`` makes it from MakeHuman's base mesh (CC0) and, for the hands, from the capsules of
``body.capsules``. It stands in the bind pose: the T-pose with fingers spread, where bones of all rigs have the same
directions. Each vertex lies at an offset from a point between anchors (joints, fingertips, waist); on another skeleton,
the anchors are elsewhere, and the offsets grow with the stature. Its face has ARKit's 52 coefficients as morphs. Its
surface lies on the capsules, which hands touch. Bodies without two known arms are drawn as capsules.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import N_JOINTS, Avatar, BodyCapsules, MeshPart, body_capsules, capsule_ends
from signsplice.motion import FloatArray, Skeleton, kinematics, rotation
from signsplice.motion.cache import CACHE
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES
from signsplice.rig.t_pose import positions_from_rotations

STEP = 1e-5
"""Unit of the offsets in ``figure.npz``, statures."""
WAIST = 0.4
"""Height of the waist between hips and shoulders."""
SKIN_COLOURS = {"right": (0.95, 0.77, 0.66), "left": (0.89, 0.71, 0.61), "": (0.94, 0.76, 0.66)}
"""Colours of skin, sRGB 0 to 1; the left hand is a little darker than the right, to distinguish crossed hands."""
PART_COLOURS = {
    "shirt": (0.20, 0.25, 0.36),
    "trim": (0.15, 0.19, 0.28),
    "sleeve": (0.20, 0.25, 0.36),
    "cuff": (0.20, 0.25, 0.36),
    "trousers": (0.40, 0.39, 0.38),
    "leg": (0.40, 0.39, 0.38),
    "shoe": (0.22, 0.21, 0.21),
    "lips": (0.80, 0.50, 0.46),
    "mouth": (0.80, 0.50, 0.46),
    "eye": (0.95, 0.94, 0.92),
    "iris": (0.36, 0.25, 0.16),
    "pupil": (0.07, 0.06, 0.06),
    "lash": (0.13, 0.09, 0.08),
    "brow": (0.26, 0.18, 0.14),
    "teeth": (0.95, 0.93, 0.88),
    "tongue": (0.66, 0.34, 0.35),
    "hair": (0.27, 0.18, 0.14),
}
"""Colours of parts that are no skin, sRGB 0 to 1."""
_NAIL_SHADE = 1.03
"""Brightness of nails relative to skin."""
_SPREAD_DEG = {"Index": 7.0, "Middle": 1.0, "Ring": -6.0, "Little": -14.0}
"""Spread of the fingers in the bind pose, degrees, so that hands and wrists of all rigs are alike."""
_WRIST, _IN_SLEEVE = 0.8, 0.6
"""Of the wrist of a hand that is drawn as capsules: thickness in that of the forearm's end, and where it begins."""
_RINGS_DEG = np.array([150.0, 120.0, 90.0, 90.0, 60.0, 30.0])
"""Angles from its axis of the six rings of a drawn capsule, three at either end."""
_AROUND = 12
"""Number of vertices of a ring."""


def body_mesh(skeleton: Skeleton) -> tuple[MeshPart, ...]:
    """Returns the mesh of a skeleton in usual proportions, by parts, cached for its lifetime; an avatar's own mesh if
    it has one.
    """
    if isinstance(skeleton, Avatar) and skeleton.mesh:
        return skeleton.mesh
    return skeleton.derived[_body_mesh]


def _body_mesh(skeleton: Skeleton) -> tuple[MeshPart, ...]:
    return figure_mesh(skeleton, body_capsules(skeleton))


def colour(part: str, side: str) -> tuple[float, float, float]:
    """Returns the colour of a part of a body by its kind and side, sRGB 0 to 1."""
    red, green, blue = PART_COLOURS.get(part, SKIN_COLOURS[side])
    shade = _NAIL_SHADE if part == "nails" else 1.0
    return shade * red, shade * green, shade * blue


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
class FigureFile:
    """The figure as ``figure.npz`` has it: V vertices, F triangles, K anchors, R roles, P parts. Of anchors and roles,
    the one above comes first.

    anchors: (K,) names: roles, and those that ``find_anchors`` adds.
    anchors_above: (K,) number of the anchor from which one that is not known is measured.
    anchor_places: (K, 3) on the model's body, statures.
    anchor_capsules: (K,) key of the capsule by whose start the thickness there is measured; "" takes that above.
    anchor_radii: (K,) its radius on the model's body, statures.
    roles: (R,) that carry vertices.
    roles_above: (R,) number of the role that replaces one that is not known.
    part_names: (P,) with their side.
    part_roles: (P,) roles without which a part is left out, separated by blanks.
    parts: (F,) number of the part.
    triangles: (F, 3) numbers of vertices.
    offsets: (V, 3) from the points between anchors, steps.
    normals: (V, 3) in 127ths.
    anchor_rows, anchor_weights: (V, 4) the anchors of each vertex, and their weights in 255ths.
    role_rows, role_weights: (V, 4) the roles that carry each vertex, and their weights in 255ths.
    unit_counts: (52,) number of vertices that each coefficient of the face moves.
    unit_vertices, unit_moves: these vertices, coefficient by coefficient, and their displacements at 1, (N, 3) steps.
    """

    anchors: NDArray[np.str_]
    anchors_above: NDArray[np.uint8]
    anchor_places: FloatArray
    anchor_capsules: NDArray[np.str_]
    anchor_radii: FloatArray
    roles: NDArray[np.str_]
    roles_above: NDArray[np.uint8]
    part_names: NDArray[np.str_]
    part_roles: NDArray[np.str_]
    parts: NDArray[np.uint8]
    triangles: NDArray[np.uint16]
    offsets: NDArray[np.int16]
    normals: NDArray[np.int8]
    anchor_rows: NDArray[np.uint8]
    anchor_weights: NDArray[np.uint8]
    role_rows: NDArray[np.uint8]
    role_weights: NDArray[np.uint8]
    unit_counts: NDArray[np.uint16]
    unit_vertices: NDArray[np.uint16]
    unit_moves: NDArray[np.int16]


def _load() -> FigureFile:
    with files("signsplice.body").joinpath("figure.npz").open("rb") as file, np.load(file) as stored:
        return FigureFile(**{name: stored[name] for name in stored.files})


def figure_mesh(skeleton: Skeleton, shape: BodyCapsules) -> tuple[MeshPart, ...]:
    """Returns the figure on a skeleton whose body has the given capsules, by parts; capsules without two known arms."""
    joints, (rotations, positions) = rig_info(skeleton).roles.joints, bind_pose(skeleton)
    starts, ends = (p[0] for p in capsule_ends(shape, rotation.to_matrix(rotations)[None], positions[None]))
    if any(side + role not in joints for side in SIDES for role in ("UpperArm", "LowerArm", "Hand")):
        return _capsule_parts(shape, starts, ends, [*range(len(shape.parts))])
    figure = CACHE.recent(_load, most=1)
    anchors = find_anchors(joints, positions, dict(zip(shape.keys, ends, strict=True)))
    points, scale = _place(figure, rig_info(skeleton).sizes.stature or 1.0, anchors, shape)
    carriers = np.zeros(len(figure.roles), np.int64)
    for n, (role, above) in enumerate(zip(figure.roles.tolist(), figure.roles_above.tolist(), strict=True)):
        carriers[n] = joints.get(role, carriers[above] if n else 0)
    weights = figure.role_weights / 255.0
    carried = np.where(weights > 0.0, carriers[figure.role_rows], 0)
    normals = figure.normals / np.linalg.norm(figure.normals, axis=1, keepdims=True)
    triangles = figure.triangles.astype(np.int64)
    last = np.cumsum(figure.unit_counts.astype(np.int64)).tolist()
    parts: list[MeshPart] = []
    bare_hands: list[str] = []
    for number, (name, needed) in enumerate(zip(figure.part_names.tolist(), figure.part_roles.tolist(), strict=True)):
        side, kind = ("", *name.split())[-2:]
        if any(role not in joints for role in needed.split()):
            bare_hands += [side] if kind == "hand" else []
            continue
        corners = triangles[figure.parts == number]
        used, local = np.unique(corners), np.full(len(points), -1)
        local[used] = np.arange(len(used))
        morphs = {}
        for unit, n, end in zip(ARKIT_CHANNELS, figure.unit_counts.tolist(), last, strict=True):
            moved = local[figure.unit_vertices[end - n : end]]
            if (is_own := moved >= 0).any():
                moved = moved[is_own]
                morphs[unit] = moved, scale[used[moved]] * figure.unit_moves[end - n : end][is_own]
        tint, corners = colour(kind, side), local[corners]
        parts.append(MeshPart(name, tint, points[used], normals[used], corners, carried[used], weights[used], morphs))
    return (*parts, *_hand_capsules(shape, starts, ends, bare_hands))


def _hand_capsules(
    shape: BodyCapsules, starts: FloatArray, ends: FloatArray, sides: Collection[str]
) -> tuple[MeshPart, ...]:
    """Returns the hands of some sides as capsules, with wrists that begin in the sleeves; arguments as below."""
    is_wrist = np.array([[part == "cuff"] for part in shape.parts])
    kinds = tuple("palm" if part == "cuff" else part for part in shape.parts)
    bare = replace(shape, parts=kinds, radii=np.where(is_wrist, _WRIST * shape.radii[:, 1:], shape.radii))
    rows = [n for n, part in enumerate(kinds) if shape.sides[n] in sides and _kind(part) == "hand"]
    return _capsule_parts(bare, starts + np.where(is_wrist, _IN_SLEEVE, 0.0) * (ends - starts), ends, rows)


def find_anchors(
    joints: Mapping[str, int], positions: FloatArray, ends: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Returns the places (3,) of the joints of roles, of the fingers' ends, of the middle between the shoulders, and of
    a waist on the line from the hips by the spine to there.

    positions: (J, 3) joints in the bind pose. ends: of capsules, by their keys.
    """
    places = {role: positions[joint] for role, joint in joints.items()}
    places |= {f"{key}End": end for key, end in ends.items() if key.endswith("Distal")}
    places["girdle"] = 0.5 * (places["leftUpperArm"] + places["rightUpperArm"])
    if "hips" in places:
        line = np.stack([places["hips"], places.get("spine", places.get("chest", places["hips"])), places["girdle"]])
        height = line[0, 1] + WAIST * (line[2, 1] - line[0, 1])
        places["waist"] = np.array([np.interp(height, line[:, 1], line[:, axis]) for axis in range(3)])
    return places


def _place(
    figure: FigureFile, height: float, anchors: Mapping[str, FloatArray], shape: BodyCapsules
) -> tuple[FloatArray, FloatArray]:
    """Returns the figure's vertices (V, 3) on a body of a stature, and the length of a step at each (V, 1)."""
    places, thickness = height * figure.anchor_places, np.ones(len(figure.anchors))
    radii = dict(zip(shape.keys, (shape.radii[:, 0] / height).tolist(), strict=True))
    steps = places - places[figure.anchors_above]
    for n, (name, above) in enumerate(zip(figure.anchors.tolist(), figure.anchors_above.tolist(), strict=True)):
        places[n] = anchors.get(name, places[above] + steps[n])
        capsule = str(figure.anchor_capsules[n])
        thickness[n] = radii[capsule] / figure.anchor_radii[n] if capsule in radii else thickness[above]
    shares = figure.anchor_weights / 255.0
    scale = STEP * height * np.einsum("vk,vk->v", shares, thickness[figure.anchor_rows])[:, None]
    return np.einsum("vk,vkx->vx", shares, places[figure.anchor_rows]) + scale * figure.offsets, scale


def _kind(part: str) -> str:
    """Returns the kind of mesh that shows a capsule of a part."""
    return "hand" if part in ("palm", *FINGERS) or part.endswith("Tip") else part


def _capsule_parts(shape: BodyCapsules, starts: FloatArray, ends: FloatArray, rows: list[int]) -> tuple[MeshPart, ...]:
    """Returns some capsules, each a closed surface, by kind and side. starts, ends: (C, 3) of axes in the bind pose."""
    axes = ends - starts
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    axes = np.where(lengths > 0.0, axes / np.maximum(lengths, 1e-300), [0.0, 1.0, 0.0])
    first = np.cross(axes, np.eye(3)[np.abs(axes).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    turns = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    around = np.cos(turns)[:, None] * first[:, None] + np.sin(turns)[:, None] * np.cross(axes, first)[:, None]
    cos, sin = np.cos(np.deg2rad(_RINGS_DEG))[:, None, None], np.sin(np.deg2rad(_RINGS_DEG))[:, None, None]
    rings = cos * axes[:, None, None] + sin * around[:, None]  # (C, 6, 12, 3)
    normals = np.concatenate([-axes[:, None], rings.reshape(len(axes), -1, 3), axes[:, None]], axis=1)
    n_half = 1 + _AROUND * len(_RINGS_DEG) // 2
    points = np.concatenate([
        starts[:, None] + shape.radii[:, :1, None] * normals[:, :n_half],
        ends[:, None] + shape.radii[:, 1:, None] * normals[:, n_half:],
    ], axis=1)  # fmt: skip
    corner = np.arange(_AROUND)
    after, last = np.roll(corner, -1), normals.shape[1] - 1
    faces = [np.stack([0 * corner, 1 + after, 1 + corner], 1),
             np.stack([0 * corner + last, last - _AROUND + corner, last - _AROUND + after], 1)]  # fmt: skip
    for low in range(1, last - _AROUND, _AROUND):
        a, b, c, d = low + corner, low + after, low + _AROUND + after, low + _AROUND + corner
        faces += [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    one, count = np.concatenate(faces), normals.shape[1]
    groups: dict[tuple[str, str], list[int]] = {}
    for n in rows:
        groups.setdefault((shape.sides[n], _kind(shape.parts[n])), []).append(n)
    weights = np.eye(1, N_JOINTS)
    return tuple(
        MeshPart(
            f"{side} {kind}".strip(),
            colour(kind, side),
            points[own].reshape(-1, 3),
            normals[own].reshape(-1, 3),
            np.concatenate([one + k * count for k in range(len(own))]),
            np.pad(shape.joints[own].repeat(count)[:, None], ((0, 0), (0, N_JOINTS - 1))).astype(np.int64),
            np.tile(weights, (count * len(own), 1)),
        )
        for (side, kind), own in groups.items()
    )
