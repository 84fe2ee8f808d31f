"""Landmarks of a video: named points of every frame, in the image's own coordinates.

A clip carries them as it carries a face. Kept frames keep their numbers bit for bit; resampled ones are interpolated,
and a clip of another framing is moved and scaled as a whole (``Points.reframe``). A point that the detector did not see
has confidence 0; its coordinates mean nothing, and are never interpolated with others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion.rotation import FloatArray

Float32 = NDArray[np.float32]

WORLD = "WORLD"
"""Part of the names of components whose coordinates are metres about the hips, not places in the image."""
_SAME_SCALE = 0.03
"""Relative difference of scale up to which two framings count as one: the estimates differ by as much."""
_SAME_PLACE_M = 0.02
"""Distance of the places of a signer up to which two framings count as one, m."""


@dataclass(frozen=True)
class Component:
    """A group of points, as a detector names it.

    name: its name: POSE_LANDMARKS.
    points: names of its points.
    limbs: pairs of points, by number, that a drawing joins by lines.
    colors: colours of the limbs, as a file has them.
    format: letters of a point's numbers, the last is C, its confidence: XYZC.
    """

    name: str
    points: tuple[str, ...]
    limbs: tuple[tuple[int, int], ...] = ()
    colors: tuple[tuple[int, int, int], ...] = ()
    format: str = "XYZC"


@dataclass(frozen=True)
class PointLayout:
    """The points of a recording.

    components: groups of points in order.
    size: width, height and depth of the image, pixels.
    """

    components: tuple[Component, ...]
    size: tuple[int, int, int] = (0, 0, 0)

    @cached_property
    def names(self) -> tuple[tuple[str, str], ...]:
        """Component and name of each of the P points."""
        return tuple((group.name, point) for group in self.components for point in group.points)

    @cached_property
    def in_image(self) -> NDArray[np.bool_]:
        """Which points (P,) have coordinates in the image."""
        return np.array([WORLD not in component.upper() for component, _ in self.names], bool)

    @property
    def n_dims(self) -> int:
        """Number of coordinates of a point, 2 or 3."""
        return max((len(group.format) for group in self.components), default=1) - 1


@dataclass(frozen=True)
class Framing:
    """Where a signer stands in the image: x right, y down; the signer's left is at the right.

    scale: image units a metre.
    x, y, z: image coordinates of the origin of the person's metres.
    """

    scale: float
    x: float
    y: float
    z: float = 0.0

    def is_like(self, other: Framing) -> bool:
        """Whether two framings show a signer in the same place and size, as far as they are known."""
        apart = float(np.hypot(self.x - other.x, self.y - other.y)) / self.scale
        return abs(self.scale / other.scale - 1.0) <= _SAME_SCALE and apart <= _SAME_PLACE_M


@dataclass(frozen=True, eq=False)
class Points:
    """The landmarks of a clip; T frames, P points, D coordinates.

    layout: names of the points.
    values: (T, P, D) float32, as the file has them.
    confidence: (T, P) float32, 0 for a point that was not seen.
    framing: where the signer stands in the image.

    Raises ``InputError`` if these do not fit together or a seen coordinate is not finite.
    """

    layout: PointLayout
    values: Float32
    confidence: Float32
    framing: Framing

    def __post_init__(self) -> None:
        for name in ("values", "confidence"):
            view = np.asarray(getattr(self, name), np.float32).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)
        shape = len(self.values), len(self.layout.names)
        if self.values.shape != (*shape, self.layout.n_dims) or self.confidence.shape != shape:
            raise InputError(
                f"points {self.values.shape} with confidences {self.confidence.shape}, expected {shape} "
                f"of {self.layout.n_dims} coordinates"
            )
        if not np.isfinite(self.confidence).all() or not np.isfinite(self.values[self.confidence > 0.0]).all():
            raise InputError("points: a coordinate or confidence of a seen point is not a finite number")

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, frames: slice | NDArray[np.intp]) -> Points:
        """Return the points of a slice of frames, or of frames at indices."""
        return self.changed(self.values[frames], self.confidence[frames])

    @property
    def nbytes(self) -> int:
        """Bytes of memory of the arrays."""
        return self.values.nbytes + self.confidence.nbytes

    def changed(self, values: Any, confidence: Any) -> Points:
        """Return the same layout and framing with other numbers, unchecked."""
        new = object.__new__(Points)
        new.__dict__.update(self.__dict__, values=values, confidence=confidence)
        return new

    def sample(self, low: NDArray[np.intp], high: NDArray[np.intp], weight: FloatArray) -> Points:
        """Return the points (N, P) between frames ``low`` and ``high`` (N,) at ``weight`` (N,), 0 at ``low``. A point
        seen in one of the two keeps its place there and fades by its confidence.
        """
        part = weight.astype(np.float32)[:, None]
        a, b, seen_a, seen_b = self.values[low], self.values[high], self.confidence[low], self.confidence[high]
        both = (seen_a > 0.0) & (seen_b > 0.0)
        values = np.where(((seen_a > 0.0) | (seen_b <= 0.0))[..., None], a, b)
        with np.errstate(invalid="ignore", over="ignore"):
            values = np.where(both[..., None], a + part[..., None] * (b - a), values)
        return self.changed(values, seen_a + part * (seen_b - seen_a))

    def reframe(self, layout: PointLayout, framing: Framing) -> Points:
        """Return the points in another layout, those that it lacks left out and those that these lack unseen, moved and
        scaled from one framing to the other; unchanged numbers if both show the same.
        """
        points = self if layout == self.layout else self._arrange(layout)
        if framing.is_like(self.framing):
            return replace(points, framing=framing)
        old, scale = self.framing, framing.scale / self.framing.scale
        shift = [new - scale * before for new, before in zip(_origin(framing), _origin(old), strict=True)]
        moved = points.values * np.float32(scale) + np.asarray(shift[: layout.n_dims], np.float32)
        values = np.where(layout.in_image[:, None], moved, points.values)
        return replace(points.changed(values, points.confidence), framing=framing)

    def _arrange(self, layout: PointLayout) -> Points:
        row_of = {name: row for row, name in enumerate(self.layout.names)}
        rows = np.array([row_of.get(name, -1) for name in layout.names], np.intp)
        n_dims = min(layout.n_dims, self.layout.n_dims)
        values = np.zeros((len(self), len(rows), layout.n_dims), np.float32)
        values[..., :n_dims] = self.values[:, rows, :n_dims]
        confidence = np.where(rows >= 0, self.confidence[:, rows], np.float32(0.0))
        return Points(layout, np.where((rows >= 0)[:, None], values, np.float32(0.0)), confidence, self.framing)


def _origin(framing: Framing) -> tuple[float, float, float]:
    return framing.x, framing.y, framing.z


def concatenate_points(parts: Sequence[Points | None]) -> Points | None:
    """Join points of one layout in time; None if a part has none, or points of another layout."""
    first = parts[0]
    if first is None or any(part is None or part.layout != first.layout for part in parts):
        return None
    known = [part for part in parts if part is not None]
    values = np.concatenate([part.values for part in known])
    return first.changed(values, np.concatenate([part.confidence for part in known]))
