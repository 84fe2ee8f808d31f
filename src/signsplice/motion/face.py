"""A face over time: ARKit's 52 coefficients, named, one row a frame.

Names and their order are those of Apple's ``ARFaceAnchor.BlendShapeLocation`` as Live Link Face writes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion.arrays import FloatArray

_EYE = ("Blink", "LookDown", "LookIn", "LookOut", "LookUp", "Squint", "Wide")
ARKIT_CHANNELS = (
    *(f"eye{part}{side}" for side in ("Left", "Right") for part in _EYE),
    "jawForward", "jawRight", "jawLeft", "jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthRight",
    "mouthLeft", "mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft", "mouthFrownRight", "mouthDimpleLeft",
    "mouthDimpleRight", "mouthStretchLeft", "mouthStretchRight", "mouthRollLower", "mouthRollUpper",
    "mouthShrugLower", "mouthShrugUpper", "mouthPressLeft", "mouthPressRight", "mouthLowerDownLeft",
    "mouthLowerDownRight", "mouthUpperUpLeft", "mouthUpperUpRight", "browDownLeft", "browDownRight", "browInnerUp",
    "browOuterUpLeft", "browOuterUpRight", "cheekPuff", "cheekSquintLeft", "cheekSquintRight", "noseSneerLeft",
    "noseSneerRight", "tongueOut",
)  # fmt: skip
"""The 52 coefficients in the order of a Live Link Face file."""
_KNOWN = frozenset(ARKIT_CHANNELS)


@dataclass(frozen=True, eq=False, repr=False)
class Face:
    """A face of T frames at the rate of the clip that carries it.

    channels: C different names of ``ARKIT_CHANNELS``; a coefficient that was not recorded is absent.
    weights: (T, C) from 0, at rest, to 1.

    Raises ``InputError`` for another name, one that comes twice, another shape, or a weight outside 0 to 1.
    """

    channels: tuple[str, ...]
    weights: FloatArray

    def __post_init__(self) -> None:
        weights = np.asarray(self.weights, np.float64).view()
        weights.flags.writeable = False
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "channels", tuple(self.channels))
        for k, name in enumerate(self.channels):
            if name not in _KNOWN:
                raise InputError(f"face: {name!r:.60} is none of ARKit's 52 coefficients")
            if name in self.channels[:k]:
                raise InputError(f"face: {name} comes twice, expected different coefficients")
        if not self.channels or weights.ndim != 2 or weights.shape[1] != len(self.channels):
            raise InputError(f"face: weights {weights.shape} for {len(self.channels)} coefficients, expected (T, C)")
        if not ((weights >= 0.0) & (weights <= 1.0)).all():  # False for NaN too
            t, k = np.argwhere(~((weights >= 0.0) & (weights <= 1.0)))[0]
            raise InputError(f"face: {self.channels[k]} is {weights[t, k]:g} at frame {t}, expected 0 to 1")

    def __repr__(self) -> str:
        return f"<Face: {len(self)} frames of {len(self.channels)} coefficients>"

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, frames: slice) -> Face:
        """The face in some frames, as views of its weights."""
        return Face(self.channels, self.weights[frames])

    def of(self, channels: Sequence[str]) -> FloatArray:
        """The weights (T, len(channels)) of some coefficients; 0, at rest, where one is absent."""
        out = np.zeros((len(self), len(channels)))
        column = {name: k for k, name in enumerate(self.channels)}
        for k, name in enumerate(channels):
            if name in column:
                out[:, k] = self.weights[:, column[name]]
        return out

    @property
    def moving(self) -> tuple[str, ...]:
        """The coefficients that are not at rest all the time."""
        most = self.weights.max(axis=0, initial=0.0).tolist()
        return tuple(name for name, weight in zip(self.channels, most, strict=True) if weight > 0.0)

    def mirrored(self) -> Face:
        """The face in the mirror: coefficients of the left and of the right change places."""
        return Face(tuple(_counterpart(name) for name in self.channels), self.weights)


def _counterpart(name: str) -> str:
    """A coefficient's name on the other side; the name itself in the middle."""
    for side, other in (("Left", "Right"), ("Right", "Left")):
        if name.endswith(side):
            return name.removesuffix(side) + other
    return name


def joined_faces(parts: Sequence[tuple[Face | None, int]]) -> Face | None:
    """Faces one after another, each with its number of frames, with all coefficients that any has; a part without a
    face, or without a coefficient, is at rest. None where no part has a face.
    """
    known = {name for face, _ in parts if face is not None for name in face.channels}
    if not known:
        return None
    channels = tuple(name for name in ARKIT_CHANNELS if name in known)
    rows = [np.zeros((n, len(channels))) if face is None else face.of(channels) for face, n in parts]
    return Face(channels, np.concatenate(rows))
