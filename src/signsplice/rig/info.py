"""What is known of a rig: the one place that ties roles, T-pose, sizes and the canonical map to a skeleton."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from signsplice.errors import InputError
from signsplice.motion.cache import kept
from signsplice.motion.clip import Skeleton
from signsplice.rig.canonical_map import CanonicalMap, map_roles
from signsplice.rig.naming import simplify
from signsplice.rig.proportions import BodySizes, measure
from signsplice.rig.roles import Humanoid, arm_joints, find_roles
from signsplice.rig.t_pose import TPose, t_pose


class RigInfo:
    """What follows from a skeleton alone; each part is computed when first asked for.

    skeleton: a copy, so that what is kept here does not keep the original alive.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = replace(skeleton)

    @cached_property
    def roles(self) -> Humanoid:
        """Which joint plays which role. Raises ``InputError`` where the skeleton's own roles do not fit it."""
        return find_roles(self.skeleton)

    @cached_property
    def simple_names(self) -> tuple[str, ...]:
        """Joint names in comparable form, see ``naming.simplify``."""
        return tuple(map(simplify, self.skeleton.names))

    @cached_property
    def t_pose(self) -> TPose:
        """The skeleton in the T-pose."""
        return t_pose(self.skeleton, self.roles)

    @cached_property
    def sizes(self) -> BodySizes:
        """Stature, arm length, shoulder width and length unit."""
        return measure(self.skeleton, self.roles, lambda: self.t_pose.positions)

    @cached_property
    def arm_joints(self) -> list[int]:
        """Joints of left then right upper arm, lower arm and hand, then the hips. Raises ``InputError`` where both arms
        are not known by name.
        """
        return arm_joints(self.skeleton, self.roles)

    @cached_property
    def has_arms(self) -> bool:
        """Whether both arms are known by name."""
        try:
            return bool(self.arm_joints)
        except InputError:
            return False

    @cached_property
    def canonical(self) -> CanonicalMap:
        """How the skeleton carries the roles of the canonical humanoid. Raises as ``arm_joints`` does."""
        return map_roles(self.skeleton, self.roles, self.t_pose, self.sizes.arm_length)


@kept
def rig_info(skeleton: Skeleton) -> RigInfo:
    """What is known of a skeleton, kept as long as the skeleton lives."""
    return RigInfo(skeleton)
