"""Bodies of other proportions on the same rig: bones stretched, skin shaped anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from signsplice.body.capsules import BodyShape
from signsplice.motion import EndSite, Skeleton, kinematics, rotation
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES


@dataclass(frozen=True)
class BodyProportions:
    """How a body differs from the source's; 1 for each is the same.

    shoulders: distance of the shoulders.
    arms: length of upper arms and forearms.
    hands: length of palms and fingers.
    trunk: height of the trunk and neck.
    shape: its skin.
    held_out: whether it is kept aside.
    """

    shoulders: float = 1.0
    arms: float = 1.0
    hands: float = 1.0
    trunk: float = 1.0
    shape: BodyShape = field(default_factory=BodyShape)
    held_out: bool = False

    @property
    def is_stretched(self) -> bool:
        """Whether its bones differ, not its skin alone."""
        return (self.shoulders, self.arms, self.hands, self.trunk) != (1.0, 1.0, 1.0, 1.0)


BODIES: Mapping[str, BodyProportions] = {
    "narrow": BodyProportions(shoulders=0.7, arms=0.85),
    "broad": BodyProportions(shoulders=1.4, arms=0.9, shape=BodyShape(trunk_width=1.3)),
    "child": BodyProportions(shoulders=0.8, arms=0.8, hands=0.9, shape=BodyShape(head=1.25)),
    "chibi": BodyProportions(shoulders=0.65, arms=0.8, shape=BodyShape(head=1.7)),
    "long arms": BodyProportions(shoulders=1.1, arms=1.2),
    "short arms": BodyProportions(arms=0.8),
    "small head": BodyProportions(shape=BodyShape(head=0.9)),
    "small hands": BodyProportions(hands=0.85, shape=BodyShape(hands=0.85)),
    "large hands": BodyProportions(hands=1.2, shape=BodyShape(hands=1.2)),
    "short trunk": BodyProportions(trunk=0.85),
    "belly": BodyProportions(shape=BodyShape(trunk_width=1.1, trunk_depth=1.3, limbs=1.1)),
    "thin": BodyProportions(shoulders=0.9, trunk=1.1, shape=BodyShape(trunk_width=0.8, trunk_depth=0.85, limbs=0.8)),
    "stout": BodyProportions(
        1.2, 0.9, 0.95, 0.95, BodyShape(trunk_width=1.2, trunk_depth=1.3, limbs=1.2, hands=1.1), held_out=True
    ),
    "youth": BodyProportions(0.85, 0.9, 0.95, 0.9, BodyShape(head=1.15, trunk_width=0.9), held_out=True),
    "lanky": BodyProportions(0.95, 1.15, 1.1, 1.15, BodyShape(head=0.95, trunk_depth=0.9, limbs=0.9), held_out=True),
}
"""Bodies by name; those with ``held_out`` are kept aside."""


def stretched(skeleton: Skeleton, body: BodyProportions) -> Skeleton:
    """The skeleton with its bones stretched, in the axes of the T-pose: shoulders sideways, trunk and neck upward,
    arms, palms and fingers along themselves. Raises ``InputError`` where its arms are not known by name.
    """
    info = rig_info(skeleton)
    joints, (left, _, _, right) = info.roles.joints, info.arm_joints[:4]
    factors = np.ones((len(skeleton), 3))
    chest = kinematics.common_ancestor(skeleton, [left, right])
    neck = joints.get("neck", joints.get("head", chest))
    factors[_path(skeleton, joints.get("hips", 0), neck), 1] *= body.trunk
    fingers: set[int] = set()
    for side in SIDES:
        arm, wrist = joints[f"{side}UpperArm"], joints[f"{side}Hand"]
        factors[_path(skeleton, chest, arm), 0] *= body.shoulders
        factors[_path(skeleton, arm, wrist)] *= body.arms
        hand = kinematics.subtree(skeleton, wrist)
        factors[hand[1:]] *= body.hands
        fingers |= set(hand)
    offsets, changed = np.array(skeleton.offsets), np.flatnonzero((factors != 1.0).any(axis=1))
    above = info.t_pose.rotations[skeleton.parents[changed]]
    upright = factors[changed] * rotation.rotate(above, offsets[changed])
    offsets[changed] = rotation.rotate(rotation.inverse(above), upright)
    sites = [EndSite(s.joint, s.offset * (body.hands if s.joint in fingers else 1.0)) for s in skeleton.end_sites]
    return Skeleton(skeleton.names, skeleton.parents, offsets, tuple(sites), skeleton.roles)


def _path(skeleton: Skeleton, above: int, joint: int) -> list[int]:
    """The joints from below ``above`` down to ``joint``."""
    way = kinematics.path_to_root(skeleton, joint)
    return way[: way.index(above)] if above in way else []
