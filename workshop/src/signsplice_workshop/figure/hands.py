"""The hands of the figure: capsules that blend into one another, as triangles, with nails."""

from __future__ import annotations

import numpy as np

from signsplice.body.capsules import N_JOINTS, body_capsules
from signsplice.lexicon import open_shipped_lexicon
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, finger_roles
from signsplice_workshop.figure.base import Floats
from signsplice_workshop.figure.blends import BoundCapsules, distances_from, pose_capsules, skin_weights, union
from signsplice_workshop.figure.body import ABOVE, Bodies
from signsplice_workshop.figure.clothes import Sheet
from signsplice_workshop.figure.surface_nets import surface

_STEP, _PALM_BLEND, _FINGER_BLEND, _BLEND = 0.0031, 0.0045, 0.0005, 0.0014
"""Distance of vertices, and radii of the blends within the palm, within a finger, and of these, statures."""
_SOFTNESS = 0.28
"""Softness of the transition from one joint to the next, in mean radii of the capsule."""
_WRIST = (0.75, 0.0125, 0.0135)
"""Beginning of the bare wrist in the sleeve, in lengths of the forearm; its radii there and at the hand, statures."""
_NAIL = (0.45, 1.15, 0.72)
"""Middle of a nail in lengths of the last phalanx, half its length and half its width, in radii of the tip."""


def make_hand(bodies: Bodies) -> dict[str, Sheet]:
    """Returns the left hand in the bind pose, and its nails."""
    skeleton = open_shipped_lexicon().clip("NAME").skeleton
    shape, height, joints = body_capsules(skeleton), bodies.height, rig_info(skeleton).roles.joints
    kinds = ("palm", *FINGERS, *(f"{finger}Tip" for finger in FINGERS))
    rows = [n for n, part in enumerate(shape.parts) if shape.sides[n] == "left" and part in kinds]
    capsules = pose_capsules(skeleton, shape, rows)
    groups = np.array([kinds.index(shape.parts[n].removesuffix("Tip")) for n in rows])
    elbow, wrist = bodies.bound["leftLowerArm"], bodies.bound["leftHand"]
    capsules = BoundCapsules(
        np.concatenate([capsules.starts, [elbow + _WRIST[0] * (wrist - elbow)]]),
        np.concatenate([capsules.ends, [wrist]]),
        np.concatenate([capsules.radii, [height * np.array(_WRIST[1:])]]),
        np.append(capsules.joints, joints["leftLowerArm"]),
    )
    groups = np.append(groups, 0)
    within = {k: height * (_FINGER_BLEND if k else _PALM_BLEND) for k in range(len(FINGERS) + 1)}

    def field(points: Floats) -> Floats:
        each = distances_from(points, capsules)
        return union(np.stack([union(each[groups == k], blend) for k, blend in within.items()]), height * _BLEND)

    margin = capsules.radii.max() + 2.0 * height * _BLEND
    ends = np.concatenate([capsules.starts, capsules.ends])
    points, normals, triangles = surface(field, ends.min(axis=0) - margin, ends.max(axis=0) + margin, height * _STEP)
    softness = _SOFTNESS * capsules.radii.mean(axis=1)
    carriers, weights = skin_weights(distances_from(points, capsules).T, softness, capsules.joints)
    role_of = {joint: role for role, joint in joints.items()}
    roles = [*bodies.weights, *hand_roles("left"), *hand_roles("right")]
    carried = np.zeros((len(points), len(roles)))
    for k in range(N_JOINTS):
        columns = np.array([roles.index(role_of.get(joint, "hips")) for joint in carriers[:, k].tolist()])
        np.add.at(carried, (np.arange(len(points)), columns), weights[:, k])
    shares = _shares(bodies, points, dict(zip(roles, carried.T, strict=True)))
    sheet = Sheet(points, normals, triangles, shares, carried)
    nail = np.full(len(points), -1.0)
    for k, n in enumerate(rows):
        if shape.parts[n].endswith("Tip"):
            nail = np.maximum(nail, _within_nail(sheet, capsules.starts[k], capsules.ends[k], capsules.radii[k, 1]))
    skin, nails = sheet.cut(nail)
    return {"hand": skin, "nails": nails}


def hand_roles(side: str) -> list[str]:
    """Returns the roles of the joints of a hand's fingers."""
    return [side + role for finger in FINGERS for role in finger_roles(finger)]


def hand_anchors(side: str) -> dict[str, str]:
    """Returns anchor of a hand -> the one above it, from the palm outwards."""
    above: dict[str, str] = {}
    for finger in FINGERS:
        chain = [f"{side}Hand", *(side + role for role in finger_roles(finger)), f"{side}{finger}DistalEnd"]
        above |= dict(zip(chain[1:], chain, strict=False))
    return above


def _within_nail(sheet: Sheet, start: Floats, end: Floats, radius: float) -> Floats:
    """Returns about how far vertices (V,) lie within the nail of a last phalanx, in radii of its tip."""
    axis = (end - start) / np.linalg.norm(end - start)
    back = np.array([0.0, 1.0, 0.0]) - axis[1] * axis
    back /= np.linalg.norm(back)
    middle, long, wide = _NAIL
    since = (sheet.points - start - (middle * np.linalg.norm(end - start) + 0.55 * radius) * axis) / radius
    u, v = since @ axis / long, since @ np.cross(axis, back) / wide
    is_near = (np.linalg.norm(since, axis=1) < 2.5) & (since @ back > 0.0)
    return np.where(is_near, 1.0 - (np.abs(u) ** 2.5 + np.abs(v) ** 2.5), -1.0)


def _shares(bodies: Bodies, points: Floats, carried: dict[str, Floats]) -> Floats:
    """Returns shares (V, K) of the anchors in the places of a left hand's vertices (V, 3): along each phalanx by the
    distance from its ends; in the palm between the wrist and the nearest knuckles.
    """
    names = [*ABOVE, *hand_anchors("left"), *hand_anchors("right")]
    shares, places = np.zeros((len(points), len(names))), bodies.bound
    ends = {above: name for name, above in hand_anchors("left").items() if above != "leftHand"}
    ends["leftLowerArm"] = "leftHand"

    def along(start: str, end: str) -> Floats:
        axis = places[end] - places[start]
        return np.clip((points - places[start]) @ axis / (axis @ axis), 0.0, 1.0)

    for role, end in ends.items():
        t = along(role, end)
        shares[:, names.index(role)] += carried[role] * (1.0 - t)
        shares[:, names.index(end)] += carried[role] * t
    knuckles = [name for name, above in hand_anchors("left").items() if above == "leftHand"]
    t = np.stack([along("leftHand", name) for name in knuckles])  # (5, V)
    wrist, ends_of_palm = places["leftHand"], np.array([places[name] for name in knuckles])
    nearest = wrist + t[:, :, None] * (ends_of_palm - wrist)[:, None]
    far = np.linalg.norm(points - nearest, axis=2)
    close = np.exp(-far / 0.8)
    close[far > np.sort(far, axis=0)[1]] = 0.0  # four anchors a vertex: two knuckles
    close *= carried["leftHand"] / close.sum(axis=0)
    for name, weight, k in zip(knuckles, close, t, strict=True):
        shares[:, names.index(name)] += weight * k
        shares[:, names.index("leftHand")] += weight * (1.0 - k)
    return shares


def mirror(sheet: Sheet, names: list[str], roles: list[str]) -> Sheet:
    """Returns a sheet of the left side on the right; names, roles: of the columns of its shares and weights."""

    def other(name: str) -> str:
        return name.replace("left", "right") if "left" in name else name.replace("right", "left")

    flip = np.array([-1.0, 1.0, 1.0])
    return Sheet(
        flip * sheet.points,
        flip * sheet.normals,
        sheet.triangles[:, ::-1],
        sheet.shares[:, [names.index(other(name)) for name in names]],
        sheet.carried[:, [roles.index(other(role)) for role in roles]],
    )
