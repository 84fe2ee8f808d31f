"""The numbers of a frame: positions of chosen joints, scaled from a cube to [-0.5, 0.5]^3 and concatenated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip, Skeleton
from signsplice.motion.rotation import FloatArray

_NAMED = 3
"""Largest number of joints named in an error."""


@dataclass(frozen=True)
class NumberSpace:
    """The joints whose positions a frame's numbers hold, and the cube around the body that scales them.

    - joints: names of J joints, in the order of the numbers
    - parents: index among these of each joint's nearest ancestor; -1 for the first, the ancestor of all
    - middle: centre of the cube, cm; becomes 0
    - side: side of the cube, cm; becomes 1

    Raises ``InputError`` if these do not fit together.
    """

    joints: tuple[str, ...]
    parents: tuple[int, ...]
    middle: tuple[float, float, float]
    side: float

    def __post_init__(self) -> None:
        n = len(self.joints)
        if not n or len(set(self.joints)) != n or len(self.parents) != n or self.parents[0] != -1:
            raise InputError(
                f"space: {n} joints and {len(self.parents)} parents, expected different names, a parent for each, and "
                "-1 for the first"
            )
        if not all(0 <= parent < joint for joint, parent in enumerate(self.parents) if joint):
            raise InputError(
                "space: a joint comes before its parent, expected parents first and the first joint above all"
            )
        cube = (*self.middle, self.side)
        if len(cube) != 4 or not np.isfinite(cube).all() or self.side <= 0.0:
            raise InputError(
                f"space: middle {self.middle} and side {self.side}, expected three numbers and one above 0"
            )

    @property
    def n_numbers(self) -> int:
        """Returns the count of numbers in a frame, 3 J."""
        return 3 * len(self.joints)

    def to_numbers(self, clip: Clip) -> FloatArray:
        """Returns the numbers (T, 3 J) of a clip in cm. Joints are matched by name, without any prefix before a colon.

        Raises ``InputError`` if the clip lacks one of the joints.
        """
        joint_indices = self.find_joints(clip.skeleton, clip.name)
        all_joints = joint_indices == list(range(len(clip.skeleton)))
        positions = kinematics.forward(clip, None if all_joints else joint_indices)[1]  # (T, J, 3)
        return np.asarray(((positions - np.array(self.middle)) / self.side).reshape(len(positions), -1))

    def to_positions(self, numbers: FloatArray) -> FloatArray:
        """Returns the joint positions (T, J, 3), cm, of numbers (T, 3 J)."""
        return np.asarray(numbers.reshape(len(numbers), -1, 3) * self.side + np.array(self.middle))

    def find_joints(self, skeleton: Skeleton, name: str = "") -> list[int]:
        """Returns the indices (J,) of the space's joints in a skeleton. Raises ``InputError``, which names the clip, if
        one is missing.
        """
        indices = {_strip_prefix(joint): k for k, joint in enumerate(skeleton.names)} | skeleton.index
        missing = [joint for joint in self.joints if joint not in indices and _strip_prefix(joint) not in indices]
        if missing:
            listed, n_more = ", ".join(missing[:_NAMED]), len(missing) - _NAMED
            raise InputError(
                f"{name or 'clip'}: has no joint {listed}{f' and {n_more} more' if n_more > 0 else ''}; expected the "
                f"{len(self.joints)} joints of the space, {self.joints[0]} first"
            )
        return [indices[joint] if joint in indices else indices[_strip_prefix(joint)] for joint in self.joints]

    def as_json(self) -> dict[str, Any]:
        """Returns the space as ``read_space`` reads it."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}


def make_space(
    skeleton: Skeleton, middle: Sequence[float], side: float, joints: Sequence[int] | None = None
) -> NumberSpace:
    """Returns the space of some of a skeleton's joints, by default all, in the skeleton's order; the root is always
    one.
    """
    joint_indices = sorted({0, *(range(len(skeleton)) if joints is None else joints)})
    order = {joint: k for k, joint in enumerate(joint_indices)}
    parents = [
        next((order[ancestor] for ancestor in kinematics.path_to_root(skeleton, joint)[1:] if ancestor in order), -1)
        for joint in joint_indices
    ]
    x, y, z = (float(value) for value in middle)
    return NumberSpace(tuple(skeleton.names[joint] for joint in joint_indices), tuple(parents), (x, y, z), float(side))


def read_space(row: object) -> NumberSpace:
    """Returns the space in a JSON object. Raises ``InputError`` for anything that ``as_json`` does not return."""
    try:
        if not isinstance(row, Mapping):
            raise TypeError(f"a {type(row).__name__}, expected an object")
        x, y, z = (float(value) for value in row["middle"])
        joints, parents = tuple(row["joints"]), tuple(int(parent) for parent in row["parents"])
        if not all(isinstance(joint, str) for joint in joints):
            raise TypeError("a joint name that is no text")
        return NumberSpace(joints, parents, (x, y, z), float(row["side"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"space: {error}; expected joints, parents, middle and side") from error


def _strip_prefix(name: str) -> str:
    """Returns a joint's name without the prefix up to its last colon, such as "mixamorig:"."""
    return name.rpartition(":")[2]
