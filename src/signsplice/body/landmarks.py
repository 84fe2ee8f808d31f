"""What the landmarks of detectors belong to: joints of a person, and places on its head.

Known are MediaPipe Holistic, whole and reduced, OpenPose, OpenPose 135, COCO whole-body; of other layouts the points
whose names say a part of the body.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import Clip, FloatArray, Skeleton, kinematics, rotation
from signsplice.motion.points import Component, Framing, PointLayout, Points
from signsplice.rig.align import ORIGIN, place
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES, finger_roles

_BODY = {
    "shoulder": "UpperArm", "elbow": "LowerArm", "wrist": "Hand", "hip": "UpperLeg", "knee": "LowerLeg",
    "ankle": "Foot", "heel": "Foot", "footindex": "Foot", "bigtoe": "Foot", "smalltoe": "Foot", "pinky": "Hand",
    "index": "Hand", "thumb": "Hand",
}  # fmt: skip
"""Words of a body point's name -> role of the joint that it hangs on, without the side."""
_AT_JOINT = ("shoulder", "elbow", "wrist", "hip")
"""Those that are the joint."""
_FINGER_POINTS = re.compile(r"(thumb|index|middle|ring|pinky|little)([1-4])")
FACE_MESH = {
    "1": (0.0, 0.045, 0.115), "152": (0.0, -0.025, 0.075), "10": (0.0, 0.145, 0.085), "33": (-0.045, 0.09, 0.068),
    "263": (0.045, 0.09, 0.068), "133": (-0.016, 0.09, 0.074), "362": (0.016, 0.09, 0.074), "61": (-0.026, 0.01, 0.085),
    "291": (0.026, 0.01, 0.085), "234": (-0.072, 0.06, 0.0), "454": (0.072, 0.06, 0.0), "168": (0.0, 0.09, 0.09),
}  # fmt: skip
"""Points of the face mesh by number -> place on the standard person's head, m from its joint: left, up, ahead. A guess
of a usual face, to half a centimetre: so the fit takes the pitch that it finds in a whole clip for the guess's error.
"""
EYES_M = 0.09
"""Height of the eyes above the head's joint, m."""


@dataclass(frozen=True, eq=False)
class Anchors:
    """What each of P points hangs on.

    joints: (P,) joint of the skeleton, -1 for points outside of the image.
    offsets: (P, 3) from that joint, in its axes, m: depths of points, whose places in the image are seen.
    rows: name of a place -> the rows of points that show it, best first. Places: roles of joints, of fingertips
        (leftIndexTip), and ``face`` and a number of the face mesh.
    """

    joints: NDArray[np.intp]
    offsets: FloatArray
    rows: Mapping[str, tuple[int, ...]]


def find_anchors(layout: PointLayout, skeleton: Skeleton) -> Anchors:
    """Return what the points of a layout belong to: Holistic, whole and reduced, OpenPose, OpenPose 135, COCO."""
    roles = rig_info(skeleton).roles.joints
    joints, offsets = np.full(len(layout.names), -1, np.intp), np.zeros((len(layout.names), 3))
    rows: dict[str, list[int]] = {}
    row = 0
    for component in layout.components:
        for number, point in enumerate(component.points):
            role, place, offset = _anchor(component.name, len(component.points), number, point)
            if layout.in_image[row] and role in roles:
                joints[row] = roles[role]
                offsets[row] = offset if offset is not None else _tip_offset(skeleton, roles, place)
                if place:
                    rows.setdefault(place, []).append(row)
            row += 1
    for side in SIDES:  # OpenPose 135 has one wrist, of body and hand
        if f"{side}Wrist" not in rows and f"{side}IndexProximal" in rows and f"{side}Hand" in rows:
            rows[f"{side}Wrist"] = rows[f"{side}Hand"]
    return Anchors(joints, offsets, {place: tuple(sorted(numbers)) for place, numbers in rows.items()})


def _anchor(component: str, n_points: int, number: int, point: str) -> tuple[str, str, FloatArray | None]:
    """Return the role of the joint that a point hangs on, the place that it shows (empty if none), and its offset from
    the joint; None for the tip of a finger, which the skeleton decides.
    """
    group, name = component.lower(), re.sub(r"[^a-z0-9]", "", point.lower())
    zero = np.zeros(3)
    if "hand" in group and n_points == 21:  # all detectors: wrist, then four points of each finger
        side = "left" if "left" in group else "right"
        return (
            _hand_point(side, (number - 1) // 4, (number - 1) % 4) if number else (f"{side}Hand", f"{side}Wrist", zero)
        )
    side = "left" if name.startswith("l") else "right"
    word = name.removeprefix("left").removeprefix("right")
    word = word if word != name else name[1:]
    if finger := _FINGER_POINTS.match(word):
        names = [name.lower() for name in FINGERS]
        return _hand_point(side, names.index(finger[1].replace("pinky", "little")), int(finger[2]) - 1)
    if name in ("midhip", "neck", "upperneck"):
        return {"midhip": "hips"}.get(name, "neck"), "", zero
    if "face" not in group:
        for text, role in _BODY.items():
            if word.endswith(text):
                return f"{side}{role}", f"{side}{role}" if text in _AT_JOINT else "", zero
    offset = np.asarray(FACE_MESH.get(name, (0.0, 0.06, 0.08)) if "face" in group else (0.0, 0.06, 0.08))
    number_known = "face" in group and name in FACE_MESH and n_points >= 100
    return "head", f"face{name}" if number_known else "", offset


def _hand_point(side: str, finger: int, number: int) -> tuple[str, str, FloatArray | None]:
    if number == 3:
        return f"{side}{finger_roles(FINGERS[finger])[2]}", f"{side}{FINGERS[finger]}Tip", None
    role = f"{side}{finger_roles(FINGERS[finger])[number]}"
    return role, role, np.zeros(3)


def _tip_offset(skeleton: Skeleton, roles: Mapping[str, int], place: str) -> FloatArray:
    """Return the offset (3,) of a fingertip from the finger's last joint, in its axes: .8 of the bone before it."""
    side = "left" if place.startswith("left") else "right"
    last = roles[f"{side}{finger_roles(place.removeprefix(side).removesuffix('Tip'))[2]}"]
    axes = rig_info(skeleton).t_pose.rotations
    bone = rotation.rotate(axes[skeleton.parents[last]], skeleton.offsets[last])
    return np.asarray(0.8 * rotation.rotate(rotation.inverse(axes[last]), bone))


_HAND_POINTS = ("WRIST", *(f"{finger}_{part}" for finger, parts in (
    ("THUMB", "CMC MCP IP TIP"), *((f"{name}_FINGER", "MCP PIP DIP TIP") for name in ("INDEX", "MIDDLE", "RING")),
    ("PINKY", "MCP PIP DIP TIP")) for part in parts.split()))  # fmt: skip
_BODY_POINTS = tuple(f"{side}_{part}" for part in ("SHOULDER", "ELBOW", "WRIST", "HIP") for side in ("LEFT", "RIGHT"))
_FINGER_LIMBS = tuple((0 if n % 4 == 1 else n - 1, n) for n in range(1, 21))
HOLISTIC = PointLayout(
    (
        Component("POSE_LANDMARKS", _BODY_POINTS, ((0, 1), (0, 2), (1, 3), (2, 4), (3, 5), (0, 6), (1, 7), (6, 7))),
        Component("LEFT_HAND_LANDMARKS", _HAND_POINTS, _FINGER_LIMBS),
        Component("RIGHT_HAND_LANDMARKS", _HAND_POINTS, _FINGER_LIMBS),
    ),
    (1024, 1024, 1024),
)
"""Body, without its face, and hands of MediaPipe Holistic: the layout of landmarks made from motion."""
_FRAMING = Framing(600.0, 512.0, 1144.0)
"""Where a person of 1.7 m stands in that image."""


def project(clip: Clip) -> Points:
    """Return the landmarks of any rig's motion, as an upright camera far ahead sees them: x right, y down, z away from
    it, in pixels. Points without a joint are not seen. Raises ``InputError`` if the rig's arms are not known.
    """
    info = rig_info(clip.skeleton)
    _ = info.arm_joints
    anchors = find_anchors(HOLISTIC, clip.skeleton)
    rotations, positions = kinematics.forward(place(clip, ORIGIN))
    joints = np.maximum(anchors.joints, 0)
    places = positions[:, joints] + np.einsum("tpab,pb->tpa", rotations[:, joints], anchors.offsets)
    places = places * info.sizes.unit.metres
    values = _FRAMING.scale * places * (1.0, -1.0, -1.0) + (_FRAMING.x, _FRAMING.y, 0.0)
    seen = np.broadcast_to(anchors.joints >= 0, values.shape[:2])
    values = np.where(seen[..., None], values, 0.0)
    return Points(HOLISTIC, values.astype(np.float32), seen.astype(np.float32), _FRAMING)


@dataclass(frozen=True)
class ComponentFit:
    """How a group of landmarks is seen, and how well the fitted pose explains it.

    name, points: of the group.
    seen: fraction of its points, over all frames, that are seen.
    pixels: median distance in the image from its joints as seen to those of the pose; None without joints.
    """

    name: str
    points: int
    seen: float
    pixels: float | None


def measure_fit(clip: Clip) -> list[ComponentFit]:
    """Return how well a clip's pose explains its landmarks, group by group; nothing without landmarks."""
    points = clip.points
    if points is None:
        return []
    anchors = find_anchors(points.layout, clip.skeleton)
    rotations, positions = kinematics.forward(clip)
    rows = np.array(sorted({row for numbers in anchors.rows.values() for row in numbers}), np.intp)
    joints, framing = anchors.joints[rows], points.framing
    places = positions[:, joints] + np.einsum("tpab,pb->tpa", rotations[:, joints], anchors.offsets[rows])
    image = np.stack([framing.x + framing.scale * places[..., 0], framing.y - framing.scale * places[..., 1]], axis=-1)
    apart = np.linalg.norm(image - points.values[:, rows, :2], axis=-1)
    results, first = [], 0
    for group in points.layout.components:
        stop = first + len(group.points)
        inside = (rows >= first) & (rows < stop)
        seen = points.confidence[:, first:stop] > 0.0
        known = apart[:, inside][seen[:, rows[inside] - first]]
        pixels = round(float(np.median(known)), 1) if len(known) else None
        results.append(ComponentFit(group.name, len(group.points), round(float(seen.mean()), 3), pixels))
        first = stop
    return results
