"""Clothes and skin of the figure: MakeHuman's surface on the body of the words that ship, in the bind pose.

The surface takes the proportions of that body with arms half lowered, as MakeHuman has them, follows the body's
capsules there, and is then brought into the T-pose so that linear blend skinning returns it exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from signsplice.body.capsules import body_capsules
from signsplice.body.mesh import bind_pose, find_anchors
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import rotation
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES
from signsplice_workshop.figure.base import BaseMesh, Floats, Index, mean_of_neighbours
from signsplice_workshop.figure.blends import BoundCapsules, distances_from, pose_capsules, union

ABOVE = {
    "girdle": "girdle", "hips": "girdle", "waist": "hips", "neck": "girdle", "head": "neck",
    **{side + role: above if above in ("girdle", "hips") else side + above for side in SIDES for role, above in (
        ("UpperArm", "girdle"), ("LowerArm", "UpperArm"), ("Hand", "LowerArm"), ("UpperLeg", "hips"),
        ("LowerLeg", "UpperLeg"), ("Foot", "LowerLeg"), ("Toes", "Foot"),
    )},
}  # fmt: skip
"""Anchor of the body -> the one above it."""
_TRUNK = ("hips", "waist", "girdle", "neck")
_BONES = {"UpperArm": "LowerArm", "LowerArm": "Hand", "UpperLeg": "LowerLeg", "LowerLeg": "Foot", "Foot": "Toes"}
_BLEND = 0.0085
"""Blend radius of the capsules of the trunk, statures."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """MakeHuman's body, and the words' body in the same pose and in the bind pose.

    base: MakeHuman's.
    weights: role of a bone -> weights (V,) of the vertices that it carries.
    theirs: anchor -> its place in MakeHuman's body, cm from the hips.
    posed: the same on the words' body with MakeHuman's pose.
    bound: the same in the bind pose.
    turns: role -> the rotation (3, 3) of its bone from ``posed`` to ``bound``.
    capsules: of trunk, neck and limbs in ``posed``.
    height: stature, cm.
    """

    base: BaseMesh
    weights: dict[str, Floats]
    theirs: dict[str, Floats]
    posed: dict[str, Floats]
    bound: dict[str, Floats]
    turns: dict[str, Floats]
    capsules: BoundCapsules
    height: float


def compare_bodies(base: BaseMesh) -> Bodies:
    """Returns MakeHuman's body beside that of the words."""
    skeleton = open_shipped_lexicon().clip("NAME").skeleton
    shape, info = body_capsules(skeleton), rig_info(skeleton)
    joints = info.roles.joints
    _, positions = bind_pose(skeleton)
    every = pose_capsules(skeleton, shape, [*range(len(shape.keys))])
    bound = find_anchors(joints, positions, dict(zip(shape.keys, every.ends, strict=True)))
    names = {role: skeleton.names[joint] for role, joint in joints.items() if skeleton.names[joint] in base.joints}
    own = np.array([10.0 * base.joints[name] for name in names.values()]) - 10.0 * base.joints[names["hips"]]
    numbers = {role: n for n, role in enumerate(names)}
    theirs = find_anchors(numbers, own, {})
    posed, turns = {name: place.copy() for name, place in bound.items()}, {}
    for side in SIDES:
        for role, end in _BONES.items():
            bone, aim = bound[side + end] - bound[side + role], theirs[side + end] - theirs[side + role]
            if role == "Foot":
                aim = bone
            aim = aim / np.linalg.norm(aim) * np.linalg.norm(bone)
            shift = posed[side + role] + aim - posed[side + end]
            chain = [name for name in posed if name == side + end or _is_below(name, side + end)]
            for name in chain:
                posed[name] = posed[name] + shift
            turns[side + role] = _swing(aim, bone)
        turns[side + "Hand"] = turns[side + "LowerArm"]
        turns[side + "Toes"] = np.eye(3)
    rows = [n for n, part in enumerate(shape.parts) if part in ("neck", "shirt", "sleeve", "cuff", "leg", "shoe")]
    chosen = pose_capsules(skeleton, shape, rows)
    starts, ends = chosen.starts.copy(), chosen.ends.copy()
    for k, n in enumerate(rows):
        if (key := shape.keys[n]) in turns:
            back, root = turns[key].T, bound[key]
            starts[k], ends[k] = (posed[key] + back @ (place - root) for place in (starts[k], ends[k]))
    capsules = BoundCapsules(starts, ends, chosen.radii, chosen.joints)
    weights = {role: base.weights[name].copy() for role, name in names.items()}
    for side in SIDES:
        for role in [role for role in weights if role.startswith(side) and any(f in role for f in FINGERS)]:
            weights[f"{side}Hand"] += weights.pop(role)
    return Bodies(base, weights, theirs, posed, bound, turns, capsules, info.sizes.stature)


def _is_below(name: str, role: str) -> bool:
    while name in ABOVE and ABOVE[name] != name:
        name = ABOVE[name]
        if name == role:
            return True
    return False


def _swing(start: Floats, end: Floats) -> Floats:
    """Returns the least rotation (3, 3) that turns one vector into the direction of another of the same length."""
    start, end = (vector / np.linalg.norm(vector) for vector in (start, end))
    return np.asarray(rotation.to_matrix(rotation.between_vectors(start, end)))


def anchor_shares(bodies: Bodies, points: Floats, weights: dict[str, Floats]) -> dict[str, Floats]:
    """Returns anchor -> shares (V,) of it in the places of points (V, 3), cm, of MakeHuman's body, which sum to 1.

    Along each bone they follow the distance from its ends; bones count as they carry a point.
    """
    shares = {name: np.zeros(len(points)) for name in ABOVE}
    places = bodies.theirs
    line = np.array([places[name][1] for name in _TRUNK])
    level = np.interp(points[:, 1], line, np.arange(len(_TRUNK)))
    for role, weight in weights.items():
        side = next((s for s in SIDES if role.startswith(s)), "")
        bone = role.removeprefix(side)
        if role == "head":
            shares["head"] += weight
        elif role == "neck":
            t = np.clip((points[:, 1] - line[-1]) / (places["head"][1] - line[-1]), 0.0, 1.0)
            shares["neck"] += weight * (1.0 - t)
            shares["head"] += weight * t
        elif bone == "Shoulder":
            t = np.clip(points[:, 0] / places[f"{side}UpperArm"][0], 0.0, 1.0)
            shares["girdle"] += weight * (1.0 - t)
            shares[f"{side}UpperArm"] += weight * t
        elif bone in _BONES:
            start, axis = places[role], places[side + _BONES[bone]] - places[role]
            t = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
            shares[role] += weight * (1.0 - t)
            shares[side + _BONES[bone]] += weight * t
        elif side:  # a hand or its fingers, toes
            shares[f"{side}Toes" if bone == "Toes" else f"{side}Hand"] += weight
        else:
            for n, name in enumerate(_TRUNK):
                shares[name] += weight * np.clip(1.0 - np.abs(level - n), 0.0, 1.0)
    return shares


def put_on(bodies: Bodies, points: Floats, shares: dict[str, Floats]) -> Floats:
    """Returns points (V, 3) of MakeHuman's body on that of the words in the same pose."""
    scale = bodies.height / 166.4
    moves = sum(share[:, None] * (bodies.posed[name] - scale * bodies.theirs[name]) for name, share in shares.items())
    return np.asarray(scale * points + moves)


def depth(bodies: Bodies, points: Floats) -> Floats:
    """Returns distances (V,) of points from the capsules in MakeHuman's pose, negative inside, cm."""
    return union(distances_from(points, bodies.capsules), _BLEND * bodies.height)


def follow_capsules(bodies: Bodies, points: Floats, triangles: Index, height: Floats) -> Floats:
    """Returns points (V, 3) moved smoothly until they lie at a ``height`` (V,) above the capsules."""
    mean = mean_of_neighbours(triangles, len(points))
    points = points.copy()
    for _ in range(10):
        away = depth(bodies, points)
        slope = np.stack([depth(bodies, points + 0.05 * axis) - away for axis in np.eye(3)], axis=1)
        slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-9)
        moves = np.clip(height - away, -3.0, 3.0)[:, None] * slope
        for _ in range(12):
            moves = mean @ moves
        points += 0.6 * moves
    return points


def bind(bodies: Bodies, points: Floats, weights: dict[str, Floats]) -> Floats:
    """Returns points (V, 3) in the bind pose, from which skinning returns them to MakeHuman's pose."""
    matrices, shifts = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    for role, weight in weights.items():
        turn, root = bodies.turns.get(role, np.eye(3)), role if role in bodies.turns else "hips"
        matrices += weight[:, None, None] * turn.T
        shifts += weight[:, None] * (bodies.posed[root] - turn.T @ bodies.bound[root])
    return np.asarray(np.linalg.solve(matrices, (points - shifts)[:, :, None])[:, :, 0])
