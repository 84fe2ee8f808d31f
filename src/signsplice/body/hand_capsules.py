"""The capsules of hands: the palm from the wrist to each knuckle, and every phalanx, in human proportions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Skeleton
from signsplice.rig.roles import FINGERS

_SEGMENTS = ("Metacarpal", "Proximal", "Intermediate", "Distal")
_THICKNESS = {"Thumb": 0.0068, "Index": 0.0058, "Middle": 0.0059, "Ring": 0.0056, "Little": 0.0049}
"""Half a finger's breadth as a fraction of stature, about 10 mm on 1.70 m."""
_PALM, _MITTEN = (0.12, 0.0095, 1.22, 1.35), (0.08, 0.02, 0.018)
"""Where on the way to a knuckle its part of the palm begins, and the radius there; the radius at the knuckle, in those
of the finger, and of the thumb. Length and radii of a hand without fingers.
"""
_TAPER, _TIP = (1.12, 0.09), (0.2, 2.0, 0.8)
"""Radius of a first phalanx at its beginning, in those of the finger, and how much it falls with each. Least and
largest length of a last phalanx, in those of the one before, and the length where no end is known.
"""


@dataclass(frozen=True, eq=False)
class Capsule:
    """One capsule: its key, joint, both ends (3,) in the joint's frame, the radii there, part and side."""

    key: str
    joint: int
    start: FloatArray
    end: FloatArray
    start_radius: float
    end_radius: float
    part: str
    side: str = ""


def hand_capsules(
    skeleton: Skeleton, joints: Mapping[str, int], rest: FloatArray, side: str, height: float, thickness: float
) -> list[Capsule]:
    """The palm of one hand as capsules from the wrist to each knuckle, and every phalanx; none without a wrist.

    joints: of roles. rest: (J, 3) of the joints at rest. height: stature, in the unit of the skeleton. thickness: of
    fingers, 1 as usual.
    """
    wrist = joints.get(f"{side}Hand")
    if wrist is None:
        return []
    rows: list[Capsule] = []
    for finger in FINGERS:
        chain = [(r, joints[r]) for s in _SEGMENTS if (r := f"{side}{finger}{s}") in joints]
        if not chain:
            continue
        thick, palm = _THICKNESS[finger] * height * thickness, _PALM[1] * height * thickness
        knuckle, wider = rest[chain[0][1]] - rest[wrist], _PALM[3 if finger == "Thumb" else 2]
        ends, radii = (_PALM[0] * knuckle, knuckle), (palm, thick * wider)
        rows.append(Capsule(f"{side}{finger}Palm", wrist, *ends, *radii, "palm", side))
        for n, (role, joint) in enumerate(chain):
            is_last, taper = n + 1 == len(chain), _TAPER[0] - _TAPER[1] * n
            after = chain[min(n + 1, len(chain) - 1)][1]
            bone = _tip(skeleton, joint, [j for _, j in chain], rest) if is_last else rest[after] - rest[joint]
            part = finger + "Tip" if is_last else finger
            radii = thick * taper, thick * (taper - _TAPER[1])
            rows.append(Capsule(role, joint, np.zeros(3), bone, *radii, part, side))
    if not rows:  # no fingers: a mitten as long as a hand
        elbow = joints.get(f"{side}LowerArm")
        bone = rest[wrist] - rest[elbow] if elbow is not None else np.array([0.0, -1.0, 0.0])
        (length, r0, r1), thick = _MITTEN, height * thickness
        bone = bone / np.linalg.norm(bone) * length * height
        rows.append(Capsule(f"{side}Mitten", wrist, np.zeros(3), bone, r0 * thick, r1 * thick, "palm", side))
    return rows


def _tip(skeleton: Skeleton, joint: int, chain: list[int], rest: FloatArray) -> FloatArray:
    """Where a finger ends beyond its last joint: its end site or tip joint, else 0.8 of the phalanx before, straight
    on.
    """
    sites = [site.offset for site in skeleton.end_sites if site.joint == joint]
    sites += [skeleton.offsets[child] for child in skeleton.children[joint]]
    before = rest[joint] - rest[chain[-2]] if len(chain) > 1 else rest[joint] - rest[skeleton.parents[joint]]
    usual = float(np.linalg.norm(before))
    for bone in sites:
        if _TIP[0] * usual < np.linalg.norm(bone) < _TIP[1] * usual:
            return bone
    return np.asarray(_TIP[2] * before)
