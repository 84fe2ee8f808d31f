"""The cube around a synthetic signer that the numbers of a frame are scaled by."""

from __future__ import annotations

from signsplice.motion.clip import Skeleton
from signsplice.motion.number_space import NumberSpace, space_of

EXTENT = 1.3
"""Side of the cube, in statures, that is scaled to [-0.5, 0.5]^3: wide enough for every reach."""


def signer_space(bones: Skeleton, stature_cm: float) -> NumberSpace:
    """The numbers of all joints of a synthetic signer: cm from the middle of the body's height, over ``EXTENT``
    statures.
    """
    return space_of(bones, (0.0, 0.5 * stature_cm, 0.0), EXTENT * stature_cm)
