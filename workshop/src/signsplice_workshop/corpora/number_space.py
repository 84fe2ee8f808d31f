"""The numbers of a frame: the positions of some joints in a cube that is scaled to [-0.5, 0.5]^3, one after another."""

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
"""Most joints named in an error."""


@dataclass(frozen=True)
class NumberSpace:
    """Which joints a frame's numbers hold, and the cube around the body that they are scaled by.

    - joints: names of J joints, in the order of the numbers
    - parents: index among these of the nearest joint above each; -1 for the first, which is above all
    - middle: cm, the middle of the cube; becomes 0
    - side: cm, the side of the cube; becomes 1

    Raises ``InputError`` where these do not fit together.
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
                "space: a joint does not stand after its parent, expected the first joint above all others"
            )
        cube = (*self.middle, self.side)
        if len(cube) != 4 or not np.isfinite(cube).all() or self.side <= 0.0:
            raise InputError(
                f"space: middle {self.middle} and side {self.side}, expected three numbers and one above 0"
            )

    @property
    def n_numbers(self) -> int:
        """Numbers a frame, 3 J."""
        return 3 * len(self.joints)

    def numbers(self, clip: Clip) -> FloatArray:
        """The numbers (T, 3 J) of a clip in cm. Joints are found by name, whatever stands before a colon in it.

        Raises ``InputError`` where the clip lacks one of the joints.
        """
        chosen = self.indices(clip.skeleton, clip.name)
        whole = chosen == list(range(len(clip.skeleton)))
        positions = kinematics.forward(clip, None if whole else chosen)[1]  # (T, J, 3)
        return np.asarray(((positions - np.array(self.middle)) / self.side).reshape(len(positions), -1))

    def positions(self, numbers: FloatArray) -> FloatArray:
        """The joint positions (T, J, 3), cm, of numbers (T, 3 J)."""
        return np.asarray(numbers.reshape(len(numbers), -1, 3) * self.side + np.array(self.middle))

    def indices(self, skeleton: Skeleton, name: str = "") -> list[int]:
        """The skeleton's joints (J,) that the numbers hold. Raises ``InputError``, naming the clip, where one lacks."""
        found = {_bare(joint): k for k, joint in enumerate(skeleton.names)} | skeleton.index
        missing = [joint for joint in self.joints if joint not in found and _bare(joint) not in found]
        if missing:
            some, more = ", ".join(missing[:_NAMED]), len(missing) - _NAMED
            raise InputError(
                f"{name or 'clip'}: has no joint {some}{f' and {more} more' if more > 0 else ''}; expected the "
                f"{len(self.joints)} joints of the space, {self.joints[0]} first"
            )
        return [found[joint] if joint in found else found[_bare(joint)] for joint in self.joints]

    def as_json(self) -> dict[str, Any]:
        """What ``read_space`` reads."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}


def space_of(
    skeleton: Skeleton, middle: Sequence[float], side: float, joints: Sequence[int] | None = None
) -> NumberSpace:
    """The space of some of a skeleton's joints, all by default, in the skeleton's order; the root is always one."""
    chosen = sorted({0, *(range(len(skeleton)) if joints is None else joints)})
    order = {joint: k for k, joint in enumerate(chosen)}
    parents = [
        next((order[above] for above in kinematics.path_to_root(skeleton, joint)[1:] if above in order), -1)
        for joint in chosen
    ]
    x, y, z = (float(value) for value in middle)
    return NumberSpace(tuple(skeleton.names[joint] for joint in chosen), tuple(parents), (x, y, z), float(side))


def read_space(row: object) -> NumberSpace:
    """The space in a row of JSON. Raises ``InputError`` for anything but what ``as_json`` gives."""
    try:
        if not isinstance(row, Mapping):
            raise TypeError(f"a {type(row).__name__}, expected an object")
        x, y, z = (float(value) for value in row["middle"])
        joints, parents = tuple(row["joints"]), tuple(int(parent) for parent in row["parents"])
        if not all(isinstance(joint, str) for joint in joints):
            raise TypeError("a joint that is no text")
        return NumberSpace(joints, parents, (x, y, z), float(row["side"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"space: {error}; expected joints, parents, middle and side") from error


def _bare(name: str) -> str:
    """A joint's name without what stands before its last colon, such as "mixamorig:"."""
    return name.rpartition(":")[2]
